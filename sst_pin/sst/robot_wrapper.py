# SPDX-License-Identifier: BSD-2-Clause
"""The description as a `pin.RobotWrapper`, in the manner of example_robot_data."""

from __future__ import annotations

from pathlib import Path

import pinocchio as pin

from .. import description
from ..errors import DescriptionError
from ..files import as_path, beside
from ..reading.shapes import UrdfShapes
from ..reading.srdf import check_srdf
from ..reading.text import read_text
from .robot import SST


def load(urdf: str | Path = description.URDF_PATH) -> pin.RobotWrapper:
    """The tree with its geometry and its named configurations.

    Args:
        urdf: The URDF of the package, or of a folder that `sst-pin describe` has written.

    Returns:
        `model` with gravity, and with the poses of the SRDF as `referenceConfigurations`; `q0`,
        the home pose; `visual_model`; `collision_model` with the pairs that can collide.

    Raises:
        DescriptionError: If it is not a URDF of an SST, or a mesh or its SRDF is missing.

    Example:
        >>> wrapper = sst_pin.load()
        >>> wrapper.model.nq
        9
    """
    path = as_path(urdf)
    sst = SST.from_urdf(path, kernels=False)
    model = sst.model
    srdf = beside(path, ".srdf")
    if not srdf.is_file():
        raise DescriptionError(str(srdf), ["the SRDF beside the URDF is missing"])
    check_srdf(srdf, model)
    pin.loadReferenceConfigurations(model, str(srdf), False)
    shapes = UrdfShapes(read_text(path, "URDF"), path.parent)
    visual, collision = (
        shapes(model, kind) for kind in (pin.GeometryType.VISUAL, pin.GeometryType.COLLISION)
    )
    collision.addAllCollisionPairs()
    pin.removeCollisionPairs(model, collision, str(srdf), False)
    robot = pin.RobotWrapper(model, collision, visual)
    robot.q0 = sst.home
    return robot
