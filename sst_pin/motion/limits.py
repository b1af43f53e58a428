# SPDX-License-Identifier: BSD-2-Clause
"""Where a motion leaves the joint limits of its robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..chain.closed_chain import ClosedChain
from ..chain.loops import CLOSURE_TOLERANCE

Array = NDArray[np.float64]


def beyond_limits(chain: ClosedChain, q: Array, t: Array | None = None) -> list[str]:
    """A sentence for each joint that leaves its limits, with its worst sample.

    Args:
        chain: Any closed chain.
        q: Configurations, shape (N, nq).
        t: Their times, shape (N,), [s]; None for a single configuration.
    """
    low, high = chain.model.lowerPositionLimit, chain.model.upperPositionLimit
    excess = np.maximum(low - q, q - high)
    found = []
    for i, (name, unit) in enumerate(zip(chain.position_names, chain.joint_units, strict=True)):
        worst = int(excess[:, i].argmax())
        if unit and excess[worst, i] > CLOSURE_TOLERANCE:
            limits = f"{low[i]:.4g} to {high[i]:.4g} {unit}"
            when = "" if t is None else f" at t = {t[worst]:.6g} s"
            found.append(f"{name} leaves its limits of {limits}: {q[worst, i]:.4g} {unit}{when}")
    return found
