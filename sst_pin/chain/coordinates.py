# SPDX-License-Identifier: BSD-2-Clause
"""The choice of the coordinates, made once, when a robot is made.

It depends on the robot alone: random displacements are drawn for each joint by its name, and ties
are decided by names, so that neither the order of the joints nor the units count.
"""

from __future__ import annotations

from collections.abc import Iterator
from zlib import crc32

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import ClosureError, SSTError
from .assembly import Assembly, home_of
from .dynamics import Memory
from .mechanism import Mechanism
from .mobility import choose_coordinates, free_motions, scaled_Phi
from .noc import body_jacobians
from .thresholds import INDEPENDENT

#: Widths of the random displacements from home or `pin.neutral`, [rad] or robot lengths.
_AROUND_HOME, _AROUND_NEUTRAL = (0.1, 0.03, 0.01), np.linspace(0.1, 2.0, 20)
#: An inertia that is smaller than this part of what its bodies have is rounding.
_ROUNDING = 1e-13


def examples(assembly: Assembly) -> Iterator[Array]:
    """Assembled configurations without symmetry, the same at each call.

    They lie close to `home` if the robot has one, because other assemblies can have other degrees
    of freedom; otherwise around `pin.neutral`. The error is that of the guess that came nearest.
    """
    mechanism = assembly.mechanism
    model, home = mechanism.model, home_of(mechanism)
    starts = [(pin.neutral(model), width) for width in _AROUND_NEUTRAL]
    if home is not None:
        starts = [(home, width) for width in _AROUND_HOME] + starts
    failures, found = [], False
    for start, width in starts:
        if found and home is not None and start is not home:
            return
        way = width * _displacement(mechanism, seed=round(1000 * width))
        guess, rates = pin.integrate(model, start, way), np.arange(model.nv)
        # Motors that stay where they are lead to assemblies in which they hold the robot.
        for free in (np.setdiff1d(rates, mechanism.driven), rates):
            try:
                q = assembly.assemble(guess, free)
            except ClosureError as error:
                failures.append(error)
            else:
                found = True
                yield q
                break
    if not found:
        raise min(failures, key=lambda error: error.residual)


def _displacement(mechanism: Mechanism, seed: int) -> Array:
    """Random rates of the tree, drawn joint by joint from the joint's name, shape (nv,)."""
    way = np.zeros(mechanism.model.nv)
    for name, rates in mechanism.space.rates.items():
        random = np.random.default_rng([seed, crc32(name.encode())])
        way[rates] = random.uniform(-1.5, 1.5, len(rates))
    return way * mechanism.rate_scale


def settle(assembly: Assembly, wanted: Indices | None) -> tuple[Indices, Array | None]:
    """Indices in v of the coordinates, and the configuration where they were judged, or None.

    The order of preference: the coordinates `wanted`; the motors' joints, as many as are
    independent; other joints by rank. Where there is no home, the assembled configuration counts in
    which the motors hold most; where nothing can be assembled, the motors' joints.
    """
    mechanism = assembly.mechanism
    asked = mechanism.driven if wanted is None else wanted
    best: tuple[tuple[bool, int, int], Array, Array] | None = None
    try:
        for q in examples(assembly):
            Phi = scaled_Phi(mechanism, assembly.loops, q)
            motions = free_motions(Phi)
            values = np.linalg.svd(motions[asked], compute_uv=False)
            held, n = int(np.count_nonzero(values > INDEPENDENT)), motions.shape[1]
            if best is None or (n > 0, held - n, held) > best[0]:
                best = (n > 0, held - n, held), Phi, q
            if 0 < n == held:
                break
    except ClosureError:
        return asked, None
    assert best is not None
    _, Phi, q = best
    return choose_coordinates(mechanism, Phi) if wanted is None else wanted, q


def without_mass(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the coordinates that move no mass, such as the spin of a thin rod between two balls.

    The mass matrix is singular there to rounding, at every configuration.
    """
    q, n = mechanism.example, len(mechanism.coordinates)
    if q is None or not n:
        return ()
    memory = Memory(mechanism)
    try:
        memory.evaluate(q)
        memory.complement.factorise(memory.loops.Phi())
    except SSTError:
        return ()  # coordinates of the caller, for another assembly
    L = memory.complement.L
    # What each coordinate would move if a body turned about its heaviest axis.
    twists = (body_jacobians(memory.model, memory.data) @ L).reshape(-1, 2, 3, n)
    inertias = list(memory.model.inertias)[1:]
    sizes = np.array([(np.trace(body.inertia), body.mass) for body in inertias])
    most = np.einsum("bp,bpin->n", sizes, twists**2) + memory.model.armature @ L**2
    scale = 1 / np.sqrt(np.maximum(np.abs(most), 1e-300))
    inertia = scale[:, None] * memory.reduced_inertia(q, L) * scale
    values, vectors = np.linalg.eigh(inertia)
    idle = np.abs(vectors[:, np.abs(values) < _ROUNDING]).max(axis=1, initial=0.0) > INDEPENDENT
    return tuple(np.array(mechanism.coordinate_rate_names)[idle].tolist())
