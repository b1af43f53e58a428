# SPDX-License-Identifier: BSD-2-Clause
"""Joints that close loops, as other tools write them into a URDF.

A URDF is a tree, so that a loop is cut at one of its joints. Several tools have elements for such
joints: GRBDA's URDF+ has `<loop>` and `<coupling>`, Isaac Sim `<loop_joint>`, Gazebo a `<joint>` in
`<gazebo>`, Drake `<drake:ball_constraint>`; `<constraint>` is proposed for urdfdom (ros/urdfdom
pull request 264).
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..model.closures import Closure, Coupling
from .problems import (
    Problem,
    attribute,
    collecting_problems,
    direction,
    error,
    is_true,
    number,
    numbers,
    placement,
    stands_for,
    unknown_parts,
    warning,
)
from .tool_elements import is_weld

#: The two sides of a joint that closes a loop, by element; `<gazebo>` has another form.
_SIDES = {
    "loop": ("predecessor", "successor"),
    "loop_constraint": ("predecessor", "successor"),
    "loop_joint": ("link1", "link2"),
    "constraint": ("parent", "child"),
}
#: Kind of the closure for each type of joint.
_KINDS = {
    "fixed": "6d",
    "spherical": "3d",
    "spherical_joint": "3d",
    "ball": "3d",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "prismatic",
    "universal": "universal",
    "cylindrical": "cylindrical",
    "planar": "planar",
}
_X, _Y, _Z = np.eye(3)
#: Drake's element for a ball that closes a loop.
_BALL = "drake:ball_constraint"


class Side(NamedTuple):
    """One of the two sides of a joint, as a file describes it.

    A placement or axis is in the neutral configuration. The link "universe" is the base.
    """

    #: The link that the joint connects.
    link: str
    #: The pose of the joint's frame relative to the link `relative_to`.
    placement: pin.SE3
    #: The axis of the joint in this frame, shape (3,); welds and balls do not use it.
    axis: Array
    relative_to: str


class CutJoint(NamedTuple):
    """A joint that closes a loop.

    The axes of its sides' frames are those of a `Closure` of this kind; see `cut_joint`.
    """

    name: str
    #: A kind of `Closure`.
    kind: str
    side_a: Side
    side_b: Side

    def close(self, model: pin.Model) -> Closure:
        """Add the frames `name_A` and `name_B` of this joint to a tree; returns its closure."""
        data = model.createData()
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        self._add_frame(model, data, f"{self.name}_A", self.side_a)
        self._add_frame(model, data, f"{self.name}_B", self.side_b)
        return Closure(f"{self.name}_A", f"{self.name}_B", self.kind)

    def _add_frame(self, model: pin.Model, data: pin.Data, name: str, side: Side) -> None:
        """Add the frame of a side; `data` has the placements in the neutral configuration."""
        if model.existFrame(name):
            raise DescriptionError(self.name, [f"a frame {name} exists; rename this joint"])
        link_id = self._link_id(model, side.link)
        reference_id = self._link_id(model, side.relative_to)
        on_link = side.placement
        if reference_id != link_id:
            on_link = data.oMf[link_id].actInv(data.oMf[reference_id]) * on_link
        link_frame = model.frames[link_id]
        frame = pin.Frame(
            name,
            link_frame.parentJoint,
            link_id,
            link_frame.placement * on_link,
            pin.FrameType.OP_FRAME,
        )
        model.addFrame(frame)

    def _link_id(self, model: pin.Model, link: str) -> int:
        """Index of the frame of a link; the base has index 0."""
        if link == "universe":
            return 0
        link_id = model.getFrameId(link, pin.FrameType.BODY)
        if link_id == model.nframes:  # Pinocchio's answer for an unknown frame
            raise DescriptionError(self.name, [f"{self.name}: no link {link}"])
        return int(link_id)


def cut_joint(name: str, kind: str, side_a: Side, side_b: Side) -> CutJoint:
    """The joint of a type of a URDF, `kind`, with frames as a `Closure` needs them.

    A closure has fixed axes in its frames: z, or x and y for a universal joint. So each frame is
    rotated until this axis is the axis of the joint.

    Raises:
        ValueError: If the type is unknown, both links are the same, or the axes of a slide differ.
    """
    if kind not in _KINDS:
        raise ValueError(f"type {kind!r} unknown; known: {', '.join(_KINDS)}")
    if side_a.link == side_b.link:
        raise ValueError(f"connects {side_a.link} with itself")
    if kind == "prismatic" and not np.allclose(side_a.axis, side_b.axis):
        raise ValueError("the axes of a prismatic joint must be the same on both sides")
    if kind == "universal":
        side_a = _with_axis(side_a, _X)
        side_b = _with_axis(side_b, _Y)
    elif _KINDS[kind] not in ("6d", "3d"):  # welds and balls have no axis
        side_a = _with_axis(side_a, _Z)
        side_b = _with_axis(side_b, _Z)
    return CutJoint(name, _KINDS[kind], side_a, side_b)


def _with_axis(side: Side, axis: Array) -> Side:
    """A side whose frame is rotated, so that the axis of the joint is this one in the frame."""
    rotation = pin.Quaternion.FromTwoVectors(axis, side.axis).matrix()
    placement = side.placement * pin.SE3(rotation, np.zeros(3))
    return side._replace(placement=placement, axis=axis)


class Marks:
    """The joints of a URDF that close loops, and its gears.

    Attributes:
        joints: Joints that close loops.
        gears: Gears of a URDF+.
        independent: Names of the joints that have the motors, in a URDF+.
        problems: Faults of these elements, and warnings.
    """

    def __init__(self, root: ET.Element) -> None:
        self.joints: list[CutJoint] = []
        self.gears: list[Coupling] = []
        self.problems: list[Problem] = []
        self.independent = tuple(_independent(root))
        #: The joint above each link, by the link's name.
        self._parent_joints = {
            attribute(joint, "child/link"): joint for joint in root.findall("joint")
        }
        self._links = {attribute(link, "name") for link in root.findall("link")}

        # Joints of URDF+, Isaac Sim and urdfdom.
        for tag, sides in _SIDES.items():
            for element in root.findall(tag):
                self._read(self._joint, element, _faults(element, sides))
            if set(root.iterfind(f".//{tag}[{sides[0]}]")).difference(root):
                self.problems.append(error(tag, "it must be a direct child of <robot>"))
        # Joints of Gazebo.
        for element in root.findall("gazebo/joint[parent]"):
            self._read(self._gazebo_joint, element, _faults_of_gazebo(element))
        # Balls of Drake.
        for index, ball in enumerate(root.iter(_BALL), 1):
            element = _constraint_of(ball, index)
            self._read(self._joint, element, _faults(element, _SIDES["constraint"]))
        # Gears of URDF+.
        for element in root.findall("coupling"):
            tags = ("predecessor", "successor", "ratio")
            self._read(self._gear, element, unknown_parts(element, tags, ("name", "type")))
        # Welds by plugins of Gazebo.
        robot = root.get("name", "")
        for index, plugin in enumerate(root.findall("gazebo/plugin"), 1):
            if is_weld(plugin):
                self._read(partial(self._weld, robot, index), plugin, ())

    def _read(
        self, reader: Callable[[ET.Element], None], element: ET.Element, faults: Iterable[str]
    ) -> None:
        """Read an element; its faults and what the reader raises become problems."""
        texts = list(faults)
        with collecting_problems(texts):
            reader(element)
        where = f"{element.tag} {element.get('name')}"
        self.problems += [error(where, text) for text in texts]

    def _joint(self, element: ET.Element) -> None:
        """Read a joint; each side has the joint's frame in the axes of its link."""
        name_a, name_b = _SIDES[element.tag]
        side_a = _side(element, name_a)
        side_b = _side(element, name_b)
        self._require_link(name_a, side_a.link)
        self._require_link(name_b, side_b.link)
        kind = attribute(element, "type")
        if kind == "universal" and element.find("parent_axis") is None:
            raise ValueError("a universal joint needs parent_axis and child_axis in a <constraint>")
        self._add(element, kind, side_a, side_b)

    def _gazebo_joint(self, element: ET.Element) -> None:
        """Read a joint of Gazebo; both sides have its frame relative to the child."""
        parent = _side_of_gazebo(element, "parent")
        child = _side_of_gazebo(element, "child")
        self._require_link("parent", parent.link)
        self._require_link("child", child.link)
        self._add(element, attribute(element, "type"), parent, child)

    def _add(self, element: ET.Element, kind: str, side_a: Side, side_b: Side) -> None:
        """Add a joint, named in the file or after its links; a warning says if limits are lost."""
        name = attribute(element, "name") or f"{side_a.link}_{side_b.link}"
        self.joints.append(cut_joint(name, kind, side_a, side_b))
        if _has_limits(element):
            where = f"{element.tag} {name}"
            self.problems.append(warning(where, "limits of a joint that closes a loop are ignored"))

    def _weld(self, robot: str, index: int, plugin: ET.Element) -> None:
        """Read a `DetachableJoint` of Gazebo: it welds two links in their pose at q = 0."""
        model = plugin.findtext("child_model", "").strip()
        if model not in (robot, "__model__"):
            raise ValueError(f"it holds a link of another model, {model!r}; delete it")
        parent = plugin.findtext("parent_link", "").strip()
        child = plugin.findtext("child_link", "").strip()
        self._require_link("parent_link", parent)
        self._require_link("child_link", child)
        # Both frames are at the frame of the child; a weld uses no axis.
        at_child = pin.SE3.Identity()
        side_a = Side(parent, at_child, _Z, relative_to=child)
        side_b = Side(child, at_child, _Z, relative_to=child)
        self.joints.append(cut_joint(f"detachable_{index}", "fixed", side_a, side_b))

    def _gear(self, element: ET.Element) -> None:
        """Read a gear of a URDF+: the angle of the successor is `ratio` times the predecessor's.

        Both angles are sums over the joints from the nearest common link to the link. With factors
        c_j that are ratio for joints of the predecessor and -1 for joints of the successor, the sum
        of c_j q_j is zero. It is solved for the first joint that is not independent.
        """
        paths = []
        for side in ("predecessor", "successor"):
            link = attribute(element, f"{side}/link")
            self._require_link(side, link)
            paths.append(list(self._path(link)))
        predecessor, successor = paths
        ratio = number(element.find("ratio"), "value")
        if ratio is None:
            raise ValueError("its ratio is not a number")
        # Joints on both paths are above the nearest common link.
        factors = dict[str, float]()
        for joint in successor:
            if joint not in predecessor and joint.get("type") != "fixed":
                factors[attribute(joint, "name")] = -1.0
        for joint in predecessor:
            if joint not in successor and joint.get("type") != "fixed":
                factors[attribute(joint, "name")] = ratio
        dependent = [name for name in factors if name not in self.independent and factors[name]]
        if not dependent:
            raise ValueError(
                'all joints between its links are independent; mark one with independent="false"'
            )
        follower = dependent[0]
        slope = factors.pop(follower)
        polynomials = {name: (0.0, -factor / slope) for name, factor in factors.items()}
        self.gears.append(Coupling(follower, polynomials))

    def _path(self, link: str) -> Iterator[ET.Element]:
        """Joints from a link to the base."""
        visited = set[str]()
        while link in self._parent_joints:
            if link in visited:
                raise ValueError(f"the joints from {link} lead back to it; a URDF is a tree")
            visited.add(link)
            joint = self._parent_joints[link]
            yield joint
            link = attribute(joint, "parent/link")

    def _require_link(self, side: str, link: str) -> None:
        if link not in self._links:
            raise ValueError(f"{side} {link} is not a link of this file")


def _faults(element: ET.Element, sides: tuple[str, str]) -> Iterator[str]:
    """Parts of a joint that are unknown, or that exert forces and are not read."""
    origins = [f"{side}_origin" for side in sides]
    axes = [f"{side}_axis" for side in sides]
    tags = [*sides, *origins, *axes, "axis", "limit", "dynamics"]
    yield from unknown_parts(element, tags, ["name", "type"])
    for part in element:
        if part.tag in sides:
            yield from unknown_parts(part, ["origin"], ["link", "xyz", "rpy"])
            for origin in part.findall("origin"):
                yield from unknown_parts(origin, [], ["xyz", "rpy"])
        elif part.tag in origins:
            yield from unknown_parts(part, [], ["xyz", "rpy"])
        elif part.tag in (*axes, "axis"):
            yield from unknown_parts(part, [], ["xyz"])
        elif part.tag == "dynamics":
            yield from _acting_dynamics(part.attrib)


def _faults_of_gazebo(joint: ET.Element) -> Iterator[str]:
    """Parts of a joint of Gazebo that are unknown, or that exert forces and are not read."""
    tags = ["parent", "child", "pose", "axis", "axis2", "physics"]
    yield from unknown_parts(joint, tags, ["name", "type"], ["sensor"])
    for pose in joint.findall("pose"):
        yield from unknown_parts(pose, [], ["degrees"])
        if is_true(pose.get("degrees")):
            yield "a <pose> in degrees is not supported here"
    for axis in (*joint.findall("axis"), *joint.findall("axis2")):
        yield from unknown_parts(axis, ["xyz", "limit", "dynamics", "use_parent_model_frame"], [])
        for xyz in axis.findall("xyz"):
            yield from unknown_parts(xyz, [], [])
        if is_true(axis.findtext("use_parent_model_frame")):
            yield "use_parent_model_frame is not supported here"
        for dynamics in axis.findall("dynamics"):
            yield from _acting_dynamics({part.tag: part.text or "" for part in dynamics})


def _acting_dynamics(numbers_by_name: Mapping[str, str]) -> Iterator[str]:
    """Friction and springs in a joint that closes a loop."""
    for key, text in numbers_by_name.items():
        if not stands_for(text, 0):
            yield f"<dynamics> with {key} {text.strip()!r} is not supported"


#: Limits beyond this position are ignored, [rad] or [m]: tools write them for "no limit".
_FAR = 1e9


def _has_limits(element: ET.Element) -> bool:
    """Whether a joint has limits of its position."""
    texts = []
    for key in ("lower", "upper"):
        texts += [limit.get(key, "") for limit in element.findall("limit")]
        texts.append(element.findtext(f"axis/limit/{key}", ""))
    for text in texts:
        position = numbers(text, 1)
        if position is not None and 0 < abs(position[0]) < _FAR:
            return True
    return False


#: Elements of a ball constraint of Drake: for each the attribute that is read, and the element and
#: the attribute of a `<constraint>` that get its value.
_DRAKE_BALL = {
    "body_A": ("name", "parent", "link"),
    "p_AP": ("value", "parent_origin", "xyz"),
    "body_B": ("name", "child", "link"),
    "p_BQ": ("value", "child_origin", "xyz"),
}


def _constraint_of(ball: ET.Element, index: int) -> ET.Element:
    """A ball joint of Drake as a `<constraint>`."""
    constraint = ET.Element("constraint", name=f"ball_constraint_{index}", type="ball")
    parts = {part.tag.removeprefix(f"{_BALL}_"): part for part in ball}
    for tag, (key, constraint_tag, constraint_key) in _DRAKE_BALL.items():
        text = "" if tag not in parts else parts[tag].get(key, "")
        ET.SubElement(constraint, constraint_tag, {constraint_key: text})
    # Unknown parts are copied, so that `_faults` names them.
    constraint.extend(part for tag, part in parts.items() if tag not in _DRAKE_BALL)
    return constraint


def _side(element: ET.Element, side: str) -> Side:
    """One side of a joint, by its name; tools write the origin in three places."""
    link = element.find(side)
    origin = element.find(f"{side}_origin")
    if origin is None and link is not None:
        origin = link.find("origin")
        if origin is None:
            origin = link  # <parent link="..." xyz="..." rpy="..."/>
    vectors = []
    for key in ("xyz", "rpy"):
        text = "0 0 0" if origin is None else origin.get(key, "0 0 0")
        vector = numbers(text, 3)
        if vector is None:
            raise ValueError(f"{key}={text!r} is not three numbers")
        vectors.append(vector)
    tag = "axis" if element.find(f"{side}_axis") is None else f"{side}_axis"
    axis = direction(attribute(element, f"{tag}/xyz") or "1 0 0")
    name = attribute(element, f"{side}/link")
    return Side(name, placement(*vectors), axis, relative_to=name)


def _side_of_gazebo(element: ET.Element, side: str) -> Side:
    """One side of a joint of Gazebo; a universal joint has its second axis on the child."""
    pose = numbers(element.findtext("pose", "0 0 0 0 0 0"), 6)
    if pose is None:
        raise ValueError("its pose is not six numbers")
    has_second_axis = side == "child" and element.get("type") == "universal"
    path = "axis2/xyz" if has_second_axis else "axis/xyz"
    axis = direction(element.findtext(path, "0 0 1"))
    link = element.findtext(side, "").strip()
    child = element.findtext("child", "").strip()
    return Side(link, placement(pose[:3], pose[3:]), axis, relative_to=child)


def _independent(root: ET.Element) -> Iterator[str]:
    """Joints of a URDF+ that are not marked `independent="false"`."""
    joints = root.findall("joint")
    has_marks = any(joint.get("independent") for joint in joints)
    if not has_marks and root.find("loop") is None and root.find("coupling") is None:
        return  # not a URDF+
    for joint in joints:
        can_have_motor = (
            joint.get("type") not in ("fixed", "floating") and joint.find("mimic") is None
        )
        mark = joint.get("independent") or "true"
        if can_have_motor and mark.lower() not in ("false", "0"):
            yield attribute(joint, "name")
