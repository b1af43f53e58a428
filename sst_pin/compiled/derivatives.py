# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives along the motions that keep the loops closed, on CasADi's symbols.

The lines of docs/derivatives.md: partial derivatives on the tree, where q, v, v_dot and the forces
of the closures are independent, are CasADi's; the loops are differentiated implicitly, by the one
factorisation of Phi_u that all else uses.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
from casadi import SX

from .elimination import total
from .equations import Equations
from .symbols import Sparse, add, is_zero, solve_symmetric, sx


def of_torques(e: Equations) -> tuple[SX, SX, SX]:
    """Derivatives of f by q, va and aa, shapes (n, n), at a motion (q, va, aa)."""
    by_q, by_va = _of_forces(e, e.aa, {})
    return by_q, by_va, e.inertia


def of_accelerations(e: Equations, tau: SX) -> tuple[SX, SX, SX, list[Any]]:
    """Derivatives of aa by q, va and tau, and one over each pivot of the inertia matrix."""
    aa, inverses = e.accelerations(tau)
    by_q, by_va = _of_forces(e, aa, e.motor_forces(tau))
    right = ca.horzcat(-by_q, -by_va, e.motor_matrix)
    aa_x, _ = solve_symmetric(e.inertia, right)
    n = len(e.L)
    return aa_x[:, :n], aa_x[:, n : 2 * n], aa_x[:, 2 * n :], inverses


def of_displacements(e: Equations) -> SX:
    """-S [v, L e_k], shape (n, n): what moving axes of joints do to a displacement xi."""
    nv, n = e.mechanism.model.nv, len(e.L)
    moved = SX(nv, n)
    for link in e.kinematics.tree.links:
        S = sx(link.S)
        own = _column(e.v, nv)[list(link.v)]
        if len(link.v) > 1:
            for k, L in enumerate(e.L):
                bracket = _bracket(S @ own, S @ _column(L, nv)[list(link.v)])
                moved[list(link.v), k] = S.T @ bracket
    return -moved[e.mechanism.coordinates.tolist(), :]


def _bracket(a: SX, b: SX) -> SX:
    """Lie bracket of two twists [linear; angular]."""
    linear = ca.cross(a[3:], b[:3]) + ca.cross(a[:3], b[3:])
    return ca.vertcat(linear, ca.cross(a[3:], b[3:]))


def _of_forces(e: Equations, aa: SX, motors: Sparse) -> tuple[SX, SX]:
    """Derivatives of f - L^T motors by q and va, at given aa and given forces of motors."""
    nv = e.mechanism.model.nv
    v_dot = e.complete(ca.vertsplit(aa), e.drift)
    force = add(e.forces(v_dot), {i: -x for i, x in motors.items()})
    velocity_q, c_q, c_v, force_q, force_v = _partials(e, v_dot, e.multipliers(force))
    L = ca.horzcat(*(_column(x, nv) for x in e.L))
    M = SX(nv, nv)
    for (i, j), entry in e.tree_inertia.items():
        M[i, j] = M[j, i] = entry
    of_c = _times_G(e, L.T @ M)
    by_v = L.T @ force_v - of_c @ c_v
    by_q = L.T @ force_q - of_c @ c_q - _times_G(e, by_v) @ velocity_q
    return by_q @ L, by_v @ L


def _partials(e: Equations, v_dot: Sparse, reactions: Mapping[int, Any]) -> list[SX]:
    """On the tree: of Phi v by q, of c = Phi v_dot + Phi_dot v by q and v, of the forces likewise.

    The forces are those of the tree less Phi^T reactions, which are held. Derivatives by q are
    taken along each rate.
    """
    nv, rows, twin = e.mechanism.model.nv, e.factors.rows, e.displaced
    displacement = twin.kinematics.displacement
    V, A, R = SX.sym("v", nv), SX.sym("v_dot", nv), SX.sym("reactions", len(rows))
    v, a = {i: V[i] for i in e.v}, {i: A[i] for i in v_dot}
    held: Sparse = {}
    velocities, accelerations = [], []
    for k, row in enumerate(twin.rows[i] for i in rows):
        velocities.append(SX(_of_row(row.Phi, v)))
        accelerations.append(_of_row(row.Phi, a) + row.drift(v))
        held = add(held, {j: -(x * R[k]) for j, x in row.Phi.items()})
    velocity, c = ca.vertcat(*velocities), ca.vertcat(*accelerations)
    taken = add(twin.tree_forces(v, a), add(twin.friction(v), add(twin.springs, held)))
    force = _column(taken, nv)
    results = [ca.jacobian(x, displacement) for x in (velocity, c, force)]
    results[2:2] = [ca.jacobian(c, V)]
    results.append(ca.jacobian(force, V))
    inputs = [twin.q, displacement, V, A, R, twin.p, twin.loads]
    function = ca.Function("partials", inputs, results)
    now = [_column(e.v, nv), _column(v_dot, nv), ca.vertcat(*(reactions.get(i, 0) for i in rows))]
    return list(function.call([e.q, SX(nv, 1), *now, e.p, e.loads]))


def _of_row(Phi: Sparse, x: Sparse) -> Any:
    return total(entry * x[j] for j, entry in Phi.items() if j in x)


def _times_G(e: Equations, X: SX) -> SX:
    """X G, row by row: Phi G c = c, no coordinate moves; shape (k, rows)."""
    rows = []
    for row in ca.vertsplit(X):
        entries = {i: entry for i, entry in enumerate(ca.horzsplit(row)) if not is_zero(entry)}
        x = e.multipliers(entries)
        rows.append(ca.horzcat(*(SX(x.get(i, 0)) for i in e.factors.rows)))
    return ca.vertcat(*rows)


def _column(x: Sparse, size: int) -> SX:
    column = SX(size, 1)
    for i, entry in x.items():
        column[i] = entry
    return column
