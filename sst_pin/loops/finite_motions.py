# SPDX-License-Identifier: BSD-2-Clause
"""Which rates that Phi allows at a closed pose belong to motions, and which lead to no other pose.

Rates v with Phi v = 0 keep the loops closed to first order. If a motion begins with these rates,
then accelerations a with Phi a = -Phi_dot v exist, Eq. (8). If the rows of Phi are independent,
they always exist. If rows are redundant, they may not exist: two bars in one line between fixed
points have a free rate across the line, but cannot move. Such rates are called *shaking*.

`finite_motions` tests this in two ways. `has_accelerations` looks for accelerations for random
rates. If they exist, all rates are taken to belong to motions. Otherwise the robot is moved along
each rate, its loops are closed again, and what remains of the step is a motion.
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

#: Lengths of the steps along rates, [rad] or lengths of the loop. A shorter one is tried if the
#: loops do not close again.
_LENGTHS = (0.05, 0.01, 0.002)
#: Rates belong to a motion if more than this part of a step along them remains after the loops are
#: closed again. Along a motion, closing changes a step of length x by about x^2, at most a
#: twentieth of the step. Along shaking rates, closing leads back to the pose, up to some 3e-6, the
#: square root of the error of closed loops: at most 2e-3 of the step remain.
_REMAINS = 0.5


def finite_motions(assembly: Assembly, q: Array, rates: Indices | None = None) -> Array:
    """Orthonormal rates, free of units, that span the motions from a closed pose q, shape (nv, k).

    Only the rates with the indices `rates` move, by default all. At a pose where several motions
    branch, the result spans the rates of all branches.
    """
    nv = assembly.mechanism.model.nv
    if rates is None:
        rates = np.arange(nv)
    Phi = scaled_Phi(assembly.mechanism, assembly.loops, q)[:, rates]
    allowed_of_rates = free_motions(Phi)
    allowed = np.zeros((nv, allowed_of_rates.shape[1]))  # the other rates are zero
    allowed[rates] = allowed_of_rates
    if has_accelerations(assembly, Phi, allowed):  # the loops are still at q
        return allowed

    # Each direction mixes motions and shaking rates. Closing the loops after a step removes its
    # shaking part. So the matrix P, which takes directions to what remains of them, is about the
    # projection on the motions: its singular values are near 1 or 0, and the columns of U for those
    # near 1 span the motions. Where several motions branch, random directions close onto different
    # branches, so that the columns of P span all of them.
    directions = _random_basis(assembly.mechanism, allowed)
    P = np.zeros((directions.shape[1], directions.shape[1]))  # in the basis of the directions
    for k, direction in enumerate(directions.T):
        P[:, k] = directions.T @ _remaining_step(assembly, q, direction, rates)
    U, sizes, _ = np.linalg.svd(P)
    return np.asarray(directions @ U[:, : np.count_nonzero(sizes > _REMAINS)])


def _random_basis(mechanism: Mechanism, rates: Array) -> Array:
    """An orthonormal basis of the space that orthonormal rates span, shape (nv, k).

    It consists of projections of random steps on the space, which depend on the names of the joints
    only. The basis of a null space that comes from an SVD depends on rounding instead.
    """
    count = rates.shape[1]
    steps = [random_step(mechanism, 1 + k / 100) / mechanism.rate_scale for k in range(count)]
    projections = rates @ (rates.T @ np.transpose(steps))
    basis, _ = np.linalg.qr(projections)
    return np.asarray(basis)


def has_accelerations(assembly: Assembly, Phi: Array, allowed: Array) -> bool:
    """Whether Phi a = -Phi_dot v has a solution a for random rates v that Phi allows.

    It has one if N^T Phi_dot v = 0, where the columns of N span the left null space of Phi.

    Args:
        assembly: Newton's method; its loops must be evaluated at the configuration.
        Phi: Phi, free of units, in the columns of the rates that move.
        allowed: Orthonormal rates with Phi v = 0, free of units, shape (nv, k).
    """
    mechanism = assembly.mechanism
    loops = assembly.loops
    U, sizes, _ = np.linalg.svd(Phi)
    N = U[:, rank_of(sizes) :]
    if not N.shape[1] or not allowed.shape[1]:
        return True
    v = allowed @ (allowed.T @ (random_step(mechanism, 1.0) / mechanism.rate_scale))
    v /= np.linalg.norm(v)
    drift = loops.drift(v * mechanism.rate_scale) * mechanism.row_scale  # Phi_dot v
    # The loops are closed to `CLOSURE_TOLERANCE` at least, which makes errors of this size.
    bound = INCONSISTENT * CLOSURE_TOLERANCE * sizes.max(initial=1.0)
    return bool(np.abs(N.T @ drift).max() <= bound)


def _remaining_step(assembly: Assembly, q: Array, direction: Array, rates: Indices) -> Array:
    """What remains of a step along a direction after the loops are closed again, shape (nv,).

    It is divided by the length of the step, and free of units. It is zero if the loops do not close
    after a step of any length.
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
