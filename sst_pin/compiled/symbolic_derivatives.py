# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives along the motions that keep the loops closed, on CasADi's symbols.

The method is that of docs/derivatives.md. CasADi differentiates functions of the tree without
closures, in which q, v and v_dot are independent. How v and v_dot change with q follows from the
closures, with the factors of Phi_u. With the multipliers Lambda of the closures, let

    F(q, v, v_dot, Lambda) = forces that the tree needs - Phi^T Lambda - B tau,
    c(q, v, v_dot) = Phi v_dot + Phi_dot v.

The forces along the coordinates are f = L^T F. Lambda and tau are held constant. A change of Lambda
would change no f, because L^T Phi^T is zero in all closed configurations. The change of f is

    df = L^T dF + dL^T F.

The second term is zero, for two reasons. The rows of L for the coordinates are constant (the
identity). Along the dependent rates F is zero, by the choice of Lambda. In a direction x of the
coordinates, dq = L x, and

    df = L^T (F_q dq + F_v dv + F_v_dot dv_dot)
    Phi dv = -Phi_dot(dq) v              from Phi v = 0, at constant va
    Phi dv_dot = -c_q dq - c_v dv        from c = 0, at constant aa

with the rate Phi_dot(dq) of Phi along dq. For derivatives by va, dq = 0 and dv = L x.

`of_torques` and `of_accelerations` give all derivatives, in one of two ways: by Jacobians of the
whole tree, or by one coordinate after the other. The second way takes fewer operations for long
trees with few coordinates (`Equations.derivatives_by_columns`).

The functions `..._along` give the change along one direction, which is an input. Kernels that
compute several directions of one sample side by side use them (`along_directions`).
"""

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple

import casadi as ca
from casadi import SX

from .closure_rows import Row, velocities_by_twists
from .elimination import total
from .equations import Equations
from .kernel_checks import Checks
from .symbols import Sparse, add, column, is_zero, sparse, sx, symmetric


class CheckedMatrix(NamedTuple):
    """Derivatives, and the checks of the linear solutions that they need."""

    values: SX
    #: Numbers that are at most 1 if the solutions are right; see `kernel_checks`.
    checks: list[Any]


class ChangeOfForces(NamedTuple):
    """Changes of f along a direction, and the checks of the linear solutions that they need."""

    #: By q, shape (n,).
    by_q: SX
    #: By va, shape (n,).
    by_va: SX
    checks: list[Any]


def of_torques(e: Equations, checks: Checks) -> CheckedMatrix:
    """Derivatives of f by q, va and aa side by side, shape (n, 3 n)."""
    no_torques = SX(*e.tau.shape)
    return _of_forces(e, checks, TreeDerivatives(e, e.aa, no_torques))


def of_accelerations(e: Equations, checks: Checks) -> CheckedMatrix:
    """Derivatives of aa by q, va and tau side by side, shape (n, 2 n + motors).

    The accelerations satisfy f(q, va, aa) = L^T B tau, and f contains aa as L^T M L aa. So the
    derivatives are the inverse of L^T M L times -f_q, -f_va and L^T B. Here f_q and f_va are those
    of f - L^T B tau at constant aa and tau.
    """
    of_forces = _of_forces(e, checks, TreeDerivatives(e, e.accelerations, e.tau))
    n = of_forces.values.shape[1] // 3
    by_q_and_va = of_forces.values[:, : 2 * n]
    forces = ca.horzcat(-by_q_and_va, e.motor_matrix)
    return CheckedMatrix(e.inertia_factors.solve(forces), of_forces.checks + checks.massless)


# --- the tree -----------------------------------------------------------------------------------

#: A function (dq, dv, dv_dot): the change of a function of q, v and v_dot for these changes of its
#: arguments, all along the rates of the tree.
Change = Callable[[Sparse, Sparse, Sparse], SX]


class TreeDerivatives:
    """Derivatives on the tree, where q, v, v_dot and Lambda are independent.

    The functions F, c and `slips` are written on separate symbols, those of `Equations.displaced`.
    There, derivatives by q along the rates are derivatives by small displacements of the joints.
    The derivatives are then evaluated: their values are expressions in the symbols of `e`.

    Args:
        e: The equations.
        aa: Accelerations of the coordinates, at which derivatives are taken.
        tau: Motor torques, which are constant.

    Attributes:
        rates: Indices of all rates of the tree.
        q, v, v_dot: The symbols by which functions are differentiated; q are the displacements.
        F: The forces F (see the module), shape (nv,).
        c: Phi v_dot + Phi_dot v, shape (rows,), for the rows in the factors of Phi_u.
        slips: Phi v of the rows that constrain rates only, zero for the other rows, shape (rows,).
    """

    def __init__(self, e: Equations, aa: SX, tau: SX) -> None:
        nv = e.mechanism.model.nv
        self.rates = range(nv)

        # The values at which derivatives are taken.
        v_dot_now = e.complete(ca.vertsplit(aa), e.drift)
        needed = add(e.forces(v_dot_now), e.motor_forces(-tau))
        Lambda_now = e.multipliers(needed)

        # The functions, on the symbols of `displaced`. Rates that are zero in e are left out.
        displaced = e.displaced
        rows = [displaced.rows[i] for i in e.factors.rows]
        self.q = displaced.kinematics.displacement
        self.v = SX.sym("v", nv)
        self.v_dot = SX.sym("v_dot", nv)
        Lambda = SX.sym("reactions", len(rows))
        v = {i: self.v[i] for i in e.v}
        v_dot = {i: self.v_dot[i] for i in v_dot_now}
        twists = partial(displaced.kinematics.twist, v=v)
        slips = []
        for row in rows:
            constrains_rates_only = row.residual is None
            slips.append(row.velocity(v, twists) if constrains_rates_only else SX(0))
        self.slips = SX(ca.vertcat(*slips))
        self.c = SX(ca.vertcat(*(row.acceleration(v, v_dot) for row in rows)))
        without_motors = _forces_with_closures(displaced, v, v_dot, rows, ca.vertsplit(Lambda))
        self.F = column(add(without_motors, displaced.motor_forces(-displaced.tau)), self.rates)

        # Each symbol of the functions and its value.
        arguments = [
            (displaced.q, e.q),
            (self.q, SX(nv, 1)),
            (self.v, column(e.v, self.rates)),
            (self.v_dot, column(v_dot_now, self.rates)),
            (Lambda, column(Lambda_now, e.factors.rows)),
            (displaced.p, e.p),
            (displaced.loads, e.loads),
            (displaced.tau, tau),
        ]
        self._symbols = [symbol for symbol, _ in arguments]
        self._values = [value for _, value in arguments]

    def jacobians(self, *pairs: tuple[SX, SX]) -> list[SX]:
        """For each pair of a function and symbols: the Jacobian of the function by the symbols."""
        results = [ca.jacobian(function, symbols) for function, symbols in pairs]
        return list(ca.Function("jacobians", self._symbols, results).call(self._values))

    @cached_property
    def change_of_slips(self) -> Change:
        """Change of `slips`."""
        return self._change(self.slips)

    @cached_property
    def change_of_c(self) -> Change:
        """Change of c."""
        return self._change(self.c)

    @cached_property
    def change_of_F(self) -> Change:
        """Change of F."""
        return self._change(self.F)

    def _change(self, expression: SX) -> Change:
        """The function (dq, dv, dv_dot) that gives the change of one of the functions."""
        nv = len(self.rates)
        change = SX.sym("change", 3 * nv)
        result = ca.jtimes(expression, ca.vertcat(self.q, self.v, self.v_dot), change)
        function = ca.Function("change", [*self._symbols, change], [result])

        def along(dq: Sparse, dv: Sparse, dv_dot: Sparse) -> SX:
            changes = (column(x, self.rates) for x in (dq, dv, dv_dot))
            return function(*self._values, ca.vertcat(*changes))

        return along


def _forces_with_closures(
    e: Equations, v: Sparse, v_dot: Sparse, rows: Sequence[Row], Lambda: list[SX]
) -> Sparse:
    """Forces that the tree needs at v and v_dot, less Phi^T Lambda of some rows.

    Phi^T Lambda is the gradient of the power Lambda . Phi v by v. A row between frames depends on
    the twists of links, so the gradient by a twist is a wrench on a link. A row of joints depends
    on v itself.
    """
    velocities, twists = velocities_by_twists(rows, v)
    power = -SX(total(x * velocity for x, velocity in zip(Lambda, velocities, strict=True)))
    on_links = {i: ca.gradient(power, twist) for i, twist in twists.items()}
    on_joints = {i: ca.gradient(power, rate) for i, rate in v.items()}
    forces = e.tree.forces(v, v_dot, additional=on_links)
    forces = add(forces, {i: x for i, x in on_joints.items() if not is_zero(x)})
    return add(forces, add(e.tree.friction(v), e.tree.springs(v)))


def _Phi_dot_v(e: Equations, slips_q: SX, c_v: SX, steps: Sequence[Sparse]) -> SX:
    """Phi_dot(x) v for each of several steps x of the tree, shape (rows, steps).

    For a row that constrains rates only, this is the change of its slip Phi v. For another row, Phi
    is the derivative of a residual. Its second derivatives in the order x, v and in the order v, x
    differ only by the bracket [x, v] of the joints:

        Phi_dot(x) v - Phi_dot(v) x = Phi [x, v].

    The function c contains v in the term Phi_dot(v) v. Its derivative by v in the direction x is

        c_v x = Phi_dot(x) v + Phi_dot(v) x.

    Half of the sum of both equations is Phi_dot(x) v = (c_v x + Phi [x, v]) / 2.

    Args:
        e: The equations.
        slips_q: Change of `slips` by q along the steps, shape (rows, steps).
        c_v: Change of c by v along the steps, shape (rows, steps).
        steps: Rates of the tree.
    """
    result = SX(c_v)
    brackets = [_brackets(e, step, e.v) for step in steps]
    for place, i in enumerate(e.factors.rows):
        row = e.rows[i]
        for k, bracket in enumerate(brackets):
            of_bracket = total(x * bracket[j] for j, x in row.Phi.items() if j in bracket)
            if row.residual is None:
                result[place, k] = slips_q[place, k]
            else:
                result[place, k] = (c_v[place, k] + of_bracket) / 2
    return result


# --- derivatives of f ---------------------------------------------------------------------------


def _of_forces(e: Equations, checks: Checks, tree: TreeDerivatives) -> CheckedMatrix:
    """Derivatives of f by q, va and aa side by side, at constant motor torques."""
    if e.derivatives_by_columns:
        return _of_forces_by_columns(e, checks, tree)
    return _of_forces_by_matrices(e, checks, tree)


def _of_forces_by_matrices(e: Equations, checks: Checks, tree: TreeDerivatives) -> CheckedMatrix:
    """`_of_forces` by Jacobians on the tree.

    F_v_dot is the mass matrix M of the tree. Only the dependent entries of dv_dot differ from zero,
    and Phi_u times these is -c_q dq - c_v dv. So

        L^T M dv_dot = -g (c_q dq + c_v dv)   with   g = (L^T M)_u Phi_u^-1.

    Row k of g contains the multipliers for the forces M L e_k. With G_q = L^T F_q - g c_q,
    G_v = L^T F_v - g c_v and the derivative V_q of v by q along the columns of L,

        f_q = G_q L + G_v V_q,   f_va = G_v L,   f_aa = L^T M L.
    """
    rows = e.factors.rows
    slips_q, c_q, c_v, F_q, F_v = tree.jacobians(
        (tree.slips, tree.q),
        (tree.c, tree.q),
        (tree.c, tree.v),
        (tree.F, tree.q),
        (tree.F, tree.v),
    )
    L = e.L_matrix

    # g, row by row.
    M = symmetric(e.tree.inertia, len(tree.rates))
    forces_of_inertia = [sparse(tree.rates, ca.vec(row)) for row in ca.vertsplit(L.T @ M)]
    g = ca.vertcat(*(column(e.multipliers(x), rows).T for x in forces_of_inertia))
    solution_checks = [check for x in forces_of_inertia for check in checks.unbalanced(x)]
    G_q = L.T @ F_q - g @ c_q
    G_v = L.T @ F_v - g @ c_v

    # V_q: only the dependent rates change.
    columns_of_V = []
    for Phi_dot_v in ca.horzsplit(_Phi_dot_v(e, slips_q @ L, c_v @ L, e.L)):
        right = sparse(rows, -Phi_dot_v)
        dv = e.factors.solve(right)
        solution_checks += checks.unsolved(dv, right)
        columns_of_V.append(column(dv, tree.rates))
    f_q = G_q @ L + G_v @ ca.horzcat(*columns_of_V)
    return CheckedMatrix(ca.horzcat(f_q, G_v @ L, e.inertia), solution_checks)


def _of_forces_by_columns(e: Equations, checks: Checks, tree: TreeDerivatives) -> CheckedMatrix:
    """`_of_forces` along one coordinate after the other."""
    n = len(e.L)
    by_q = list[SX]()
    by_va = list[SX]()
    solution_checks = list[Any]()
    for k in range(n):
        direction = SX(n, 1)
        direction[k] = 1
        change = of_forces_along(e, checks, tree, direction)
        by_q.append(change.by_q)
        by_va.append(change.by_va)
        solution_checks += change.checks
    return CheckedMatrix(ca.horzcat(*by_q, *by_va, e.inertia), solution_checks)


def of_forces_along(
    e: Equations, checks: Checks, tree: TreeDerivatives, direction: SX
) -> ChangeOfForces:
    """Changes of f by q and by va along a direction x of the coordinates, shape (n,)."""
    rows = e.factors.rows
    zero_at_coordinates = [0.0] * direction.numel()
    zero = Sparse()
    step = e.complete(ca.vertsplit(direction), zero)  # L x

    # By q: dq = L x, then dv and dv_dot.
    c_v_step = tree.change_of_c(zero, step, zero)
    slips_step = tree.change_of_slips(step, zero, zero)
    right_of_dv = sparse(rows, -_Phi_dot_v(e, slips_step, c_v_step, [step]))
    dv = e.complete(zero_at_coordinates, right_of_dv)
    right_of_dv_dot = sparse(rows, -tree.change_of_c(step, dv, zero))
    dv_dot = e.complete(zero_at_coordinates, right_of_dv_dot)
    dF_by_q = sparse(tree.rates, tree.change_of_F(step, dv, dv_dot))

    # By va: dq = 0, dv = L x, then dv_dot.
    right_by_va = sparse(rows, -c_v_step)
    dv_dot_by_va = e.complete(zero_at_coordinates, right_by_va)
    dF_by_va = sparse(tree.rates, tree.change_of_F(zero, step, dv_dot_by_va))

    solution_checks = [
        *checks.unsolved(step, zero),
        *checks.unsolved(dv, right_of_dv),
        *checks.unsolved(dv_dot, right_of_dv_dot),
        *checks.unsolved(dv_dot_by_va, right_by_va),
        *checks.unbalanced(dF_by_q),
        *checks.unbalanced(dF_by_va),
    ]
    return ChangeOfForces(e.projected(dF_by_q), e.projected(dF_by_va), solution_checks)


def of_inertia_along(
    e: Equations, checks: Checks, tree: TreeDerivatives, direction: SX
) -> CheckedMatrix:
    """L^T M L times a direction of the coordinates, shape (n,): the change of f by aa."""
    zero = Sparse()
    step = e.complete(ca.vertsplit(direction), zero)  # L x
    dF_by_aa = sparse(tree.rates, tree.change_of_F(zero, zero, step))
    return CheckedMatrix(e.projected(dF_by_aa), checks.unbalanced(dF_by_aa))


# --- displacements ------------------------------------------------------------------------------


def displacement_rates_along(e: Equations, step: Sparse) -> SX:
    """-[v, step] along the coordinates, shape (n,), with the Lie bracket of rates of the tree.

    For step = L e_k it is column k of D, which `Engine.displacement_rates` explains.
    """
    return -column(_brackets(e, e.v, step), e.mechanism.coordinates.tolist())


def _brackets(e: Equations, a: Sparse, b: Sparse) -> Sparse:
    """The Lie bracket [a, b] of rates a and b of the tree, joint by joint.

    For two twists [u; omega] of a joint the bracket is the twist
    [omega_a x u_b + u_a x omega_b; omega_a x omega_b]. S^T times this twist are its rates, because
    the columns of S are orthonormal in joints with several rates.
    """
    brackets: Sparse = {}
    for link in e.kinematics.tree.links:
        if len(link.v) > 1:  # a single twist has a zero bracket with itself
            S = sx(link.S)
            u_a, omega_a = ca.vertsplit(S @ column(a, link.v), 3)
            u_b, omega_b = ca.vertsplit(S @ column(b, link.v), 3)
            linear = ca.cross(omega_a, u_b) + ca.cross(u_a, omega_b)
            brackets |= sparse(link.v, S.T @ ca.vertcat(linear, ca.cross(omega_a, omega_b)))
    return brackets
