# SPDX-License-Identifier: BSD-2-Clause
"""Writes bodies and joints as the tree of a URDF; joints beyond the tree close loops.

An SDF has no tree. A joint is reversed if its child is in the tree first. A body without a joint
floats.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from .acting_words import SPRINGS

WORLD = "world"
#: Larger limits count as none, [rad] or [m].
_WIDE = 1e9


class Axis(NamedTuple):
    """Direction of an axis in the joint's frame, and attributes as a URDF has them.

    An effort or a velocity of 0 is no limit.
    """

    direction: Array = np.eye(3)[2]
    limit: Mapping[str, float] = {"lower": -np.inf, "upper": np.inf}
    dynamics: Mapping[str, float] = {}
    mimic: Mapping[str, str] = {}


class GraphJoint(NamedTuple):
    """A joint between two links, parent and child, and its frame on both.

    `kind` is the type of a URDF, "ball", or "universal", which has two axes.
    """

    name: str
    kind: str
    links: tuple[str, str]
    places: tuple[pin.SE3, pin.SE3]
    axes: tuple[Axis, ...] = (Axis(),)


class JointGraph:
    """A URDF of bodies and joints; `add_link` adds the bodies.

    `frames` has the pose of each link's frame in the URDF relative to its frame in the file.
    `balls` are the ball joints, which a URDF lacks. `crosses` are the links between two axes of a
    joint.
    """

    def __init__(
        self, name: str, joints: Sequence[GraphJoint], rest: Mapping[str, pin.SE3]
    ) -> None:
        """`rest` has the pose of each body in the world at zero, for bodies that float."""
        self.urdf, self.frames = ET.Element("robot", name=name), {WORLD: pin.SE3.Identity()}
        self.balls, self.problems, left = list[str](), list[str](), list(joints)
        self.crosses = list[str]()
        self.gravity = np.array([0, 0, -9.81])
        ET.SubElement(self.urdf, "link", name=WORLD)
        while free := [body for body in rest if body not in self.frames]:
            joint = next(self._next(left), None)
            if joint is None:  # nothing holds this body: it floats
                called = "floating_base" if len(self.frames) == 1 else f"{free[0]}_floats"
                places = rest[free[0]], pin.SE3.Identity()
                joint = GraphJoint(called, "floating", (WORLD, free[0]), places)
            else:
                left.remove(joint)
            self._branch(joint)
        for joint in left:
            self._cut(joint)

    def _next(self, joints: list[GraphJoint]) -> Iterator[GraphJoint]:
        """Joints that add a body to the tree, in the order of its bodies."""
        for link in self.frames:
            for joint in joints:
                a, b = joint.links
                if link in (a, b) and (a in self.frames) != (b in self.frames):
                    yield joint

    def _branch(self, joint: GraphJoint) -> None:
        """Add a joint to the tree; a reversed joint keeps its positions."""
        ((parent, child), (there, here)), swap = (joint.links, joint.places), False
        if child in self.frames:
            parent, child, there, here, swap = child, parent, here, there, True
        self.frames[child] = here
        self.balls += [joint.name] * (joint.kind == "ball")
        at, sign = self.frames[parent].actInv(there), -1 if swap else 1
        names = [joint.name] if len(joint.axes) == 1 else [f"{joint.name}_{k}" for k in (1, 2)]
        steps = list(zip(names, joint.axes, strict=True))[::sign]
        for name, axis in steps:
            link = child if name == steps[-1][0] else f"{joint.name}_cross"
            if link != child:
                ET.SubElement(self.urdf, "link", name=link)
                self.crosses.append(link)
            kind = "revolute" if joint.kind in ("universal", "ball") else joint.kind
            element = ET.SubElement(self.urdf, "joint", name=name, type=kind)
            ET.SubElement(element, "parent", link=parent)
            ET.SubElement(element, "child", link=link)
            ET.SubElement(element, "origin", origin_of(at))
            if kind != "floating":
                ET.SubElement(element, "axis", xyz=text_of(sign * axis.direction))
            if kind not in ("fixed", "floating"):
                _detail(element, axis, joint.kind != "ball")
            if axis.dynamics.get("spring_stiffness"):  # as Gazebo has it in a URDF
                spring = ET.SubElement(self.urdf, "gazebo", reference=name)
                for key, tag in SPRINGS.items():
                    ET.SubElement(spring, tag).text = repr(axis.dynamics[f"spring_{key}"])
            parent, at = link, pin.SE3.Identity()

    def _cut(self, joint: GraphJoint) -> None:
        """Add a joint that closes a loop."""
        cut = ET.SubElement(self.urdf, "constraint", name=joint.name, type=joint.kind)
        first, last = joint.axes[0], joint.axes[-1]
        sides = zip(("parent", "child"), joint.links, joint.places, (first, last), strict=True)
        for side, link, place, axis in sides:
            ET.SubElement(cut, side, link=link)
            ET.SubElement(cut, f"{side}_origin", origin_of(self.frames[link].actInv(place)))
            ET.SubElement(cut, f"{side}_axis", xyz=text_of(axis.direction))
        acting = ("damping", "friction", "spring_stiffness")
        texts = [f"has {k}" for axis in joint.axes for k in acting if axis.dynamics.get(k)]
        texts += ["has mimic"] * any(axis.mimic for axis in joint.axes)
        if joint.kind == "universal" and abs(first.direction @ last.direction) > 1e-9:
            texts.append("its axes are not at a right angle")
        self.problems += [f"joint {joint.name}: closes a loop and {text}" for text in texts]

    def add_link(
        self, name: str, place: pin.SE3, mass: float, inertia: Mapping[str, float]
    ) -> ET.Element:
        """A link with its inertia; `place` is that of the inertia in the frame of the file."""
        element = ET.SubElement(self.urdf, "link", name=name)
        part = ET.SubElement(element, "inertial")
        ET.SubElement(part, "origin", origin_of(self.frames[name].actInv(place)))
        ET.SubElement(part, "mass", value=repr(mass))
        ET.SubElement(part, "inertia", {key: repr(x) for key, x in inertia.items()})
        return element


def _detail(element: ET.Element, axis: Axis, may_be_endless: bool) -> None:
    """Add the limits, friction and mimic of an axis to a joint."""
    low, high = axis.limit["lower"], axis.limit["upper"]
    if may_be_endless and element.get("type") == "revolute" and low <= -_WIDE and high >= _WIDE:
        element.set("type", "continuous")
    limit = {"lower": max(low, -_WIDE), "upper": min(high, _WIDE)}
    for key in ("effort", "velocity"):
        value = axis.limit.get(key, 0.0)
        limit[key] = value if 0 < value < _WIDE else 0.0
    ET.SubElement(element, "limit", {key: repr(float(x)) for key, x in limit.items()})
    friction = {key: repr(x) for key, x in axis.dynamics.items() if not key.startswith("spring")}
    ET.SubElement(element, "dynamics", friction)
    if axis.mimic:
        ET.SubElement(element, "mimic", dict(axis.mimic))


def origin_of(place: pin.SE3) -> dict[str, Any]:
    """Attributes of the `<origin>` of a URDF."""
    return {"xyz": text_of(place.translation), "rpy": text_of(pin.rpy.matrixToRpy(place.rotation))}


def text_of(vector: Array) -> str:
    """Numbers with all their digits, separated by blanks."""
    return " ".join(map(repr, map(float, vector)))
