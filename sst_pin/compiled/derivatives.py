# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives along the motions that keep the loops closed, on CasADi's symbols.

The lines of docs/derivatives.md: partial derivatives on the tree, where q, v, v_dot and the forces
of the closures are independent, are CasADi's; the loops are differentiated implicitly, by the one
factorisation of Phi_u that all else uses.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import casadi as ca
from casadi import SX

from .closure_rows import Row
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
    nv = e.mechanism.model.nv
    moved = ca.horzcat(*(_column(_brackets(e, e.v, L), nv) for L in e.L))
    return -moved[e.mechanism.coordinates.tolist(), :]


def _brackets(e: Equations, a: Sparse, b: Sparse) -> Sparse:
    """Joint by joint the Lie bracket [a, b] of rates, along the rates."""
    brackets: Sparse = {}
    for link in e.kinematics.tree.links:
        if len(link.v) > 1:
            S = sx(link.S)
            of_a, of_b = (S @ ca.vertcat(*(SX(x.get(k, 0)) for k in link.v)) for x in (a, b))
            brackets |= _entries(link.v, S.T @ _bracket(of_a, of_b))
    return brackets


def _bracket(a: SX, b: SX) -> SX:
    """Lie bracket of two twists [linear; angular]."""
    linear = ca.cross(a[3:], b[:3]) + ca.cross(a[:3], b[3:])
    return ca.vertcat(linear, ca.cross(a[3:], b[3:]))


def _of_forces(e: Equations, aa: SX, motors: Sparse) -> tuple[SX, SX]:
    """Derivatives of f - L^T motors by q and va, at given aa and given forces of motors."""
    v_dot = e.complete(ca.vertsplit(aa), e.drift)
    force = add(e.forces(v_dot), {i: -x for i, x in motors.items()})
    slip_q, c_q, c_v, force_q, force_v = _partials(e, v_dot, e.multipliers(force))
    nv = e.mechanism.model.nv
    L = ca.horzcat(*(_column(x, nv) for x in e.L))
    M = SX(nv, nv)
    for (i, j), entry in e.tree_inertia.items():
        M[i, j] = M[j, i] = entry
    inertial = [e.multipliers(_entries(range(nv), ca.vec(row))) for row in ca.vertsplit(L.T @ M)]
    g = ca.vertcat(*(ca.horzcat(*(SX(x.get(i, 0)) for i in e.factors.rows)) for x in inertial))
    by_q, by_v = L.T @ force_q - g @ c_q, L.T @ force_v - g @ c_v
    lost = _phi_dot_v(e, slip_q @ L, c_v @ L)
    v_q = (e.factors.solve(_entries(e.factors.rows, -x)) for x in ca.horzsplit(lost))
    return by_q @ L + by_v @ ca.horzcat(*(_column(x, nv) for x in v_q)), by_v @ L


def _phi_dot_v(e: Equations, slip_q: SX, c_v: SX) -> SX:
    """Phi_dot v, with Phi_dot along each L e_k, shape (rows, n).

    Where rows hold positions and the loops are closed, c_v L e_k is twice that, but for the bracket
    of L e_k and v.

    Args:
        e: Of the robot.
        slip_q: The same, of rows that hold rates only.
        c_v: c_v L.
    """
    result, brackets = SX(c_v), [_brackets(e, L, e.v) for L in e.L]
    for place, i in enumerate(e.factors.rows):
        row = e.rows[i]
        for k, bracket in enumerate(brackets):
            turned = total(x * bracket[j] for j, x in row.Phi.items() if j in bracket)
            of_position = (c_v[place, k] + turned) / 2
            result[place, k] = slip_q[place, k] if row.residual is None else of_position
    return result


def _partials(e: Equations, v_dot: Sparse, reactions: Sparse) -> list[SX]:
    """On the tree: of Phi v by q, of c = Phi v_dot + Phi_dot v by q and v, of the forces likewise.

    Of Phi v there are those rows only that hold rates and no positions. The forces are those of the
    tree less Phi^T reactions, which are held. Derivatives by q are taken along each rate.
    """
    nv, twin = e.mechanism.model.nv, e.displaced
    rows = [twin.rows[i] for i in e.factors.rows]
    displacement = twin.kinematics.displacement
    V, A, R = SX.sym("v", nv), SX.sym("v_dot", nv), SX.sym("reactions", len(rows))
    v, a = {i: V[i] for i in e.v}, {i: A[i] for i in v_dot}
    twists = partial(twin.kinematics.twist, v=v)
    slips = [row.velocity(v, twists) if row.residual is None else SX(0) for row in rows]
    slip, c = SX(ca.vertcat(*slips)), SX(ca.vertcat(*(row.acceleration(v, a) for row in rows)))
    force = _column(_forces(twin, v, a, rows, ca.vertsplit(R)), nv)
    results = [ca.jacobian(x, displacement) for x in (slip, c, force)]
    results[2:2] = [ca.jacobian(c, V)]
    results.append(ca.jacobian(force, V))
    inputs = [twin.q, displacement, V, A, R, twin.p, twin.loads]
    function = ca.Function("partials", inputs, results)
    held = ca.vertcat(*(reactions.get(i, 0) for i in e.factors.rows))
    now = [_column(e.v, nv), _column(v_dot, nv), held]
    return list(function.call([e.q, SX(nv, 1), *now, e.p, e.loads]))


def _forces(e: Equations, v: Sparse, a: Sparse, rows: Sequence[Row], R: list[SX]) -> Sparse:
    """Forces of the tree at v and a, less Phi^T R of given rows, which act on the links."""
    twists: dict[int, SX] = {}

    def twist(_: int, link: int) -> tuple[SX, SX]:
        own = twists.setdefault(link, SX.sym("twist", 6))
        return own[:3], own[3:]

    power = -SX(total(x * row.velocity(v, twist) for x, row in zip(R, rows, strict=True)))
    wrenches = {i: ca.gradient(power, x) for i, x in twists.items()}
    forces = e.tree_forces(v, a, reactions=wrenches)
    coupled = {i: ca.gradient(power, rate) for i, rate in v.items()}
    forces = add(forces, {i: x for i, x in coupled.items() if not is_zero(x)})
    return add(forces, add(e.friction(v), e.springs))


def _entries(places: Iterable[int], column: SX) -> Sparse:
    values = zip(places, ca.vertsplit(column), strict=True)
    return {i: x for i, x in values if not is_zero(x)}


def _column(x: Sparse, size: int) -> SX:
    column = SX(size, 1)
    for i, entry in x.items():
        column[i] = entry
    return column
