# SPDX-License-Identifier: BSD-2-Clause
# The public names. `__init__.py` reads this list, and so do editors and type checkers.

# Rooms
from . import control as control
from . import design as design
from . import errors as errors
from . import identification as identification
from . import plots as plots
from . import robots as robots
from . import sst as sst
from . import viewer as viewer

# Robots and what closes and drives them
from .closed_chain import ClosedChain as ClosedChain
from .model.closures import Brake as Brake
from .model.closures import Closure as Closure
from .model.closures import Coupling as Coupling
from .model.closures import Distance as Distance
from .model.closures import Rolling as Rolling
from .model.contacts import Contact as Contact
from .model.contacts import Rope as Rope
from .model.lines import LineForce as LineForce

# The SST; its other names are in `sst`
from .description.folder import URDF_PATH as URDF_PATH
from .description.parameters import Parameters as Parameters
from .sst.robot import SST as SST
from .sst.robot_wrapper import load as load

# Files of robots
from .compiled.export import write_c as write_c
from .description.loop_closures_writer import write_loop_closures as write_loop_closures
from .description.mjcf_writer import write_mjcf as write_mjcf
from .reading.validate import Problem as Problem
from .reading.validate import validate as validate

# Results of the dynamics
from .dynamics.dynamics import ReducedTerms as ReducedTerms
from .dynamics.reactions import Reactions as Reactions
from .dynamics.regressor import DynamicParameters as DynamicParameters

# Motions
from .simulation.bearing_loads import Loads as Loads
from .simulation.coordinate_motions import coordinate_motion as coordinate_motion
from .simulation.crossings import Crossing as Crossing
from .simulation.energy import energy_error as energy_error
from .simulation.frame_motions import frame_motion as frame_motion
from .simulation.nonsmooth_rollout import NonsmoothRollout as NonsmoothRollout
from .simulation.rollouts import Rollout as Rollout
from .simulation.sampled_torques import SampledTorque as SampledTorque
from .simulation.trajectories import Trajectory as Trajectory
from .sst.platform_motion import paper_circle as paper_circle

# Control
from .control.controllers import ComputedTorque as ComputedTorque
from .control.controllers import GravityPD as GravityPD
from .control.controllers import TrackingLQR as TrackingLQR
from .control.pose_abilities import Ellipsoid as Ellipsoid
from .control.pose_abilities import acceleration_ellipsoid as acceleration_ellipsoid
from .control.pose_abilities import acceleration_polytope as acceleration_polytope
from .control.pose_abilities import force_ellipsoid as force_ellipsoid
from .control.pose_abilities import force_polytope as force_polytope
from .control.reach import ReachMap as ReachMap
from .control.reach import reach_map as reach_map
from .control.serial_view import SerialView as SerialView
from .control.timing import time_optimal as time_optimal

# Errors and warnings
from .errors import ActuationError as ActuationError
from .errors import ClosureError as ClosureError
from .errors import CompilationError as CompilationError
from .errors import DescriptionError as DescriptionError
from .errors import DescriptionWarning as DescriptionWarning
from .errors import FileFormatError as FileFormatError
from .errors import IndeterminateError as IndeterminateError
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
from .version import __version__ as __version__
