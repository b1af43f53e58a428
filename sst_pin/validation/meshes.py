# SPDX-License-Identifier: BSD-2-Clause
"""Meshes that are there, in forms that every tool reads."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from .problems import Problem, error, warning

#: What refuses a kind of file.
_REFUSED = {
    ".stl": "Drake",
    ".dae": "MuJoCo and Drake",
    ".glb": "MuJoCo and PyBullet",
    ".gltf": "MuJoCo and PyBullet",
}


def check(root: ET.Element, folder: Path) -> Iterator[Problem]:
    """Problems of a URDF's shapes.

    Args:
        root: The URDF.
        folder: Where it lies.
    """
    told = set()
    for link in root.findall("link"):
        where = f"link {link.get('name')}"
        for shape in link.iterfind(".//geometry/*"):
            if shape.tag == "capsule":
                yield warning(where, "a <capsule>: Pinocchio drops it")
            name = shape.get("filename", "")
            if shape.tag == "mesh" and name not in told:
                told.add(name)  # once for each file
                yield from _mesh(name, where, folder)


def _mesh(name: str, where: str, folder: Path) -> Iterator[Problem]:
    if name.startswith("package://"):
        yield warning(where, f"mesh {name}: MuJoCo does not know package://; write a relative path")
        package, _, rest = name.removeprefix("package://").partition("/")
        places = [base / package / rest for base in (folder, *folder.resolve().parents)]
    else:
        places = [folder / name.removeprefix("file://")]
        if places[0] == Path(name.removeprefix("file://")):
            yield warning(where, f"mesh {name}: an absolute path, of one machine only")
    if not any(place.is_file() for place in places):
        yield error(where, f"mesh {name or '(no name)'}: not found")
    tools = _REFUSED.get(Path(name).suffix.lower())
    if tools:
        yield warning(where, f"mesh {name}: {tools} cannot read it")
