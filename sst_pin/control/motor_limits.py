# SPDX-License-Identifier: BSD-2-Clause
"""Limits of the motors that hold for any preload.

The part of a torque in its limits is the torque normalised to the range from -1 to 1,

    p = (2 tau - largest - least) / (largest - least).

Surplus motors can add a preload N x to tau, with any x. The k columns of N are the directions of
preload. The parts become p + D x, with D = 2 N / (largest - least).

A sum c^T p does not depend on the preload if c^T D = 0. For each choice of k + 1 motors there is
one such c that is zero for all other motors; its entries are minors of D. By Farkas' lemma, a
preload that keeps all |p| <= 1 exists if and only if |c^T p| <= sum of |c_i| for each of these c.
So limits of torques become limits of these sums, in which the preload does not appear. The entries
of c are called the factors of a sum.
"""

import itertools

import numpy as np

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import InputError

#: The largest number of sums: a binomial coefficient, which soon exceeds all memory.
_MOST = 10_000
#: A row of factors smaller than this part of the largest row counts as zero: the other rows imply
#: its limit.
_ZERO = 1e-6


def part_of(tau: Array, limits: Array) -> Array:
    """Parts p of torques, shape (..., motors), in their limits, shape (motors, 2)."""
    return (2 * tau - limits.sum(axis=1)) / np.ptp(limits, axis=1)


def factors_of_sums(directions: Array, limits: Array) -> Array:
    """Factors c of the sums that no preload changes, shape (..., sums, motors).

    They are continuous where the directions are. Without surplus motors they are the identity.

    Args:
        directions: Directions N of preload, shape (..., motors, k).
        limits: Least and largest torques, shape (motors, 2).
    """
    motors, k = directions.shape[-2:]
    groups = list(itertools.combinations(range(motors), k + 1))  # one sum for each
    if len(groups) > _MOST:
        raise InputError("chain", f"{motors} motors, {k} of them surplus, are too many for limits")
    D = 2 * directions / np.ptp(limits, axis=1)[:, None]
    factors = np.zeros((*directions.shape[:-2], len(groups), motors))
    for row, group in enumerate(groups):
        for i, motor in enumerate(group):
            # The minor of D without this motor, with alternating signs: then c^T D = 0.
            others = [*group[:i], *group[i + 1 :]]
            factors[..., row, motor] = (-1) ** i * np.linalg.det(D[..., others, :])
    return factors


def sums_of(factors: Array, parts: Array) -> Array:
    """c^T p / sum of |c_i| for parts of shape (..., motors), shape (..., sums); within -1 and 1."""
    return normalised(np.einsum("...rm,...m->...r", factors, parts), factors)


def normalised(sums: Array, factors: Array) -> Array:
    """Sums c^T p, shape (..., sums), divided by the sum of |c_i|; 0 where c is 0."""
    sizes = np.abs(factors).sum(axis=-1)
    zero = sizes <= _ZERO * sizes.max(axis=-1, keepdims=True, initial=0.0)
    return np.where(zero, 0.0, sums / np.where(zero, 1.0, sizes))


def largest_part(tau: Array, directions: Array, limits: Array) -> Array:
    """The largest part of a motor's limits that torques take with the best preload, shape (...).

    Above 1 the motors cannot give the torques.
    """
    sums = sums_of(factors_of_sums(directions, limits), part_of(tau, limits))
    return np.abs(sums).max(axis=-1, initial=0.0)


def motors_of(chain: ClosedChain, factors: Array) -> list[str]:
    """Names of the motors in a sum, by its factors, shape (motors,)."""
    return [chain.motor_names[k] for k in np.flatnonzero(factors)]
