# SPDX-License-Identifier: BSD-2-Clause
"""Which rates that Phi allows at a closed pose belong to motions, and which only shake it.

Rates v with Phi v = 0 keep the loops closed to first order. If a motion begins with them, then
accelerations with Phi a = -Phi_dot v exist, Eq. (8). Where rows of Phi are independent, they always
do. Where rows are redundant they may not, as in three parallel bars of different lengths between
two bodies, or in two bars in one line: the velocities look free, but nothing moves.

If accelerations exist for random rates, all rates belong to motions. Otherwise the robot is moved
along each of them, its loops are closed again, and the poses are compared.
"""

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import ClosureError
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE, INCONSISTENT
from .assembly import Assembly
from .guesses import displacement
from .ranks import free_motions, rank_of, scaled_Phi

#: Length of the motions along rates, [rad] or lengths of the loop, the longest first. Shorter ones
#: are tried if the loops do not close again.
_LENGTHS = 0.05, 0.01, 0.002
#: Part of a motion that is left after the loops are closed again. Where rates only shake a pose,
#: closing returns to this pose, by all but 1e-3 of the motion; along motions it changes the pose by
#: about the length of the motion times the motion.
_MOVED = 0.5


def finite_motions(assembly: Assembly, q: Array, rates: Indices | None = None) -> Array:
    """Orthonormal rates, without units, of the motions from a closed pose q, shape (nv, k).

    Only `rates` move, by default all. At a pose where several motions branch, the rates of all
    branches count.
    """
    nv = assembly.mechanism.model.nv
    if rates is None:
        rates = np.arange(nv)
    Phi = scaled_Phi(assembly.mechanism, assembly.loops, q)[:, rates]
    of_rates = free_motions(Phi)
    motions = np.zeros((nv, of_rates.shape[1]))
    motions[rates] = of_rates
    if has_accelerations(assembly, Phi, motions):
        return motions
    directions = _random_basis(assembly.mechanism, motions)
    # Column k: the motion that is left of direction k, in the basis of the directions.
    left = np.zeros((directions.shape[1], directions.shape[1]))
    for k, direction in enumerate(directions.T):
        left[:, k] = directions.T @ _moved(assembly, q, direction, rates)
    U, sizes, _ = np.linalg.svd(left)
    return np.asarray(directions @ U[:, : np.count_nonzero(sizes > _MOVED)])


def _random_basis(mechanism: Mechanism, motions: Array) -> Array:
    """Another orthonormal basis of the motions, by random displacements that depend on names only.

    Projections of displacements on the motions do not depend on the basis that is given.
    """
    count = motions.shape[1]
    random = [displacement(mechanism, 1 + k / 100) / mechanism.rate_scale for k in range(count)]
    basis, _ = np.linalg.qr(motions @ (motions.T @ np.transpose(random)))
    return np.asarray(basis)


def has_accelerations(assembly: Assembly, Phi: Array, motions: Array) -> bool:
    """Whether Phi a = -Phi_dot v has a solution a for random rates v along the motions.

    It has one if Phi_dot v vanishes along the left null space of Phi. Phi, free of units, has the
    columns of the rates that move, at the configuration of `assembly.loops`.
    """
    mechanism, loops = assembly.mechanism, assembly.loops
    U, sizes, _ = np.linalg.svd(Phi)
    null_space = U[:, rank_of(sizes) :]
    if not null_space.shape[1] or not motions.shape[1]:
        return True
    v = motions @ (motions.T @ (displacement(mechanism, 1.0) / mechanism.rate_scale))
    v /= np.linalg.norm(v)
    drift = loops.drift(v * mechanism.rate_scale) * mechanism.row_scale  # Phi_dot v
    bound = INCONSISTENT * CLOSURE_TOLERANCE * sizes.max(initial=1.0)
    return bool(np.abs(null_space.T @ drift).max() <= bound)


def _moved(assembly: Assembly, q: Array, direction: Array, rates: Indices) -> Array:
    """The motion, relative to its length, that is left after a step is corrected, shape (nv,)."""
    mechanism = assembly.mechanism
    model, scale = mechanism.model, mechanism.rate_scale
    for length in _LENGTHS:
        guess = pin.integrate(model, q, length * direction * scale)
        try:
            closed = assembly.assemble(guess, rates)
        except ClosureError:
            continue
        return np.asarray(pin.difference(model, q, closed) / scale / length)
    return np.zeros(model.nv)
