# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of closed-chain robots on Pinocchio by the natural orthogonal complement.

Public names are loaded at their first use.
"""

from importlib import import_module
from importlib.util import find_spec

from .version import __version__ as __version__

TYPE_CHECKING = False  # except for type checkers; importing `typing` takes time

if TYPE_CHECKING:
    from . import plots as plots
    from . import robots as robots
    from . import viewer as viewer
    from .chain.closed_chain import ClosedChain as ClosedChain
    from .chain.closures import Closure as Closure
    from .chain.closures import Coupling as Coupling
    from .chain.closures import Distance as Distance
    from .chain.closures import Rolling as Rolling
    from .chain.dynamics import ReducedTerms as ReducedTerms
    from .description import MJCF_PATH as MJCF_PATH
    from .description import PACKAGE_PATH as PACKAGE_PATH
    from .description import REPOSITORY_PATH as REPOSITORY_PATH
    from .description import SRDF_PATH as SRDF_PATH
    from .description import URDF_PATH as URDF_PATH
    from .description import YAML_PATH as YAML_PATH
    from .description.parameters import Parameters as Parameters
    from .description.parameters import RigidBody as RigidBody
    from .errors import ActuationError as ActuationError
    from .errors import AssignmentError as AssignmentError
    from .errors import ClosureError as ClosureError
    from .errors import DescriptionError as DescriptionError
    from .errors import DescriptionWarning as DescriptionWarning
    from .errors import FileFormatError as FileFormatError
    from .errors import InputError as InputError
    from .errors import MissingExtraError as MissingExtraError
    from .errors import OutputError as OutputError
    from .errors import ParametersError as ParametersError
    from .errors import SimulationError as SimulationError
    from .errors import SingularConfigurationError as SingularConfigurationError
    from .errors import SingularityWarning as SingularityWarning
    from .errors import SSTError as SSTError
    from .errors import UnknownNameError as UnknownNameError
    from .errors import WorkspaceError as WorkspaceError
    from .motion.coordinate_motions import coordinate_motion as coordinate_motion
    from .motion.energy import energy_error as energy_error
    from .motion.rollouts import Rollout as Rollout
    from .motion.trajectories import Trajectory as Trajectory
    from .sst.kinematics import BRANCHES as BRANCHES
    from .sst.platform_motion import PlatformMotion as PlatformMotion
    from .sst.platform_motion import interpolate_orientations as interpolate_orientations
    from .sst.platform_motion import orientation as orientation
    from .sst.platform_motion import orientation_motion as orientation_motion
    from .sst.platform_motion import paper_circle as paper_circle
    from .sst.robot import SST as SST
    from .sst.robot_wrapper import load as load
    from .validation import Problem as Problem
    from .validation import validate as validate

#: Public names of each module.
_NAMES = {
    "chain.closed_chain": "ClosedChain",
    "chain.closures": "Closure Coupling Distance Rolling",
    "chain.dynamics": "ReducedTerms",
    "description": "MJCF_PATH PACKAGE_PATH REPOSITORY_PATH SRDF_PATH URDF_PATH YAML_PATH",
    "description.parameters": "Parameters RigidBody",
    "errors": (
        "ActuationError AssignmentError ClosureError DescriptionError DescriptionWarning "
        "FileFormatError "
        "InputError MissingExtraError OutputError ParametersError SimulationError "
        "SingularConfigurationError SingularityWarning SSTError UnknownNameError "
        "WorkspaceError"
    ),
    "motion.coordinate_motions": "coordinate_motion",
    "motion.energy": "energy_error",
    "motion.rollouts": "Rollout",
    "motion.trajectories": "Trajectory",
    "sst.kinematics": "BRANCHES",
    "sst.platform_motion": (
        "PlatformMotion interpolate_orientations orientation orientation_motion paper_circle"
    ),
    "sst.robot": "SST",
    "sst.robot_wrapper": "load",
    "validation": "Problem validate",
}
#: Rooms that need an extra, and a package that it brings.
_OPTIONAL = {"plots": "matplotlib", "viewer": "meshcat"}
_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = sorted([*_MODULES, "robots"])  # noqa: PLE0605


if not TYPE_CHECKING:

    def __getattr__(name):
        """A public name, or a room of the package, when it is first asked for."""
        if name in _MODULES:
            value = getattr(import_module(f".{_MODULES[name]}", __name__), name)
        elif name.startswith("_"):
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        else:
            try:
                value = import_module(f".{name}", __name__)
            except ModuleNotFoundError as error:
                if error.name != f"{__name__}.{name}":
                    raise
                raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    there = (room for room, package in _OPTIONAL.items() if find_spec(package))
    return sorted([*__all__, "__version__", *there])
