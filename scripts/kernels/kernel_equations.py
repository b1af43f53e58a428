# SPDX-License-Identifier: BSD-2-Clause
"""The kernels: each the body of one function, put together from kinematics and dynamics."""

from __future__ import annotations

from c_expressions import Body, Expr, Vector, cross, dot, minus, plus, scaled, unit
from kernel_dynamics import (
    at_the_motors,
    convective,
    gyroscopic,
    inertia_matrix,
    inertial,
    platform,
    rubbing,
    solve_symmetric,
    weights,
)
from kernel_kinematics import (
    LEGS,
    Inverse,
    Legs,
    Rates,
    accelerations,
    argument,
    axes_by_both_ways,
    base_axes,
    inverse,
    legs,
    openness,
    rates,
)


def put_all(b: Body, name: str, values: list[Expr]) -> None:
    for i, value in enumerate(values):
        b.put(f"{name}[{i}]", value)


def configuration(b: Body) -> tuple[Legs, list[Vector], Expr, Inverse]:
    """The legs, the axes of {01}, how open the loops are, the inverse of A."""
    axes = legs(b)
    base = base_axes(b, axes)
    off = openness(b, axes_by_both_ways(b, axes, base))
    return axes, base, off, inverse(b, axes.y)


def torques(
    b: Body, axes: Legs, base: list[Vector], A: Inverse, v: Rates, gamma_ddot: list[Expr]
) -> list[Expr]:
    """Motor torques of a motion, Eq. (91)."""
    b.section("accelerations")
    a = accelerations(b, axes, A, v, v, gamma_ddot)
    load = inertial(a) + weights(b, axes, base)
    b.section("inertia")
    load += gyroscopic(b, v)
    load += rubbing(b, v)
    load.star = minus(load.star, platform(b, base))
    b.section("loads, and the torques that carry them")
    return at_the_motors(b, axes, A, load)


def inverse_dynamics() -> Body:
    b = Body()
    axes, base, off, A = configuration(b)
    b.section("rates")
    v = rates(b, axes, A, argument("va"))
    put_all(b, "tau", torques(b, axes, base, A, v, argument("aa")))
    put_all(b, "check", [off, A.det])
    return b


def direct_dynamics() -> Body:
    """Eq. (92): the motors' inertia takes what motors at constant rates would leave."""
    b = Body()
    axes, base, off, A = configuration(b)
    b.section("rates")
    v = rates(b, axes, A, argument("va"))
    carried = torques(b, axes, base, A, v, [Expr.of(0.0)] * 3)
    left = [
        b.let(f"left_{k + 1}", tau - x)
        for k, (tau, x) in enumerate(zip(argument("tau"), carried, strict=True))
    ]
    M = inertia_matrix(b, axes, A)
    aa, definite = solve_symmetric(b, M, left)
    put_all(b, "q_dot", v.joints)
    put_all(b, "aa", aa)
    put_all(b, "check", [off, A.det, definite])
    return b


def reduced_terms() -> Body:
    b = Body()
    axes, base, off, A = configuration(b)
    b.section("rates")
    v = rates(b, axes, A, argument("va"))
    M = inertia_matrix(b, axes, A)
    C = []
    for j in LEGS:
        b.section(f"motor {j + 1} alone: column of L, its rate, and the moments")
        mark = f"_by_{j + 1}"
        w = rates(b, axes, A, list(unit(j)), mark)
        a = accelerations(b, axes, A, v, w, [Expr.of(0.0)] * 3, mark)
        C.append(at_the_motors(b, axes, A, inertial(a) + convective(b, v, w, mark), mark))
    weight = weights(b, axes, base)
    b.section("results")
    tau_g = at_the_motors(b, axes, A, weight, "_g")
    tau_f = at_the_motors(b, axes, A, rubbing(b, v), "_f")
    put_all(b, "inertia", [M[min(i, j), max(i, j)] for i in LEGS for j in LEGS])
    put_all(b, "coriolis", [C[j][i] for i in LEGS for j in LEGS])
    put_all(b, "gravity", [-x for x in tau_g])
    put_all(b, "friction", [-x for x in tau_f])
    put_all(b, "check", [off, A.det])
    return b


def close() -> Body:
    """One step of Newton's method on the passive joints.

    phi_k is the turn from the star by leg 1 to the star by leg k; delta, the turn of the star by
    leg 1 to where all three can meet, must leave no y component: A delta = (y_2k . phi_k).
    """
    b = Body()
    axes = legs(b)
    ways = axes_by_both_ways(b, axes, base_axes(b, axes))
    off = openness(b, ways)
    b.section("turns from leg 1 to legs 2 and 3")
    phi: list[Vector] = [(Expr.of(0.0),) * 3]
    for k, ((e_1, u_1), (e_k, u_k)) in zip((2, 3), ways, strict=True):
        third_1 = b.let_vector(f"v_{k}_by_1", cross(e_1, u_1))
        third_k = b.let_vector(f"v_{k}", cross(e_k, u_k))
        twice = plus(cross(e_k, e_1), cross(u_k, u_1), cross(third_k, third_1))
        phi.append(b.let_vector(f"phi_{k}", scaled(Expr("0.5"), twice)))
    A = inverse(b, axes.y)
    b.section("to where they meet")
    delta = A.times(b, "delta_", [dot(axes.y[k], phi[k]) for k in LEGS])
    for k in LEGS:
        turn = b.let_vector(f"turn_{k + 1}", minus(delta, phi[k]))
        b.put(f"q[{3 * k + 1}]", Expr(f"q[{3 * k + 1}]") + dot(axes.u[k], turn))
        b.put(f"q[{3 * k + 2}]", Expr(f"q[{3 * k + 2}]") + dot(axes.n[k], turn))
    put_all(b, "check", [off, A.det])
    return b
