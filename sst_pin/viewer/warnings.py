# SPDX-License-Identifier: BSD-2-Clause
"""What a machine could not take of what is shown."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..chain.closed_chain import ClosedChain
from ..chain.loops import CLOSURE_TOLERANCE
from ..motion.limits import beyond_limits
from ..sst.check import findings
from ..sst.robot import SST

Array = NDArray[np.float64]


def warnings_of(robot: ClosedChain, t: Array | None, q: Array) -> list[str]:
    """One line each: open loops, joints beyond their limits; of an SST all that `check` finds.

    Args:
        robot: Any closed chain.
        t: Times of a motion, shape (n,), [s]; None for a single configuration.
        q: Configurations, shape (n, nq).
    """
    lines = list(_open(robot, t, q))
    if isinstance(robot, SST):
        found = findings(robot.model, robot.geometry, np.zeros(1) if t is None else t, q)
        return lines + [finding.problem if t is None else str(finding) for finding in found]
    return lines + beyond_limits(robot, q, t)


def _open(robot: ClosedChain, t: Array | None, q: Array) -> Iterator[str]:
    residuals = np.abs(robot.residual(q)).max(axis=1, initial=0.0)
    worst = int(residuals.argmax())
    if residuals[worst] > CLOSURE_TOLERANCE:
        yield f"the loops are open by {residuals[worst]:.3g} (m or rad){_at(t, worst)}"


def _at(t: Array | None, sample: int) -> str:
    return "" if t is None else f" at t = {t[sample]:.6g} s"
