# SPDX-License-Identifier: BSD-2-Clause
"""An SST as a `pin.RobotWrapper`, as in example_robot_data, and its named configurations."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..description.folder import URDF_PATH, YAML_PATH
from ..description.parameters import Parameters
from ..errors import DescriptionError, SingularConfigurationError, WorkspaceError
from ..files import as_path
from ..reading import read_urdf
from .platform_motion import paper_circle
from .robot import SST


def load(urdf: str | Path = URDF_PATH) -> pin.RobotWrapper:
    """Load the open tree of an SST, by default the paper's, as a `pin.RobotWrapper`.

    It has no closures; `ClosedChain.from_urdf` loads any robot with its closures.

    Args:
        urdf: The URDF of the package, or of a folder that `sst-pin describe` has written.

    Returns:
        `model` with gravity, and with the poses of the SRDF as `referenceConfigurations`; `q0`,
        the home pose; `visual_model`; `collision_model` with the pairs that can collide.

    Raises:
        DescriptionError: If it is not a URDF of an SST, or a mesh or its SRDF is missing.
    """
    path = as_path(urdf)
    description = read_urdf(path, default=YAML_PATH)
    sst = SST.from_description(description)
    model = sst.model
    srdf = description.srdf
    if srdf is None:
        raise DescriptionError(
            str(path.with_suffix(".srdf")), ["the SRDF beside the URDF is missing"]
        )
    kinds = pin.GeometryType.VISUAL, pin.GeometryType.COLLISION
    visual, collision = (description.shapes(model, kind) for kind in kinds)
    collision.addAllCollisionPairs()
    srdf.remove_pairs(model, collision)
    robot = pin.RobotWrapper(model, collision, visual)
    robot.q0 = sst.home
    return robot


def configurations_of(parameters: Parameters) -> dict[str, Array]:
    """Joint angles, shape (9,), of `SST.home` and of the start of the paper's circle, by name.

    Poses out of reach, or with a leg in the plane of its arc, are left out.
    """
    robot = SST(parameters)
    configurations = dict[str, Array]()
    poses = robot.model.referenceConfigurations
    if "home" in poses:
        configurations["home"] = np.array(poses["home"])
    with suppress(SingularConfigurationError, WorkspaceError):
        configurations["circle_start"] = robot.inverse_kinematics(paper_circle(0.0).R)
    # The last bit of an arctangent depends on the machine; files are the same everywhere.
    return {name: q.round(14) for name, q in configurations.items()}
