# SPDX-License-Identifier: BSD-2-Clause
"""Checks of a URDF: names, tree, numbers that would be lost, inertias, meshes, other tools."""

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from os.path import isfile
from pathlib import Path

import numpy as np

from ..arrays import Array
from .problems import (
    Problem,
    attribute,
    error,
    note,
    number,
    numbers,
    unknown_parts,
    warning,
)

ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_ONE_AXIS = ("revolute", "prismatic", "continuous")
_KINDS = (*_ONE_AXIS, "fixed", "floating", "planar")
#: Attributes of elements that act.
_ATTRIBUTES = {
    "origin": ["xyz", "rpy"],
    "mass": ["value"],
    "inertia": list(ENTRIES),
    "axis": ["xyz"],
    "limit": ["lower", "upper", "effort", "velocity"],
    "dynamics": ["damping", "friction"],
    "mimic": ["joint", "multiplier", "offset"],
}
_OF_FRAMES = ["name", "link", "xyz", "rpy"]
#: The count of numbers in attributes.
_COUNTS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}
#: Rounding of the moments of a rod or disc, as a share of the largest moment.
_ROUNDING = 1e-9
#: The most links that a warning names.
_NAMED = 5
#: Largest ratio of the masses of moving links; beyond it, half of the digits are lost.
_SPREAD = 1e8
#: Largest ratio of a link's size to its radius of gyration, 3.5 for a rod, and of this radius to
#: the largest size. Lengths or moments in millimetres make one of them a thousand times larger.
_SIZES = 100
#: Tools that refuse a kind of file.
_REFUSED = {
    ".stl": "Drake",
    ".dae": "MuJoCo and Drake",
    ".glb": "MuJoCo and PyBullet",
    ".gltf": "MuJoCo and PyBullet",
}


def check(root: ET.Element) -> Iterator[Problem]:
    """Errors and warnings of a URDF."""
    if root.tag != "robot":
        cure = ""
        if root.tag == "mujoco":
            cure = "; ClosedChain.from_mjcf reads an MJCF"
        yield error("file", f"a URDF starts with <robot>, not with <{root.tag}>{cure}")
        return
    links, joints = root.findall("link"), root.findall("joint")
    if any("xacro" in element.tag for element in root.iter()):
        cure = "make a URDF of it: xacro FILE.xacro > FILE.urdf (pip install xacro)"
        yield error("file", f"this is a xacro file; {cure}")
    if not root.get("name"):
        yield error("file", "<robot> has no name")
    if not links:
        yield error("file", "no links")
    for tag, elements in (("link", links), ("joint", joints)):
        for name, count in Counter(element.get("name") for element in elements).items():
            if not name:
                yield error(tag, f"{count} without a name")
            elif count > 1:
                yield error(f"{tag} {name}", f"{count} have this name")
    yield from _connections([link.get("name", "") for link in links], joints)
    for link in links:
        yield from _link(link, f"link {link.get('name')}")
    for frame in root.findall("frame"):  # of Drake
        where, link_name = f"frame {frame.get('name')}", frame.get("link", "")
        yield from (error(where, text) for text in unknown_parts(frame, [], _OF_FRAMES))
        if link_name not in {link.get("name") for link in links}:
            yield error(where, f"link {link_name} is not a link of this file")
        for key in ("xyz", "rpy"):
            if numbers(text := frame.get(key, "0 0 0"), 3) is None:
                yield error(where, f"{key}={text!r} is not three numbers")
    kinds = {joint.get("name"): joint.get("type", "") for joint in joints}
    for joint in joints:
        yield from _joint(joint, f"joint {joint.get('name')}", kinds)


def _connections(links: Sequence[str], joints: Sequence[ET.Element]) -> Iterator[Problem]:
    """Errors of links and joints that form no tree."""
    known, bearers, children = set(links), dict[str, str](), dict[str, list[str]]()
    for joint in joints:
        name = joint.get("name", "")
        parent, child = (attribute(joint, f"{role}/link") for role in ("parent", "child"))
        for role, link in (("parent", parent), ("child", child)):
            if not link:
                yield error(f"joint {name}", f"no <{role} link=...>")
            elif link not in known:
                yield error(f"joint {name}", f"{role} {link} is not a link of this file")
        if not (parent and child):
            continue
        if child in bearers:
            text = f"link {child} is already the child of joint {bearers[child]}; a URDF is a tree"
            text += ": cut the loop here and add a closure to the YAML of the cuts"
            yield error(f"joint {name}", text)
        else:
            bearers[child] = name
            children.setdefault(parent, []).append(child)
    branches = [link for link in dict.fromkeys(links) if link not in bearers]
    if len(branches) > 1:
        text = f"{len(branches)} links without a parent: {', '.join(branches)}"
        yield error("tree", f"{text}; only the base may have none")
    lost = dict.fromkeys(links)
    for link in branches:  # which grows
        branches += children.get(link, [])
        lost.pop(link, None)
    if lost:
        yield error("tree", f"links that are not connected to the base: {', '.join(lost)}")


def _parts(element: ET.Element) -> Iterator[str]:
    """Faults of the parts of a link or a joint that act; other tools add their own."""
    if element.tag == "link":
        tags, several = ["inertial"], ["visual", "collision"]
    else:
        tags = ["origin", "parent", "child", "axis", "limit", "dynamics", "mimic"]
        several = ["calibration", "safety_controller"]
    yield from unknown_parts(element, tags, ["name", "type"], several, others=True)
    for part in element:
        if part.tag in tags:
            yield from _content(part)


def _content(part: ET.Element) -> Iterator[str]:
    """Faults of a part of a link or a joint."""
    if part.tag == "inertial":
        yield from unknown_parts(part, ["origin", "mass", "inertia"], [], others=True)
        for each in part:
            if each.tag in ("origin", "mass", "inertia"):
                yield from _content(each)
    elif part.tag in ("limit", "dynamics", "axis"):  # the reader names what else is in them
        yield from unknown_parts(part, [], _ATTRIBUTES[part.tag], others=True)
    elif part.tag in _ATTRIBUTES:
        yield from unknown_parts(part, [], _ATTRIBUTES[part.tag])


def _link(link: ET.Element, where: str) -> Iterator[Problem]:
    yield from (error(where, text) for text in _parts(link))
    for inertial in link.findall("inertial"):
        yield from no_numbers(inertial, where)
        if (mass := number(inertial.find("mass"), "value")) is None:
            yield error(where, "its mass is not a number")
        elif mass < 0:
            yield error(where, f"its mass is negative, {mass:g} kg")
        if missing := [key for key in ENTRIES if number(inertial.find("inertia"), key) is None]:
            yield error(where, f"its inertia has no number {', '.join(missing)}")


def _joint(joint: ET.Element, where: str, kinds: Mapping[str | None, str]) -> Iterator[Problem]:
    kind, name = joint.get("type", ""), joint.get("name")
    yield from (error(where, text) for text in _parts(joint))
    yield from no_numbers(joint, where)
    if name == "universe":
        yield error(where, "Pinocchio's base has this name; rename the joint")
    if kind not in _KINDS:
        yield error(where, f"type {kind!r} unknown; known: {', '.join(_KINDS)}")
    if kind in ("floating", "planar"):
        yield note(where, f"{kind}: q has one more entry than v")
    if kind == "continuous":
        yield note(where, "continuous: two coordinates in Pinocchio; read as revolute here")
    if kind != "fixed":
        yield from _axis(joint, where, kind)
        yield from _friction(joint, where, kind)
    if kind in _ONE_AXIS:
        yield from _limits(joint, where, kind)
    for mimic in joint.findall("mimic"):
        other = mimic.get("joint")
        for each in (name, other):
            if each not in kinds:
                yield error(where, f"mimics {each}, which is not a joint of this file")
            elif kinds[each] not in _ONE_AXIS:
                yield error(where, f"mimics {other}: {each} is {kinds[each]}")
        if other == name:
            yield error(where, "mimics itself")


def no_numbers(parent: ET.Element, where: str) -> Iterator[Problem]:
    """Attributes of the children of an element that are not the right count of numbers."""
    for element in parent:
        for key, count in _COUNTS.get(element.tag, {}).items():
            if key in element.attrib and numbers(text := element.attrib[key], count) is None:
                need = "a number" if count == 1 else "three numbers"
                yield error(where, f"{element.tag} {key}={text!r} is not {need}")


def _axis(joint: ET.Element, where: str, kind: str) -> Iterator[Problem]:
    axis = joint.find("axis")
    text = "1 0 0" if axis is None else axis.get("xyz", "0 0 0")
    direction = numbers(text, 3)
    if direction is None:
        return
    if not 1e-100 < np.abs(direction).max() < 1e100:  # the norm of 1e200 overflows
        yield error(where, "its axis is zero")
    elif abs(np.linalg.norm(direction) - 1) > 1e-6:
        yield warning(where, f"its axis has length {np.linalg.norm(direction):.6g}, not 1")
    if kind == "planar" and (direction[:2].any() or not direction[2] > 0):
        text = f"planar about {text}; Pinocchio moves it in x and y whatever its axis: turn "
        yield error(where, text + "the joint's frame until the axis is 0 0 1")


def _friction(joint: ET.Element, where: str, kind: str) -> Iterator[Problem]:
    for key, name in (("damping", "viscous_friction"), ("friction", "coulomb_friction")):
        dynamics = joint.find("dynamics")
        value = number(dynamics, key) or 0.0
        if value and kind not in _ONE_AXIS:
            cure = f"write {name}: {{{joint.get('name')}: {value:g}}} in the YAML"
            yield error(where, f"{key} of a {kind} joint is not read; {cure}")
        elif value < 0:
            text = f"dynamics {key}={attribute(joint, f'dynamics/{key}')!r} is negative"
            yield error(where, f"{text}: it would accelerate the joint")


def _limits(joint: ET.Element, where: str, kind: str) -> Iterator[Problem]:
    limit = joint.find("limit")
    if limit is None:
        return
    for key in ("effort", "velocity"):
        if (number(limit, key) or 0) < 0:
            yield error(where, f"limit {key}={limit.get(key)!r} is negative")
    low, high = (numbers(limit.get(key, "0"), 1) for key in ("lower", "upper"))
    if kind == "continuous" or low is None or high is None:
        return
    if low > high:
        yield error(where, f"lower limit {low[0]:g} above the upper one {high[0]:g}")
    elif low == high:
        text = f"limits [{low[0]:g}, {high[0]:g}]: tools that enforce limits lock the joint"
        yield note(where, text)


def bodies_of(root: ET.Element) -> dict[str, tuple[float, Array]]:
    """Mass [kg] and moments of inertia [kg m^2], shape (3, 3), of the links that have both."""
    bodies = dict[str, tuple[float, Array]]()
    for link in root.findall("link[inertial]"):
        mass = number(link.find("inertial/mass"), "value")
        entries = [number(link.find("inertial/inertia"), key) for key in ENTRIES]
        if mass is not None and None not in entries:
            xx, xy, xz, yy, yz, zz = entries
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)
            bodies[link.get("name", "")] = mass, inertia
    return bodies


def principal_moments(inertia: Array) -> Array:
    """Principal moments of inertia, ascending, shape (3,), [kg m^2]."""
    size = np.abs(inertia).max() or 1.0  # of 1e300 the eigenvalues overflow
    return np.linalg.eigvalsh(inertia / size) * size


def impossible(mass: float, inertia: Array) -> str:
    """The reason why no body has this mass and these moments; empty if one can have them.

    A point or a rod without thickness counts as a body.
    """
    A, B, C = principal_moments(inertia)
    if not inertia.any():
        return ""
    if mass == 0:
        return "inertia without mass"
    shown = f"principal moments {A:.4g}, {B:.4g}, {C:.4g} kg m^2"
    if A < -_ROUNDING * C:
        return f"inertia not positive definite: {shown}"
    if A + B < C * (1 - _ROUNDING):
        return f"impossible inertia, the two smaller moments must reach the third: {shown}"
    return ""


def inertia_notes(root: ET.Element) -> Iterator[str]:
    """Notes on links of a URDF with impossible inertias, which are used unchanged."""
    reasons = ((name, impossible(*body)) for name, body in bodies_of(root).items())
    if problems := [f"link {name}: {text}" for name, text in reasons if text]:
        more = f" and {len(problems) - _NAMED} more" * (len(problems) > _NAMED)
        listed = "; ".join(problems[:_NAMED])
        yield f"{listed}{more}. The dynamics are computed with these numbers"


def check_inertias(root: ET.Element, without: Collection[str] = ()) -> Iterator[Problem]:
    """Problems of a URDF's inertials, but for some links that need none."""
    joints, bodies = root.findall("joint"), bodies_of(root)
    moves = {attribute(joint, "child/link"): joint.get("type") != "fixed" for joint in joints}
    for link in root.findall("link"):
        name = link.get("name", "")
        where = f"link {name}"
        if name in bodies:
            yield from _body(*bodies[name], where, moves.get(name, False))
        elif link.find("inertial") is not None or name in without:
            continue  # the reader's checks name a missing number
        elif moves.get(name):
            yield note(where, "moves without <inertial>: 1 kg in PyBullet, refused by MuJoCo")
        elif name in moves:
            text = "1 kg in PyBullet; add an <inertial> of zeros"
            yield note(where, f"fixed link without <inertial>: {text}")
    masses = {name: mass for name, (mass, _) in bodies.items() if moves.get(name) and mass > 0}
    heavy, light = (end(masses, key=lambda n: masses[n], default="") for end in (max, min))
    if masses and masses[heavy] > _SPREAD * masses[light]:
        text = f"very different masses, {masses[heavy]:.3g} kg and {masses[light]:.3g} kg"
        yield warning(f"links {heavy} and {light}", text)
    yield from _sizes(root, bodies)


def _sizes(root: ET.Element, bodies: Mapping[str, tuple[float, Array]]) -> Iterator[Problem]:
    """Links whose lengths and inertias are in different units."""
    sizes = dict[str, float]()
    for joint in root.findall("joint"):
        for parent, origin in zip(joint.findall("parent"), joint.findall("origin"), strict=False):
            if (place := numbers(origin.get("xyz", "0 0 0"), 3)) is not None:
                name = parent.get("link", "")
                sizes[name] = max(sizes.get(name, 0.0), float(np.linalg.norm(place)))
    largest = max(sizes.values(), default=0.0)
    for name, (mass, inertia) in bodies.items():
        size, moment = sizes.get(name, 0.0), principal_moments(inertia)[2]
        radius = math.sqrt(moment / mass) if mass > 0 and moment > 0 else 0.0
        if radius and (size > _SIZES * radius or radius > _SIZES * largest > 0):
            text = f"joints {size:.3g} m apart, but a radius of gyration of {radius:.3g} m; URDF "
            yield warning(f"link {name}", text + "needs m, kg and kg m^2")


def _body(mass: float, inertia: Array, where: str, moves: bool) -> Iterator[Problem]:
    if mass < 0:
        return  # an error of the reader's checks
    if text := impossible(mass, inertia):
        yield warning(where, text)
    elif moves and mass == 0:
        yield note(where, "moves without mass: refused by MuJoCo")
    elif moves and not inertia.any():
        yield note(where, "moves, has mass but no inertia: refused by MuJoCo")
    elif mass and not inertia.any():
        yield note(where, "has mass but no inertia")
    elif moves and principal_moments(inertia)[0] <= 0:
        yield note(where, "moves, a principal moment of its inertia is 0: refused by MuJoCo")


def check_shapes(root: ET.Element, folder: Path) -> Iterator[Problem]:
    """Problems of the shapes of a URDF in a folder."""
    meshes: dict[str, str] = {}
    for link in root.findall("link"):
        where = f"link {link.get('name')}"
        for shape in (*link.findall("visual"), *link.findall("collision")):
            for part in (shape, *shape.findall("geometry")):  # Pinocchio drops such a shape
                yield from no_numbers(part, where)
        for shape in link.iterfind(".//geometry/*"):
            if shape.tag == "capsule":
                yield note(where, "<capsule>: not drawn by Pinocchio")
            if shape.tag == "mesh":
                meshes.setdefault(shape.get("filename", ""), where)
    for name, where in meshes.items():  # once for each file
        yield from _mesh(name, where, folder)


def _mesh(name: str, where: str, folder: Path) -> Iterator[Problem]:
    if name.startswith("package://"):
        yield note(where, "meshes by package://: not resolved by MuJoCo; use relative paths")
        package, _, rest = name.removeprefix("package://").partition("/")
        places = [base / package / rest for base in (folder, *folder.resolve().parents)]
    else:
        places = [folder / name.removeprefix("file://")]
        if Path(name.removeprefix("file://")).is_absolute():
            yield warning(where, f"mesh {name}: an absolute path is valid on one machine only")
    if not any(map(isfile, places)):  # which takes names of any length
        text = f"mesh {name or '(no name)'}: not found; the shape is not drawn"
        yield warning(where, text)
    kind = Path(name).suffix.lower()
    if tools := _REFUSED.get(kind):
        yield note(where, f"meshes {kind}: not read by {tools}")
