# SPDX-License-Identifier: BSD-2-Clause
"""The shapes of a robot's bodies, as Pinocchio's geometry models."""

from __future__ import annotations

from pathlib import Path

import pinocchio as pin

from .errors import DescriptionError


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
