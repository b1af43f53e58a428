# SPDX-License-Identifier: BSD-2-Clause
"""The files that describe an SST, together."""

from __future__ import annotations

from pathlib import Path

from ..files import Writer, text_writer
from ..parameters import Parameters
from .cuts import cuts_of
from .meshes import mesh_writers
from .mjcf import mjcf_of
from .paths import PACKAGE_PATH
from .readme import readme_of
from .scene import scene_of
from .srdf import srdf_of
from .urdf import urdf_of

#: What no parameter changes.
_CONSTANT = ("LICENSE", "package.xml", "CMakeLists.txt")


def description_writers(p: Parameters) -> dict[str, Writer]:
    """Writers of a description's files but its picture, by name, for `files.write_files`.

    Raises:
        MissingExtraError: Without trimesh.
    """
    texts = {
        "sst.urdf": urdf_of(p),
        "sst.yaml": cuts_of(p),
        "sst.srdf": srdf_of(p),
        "sst.xml": mjcf_of(p),
        "scene.xml": scene_of(p),
        "README.md": readme_of(p),
    }
    shipped = Path(PACKAGE_PATH)
    texts |= {name: (shipped / name).read_text(encoding="utf-8") for name in _CONSTANT}
    return {name: text_writer(text) for name, text in texts.items()} | mesh_writers(p)
