# SPDX-License-Identifier: BSD-2-Clause
"""The files that describe an SST, together."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..arrays import Array
from ..files import Writer, text_writer
from .beside_urdf import srdf_of, yaml_of
from .meshes import mesh_writers
from .mjcf_writer import mjcf_of
from .parameters import Parameters
from .paths import PACKAGE_PATH
from .readme import readme_of
from .scene import scene_of
from .urdf_writer import urdf_of

#: Files that no parameter changes.
_CONSTANT = ("LICENSE", "package.xml", "CMakeLists.txt")


def description_writers(p: Parameters, configurations: Mapping[str, Array]) -> dict[str, Writer]:
    """Writers of a description's files but its picture, by name, for `files.write_files`.

    `configurations` are joint coordinates by name, shape (9,).
    """
    texts = {
        "sst.urdf": urdf_of(p),
        "sst.yaml": yaml_of(p),
        "sst.srdf": srdf_of(configurations),
        "sst.xml": mjcf_of(p, configurations),
        "scene.xml": scene_of(p),
        "README.md": readme_of(p),
    }
    shipped = Path(PACKAGE_PATH)
    texts |= {name: (shipped / name).read_text(encoding="utf-8") for name in _CONSTANT}
    return {name: text_writer(text) for name, text in texts.items()} | mesh_writers(p)
