# SPDX-License-Identifier: BSD-2-Clause
"""The shapes of an SST that no file describes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import pinocchio as pin

from ..description import mesh_writers
from ..description.parameters import Parameters
from ..files import write_files
from ..reading.shapes import UrdfShapes


@dataclass(frozen=True)
class ParameterShapes:
    """The shapes of a URDF whose meshes are made of its parameters."""

    root: ET.Element
    parameters: Parameters

    def __call__(self, model: pin.Model) -> pin.GeometryModel:
        """Shapes for the eye, for the tree of the same URDF."""
        with TemporaryDirectory() as name:
            folder = Path(name)
            files = mesh_writers(self.parameters)
            write_files({folder / n: write for n, write in files.items()}, folder=folder)
            return UrdfShapes(self.root, folder)(model)
