# SPDX-License-Identifier: BSD-2-Clause
"""Samples of a motion: their times, and smooth curves through them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array
from ..errors import InputError

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


def sample_times(t: ArrayLike, least: int = 1) -> Array:
    """Times as a read-only array.

    Raises:
        InputError: When they are not increasing, or fewer than `least`.
    """
    times = finite_array("t", t, ()).copy()
    if times.ndim != 1 or len(times) < least:
        raise InputError("t", f"shape {times.shape}, expected (N,) with N >= {least}")
    steps = np.diff(times)
    if (steps <= 0).any():
        i = int(np.argmax(steps <= 0)) + 1
        raise InputError("t", f"not increasing: t[{i}] = {times[i]:g} after {times[i - 1]:g}")
    times.setflags(write=False)
    return times


def times_within(name: str, value: ArrayLike, times: Array, beyond: float = 0.0) -> Array:
    """Times at which samples can be interpolated, shape (...).

    Args:
        name: The argument.
        value: The times.
        times: Those of the samples, increasing.
        beyond: How far they may lie outside, [s].

    Raises:
        InputError: When one lies further before the first sample or after the last.
    """
    array = finite_array(name, value, ())
    slack = beyond + 1e-9 * (times[-1] - times[0])  # an integrator may end a rounding beyond
    outside = (array < times[0] - slack) | (array > times[-1] + slack)
    if outside.any():
        first = array[outside][0]
        raise InputError(name, f"{first:g} s, sampled from {times[0]:g} to {times[-1]:g} s")
    return array


def spline(t: Array, values: Array) -> BSpline:
    """A smooth curve through samples: of degree five, lower for fewer than six of them.

    Args:
        t: Increasing times, shape (N,).
        values: Shape (N, ...).

    Raises:
        InputError: When the times are too near to one another for a curve in double precision.
    """
    from scipy.interpolate import make_interp_spline

    try:
        return make_interp_spline(t, values, k=min(5, len(t) - 1))
    except ValueError as error:
        raise InputError("t", f"no smooth curve through the samples: {error}") from None
