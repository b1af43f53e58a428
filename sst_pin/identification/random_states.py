# SPDX-License-Identifier: BSD-2-Clause
"""Random states of a robot: assembled, within limits, away from singularities."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from ..arrays import Array, whole_number
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import ClosureError, SingularConfigurationError
from ..model.conventions import EARTH_GRAVITY

#: Largest condition number of a random configuration; see `_largest_condition_number`.
_REGULAR = 1e2
#: Standard deviation of the steps of coordinates in a random motion, [rad] or robot lengths: short
#: steps stay in the assembly mode.
_STEP = 0.1
#: Number of equal steps of a random motion.
_STEPS = 3
#: A random motion to a configuration that is not good is tried with this number of lengths, each
#: half of the one before.
_LENGTHS = 6
#: Largest number of random motions for each configuration that is wanted.
_MOTIONS = 20
#: Largest number of tries in the search for a start within the limits.
_TRIES = 100
#: The search ends where the distance of each joint from the middle of its range is below this part
#: of half the range.
_INSIDE = 0.75


def random_states(chain: ClosedChain, count: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """q, va, aa at random assembled configurations of one mode, away from singularities.

    Shapes (count, nq), (count, n), (count, n). A search finds a start that is far from the limits
    of the robot, and the configurations are near this start. If the start is beyond a limit, the
    configurations are at most as far beyond it. They keep all other limits. With these rates and
    accelerations, weights and inertia take torques of about the same size. `seed` is the seed of
    the random numbers.

    Raises:
        ClosureError: If too few configurations nearby are assembled, regular and within limits.

    Example:
        >>> chain = sst_pin.robots.four_bar()
        >>> q, va, aa = sst_pin.identification.random_states(chain, 5)
        >>> q.shape, va.shape
        ((5, 3), (5, 1))
    """
    require_robot("chain", chain)
    random = np.random.default_rng(whole_number("seed", seed, 0))
    mechanism = chain.mechanism
    count = whole_number("count", count, 1)
    units = mechanism.rate_scale[mechanism.coordinates]
    start = _within_limits(chain, chain.generic_configuration(), random)
    largest = _largest_condition_number(chain, start)
    allowed = _beyond_limits(chain, start)

    def is_good(q: Array) -> bool:
        """Whether q is regular, and no joint is farther beyond a limit than at the start."""
        if not chain.condition_number(q) < largest:
            return False
        excess = _beyond_limits(chain, q)
        return all(excess[joints] <= allowed.get(joints, 0.0) for joints in excess)

    configurations = list[Array]()
    for _ in range(_MOTIONS * count):
        step = _STEP * random.normal(size=len(units)) * units
        q = _good_end(chain, start, step, is_good)
        if q is not None:
            configurations.append(q)
        if len(configurations) == count:
            break
    if len(configurations) < count:
        text = f"only {len(configurations)} of {count} random configurations are assembled, "
        text += "regular and within limits; use configurations of your own"
        raise ClosureError(text, float("inf"))

    # Rates and accelerations of a robot that gravity moves over its length l: v^2 / l = g.
    per_second_squared = EARTH_GRAVITY / mechanism.length
    va, aa = random.normal(size=(2, count, len(units))) * units
    return np.array(configurations), va * np.sqrt(per_second_squared), aa * per_second_squared


def _good_end(
    chain: ClosedChain, start: Array, step: Array, is_good: Callable[[Array], bool]
) -> Array | None:
    """The configuration after a step of the coordinates, or half of it, and so on, that is good.

    The longest good one of `_LENGTHS` steps is returned; None if none is good.
    """
    for _ in range(_LENGTHS):
        q = _moved(chain, start, step)
        if q is not None and is_good(q):
            return q
        step = step / 2
    return None


def _largest_condition_number(chain: ClosedChain, start: Array) -> float:
    """The largest condition number that is allowed near a start.

    A robot with a large condition number at its start has large ones elsewhere too.
    """
    return max(_REGULAR, 2 * float(chain.condition_number(start)))


def _moved(chain: ClosedChain, start: Array, step: Array) -> Array | None:
    """The configuration after `_STEPS` steps of the coordinates; None if loops do not close."""
    q = start
    try:
        for _ in range(_STEPS):
            ahead = pin.integrate(chain.mechanism.model, q, chain.joint_rates(q, step))
            q = chain.assemble(ahead, fixed=())
    except (ClosureError, SingularConfigurationError):
        return None
    return q


def _beyond_limits(chain: ClosedChain, q: Array) -> dict[tuple[str, ...], float]:
    """How far joints are beyond their limits at q, [rad] or [m]; the keys are `Finding.joints`."""
    excess = dict[tuple[str, ...], float]()
    for finding in chain.check_limits(q):
        if not finding.singular:
            low, high = finding.limits
            value = float(finding.values[0])
            excess[finding.joints] = max(low - value, value - high)
    return excess


def _within_limits(chain: ClosedChain, start: Array, random: np.random.Generator) -> Array:
    """A configuration near the middle of the limits, in the assembly mode of the start.

    It follows random motions that lead towards the middle.
    """
    mechanism = chain.mechanism
    low = mechanism.model.lowerPositionLimit
    high = mechanism.model.upperPositionLimit
    limited = np.isfinite(low) & np.isfinite(high) & (high > low)
    if not limited.any():
        return start
    low = low[limited]
    high = high[limited]
    units = mechanism.rate_scale[mechanism.coordinates]
    best = start
    largest = _largest_condition_number(chain, start)

    def distance(q: Array) -> float:
        """The largest distance of a joint from the middle of its range; 1 is at a limit."""
        # Each term is halved, as a difference of large limits may overflow.
        middle = high / 2 + low / 2
        half = high / 2 - low / 2
        return float((np.abs(q[limited] - middle) / half).max())

    for _ in range(_TRIES):
        if distance(best) < _INSIDE:
            break
        q = _moved(chain, best, _STEP * random.normal(size=len(units)) * units)
        if q is None or not chain.condition_number(q) < largest:  # NaN is not regular
            continue
        if distance(q) < distance(best):
            best = q
    return best
