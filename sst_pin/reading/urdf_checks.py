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
#: Known attributes of elements that change the motion.
_ATTRIBUTES = {
    "origin": ["xyz", "rpy"],
    "mass": ["value"],
    "inertia": list(ENTRIES),
    "axis": ["xyz"],
    "limit": ["lower", "upper", "effort", "velocity"],
    "dynamics": ["damping", "friction"],
    "mimic": ["joint", "multiplier", "offset"],
}
_FRAME_ATTRIBUTES = ["name", "link", "xyz", "rpy"]
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
#: Largest number of links that a warning names.
_MAX_NAMES = 5
#: Largest ratio of the masses of moving links; beyond it, half of the digits are lost.
_MAX_MASS_RATIO = 1e8
#: Largest ratio of a link's size to its radius of gyration, which is 3.5 for a rod, and of this
#: radius to the largest size. Lengths or moments in millimetres make one of the ratios a thousand
#: times larger.
_MAX_SIZE_RATIO = 100
#: Range of the largest entry of an axis. The squares of others underflow or overflow in its norm.
_MIN_AXIS = 1e-100
_MAX_AXIS = 1e100
#: Largest deviation of an axis from unit length that is rounding of its written digits.
_AXIS_ROUNDING = 1e-6
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
        cure = "; ClosedChain.from_mjcf reads an MJCF" if root.tag == "mujoco" else ""
        yield error("file", f"a URDF starts with <robot>, not with <{root.tag}>{cure}")
        return
    links = root.findall("link")
    joints = root.findall("joint")
    if any("xacro" in element.tag for element in root.iter()):
        cure = "make a URDF of it: xacro FILE.xacro > FILE.urdf (pip install xacro)"
        yield error("file", f"this is a xacro file; {cure}")
    if not root.get("name"):
        yield error("file", "<robot> has no name")
    if not links:
        yield error("file", "no links")
    yield from _repeated_names("link", links)
    yield from _repeated_names("joint", joints)
    link_names = [link.get("name", "") for link in links]
    yield from _connections(link_names, joints)
    for link in links:
        yield from _link(link, f"link {link.get('name')}")
    frame_links = {link.get("name") for link in links}
    for frame in root.findall("frame"):
        yield from _drake_frame(frame, frame_links)
    kinds = {joint.get("name"): joint.get("type", "") for joint in joints}
    for joint in joints:
        yield from _joint(joint, f"joint {joint.get('name')}", kinds)


def _repeated_names(tag: str, elements: Sequence[ET.Element]) -> Iterator[Problem]:
    for name, count in Counter(element.get("name") for element in elements).items():
        if not name:
            yield error(tag, f"{count} without a name")
        elif count > 1:
            yield error(f"{tag} {name}", f"{count} have this name")


def _drake_frame(frame: ET.Element, links: Collection[str | None]) -> Iterator[Problem]:
    where = f"frame {frame.get('name')}"
    for text in unknown_parts(frame, [], _FRAME_ATTRIBUTES):
        yield error(where, text)
    link = frame.get("link", "")
    if link not in links:
        yield error(where, f"link {link} is not a link of this file")
    for key in ("xyz", "rpy"):
        text = frame.get(key, "0 0 0")
        if numbers(text, 3) is None:
            yield error(where, f"{key}={text!r} is not three numbers")


def _connections(links: Sequence[str], joints: Sequence[ET.Element]) -> Iterator[Problem]:
    """Errors of links and joints that form no tree."""
    known = set(links)
    parent_joints = dict[str, str]()  # by child
    children = dict[str, list[str]]()  # by parent
    for joint in joints:
        name = joint.get("name", "")
        parent = attribute(joint, "parent/link")
        child = attribute(joint, "child/link")
        for role, link in (("parent", parent), ("child", child)):
            if not link:
                yield error(f"joint {name}", f"no <{role} link=...>")
            elif link not in known:
                yield error(f"joint {name}", f"{role} {link} is not a link of this file")
        if not parent or not child:
            continue
        if child in parent_joints:
            other = parent_joints[child]
            text = f"link {child} is already the child of joint {other}; a URDF is a tree"
            text += ": cut the loop here and add a closure to the YAML of the cuts"
            yield error(f"joint {name}", text)
        else:
            parent_joints[child] = name
            children.setdefault(parent, []).append(child)
    roots = [link for link in dict.fromkeys(links) if link not in parent_joints]
    if len(roots) > 1:
        text = f"{len(roots)} links without a parent: {', '.join(roots)}"
        yield error("tree", f"{text}; only the base may have none")
    unreachable = dict.fromkeys(links)  # a dictionary, to keep the order
    queue = list(roots)
    while queue:
        link = queue.pop()
        unreachable.pop(link, None)
        queue += children.get(link, [])
    if unreachable:
        yield error("tree", f"links that are not connected to the base: {', '.join(unreachable)}")


def _parts(element: ET.Element) -> Iterator[str]:
    """Faults of the parts of a link or a joint that change the motion.

    Other tools add parts of their own, which are no faults.
    """
    if element.tag == "link":
        tags = ["inertial"]
        several = ["visual", "collision"]
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
        for child in part:
            if child.tag in ("origin", "mass", "inertia"):
                yield from _content(child)
    elif part.tag in ("limit", "dynamics", "axis"):  # the reader names what else is in them
        yield from unknown_parts(part, [], _ATTRIBUTES[part.tag], others=True)
    elif part.tag in _ATTRIBUTES:
        yield from unknown_parts(part, [], _ATTRIBUTES[part.tag])


def _link(link: ET.Element, where: str) -> Iterator[Problem]:
    for text in _parts(link):
        yield error(where, text)
    for inertial in link.findall("inertial"):
        yield from no_numbers(inertial, where)
        mass = number(inertial.find("mass"), "value")
        if mass is None:
            yield error(where, "its mass is not a number")
        elif mass < 0:
            yield error(where, f"its mass is negative, {mass:g} kg")
        inertia = inertial.find("inertia")
        missing = [key for key in ENTRIES if number(inertia, key) is None]
        if missing:
            yield error(where, f"its inertia has no number {', '.join(missing)}")


def _joint(joint: ET.Element, where: str, kinds: Mapping[str | None, str]) -> Iterator[Problem]:
    kind = joint.get("type", "")
    for text in _parts(joint):
        yield error(where, text)
    yield from no_numbers(joint, where)
    if joint.get("name") == "universe":
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
        yield from _mimic(joint.get("name"), mimic.get("joint"), where, kinds)


def _mimic(
    follower: str | None, leader: str | None, where: str, kinds: Mapping[str | None, str]
) -> Iterator[Problem]:
    """Errors of a joint that follows another one; both need one axis."""
    for name in (follower, leader):
        if name not in kinds:
            yield error(where, f"mimics {name}, which is not a joint of this file")
        elif kinds[name] not in _ONE_AXIS:
            yield error(where, f"mimics {leader}: {name} is {kinds[name]}")
    if leader == follower:
        yield error(where, "mimics itself")


def no_numbers(parent: ET.Element, where: str) -> Iterator[Problem]:
    """Attributes of the children of an element that are not the right count of numbers."""
    for element in parent:
        for key, count in _COUNTS.get(element.tag, {}).items():
            text = element.get(key)
            if text is not None and numbers(text, count) is None:
                need = "a number" if count == 1 else "three numbers"
                yield error(where, f"{element.tag} {key}={text!r} is not {need}")


def _axis(joint: ET.Element, where: str, kind: str) -> Iterator[Problem]:
    """Problems of the direction of an axis."""
    axis = joint.find("axis")
    text = "1 0 0" if axis is None else axis.get("xyz", "0 0 0")
    direction = numbers(text, 3)
    if direction is None:
        return
    if not _MIN_AXIS < np.abs(direction).max() < _MAX_AXIS:
        yield error(where, "its axis is zero")
    elif abs(np.linalg.norm(direction) - 1) > _AXIS_ROUNDING:
        yield warning(where, f"its axis has length {np.linalg.norm(direction):.6g}, not 1")
    is_along_z = direction[2] > 0 and not direction[:2].any()
    if kind == "planar" and not is_along_z:
        text = f"planar about {text}; Pinocchio moves it in x and y whatever its axis: turn "
        yield error(where, text + "the joint's frame until the axis is 0 0 1")


def _friction(joint: ET.Element, where: str, kind: str) -> Iterator[Problem]:
    """Errors of friction that is negative or that Pinocchio does not read."""
    dynamics = joint.find("dynamics")
    for key, yaml_key in (("damping", "viscous_friction"), ("friction", "coulomb_friction")):
        value = number(dynamics, key) or 0.0
        if value and kind not in _ONE_AXIS:
            cure = f"write {yaml_key}: {{{joint.get('name')}: {value:g}}} in the YAML"
            yield error(where, f"{key} of a {kind} joint is not read; {cure}")
        elif value < 0:
            text = f"dynamics {key}={attribute(joint, f'dynamics/{key}')!r} is negative"
            yield error(where, f"{text}: it would accelerate the joint")


def _limits(joint: ET.Element, where: str, kind: str) -> Iterator[Problem]:
    """Problems of limits that are negative, reversed or equal."""
    limit = joint.find("limit")
    if limit is None:
        return
    for key in ("effort", "velocity"):
        if (number(limit, key) or 0) < 0:
            yield error(where, f"limit {key}={limit.get(key)!r} is negative")
    lower = numbers(limit.get("lower", "0"), 1)
    upper = numbers(limit.get("upper", "0"), 1)
    if kind == "continuous" or lower is None or upper is None:
        return
    if lower > upper:
        yield error(where, f"lower limit {lower[0]:g} above the upper one {upper[0]:g}")
    elif lower == upper:
        text = f"limits [{lower[0]:g}, {upper[0]:g}]: tools that enforce limits lock the joint"
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
    scale = np.abs(inertia).max() or 1.0  # without it, the eigenvalues of 1e300 overflow
    return np.linalg.eigvalsh(inertia / scale) * scale


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
    problems = list[str]()
    for name, (mass, inertia) in bodies_of(root).items():
        reason = impossible(mass, inertia)
        if reason:
            problems.append(f"link {name}: {reason}")
    if not problems:
        return
    text = "; ".join(problems[:_MAX_NAMES])
    if len(problems) > _MAX_NAMES:
        text += f" and {len(problems) - _MAX_NAMES} more"
    yield f"{text}. The dynamics are computed with these numbers"


def check_inertias(root: ET.Element, helpers: Collection[str] = ()) -> Iterator[Problem]:
    """Problems of a URDF's inertials; the links in `helpers` need none."""
    bodies = bodies_of(root)
    moves = {
        attribute(joint, "child/link"): joint.get("type") != "fixed"
        for joint in root.findall("joint")
    }
    for link in root.findall("link"):
        name = link.get("name", "")
        where = f"link {name}"
        if name in bodies:
            yield from _body(*bodies[name], where, moves.get(name, False))
        elif link.find("inertial") is not None or name in helpers:
            continue  # `_link` reports missing numbers
        elif moves.get(name):
            yield note(where, "moves without <inertial>: 1 kg in PyBullet, refused by MuJoCo")
        elif name in moves:
            text = "1 kg in PyBullet; add an <inertial> of zeros"
            yield note(where, f"fixed link without <inertial>: {text}")
    masses = {name: mass for name, (mass, _) in bodies.items() if moves.get(name) and mass > 0}
    yield from _mass_ratio(masses)
    yield from _sizes(root, bodies)


def _mass_ratio(masses: Mapping[str, float]) -> Iterator[Problem]:
    """A warning of very different masses of moving links."""
    if not masses:
        return
    heavy = max(masses, key=lambda name: masses[name])
    light = min(masses, key=lambda name: masses[name])
    if masses[heavy] > _MAX_MASS_RATIO * masses[light]:
        text = f"very different masses, {masses[heavy]:.3g} kg and {masses[light]:.3g} kg"
        yield warning(f"links {heavy} and {light}", text)


def _sizes(root: ET.Element, bodies: Mapping[str, tuple[float, Array]]) -> Iterator[Problem]:
    """Links whose lengths and inertias are in different units."""
    sizes = dict[str, float]()  # largest distance of a joint from the link's frame
    for joint in root.findall("joint"):
        for parent, origin in zip(joint.findall("parent"), joint.findall("origin"), strict=False):
            place = numbers(origin.get("xyz", "0 0 0"), 3)
            if place is not None:
                name = parent.get("link", "")
                sizes[name] = max(sizes.get(name, 0.0), float(np.linalg.norm(place)))
    largest_size = max(sizes.values(), default=0.0)
    for name, (mass, inertia) in bodies.items():
        size = sizes.get(name, 0.0)
        moment = principal_moments(inertia)[2]
        if mass <= 0 or moment <= 0:
            continue
        radius = math.sqrt(moment / mass)  # of gyration
        if not radius:
            continue  # it underflows
        is_too_small = size > _MAX_SIZE_RATIO * radius
        is_too_large = radius > _MAX_SIZE_RATIO * largest_size > 0
        if is_too_small or is_too_large:
            text = f"joints {size:.3g} m apart, but a radius of gyration of {radius:.3g} m; URDF "
            yield warning(f"link {name}", text + "needs m, kg and kg m^2")


def _body(mass: float, inertia: Array, where: str, moves: bool) -> Iterator[Problem]:
    """A problem of the mass and the inertia of a link, also for other tools."""
    if mass < 0:
        return  # `_link` reports it
    reason = impossible(mass, inertia)
    if reason:
        yield warning(where, reason)
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
    """Problems of the file of a mesh, also for other tools."""
    if name.startswith("package://"):
        yield note(where, "meshes by package://: not resolved by MuJoCo; use relative paths")
        package, _, path_in_package = name.removeprefix("package://").partition("/")
        folders = (folder, *folder.resolve().parents)
        paths = [base / package / path_in_package for base in folders]
    else:
        path = name.removeprefix("file://")
        paths = [folder / path]
        if Path(path).is_absolute():
            yield warning(where, f"mesh {name}: an absolute path is valid on one machine only")
    if not any(map(isfile, paths)):  # unlike Path.is_file, it takes names of any length
        text = f"mesh {name or '(no name)'}: not found; the shape is not drawn"
        yield warning(where, text)
    kind = Path(name).suffix.lower()
    if kind in _REFUSED:
        yield note(where, f"meshes {kind}: not read by {_REFUSED[kind]}")
