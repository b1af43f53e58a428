# SPDX-License-Identifier: BSD-2-Clause
"""From `Parameters` to the files that describe the robot.

The robot is a tree of three legs; the cuts close it. The star is cut into its three arcs: leg k
ends in `star_k`, which carries a third of the star's mass and inertia about the star's mass centre,
so that the three make up body 7 when the closures hold and no moving link is massless.
"""

from .folder import (
    MJCF_PATH,
    PACKAGE_PATH,
    REPOSITORY_PATH,
    SRDF_PATH,
    URDF_PATH,
    YAML_PATH,
    description_writers,
    srdf_of,
    yaml_of,
)
from .frames import JOINT_NAMES, MOTOR_NAMES, base_orientations, star_orientations
from .mjcf_writer import mjcf_of
from .parts import mesh_writers, meshes_of
from .urdf_writer import urdf_of

__all__ = [
    "JOINT_NAMES",
    "MJCF_PATH",
    "MOTOR_NAMES",
    "PACKAGE_PATH",
    "REPOSITORY_PATH",
    "SRDF_PATH",
    "URDF_PATH",
    "YAML_PATH",
    "base_orientations",
    "description_writers",
    "mesh_writers",
    "meshes_of",
    "mjcf_of",
    "srdf_of",
    "star_orientations",
    "urdf_of",
    "yaml_of",
]
