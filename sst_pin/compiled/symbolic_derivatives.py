# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives along the motions that keep the loops closed, on CasADi's symbols.

As docs/derivatives.md: partial derivatives on the tree are CasADi's; the loops are differentiated
implicitly, by the one factorisation of Phi_u. For many samples whole matrices take the fewest
operations. For one sample, its directions are computed side by side like samples of a batch.
"""

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any

import casadi as ca
from casadi import SX

from .closure_rows import Row, by_twists
from .elimination import total
from .equations import Equations
from .kernel_checks import Checks
from .symbols import Sparse, add, column, is_zero, sparse, sx, symmetric


def of_torques(e: Equations, checks: Checks) -> tuple[SX, list[Any]]:
    """Derivatives of f by q, va and aa side by side, and checks."""
    return _of_forces(e, checks, OnTree(e, e.aa, SX(*e.tau.shape)))


def of_accelerations(e: Equations, checks: Checks) -> tuple[SX, list[Any]]:
    """Derivatives of aa by q, va and tau side by side, and checks."""
    by_motion, residual_checks = _of_forces(e, checks, OnTree(e, e.accelerations, e.tau))
    n = by_motion.shape[1] // 3
    forces = ca.horzcat(-by_motion[:, : 2 * n], e.motor_matrix)
    return e.inertia_factors.solve(forces), residual_checks + checks.massless


def of_displacement(e: Equations, step: Sparse) -> SX:
    """-S [v, step], shape (n,): the effect of moving joint axes on a displacement xi."""
    return -column(_brackets(e, e.v, step), e.mechanism.coordinates.tolist())


def _brackets(e: Equations, a: Sparse, b: Sparse) -> Sparse:
    """Joint by joint the Lie bracket [a, b] of rates, along the rates."""
    brackets: Sparse = {}
    for link in e.kinematics.tree.links:
        if len(link.v) > 1:
            S = sx(link.S)
            (u, turn), (other_u, other) = (ca.vertsplit(S @ column(x, link.v), 3) for x in (a, b))
            linear = ca.cross(turn, other_u) + ca.cross(u, other)
            brackets |= sparse(link.v, S.T @ ca.vertcat(linear, ca.cross(turn, other)))
    return brackets


#: Derivative of a function of q, v and v_dot, from changes of these along the rates of the tree.
Change = Callable[[Sparse, Sparse, Sparse], SX]


class OnTree:
    """Derivatives on the tree, where q, v, v_dot and the forces of the closures are independent.

    Functions of displacements q along the rates, of v and of v_dot: `slips`, Phi v of the rows that
    constrain rates only; `c`, Phi v_dot + Phi_dot v; `forces`, those of the tree less those of the
    closures and of the motors.
    """

    def __init__(self, e: Equations, aa: SX, tau: SX) -> None:
        of_v_dot = e.complete(ca.vertsplit(aa), e.drift)
        force = add(e.forces(of_v_dot), e.motor_forces(-tau))
        nv = e.mechanism.model.nv
        twin = e.displaced
        self.rates = range(nv)
        rows = [twin.rows[i] for i in e.factors.rows]
        self.q = twin.kinematics.displacement
        self.v, self.v_dot = SX.sym("v", nv), SX.sym("v_dot", nv)
        v = {i: self.v[i] for i in e.v}
        a = {i: self.v_dot[i] for i in of_v_dot}
        R = SX.sym("reactions", len(rows))
        twists = partial(twin.kinematics.twist, v=v)
        slips = (row.velocity(v, twists) if row.residual is None else SX(0) for row in rows)
        self.slips = SX(ca.vertcat(*slips))
        self.c = SX(ca.vertcat(*(row.acceleration(v, a) for row in rows)))
        forces = add(_forces(twin, v, a, rows, ca.vertsplit(R)), twin.motor_forces(-twin.tau))
        self.forces = column(forces, range(nv))
        self._symbols = [twin.q, self.q, self.v, self.v_dot, R, twin.p, twin.loads, twin.tau]
        lambda_ = column(e.multipliers(force), e.factors.rows)
        now = [column(e.v, range(nv)), column(of_v_dot, range(nv)), lambda_]
        self._values = [e.q, SX(nv, 1), *now, e.p, e.loads, tau]

    def by(self, *pairs: tuple[SX, SX]) -> list[SX]:
        """For each pair, the derivative of the first member by the second one."""
        results = [ca.jacobian(of, x) for of, x in pairs]
        return list(ca.Function("by", self._symbols, results).call(self._values))

    @cached_property
    def change_of_slips(self) -> Change:
        """Derivative of `slips`."""
        return self._change(self.slips)

    @cached_property
    def change_of_c(self) -> Change:
        """Derivative of `c`."""
        return self._change(self.c)

    @cached_property
    def change_of_forces(self) -> Change:
        """Derivative of `forces`."""
        return self._change(self.forces)

    def _change(self, of: SX) -> Change:
        """Derivative of one of the functions by changes of q, v and v_dot."""
        nv = self.v.numel()
        change = SX.sym("change", 3 * nv)
        result = ca.jtimes(of, ca.vertcat(self.q, self.v, self.v_dot), change)
        function = ca.Function("change", [*self._symbols, change], [result])

        def along(q: Sparse, v: Sparse, v_dot: Sparse) -> SX:
            changes = (column(x, range(nv)) for x in (q, v, v_dot))
            return function(*self._values, ca.vertcat(*changes))

        return along


def _of_forces(e: Equations, checks: Checks, tree: OnTree) -> tuple[SX, list[Any]]:
    """Derivatives of f by q, va and aa at constant motor forces, and checks of the solutions."""
    if e.derivatives_by_columns:
        return _of_forces_by_columns(e, checks, tree)
    nv = e.mechanism.model.nv
    rows = e.factors.rows
    of_rows = (tree.slips, tree.q), (tree.c, tree.q), (tree.c, tree.v)
    of_forces = (tree.forces, tree.q), (tree.forces, tree.v)
    slip_q, c_q, c_v, force_q, force_v = tree.by(*of_rows, *of_forces)
    L = e.L_matrix
    M = symmetric(e.tree.inertia, nv)
    inertial = [sparse(range(nv), ca.vec(row)) for row in ca.vertsplit(L.T @ M)]
    g = ca.vertcat(*(column(e.multipliers(x), rows).T for x in inertial))
    residual_checks = [check for x in inertial for check in checks.unbalanced(x)]
    by_q = L.T @ force_q - g @ c_q
    by_v = L.T @ force_v - g @ c_v
    lost = [sparse(rows, -x) for x in ca.horzsplit(_phi_dot_v(e, slip_q @ L, c_v @ L))]
    v_q = [e.factors.solve(x) for x in lost]
    pairs = zip(v_q, lost, strict=True)
    residual_checks += [check for pair in pairs for check in checks.unsolved(*pair)]
    of_q = by_q @ L + by_v @ ca.horzcat(*(column(x, range(nv)) for x in v_q))
    return ca.horzcat(of_q, by_v @ L, e.inertia), residual_checks


def _of_forces_by_columns(e: Equations, checks: Checks, tree: OnTree) -> tuple[SX, list[Any]]:
    """As `_of_forces`, along one coordinate after the other."""
    n = len(e.L)
    by_q = list[SX]()
    by_va = list[SX]()
    solution_checks = list[Any]()
    for k in range(n):
        along = SX(n, 1)
        along[k] = 1
        of_q, of_va, more = of_forces_along(e, checks, tree, along)
        by_q.append(of_q)
        by_va.append(of_va)
        solution_checks += more
    return ca.horzcat(*by_q, *by_va, e.inertia), solution_checks


def of_forces_along(
    e: Equations, checks: Checks, tree: OnTree, direction: SX
) -> tuple[SX, SX, list[Any]]:
    """Changes of f by q and by va along a direction of the coordinates, and checks of them."""
    rows = e.factors.rows
    still = [0.0] * direction.numel()
    none = Sparse()
    step = e.complete(ca.vertsplit(direction), none)
    c_v = tree.change_of_c(none, step, none)
    slips = tree.change_of_slips(step, none, none)
    lost = sparse(rows, -_phi_dot_v(e, slips, c_v, [step]))
    v_q = e.complete(still, lost)
    c_q = sparse(rows, -tree.change_of_c(step, v_q, none))
    c_va = sparse(rows, -c_v)
    v_dot_q = e.complete(still, c_q)
    v_dot_va = e.complete(still, c_va)
    by_q = sparse(tree.rates, tree.change_of_forces(step, v_q, v_dot_q))
    by_va = sparse(tree.rates, tree.change_of_forces(none, step, v_dot_va))
    solved = (step, none), (v_q, lost), (v_dot_q, c_q), (v_dot_va, c_va)
    more = [check for x, right in solved for check in checks.unsolved(x, right)]
    more += [*checks.unbalanced(by_q), *checks.unbalanced(by_va)]
    return e.reduced(by_q), e.reduced(by_va), more


def of_inertia_along(
    e: Equations, checks: Checks, tree: OnTree, direction: SX
) -> tuple[SX, list[Any]]:
    """The mass matrix times a direction of the coordinates, and a check of it."""
    none = Sparse()
    step = e.complete(ca.vertsplit(direction), none)
    by_aa = sparse(tree.rates, tree.change_of_forces(none, none, step))
    return e.reduced(by_aa), checks.unbalanced(by_aa)


def _phi_dot_v(e: Equations, slip_q: SX, c_v: SX, steps: Sequence[Sparse] | None = None) -> SX:
    """Phi_dot v, with Phi_dot along each L e_k or each of the steps, shape (rows, n)."""
    # Where rows hold positions and loops are closed, c_v L e_k is twice that, but for the bracket
    # of L e_k and v. For rows that hold rates only it is `slip_q`.
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
    velocities, twists = by_twists(rows, v)
    power = -SX(total(x * u for x, u in zip(R, velocities, strict=True)))
    wrenches = {i: ca.gradient(power, x) for i, x in twists.items()}
    forces = e.tree.forces(v, a, reactions=wrenches)
    coupled = {i: ca.gradient(power, rate) for i, rate in v.items()}
    forces = add(forces, {i: x for i, x in coupled.items() if not is_zero(x)})
    return add(forces, add(e.tree.friction(v), e.tree.springs(v)))
