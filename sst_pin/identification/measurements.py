# SPDX-License-Identifier: BSD-2-Clause
"""A log of positions and torques as a motion: filtered, differentiated, decimated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, finite_array, positive_number, whole_number
from ..closed_chain import ClosedChain
from ..errors import InputError
from ..simulation.coordinate_motions import configurations_of, without_full_turns
from ..simulation.samples import sample_times, spline
from ..simulation.trajectories import Trajectory

#: Order of the Butterworth filter.
_ORDER = 4
#: The start of names of torques.
_TORQUE = "torque of "
#: A cut-off above this, in periods per sample, does not filter: half a period per sample is the
#: most that samples can show.
_NO_FILTER = 0.45
#: Cut-off of the filter of `decimated`, in periods per sample of the result; below 0.5, so that
#: faster changes do not appear as slower ones.
_ANTI_ALIASING = 0.4
#: Deviations from the smooth curve are compared with their median in parts of the log. A part has
#: at least this number of periods of the cut-off, and of samples.
_PART_PERIODS = 10
_PART_SAMPLES = 141
#: An outlier is farther from the smooth curve than this multiple of the usual deviation. Of normal
#: noise, no sample in 10^14 is so far away.
_OUTLIER = 8.0
#: Standard deviation of normal noise, in units of the median of its absolute values.
_DEVIATION_OF_MEDIAN = 1.4826
#: Deviations below this fraction of the range of a column are no outliers, however small its noise.
_LEAST_DEVIATION = 1e-3
#: In each pass at most one outlier in this number of samples is replaced: a bad sample bends the
#: curve at its neighbours too.
_NEIGHBOURS = 7
#: Most passes.
_PASSES = 60
#: Part of a period of the cut-off for which samples may be replaced in a row.
_BRIDGED = 0.25
#: A torque is compared with the median of this number of samples. One bad sample of an uneven log
#: spoils three even ones, so that four of them are good.
_MEDIAN_SAMPLES = 7
#: A sample affects this number of outputs of the filter of `decimated`.
_MEMORY = 20
#: Largest fraction of the samples that may be outliers; more would spoil the smooth curve.
_MOST_OUTLIERS = 0.05


@dataclass(frozen=True, eq=False, repr=False, init=False)
class MeasuredMotion(Trajectory):
    """A motion from a log.

    Attributes:
        replaced: How many samples of the log were replaced as outliers, by the name of the
            coordinate, or "torque of" the motor; those without any are left out.
    """

    replaced: Mapping[str, int]

    def __init__(
        self, *values: Any, replaced: Mapping[str, int] = MappingProxyType({}), **words: Any
    ) -> None:
        super().__init__(*values, **words)
        vars(self)["replaced"] = replaced


def measured_motion(
    chain: ClosedChain,
    t: ArrayLike,
    x: ArrayLike,
    tau: ArrayLike,
    *,
    cutoff: float,
    decimate: int = 1,
    start: ArrayLike | None = None,
) -> MeasuredMotion:
    """A log of positions and torques as a motion of the robot.

    A Butterworth filter of order four, forwards and backwards, smooths the positions. Rates and
    accelerations are derivatives of splines of degree five. Joints without a sensor follow by
    assembly, from sample to sample in one assembly mode. The first and the last two periods of the
    cut-off frequency are left out.

    With `decimate` = 1 the torques are filtered like the positions, and the result has two samples
    in a period: friction that jumps is then smooth in the torques and not in the regressor. With
    more, it has `decimate` samples, and `estimate(decimate=)` filters both sides alike.

    Outliers are samples far from the smooth curve, and torques also far from their neighbours, so
    that jumps stay. They are replaced: positions by the curve, torques by the median.

    Args:
        chain: The robot; each coordinate turns about an axis or slides.
        t: Times, increasing, shape (N,), [s]; uneven ones are interpolated, at most half a period
            of the cut-off frequency apart.
        x: Positions of the coordinates, shape (N, n), [rad] or [m]. Angles of joints that
            turn without end may jump by full turns.
        tau: Torques of the motors, shape (N, motors).
        cutoff: Frequency where the two passes together let half of the amplitude through, [Hz].
        decimate: The same as in `estimate`; 8 to 20 for robots with dry friction.
        start: A guess of all joints at the start, as in `coordinate_motion`.

    Raises:
        InputError: For a gap in the log, more than 5 % of outliers, or outliers for more than a
            quarter of a period, a cut-off frequency that is not below half of the sampling rate or
            needs more time than the log has, or more samples than the log has.

    Example:
        >>> t = np.linspace(0, 4, 2001)
        >>> x = chain.home[0] + 0.3 * np.sin(3 * t)[:, None]
        >>> tau = np.cos(t)[:, None]
        >>> motion = sst_pin.identification.measured_motion(chain, t, x, tau, cutoff=10)
        >>> bool(np.abs(motion.va[:, 0] - 0.9 * np.cos(3 * motion.t)).max() < 1e-3)
        True
    """
    even, values, rate = _even_samples(chain, t, x, tau, cutoff)
    period = 1 / cutoff
    count = whole_number("decimate", decimate, 1)
    per_period = 2 if count == 1 else count
    if per_period * cutoff > rate * (1 + 1e-9):
        problem = f"{per_period} samples in a period of {cutoff:g} Hz"
        most = f"the log has {rate:.4g} in 1 s: at most {int(rate / cutoff)}"
        raise InputError("decimate", f"{problem}; {most}")

    n = len(chain.coordinates)
    values, smooth, replaced = _without_outliers(values, n, cutoff / rate)
    # The filter is inaccurate at the ends: two periods are left out.
    first = even[0] + 2 * period
    last = even[-1] - 2 * period
    inside = (first <= even) & (even <= last)
    names = [*chain.coordinates, *(_TORQUE + name for name in chain.motor_names)]
    _require_bridged(names, even[inside], replaced[inside], _BRIDGED * period)

    curve = spline(even, smooth[:, :n])
    torques = smooth[:, n:]
    if count > 1:
        # `estimate` filters torques and regressor alike; here the torques need anti-aliasing only.
        torques = values[:, n:]
        anti_aliasing = count * cutoff / 2 / rate
        if anti_aliasing < _NO_FILTER:
            torques = lowpass(torques, anti_aliasing)
    times = np.linspace(first, last, int((last - first) * per_period / period) + 1)
    q = configurations_of(chain.engine, curve(times), start)
    va = curve.derivative(1)(times)
    aa = curve.derivative(2)(times)
    motion = chain.trajectory(times, q, va, aa, spline(even, torques)(times))
    counts = zip(names, replaced.sum(axis=0).tolist(), strict=True)
    return MeasuredMotion(**vars(motion), replaced={name: k for name, k in counts if k})


def _even_samples(
    chain: ClosedChain, t: ArrayLike, x: ArrayLike, tau: ArrayLike, cutoff: float
) -> tuple[Array, Array, float]:
    """Even times, positions beside torques there, and their rate, [Hz]."""
    times = sample_times(t, 3)
    positions = finite_array("x", x, (len(chain.coordinates),))
    torques = finite_array("tau", tau, (len(chain.motor_names),))
    for name, array in (("x", positions), ("tau", torques)):
        if array.ndim != 2 or len(array) != len(times):
            raise InputError(name, f"shape {array.shape}, expected {len(times)} rows")
    period = 1 / positive_number("cutoff", cutoff)
    duration = times[-1] - times[0]
    even = np.linspace(times[0], times[-1], len(times))
    rate = 1 / (even[1] - even[0])
    if not (cutoff < rate / 2 and duration > 8 * period):
        needed = f"more than {8 / duration:.3g} and less than {rate / 2:.3g}"
        problem = f"{cutoff:g} Hz, of {duration:g} s at {rate:g} Hz; needed: {needed}"
        raise InputError("cutoff", problem)
    gap = int(np.diff(times).argmax())
    missing = times[gap + 1] - times[gap]
    if missing > period / 2:
        problem = f"no samples for {missing:.3g} s from {times[gap]:.6g} s on"
        raise InputError("t", f"{problem}: more than half a period of {cutoff:g} Hz; split the log")
    columns = np.hstack([without_full_turns(chain.mechanism, positions), torques]).T
    values = np.array([np.interp(even, times, column) for column in columns]).T
    return even, values, float(rate)


def lowpass(values: Array, cutoff: float, ends: str = "odd") -> Array:
    """Values filtered forwards and backwards along axis 0, the cut-off in periods per sample.

    `ends` says how the values are reflected beyond their ends: "odd", about the last, or "even".
    """
    from scipy.signal import butter, sosfiltfilt

    beyond = min(int(3 / cutoff), len(values) - 1)  # where the ends are continued
    sections = butter(_ORDER, cutoff, fs=1.0, output="sos")
    return np.asarray(sosfiltfilt(sections, values, axis=0, padtype=ends, padlen=beyond))


def decimated(values: Array, every: int) -> Array:
    """One of `every` samples, after a low-pass filter for that rate.

    The filter mirrors the values at both ends. The first and the last sample, which have more
    noise, are left out.
    """
    if every == 1:
        return values
    return lowpass(values, _ANTI_ALIASING / every, "even")[::every][1:-1]


def noise_correlations(every: int) -> Array:
    """Correlations of filtered noise in samples of `decimated` that are 1, 2, ... apart."""
    if every == 1:
        return np.empty(0)
    impulse = np.zeros(2 * _MEMORY * every + 1)
    impulse[_MEMORY * every] = 1.0
    response = lowpass(impulse, _ANTI_ALIASING / every)
    lags = np.correlate(response, response, "full")[len(response) - 1 :: every][:_MEMORY]
    return np.asarray(lags[1:] / lags[0])


def _require_bridged(names: Sequence[str], t: Array, replaced: Flags, longest: float) -> None:
    """Check that few samples are replaced, and for short times only."""
    from scipy.ndimage import find_objects, label

    for name, column in zip(names, replaced.T, strict=True):
        argument = "tau" if name.startswith(_TORQUE) else "x"
        for (run,) in find_objects(label(column)[0]):
            if t[run.stop - 1] - t[run.start] >= longest:
                problem = f"{name} jumps, or is faster than the cut-off frequency"
                cure = "clean the log or split it there"
                raise InputError(argument, f"{problem}, at {t[run.start]:.6g} s; {cure}")
        count = int(column.sum())
        if count > _MOST_OUTLIERS * len(t):
            problem = f"{count} of {len(t)} samples of {name} are outliers"
            cure = "clean the log, or choose a higher cut-off frequency"
            raise InputError(argument, f"{problem}: {cure}")


def _without_outliers(values: Array, positions: int, cutoff: float) -> tuple[Array, Array, Flags]:
    """Samples and smooth curves without outliers, and which samples are outliers.

    Outliers are replaced one by one. An outlier is the sample farthest from the curve around it, by
    far more than is usual there. A torque must also be far from the median of its neighbours.
    """
    from scipy.ndimage import maximum_filter1d, median_filter

    values = values.copy()
    replaced = np.zeros(values.shape, bool)
    parts = max(1, int(len(values) / max(_PART_SAMPLES, _PART_PERIODS / cutoff)))
    for _ in range(_PASSES):
        curve = lowpass(values, cutoff)
        deviations = np.abs(values - curve)
        usual = _DEVIATION_OF_MEDIAN * _medians(deviations, parts)
        # Positions are replaced by the curve, torques by the median, which keeps jumps.
        substitutes = curve.copy()
        torques = values[:, positions:]
        substitutes[:, positions:] = median_filter(torques, (_MEDIAN_SAMPLES, 1), mode="nearest")
        deviations = np.minimum(deviations, np.abs(values - substitutes))

        least = _LEAST_DEVIATION * np.ptp(curve, axis=0)
        outliers = deviations > _OUTLIER * np.maximum(usual, least)
        outliers &= deviations >= maximum_filter1d(deviations, _NEIGHBOURS, axis=0)
        if not outliers.any():
            break
        values[outliers] = substitutes[outliers]
        replaced |= outliers
    return values, curve, replaced


def _medians(deviations: Array, parts: int) -> Array:
    """The median of each column in each part of the samples, repeated for all its samples."""
    medians = [
        np.broadcast_to(np.median(part, axis=0), part.shape)
        for part in np.array_split(deviations, parts)
    ]
    return np.vstack(medians)
