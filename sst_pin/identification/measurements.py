# SPDX-License-Identifier: BSD-2-Clause
"""A log of positions and torques as a motion of a robot.

`measured_motion` does this in steps: the log is interpolated at even times (`_even_log`), outliers
are replaced, positions and torques are filtered, and the positions are differentiated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, positive_number, whole_number
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import InputError
from ..simulation.coordinate_motions import (
    configurations_of,
    require_start_with_brakes,
    without_full_turns,
)
from ..simulation.samples import rows_of_samples, sample_times, spline
from ..simulation.trajectories import Trajectory
from .filters import lowpass
from .outliers import require_few_replaced, without_outliers

#: The start of names of torques in `MeasuredMotion.replaced`.
_TORQUE = "torque of "
#: No filter is needed for a cut-off above this, in periods per sample: samples show up to 0.5.
_NO_FILTER = 0.45
#: Samples in a row may be replaced for this part of a period of the cut-off frequency.
_BRIDGED = 0.25


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
        """Take the arguments of `Trajectory`, and `replaced`."""
        super().__init__(*values, **words)
        vars(self)["replaced"] = replaced  # as a frozen dataclass, which assigns no attributes


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
    in a period of the cut-off frequency. Coulomb friction, which jumps, is then smooth in the
    torques but not in the regressor. With a larger `decimate` the result has this number of samples
    in a period, and `estimate(decimate=)` filters the torques and the regressor alike.

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
        start: A guess of all joints at the start, as in `coordinate_motion`; a robot with brakes
            needs it.

    Raises:
        InputError: For a gap in the log; for more than 5 % of outliers, or outliers for more than a
            quarter of a period; for a cut-off frequency that is not below half of the sampling
            rate, or so low that the log has at most eight periods; if `decimate` asks for more
            samples than the log has; for a robot with brakes and no `start`.

    Example:
        >>> t = np.linspace(0, 4, 2001)
        >>> x = chain.home[0] + 0.3 * np.sin(3 * t)[:, None]
        >>> tau = np.cos(t)[:, None]
        >>> motion = sst_pin.identification.measured_motion(chain, t, x, tau, cutoff=10)
        >>> bool(np.abs(motion.va[:, 0] - 0.9 * np.cos(3 * motion.t)).max() < 1e-3)
        True
    """
    require_robot("chain", chain)
    require_start_with_brakes(chain.mechanism, start)
    log = _even_log(chain, t, x, tau, cutoff)
    period = 1 / cutoff
    count = whole_number("decimate", decimate, 1)
    # Samples of the result in a period of the cut-off frequency.
    per_period = 2 if count == 1 else count
    if per_period * cutoff > log.rate * (1 + 1e-9):  # but for rounding of the times
        problem = f"{per_period} samples in a period of {cutoff:g} Hz"
        most = f"the log has {log.rate:.4g} in 1 s: at most {int(log.rate / cutoff)}"
        raise InputError("decimate", f"{problem}; {most}")

    # Outliers. The filter is inaccurate at the ends: two periods are left out.
    n = len(chain.coordinates)
    cleaned = without_outliers(log.values, n, cutoff / log.rate)
    first = log.t[0] + 2 * period
    last = log.t[-1] - 2 * period
    inside = (first <= log.t) & (log.t <= last)
    names = [*chain.coordinates, *(_TORQUE + name for name in chain.motor_names)]
    is_torque = np.arange(len(names)) >= n
    replaced = cleaned.replaced
    longest = _BRIDGED * period
    require_few_replaced(names, is_torque.tolist(), log.t[inside], replaced[inside], longest)

    # Torques. Without `decimate` they are filtered as the positions. With it, `estimate` filters
    # the torques and the regressor alike, so here the torques are only filtered against aliasing:
    # the cut-off is half the sampling rate of the result, in periods per sample of the log.
    if count == 1:
        torques = cleaned.smooth[:, n:]
    else:
        torques = cleaned.values[:, n:]
        anti_aliasing = count * cutoff / 2 / log.rate
        if anti_aliasing < _NO_FILTER:
            torques = lowpass(torques, anti_aliasing)

    # The motion, at the times of the result.
    curve = spline(log.t, cleaned.smooth[:, :n])
    times = np.linspace(first, last, int((last - first) * per_period / period) + 1)
    q = configurations_of(chain.engine, curve(times), start)
    va = curve.derivative(1)(times)
    aa = curve.derivative(2)(times)
    motion = chain.trajectory(times, q, va, aa, spline(log.t, torques)(times))
    counts = zip(names, replaced.sum(axis=0).tolist(), strict=True)
    return MeasuredMotion(**vars(motion), replaced={name: k for name, k in counts if k})


class _Log(NamedTuple):
    """A log at even times."""

    #: Times, shape (N,), [s].
    t: Array
    #: Sampling rate, [Hz].
    rate: float
    #: Positions of the coordinates, then torques of the motors, shape (N, n + motors).
    values: Array


def _even_log(
    chain: ClosedChain, t: ArrayLike, x: ArrayLike, tau: ArrayLike, cutoff: float
) -> _Log:
    """The log, checked and interpolated at as many even times, with angles without full turns."""
    times = sample_times(t, 3)
    positions = rows_of_samples("x", x, (len(times), len(chain.coordinates)))
    torques = rows_of_samples("tau", tau, (len(times), len(chain.motor_names)))
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
    return _Log(even, float(rate), values)
