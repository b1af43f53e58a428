# SPDX-License-Identifier: BSD-2-Clause
"""The SST: its robot, kinematics, parameters and files, its motions, the paper's examples."""

from ..description.folder import (
    MJCF_PATH,
    PACKAGE_PATH,
    REPOSITORY_PATH,
    SRDF_PATH,
    URDF_PATH,
    YAML_PATH,
)
from ..description.parameters import Parameters, RigidBody
from .kinematics import BRANCHES
from .platform_motion import (
    PlatformMotion,
    interpolate_orientations,
    orientation,
    orientation_motion,
    orientation_path,
    paper_circle,
)
from .robot import SST
from .robot_wrapper import load

__all__ = [
    "BRANCHES",
    "MJCF_PATH",
    "PACKAGE_PATH",
    "REPOSITORY_PATH",
    "SRDF_PATH",
    "SST",
    "URDF_PATH",
    "YAML_PATH",
    "Parameters",
    "PlatformMotion",
    "RigidBody",
    "interpolate_orientations",
    "load",
    "orientation",
    "orientation_motion",
    "orientation_path",
    "paper_circle",
]


def __dir__() -> list[str]:
    return __all__
