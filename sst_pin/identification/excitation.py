# SPDX-License-Identifier: BSD-2-Clause
"""Exciting motions for identification, as Fourier series (J. Swevers et al., IEEE T-RA, 1997).

- `condition_number` judges a motion: how well it shows the base parameters.
- `excitation` searches for a motion with a small condition number (`_search`).
- `_Series` makes motions of the robot from coefficients of Fourier series, within its limits.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, one_or_each, positive_number, whole_number
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import InputError, SSTError, warn_caller
from ..loops.start import placed
from ..model.named_positions import positions_of
from ..progress import counted
from ..simulation.coordinate_motions import coordinate_motion
from ..simulation.trajectories import Trajectory, require_motion
from .base_parameters import BaseParameters, require_base
from .random_states import random_states

#: Number of samples of a motion that is judged: this number for each harmonic.
_SAMPLES = 12
#: Largest number of samples of the result.
_MOST = 100_000
#: At this condition number, noise of 0.1 % of the torques hides the worst identified parameter.
_POOR = 1e3
#: Factors that scale a series until it keeps the limits, tried in this order: from 1 down to 0.06.
_FACTORS = 0.7 ** np.arange(9)
#: Such factors for the samples of the result, from 1 down to 0.76.
_FINAL_FACTORS = 0.97 ** np.arange(10)
#: The part of the tries with random series; the others are steps from the best one.
_RANDOM_TRIES = 1 / 3
#: Size of the first steps from the best series, as a part of its largest coefficient.
_FIRST_STEP = 0.5


def condition_number(chain: ClosedChain, base: BaseParameters, motion: Trajectory) -> float:
    """Condition number of the base regressor along a motion.

    It is small if the motion identifies all parameters. Each column is divided by its root mean
    square at random states of the robot, so that units of parameters do not matter.

    Args:
        chain: The robot.
        base: Its base parameters.
        motion: A motion of it.

    Example:
        >>> base = sst_pin.identification.base_parameters(chain)
        >>> t = np.linspace(0, 2, 41)
        >>> slow = sst_pin.coordinate_motion(chain, t, chain.home[0] + 0.1 * np.sin(t)[:, None])
        >>> sst_pin.identification.condition_number(chain, base, slow) > 100
        True
    """
    require_robot("chain", chain)
    require_motion(motion, chain.mechanism)
    return _condition(chain, base, _sizes(chain, base), motion)


def _sizes(chain: ClosedChain, base: BaseParameters) -> Array:
    """Root mean squares of the columns of the base regressor at random states, shape (b,)."""
    require_base(chain, base)
    Y = chain.torque_regressor(*random_states(chain, 200, 0))[..., base.columns]
    return np.asarray(np.sqrt(np.mean(Y**2, axis=(0, 1))))


def _condition(chain: ClosedChain, base: BaseParameters, sizes: Array, motion: Trajectory) -> float:
    """Condition number of the base regressor along a motion, its columns divided by `sizes`."""
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
    """One period of an exciting motion to identify base parameters, within the limits of the robot.

    Each coordinate is a Fourier series about its position at the start, where the motion begins and
    ends at rest. Random series are scaled down until they exceed no limit and meet no singular
    configuration; the best one is improved by random steps. Positions of joints stay within the
    limits of the model.

    Args:
        chain: The robot; each coordinate turns about an axis or slides.
        base: The base parameters to identify.
        duration: Duration of one period, [s].
        harmonics: Number of harmonics; the highest frequency is harmonics / duration, [Hz].
        rates: Largest rate of each coordinate, shape (n,) or (); by default the model's.
        torques: Largest torque of each motor, shape (motors,) or (). By default the limits of the
            model for the forces of motors on each joint and line.
        start: The configuration at the start, shape (nq,); `home` by default.
        tries: How many motions are judged.
        seed: Seed of the random series.
        dt: Time between samples of the result, [s].

    Raises:
        InputError: If no motion is possible within the limits.

    Warns:
        RuntimeWarning: If the condition number is large, so that noise hides some parameters.
        DescriptionWarning: If neither `home` nor `start` chooses the assembly mode.

    Example:
        >>> chain = sst_pin.robots.four_bar()
        >>> base = sst_pin.identification.base_parameters(chain)
        >>> motion = sst_pin.identification.excitation(chain, base, 3.0, tries=3)
        >>> bool(np.abs(motion.va[[0, -1]]).max() < 1e-3)
        True
    """
    require_robot("chain", chain)
    period = positive_number("duration", duration)
    sample_time = positive_number("dt", dt)
    if period > _MOST * sample_time:
        problem = f"at most {_MOST:g} samples of {sample_time:g} s"
        raise InputError("duration", f"{problem}; give a shorter duration or a larger dt")
    count = whole_number("harmonics", harmonics, 2)
    tries = whole_number("tries", tries, 1)
    random = np.random.default_rng(whole_number("seed", seed, 0))
    series = _Series(chain, period, count, placed(chain.engine, {}, start), rates, torques)
    best = _search(chain, base, series, tries, random, sample_time)
    if best is None:
        raise InputError("start", "no motion about it stays within the limits")
    if best.condition > _POOR:
        cure = "allow larger rates or torques, more tries or harmonics, or fewer parameters"
        problem = f"the motion shows the parameters poorly: condition number {best.condition:.3g}"
        warn_caller(f"{problem}; {cure}", RuntimeWarning)
    return best.motion


class _Best(NamedTuple):
    """The best motion of a search."""

    condition: float  #: Its condition number.
    coefficients: Array  #: Coefficients of its series.
    motion: Trajectory


def _search(
    chain: ClosedChain,
    base: BaseParameters,
    series: _Series,
    tries: int,
    random: np.random.Generator,
    dt: float,
) -> _Best | None:
    """The motion with the smallest condition number of some tries; None if no series is possible.

    The first tries are random series. The others are random steps from the best series so far; the
    steps become shorter from try to try, down to almost zero.
    """
    sizes = _sizes(chain, base)
    coarse_step = series.period / (_SAMPLES * series.harmonics)
    best: _Best | None = None
    for k in counted(range(tries), "excitation", tries):
        # The sum of all harmonics has about the same size for any number of them.
        z = np.asarray(random.normal(size=series.shape) / series.harmonics)
        if k >= tries * _RANDOM_TRIES and best is not None:
            # z has entries of about 1 / harmonics: with the factor `harmonics` the size of the step
            # does not depend on their number.
            largest = np.abs(best.coefficients).max()
            step = _FIRST_STEP * largest * series.harmonics * (1 - k / tries)
            z = best.coefficients + step * z
        candidate = series.within_limits(z, _FACTORS, coarse_step)
        if candidate is None:
            continue
        condition = _condition(chain, base, sizes, candidate.motion)
        if condition >= (np.inf if best is None else best.condition):
            continue
        # A limit may be exceeded between coarse samples: check those of the result, and scale down.
        final = series.within_limits(candidate.coefficients, _FINAL_FACTORS, dt)
        if final is not None:
            best = _Best(condition, candidate.coefficients, final.motion)
    return best


class _Candidate(NamedTuple):
    """A motion within the limits, and the coefficients z of its series."""

    coefficients: Array
    motion: Trajectory


class _Series:
    """Fourier series of the coordinates that begin and end at rest at the first configuration.

    The position of a coordinate is its start plus the sum of a_k sin(w_k t) + b_k cos(w_k t). At
    the ends, this sum, its rate and its acceleration must be zero. At t = 0, and so at the end of
    the period, they are sum b_k, sum w_k a_k and -sum w_k^2 b_k. These conditions are linear in a
    and b, so (a, b) = B z with a basis B of their null space and any coefficients z.

    Attributes:
        period: Duration, [s].
        harmonics: Number of harmonics w_k.
        shape: Shape of the coefficients z, with a column for each coordinate.
    """

    def __init__(
        self,
        chain: ClosedChain,
        period: float,
        count: int,
        first: Array,
        rates: ArrayLike | None,
        torques: ArrayLike | None,
    ) -> None:
        from scipy.linalg import null_space  # takes as long to import as all else

        mechanism = chain.mechanism
        model = mechanism.model
        self.period = period
        self.harmonics = count
        self._chain = chain
        self._first = first
        #: Angular frequencies of the harmonics.
        self._frequencies = 2 * np.pi * np.arange(1, count + 1) / period
        # The three conditions at the ends as rows: factors of all a_k, then of all b_k.
        zero = np.zeros(count)
        one = np.ones(count)
        position = [*zero, *one]
        rate = [*self._frequencies, *zero]
        acceleration = [*zero, *self._frequencies**2]
        conditions = np.array([position, rate, acceleration])
        #: B, shape (2 harmonics, 2 harmonics - 3).
        self._basis = null_space(conditions / np.abs(conditions).max(axis=1, keepdims=True))
        self.shape = (self._basis.shape[1], len(chain.coordinates))
        #: Units of the coordinates, shape (n,): 1 rad or the robot's length. z is free of units.
        self._units = mechanism.rate_scale[mechanism.coordinates]
        self._start = positions_of(mechanism.space, first, chain.coordinates)
        #: Largest rates of the coordinates, shape (n,).
        self._fastest = _limits("rates", rates, model.velocityLimit[mechanism.coordinates])
        # Forces that have limits: their factors from the motor torques, shape (k, motors), and the
        # largest forces, shape (k,).
        if torques is None:
            self._factors = mechanism.effort_factors
            self._strongest = _limits("torques", None, mechanism.effort_limits)
        else:  # the caller's limits are limits of the torques themselves
            motors = len(chain.motor_names)
            self._factors = np.eye(motors)
            self._strongest = one_or_each("torques", torques, motors)

    def within_limits(self, z: Array, factors: Iterable[float], step: float) -> _Candidate | None:
        """The series with the first factor that keeps all limits; None if none does.

        Args:
            z: Coefficients, of shape `shape`.
            factors: Factors of the coefficients, tried in this order.
            step: Time between samples of the motion, [s].
        """
        for factor in factors:
            with suppress(SSTError):  # the motion meets a singular configuration, or loops open
                motion = self._sampled(factor * z, step)
                if self._allows(motion):
                    return _Candidate(factor * z, motion)
        return None

    def _sampled(self, z: Array, step: float) -> Trajectory:
        """The motion of the robot for coefficients z of shape `shape`."""
        t = np.linspace(0, self.period, max(round(self.period / step), 3) + 1)
        phases = np.outer(t, self._frequencies)
        waves = np.hstack([np.sin(phases), np.cos(phases)])
        x = self._start + (waves @ self._basis @ z) * self._units
        return coordinate_motion(self._chain, t, x, self._first)

    def _allows(self, motion: Trajectory) -> bool:
        """Whether a motion keeps the limits of positions, rates and torques."""
        model = self._chain.mechanism.model
        low = model.lowerPositionLimit
        high = model.upperPositionLimit
        unlimited = low >= high
        positions_allowed = unlimited | ((low <= motion.q) & (motion.q <= high))
        rates_allowed = np.abs(motion.va) <= self._fastest
        forces_allowed = np.abs(motion.tau @ self._factors.T) <= self._strongest
        return bool(positions_allowed.all() and rates_allowed.all() and forces_allowed.all())


def _limits(name: str, values: ArrayLike | None, model: Array) -> Array:
    """Largest values by the caller, one or each, or else by the model, in which 0 is unknown."""
    if values is None:
        return np.where(model > 0, model, np.inf)
    return one_or_each(name, values, len(model))
