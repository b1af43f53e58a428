# SPDX-License-Identifier: BSD-2-Clause
"""Writes links and joints as the tree of a URDF; joints beyond the tree close loops.

An SDF is a graph of links, not a tree. The tree is grown from the world, link by link. A joint is
reversed if its child is in the tree before its parent. A link without a joint floats. A joint with
several axes becomes several joints of a URDF in series, its steps.

In a URDF the frame of a link is at its joint. If the file has them at different poses, the joint
moves a helper link without mass, and the link is fixed to the helper. So each link keeps its frame
from the file.
"""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.conventions import NO_LIMIT
from .problems import Problem, warning
from .tool_elements import SPRINGS

#: Name of the base, as in an SDF.
WORLD = "world"
#: Smaller distances and angles between a link and its joint are rounding of the poses, [m], [rad].
_ROUNDING = 1e-13
#: Largest cosine of the angle between two axes that count as orthogonal.
_ORTHOGONAL = 1e-9


@dataclass(frozen=True)
class Axis:
    """Direction of an axis in the joint's frame, and attributes of elements of a URDF.

    An effort or a velocity of 0 means that there is no limit.
    """

    direction: Array = field(default_factory=lambda: np.eye(3)[2])
    #: Of `<limit>`: lower, upper, effort, velocity.
    limit: Mapping[str, float] = field(default_factory=lambda: {"lower": -np.inf, "upper": np.inf})
    #: Of `<dynamics>`: damping, friction; and spring_stiffness, spring_reference.
    dynamics: Mapping[str, float] = field(default_factory=dict)
    #: Of `<mimic>`: joint, multiplier, offset; empty if the joint follows no other.
    mimic: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class GraphJoint:
    """A joint between two links."""

    name: str
    #: The type of a URDF, or "ball", "universal" (two axes), or "screw".
    kind: str
    parent: str
    child: str
    #: The pose of the joint's frame on the parent and on the child, at position zero.
    on_parent: pin.SE3
    on_child: pin.SE3
    axes: tuple[Axis, ...] = (Axis(),)
    #: How far the body of a screw slides along the axis in one turn, [m].
    lead: float = 0.0


class _Step(NamedTuple):
    """One of the joints of a URDF, in series, that replace a joint; it has one axis at most."""

    name: str
    kind: str
    axis: Axis


class _TreeJoint(NamedTuple):
    """A joint in the tree; its parent is nearer to the world than its child."""

    parent: str
    child: str
    #: The pose of the joint's frame on the parent and on the child, at position zero.
    on_parent: pin.SE3
    on_child: pin.SE3
    #: Its steps from parent to child.
    steps: list[_Step]


class JointGraph:
    """Links and joints as the elements of a URDF.

    The constructor makes the joints. `add_link` adds the links, `add_frame` frames, and
    `add_ball_constraint` balls that close loops.

    Attributes:
        urdf: The root of the URDF.
        balls: Names of the ball joints. URDF has none, so they are written as revolute.
        helpers: Names of links without mass that are not in the file: between two axes of a joint,
            between a joint and its link, and for frames.
        problems: Names that are used twice, and parts of joints that close loops, such as friction,
            that are not supported.
        notes: Warnings of limits of joints that close loops.
    """

    def __init__(
        self,
        name: str,
        joints: Sequence[GraphJoint],
        poses: Mapping[str, pin.SE3],
        frames: Collection[str] = (),
    ) -> None:
        """Make the joints, and the helpers between them.

        Args:
            name: The name of the robot.
            joints: All joints.
            poses: The pose of each link in the world when all positions are zero.
            frames: Names of the frames that `add_frame` will add.
        """
        self.urdf = ET.Element("robot", name=name)
        self.balls = list[str]()
        self.helpers = list[str]()
        self.problems = list[str]()
        self.notes = list[Problem]()
        self._in_tree = [WORLD]  # links, in the order in which the tree grows
        self._joint_names = {joint.name for joint in joints}
        # All names that are used; names of helpers and of joints that are made here must be new.
        self._names = {WORLD, *poses, *frames, *self._joint_names}
        self._names.update(step.name for each in joints for step in _steps(each))
        ET.SubElement(self.urdf, "link", name=WORLD)
        # Grow the tree until each link is in it. Where no joint leads on, the link floats.
        remaining = list(joints)  # joints that are not in the tree
        for link in poses:
            while link not in self._in_tree:
                joint = self._next_joint(remaining)
                if joint is None:
                    joint = self._floating_joint(link, poses[link])
                else:
                    remaining.remove(joint)
                self._add_to_tree(joint)
        for joint in remaining:
            self._add_constraint(joint)

    def _next_joint(self, joints: list[GraphJoint]) -> GraphJoint | None:
        """A joint between a link in the tree and a link that is not; None if there is none.

        Links that are in the tree for longer come first, then the order of the joints.
        """
        for link in self._in_tree:
            for joint in joints:
                is_on_link = link in (joint.parent, joint.child)
                one_is_new = (joint.parent in self._in_tree) != (joint.child in self._in_tree)
                if is_on_link and one_is_new:
                    return joint
        return None

    def _floating_joint(self, link: str, pose: pin.SE3) -> GraphJoint:
        """A floating joint for a link that no joint connects with the tree.

        `pose` is the pose of the link in the world when the position of this joint is zero.
        """
        name = "floating_base" if len(self._in_tree) == 1 else f"{link}_floats"
        name = self._new_name(name)
        return GraphJoint(name, "floating", WORLD, link, pose, pin.SE3.Identity())

    def _add_to_tree(self, graph_joint: GraphJoint) -> None:
        """Add a joint of the tree; it is reversed if its child is in the tree already."""
        joint = _tree_joint(graph_joint, is_reversed=graph_joint.child in self._in_tree)
        self._in_tree.append(joint.child)
        is_ball = graph_joint.kind == "ball"
        if is_ball:
            self.balls.append(graph_joint.name)

        # In a URDF the frame of a link is at its joint. If it is elsewhere in the file, the last
        # step moves a helper, to which the link is fixed.
        needs_helper = not joint.on_child.isIdentity(_ROUNDING)
        parent = joint.parent
        pose = joint.on_parent
        self._require_free_names(graph_joint, joint.steps)
        for number, step in enumerate(joint.steps, start=1):
            is_last = number == len(joint.steps)
            if not is_last:
                child = self._add_helper(f"{graph_joint.name}_cross")
            elif needs_helper:
                child = self._add_helper(f"{joint.child}_at_{graph_joint.name}")
            else:
                child = joint.child
            element = self._add_joint(step.name, step.kind, parent, child, pose)
            if step.kind != "floating":
                ET.SubElement(element, "axis", xyz=text_of(step.axis.direction))
            if step.kind not in ("fixed", "floating"):
                _add_numbers(element, step.axis, may_be_continuous=not is_ball)
            self._add_spring(step)
            parent = child
            pose = pin.SE3.Identity()  # all steps have the frame of the joint
        if needs_helper:
            name = self._new_name(f"{joint.child}_fixed")
            self._add_joint(name, "fixed", parent, joint.child, joint.on_child.inverse())

    def _require_free_names(self, joint: GraphJoint, steps: Sequence[_Step]) -> None:
        """Add a problem if a step of a joint would get the name of another joint.

        A step cannot have another name, because `<mimic>` and users refer to it by this one.
        """
        for step in steps:
            if step.name != joint.name and step.name in self._joint_names:
                text = f"a part of it gets the name {step.name}, which another joint has"
                self.problems.append(f"joint {joint.name}: {text}; rename one of them")

    def _add_joint(
        self, name: str, kind: str, parent: str, child: str, place: pin.SE3
    ) -> ET.Element:
        """Add a joint between two links, with its frame at a place on the parent."""
        if kind == "ball":  # `balls` has its name
            kind = "revolute"
        element = ET.SubElement(self.urdf, "joint", name=name, type=kind)
        ET.SubElement(element, "parent", link=parent)
        ET.SubElement(element, "child", link=child)
        ET.SubElement(element, "origin", origin_of(place))
        return element

    def _add_spring(self, step: _Step) -> None:
        """Add the spring of a joint as Gazebo's element of a URDF."""
        dynamics = step.axis.dynamics
        if not dynamics.get("spring_stiffness"):
            return
        spring = ET.SubElement(self.urdf, "gazebo", reference=step.name)
        for key, tag in SPRINGS.items():  # the keys are stiffness and reference
            ET.SubElement(spring, tag).text = repr(dynamics[f"spring_{key}"])

    def _new_name(self, name: str) -> str:
        """The name, with underscores appended until it is unique."""
        while name in self._names:
            name += "_"
        self._names.add(name)
        return name

    def _add_helper(self, name: str) -> str:
        """Add a link without mass; returns its unique name."""
        name = self._new_name(name)
        self.helpers.append(name)
        ET.SubElement(self.urdf, "link", name=name)
        return name

    def add_ball_constraint(self, texts: Mapping[str, str]) -> None:
        """Add a `<drake:ball_constraint>`, which closes a loop.

        `texts` has the texts of its parts in the SDF, by tag.
        """
        element = ET.SubElement(self.urdf, "drake:ball_constraint")
        for tag, text in texts.items():
            # In a URDF a body has its text in the attribute `name`, a point in `value`.
            ET.SubElement(element, tag, name=text, value=text)

    def _add_constraint(self, joint: GraphJoint) -> None:
        """Add a joint that closes a loop, and problems of parts that such a joint cannot have.

        It becomes a `<constraint>`, which `loop_elements` reads, with a link, an origin and an axis
        on both sides. A universal joint has its first axis on the parent, its second on the child.
        """
        first_axis = joint.axes[0]
        last_axis = joint.axes[-1]
        element = ET.SubElement(self.urdf, "constraint", name=joint.name, type=joint.kind)
        ET.SubElement(element, "parent", link=joint.parent)
        ET.SubElement(element, "parent_origin", origin_of(joint.on_parent))
        ET.SubElement(element, "parent_axis", xyz=text_of(first_axis.direction))
        ET.SubElement(element, "child", link=joint.child)
        ET.SubElement(element, "child_origin", origin_of(joint.on_child))
        ET.SubElement(element, "child_axis", xyz=text_of(last_axis.direction))
        texts = []
        if joint.kind == "screw":
            texts.append("is a screw, which no closure replaces")
        for axis in joint.axes:
            for key in ("damping", "friction", "spring_stiffness"):
                if axis.dynamics.get(key):
                    texts.append(f"has {key}")
            if axis.mimic:
                texts.append("has mimic")
        cosine = first_axis.direction @ last_axis.direction
        if joint.kind == "universal" and abs(cosine) > _ORTHOGONAL:
            texts.append("its axes are not at a right angle")
        self.problems += [f"joint {joint.name}: closes a loop and {text}" for text in texts]
        if any(
            axis.limit["lower"] > -NO_LIMIT or axis.limit["upper"] < NO_LIMIT for axis in joint.axes
        ):
            text = "limits of a joint that closes a loop are ignored"
            self.notes.append(warning(f"joint {joint.name}", text))

    def add_link(
        self, name: str, place: pin.SE3, mass: float, inertia: Mapping[str, float]
    ) -> ET.Element:
        """Add a link; `place` is the pose on the link of the frame that `inertia` refers to.

        The keys of `inertia` are the attributes of a URDF's `<inertia>`, such as "ixx".
        """
        element = ET.SubElement(self.urdf, "link", name=name)
        part = ET.SubElement(element, "inertial")
        ET.SubElement(part, "origin", origin_of(place))
        ET.SubElement(part, "mass", value=repr(mass))
        ET.SubElement(part, "inertia", {key: repr(x) for key, x in inertia.items()})
        return element

    def add_frame(self, name: str, link: str, place: pin.SE3) -> None:
        """Add a frame that is fixed to a link, as a link without mass."""
        self.helpers.append(name)
        ET.SubElement(self.urdf, "link", name=name)
        self._add_joint(self._new_name(f"{name}_fixed"), "fixed", link, name, place)


def _tree_joint(joint: GraphJoint, *, is_reversed: bool) -> _TreeJoint:
    """A joint as it is in the tree.

    If it is reversed, parent and child change places, and axes change their order and sign. A turn
    or a slide of the child about an axis is the same turn or slide of the parent about the opposite
    axis, so positions stay the same. A ball has no axis: its quaternion turns into its inverse.
    """
    steps = _steps(joint)
    if not is_reversed:
        return _TreeJoint(joint.parent, joint.child, joint.on_parent, joint.on_child, steps)
    reversed_steps = list[_Step]()
    for step in steps[::-1]:
        axis = replace(step.axis, direction=-step.axis.direction)
        reversed_steps.append(_Step(step.name, step.kind, axis))
    return _TreeJoint(joint.child, joint.parent, joint.on_child, joint.on_parent, reversed_steps)


def _steps(joint: GraphJoint) -> list[_Step]:
    """The steps of a joint, in series from its parent to its child.

    A universal joint becomes two hinges. A screw becomes a hinge and a slide that mimics the hinge.
    Any other joint has one step.
    """
    if joint.kind == "universal":
        name_1, name_2 = axis_names(joint.name, 2)
        axis_1, axis_2 = joint.axes
        return [_Step(name_1, "revolute", axis_1), _Step(name_2, "revolute", axis_2)]
    if joint.kind == "screw":
        (axis,) = joint.axes
        metres_per_radian = joint.lead / (2 * np.pi)
        mimic = {"joint": joint.name, "multiplier": repr(metres_per_radian), "offset": "0.0"}
        turn = _Step(joint.name, "revolute", axis)
        slide = _Step(f"{joint.name}_slide", "prismatic", Axis(axis.direction, mimic=mimic))
        return [turn, slide]
    return [_Step(joint.name, joint.kind, joint.axes[0])]


def axis_names(joint: str, count: int) -> list[str]:
    """Names of the steps of a joint with `count` axes; a joint with one axis keeps its name."""
    if count < 2:
        return [joint]
    return [f"{joint}_{k}" for k in range(1, count + 1)]


def _add_numbers(element: ET.Element, axis: Axis, *, may_be_continuous: bool) -> None:
    """Add the limits, friction and mimic of an axis to the element of a joint.

    A hinge without limits becomes continuous if it may. The hinge that stands for a ball stays
    revolute; see `JointGraph.balls`.
    """
    lower = axis.limit["lower"]
    upper = axis.limit["upper"]
    is_unlimited = lower <= -NO_LIMIT and upper >= NO_LIMIT
    if may_be_continuous and element.get("type") == "revolute" and is_unlimited:
        element.set("type", "continuous")
    limit = {"lower": max(lower, -NO_LIMIT), "upper": min(upper, NO_LIMIT)}
    for key in ("effort", "velocity"):
        value = axis.limit.get(key, 0.0)
        limit[key] = value if 0 < value < NO_LIMIT else 0.0
    ET.SubElement(element, "limit", {key: repr(float(value)) for key, value in limit.items()})
    friction = {
        key: repr(value) for key, value in axis.dynamics.items() if not key.startswith("spring")
    }
    ET.SubElement(element, "dynamics", friction)
    if axis.mimic:
        ET.SubElement(element, "mimic", dict(axis.mimic))


def origin_of(place: pin.SE3) -> dict[str, Any]:
    """Attributes of the `<origin>` of a URDF."""
    return {"xyz": text_of(place.translation), "rpy": text_of(pin.rpy.matrixToRpy(place.rotation))}


def text_of(vector: Array) -> str:
    """Numbers with all their digits, separated by blanks."""
    return " ".join(repr(float(entry)) for entry in vector)
