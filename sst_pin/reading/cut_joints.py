# SPDX-License-Identifier: BSD-2-Clause
"""Joints that close loops, as other tools write them into a URDF.

GRBDA's URDF+ has `<loop>` and `<coupling>`, Isaac Sim `<loop_joint>`, Gazebo a `<joint>` in
`<gazebo>`, Drake `<drake:ball_constraint>`; `<constraint>` is proposed for urdfdom (ros/urdfdom
pull request 264).
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..model.closures import Closure, Coupling
from .acting_elements import is_detachable
from .problems import (
    Problem,
    attribute,
    direction,
    error,
    is_true,
    means,
    number,
    numbers,
    placement,
    telling,
    unknown_parts,
    warning,
)

#: The two sides of a joint that closes a loop, by element; `<gazebo>` has another form.
_SIDES = {
    "loop": ("predecessor", "successor"),
    "loop_constraint": ("predecessor", "successor"),
    "loop_joint": ("link1", "link2"),
    "constraint": ("parent", "child"),
}
#: Kind of the closure for each type of joint.
_KINDS = {"fixed": "6d", **dict.fromkeys(("spherical", "spherical_joint", "ball"), "3d")}
_KINDS |= dict.fromkeys(("revolute", "continuous"), "hinge")
_KINDS |= {kind: kind for kind in ("prismatic", "universal", "cylindrical", "planar")}
#: For each kind, the axes of the two frames that are turned onto the axes of the joint; else z.
_ALONG = {"universal": np.eye(3)[:2]}
_BALL = "drake:ball_constraint"
#: Larger limits are none, [rad] or [m].
_FAR = 1e9
#: Elements of Drake's balls: their attribute, and the element and attribute of a `<constraint>`.
_OF_BALLS = {
    "body_A": ("name", "parent", "link"),
    "p_AP": ("value", "parent_origin", "xyz"),
    "body_B": ("name", "child", "link"),
    "p_BQ": ("value", "child_origin", "xyz"),
}


class CutJoint(NamedTuple):
    """A joint that closes a loop, by a kind of `Closure`; its frames are `name_A` and `name_B`.

    `places[k]` is the pose, relative to link `seen_from[k]`, of its frame on link `links[k]`, in
    the neutral configuration. The link "universe" is the base.
    """

    name: str
    kind: str
    links: tuple[str, str]
    places: tuple[pin.SE3, pin.SE3]
    seen_from: tuple[str, str]

    def closure(self, model: pin.Model) -> Closure:
        """The closure of this joint, whose frames are added to the tree."""
        names = f"{self.name}_A", f"{self.name}_B"
        data = model.createData()
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        sides = zip(names, self.links, self.places, self.seen_from, strict=True)
        for name, link, offset, other in sides:
            if model.existFrame(name):
                raise DescriptionError(self.name, [f"a frame {name} exists; rename this joint"])
            number, seen = self._frame(model, link), self._frame(model, other)
            body, there = model.frames[number], data.oMf[number].actInv(data.oMf[seen])
            place = body.placement * (offset if seen == number else there * offset)
            kind = pin.FrameType.OP_FRAME
            model.addFrame(pin.Frame(name, body.parentJoint, number, place, kind))
        return Closure(*names, self.kind)

    def _frame(self, model: pin.Model, link: str) -> int:
        number = 0 if link == "universe" else model.getFrameId(link, pin.FrameType.BODY)
        if number == model.nframes:
            raise DescriptionError(self.name, [f"{self.name}: no link {link}"])
        return int(number)


def cut_joint(
    name: str,
    kind: str,
    links: tuple[str, str],
    places: Sequence[pin.SE3],
    axes: Sequence[Array],
    seen_from: tuple[str, str],
) -> CutJoint:
    """A joint of a type of URDFs, with its axis in each of its two frames.

    Raises:
        ValueError: If the type is unknown, both links are the same, or the axes of a slide differ.
    """
    if kind not in _KINDS:
        raise ValueError(f"type {kind!r} unknown; known: {', '.join(_KINDS)}")
    if links[0] == links[1]:
        raise ValueError(f"connects {links[0]} with itself")
    if kind == "prismatic" and not np.allclose(axes[0], axes[1]):
        raise ValueError("the axes of a prismatic joint must be the same on both sides")
    if _KINDS[kind] not in ("6d", "3d"):
        along = _ALONG.get(kind, np.eye(3)[[2, 2]])
        places = [_turned(*each) for each in zip(places, axes, along, strict=True)]
    return CutJoint(name, _KINDS[kind], links, (places[0], places[1]), seen_from)


def _turned(place: pin.SE3, axis: Array, along: Array) -> pin.SE3:
    """A frame turned until its axis `along` is `axis`, both in axes of the frame."""
    return place * pin.SE3(pin.Quaternion.FromTwoVectors(along, axis).matrix(), np.zeros(3))


class Marks:
    """The joints of a URDF that close loops, and its gears.

    `independent` are names of the joints that have the motors, in a URDF+.
    """

    def __init__(self, root: ET.Element) -> None:
        self.joints: list[CutJoint] = []
        self.gears: list[Coupling] = []
        self.problems: list[Problem] = []
        self.independent = tuple(_independent(root))
        self._bearers = {attribute(joint, "child/link"): joint for joint in root.findall("joint")}
        self._links = {attribute(link, "name") for link in root.findall("link")}
        for tag, sides in _SIDES.items():
            for element in root.findall(tag):
                self._read(self._joint, element, _faults(element, sides))
            if set(root.iterfind(f".//{tag}[{sides[0]}]")).difference(root):
                self.problems.append(error(tag, "it must be a direct child of <robot>"))
        for element in root.findall("gazebo/joint[parent]"):
            self._read(self._joint, element, _faults_of_gazebo(element))
        for k, ball in enumerate(root.iter(_BALL), 1):
            element = _constraint_of(ball, k)
            self._read(self._joint, element, _faults(element, _SIDES["constraint"]))
        for element in root.findall("coupling"):
            tags = ("predecessor", "successor", "ratio")
            self._read(self._gear, element, unknown_parts(element, tags, ("name", "type")))
        for k, plugin in enumerate(root.findall("gazebo/plugin"), 1):
            if is_detachable(plugin):
                self._read(partial(self._weld, root.get("name", ""), k), plugin, ())

    def _read(
        self, reader: Callable[[ET.Element], None], element: ET.Element, faults: Iterable[str]
    ) -> None:
        problems, where = list(faults), f"{element.tag} {element.get('name')}"
        with telling(problems):
            reader(element)
        self.problems += [error(where, text) for text in problems]

    def _joint(self, element: ET.Element) -> None:
        kind, gazebo = attribute(element, "type"), element.tag == "joint"
        sides = _SIDES["constraint" if gazebo else element.tag]
        read = _side_of_gazebo if gazebo else _side
        (a, b), places, axes = zip(*(read(element, side) for side in sides), strict=True)
        for side, link in zip(sides, (a, b), strict=True):
            self._require_link(side, link)
        if kind == "universal" and not gazebo and element.find("parent_axis") is None:
            raise ValueError("a universal joint needs parent_axis and child_axis in a <constraint>")
        seen = (b, b) if gazebo else (a, b)
        name = attribute(element, "name") or f"{a}_{b}"
        self.joints.append(cut_joint(name, kind, (a, b), places, axes, seen))
        if _has_limits(element):
            where = f"{element.tag} {name}"
            self.problems.append(warning(where, "limits of a joint that closes a loop are ignored"))

    def _weld(self, robot: str, number: int, plugin: ET.Element) -> None:
        """A `DetachableJoint` of Gazebo: two links that are welded as they are at zero."""
        model = plugin.findtext("child_model", "").strip()
        if model not in (robot, "__model__"):
            raise ValueError(f"it holds a link of another model, {model!r}; delete it")
        a, b = (plugin.findtext(f"{side}_link", "").strip() for side in ("parent", "child"))
        self._require_link("parent_link", a)
        self._require_link("child_link", b)
        here = pin.SE3.Identity()
        axes = np.eye(3)[2], np.eye(3)[2]  # of a weld they do not count
        self.joints.append(
            cut_joint(f"detachable_{number}", "fixed", (a, b), (here, here), axes, (b, b))
        )

    def _gear(self, element: ET.Element) -> None:
        paths, ratio = [], number(element.find("ratio"), "value")
        for side in ("predecessor", "successor"):
            self._require_link(side, link := attribute(element, f"{side}/link"))
            paths.append(list(self._path(link)))
        if ratio is None:
            raise ValueError("its ratio is not a number")
        factors = {
            attribute(joint, "name"): factor
            for path, factor, other in zip(paths[::-1], (-1.0, ratio), paths, strict=True)
            for joint in path
            if joint not in other and joint.get("type") != "fixed"
        }
        names = [name for name in factors if name not in self.independent and factors[name]]
        if not names:
            raise ValueError(
                'all joints between its links are independent; mark one with independent="false"'
            )
        slope = factors.pop(names[0])
        self.gears.append(Coupling(names[0], {n: (0.0, -f / slope) for n, f in factors.items()}))

    def _path(self, link: str) -> Iterator[ET.Element]:
        """Joints from a link to the base."""
        passed = set[str]()
        while (joint := self._bearers.get(link)) is not None:
            if link in passed:
                raise ValueError(f"the joints from {link} lead back to it; a URDF is a tree")
            passed.add(link)
            yield joint
            link = attribute(joint, "parent/link")

    def _require_link(self, side: str, link: str) -> None:
        if link not in self._links:
            raise ValueError(f"{side} {link} is not a link of this file")


def _faults(element: ET.Element, sides: tuple[str, str]) -> Iterator[str]:
    """Parts of a joint that closes a loop that are not known, or that act and are not read."""
    origins, axes = [f"{side}_origin" for side in sides], [f"{side}_axis" for side in sides]
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
    """The same for a joint of Gazebo."""
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
        if not means(text, 0):
            yield f"<dynamics> with {key} {text.strip()!r} is not supported"


def _has_limits(element: ET.Element) -> bool:
    """Whether a joint has limits of its position."""
    texts = [
        *(limit.get(key, "") for limit in element.findall("limit") for key in ("lower", "upper")),
        *(element.findtext(f"axis/limit/{key}", "") for key in ("lower", "upper")),
    ]
    values = [numbers(text, 1) for text in texts]
    return any(value is not None and 0 < abs(value[0]) < _FAR for value in values)


def _constraint_of(ball: ET.Element, number: int) -> ET.Element:
    """A ball joint of Drake as a `<constraint>`."""
    constraint = ET.Element("constraint", name=f"ball_constraint_{number}", type="ball")
    parts = {part.tag.removeprefix(f"{_BALL}_"): part for part in ball}
    for tag, (key, there, word) in _OF_BALLS.items():
        text = "" if tag not in parts else parts[tag].get(key, "")
        ET.SubElement(constraint, there, {word: text})
    constraint.extend(part for tag, part in parts.items() if tag not in _OF_BALLS)
    return constraint


#: A link, the place of the joint's frame on it, and the axis there.
_Side = tuple[str, pin.SE3, Array]


def _side(element: ET.Element, side: str) -> _Side:
    end, origin = element.find(side), element.find(f"{side}_origin")
    if origin is None and end is not None:
        origin = end if end.find("origin") is None else end.find("origin")
    vectors = []
    for key in ("xyz", "rpy"):
        text = "0 0 0" if origin is None else origin.get(key, "0 0 0")
        if (vector := numbers(text, 3)) is None:
            raise ValueError(f"{key}={text!r} is not three numbers")
        vectors.append(vector)
    tag = "axis" if element.find(f"{side}_axis") is None else f"{side}_axis"
    axis = direction(attribute(element, f"{tag}/xyz") or "1 0 0")
    return attribute(element, f"{side}/link"), placement(*vectors), axis


def _side_of_gazebo(element: ET.Element, side: str) -> _Side:
    pose = numbers(element.findtext("pose", "0 0 0 0 0 0"), 6)
    if pose is None:
        raise ValueError("its pose is not six numbers")
    second = side == "child" and element.get("type") == "universal"
    axis = direction(element.findtext("axis2/xyz" if second else "axis/xyz", "0 0 1"))
    return element.findtext(side, "").strip(), placement(pose[:3], pose[3:]), axis


def _independent(root: ET.Element) -> Iterator[str]:
    """Joints of a URDF+ that are not marked `independent="false"`."""
    joints = root.findall("joint")
    marks = [joint.get("independent") for joint in joints]
    if any(marks) or any(root.find(tag) is not None for tag in ("loop", "coupling")):
        for joint, mark in zip(joints, marks, strict=True):
            free = joint.get("type") not in ("fixed", "floating") and joint.find("mimic") is None
            if free and (mark or "true").lower() not in ("false", "0"):
                yield attribute(joint, "name")
