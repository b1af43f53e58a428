# SPDX-License-Identifier: BSD-2-Clause
"""Reads a URDF as a Pinocchio model, couplings of its mimic joints and shapes."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping
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
from .acting_elements import is_weightless, joint_numbers, mimics_of, unread
from .cut_joints import Marks
from .problems import Problem, number, numbers, placement, warning
from .sdf import Sdf
from .text import bare, parse_almost_xml, read_text
from .urdf_checks import check
from .urdf_defaults import WIDE, add_defaults

_TURNS = {"X": pin.JointModelRX(), "Y": pin.JointModelRY(), "Z": pin.JointModelRZ()}
_PAIRS = {a + b: {f"_{x}": _TURNS[x] for x in (a, b)} for a, b in permutations(_TURNS, 2)}
#: Kinds of joints that a URDF lacks, also as LAAS writes them: their parts by suffix of the name.
KINDS: dict[str, dict[str, Any]] = {
    "FIXED": {},
    "BALL": {"": pin.JointModelSpherical()},
    "SPHERICAL": {"": pin.JointModelSpherical()},
    "UNIVERSAL": _PAIRS["XY"],
    **{f"UNIVERSAL {axes}": parts for axes, parts in _PAIRS.items()},
    **{f"UJOINT_{axes}": parts for axes, parts in _PAIRS.items()},
}
#: Elements that affect the dynamics; fixed joints have the first three only.
_OF_JOINTS = ("origin", "parent", "child", "axis", "limit", "dynamics")
#: Moving joints at most: Pinocchio's data have arrays with the cube of their number, 4 GB here.
MOST_JOINTS = 400


class Urdf:
    """A URDF, or an SDF in the form of a URDF, read and parsed once.

    `source` is its path, or another name for messages; `root` its elements, not to be changed;
    `marks` the joints that close loops, and gears; `numbers` springs and rotors of its joints;
    `notices` warnings of content that is read otherwise or not at all; `problems` these, errors
    and other warnings; `helpers` links without mass that the file does not have.
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
        notices += [*add_defaults(self.root), *unread(self.root)]
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
        names = self.joint_names
        errors = [p for p in self.problems if p.severity == "error"]
        problems = [
            f"{p.where}: {p.text}".replace("file:", f"not {self._what}:", 1) for p in errors
        ]
        for name in set(joints).difference(names):
            meant = [f"; {near} is meant?" for near in get_close_matches(name, names, 1, 0.8)]
            problems.append(f"joint {name} is missing{''.join(meant)}")
        for name in (j.get("name", "") for j in self.root.iterfind("joint[@type='fixed']")):
            if KINDS[joints.get(name, "FIXED")]:
                text = f"{joints[name]}, but fixed in the URDF; make it revolute"
                problems.append(f"joint {name}: {text}")
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
        parts = {name: KINDS[kind] for name, kind in joints.items() if KINDS[kind]}
        model = self._split(model, parts) if parts else model
        for frame in self.root.findall("frame"):  # of Drake
            link = model.frames[model.getFrameId(frame.get("link", ""), pin.FrameType.BODY)]
            at = link.placement * _pose(frame)
            kind = pin.FrameType.OP_FRAME
            model.addFrame(pin.Frame(frame.get("name", ""), link.parentJoint, at, kind))
        return model

    def _split(self, model: pin.Model, parts: Mapping[str, Mapping[str, Any]]) -> pin.Model:
        """The tree with some joints replaced by several in series, each with their friction."""
        names = {frame.name for frame in model.frames if frame.type != pin.FrameType.BODY}
        for name in (name + suffix for name, each in parts.items() for suffix in each if suffix):
            if name in names:
                text = f"joint {name}: 2 have this name, a part of {name[:-2]} is one of them"
                raise DescriptionError(self.source, [text])
        series = {model.getJointId(name): Series.named(each) for name, each in parts.items()}
        split = rebuilt(model, series)
        for name, suffix in ((name, suffix) for name, each in parts.items() for suffix in each):
            old = model.joints[model.getJointId(name)].idx_v
            part = split.joints[split.getJointId(name + suffix)]
            rates = slice(part.idx_v, part.idx_v + part.nv)
            split.damping[rates], split.friction[rates] = model.damping[old], model.friction[old]
            _put_limits(split, part, model, old, self._along(name, suffix))
        return split

    def _along(self, joint: str, suffix: str) -> int:
        """1 or -1 if a part of a joint turns along or against its axis in the URDF, else 0."""
        axis = self.root.find(f"joint[@name='{joint}']/axis")
        direction = numbers("1 0 0" if axis is None else axis.get("xyz", ""), 3)
        if direction is None or suffix[1:] not in _TURNS:
            return 0
        component = direction["XYZ".index(suffix[1:])] / np.linalg.norm(direction)
        return int(np.sign(component)) if abs(component) > 1 - 1e-9 else 0

    def lost_limits(self, joints: Mapping[str, str], limited: Collection[str]) -> Iterator[Problem]:
        """Warnings of limits of joints whose true kind does not have their axis.

        `limited` are joints of one axis that get other limits.
        """
        for name, kind in joints.items():
            limit = self.root.find(f"joint[@name='{name}']/limit")
            ends = [number(limit, key) or 0.0 for key in ("lower", "upper")]
            names = [name + suffix for suffix in KINDS[kind]]
            has_axis = any(self._along(name, suffix) for suffix in KINDS[kind])
            if not KINDS[kind] or has_axis or {*names} & {*limited}:
                continue
            # half a turn to both sides excludes no orientation
            if limit is not None and not (ends[0] <= -np.pi and ends[1] >= np.pi):
                text = f"its limits of {ends[0]:g} to {ends[1]:g} are not kept: it is {kind} in the"
                text += " YAML and has no such axis"
                if len(names) > 1:
                    text += f"; write joint_limit: {{{names[0]}: {{lower: .., upper: ..}}}}"
                yield warning(f"joint {name}", text)

    @property
    def mimics(self) -> tuple[Coupling, ...]:
        """A coupling for each joint that mimics another: multiplier and offset."""
        return tuple(
            Coupling(name, {other: (0.0, float(factor))}, float(offset))
            for name, other, factor, offset in mimics_of(self.root)
        )


def _put_limits(split: pin.Model, part: Any, model: pin.Model, old: int, sense: int) -> None:
    """Give a joint of one axis the limits of a joint; none if its axis is another."""
    if not sense:
        return
    whole = next(joint for joint in list(model.joints)[1:] if joint.idx_v == old)
    ends = model.lowerPositionLimit[whole.idx_q], model.upperPositionLimit[whole.idx_q]
    low, high = sorted(sense * end for end in ends)
    split.lowerPositionLimit[part.idx_q], split.upperPositionLimit[part.idx_q] = low, high
    split.effortLimit[part.idx_v] = model.effortLimit[old]
    split.velocityLimit[part.idx_v] = model.velocityLimit[old]


def _pose(element: ET.Element) -> pin.SE3:
    """The pose of a `<frame>` of Drake on its link."""
    xyz, rpy = (numbers(element.get(key, "0 0 0"), 3) for key in ("xyz", "rpy"))
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
