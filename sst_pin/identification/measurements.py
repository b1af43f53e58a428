# SPDX-License-Identifier: BSD-2-Clause
"""Measured positions and torques as a motion: filtered without phase, differentiated, decimated."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, finite_array, positive_number
from ..closed_chain import ClosedChain
from ..errors import InputError
from ..simulation.coordinate_motions import configurations_of, without_full_turns
from ..simulation.samples import sample_times, spline
from ..simulation.trajectories import Trajectory

_ORDER = 4
#: How far an outlier is from the smooth curve, over the median of so many periods and samples:
#: an outlier moves the curve by more than a period.
_OUTLIER, _PERIODS, _USUAL = 8.0, 10, 141
#: Of so many samples one outlier is replaced in each of so many passes; positions may be replaced
#: for this part of a period.
_AROUND, _PASSES, _BRIDGED = 7, 60, 0.25
#: Part of the samples that may be outliers: more spoil the curve that they are held against.
_MOST = 0.05


def measured_motion(
    chain: ClosedChain,
    t: ArrayLike,
    x: ArrayLike,
    tau: ArrayLike,
    *,
    cutoff: float,
    start: ArrayLike | None = None,
) -> Trajectory:
    """A log of positions and torques as a motion of the robot, with the filtered torques.

    A Butterworth filter of order four, forwards and backwards, smooths positions and torques alike;
    outliers are replaced by the smooth curve around them, positions for less than a quarter of a
    period of the cut-off frequency. Rates and accelerations are derivatives of splines of degree
    five. Of the filtered samples as many are kept as the cut-off frequency needs, two in its
    period, without the first and the last two periods. Joints without a sensor follow by assembly,
    from sample to sample in one assembly mode.

    Args:
        chain: The robot; each coordinate turns about an axis or slides.
        t: Times, increasing, shape (N,), [s]; uneven ones are interpolated, at most half a period
            of the cut-off frequency apart.
        x: Positions of the coordinates, shape (N, n), [rad] or [m]. Those of joints that turn
            without end may jump by full turns.
        tau: Torques of the motors, shape (N, motors).
        cutoff: Frequency where the two passes together let half of the amplitude through, [Hz].
        start: A guess of all joints at the start, as in `coordinate_motion`.

    Raises:
        InputError: For wrong shapes, a gap in the log, too many outliers, or too many in a row, or
            a cut-off frequency that is not below half of the sampling rate, or needs more time than
            the log has.
        ClosureError: If the loops cannot be closed along the motion.

    Example:
        >>> t = np.linspace(0, 4, 2001)
        >>> x = chain.home[0] + 0.3 * np.sin(3 * t)[:, None]
        >>> tau = np.cos(t)[:, None]
        >>> motion = sst_pin.identification.measured_motion(chain, t, x, tau, cutoff=10)
        >>> bool(np.abs(motion.va[:, 0] - 0.9 * np.cos(3 * motion.t)).max() < 1e-3)
        True
    """
    times = sample_times(t, 3)
    values = finite_array("x", x, (len(chain.coordinates),))
    torques = finite_array("tau", tau, (len(chain.motor_names),))
    for name, array in (("x", values), ("tau", torques)):
        if array.ndim != 2 or len(array) != len(times):
            raise InputError(name, f"shape {array.shape}, expected {len(times)} rows")
    values = without_full_turns(chain.mechanism, values)
    period = 1 / positive_number("cutoff", cutoff)
    even = np.linspace(times[0], times[-1], len(times))
    rate = 1 / (even[1] - even[0])
    if not (cutoff < rate / 2 and even[-1] - even[0] > 8 * period):
        told = f"{cutoff:g} Hz, of {even[-1] - even[0]:g} s at {rate:g} Hz"
        low, high = 8 / (even[-1] - even[0]), rate / 2
        raise InputError("cutoff", f"{told}; needed: more than {low:.3g} and less than {high:.3g}")
    gap = int(np.diff(times).argmax())
    if (missing := times[gap + 1] - times[gap]) > period / 2:
        problem = f"no samples for {missing:.3g} s from {times[gap]:.6g} s on"
        raise InputError("t", f"{problem}: more than half a period of {cutoff:g} Hz; split the log")
    both = np.array([np.interp(even, times, column) for column in np.hstack([values, torques]).T]).T
    smooth, replaced = _smoothed(both, cutoff / rate)
    curve = spline(even, smooth[:, : values.shape[1]])
    first, last = even[0] + 2 * period, even[-1] - 2 * period
    inside = (first <= even) & (even <= last)
    _require_bridged(chain, even[inside], replaced[inside], _BRIDGED * period)
    kept = np.linspace(first, last, int((last - first) * 2 / period) + 1)
    q = configurations_of(chain.engine, curve(kept), start)
    held = spline(even, smooth[:, values.shape[1] :])(kept)
    va, aa = (curve.derivative(k)(kept) for k in (1, 2))
    return chain.trajectory(kept, q, va, aa, held)


def lowpass(values: Array, cutoff: float) -> Array:
    """Filtered forwards and backwards along the first axis, the cut-off in periods per sample."""
    from scipy.signal import butter, sosfiltfilt

    beyond = min(int(3 / cutoff), len(values) - 1)  # where the ends are continued
    sections = butter(_ORDER, cutoff, fs=1.0, output="sos")
    return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=beyond))


def decimated(values: Array, every: int) -> Array:
    """One of so many samples, after a filter that lets through what these can show."""
    return values if every == 1 else lowpass(values, 0.4 / every)[::every]


def _require_bridged(chain: ClosedChain, t: Array, replaced: Flags, longest: float) -> None:
    """Check that few positions are replaced, and for short times only."""
    for name, column in zip(chain.coordinates, replaced.T, strict=False):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], column, [False]]).astype(int)))
        first, behind = edges[::2], edges[1::2]
        at = t[first[t[behind - 1] - t[first] >= longest]]
        if len(at):
            problem = f"{name} jumps, or is faster than the cut-off frequency, at {at[0]:.6g} s"
            raise InputError("x", f"{problem}; clean the log or split it there")
        if (count := int(column.sum())) > _MOST * len(t):
            problem = f"{count} of {len(t)} samples of {name} are outliers"
            raise InputError("x", f"{problem}: clean the log, or choose a higher cut-off frequency")


def _smoothed(values: Array, cutoff: float) -> tuple[Array, Flags]:
    """Smooth curves through samples, and which samples are outliers, which give way one by one.

    An outlier is the sample farthest from the curve around it, by far more than is usual there.
    """
    from scipy.ndimage import maximum_filter1d

    values, replaced = values.copy(), np.zeros(values.shape, bool)
    parts = max(1, int(len(values) / max(_USUAL, _PERIODS / cutoff)))
    for _ in range(_PASSES):
        curve = lowpass(values, cutoff)
        away = np.abs(values - curve)
        usual = 1.4826 * np.vstack([0 * a + np.median(a, 0) for a in np.array_split(away, parts)])
        far = away > _OUTLIER * np.maximum(usual, 1e-3 * np.ptp(curve, axis=0))
        far &= away >= maximum_filter1d(away, _AROUND, axis=0)
        if not far.any():
            break
        values[far] = curve[far]
        replaced |= far
    return curve, replaced
