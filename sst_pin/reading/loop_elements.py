# SPDX-License-Identifier: BSD-2-Clause
"""Elements of a URDF for joints that close loops, and for gears.

A URDF is a tree, so that a loop is cut at one of its joints. Several tools have elements for such
joints. URDF+, the dialect of the library GRBDA, has `<loop>` and, for gears, `<coupling>`; Isaac
Sim has `<loop_joint>`; Gazebo has a `<joint>` in `<gazebo>`; Drake has `<drake:ball_constraint>`.
`<constraint>` is proposed for urdfdom (ros/urdfdom pull request 264).
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.closures import Coupling
from ..model.conventions import NO_LIMIT
from .cut_joints import CutJoint, Side, cut_joint
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
from .tool_elements import is_weld, is_weld_within

#: The two sides of a joint of URDF+, Isaac Sim and urdfdom, by the tag of the joint.
_SIDES = {
    "loop": ("predecessor", "successor"),
    "loop_constraint": ("predecessor", "successor"),
    "loop_joint": ("link1", "link2"),
    "constraint": ("parent", "child"),
}
#: Drake's element for a ball that closes a loop.
_BALL = "drake:ball_constraint"


class LoopElements(NamedTuple):
    """What a URDF says about its loops."""

    #: Joints that close loops.
    joints: tuple[CutJoint, ...]
    #: Gears of a URDF+.
    gears: tuple[Coupling, ...]
    #: Names of the joints that have the motors, in a URDF+; empty in another URDF.
    independent: tuple[str, ...]
    #: Faults of these elements, and warnings.
    problems: tuple[Problem, ...]


def loop_elements(root: ET.Element) -> LoopElements:
    """Read the joints of a URDF that close loops, and its gears."""
    tree = _Tree(
        links={attribute(link, "name") for link in root.findall("link")},
        parent_joints={attribute(joint, "child/link"): joint for joint in root.findall("joint")},
    )
    joints = list[CutJoint]()
    problems = list[Problem]()

    def add_joint(
        element: ET.Element, faults: Iterable[str], read: Callable[[ET.Element, _Tree], CutJoint]
    ) -> None:
        """Add the joint that `read` makes of an element, and what is wrong with the element."""
        with _reporting(problems, element, faults):
            joint = read(element, tree)
            joints.append(joint)
            problems.extend(_ignored_limits(element, joint.name))

    # Joints of URDF+, Isaac Sim and urdfdom.
    for tag, sides in _SIDES.items():
        for element in root.findall(tag):
            add_joint(element, _faults(element, sides), _joint)
        if _has_nested_joint(root, tag):
            problems.append(error(tag, "it must be a direct child of <robot>"))
    # Joints of Gazebo.
    for element in root.findall("gazebo/joint[parent]"):
        add_joint(element, _faults_of_gazebo(element), _gazebo_joint)
    # Balls of Drake.
    for index, ball in enumerate(root.iter(_BALL), 1):
        element = _constraint_of(ball, index)
        add_joint(element, _faults(element, _SIDES["constraint"]), _joint)
    # Gears of URDF+.
    gears = list[Coupling]()
    independent = tuple(_independent(root))
    for element in root.findall("coupling"):
        tags = ("predecessor", "successor", "ratio")
        faults = unknown_parts(element, tags=tags, attributes=("name", "type"))
        with _reporting(problems, element, faults):
            gears.append(_gear(element, tree, independent))
    # Welds by plugins of Gazebo.
    for index, plugin in enumerate(root.findall("gazebo/plugin"), 1):
        if is_weld(plugin):
            with _reporting(problems, plugin, ()):
                joints.append(_weld(plugin, tree, root.get("name", ""), index))
    return LoopElements(tuple(joints), tuple(gears), independent, tuple(problems))


class _Tree(NamedTuple):
    """The links of a URDF, and the joints that connect them as a tree."""

    #: Names of the links.
    links: set[str]
    #: The joint above each link, by the link's name.
    parent_joints: dict[str, ET.Element]

    def require_link(self, role: str, link: str) -> None:
        """Raise a ValueError if there is no link of this name; `role` is the tag that names it."""
        if link not in self.links:
            raise ValueError(f"{role} {link} is not a link of this file")

    def path(self, link: str) -> list[ET.Element]:
        """The joints between a link and the base, in this order."""
        joints = list[ET.Element]()
        visited = set[str]()
        while link in self.parent_joints:
            if link in visited:
                raise ValueError(f"the joints from {link} lead back to it; a URDF is a tree")
            visited.add(link)
            joint = self.parent_joints[link]
            joints.append(joint)
            link = attribute(joint, "parent/link")
        return joints


@contextmanager
def _reporting(
    problems: list[Problem], element: ET.Element, faults: Iterable[str]
) -> Iterator[None]:
    """Collect what is wrong with an element: its faults, and a ValueError of the block.

    The block reads the element. A ValueError ends it, but not the caller.
    """
    texts = list(faults)
    with collecting_problems(texts):
        yield
    where = f"{element.tag} {element.get('name')}"
    problems += [error(where, text) for text in texts]


def _has_nested_joint(root: ET.Element, tag: str) -> bool:
    """Whether a joint with a tag of `_SIDES` is not a direct child of the root.

    Elements of other tools may have the same tag, but not the sides of a joint in them.
    """
    first_side, _ = _SIDES[tag]
    everywhere = set(root.iterfind(f".//{tag}[{first_side}]"))
    return bool(everywhere.difference(root))


# --- joints -----------------------------------------------------------------------------------


def _joint(element: ET.Element, tree: _Tree) -> CutJoint:
    """A joint of URDF+, Isaac Sim or urdfdom; each side has its frame relative to its link."""
    tag_a, tag_b = _SIDES[element.tag]
    side_a = _side(element, tag_a)
    side_b = _side(element, tag_b)
    tree.require_link(tag_a, side_a.link)
    tree.require_link(tag_b, side_b.link)
    kind = attribute(element, "type")
    if kind == "universal" and element.find("parent_axis") is None:
        raise ValueError("a universal joint needs parent_axis and child_axis in a <constraint>")
    return cut_joint(_name(element, side_a, side_b), kind, side_a, side_b)


def _gazebo_joint(element: ET.Element, tree: _Tree) -> CutJoint:
    """A joint of Gazebo; both sides have their frame relative to the child."""
    parent = _side_of_gazebo(element, "parent")
    child = _side_of_gazebo(element, "child")
    tree.require_link("parent", parent.link)
    tree.require_link("child", child.link)
    return cut_joint(_name(element, parent, child), attribute(element, "type"), parent, child)


def _name(element: ET.Element, side_a: Side, side_b: Side) -> str:
    """The name of a joint in the file; without one, the names of its two links."""
    return attribute(element, "name") or f"{side_a.link}_{side_b.link}"


def _side(element: ET.Element, side: str) -> Side:
    """The side of a joint with the tag `side`, such as "parent".

    Tools write the origin of its frame in three places: in an element of its own, such as
    `<parent_origin>`, in an `<origin>` inside the side, or as attributes of the side.
    """
    part = element.find(side)
    origin = element.find(f"{side}_origin")
    if origin is None and part is not None:
        origin = part.find("origin")
        if origin is None:
            origin = part
    xyz = _vector(origin, "xyz")
    rpy = _vector(origin, "rpy")
    tag = "axis" if element.find(f"{side}_axis") is None else f"{side}_axis"
    axis = direction(attribute(element, f"{tag}/xyz") or "1 0 0")
    link = attribute(element, f"{side}/link")
    return Side(link, relative_to=link, placement=placement(xyz, rpy), axis=axis)


def _vector(origin: ET.Element | None, key: str) -> Array:
    """The three numbers of the attribute `key`; zeros if the file does not have it."""
    text = "0 0 0" if origin is None else origin.get(key, "0 0 0")
    vector = numbers(text, 3)
    if vector is None:
        raise ValueError(f"{key}={text!r} is not three numbers")
    return vector


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
    return Side(link, relative_to=child, placement=placement(pose[:3], pose[3:]), axis=axis)


def _constraint_of(ball: ET.Element, index: int) -> ET.Element:
    """A ball constraint of Drake as a `<constraint>`, which `_joint` reads.

    Drake's ball connects the point P of body A with the point Q of body B.
    """
    constraint = ET.Element("constraint", name=f"ball_constraint_{index}", type="ball")
    parts = {part.tag.removeprefix(f"{_BALL}_"): part for part in ball}
    without_attributes = ET.Element("missing")  # in place of a missing part
    body_a = parts.pop("body_A", without_attributes)
    point_a = parts.pop("p_AP", without_attributes)
    body_b = parts.pop("body_B", without_attributes)
    point_b = parts.pop("p_BQ", without_attributes)
    ET.SubElement(constraint, "parent", link=body_a.get("name", ""))
    ET.SubElement(constraint, "parent_origin", xyz=point_a.get("value", ""))
    ET.SubElement(constraint, "child", link=body_b.get("name", ""))
    ET.SubElement(constraint, "child_origin", xyz=point_b.get("value", ""))
    # Unknown parts are copied, so that `_faults` names them.
    constraint.extend(parts.values())
    return constraint


def _weld(plugin: ET.Element, tree: _Tree, robot: str, index: int) -> CutJoint:
    """A `DetachableJoint` of Gazebo, which welds two links in their pose at q = 0."""
    if not is_weld_within(plugin, robot):
        model = plugin.findtext("child_model", "").strip()
        raise ValueError(f"it holds a link of another model, {model!r}; delete it")
    parent = plugin.findtext("parent_link", "").strip()
    child = plugin.findtext("child_link", "").strip()
    tree.require_link("parent_link", parent)
    tree.require_link("child_link", child)
    # Both frames are at the frame of the child; a weld uses no axis.
    at_child = pin.SE3.Identity()
    axis = np.array([0.0, 0.0, 1.0])
    side_a = Side(parent, relative_to=child, placement=at_child, axis=axis)
    side_b = Side(child, relative_to=child, placement=at_child, axis=axis)
    return cut_joint(f"detachable_{index}", "fixed", side_a, side_b)


def _ignored_limits(element: ET.Element, name: str) -> Iterator[Problem]:
    """A warning if a joint that closes a loop has limits of its position."""
    texts = []
    for key in ("lower", "upper"):
        texts += [limit.get(key, "") for limit in element.findall("limit")]
        texts.append(element.findtext(f"axis/limit/{key}", ""))  # of a joint of Gazebo
    for text in texts:
        position = numbers(text, 1)
        # Tools write zero, too, if there is no limit.
        if position is not None and 0 < abs(position[0]) < NO_LIMIT:
            where = f"{element.tag} {name}"
            yield warning(where, "limits of a joint that closes a loop are ignored")
            return


# --- gears and motors of URDF+ ------------------------------------------------------------------


def _gear(element: ET.Element, tree: _Tree, independent: Iterable[str]) -> Coupling:
    """A gear of a URDF+: the angle of the successor is `ratio` times the predecessor's.

    The angle of a link is the sum of the positions q_j of the joints between the nearest common
    link and this link. So sum of c_j q_j = 0, where the factor c_j is `ratio` for joints of the
    predecessor and -1 for joints of the successor. The first joint f that is not independent
    follows the others: q_f = sum of (-c_j / c_f) q_j over the others.
    """
    predecessor_link = attribute(element, "predecessor/link")
    successor_link = attribute(element, "successor/link")
    tree.require_link("predecessor", predecessor_link)
    tree.require_link("successor", successor_link)
    predecessor = tree.path(predecessor_link)
    successor = tree.path(successor_link)
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
    dependent = [name for name in factors if name not in independent and factors[name]]
    if not dependent:
        raise ValueError(
            'all joints between its links are independent; mark one with independent="false"'
        )
    follower = dependent[0]
    factor_of_follower = factors.pop(follower)
    polynomials = dict[str, tuple[float, float]]()  # the coefficients of q_j^0 and q_j^1
    for name, factor in factors.items():
        polynomials[name] = (0.0, -factor / factor_of_follower)
    return Coupling(follower, polynomials)


def _independent(root: ET.Element) -> Iterator[str]:
    """Joints of a URDF+ that are not marked `independent="false"`; none in another URDF."""
    joints = root.findall("joint")
    has_marks = any(joint.get("independent") for joint in joints)
    has_loops = root.find("loop") is not None or root.find("coupling") is not None
    is_urdf_plus = has_marks or has_loops
    if not is_urdf_plus:
        return
    for joint in joints:
        can_have_motor = (
            joint.get("type") not in ("fixed", "floating") and joint.find("mimic") is None
        )
        mark = joint.get("independent") or "true"
        if can_have_motor and mark.lower() not in ("false", "0"):
            yield attribute(joint, "name")


# --- faults -----------------------------------------------------------------------------------


def _faults(element: ET.Element, sides: tuple[str, str]) -> Iterator[str]:
    """Parts of a joint that are unknown, or that exert forces and are not read."""
    origins = [f"{side}_origin" for side in sides]
    axes = [f"{side}_axis" for side in sides]
    tags = [*sides, *origins, *axes, "axis", "limit", "dynamics"]
    yield from unknown_parts(element, tags=tags, attributes=["name", "type"])
    for part in element:
        if part.tag in sides:
            yield from unknown_parts(part, tags=["origin"], attributes=["link", "xyz", "rpy"])
            for origin in part.findall("origin"):
                yield from unknown_parts(origin, attributes=["xyz", "rpy"])
        elif part.tag in origins:
            yield from unknown_parts(part, attributes=["xyz", "rpy"])
        elif part.tag in (*axes, "axis"):
            yield from unknown_parts(part, attributes=["xyz"])
        elif part.tag == "dynamics":
            yield from _acting_dynamics(part.attrib)


def _faults_of_gazebo(joint: ET.Element) -> Iterator[str]:
    """Parts of a joint of Gazebo that are unknown, or that exert forces and are not read."""
    tags = ["parent", "child", "pose", "axis", "axis2", "physics"]
    yield from unknown_parts(joint, tags=tags, attributes=["name", "type"], several=["sensor"])
    for pose in joint.findall("pose"):
        yield from unknown_parts(pose, attributes=["degrees"])
        if is_true(pose.get("degrees")):
            yield "a <pose> in degrees is not supported here"
    known = ["xyz", "limit", "dynamics", "use_parent_model_frame"]
    for axis in (*joint.findall("axis"), *joint.findall("axis2")):
        yield from unknown_parts(axis, tags=known)
        for xyz in axis.findall("xyz"):
            yield from unknown_parts(xyz)
        if is_true(axis.findtext("use_parent_model_frame")):
            yield "use_parent_model_frame is not supported here"
        for dynamics in axis.findall("dynamics"):
            yield from _acting_dynamics({part.tag: part.text or "" for part in dynamics})


def _acting_dynamics(numbers_by_name: Mapping[str, str]) -> Iterator[str]:
    """Faults of numbers that are not zero: friction and springs in a joint that closes a loop."""
    for key, text in numbers_by_name.items():
        if not stands_for(text, 0):
            yield f"<dynamics> with {key} {text.strip()!r} is not supported"
