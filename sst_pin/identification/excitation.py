# SPDX-License-Identifier: BSD-2-Clause
"""Motions that show parameters well: Fourier series (J. Swevers et al., IEEE T-RA 13(5), 1997)."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, one_or_each, positive_number, whole_number
from ..closed_chain import ClosedChain
from ..errors import InputError, SSTError
from ..loops.start import placed
from ..model.named_positions import taken
from ..progress import counted
from ..simulation.coordinate_motions import coordinate_motion
from ..simulation.trajectories import Trajectory, require_motion
from .base_parameters import BaseParameters, random_states

#: Samples of a motion that is judged, for each harmonic.
_SAMPLES = 12
#: Most samples of a period.
_MOST = 100_000
#: At this condition number noise of 0.1 % of the torques hides the parameter that is shown least.
_POOR = 1e3
#: Parts of an amplitude that are tried before another motion.
_PARTS = 0.7 ** np.arange(9)


def condition_number(chain: ClosedChain, base: BaseParameters, motion: Trajectory) -> float:
    """Condition number of the base regressor along a motion; the smaller, the better it is shown.

    Each column is in units of its mean square at random states of the robot, so that units of
    parameters do not count.

    Args:
        chain: The robot.
        base: Its base parameters.
        motion: A motion of it.

    Raises:
        InputError: For a motion of another robot.

    Example:
        >>> base = sst_pin.identification.base_parameters(chain)
        >>> t = np.linspace(0, 2, 41)
        >>> slow = sst_pin.coordinate_motion(chain, t, chain.home[0] + 0.1 * np.sin(t)[:, None])
        >>> sst_pin.identification.condition_number(chain, base, slow) > 100
        True
    """
    require_motion(motion, chain.mechanism)
    return _condition(chain, base, _sizes(chain, base), motion)


def _sizes(chain: ClosedChain, base: BaseParameters) -> Array:
    """Root mean squares of the columns of the base regressor at random states, shape (b,)."""
    usual = chain.torque_regressor(*random_states(chain, 200, 0))[..., base.columns]
    return np.asarray(np.sqrt(np.mean(usual**2, axis=(0, 1))))


def _condition(chain: ClosedChain, base: BaseParameters, sizes: Array, motion: Trajectory) -> float:
    Y = chain.torque_regressor(motion.q, motion.va, motion.aa)[..., base.columns]
    return float(np.linalg.cond((Y / sizes).reshape(-1, len(base))))


def excitation(
    chain: ClosedChain,
    base: BaseParameters,
    duration: float,
    *,
    harmonics: int = 5,
    rates: ArrayLike | None = None,
    torques: ArrayLike | None = None,
    start: ArrayLike | None = None,
    tries: int = 60,
    seed: int = 0,
    dt: float = 0.01,
) -> Trajectory:
    """One period of a motion that shows base parameters well, within what the robot can do.

    Each coordinate is a Fourier series about its position at the start, where the motion begins and
    ends at rest. Random series are scaled down until no limit is passed and no singular
    configuration is met; the best one is bettered by random steps. Positions of joints stay within
    the limits of the model.

    Args:
        chain: The robot; each coordinate turns about an axis or slides.
        base: The combinations to be shown.
        duration: Duration of one period, [s].
        harmonics: Number of harmonics; the highest frequency is it over the duration.
        rates: Largest rate of each coordinate, shape (n,) or (); those of the model by default.
        torques: Largest torque of each motor, shape (motors,) or (); those of the model by default.
        start: The configuration at the start, shape (nq,); `home` by default.
        tries: How many motions are judged.
        seed: Seed of the random series.
        dt: Time between samples of the result, [s].

    Raises:
        InputError: If no motion is possible within the limits, or the limits are not positive.

    Warns:
        RuntimeWarning: If the condition number is large, so that noise hides some parameters.
        DescriptionWarning: If neither `home` nor `start` chooses the assembly mode.

    Example:
        >>> chain = sst_pin.robots.four_bar()
        >>> base = sst_pin.identification.base_parameters(chain)
        >>> motion = sst_pin.identification.excitation(chain, base, 3.0, harmonics=2, tries=1)
        >>> bool(np.abs(motion.va[[0, -1]]).max() < 1e-3)
        True
    """
    from scipy.linalg import null_space  # takes as long to import as all else

    period, n = positive_number("duration", duration), len(chain.coordinates)
    fine = positive_number("dt", dt)
    if period > _MOST * fine:
        problem = f"{period:g} s have more than {_MOST:g} samples of {fine:g} s"
        raise InputError("duration", problem)
    count, tries = whole_number("harmonics", harmonics, 2), whole_number("tries", tries, 1)
    mechanism, random = chain.mechanism, np.random.default_rng(whole_number("seed", seed, 0))
    model, space = mechanism.model, mechanism.space
    fastest = _limits("rates", rates, model.velocityLimit[mechanism.coordinates])
    effort = np.abs(mechanism.motors).T @ np.minimum(model.effortLimit, np.finfo(float).max / 10)
    strongest = _limits("torques", torques, effort)
    first = placed(chain.engine, {}, start)
    x0 = taken(space, first, chain.coordinates)
    sizes = _sizes(chain, base)
    units = mechanism.rate_scale[mechanism.coordinates]

    orders = 2 * np.pi * np.arange(1, count + 1) / period
    zero, one = np.zeros(count), np.ones(count)
    ends = np.array([[*zero, *one], [*orders, *zero], [*zero, *orders**2]])  # rest at the start
    rest = null_space(ends / np.abs(ends).max(axis=1, keepdims=True))

    def sampled(z: Array, step: float) -> Trajectory:
        t = np.linspace(0, period, max(round(period / step), 3) + 1)
        waves = np.hstack([np.sin(np.outer(t, orders)), np.cos(np.outer(t, orders))])
        return coordinate_motion(chain, t, x0 + (waves @ rest @ z) * units, first)

    def allowed(motion: Trajectory) -> bool:
        low, high = model.lowerPositionLimit, model.upperPositionLimit
        within = (low <= motion.q) & (motion.q <= high) | (low >= high)  # these are none
        small = (np.abs(motion.va) <= fastest).all() and (np.abs(motion.tau) <= strongest).all()
        return bool(within.all() and small)

    def possible(z: Array, parts: Iterable[float], step: float) -> tuple[Array, Trajectory] | None:
        """Coefficients and motion of the first of these parts that is possible."""
        for part in parts:
            with suppress(SSTError):
                motion = sampled(part * z, step)
                if allowed(motion):
                    return part * z, motion
        return None

    best, kept, chosen = np.inf, np.zeros((rest.shape[1], n)), None
    for k in counted(range(tries), "excitation", tries):
        z = np.asarray(random.normal(size=kept.shape) / count)
        if k >= tries / 3 and np.isfinite(best):  # from the best one, ever shorter steps
            z = kept + 0.5 * np.abs(kept).max() * count * (1 - k / tries) * z
        if (found := possible(z, _PARTS, period / (_SAMPLES * count))) is None:
            continue
        value = _condition(chain, base, sizes, found[1])
        # In short steps a little smaller, if it passes a limit between the others.
        if value < best and (followed := possible(found[0], 0.97 ** np.arange(10), fine)):
            best, kept, chosen = value, found[0], followed[1]
    if chosen is None:
        raise InputError("start", "no motion about it stays within the limits")
    if best > _POOR:
        problem = f"the motion shows the parameters poorly: condition number {best:.3g}"
        cure = (
            "allow larger rates or torques, more tries or harmonics, or consider fewer parameters"
        )
        warnings.warn(f"{problem}; {cure}", RuntimeWarning, stacklevel=2)
    return chosen


def _limits(name: str, given: ArrayLike | None, model: Array) -> Array:
    """Largest values, one or each; a limit of the model that is 0 is unknown."""
    if given is None:
        return np.where(model > 0, model, np.inf)
    return one_or_each(name, given, len(model))
