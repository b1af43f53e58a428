# SPDX-License-Identifier: BSD-2-Clause
"""What motions need of a robot, which every `ClosedChain` has; whether a motion is a robot's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..chain.backend import States
from ..chain.mechanism import Mechanism
from ..errors import InputError
from .crossings import Crossing
from .trajectories import Trajectory

Array = NDArray[np.float64]


class Robot(Protocol):
    """A robot that moves in time."""

    @property
    def mechanism(self) -> Mechanism:
        """What is computed."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the independent joints."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, each of which bears a body."""

    @property
    def position_names(self) -> tuple[str, ...]:
        """Names of the entries of q."""

    @property
    def motor_names(self) -> tuple[str, ...]:
        """Names of the motors."""

    @property
    def degrees_of_freedom(self) -> int:
        """Number of the coordinates' rates."""

    def joint_rates(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Rates of all joints; raises an error if q is open or singular."""

    def _states(self, sign_width: float) -> States:
        """The state space, the sign of friction smoothed, for motions that start at q."""

    def trajectory(
        self,
        t: ArrayLike,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        tau: ArrayLike | None = None,
        *,
        stopped: str = "",
        crossings: Sequence[Crossing] = (),
    ) -> Trajectory:
        """A motion of this robot as a value."""


def require_motion(motion: Trajectory, robot: Robot, name: str = "motion") -> None:
    """Check that something is a motion of a robot: its joints, coordinates and motors, in order.

    Args:
        motion: What should be one.
        robot: Whose motion it should be.
        name: The argument.

    Raises:
        InputError: When it is none, or another robot's.
    """
    if not isinstance(motion, Trajectory):
        raise InputError(name, f"a Trajectory is needed, not {type(motion).__name__}")
    for what, found, needed in (
        ("joints", motion.joint_names, robot.position_names),
        ("coordinates", motion.coordinates, rates_of_coordinates(robot)[0]),
        ("motors", motion.actuated, robot.motor_names),
    ):
        if found != tuple(needed):
            raise InputError(
                name,
                f"belongs to another robot, with {what} {', '.join(found)}; "
                f"this one has {', '.join(needed) or 'none'}",
            )


def rates_of_coordinates(robot: Robot) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the rates of a robot's coordinates."""
    space = robot.mechanism.space
    rates = space.rates_of(robot.coordinates)
    return tuple(space.rate_names[k] for k in rates), tuple(space.rate_units[k] for k in rates)
