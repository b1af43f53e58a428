# SPDX-License-Identifier: BSD-2-Clause
"""Checks of what links hold: inertias that a body can have, meshes that exist, other tools."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from os.path import isfile
from pathlib import Path

from ..arrays import Array
from .problems import Problem, error, note, warning
from .urdf_checks import impossible, mass_of, no_numbers, principal_moments

#: Heaviest over lightest moving link, beyond which half the digits are gone.
_SPREAD = 1e8
#: Tools that refuse a kind of file.
_REFUSED = {
    ".stl": "Drake",
    ".dae": "MuJoCo and Drake",
    ".glb": "MuJoCo and PyBullet",
    ".gltf": "MuJoCo and PyBullet",
}


def check_inertias(root: ET.Element, without: Collection[str] = ()) -> Iterator[Problem]:
    """Problems of a URDF's inertials, but for some links that need none."""
    masses, moves = dict[str, float](), dict[str, bool]()
    for joint in root.findall("joint"):
        for child in joint.findall("child"):
            moves[child.get("link", "")] = joint.get("type") != "fixed"
    for link in root.findall("link"):
        name, inertial = link.get("name", ""), link.find("inertial")
        where = f"link {name}"
        if inertial is not None:
            body = mass_of(inertial)  # a missing number is told by the reader's checks
            if body is not None and body[0] >= 0:
                yield from _body(*body, where, moves.get(name, False))
                if moves.get(name) and body[0]:
                    masses[name] = body[0]
        elif name in without:
            continue
        elif moves.get(name):
            yield note(where, "moves without <inertial>: 1 kg in PyBullet, refused by MuJoCo")
        elif name in moves:
            text = "1 kg in PyBullet; add an <inertial> of zeros"
            yield note(where, f"fixed link without <inertial>: {text}")
    heavy, light = (end(masses, key=lambda n: masses[n], default="") for end in (max, min))
    if masses and masses[heavy] > _SPREAD * masses[light]:
        text = f"very different masses, {masses[heavy]:.3g} kg and {masses[light]:.3g} kg"
        yield warning(f"links {heavy} and {light}", text)


def _body(mass: float, inertia: Array, where: str, moves: bool) -> Iterator[Problem]:
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
        yield error(where, f"mesh {name or '(no name)'}: not found")
    kind = Path(name).suffix.lower()
    if tools := _REFUSED.get(kind):
        yield note(where, f"meshes {kind}: not read by {tools}")
