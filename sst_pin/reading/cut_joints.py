# SPDX-License-Identifier: BSD-2-Clause
"""Joints that close loops, as other tools write them into a URDF.

GRBDA's URDF+ has `<loop>` and `<coupling>`, Isaac Sim `<loop_joint>`, Gazebo a `<joint>` in
`<gazebo>`, Drake `<drake:ball_constraint>`; `<constraint>` is proposed for urdfdom (ros/urdfdom
pull request 264).
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..model.closures import Closure, Coupling
from .known_words import unknown
from .problems import Problem, attribute, direction, error, number, numbers, placement, telling

#: The two sides of a joint that closes a loop, by element; `<gazebo>` has another form.
_SIDES = {
    "loop": ("predecessor", "successor"),
    "loop_constraint": ("predecessor", "successor"),
    "loop_joint": ("link1", "link2"),
    "constraint": ("parent", "child"),
}
#: Kind of the closure for each type of joint.
_KINDS = {"fixed": "6d", **dict.fromkeys(("spherical", "ball"), "3d")}
_KINDS |= dict.fromkeys(("revolute", "continuous"), "hinge")
_KINDS |= {kind: kind for kind in ("prismatic", "universal", "cylindrical", "planar")}
#: For each kind, the axes of the two frames that are turned onto the axes of the joint; else z.
_ALONG = {"universal": np.eye(3)[:2]}
_ENDS = [side for sides in _SIDES.values() for side in sides]
_BALL = "drake:ball_constraint"
#: Elements of Drake's balls: their attribute, and the element and attribute of a `<constraint>`.
_OF_BALLS = {
    "body_A": ("name", "parent", "link"),
    "p_AP": ("value", "parent_origin", "xyz"),
    "body_B": ("name", "child", "link"),
    "p_BQ": ("value", "child_origin", "xyz"),
}
_CUT = "@name @type {0} {1} {0}_origin {1}_origin {0}_axis {1}_axis axis limit dynamics"
#: Elements and attributes of each element, as in `known_words`. Limits are not enforced.
_WORDS = {
    **{tag: _CUT.format(*sides) for tag, sides in _SIDES.items()},
    **dict.fromkeys(_ENDS, "@link @xyz @rpy origin"),
    **dict.fromkeys(["origin", *(f"{end}_origin" for end in _ENDS)], "@xyz @rpy"),
    **dict.fromkeys(["axis", *(f"{end}_axis" for end in _ENDS)], "@xyz"),
    "dynamics": "*=0",
    "coupling": "@name @type predecessor successor ratio",
    "ratio": "@value",
}
_WORDS_OF_GAZEBO = {
    "joint": "@name @type parent child pose axis axis2 sensor+ physics",
    "pose": "@degrees=0",
    **dict.fromkeys(("axis", "axis2"), "xyz limit dynamics use_parent_model_frame=0"),
    "xyz": "",
    "dynamics": "*=0",
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
        for tag, (side, _) in _SIDES.items():
            for element in root.findall(tag):
                self._read(self._joint, element, _WORDS)
            if set(root.iterfind(f".//{tag}[{side}]")).difference(root):
                self.problems.append(error(tag, "it must be a direct child of <robot>"))
        for element in root.findall("gazebo/joint[parent]"):
            self._read(self._joint, element, _WORDS_OF_GAZEBO)
        for k, element in enumerate(root.iter(_BALL), 1):
            self._read(self._joint, _constraint_of(element, k), _WORDS)
        for element in root.findall("coupling"):
            self._read(self._gear, element, _WORDS)

    def _read(
        self, reader: Callable[[ET.Element], None], element: ET.Element, words: Mapping[str, str]
    ) -> None:
        problems, where = list(unknown(element, words)), f"{element.tag} {element.get('name')}"
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
        while (joint := self._bearers.get(link)) is not None:
            yield joint
            link = attribute(joint, "parent/link")

    def _require_link(self, side: str, link: str) -> None:
        if link not in self._links:
            raise ValueError(f"{side} {link} is not a link of this file")


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
