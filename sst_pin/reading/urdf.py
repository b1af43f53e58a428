# SPDX-License-Identifier: BSD-2-Clause
"""Reads a URDF as a Pinocchio model, couplings of its mimic joints and shapes."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Set
from difflib import get_close_matches
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ..errors import DescriptionError, InputError
from ..model.closures import Closure, Coupling
from ..model.joint_series import Series
from ..model.rebuilt_tree import rebuilt
from .acting_elements import unread_elements
from .cut_joints import Marks
from .problems import Problem, number, numbers, placement, warning
from .sdf import Sdf
from .text import bare, parse_almost_xml, read_text
from .tool_elements import is_weightless, joint_numbers, mimics_of
from .urdf_checks import check
from .urdf_defaults import WIDE, add_defaults

#: Revolute joints about the axes of their frame.
_TURNS = {"X": pin.JointModelRX(), "Y": pin.JointModelRY(), "Z": pin.JointModelRZ()}
#: Kinds of joints that a URDF lacks, also as LAAS writes them. For each the joints in series that
#: replace a joint of this kind, by the suffix of their names; none for a joint that is fixed.
KINDS: dict[str, dict[str, Any]] = {
    "FIXED": {},
    "BALL": {"": pin.JointModelSpherical()},
    "SPHERICAL": {"": pin.JointModelSpherical()},
    "UNIVERSAL": {"_X": _TURNS["X"], "_Y": _TURNS["Y"]},
}
for _first, _second in permutations(_TURNS, 2):  # UNIVERSAL XY, UJOINT_XY and so on
    _parts = {f"_{_first}": _TURNS[_first], f"_{_second}": _TURNS[_second]}
    KINDS[f"UNIVERSAL {_first}{_second}"] = _parts
    KINDS[f"UJOINT_{_first}{_second}"] = _parts
#: Elements that affect the dynamics; fixed joints have the first three only.
_OF_JOINTS = ("origin", "parent", "child", "axis", "limit", "dynamics")
#: Moving joints at most: Pinocchio's data have arrays with the cube of their number, 4 GB here.
MOST_JOINTS = 400


class Urdf:
    """A URDF, or an SDF in the form of a URDF, read and parsed once.

    Attributes:
        source: Its path, or another name for messages.
        root: Its elements; they must not be changed.
        gravity: In base axes, shape (3,), [m/s^2].
        numbers: Springs and rotors of its joints.
        marks: Joints that close loops, and gears.
        helpers: Links without mass that the file does not have.
        notices: Warnings of content that is read otherwise or not at all.
        problems: These warnings, others, and errors.
    """

    def __init__(self, text: str, source: str, model: str | None = None) -> None:
        self.source = source
        self._what = "an SDF" if "<sdf" in text else "a URDF"
        self.root, notices = parse_almost_xml(text, source, self._what)
        self.gravity = np.array([0, 0, -9.81])
        self._balls = list[str]()
        self.helpers: list[str] = []
        if self.root.tag == "sdf":
            sdf = Sdf(self.root, source, model)
            graph = sdf.graph()
            self.root = graph.urdf
            self.gravity = sdf.gravity
            self._balls = graph.balls
            self.helpers = graph.helpers
            notices += sdf.notes
        elif model is not None:
            raise InputError("model", "only an SDF has several models")
        if is_weightless(self.root):
            self.gravity = np.zeros(3)
        notices += [*add_defaults(self.root), *unread_elements(self.root)]
        self.numbers = joint_numbers(self.root)
        self.marks = Marks(self.root)
        self.notices = tuple(notice for notice in notices if notice.severity != "error")
        self.problems = (*notices, *check(self.root), *self.marks.problems)

    @classmethod
    def read(cls, path: str | Path, model: str | None = None) -> "Urdf":
        """The URDF in a file, or a model of an SDF."""
        return cls(read_text(path, "URDF"), str(path), model)

    @property
    def joint_names(self) -> list[str]:
        """Names of all joints, in the order of the file."""
        return [joint.get("name", "") for joint in self.root.findall("joint")]

    def tree(self, joints: Mapping[str, str] | None = None) -> pin.Model:
        """The Pinocchio model; an error names every error of `problems`.

        A `continuous` joint is read as a revolute one without limits: one angle, where Pinocchio
        would have its cosine and sine. A joint that mimics another is free here; see `mimics`.
        `joints` has the true kinds of joints by name: "FIXED"; "BALL"; "UNIVERSAL XY", ..., a
        joint for each axis, `name_X` and `name_Y`.
        """
        joints = {**dict.fromkeys(self._balls, "BALL"), **(joints or {})}

        # Errors of the file, and of the kinds of joints.
        names = self.joint_names
        problems = []
        for problem in self.problems:
            if problem.severity == "error":
                text = f"{problem.where}: {problem.text}"
                problems.append(text.replace("file:", f"not {self._what}:", 1))
        for name in set(joints).difference(names):
            text = f"joint {name} is missing"
            similar = get_close_matches(name, names, 1, 0.8)
            if similar:
                text += f"; {similar[0]} is meant?"
            problems.append(text)
        for element in self.root.iterfind("joint[@type='fixed']"):
            name = element.get("name", "")
            kind = joints.get(name, "FIXED")
            if KINDS[kind]:
                text = f"joint {name}: {kind}, but fixed in the URDF; make it revolute"
                problems.append(text)

        # The tree with a joint of one axis for each joint.
        root = _dynamics(self.root, joints)
        moving = sum(joint.get("type") != "fixed" for joint in root.findall("joint"))
        if moving > MOST_JOINTS:
            problems.append(f"{moving} moving joints; at most {MOST_JOINTS} are supported")
        if problems:
            raise DescriptionError(self.source, problems)
        try:
            model = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))
        except (ValueError, RuntimeError) as error:
            raise DescriptionError(self.source, [f"not {self._what}: {error}"]) from None

        # Joints of several axes replace some of them. Then frames of Drake.
        parts = {name: KINDS[kind] for name, kind in joints.items() if KINDS[kind]}
        if parts:
            model = self._split(model, parts)
        for frame in self.root.findall("frame"):
            link = model.frames[model.getFrameId(frame.get("link", ""), pin.FrameType.BODY)]
            placement_on_joint = link.placement * _pose(frame)
            name = frame.get("name", "")
            kind = pin.FrameType.OP_FRAME
            model.addFrame(pin.Frame(name, link.parentJoint, placement_on_joint, kind))
        return model

    def _split(self, model: pin.Model, parts: Mapping[str, Mapping[str, Any]]) -> pin.Model:
        """The tree with some joints replaced by several in series, each with their friction.

        `parts` are the joints of each series by suffix, by the name of the joint.
        """
        names = {frame.name for frame in model.frames if frame.type != pin.FrameType.BODY}
        for joint_name, series in parts.items():
            for suffix in series:
                if suffix and joint_name + suffix in names:
                    text = f"joint {joint_name}{suffix}: 2 have this name, a part of {joint_name} "
                    text += "is one of them"
                    raise DescriptionError(self.source, [text])
        changes = {model.getJointId(name): Series.named(series) for name, series in parts.items()}
        split = rebuilt(model, changes)
        for joint_name, series in parts.items():
            old_joint = model.joints[model.getJointId(joint_name)]
            old_rate = old_joint.idx_v
            for suffix in series:
                part = split.joints[split.getJointId(joint_name + suffix)]
                rates = slice(part.idx_v, part.idx_v + part.nv)
                split.damping[rates] = model.damping[old_rate]
                split.friction[rates] = model.friction[old_rate]
                sense = self._sense_of_part(joint_name, suffix)
                if sense:
                    _put_limits(split, part, model, old_joint, sense)
        return split

    def _sense_of_part(self, joint: str, suffix: str) -> int:
        """1 or -1 if a part turns about the axis of the joint in the URDF or against it, else 0."""
        axis = self.root.find(f"joint[@name='{joint}']/axis")
        direction = numbers("1 0 0" if axis is None else axis.get("xyz", ""), 3)
        if direction is None or suffix[1:] not in _TURNS:
            return 0
        component = direction["XYZ".index(suffix[1:])] / np.linalg.norm(direction)
        return int(np.sign(component)) if abs(component) > 1 - 1e-9 else 0

    def lost_limits(self, joints: Mapping[str, str], limited: Set[str]) -> Iterator[Problem]:
        """Warnings of limits of joints whose true kind does not have their axis.

        `limited` are joints of one axis that get other limits.
        """
        for name, kind in joints.items():
            limit = self.root.find(f"joint[@name='{name}']/limit")
            suffixes = list(KINDS[kind])
            if limit is None or not suffixes:
                continue
            names = [name + suffix for suffix in suffixes]
            has_axis = any(self._sense_of_part(name, suffix) for suffix in suffixes)
            if has_axis or not limited.isdisjoint(names):
                continue
            lower = number(limit, "lower") or 0.0
            upper = number(limit, "upper") or 0.0
            # half a turn to both sides excludes no orientation
            if lower > -np.pi or upper < np.pi:
                text = f"its limits of {lower:g} to {upper:g} are not used: it is {kind} in the "
                text += "YAML and has no such axis"
                if len(names) > 1:
                    text += f"; write joint_limit: {{{names[0]}: {{lower: .., upper: ..}}}}"
                yield warning(f"joint {name}", text)

    @property
    def mimics(self) -> tuple[Coupling, ...]:
        """A coupling for each joint that mimics another: multiplier and offset."""
        couplings = []
        for mimic in mimics_of(self.root):
            polynomial = (0.0, float(mimic.multiplier))
            couplings.append(
                Coupling(mimic.follower, {mimic.leader: polynomial}, float(mimic.offset))
            )
        return tuple(couplings)


def _put_limits(split: pin.Model, part: Any, model: pin.Model, joint: Any, sense: int) -> None:
    """Give a part, which turns along (1) or against (-1) the axis of a joint, its limits."""
    ends = (
        sense * model.lowerPositionLimit[joint.idx_q],
        sense * model.upperPositionLimit[joint.idx_q],
    )
    split.lowerPositionLimit[part.idx_q] = min(ends)
    split.upperPositionLimit[part.idx_q] = max(ends)
    split.effortLimit[part.idx_v] = model.effortLimit[joint.idx_v]
    split.velocityLimit[part.idx_v] = model.velocityLimit[joint.idx_v]


def _pose(element: ET.Element) -> pin.SE3:
    """The pose of a `<frame>` of Drake on its link."""
    xyz = numbers(element.get("xyz", "0 0 0"), 3)
    rpy = numbers(element.get("rpy", "0 0 0"), 3)
    if xyz is None or rpy is None:
        raise ValueError("not three numbers")  # the checks have named it
    return placement(xyz, rpy)


def is_closing(frame: pin.Frame) -> bool:
    """Whether a frame marks one of two points that coincide."""
    named = re.fullmatch("closing_.+_[12]", frame.name)
    return frame.type == pin.FrameType.BODY and named is not None


def closing_frames(model: pin.Model) -> Iterator[Closure]:
    """Points that coincide, marked by onshape-to-robot: frames `closing_NAME_1`, `closing_NAME_2`.

    With them PlaCo closes loops as well.
    """
    for name in [frame.name for frame in model.frames if is_closing(frame)]:
        first = f"{name[:-1]}1"
        second = f"{name[:-1]}2"
        if not (model.existFrame(first) and model.existFrame(second)):
            raise DescriptionError(name, [f"{first} and {second} close a loop; one is missing"])
        if name == first:
            yield Closure(first, second, "3d")


def _dynamics(root: ET.Element, kinds: Mapping[str, str]) -> ET.Element:
    """Elements that affect the dynamics, in the form for urdfdom; no joint is continuous."""
    copy = bare(root, {"link": ("inertial",), "joint": _OF_JOINTS})
    for joint in copy.findall("joint"):
        for dynamics in joint.findall("dynamics"):  # urdfdom wants one of them
            dynamics.attrib.setdefault("damping", "0")
        if "fixed" in (joint.get("type"), kinds.get(joint.get("name", ""), "").lower()):
            joint.set("type", "fixed")
            joint[:] = [child for child in joint if child.tag in _OF_JOINTS[:3]]
        elif joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ET.SubElement(joint, "limit", effort="0", velocity="0")
            limit.attrib.update(lower=f"-{WIDE}", upper=WIDE)
    return copy
