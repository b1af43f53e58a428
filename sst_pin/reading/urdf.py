# SPDX-License-Identifier: BSD-2-Clause
"""URDF to a Pinocchio model, its mimic joints to couplings."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any

import pinocchio as pin

from ..chain.closures import Closure, Coupling
from ..errors import DescriptionError
from .checks import FIXED, INERTIAL, MOVING, check
from .problems import Problem

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
#: What a tree has for each rate, and for each coordinate.
_OF_RATES = ("damping", "friction", "effortLimit", "velocityLimit")
_OF_COORDINATES = ("lowerPositionLimit", "upperPositionLimit")
#: Of a joint without limits; [rad] or [m].
_WIDE = "1e9"
#: Pinocchio's data have several arrays with the cube of their number: 4 GB here.
MOST_JOINTS = 400
#: Links, joints and others; Pinocchio goes down a tree by recursion, deep enough to crash.
_MOST_ELEMENTS = 10_000


def parse_urdf(text: str, source: str, joints: Mapping[str, str] | None = None) -> pin.Model:
    """A Pinocchio model of a URDF.

    A `continuous` joint is read as a revolute one without limits: one angle, where Pinocchio would
    have its cosine and sine. A joint that mimics another is free here; see `parse_mimics`.

    Args:
        text: The XML.
        source: What error messages call it.
        joints: What joints are in truth, where a URDF cannot say, by name: "FIXED"; "SPHERICAL", a
            ball; "UJOINT_XY", ..., a joint for each axis, `name_X` and `name_Y`.

    Raises:
        DescriptionError: When it is no URDF, or has what the dynamics would overlook: with every
            error that `validate` finds in names, tree and numbers.
    """
    root = parse_xml(text, source)
    problems = _errors(check(root))
    names = [joint.get("name", "") for joint in root.findall("joint")]
    for name in set(joints or ()).difference(names):
        meant = [f"; {near} is meant?" for near in get_close_matches(name, names, 1, 0.8)]
        problems.append(f"joint {name} is missing{''.join(meant)}")
    if problems:
        raise DescriptionError(source, problems)
    _strip(root)
    _unbind(root)
    for joint in root.findall("joint"):
        if (joints or {}).get(joint.get("name", "")) == "FIXED":
            joint.set("type", "fixed")
    moving = sum(joint.get("type") != "fixed" for joint in root.findall("joint"))
    if moving > MOST_JOINTS:
        problems = [f"{moving} moving joints; at most {MOST_JOINTS} are supported"]
        raise DescriptionError(source, problems)
    try:
        model = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        raise DescriptionError(source, [f"not a URDF: {error}"]) from None
    parts = {name: KINDS[kind] for name, kind in (joints or {}).items() if KINDS[kind]}
    return _with(model, parts, source) if parts else model


def parse_mimics(text: str, source: str) -> tuple[Coupling, ...]:
    """A coupling for each joint of a URDF that mimics another: multiplier and offset.

    Raises:
        DescriptionError: When it is not XML.
    """
    return tuple(
        Coupling(
            joint.get("name", ""),
            {mimic.get("joint", ""): (0.0, float(mimic.get("multiplier", "1")))},
            float(mimic.get("offset", "0")),
        )
        for joint in parse_xml(text, source).findall("joint")
        for mimic in joint.findall("mimic")
    )


def closing_frames(model: pin.Model) -> tuple[Closure, ...]:
    """Points that coincide, marked by onshape-to-robot: frames `closing_NAME_1`, `closing_NAME_2`.

    With them PlaCo closes loops as well.
    """
    firsts = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    pairs = [(name, f"{name[:-1]}2") for name in firsts if name.startswith("closing_")]
    return tuple(Closure(a, b, "3d") for a, b in pairs if a.endswith("_1") and model.existFrame(b))


def parse_xml(text: str, source: str, what: str = "a URDF") -> ET.Element:
    """The elements of a URDF or an SRDF.

    Raises:
        DescriptionError: When it is not XML, with line and column, which urdfdom does not say; or
            when it is larger than any robot.
    """
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise DescriptionError(source, [f"not {what}: not XML: {error}"]) from None
    if len(root) > _MOST_ELEMENTS:
        text = f"not {what}: {len(root)} elements; at most {_MOST_ELEMENTS} are supported"
        raise DescriptionError(source, [text])
    return root


def _errors(problems: Iterable[Problem]) -> list[str]:
    return [
        f"{'not a URDF' if problem.where == 'file' else problem.where}: {problem.text}"
        for problem in problems
        if problem.severity == "error"
    ]


def _strip(root: ET.Element) -> None:
    """Leave what the dynamics are made of, and one blank between numbers.

    Otherwise urdfdom takes a number before a tab for none, and a tree with an odd shape as well.
    """
    root[:] = [element for element in root if element.tag in ("link", "joint")]
    for element in root:
        fixed = element.get("type") == "fixed"
        kept = ("inertial",) if element.tag == "link" else FIXED if fixed else MOVING
        element[:] = [child for child in element if child.tag in kept]
        for child in element:
            child[:] = [ET.Element(e.tag, e.attrib) for e in child if e.tag in INERTIAL]
            if child.tag == "dynamics":  # urdfdom wants one of them
                child.attrib.setdefault("damping", "0")
            if child.tag not in ("parent", "child"):  # which have names
                for e in (child, *child):
                    e.attrib.update({key: " ".join(text.split()) for key, text in e.items()})


def _unbind(root: ET.Element) -> None:
    """Make continuous joints revolute."""
    for joint in root.findall("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ET.SubElement(joint, "limit", effort="0", velocity="0")
            limit.attrib.update(lower="-" + _WIDE, upper=_WIDE)


def _with(old: pin.Model, parts: Mapping[str, Mapping[str, Any]], source: str) -> pin.Model:
    """The tree in which some joints are replaced, each by one or several joints in series."""
    for name in (name + suffix for name, own in parts.items() for suffix in own if suffix):
        if any(frame.name == name and frame.type != pin.FrameType.BODY for frame in old.frames):
            text = f"joint {name}: 2 have this name, a part of {name[:-2]} is one of them"
            raise DescriptionError(source, [text])
    model, ids = pin.Model(), [0]
    model.name, model.gravity = old.name, old.gravity
    model.inertias[0] = old.inertias[0]
    for name, place, joint, parent, inertia in zip(
        *(list(x)[1:] for x in (old.names, old.jointPlacements, old.joints, old.parents)),
        list(old.inertias)[1:],
        strict=True,
    ):
        parent_joint, at = ids[parent], place
        for suffix, part in parts.get(name, {"": joint}).items():
            parent_joint = model.addJoint(parent_joint, part, at, name + suffix)
            at = pin.SE3.Identity()
            model.addJointFrame(parent_joint)
        model.appendBodyToJoint(parent_joint, inertia, at)
        ids.append(parent_joint)
    for frame in list(old.frames)[1:]:
        if frame.type != pin.FrameType.JOINT:
            placed = pin.Frame(frame.name, ids[frame.parentJoint], frame.placement, frame.type)
            model.addFrame(placed, False)
    for name in set(old.names) & set(model.names) - set(parts):  # numbers of the joints that stay
        a, b = (m.joints[m.getJointId(name)] for m in (old, model))
        for field in _OF_RATES:
            getattr(model, field)[b.idx_v : b.idx_v + b.nv] = getattr(old, field)[
                a.idx_v : a.idx_v + a.nv
            ]
        for field in _OF_COORDINATES:
            getattr(model, field)[b.idx_q : b.idx_q + b.nq] = getattr(old, field)[
                a.idx_q : a.idx_q + a.nq
            ]
    return model
