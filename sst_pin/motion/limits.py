# SPDX-License-Identifier: BSD-2-Clause
"""Where a motion leaves the joint limits of its robot."""

from __future__ import annotations

import numpy as np

from ..chain.closed_chain import ClosedChain
from .trajectories import Trajectory, require_motion


def beyond_limits(chain: ClosedChain, motion: Trajectory) -> list[str]:
    """A sentence for each joint that leaves its limits, with its worst sample.

    Args:
        chain: Any closed chain.
        motion: Of that robot.

    Raises:
        InputError: When the motion is another robot's.
    """
    require_motion(motion, chain.position_names)
    found = []
    limits = zip(chain.model.lowerPositionLimit, chain.model.upperPositionLimit, strict=True)
    names = zip(motion.joint_names, motion.units, strict=True)
    for (name, unit), (low, high), q in zip(names, limits, motion.q.T, strict=True):
        beyond = np.maximum(low - q, q - high)
        worst = int(beyond.argmax())
        if unit and beyond[worst] > 0:
            found.append(
                f"{name} leaves its limits of {low:.4g} to {high:.4g} {unit}: "
                f"{q[worst]:.4g} {unit} at t = {motion.t[worst]:.6g} s"
            )
    return found
