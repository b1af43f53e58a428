# SPDX-License-Identifier: BSD-2-Clause
"""Controllers, serial views, time-optimal motions, forces and accelerations in a pose, reach."""

from .controllers import Adaptive, ComputedTorque, GravityPD, TrackingLQR
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
    "Adaptive",
    "ComputedTorque",
    "Ellipsoid",
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
]


def __dir__() -> list[str]:
    return __all__
