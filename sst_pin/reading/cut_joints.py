# SPDX-License-Identifier: BSD-2-Clause
"""Joints that close loops, as other tools write them into a URDF.

GRBDA's URDF+ has `<loop>` and `<coupling>`, Isaac Sim `<loop_joint>`, Gazebo a `<joint>` in
`<gazebo>`; `<constraint>` is proposed for urdfdom (ros/urdfdom pull request 264).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..chain.closures import Closure, Coupling
from ..errors import DescriptionError
from .problems import Problem, error, number, numbers

Array = NDArray[np.float64]

#: The two sides of a joint that closes a loop, by element.
_SIDES = {
    "loop": ("predecessor", "successor"),
    "loop_constraint": ("predecessor", "successor"),
    "loop_joint": ("link1", "link2"),
    "constraint": ("parent", "child"),
}
#: Kind of the closure of a joint.
_KINDS = {
    "fixed": "6d",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "prismatic",
    "spherical": "3d",
    "ball": "3d",
    "universal": "universal",
    "cylindrical": "cylindrical",
    "planar": "planar",
}
#: Axes of both frames that lie along the axes of the joint; z where a kind is not here.
_ALONG = {"universal": np.eye(3)[:2]}


class CutJoint(NamedTuple):
    """A joint that closes a loop.

    Attributes:
        name: Its name; its frames are called `name_A` and `name_B`.
        kind: A kind of `Closure`.
        links: The two links that it connects.
        places: Its frame on each side.
        seen_from: Relative to what the places are given: the links, or others at q = 0;
            "universe" is the base.
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
        for name, link, given, other in sides:
            if model.existFrame(name):
                raise DescriptionError(self.name, [f"a frame {name} exists; rename this joint"])
            number, seen = self._frame(model, link), self._frame(model, other)
            body, there = model.frames[number], data.oMf[number].actInv(data.oMf[seen])
            place = body.placement * (given if seen == number else there * given)
            kind = pin.FrameType.OP_FRAME
            model.addFrame(pin.Frame(name, body.parentJoint, number, place, kind))
        return Closure(*names, self.kind)

    def _frame(self, model: pin.Model, link: str) -> int:
        number = 0 if link == "universe" else model.getFrameId(link, pin.FrameType.BODY)
        if number == model.nframes:
            raise DescriptionError(self.name, [f"{self.name}: no link {link}"])
        return int(number)


def turned(place: pin.SE3, axis: Array, along: Array) -> pin.SE3:
    """A frame turned until its axis `along` is `axis`, both in axes of the frame."""
    turn = pin.Quaternion.FromTwoVectors(along, axis).matrix()
    return place * pin.SE3(turn, np.zeros(3))


class Marks:
    """What a URDF says of its loops beyond the tree.

    Attributes:
        joints: Joints that close loops.
        gears: Couplings of joints along two paths: URDF+'s `<coupling>`.
        independent: Names of the joints that have the motors, in a URDF+.
        problems: What cannot be read.
    """

    def __init__(self, root: ET.Element) -> None:
        self.joints: list[CutJoint] = []
        self.gears: list[Coupling] = []
        self.problems: list[Problem] = []
        self._joints = {
            name: joint
            for joint in root.findall("joint")
            if (name := _name(joint.find("child"), "link"))
        }
        self._links = {link.get("name", "") for link in root.findall("link")}
        self.independent = tuple(_independent(root))
        for tag, sides in _SIDES.items():
            for element in root.findall(tag):
                self._read(self._joint, element, sides)
        for element in root.findall("gazebo/joint[parent]"):
            self._read(self._of_gazebo, element)
        for element in root.findall("coupling"):
            self._read(self._gear, element)

    def _read(self, reader: Callable[..., None], element: ET.Element, *more: object) -> None:
        try:
            reader(element, *more)
        except ValueError as caught:
            self.problems.append(error(f"{element.tag} {element.get('name')}", str(caught)))

    def _joint(self, element: ET.Element, sides: tuple[str, str]) -> None:
        kind, links, places, axes = _kind(element), [], [], []
        for side in sides:
            found = element.find(side)
            links.append(self._link(_name(found, "link"), side))
            origin = element.find(f"{side}_origin")
            if origin is None and found is not None:
                origin = found.find("origin")
            places.append(_placement(found if origin is None else origin))
            axis = element.find(f"{side}_axis")
            axes.append(_axis(element.find("axis") if axis is None else axis))
        if kind == "universal" and element.find("parent_axis") is None:
            raise ValueError("a universal joint has two axes; write it as <constraint>")
        if kind == "prismatic" and not np.allclose(axes[0], axes[1]):
            raise ValueError("prismatic along two axes; both sides need the same")
        self._add(element, kind, links, places, axes, links)

    def _of_gazebo(self, element: ET.Element) -> None:
        kind = _kind(element)
        parent, child = (
            self._link(element.findtext(side, "").strip(), side) for side in ("parent", "child")
        )
        pose = numbers(element.findtext("pose", "0 0 0 0 0 0"), 6)
        if pose is None:
            raise ValueError("its pose is not six numbers")
        place = pin.SE3(pin.rpy.rpyToMatrix(pose[3:]), pose[:3])
        tags = ("axis", "axis2") if kind == "universal" else ("axis", "axis")
        axes = [_vector(element.findtext(f"{tag}/xyz", "0 0 1")) for tag in tags]
        self._add(element, kind, [parent, child], [place, place], axes, [child, child])

    def _add(
        self,
        element: ET.Element,
        kind: str,
        links: Sequence[str],
        places: Sequence[pin.SE3],
        axes: Sequence[Array],
        seen_from: Sequence[str],
    ) -> None:
        if links[0] == links[1]:
            raise ValueError(f"connects {links[0]} with itself")
        if kind not in ("6d", "3d"):
            along = _ALONG.get(kind, np.eye(3)[[2, 2]])
            places = [turned(*each) for each in zip(places, axes, along, strict=True)]
        a, b = places
        name = _name(element, "name") or "_".join(links)
        seen = seen_from[0], seen_from[1]
        self.joints.append(CutJoint(name, kind, (links[0], links[1]), (a, b), seen))

    def _gear(self, element: ET.Element) -> None:
        first, second = (
            list(self._path(self._link(_name(element.find(side), "link"), side)))
            for side in ("predecessor", "successor")
        )
        ratio = number(element.find("ratio"), "value")
        if ratio is None:
            raise ValueError("its ratio is not a number")
        factors = {
            _name(joint, "name"): factor
            for path, factor, other in ((second, -1.0, first), (first, ratio, second))
            for joint in path
            if joint not in other and joint.get("type") != "fixed"
        }
        names = [name for name in factors if name not in self.independent and factors[name]]
        if not names:
            raise ValueError("no joint between its links depends on others")
        name, own = names[0], factors.pop(names[0])
        self.gears.append(Coupling(name, {n: (0.0, -f / own) for n, f in factors.items()}))

    def _path(self, link: str) -> Iterator[ET.Element]:
        """Joints from a link to the base."""
        while link in self._joints:
            joint = self._joints[link]
            yield joint
            link = _name(joint.find("parent"), "link")

    def _link(self, name: str, side: str) -> str:
        if name not in self._links:
            raise ValueError(f"{side} {name} is not a link of this file")
        return name


def _name(element: ET.Element | None, key: str) -> str:
    return "" if element is None else element.get(key, "")


def _independent(root: ET.Element) -> Iterator[str]:
    """Joints of a URDF+ that are not marked `independent="false"`."""
    joints = root.findall("joint")
    marks = [joint.get("independent") for joint in joints]
    if any(marks) or any(root.find(tag) is not None for tag in ("loop", "coupling")):
        for joint, mark in zip(joints, marks, strict=True):
            free = joint.get("type") not in ("fixed", "floating") and joint.find("mimic") is None
            if free and (mark or "true").lower() not in ("false", "0"):
                yield _name(joint, "name")


def _kind(element: ET.Element) -> str:
    kind = element.get("type", "")
    if kind not in _KINDS:
        raise ValueError(f"type {kind!r} unknown; known: {', '.join(_KINDS)}")
    return _KINDS[kind]


def _placement(origin: ET.Element | None) -> pin.SE3:
    found = {}
    for key in ("xyz", "rpy"):
        text = "0 0 0" if origin is None else origin.get(key, "0 0 0")
        values = numbers(text, 3)
        if values is None:
            raise ValueError(f"{key}={text!r} is not three numbers")
        found[key] = values
    return pin.SE3(pin.rpy.rpyToMatrix(found["rpy"]), found["xyz"])


def _axis(element: ET.Element | None) -> Array:
    return _vector("1 0 0" if element is None else element.get("xyz", "1 0 0"))


def _vector(text: str) -> Array:
    axis = numbers(text, 3)
    if axis is None or not np.linalg.norm(axis) > 1e-100:
        raise ValueError(f"axis {text!r} is not a direction")
    return axis / np.linalg.norm(axis)
