# SPDX-License-Identifier: BSD-2-Clause
"""Checks of the shapes of a URDF: their numbers, the files of meshes, other tools."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from os.path import isfile
from pathlib import Path

from .problems import Problem, note, warning
from .urdf_checks import wrong_numbers


def check_shapes(root: ET.Element, folder: Path) -> Iterator[Problem]:
    """Problems of the shapes of a URDF in a folder."""
    meshes: dict[str, str] = {}
    for link in root.findall("link"):
        where = f"link {link.get('name')}"
        for shape in (*link.findall("visual"), *link.findall("collision")):
            # Pinocchio leaves out a shape with a wrong number.
            for part in (shape, *shape.findall("geometry")):
                yield from wrong_numbers(part, where)
        for shape in link.iterfind(".//geometry/*"):
            if shape.tag == "capsule":
                yield note(where, "<capsule>: not drawn by Pinocchio")
            if shape.tag == "mesh":
                meshes.setdefault(shape.get("filename", ""), where)
    for name, where in meshes.items():  # once for each file
        yield from _mesh(name, where, folder)


#: Tools that refuse a kind of file.
_REFUSED = {
    ".stl": "Drake",
    ".dae": "MuJoCo and Drake",
    ".glb": "MuJoCo and PyBullet",
    ".gltf": "MuJoCo and PyBullet",
}


def _mesh(name: str, where: str, folder: Path) -> Iterator[Problem]:
    """Problems of the file of a mesh, also for other tools."""
    if name.startswith("package://"):
        yield note(where, "meshes by package://: not resolved by MuJoCo; use relative paths")
        package, _, path_in_package = name.removeprefix("package://").partition("/")
        folders = (folder, *folder.resolve().parents)
        paths = [base / package / path_in_package for base in folders]
    else:
        if name.startswith("file://"):
            yield note(where, "meshes by file://: not resolved by MuJoCo; use relative paths")
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
