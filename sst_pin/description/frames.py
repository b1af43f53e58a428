# SPDX-License-Identifier: BSD-2-Clause
"""Joints and frames of an SST, by its parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..parameters import Parameters

Array = NDArray[np.float64]

#: Names of the joints of leg k, in the order of the chain and of q.
JOINT_NAMES = tuple(f"{joint}_{k}" for k in (1, 2, 3) for joint in ("gamma", "mu", "beta"))


def base_orientations(parameters: Parameters) -> Array:
    """R_0k: {0k} in the base, x = v_k and z = e_k, shape (3, 3, 3) (Eqs. 32, 36)."""
    v, e = parameters.base_directions, parameters.actuated_axes
    return np.stack([v, np.cross(e, v), e], axis=-1)


def star_orientations(parameters: Parameters) -> Array:
    """{E} in {3k}: Rot(x, 0), Rot(x, -alpha_2), Rot(x, -(alpha_2 + alpha_3)), shape (3, 3, 3)."""
    _, alpha_2, alpha_3 = parameters.arc_angles
    # Eqs. (30), (31), (35)
    return np.stack([_rot_x(angle) for angle in (0.0, -alpha_2, -(alpha_2 + alpha_3))])


def _rot_x(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array(((1, 0, 0), (0, c, -s), (0, s, c)))
