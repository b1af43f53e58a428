# SPDX-License-Identifier: BSD-2-Clause
"""Controllers, observers, serial views, fastest motions, cables, what a pose can do, reach."""

from .cables import unstretched_lengths
from .controllers import ComputedTorque, GravityPD, TrackingLQR
from .force_observer import ForceObserver
from .pose_abilities import (
    Ellipsoid,
    acceleration_ellipsoid,
    acceleration_polytope,
    force_ellipsoid,
    force_polytope,
)
from .reach import ReachMap, reach_map
from .serial_view import SerialView
from .timing import time_optimal

__all__ = [
    "ComputedTorque",
    "Ellipsoid",
    "ForceObserver",
    "GravityPD",
    "ReachMap",
    "SerialView",
    "TrackingLQR",
    "acceleration_ellipsoid",
    "acceleration_polytope",
    "force_ellipsoid",
    "force_polytope",
    "reach_map",
    "time_optimal",
    "unstretched_lengths",
]


def __dir__() -> list[str]:
    return __all__
