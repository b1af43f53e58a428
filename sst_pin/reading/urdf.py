# SPDX-License-Identifier: BSD-2-Clause
"""A URDF to a Pinocchio model, couplings of its mimic joints and shapes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ..chain.closures import Closure, Coupling
from ..chain.rebuilt_tree import rebuilt
from ..errors import DescriptionError
from .cut_joints import Marks
from .sdf import Sdf
from .shapes import UrdfShapes
from .text import parse_xml, read_text
from .urdf_checks import FIXED, INERTIAL, MOVING, check
from .usd import Usd, is_usd

_TURNS = {"X": pin.JointModelRX(), "Y": pin.JointModelRY(), "Z": pin.JointModelRZ()}
#: What a joint of the LAAS schema is: its parts, each with what is added to its name.
KINDS: dict[str, dict[str, Any]] = {
    "FIXED": {},
    "SPHERICAL": {"": pin.JointModelSpherical()},
    **{
        f"UJOINT_{a}{b}": {f"_{a}": _TURNS[a], f"_{b}": _TURNS[b]}
        for a in _TURNS
        for b in _TURNS
        if a != b
    },
}
#: Limit of a joint that has none, [rad] or [m].
_WIDE = "1e9"
#: Moving joints at most: Pinocchio's data have arrays with the cube of their number, 4 GB here.
MOST_JOINTS = 400


class Urdf:
    """A URDF, or an SDF or a USD in the form of a URDF, read and parsed once.

    Attributes:
        source: Its path, or what else error messages call it.
        root: Its elements; not to be changed.
        gravity: Acceleration of gravity, shape (3,), [m/s^2].
        marks: What it says of loops beyond the tree.
        poses: Named configurations that the file itself has, by joint.
        problems: What is wrong in names, tree and numbers.
    """

    def __init__(self, content: str | Usd, source: str) -> None:
        self.source, self.poses = source, dict[str, dict[str, list[float]]]()
        self.gravity, self._balls = np.array([0, 0, -9.81]), list[str]()
        if isinstance(content, Usd):
            self.root, self._balls, self.gravity = content.urdf(), content.balls, content.gravity
            self.poses = content.poses
        else:
            self.root = parse_xml(content, source)
        if self.root.tag == "sdf":
            sdf = Sdf(self.root, source)
            self.root, self._balls = sdf.urdf(), sdf.balls
            self.gravity = self.gravity if sdf.gravity is None else sdf.gravity
        self.marks = Marks(self.root)
        self.problems = (*check(self.root), *self.marks.problems)

    @classmethod
    def read(cls, path: str | Path) -> Urdf:
        """The URDF in a file."""
        usd = isinstance(path, (str, Path)) and is_usd(Path(path))
        return cls(Usd(Path(path)) if usd else read_text(path, "URDF"), str(path))

    @property
    def joint_names(self) -> list[str]:
        """Names of all joints, in the order of the file."""
        return [joint.get("name", "") for joint in self.root.findall("joint")]

    @property
    def shapes(self) -> UrdfShapes:
        """The shapes of its bodies."""
        return UrdfShapes(self.root, Path(self.source).parent)

    def tree(self, joints: Mapping[str, str] | None = None) -> pin.Model:
        """The Pinocchio model.

        A `continuous` joint is read as a revolute one without limits: one angle, where Pinocchio
        would have its cosine and sine. A joint that mimics another is free here; see `mimics`.

        Args:
            joints: What joints are in truth, where a URDF cannot say, by name: "FIXED";
                "SPHERICAL", a ball; "UJOINT_XY", ..., a joint for each axis, `name_X` and `name_Y`.

        Raises:
            DescriptionError: With every error of `problems`, or for an unknown joint.
        """
        joints = {**dict.fromkeys(self._balls, "SPHERICAL"), **(joints or {})}
        names = self.joint_names
        problems = [
            f"{'not a URDF' if problem.where == 'file' else problem.where}: {problem.text}"
            for problem in self.problems
            if problem.severity == "error"
        ]
        for name in set(joints).difference(names):
            meant = [f"; {near} is meant?" for near in get_close_matches(name, names, 1, 0.8)]
            problems.append(f"joint {name} is missing{''.join(meant)}")
        if problems:
            raise DescriptionError(self.source, problems)
        root = _dynamics(self.root)
        for joint in root.findall("joint"):
            if joints.get(joint.get("name", "")) == "FIXED":
                joint.set("type", "fixed")
        moving = sum(joint.get("type") != "fixed" for joint in root.findall("joint"))
        if moving > MOST_JOINTS:
            problems = [f"{moving} moving joints; at most {MOST_JOINTS} are supported"]
            raise DescriptionError(self.source, problems)
        try:
            model = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))
        except (ValueError, RuntimeError) as error:
            raise DescriptionError(self.source, [f"not a URDF: {error}"]) from None
        parts = {name: KINDS[kind] for name, kind in joints.items() if KINDS[kind]}
        return self._split(model, parts) if parts else model

    def _split(self, model: pin.Model, parts: Mapping[str, Mapping[str, Any]]) -> pin.Model:
        """The tree with some joints replaced by several in series."""
        taken = {frame.name for frame in model.frames if frame.type != pin.FrameType.BODY}
        for name in (name + suffix for name, own in parts.items() for suffix in own if suffix):
            if name in taken:
                text = f"joint {name}: 2 have this name, a part of {name[:-2]} is one of them"
                raise DescriptionError(self.source, [text])
        numbers = {model.getJointId(name): own for name, own in parts.items()}
        return rebuilt(model, numbers, pin.neutral(model))

    @property
    def mimics(self) -> tuple[Coupling, ...]:
        """A coupling for each joint that mimics another: multiplier and offset."""
        return tuple(
            Coupling(
                joint.get("name", ""),
                {mimic.get("joint", ""): (0.0, float(mimic.get("multiplier", "1")))},
                float(mimic.get("offset", "0")),
            )
            for joint in self.root.findall("joint")
            for mimic in joint.findall("mimic")
        )


def closing_frames(model: pin.Model) -> tuple[Closure, ...]:
    """Points that coincide, marked by onshape-to-robot: frames `closing_NAME_1`, `closing_NAME_2`.

    With them PlaCo closes loops as well.
    """
    firsts = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    pairs = [(name, f"{name[:-1]}2") for name in firsts if name.startswith("closing_")]
    return tuple(Closure(a, b, "3d") for a, b in pairs if a.endswith("_1") and model.existFrame(b))


def _dynamics(root: ET.Element) -> ET.Element:
    """What the dynamics are made of, with one blank between numbers and no continuous joints.

    Otherwise urdfdom takes a number before a tab for none, and a tree with an odd shape as well.
    """
    found = ET.Element(root.tag, root.attrib)
    for element in root:
        if element.tag not in ("link", "joint"):
            continue
        fixed = element.get("type") == "fixed"
        kept = ("inertial",) if element.tag == "link" else FIXED if fixed else MOVING
        copy = ET.SubElement(found, element.tag, element.attrib)
        for child in (child for child in element if child.tag in kept):
            part = ET.SubElement(copy, child.tag, child.attrib)
            part.extend(ET.Element(e.tag, e.attrib) for e in child if e.tag in INERTIAL)
            if part.tag == "dynamics":  # urdfdom wants one of them
                part.attrib.setdefault("damping", "0")
            if part.tag not in ("parent", "child"):  # which have names
                for e in (part, *part):
                    e.attrib.update({key: " ".join(text.split()) for key, text in e.items()})
        if copy.get("type") == "continuous":
            copy.set("type", "revolute")
            limit = copy.find("limit")
            if limit is None:
                limit = ET.SubElement(copy, "limit", effort="0", velocity="0")
            limit.attrib.update(lower="-" + _WIDE, upper=_WIDE)
    return found
