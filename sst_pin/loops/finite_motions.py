# SPDX-License-Identifier: BSD-2-Clause
"""Which rates that Phi allows at a closed pose belong to motions, and which lead to no other pose.

Rates v with Phi v = 0 keep the loops closed to first order. If a motion begins with them, then
accelerations a with Phi a = -Phi_dot v exist, Eq. (8). Where rows of Phi are independent, they
always do. Where rows are redundant they may not, as in three parallel bars of different lengths
between two bodies, or in two bars in one line: the velocities look free, but nothing moves. Such
rates only shake the pose.

If accelerations exist for random rates, all rates are taken to belong to motions. Otherwise the
robot is moved along each of them, its loops are closed again, and the poses are compared.
"""

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import ClosureError
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE, INCONSISTENT
from .assembly import Assembly
from .guesses import random_step
from .ranks import free_motions, rank_of, scaled_Phi

#: Lengths of the steps along rates, [rad] or lengths of the loop. Shorter ones are tried if the
#: loops do not close again.
_LENGTHS = (0.05, 0.01, 0.002)
#: Rates belong to a motion if more than this part of a step along them remains after the loops are
#: closed again. Where rates only shake a pose, closing returns to this pose: at most 1e-3 of the
#: step remain. Along motions closing changes the step by about its length squared.
_REMAINS = 0.5


def finite_motions(assembly: Assembly, q: Array, rates: Indices | None = None) -> Array:
    """Orthonormal rates, without units, of the motions from a closed pose q, shape (nv, k).

    Only `rates` move, by default all. At a pose where several motions branch, the rates of all
    branches count.
    """
    nv = assembly.mechanism.model.nv
    if rates is None:
        rates = np.arange(nv)
    Phi = scaled_Phi(assembly.mechanism, assembly.loops, q)[:, rates]
    allowed_of_rates = free_motions(Phi)
    allowed = np.zeros((nv, allowed_of_rates.shape[1]))
    allowed[rates] = allowed_of_rates
    if has_accelerations(assembly, Phi, allowed):  # the loops are still at q
        return allowed
    directions = _random_basis(assembly.mechanism, allowed)
    # Column k: what remains of a step along direction k, in the basis of the directions. A
    # direction mixes motions and rates that only shake the pose. Closing the loops removes the
    # latter, so the matrix is about the projection on the motions. Its singular values are near 1
    # or 0, and U begins with a basis of the motions. Where several motions branch, random
    # directions close onto different branches, and the columns of all of them count.
    remaining = np.zeros((directions.shape[1], directions.shape[1]))
    for k, direction in enumerate(directions.T):
        remaining[:, k] = directions.T @ _remaining_step(assembly, q, direction, rates)
    U, sizes, _ = np.linalg.svd(remaining)
    return np.asarray(directions @ U[:, : np.count_nonzero(sizes > _REMAINS)])


def _random_basis(mechanism: Mechanism, rates: Array) -> Array:
    """Another orthonormal basis of the space of some rates, shape (nv, k).

    The basis from an SVD depends on rounding where singular values are equal, as in a null space.
    This one depends on the space only: random displacements, which are the same for the same names
    of joints, are projected on it.
    """
    count = rates.shape[1]
    random = [random_step(mechanism, 1 + k / 100) / mechanism.rate_scale for k in range(count)]
    basis, _ = np.linalg.qr(rates @ (rates.T @ np.transpose(random)))
    return np.asarray(basis)


def has_accelerations(assembly: Assembly, Phi: Array, motions: Array) -> bool:
    """Whether Phi a = -Phi_dot v has a solution a for random rates v along the motions.

    It has one if Phi_dot v vanishes along the left null space of Phi. Phi, free of units, has the
    columns of the rates that move. `assembly.loops` must be evaluated at its configuration.
    """
    mechanism = assembly.mechanism
    loops = assembly.loops
    U, sizes, _ = np.linalg.svd(Phi)
    null_space = U[:, rank_of(sizes) :]
    if not null_space.shape[1] or not motions.shape[1]:
        return True
    v = motions @ (motions.T @ (random_step(mechanism, 1.0) / mechanism.rate_scale))
    v /= np.linalg.norm(v)
    drift = loops.drift(v * mechanism.rate_scale) * mechanism.row_scale  # Phi_dot v
    bound = INCONSISTENT * CLOSURE_TOLERANCE * sizes.max(initial=1.0)
    return bool(np.abs(null_space.T @ drift).max() <= bound)


def _remaining_step(assembly: Assembly, q: Array, direction: Array, rates: Indices) -> Array:
    """What remains of a step along a direction when the loops are closed again, shape (nv,).

    It is relative to the length of the step; zero if the loops do not close after any step.
    """
    mechanism = assembly.mechanism
    model = mechanism.model
    scale = mechanism.rate_scale
    for length in _LENGTHS:
        guess = pin.integrate(model, q, length * direction * scale)
        try:
            closed = assembly.assemble(guess, rates)
        except ClosureError:
            continue
        return np.asarray(pin.difference(model, q, closed) / scale / length)
    return np.zeros(model.nv)
