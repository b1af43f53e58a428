# SPDX-License-Identifier: BSD-2-Clause
"""The files that describe an SST, together."""

from __future__ import annotations

from ..files import Writer, text_writer
from ..parameters import Parameters
from .cuts import cuts_of
from .meshes import mesh_writers
from .mjcf import mjcf_of, scene_of
from .urdf import urdf_of


def description_writers(p: Parameters) -> dict[str, Writer]:
    """Writers of URDF, cuts and meshes, by the file's name in a folder, for `files.write_files`.

    Raises:
        MissingExtraError: Without trimesh.
    """

    texts = {
        "sst.urdf": urdf_of(p),
        "sst.yaml": cuts_of(p),
        "sst.xml": mjcf_of(p),
        "scene.xml": scene_of(),
    }
    return {name: text_writer(text) for name, text in texts.items()} | mesh_writers(p)
