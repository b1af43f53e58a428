# SPDX-License-Identifier: BSD-2-Clause
"""The description as a `pin.RobotWrapper`, in the manner of example_robot_data."""

from pathlib import Path

import pinocchio as pin

from .. import description
from ..errors import DescriptionError
from ..files import as_path, beside
from ..reading import read_urdf
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
    found = read_urdf(path, default=description.YAML_PATH)
    sst = SST._of_file(found, kernels=False)
    model, srdf = sst.model, found.srdf
    if srdf is None:
        raise DescriptionError(str(beside(path, ".srdf")), ["the SRDF beside the URDF is missing"])
    visual, collision = (
        found.shapes(model, kind) for kind in (pin.GeometryType.VISUAL, pin.GeometryType.COLLISION)
    )
    collision.addAllCollisionPairs()
    srdf.remove_pairs(model, collision)
    robot = pin.RobotWrapper(model, collision, visual)
    robot.q0 = sst.home
    return robot
