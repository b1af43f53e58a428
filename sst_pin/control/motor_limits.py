# SPDX-License-Identifier: BSD-2-Clause
"""Limits of the motors that hold for any preload.

A torque is given as a part of its limits: -1 is the least torque, 1 the largest. With surplus
motors a preload changes these parts, but not certain weighted sums of them (`combinations`). Each
sum has one motor more than there are directions of preload. A preload that keeps all motors within
their limits exists if no sum exceeds the sum of the absolute values of its factors.
"""

import itertools

import numpy as np

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import InputError

#: The largest number of combinations.
_MOST = 10_000
#: A row of factors smaller than this part of the largest row counts as zero: the other rows imply
#: its limit.
_ZERO = 1e-6


def part_of(tau: Array, limits: Array) -> Array:
    """Torques, shape (..., motors), as parts of their limits: -1 is the least, 1 the largest."""
    return (2 * tau - limits.sum(axis=1)) / np.ptp(limits, axis=1)


def combinations(directions: Array, limits: Array) -> Array:
    """Factors of the sums of parts that no preload changes, shape (..., sums, motors).

    They are minors of the directions of preload, so they are continuous where these are. Without
    surplus motors they are the identity.
    """
    motors, k = directions.shape[-2:]
    chosen = list(itertools.combinations(range(motors), k + 1))
    if len(chosen) > _MOST:
        raise InputError("chain", f"{motors} motors, {k} of them surplus, are too many for limits")
    parts = 2 * directions / np.ptp(limits, axis=1)[:, None]
    factors = np.zeros((*directions.shape[:-2], len(chosen), motors))
    for row, group in enumerate(chosen):
        for i, motor in enumerate(group):
            minor = parts[..., [*group[:i], *group[i + 1 :]], :]
            factors[..., row, motor] = (-1) ** i * np.linalg.det(minor)
    return factors


def sums_of(factors: Array, parts: Array) -> Array:
    """Sums of parts, shape (..., motors), divided by the sizes of their factors, (..., sums)."""
    return of_sizes(np.einsum("...rm,...m->...r", factors, parts), factors)


def of_sizes(sums: Array, factors: Array) -> Array:
    """Sums, shape (..., sums), divided by the sizes of their factors; 0 where these are 0."""
    sizes = np.abs(factors).sum(axis=-1)
    zero = sizes <= _ZERO * sizes.max(axis=-1, keepdims=True, initial=0.0)
    return np.where(zero, 0.0, sums / np.where(zero, 1.0, sizes))


def largest_part(tau: Array, directions: Array, limits: Array) -> Array:
    """The largest part of a motor's limits that torques take with the best preload, shape (...).

    More than 1 is more than the motors can give.
    """
    sums = sums_of(combinations(directions, limits), part_of(tau, limits))
    return np.abs(sums).max(axis=-1, initial=0.0)


def motors_of(chain: ClosedChain, factors: Array) -> list[str]:
    """Names of the motors that a combination joins, by its factors, shape (motors,)."""
    return [chain.motor_names[k] for k in np.flatnonzero(factors)]
