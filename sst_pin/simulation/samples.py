# SPDX-License-Identifier: BSD-2-Clause
"""Times of samples, and smooth curves through samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array
from ..errors import InputError

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


def sample_times(t: ArrayLike, least: int = 1) -> Array:
    """Times as a read-only array; fewer than `least`, or times that do not increase, are errors."""
    times = finite_array("t", t, ()).copy()
    if times.ndim != 1 or len(times) < least:
        raise InputError("t", f"shape {times.shape}, expected (N,) with N >= {least}")
    steps = np.diff(times)
    if (steps <= 0).any():
        i = int(np.argmax(steps <= 0)) + 1
        raise InputError("t", f"not increasing: t[{i}] = {times[i]:g} after {times[i - 1]:g}")
    times.setflags(write=False)
    return times


def rows_of_samples(name: str, value: ArrayLike, shape: tuple[int, int]) -> Array:
    """An array of finite numbers with a row for each time, of exactly this shape."""
    array = finite_array(name, value, shape[1:])
    if array.shape != shape:
        raise InputError(name, f"shape {array.shape}, expected {shape}: a row for each time")
    return array


def times_within(name: str, value: ArrayLike, times: Array, beyond: float = 0.0) -> Array:
    """The times `value`, shape (...); an error if one is more than `beyond` [s] outside `times`."""
    array = finite_array(name, value, ())
    slack = beyond + 1e-9 * (times[-1] - times[0])  # an integrator may end a rounding beyond
    outside = (array < times[0] - slack) | (array > times[-1] + slack)
    if outside.any():
        first = array[outside][0]
        raise InputError(name, f"{first:g} s, sampled from {times[0]:g} to {times[-1]:g} s")
    return array


def spline(t: Array, values: Array) -> BSpline:
    """A smooth curve through samples, shape (N, ...): of degree five, lower for fewer than six."""
    from scipy.interpolate import make_interp_spline

    try:
        return make_interp_spline(t, values, k=min(5, len(t) - 1))
    except ValueError as error:  # times too close for double precision
        raise InputError("t", f"no smooth curve through the samples: {error}") from None
