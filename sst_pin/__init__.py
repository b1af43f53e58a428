# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of closed-chain robots on Pinocchio by the natural orthogonal complement."""

from .closed_chain import ClosedChain
from .closures import Closure
from .description import PACKAGE_PATH, URDF_PATH, YAML_PATH
from .kinematics import BRANCHES
from .parameters import Parameters, RigidBody
from .sst import SST
from .platform_motion import PlatformMotion, orientation, paper_circle
from .trajectories import Trajectory
