# SPDX-License-Identifier: BSD-2-Clause
"""What the viewer asks of an SST beyond what every closed chain has."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..motion.trajectories import Trajectory
from ..sst.check import Finding
from ..sst.kinematics import Geometry

Array = NDArray[np.float64]


@runtime_checkable
class Star(Protocol):
    """A robot with a star on three arcs: the SST, by its own names."""

    @property
    def geometry(self) -> Geometry:
        """Of its tree."""

    @property
    def home(self) -> Array:
        """Where it is shown first, shape (9,)."""

    @property
    def star_radius(self) -> float:
        """Distance OE, [m]."""

    @property
    def shapes(self) -> Any:
        """Of its bodies."""

    def platform_orientation(self, q: ArrayLike) -> Array:
        """Of the star in the base, shape (..., 3, 3)."""

    def check(self, motion: Trajectory) -> tuple[Finding, ...]:
        """Where the machine cannot follow a motion."""
