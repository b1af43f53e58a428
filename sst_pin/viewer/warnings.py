# SPDX-License-Identifier: BSD-2-Clause
"""Warnings of what a machine could not execute."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arrays import Array
from ..chain.closed_chain import ClosedChain
from ..chain.thresholds import CLOSURE_TOLERANCE
from ..motion.limits import samples_of
from ..motion.trajectories import Trajectory


def warnings_of(robot: ClosedChain, shown: Trajectory | Array) -> list[str]:
    """One line each: open loops, then what `robot.check` finds in a motion or a configuration."""
    t, q = samples_of(robot, shown)
    return [*_open(robot, t, q), *map(str, robot.check(shown))]


def _open(robot: ClosedChain, t: Array, q: Array) -> Iterator[str]:
    residuals = np.abs(robot.residual(q)).max(axis=1, initial=0.0)
    worst = int(residuals.argmax())
    if residuals[worst] > CLOSURE_TOLERANCE:
        when = "" if np.isnan(t[worst]) else f" at t = {t[worst]:.6g} s"
        yield f"the loops are open by {residuals[worst]:.3g} (m or rad){when}"
