# SPDX-License-Identifier: BSD-2-Clause
"""Checks of mesh files: that they exist, in formats that every tool reads."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from os.path import isfile
from pathlib import Path

from ..reading.problems import Problem, error, numbers, warning

#: Tools that refuse a kind of file.
_REFUSED = {
    ".stl": "Drake",
    ".dae": "MuJoCo and Drake",
    ".glb": "MuJoCo and PyBullet",
    ".gltf": "MuJoCo and PyBullet",
}


#: How many numbers an attribute of a shape has.
_SIZES = {
    "origin": {"xyz": 3, "rpy": 3},
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}


def check(root: ET.Element, folder: Path) -> Iterator[Problem]:
    """Problems of the shapes of a URDF in a folder."""
    told = set()
    for link in root.findall("link"):
        where = f"link {link.get('name')}"
        for shape in (*link.findall("visual"), *link.findall("collision")):
            yield from _sizes(shape, where)
        for shape in link.iterfind(".//geometry/*"):
            if shape.tag == "capsule":
                yield warning(where, "Pinocchio ignores <capsule>")
            name = shape.get("filename", "")
            if shape.tag == "mesh" and name not in told:
                told.add(name)  # once for each file
                yield from _mesh(name, where, folder)


def _sizes(shape: ET.Element, where: str) -> Iterator[Problem]:
    """Attributes that are no numbers, for which Pinocchio drops the shape."""
    for element in (*shape.findall("origin"), *shape.iterfind("geometry/*")):
        for key, count in _SIZES.get(element.tag, {}).items():
            text = element.get(key)
            if text is not None and numbers(text, count) is None:
                what = f"{element.tag} {key}={text!r} of a shape"
                yield error(where, f"{what} is not {count} number(s)")


def _mesh(name: str, where: str, folder: Path) -> Iterator[Problem]:
    if name.startswith("package://"):
        yield warning(
            where, f"mesh {name}: MuJoCo does not support package://; use a relative path"
        )
        package, _, rest = name.removeprefix("package://").partition("/")
        places = [base / package / rest for base in (folder, *folder.resolve().parents)]
    else:
        place = Path(name.removeprefix("file://"))
        places = [folder / place]
        if place.is_absolute():
            yield warning(where, f"mesh {name}: an absolute path is valid on one machine only")
    if not any(map(isfile, places)):  # which takes names of any length
        yield error(where, f"mesh {name or '(no name)'}: not found")
    tools = _REFUSED.get(Path(name).suffix.lower())
    if tools:
        yield warning(where, f"mesh {name}: {tools} cannot read it")
