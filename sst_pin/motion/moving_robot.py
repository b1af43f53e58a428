# SPDX-License-Identifier: BSD-2-Clause
"""The interface that `simulate` and `rollout` need; every `ClosedChain` has it."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..chain.backend import States
from .trajectories import Trajectory

Array = NDArray[np.float64]


class Robot(Protocol):
    """A robot that moves in time."""

    @property
    def model(self) -> pin.Model:
        """Its tree."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the independent joints."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Of the joints, each of which bears a body."""

    @property
    def position_names(self) -> tuple[str, ...]:
        """Of the entries of q."""

    @property
    def motor_names(self) -> tuple[str, ...]:
        """Of the motors."""

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
    ) -> Trajectory:
        """A motion of this robot as a value."""
