# SPDX-License-Identifier: BSD-2-Clause
"""Whether a motion is one of a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..errors import InputError
from .trajectories import Trajectory

if TYPE_CHECKING:
    from ..closed_chain import ClosedChain


def require_motion(motion: Trajectory, robot: ClosedChain, name: str = "motion") -> None:
    """Check that an argument is a motion of a robot: its joints, coordinates, motors, units."""
    if not isinstance(motion, Trajectory):
        raise InputError(name, f"a Trajectory is needed, not {type(motion).__name__}")
    for what, found, needed in (
        ("joints", motion.joint_names, robot.position_names),
        ("coordinates", motion.coordinates, robot.mechanism.coordinate_rate_names),
        ("motors", motion.actuated, robot.motor_names),
        ("units of positions", motion.units, robot.joint_units),
        ("units of rates", motion.rate_units, robot.mechanism.coordinate_rate_units),
    ):
        if found != tuple(needed):
            raise InputError(
                name,
                f"belongs to another robot, with {what} {', '.join(x or '1' for x in found)}; "
                f"this one has {', '.join(x or '1' for x in needed) or 'none'}",
            )
