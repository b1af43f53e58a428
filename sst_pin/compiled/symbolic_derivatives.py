# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives along the motions that keep the loops closed, on CasADi's symbols.

The lines of docs/derivatives.md: partial derivatives on the tree, where q, v, v_dot and the forces
of the closures are independent, are CasADi's; the loops are differentiated implicitly, by the one
factorisation of Phi_u that all else uses. For many samples whole matrices take the fewest
operations. For one sample its directions are computed side by side, as samples otherwise are.
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
from .kernel_checks import Checks
from .symbols import Sparse, add, is_zero, solve_symmetric, sx


def of_torques(e: Equations, checks: Checks) -> tuple[SX, SX, SX, list[Any]]:
    """Derivatives of f by q, va and aa, shapes (n, n), at a motion (q, va, aa), and checks."""
    by_q, by_va, own = _of_forces(e, checks, _OnTree(e, e.aa, None))
    return by_q, by_va, e.inertia, own


def of_torques_along(e: Equations, checks: Checks, way: SX) -> tuple[SX, SX, SX, list[Any]]:
    """Derivatives of f times a direction of the coordinates, shapes (n,)."""
    return _of_forces_along(e, checks, _OnTree(e, e.aa, None), way)


def of_accelerations(e: Equations, checks: Checks, tau: SX) -> tuple[SX, SX, SX, list[Any]]:
    """Derivatives of aa by q, va and tau, and checks."""
    aa, inverses = e.accelerations(tau)
    by_q, by_va, own = _of_forces(e, checks, _OnTree(e, aa, tau))
    right = ca.horzcat(-by_q, -by_va, e.motor_matrix)
    aa_x, _ = solve_symmetric(e.inertia, right)
    n = len(e.L)
    return aa_x[:, :n], aa_x[:, n : 2 * n], aa_x[:, 2 * n :], own + checks.massless(inverses)


def of_accelerations_along(
    e: Equations, checks: Checks, tau: SX, way: SX
) -> tuple[SX, SX, SX, list[Any]]:
    """Derivatives of aa times a direction of coordinates and as many motors, shapes (n,)."""
    aa, inverses = e.accelerations(tau)
    by_q, by_va, _, own = _of_forces_along(e, checks, _OnTree(e, aa, tau), way)
    driven = e.project(e.motor_forces(way))
    aa_x, _ = solve_symmetric(e.inertia, ca.horzcat(-by_q, -by_va, driven))
    return aa_x[:, 0], aa_x[:, 1], aa_x[:, 2], own + checks.massless(inverses)


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


class _OnTree:
    """Derivatives on the tree, where q, v, v_dot and the forces of the closures are independent.

    Attributes:
        slips: Phi v of those rows that hold rates and no positions; zeros for the others.
        c: Phi v_dot + Phi_dot v.
        forces: Forces of the tree less those of the closures and of motors on lines.
        q, v, v_dot: What they can be differentiated by; q along each rate.
    """

    def __init__(self, e: Equations, aa: SX, tau: SX | None) -> None:
        of_v_dot = e.complete(ca.vertsplit(aa), e.drift)
        tau = SX(len(e.mechanism.motor_names), 1) if tau is None else tau
        motors = e.motor_forces(tau)
        self.force = add(e.forces(of_v_dot), {i: -x for i, x in motors.items() if not is_zero(x)})
        reactions = e.multipliers(self.force)
        nv, twin = e.mechanism.model.nv, e.displaced
        rows = [twin.rows[i] for i in e.factors.rows]
        self.q = twin.kinematics.displacement
        self.v, self.v_dot = SX.sym("v", nv), SX.sym("v_dot", nv)
        v, a = {i: self.v[i] for i in e.v}, {i: self.v_dot[i] for i in of_v_dot}
        R = SX.sym("reactions", len(rows))
        twists = partial(twin.kinematics.twist, v=v)
        slips = (row.velocity(v, twists) if row.residual is None else SX(0) for row in rows)
        self.slips = SX(ca.vertcat(*slips))
        self.c = SX(ca.vertcat(*(row.acceleration(v, a) for row in rows)))
        held_tau = SX.sym("tau", *tau.shape)
        motors = {i: -x for i, x in twin.pushed(held_tau).items()}
        self.forces = _column(add(_forces(twin, v, a, rows, ca.vertsplit(R)), motors), nv)
        self._symbols = [twin.q, self.q, self.v, self.v_dot, R, twin.p, twin.loads, held_tau]
        held = ca.vertcat(*(reactions.get(i, 0) for i in e.factors.rows))
        now = [_column(e.v, nv), _column(of_v_dot, nv), held]
        self._values = [e.q, SX(nv, 1), *now, e.p, e.loads, tau]

    def by(self, *pairs: tuple[SX, SX]) -> list[SX]:
        """Derivatives of one of them by another, pair by pair."""
        results = [ca.jacobian(of, x) for of, x in pairs]
        return list(ca.Function("by", self._symbols, results).call(self._values))

    def along(self, of: SX, q: Sparse, v: Sparse, v_dot: Sparse) -> SX:
        """Derivative of one of them where q, v and v_dot change."""
        nv = self.v.numel()
        step = ca.vertcat(*(_column(x, nv) for x in (q, v, v_dot)))
        symbol = SX.sym("step", 3 * nv)
        result = ca.jtimes(of, ca.vertcat(self.q, self.v, self.v_dot), symbol)
        function = ca.Function("along", [*self._symbols, symbol], [result])
        return function(*self._values, step)


def _of_forces(e: Equations, checks: Checks, tree: _OnTree) -> tuple[SX, SX, list[Any]]:
    """Derivatives of f by q and va, the motors' forces held, and checks of what is solved."""
    nv, rows = e.mechanism.model.nv, e.factors.rows
    of_rows = (tree.slips, tree.q), (tree.c, tree.q), (tree.c, tree.v)
    of_forces = (tree.forces, tree.q), (tree.forces, tree.v)
    slip_q, c_q, c_v, force_q, force_v = tree.by(*of_rows, *of_forces)
    L = ca.horzcat(*(_column(x, nv) for x in e.L))
    M = SX(nv, nv)
    for (i, j), entry in e.tree.inertia.items():
        M[i, j] = M[j, i] = entry
    inertial = [_entries(range(nv), ca.vec(row)) for row in ca.vertsplit(L.T @ M)]
    g = ca.vertcat(*(_row(e.multipliers(x), rows) for x in inertial))
    own = [check for x in inertial for check in checks.unbalanced(x)]
    by_q, by_v = L.T @ force_q - g @ c_q, L.T @ force_v - g @ c_v
    lost = [_entries(rows, -x) for x in ca.horzsplit(_phi_dot_v(e, slip_q @ L, c_v @ L))]
    v_q = [e.factors.solve(x) for x in lost]
    own += [c for x, right in zip(v_q, lost, strict=True) for c in checks.unsolved(x, right)]
    of_q = by_q @ L + by_v @ ca.horzcat(*(_column(x, nv) for x in v_q))
    return of_q, by_v @ L, own


def _of_forces_along(
    e: Equations, checks: Checks, tree: _OnTree, way: SX
) -> tuple[SX, SX, SX, list[Any]]:
    """Derivatives of f by q, va and aa, the motors' forces held, times a direction, and checks."""
    rows, held = e.factors.rows, [0.0] * way.numel()
    step = e.complete(ca.vertsplit(way), {})
    c_v = tree.along(tree.c, {}, step, {})
    slips = tree.along(tree.slips, step, {}, {})
    lost = _entries(rows, -_phi_dot_v(e, slips, c_v, [step]))
    v_q = e.complete(held, lost)
    c_q = _entries(rows, -tree.along(tree.c, step, v_q, {}))
    c_va = _entries(rows, -c_v)
    v_dot_q, v_dot_va = e.complete(held, c_q), e.complete(held, c_va)
    none: Sparse = {}
    changes = (step, v_q, v_dot_q), (none, step, v_dot_va), (none, none, step)
    columns = [tree.along(tree.forces, *change) for change in changes]
    forces = [_entries(range(e.mechanism.model.nv), x) for x in columns]
    solved = (step, none), (v_q, lost), (v_dot_q, c_q), (v_dot_va, c_va)
    own = [check for x, right in solved for check in checks.unsolved(x, right)]
    own += [check for x in forces for check in checks.unbalanced(x)]
    f = [e.reduced(x) for x in forces]
    return f[0], f[1], f[2], own


def _phi_dot_v(e: Equations, slip_q: SX, c_v: SX, steps: Sequence[Sparse] | None = None) -> SX:
    """Phi_dot v, with Phi_dot along each L e_k or each of the steps, shape (rows, n).

    Where rows hold positions and the loops are closed, c_v L e_k is twice that, but for the bracket
    of L e_k and v. For rows that hold rates only it is `slip_q`.
    """
    result = SX(c_v)
    brackets = [_brackets(e, step, e.v) for step in steps or e.L]
    for place, i in enumerate(e.factors.rows):
        row = e.rows[i]
        for k, bracket in enumerate(brackets):
            turned = total(x * bracket[j] for j, x in row.Phi.items() if j in bracket)
            of_position = (c_v[place, k] + turned) / 2
            result[place, k] = slip_q[place, k] if row.residual is None else of_position
    return result


def _forces(e: Equations, v: Sparse, a: Sparse, rows: Sequence[Row], R: list[SX]) -> Sparse:
    """Forces of the tree at v and a, less Phi^T R of given rows, which act on the links."""
    twists: dict[int, SX] = {}

    def twist(_: int, link: int) -> tuple[SX, SX]:
        own = twists.setdefault(link, SX.sym("twist", 6))
        return own[:3], own[3:]

    power = -SX(total(x * row.velocity(v, twist) for x, row in zip(R, rows, strict=True)))
    wrenches = {i: ca.gradient(power, x) for i, x in twists.items()}
    forces = e.tree.forces(v, a, reactions=wrenches)
    coupled = {i: ca.gradient(power, rate) for i, rate in v.items()}
    forces = add(forces, {i: x for i, x in coupled.items() if not is_zero(x)})
    return add(forces, add(e.tree.friction(v), e.tree.springs))


def _entries(places: Iterable[int], column: SX) -> Sparse:
    values = zip(places, ca.vertsplit(column), strict=True)
    return {i: x for i, x in values if not is_zero(x)}


def _column(x: Sparse, size: int) -> SX:
    column = SX(size, 1)
    for i, entry in x.items():
        column[i] = entry
    return column


def _row(x: Sparse, places: Sequence[int]) -> SX:
    return ca.horzcat(*(SX(x.get(i, 0)) for i in places))
