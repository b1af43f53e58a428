# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of closed-chain robots on Pinocchio by the natural orthogonal complement."""

from .closed_chain import ClosedChain
from .closures import Closure
from .description import (
    MJCF_PATH,
    PACKAGE_PATH,
    REPOSITORY_PATH,
    SRDF_PATH,
    URDF_PATH,
    YAML_PATH,
)
from .dynamics import ReducedTerms
from .energy import energy_error
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
from .kinematics import BRANCHES
from .parameters import Parameters, RigidBody
from .platform_motion import (
    PlatformMotion,
    interpolate_orientations,
    orientation,
    orientation_motion,
    paper_circle,
)
from .robot_wrapper import load
from .rollouts import Rollout
from .sst import SST
from .trajectories import Trajectory
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
