# SPDX-License-Identifier: BSD-2-Clause
"""Loads an MJCF by MuJoCo's compiler, if need be without the shapes whose files are missing."""

import xml.etree.ElementTree as ET
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import DescriptionError, MissingExtraError
from ..summaries import listed

#: First bytes of a file that Git LFS has not fetched.
_POINTER = b"version https://git-lfs"


class LoadedMjcf(NamedTuple):
    """An MJCF in MuJoCo."""

    mujoco: Any  #: The module.
    mj: Any  #: The `mujoco.MjModel`.
    notes: list[str]  #: What was left out.


def load_mjcf(path: Path) -> LoadedMjcf:
    """Compile an MJCF; a DescriptionError has MuJoCo's message if it is refused."""
    try:
        import mujoco
    except ImportError:
        raise MissingExtraError("mujoco", "mjcf") from None
    source = str(path)
    first = _first_element(path)
    if first not in ("", "mujoco"):  # MuJoCo reads a URDF, which has no closures
        text = f"an MJCF starts with <mujoco>, not with <{first}>"
        cure = "; ClosedChain.from_urdf reads a URDF or an SDF"
        raise DescriptionError(source, [f"not an MJCF: {text}{cure}"])
    try:
        loaded = LoadedMjcf(mujoco, mujoco.MjModel.from_xml_path(source), [])
    except ValueError as error:
        loaded = _load_without_missing_files(mujoco, path, str(error))
    try:
        loaded.mj.names.decode()
    except UnicodeDecodeError as error:
        raise DescriptionError(source, [f"names that are not UTF-8: {error}"]) from None
    return loaded


def _first_element(path: Path) -> str:
    """The name of an XML's root; empty if Python cannot read the file."""
    with suppress(ET.ParseError, OSError, ValueError), path.open("rb") as file:
        for _, element in ET.iterparse(file, events=("start",)):
            return str(element.tag)
    return ""


def _load_without_missing_files(mujoco: Any, path: Path, error: str) -> LoadedMjcf:
    """The model without meshes and textures whose files are missing.

    If no file is missing, or a body has its mass from such a mesh, the MJCF is refused. `error` is
    MuJoCo's message on the whole MJCF.
    """
    source = str(path)
    refused = DescriptionError(source, [f"MuJoCo refuses it: {error}"])
    try:
        spec = mujoco.MjSpec.from_file(source)
    except (AttributeError, ValueError):  # an old MuJoCo, or another fault
        raise refused from None
    meshes = _delete_missing_meshes(spec, path.parent)
    textures = _delete_missing_textures(spec, path.parent)
    if not meshes and not textures:
        raise refused
    always_from_shapes = (
        spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    )
    problems = _delete_shapes(spec, meshes, always_from_shapes)
    if problems:
        raise DescriptionError(source, problems)
    try:
        mj = spec.compile()
    except ValueError as other:
        raise DescriptionError(source, [f"MuJoCo refuses it: {other}"]) from None
    files = listed(sorted(meshes | textures))
    note = f"files of {files} are missing; the robot is read without these shapes"
    return LoadedMjcf(mujoco, mj, [note])


def _delete_missing_meshes(spec: Any, folder: Path) -> set[str]:
    """Delete meshes whose files are missing; returns their names."""
    names = set[str]()
    for mesh in list(spec.meshes):
        if _is_missing(folder / spec.meshdir, mesh):
            names.add(mesh.name or Path(mesh.file).stem)
            spec.delete(mesh)
    return names


def _delete_missing_textures(spec: Any, folder: Path) -> set[str]:
    """Delete textures whose files are missing, also from materials; returns their names."""
    missing = [t for t in spec.textures if _is_missing(folder / spec.texturedir, t)]
    names = {texture.name or Path(texture.file).stem for texture in missing}
    for material in list(spec.materials):
        material.textures = ["" if name in names else name for name in material.textures]
    for texture in missing:
        spec.delete(texture)
    return names


def _delete_shapes(spec: Any, meshes: Collection[str], always_from_shapes: bool) -> list[str]:
    """Delete the shapes of some meshes; returns problems of bodies that have their mass from one.

    `always_from_shapes` says that bodies have their masses from shapes, even with an `<inertial>`.
    """
    problems = list[str]()
    for body in spec.bodies:
        for geom in [geom for geom in body.geoms if geom.meshname in meshes]:
            if body.name != "world" and (always_from_shapes or not body.explicitinertial):
                text = f"its mass is that of the mesh {geom.meshname}, whose file is missing"
                problems.append(f"body {body.name}: {text}")
            spec.delete(geom)
    return list(dict.fromkeys(problems))


def _is_missing(folder: Path, asset: Any) -> bool:
    """Whether the file of a mesh or a texture is missing, or a pointer of Git LFS to it."""
    if not asset.file:
        return False
    path = folder / asset.file
    if not path.is_file():
        return True
    with path.open("rb") as file:
        return file.read(len(_POINTER)) == _POINTER
