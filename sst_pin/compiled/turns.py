# SPDX-License-Identifier: BSD-2-Clause
"""Angles and rotation vectors on CasADi's symbols, smooth up to half a turn.

An arc over its sine depends on its cosine c alone. With the arc halved three times, by
cos(x / 2) = sqrt((1 + c) / 2), the series of the arcsine converges to rounding within a few terms.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
from casadi import SX

#: Coefficients of asin(x) / x by x^2; x is at most sin(pi / 16).
_SERIES = [1.0]
for _k in range(1, 11):
    _SERIES.append(_SERIES[-1] * (2 * _k - 1) ** 2 / (2 * _k * (2 * _k + 1)))


def rotation_vector(quaternion: SX) -> SX:
    """Rotation vector of a unit quaternion (x, y, z, w), at most half a turn long."""
    vector, w = quaternion[:3], quaternion[3]
    side = _side(w)
    return 2 * side * _arc_over_sine(side * w) * vector


def angle(cosine: Any, sine: Any) -> Any:
    """From -pi to pi."""
    side = _side(cosine)
    beyond = ca.pi / 2 * (1 - side) * _side(sine)  # of a right angle: measured from half a turn
    return beyond + side * _arc_over_sine(side * cosine) * sine


def _side(x: Any) -> Any:
    """1, or -1 below 0."""
    return 2 * (x >= 0) - 1


def _arc_over_sine(cosine: Any) -> Any:
    """An arc up to a right angle over its sine."""
    halved = 1
    for _ in range(3):
        square, cosine = (1 - cosine) / 2, ca.sqrt((1 + cosine) / 2)
        halved *= cosine
    series = 0
    for coefficient in reversed(_SERIES):
        series = series * square + coefficient
    return series / halved
