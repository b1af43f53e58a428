# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of closed-chain robots on Pinocchio by the natural orthogonal complement."""

from .chain.closed_chain import ClosedChain
from .chain.closures import Closure
from .chain.dynamics import ReducedTerms
from .description import MJCF_PATH, PACKAGE_PATH, REPOSITORY_PATH, SRDF_PATH, URDF_PATH, YAML_PATH
from .description.parameters import Parameters, RigidBody
from .errors import (
    ActuationError,
    ClosureError,
    DescriptionError,
    DescriptionWarning,
    FileFormatError,
    InputError,
    MissingExtraError,
    OutputError,
    ParametersError,
    SimulationError,
    SingularConfigurationError,
    SingularityWarning,
    SSTError,
    UnknownNameError,
    WorkspaceError,
)
from .motion.energy import energy_error
from .motion.rollouts import Rollout
from .motion.trajectories import Trajectory
from .sst.kinematics import BRANCHES
from .sst.platform_motion import (
    PlatformMotion,
    interpolate_orientations,
    orientation,
    orientation_motion,
    paper_circle,
)
from .sst.robot import SST
from .sst.robot_wrapper import load
from .validation import Problem, validate

__all__ = [
    "BRANCHES",
    "MJCF_PATH",
    "PACKAGE_PATH",
    "REPOSITORY_PATH",
    "SRDF_PATH",
    "SST",
    "URDF_PATH",
    "YAML_PATH",
    "ActuationError",
    "ClosedChain",
    "Closure",
    "ClosureError",
    "DescriptionError",
    "DescriptionWarning",
    "FileFormatError",
    "InputError",
    "MissingExtraError",
    "OutputError",
    "Parameters",
    "ParametersError",
    "PlatformMotion",
    "Problem",
    "ReducedTerms",
    "RigidBody",
    "Rollout",
    "SSTError",
    "SimulationError",
    "SingularConfigurationError",
    "SingularityWarning",
    "Trajectory",
    "UnknownNameError",
    "WorkspaceError",
    "energy_error",
    "interpolate_orientations",
    "load",
    "orientation",
    "orientation_motion",
    "paper_circle",
    "validate",
]
