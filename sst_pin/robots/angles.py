# SPDX-License-Identifier: BSD-2-Clause
"""Inverse kinematics in closed form: what the legs of the gallery share.

Out of reach, the functions answer NaN.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, in_one_turn


def direction(vector: ArrayLike) -> float:
    """Angle of a planar vector from the x axis, [rad]; shape (2,) or longer."""
    x, y, *_ = np.asarray(vector, dtype=float)
    return float(np.arctan2(y, x))


def angle_about_z(R: Array) -> float:
    """Angle of a turn about z, [rad]; shape (3, 3)."""
    return float(np.arctan2(R[1, 0], R[0, 0]))


def two_link(target: ArrayLike, first: float, second: float, elbow: int) -> tuple[float, float]:
    """Angles of a planar arm of two links whose tip is at a point seen from its shoulder, [rad].

    They are those of the shoulder from the x axis and of the elbow from the upper link; `elbow` is
    the sign of the latter.
    """
    x, y, *_ = np.asarray(target, dtype=float)
    cosine = (x**2 + y**2 - first**2 - second**2) / (2 * first * second)
    with np.errstate(invalid="ignore"):
        bend = elbow * np.arccos(cosine)
    shoulder = np.arctan2(y, x) - np.arctan2(second * np.sin(bend), first + second * cosine)
    return float(in_one_turn(shoulder)), float(bend)


def universal(vector: ArrayLike) -> tuple[float, float]:
    """Turns about x and then y that bring the z axis to a direction; shape (3,)."""
    x, y, z = np.asarray(vector, dtype=float)
    return float(np.arctan2(-y, z)), float(np.arctan2(x, np.hypot(y, z)))


def of_two_turns(x: float, y: float) -> Array:
    """Orientation by turns about x and then the moved y, shape (3, 3)."""
    R: Array = pin.rpy.rpyToMatrix(x, 0.0, 0.0) @ pin.rpy.rpyToMatrix(0.0, y, 0.0)
    return R
