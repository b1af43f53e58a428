# SPDX-License-Identifier: BSD-2-Clause
"""Whether a motion is one of a robot."""

from __future__ import annotations

from ..errors import InputError
from ..model.mechanism import Mechanism
from .trajectories import Trajectory


def require_motion(motion: Trajectory, robot: Mechanism, name: str = "motion") -> None:
    """Check that an argument is a motion of a robot: its joints, coordinates, motors, units."""
    if not isinstance(motion, Trajectory):
        raise InputError(name, f"a Trajectory is needed, not {type(motion).__name__}")
    for what, names, needed in (
        ("joints", motion.joint_names, robot.space.position_names),
        ("coordinates", motion.coordinates, robot.coordinate_rate_names),
        ("motors", motion.actuated, robot.motor_names),
        ("units of positions", motion.units, robot.space.position_units),
        ("units of rates", motion.rate_units, robot.coordinate_rate_units),
    ):
        if names != tuple(needed):
            raise InputError(
                name,
                f"belongs to another robot, with {what} {', '.join(x or '1' for x in names)}; "
                f"this one has {', '.join(x or '1' for x in needed) or 'none'}",
            )
