# SPDX-License-Identifier: BSD-2-Clause
"""Writes bodies and joints as the tree of a URDF; joints beyond the tree close loops.

An SDF has no tree. A joint is reversed if its child is in the tree first. A body without a joint
floats. In a URDF a link stands at its joint. Where the file has them apart, the joint bears a link
without mass, to which the link is fixed; so the name of a link is its frame in the file.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from .acting_elements import SPRINGS

WORLD = "world"
#: Larger limits count as none, [rad] or [m].
_WIDE = 1e9
#: Smaller distances and angles between a link and its joint are rounding of the poses, [m], [rad].
_ROUNDING = 1e-13


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

    `kind` is the type of a URDF, "ball", "universal", which has two axes, or "screw", whose body
    also slides along the axis by `lead` metres in a turn.
    """

    name: str
    kind: str
    links: tuple[str, str]
    places: tuple[pin.SE3, pin.SE3]
    axes: tuple[Axis, ...] = (Axis(),)
    lead: float = 0.0


class _Step(NamedTuple):
    """A joint of a URDF, one of those in series for a `GraphJoint`."""

    name: str
    kind: str
    axis: Axis


class JointGraph:
    """A URDF of bodies and joints; `add_link` adds the bodies, `add_frame` other frames.

    `balls` are the ball joints, which a URDF lacks. `helpers` are the links without mass that the
    file does not have: between two axes of a joint, between a joint and its link, and its frames.
    """

    def __init__(
        self, name: str, joints: Sequence[GraphJoint], rest: Mapping[str, pin.SE3]
    ) -> None:
        """`rest` has the pose of each body in the world at zero, for bodies that float."""
        self.urdf = ET.Element("robot", name=name)
        self.balls, self.helpers, self.problems = list[str](), list[str](), list[str]()
        self._bodies, left = [WORLD], list(joints)
        self._taken = {WORLD, *rest, *(joint.name for joint in joints)}
        ET.SubElement(self.urdf, "link", name=WORLD)
        while free := [body for body in rest if body not in self._bodies]:
            joint = next(self._next(left), None)
            if joint is None:  # nothing holds this body: it floats
                called = "floating_base" if len(self._bodies) == 1 else f"{free[0]}_floats"
                places = rest[free[0]], pin.SE3.Identity()
                joint = GraphJoint(called, "floating", (WORLD, free[0]), places)
            else:
                left.remove(joint)
            self._branch(joint)
        for joint in left:
            self._cut(joint)

    def _next(self, joints: list[GraphJoint]) -> Iterator[GraphJoint]:
        """Joints that add a body to the tree, in the order of its bodies."""
        for link in self._bodies:
            for joint in joints:
                a, b = joint.links
                if link in (a, b) and (a in self._bodies) != (b in self._bodies):
                    yield joint

    def _branch(self, joint: GraphJoint) -> None:
        """Add a joint to the tree; a reversed joint keeps its positions."""
        (parent, child), (on_parent, on_child) = joint.links, joint.places
        steps, sign = _steps(joint), 1
        if child in self._bodies:
            parent, child = child, parent
            on_parent, on_child = on_child, on_parent
            steps, sign = steps[::-1], -1
        self._bodies.append(child)
        if joint.kind == "ball":
            self.balls.append(joint.name)
        apart = not on_child.isIdentity(_ROUNDING)
        link, at = parent, on_parent
        for k, step in enumerate(steps):
            bearer, last = link, k == len(steps) - 1
            if not last:
                link = self._helper(f"{joint.name}_cross")
            elif apart:
                link = self._helper(f"{child}_at_{joint.name}")
            else:
                link = child
            element = self._joint(step.name, step.kind, (bearer, link), at)
            if step.kind != "floating":
                ET.SubElement(element, "axis", xyz=text_of(sign * step.axis.direction))
            if step.kind not in ("fixed", "floating"):
                _detail(element, step.axis, joint.kind != "ball")
            self._add_spring(step)
            at = pin.SE3.Identity()
        if apart:
            self._joint(
                self._new_name(f"{child}_fixed"), "fixed", (link, child), on_child.inverse()
            )

    def _joint(self, name: str, kind: str, links: tuple[str, str], place: pin.SE3) -> ET.Element:
        kind = "revolute" if kind == "ball" else kind
        element = ET.SubElement(self.urdf, "joint", name=name, type=kind)
        ET.SubElement(element, "parent", link=links[0])
        ET.SubElement(element, "child", link=links[1])
        ET.SubElement(element, "origin", origin_of(place))
        return element

    def _add_spring(self, step: _Step) -> None:
        """A spring as Gazebo has it in a URDF."""
        dynamics = step.axis.dynamics
        if dynamics.get("spring_stiffness"):
            spring = ET.SubElement(self.urdf, "gazebo", reference=step.name)
            for key, tag in SPRINGS.items():
                ET.SubElement(spring, tag).text = repr(dynamics[f"spring_{key}"])

    def _new_name(self, name: str) -> str:
        """The name, or a longer one if the file has it."""
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name

    def _helper(self, name: str) -> str:
        name = self._new_name(name)
        self.helpers.append(name)
        ET.SubElement(self.urdf, "link", name=name)
        return name

    def _cut(self, joint: GraphJoint) -> None:
        """Add a joint that closes a loop."""
        cut = ET.SubElement(self.urdf, "constraint", name=joint.name, type=joint.kind)
        first, last = joint.axes[0], joint.axes[-1]
        sides = zip(("parent", "child"), joint.links, joint.places, (first, last), strict=True)
        for side, link, place, axis in sides:
            ET.SubElement(cut, side, link=link)
            ET.SubElement(cut, f"{side}_origin", origin_of(place))
            ET.SubElement(cut, f"{side}_axis", xyz=text_of(axis.direction))
        texts = []
        if joint.kind == "screw":
            texts.append("is a screw, which no closure is")
        for axis in joint.axes:
            acting = ("damping", "friction", "spring_stiffness")
            texts += [f"has {key}" for key in acting if axis.dynamics.get(key)]
            if axis.mimic:
                texts.append("has mimic")
        if joint.kind == "universal" and abs(first.direction @ last.direction) > 1e-9:
            texts.append("its axes are not at a right angle")
        self.problems += [f"joint {joint.name}: closes a loop and {text}" for text in texts]

    def add_link(
        self, name: str, place: pin.SE3, mass: float, inertia: Mapping[str, float]
    ) -> ET.Element:
        """A link with its inertia, whose frame has a place on the link."""
        element = ET.SubElement(self.urdf, "link", name=name)
        part = ET.SubElement(element, "inertial")
        ET.SubElement(part, "origin", origin_of(place))
        ET.SubElement(part, "mass", value=repr(mass))
        ET.SubElement(part, "inertia", {key: repr(x) for key, x in inertia.items()})
        return element

    def add_frame(self, name: str, link: str, place: pin.SE3) -> None:
        """A frame on a link."""
        self.helpers.append(name)
        ET.SubElement(self.urdf, "link", name=name)
        self._joint(self._new_name(f"{name}_fixed"), "fixed", (link, name), place)


def _steps(joint: GraphJoint) -> list[_Step]:
    """The joints of one axis that a joint consists of."""
    if joint.kind == "universal":
        names = axis_names(joint.name, 2)
        return [_Step(*each) for each in zip(names, ("revolute",) * 2, joint.axes, strict=True)]
    if joint.kind == "screw":
        (axis,) = joint.axes
        per_radian = repr(joint.lead / (2 * np.pi))
        follows = {"joint": joint.name, "multiplier": per_radian, "offset": "0.0"}
        slide = Axis(axis.direction, mimic=follows)
        turn = _Step(joint.name, "revolute", axis)
        return [turn, _Step(f"{joint.name}_slide", "prismatic", slide)]
    return [_Step(joint.name, joint.kind, joint.axes[0])]


def axis_names(joint: str, count: int) -> list[str]:
    """Names of the joints of one axis for a joint of several axes."""
    return [joint] if count < 2 else [f"{joint}_{k}" for k in range(1, count + 1)]


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
