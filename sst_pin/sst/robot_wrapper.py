# SPDX-License-Identifier: BSD-2-Clause
"""The description as a `pin.RobotWrapper`, as example_robot_data has them; its named poses."""

from pathlib import Path

import pinocchio as pin

from ..arrays import Array
from ..description.folder import URDF_PATH, YAML_PATH
from ..description.frames import base_orientations, star_orientations
from ..description.parameters import Parameters
from ..errors import DescriptionError, SingularConfigurationError
from ..files import as_path
from ..reading import read_urdf
from . import kinematics
from .platform_motion import paper_circle
from .robot import SST


def load(urdf: str | Path = URDF_PATH) -> pin.RobotWrapper:
    """Load the open tree of an SST, the paper's by default, for code on `pin.RobotWrapper`.

    Its loops are not closed; `ClosedChain.from_urdf` loads any robot with its loops.

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
    found = read_urdf(path, default=YAML_PATH)
    sst = SST.from_description(found)
    model, srdf = sst.model, found.srdf
    if srdf is None:
        raise DescriptionError(
            str(path.with_suffix(".srdf")), ["the SRDF beside the URDF is missing"]
        )
    visual, collision = (
        found.shapes(model, kind) for kind in (pin.GeometryType.VISUAL, pin.GeometryType.COLLISION)
    )
    collision.addAllCollisionPairs()
    srdf.remove_pairs(model, collision)
    robot = pin.RobotWrapper(model, collision, visual)
    robot.q0 = sst.home
    return robot


def configurations_of(parameters: Parameters) -> dict[str, Array]:
    """Joint coordinates, shape (9,), of `SST.home` and of the start of the paper's circle, by name.

    A pose in which a leg would lie flat on its arc is left out.
    """
    geometry = kinematics.Geometry(base_orientations(parameters), star_orientations(parameters))
    poses = {"home": kinematics.home_orientation(geometry), "circle_start": paper_circle(0.0).R}
    found = {}
    for name, R in poses.items():
        try:
            legs = kinematics.legs_of_orientation(geometry, R, (1, 1, 1))
        except SingularConfigurationError:
            continue
        # The last bit of an arctangent is the machine's own; files shall be the same everywhere.
        found[name] = kinematics.joints_of_legs(geometry, legs).round(14)
    return found
