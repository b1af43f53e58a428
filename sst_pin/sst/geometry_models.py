# SPDX-License-Identifier: BSD-2-Clause
"""The shapes of a robot's bodies, as Pinocchio's geometry models."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import pinocchio as pin

from ..description import mesh_writers
from ..description.parameters import Parameters
from ..errors import DescriptionError
from ..files import write_files


class Shapes(NamedTuple):
    """Where the shapes of an SST come from.

    Attributes:
        urdf: The XML that names them.
        meshes: Folder that their files are relative to, or the parameters to make them of.
    """

    urdf: str
    meshes: Path | Parameters

    @contextmanager
    def geometry_model(
        self, model: pin.Model, kind: pin.GeometryType = pin.GeometryType.VISUAL
    ) -> Iterator[pin.GeometryModel]:
        """Shapes for the eye, or for collisions; mesh files are there as long as the block lasts.

        Args:
            model: The tree of the same URDF.
            kind: VISUAL or COLLISION.

        Raises:
            DescriptionError: When a mesh cannot be loaded.
            MissingExtraError: When meshes must be made, without trimesh.
        """
        if isinstance(self.meshes, Parameters):
            with TemporaryDirectory() as name:
                folder = Path(name)
                files = mesh_writers(self.meshes)
                write_files({folder / file: write for file, write in files.items()})
                yield geometry_model(model, self.urdf, folder, kind)
        else:
            yield geometry_model(model, self.urdf, self.meshes, kind)


def geometry_model(
    model: pin.Model, urdf: str, folder: Path, kind: pin.GeometryType
) -> pin.GeometryModel:
    """Shapes of a URDF.

    Args:
        model: Its tree.
        urdf: Its XML.
        folder: What its mesh files are relative to.
        kind: VISUAL or COLLISION.

    Raises:
        DescriptionError: When a mesh cannot be loaded.
    """
    try:
        return pin.buildGeomFromUrdfString(model, urdf, kind, package_dirs=[str(folder)])
    except (ValueError, RuntimeError) as error:
        raise DescriptionError(str(folder), [f"its geometry cannot be loaded: {error}"]) from None
