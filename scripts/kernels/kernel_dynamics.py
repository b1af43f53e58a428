# SPDX-License-Identifier: BSD-2-Clause
"""Moments about O, where every body turns, and the motor torques that carry them.

The forces go the way of the rates back: what the joints and links of a leg ask of the star is
brought to the motors by the transpose of the inverse of A.
"""

from __future__ import annotations

from dataclasses import dataclass

from c_expressions import (
    PRODUCT,
    Body,
    Expr,
    Vector,
    cross,
    dot,
    minus,
    plus,
    scaled,
    symmetric,
    total,
)
from kernel_kinematics import (
    LEGS,
    Accelerations,
    Inverse,
    Legs,
    Rates,
    argument,
    columns,
    field,
    row,
    upper,
)


@dataclass
class Load:
    """What the motions are asked for: moments on the star, on the passive links, in the joints."""

    star: Vector
    links: list[Vector]
    joints: list[Expr]

    def __add__(self, other: Load) -> Load:
        return Load(
            plus(self.star, other.star),
            [plus(a, b) for a, b in zip(self.links, other.links, strict=True)],
            [a + b for a, b in zip(self.joints, other.joints, strict=True)],
        )


def inertial(a: Accelerations) -> Load:
    """Inertia about O times angular acceleration; rotors in their joints."""
    joints = []
    for k in LEGS:
        joints += [
            field("link_inertia", k) * a.gamma[k],
            field("rotor", k, 0) * a.mu[k],
            field("rotor", k, 1) * a.beta[k],
        ]
    return Load(
        symmetric(upper("star_inertia"), a.alpha),
        [symmetric(upper("passive_inertia", k), a.links[k]) for k in LEGS],
        joints,
    )


def gyroscopic(b: Body, v: Rates) -> Load:
    """omega x (inertia omega)."""
    spin = b.let_vector("spin_", symmetric(upper("star_inertia"), v.omega))
    links = []
    for k in LEGS:
        own = b.let_vector(f"spin_2{k + 1}", symmetric(upper("passive_inertia", k), v.link(k)))
        links.append(cross(v.link(k), own))
    return Load(cross(v.omega, spin), links, _nothing())


def convective(b: Body, v: Rates, w: Rates, mark: str) -> Load:
    """The part of T_dot and Omega M T beyond `inertial`, for directions w, Eq. (94).

    A body that turns about O with omega has, for a direction theta of its own,
    inertia (omega x theta) + omega x (inertia theta) - m c^2 (omega x theta).
    """

    def moment(name: str, inertia: list[Expr], polar: Expr, omega: Vector, theta: Vector) -> Vector:
        turned = b.let_vector(f"turned{mark}{name}", cross(omega, theta))
        spin = b.let_vector(f"spin{mark}{name}", symmetric(inertia, theta))
        return plus(symmetric(inertia, turned), cross(omega, spin), scaled(-polar, turned))

    star = moment("_", upper("star_inertia"), field("star_polar"), v.omega, w.omega)
    links = [
        moment(
            f"_2{k + 1}", upper("passive_inertia", k), field("passive_polar", k),
            v.link(k), w.link(k),
        )
        for k in LEGS
    ]  # fmt: skip
    return Load(star, links, _nothing())


def weights(b: Body, legs: Legs, base: list[Vector]) -> Load:
    """Moments of the weights about O, with the sign of a load to be carried: - m c x g."""
    b.section("weights")
    g = b.let_vector("g_", columns(base, list(row("gravity", 0))))
    star = cross(g, tuple(field("star_moment", i) for i in range(3)))  # type: ignore[arg-type]
    links, joints = [], []
    for k in LEGS:
        g_x, g_y, g_z = row("gravity", k)
        s, c = legs.s_gamma[k], legs.c_gamma[k]
        g_1x = b.let(f"g_1{k + 1}x", c * g_x + s * g_y)
        g_1y = b.let(f"g_1{k + 1}y", c * g_y - s * g_x)
        g_2y = b.let(f"g_2{k + 1}y", legs.c[k] * g_1y + legs.s[k] * g_z)
        g_2z = b.let(f"g_2{k + 1}z", legs.c[k] * g_z - legs.s[k] * g_1y)
        links.append(cross((g_1x, g_2y, g_2z), row("passive_moment", k)))
        m_x, m_y = (field("link_moment", k, i) for i in range(2))
        joints += [m_y * g_1x - m_x * g_1y, Expr.of(0.0), Expr.of(0.0)]
    return Load(star, links, joints)


def rubbing(b: Body, v: Rates) -> Load:
    """-tau^f, Eqs. (87)-(89)."""
    b.section("friction")
    joints = []
    for i, rate in enumerate(v.joints):
        name = f"{('gamma', 'mu', 'beta')[i % 3]}_{i // 3 + 1}"
        friction = f"sst_friction({rate.text}, p->viscous[{i}], p->coulomb[{i}], p->sign_width)"
        joints.append(b.let(f"friction_{name}", Expr(friction, PRODUCT)))
    return Load((Expr.of(0.0),) * 3, [(Expr.of(0.0),) * 3] * 3, joints)


def platform(b: Body, base: list[Vector]) -> Vector:
    """The moment on the star, from base axes to {31}; none when there is no pointer to it."""
    b.section("moment on the star")
    m = argument("moment")
    in_01 = [total([m[i] * field("R_01", i, j) for i in range(3)]) for j in range(3)]
    names = [f"moment_{c}" for c in "xyz"]
    lines = [f"real {', '.join(f'{name} = {{0}}' for name in names)};", "if (moment) {"]
    lines += [f"    const real m_{c} = {m_j.text};" for c, m_j in zip("xyz", in_01, strict=True)]
    turned = columns(base, [Expr(f"m_{c}") for c in "xyz"])
    lines += [f"    {name} = {value.text};" for name, value in zip(names, turned, strict=True)]
    x, y, z = b.statement(names, "\n".join([*lines, "}"]))
    return x, y, z


def at_the_motors(b: Body, legs: Legs, A: Inverse, load: Load, mark: str = "") -> list[Expr]:
    """The motor torques that carry a load: its power is that of the motors, Eqs. (82), (91)."""
    star = b.let_vector(f"load{mark}_", load.star)
    own, passive = [], [star]
    for k in LEGS:
        x, y, z = b.let_vector(f"load{mark}_2{k + 1}", load.links[k])
        gamma, mu, beta = load.joints[3 * k : 3 * k + 3]
        beta = b.let(f"load{mark}_beta_{k + 1}", beta)
        own.append(gamma + legs.s[k] * y + legs.c[k] * (z - beta))
        passive += [scaled(b.let(f"load{mark}_mu_{k + 1}", x + mu), legs.u[k])]
        passive += [scaled(beta, legs.n[k])]
    carried = b.let_vector(f"carried{mark}_", plus(*passive))
    return [own[k] + legs.s[k] * x for k, x in enumerate(A.transposed_times(carried))]


def inertia_matrix(b: Body, legs: Legs, A: Inverse) -> dict[tuple[int, int], Expr]:
    """Generalised inertia matrix, Eq. (93): W^T S W + W^T P + P^T W + D, upper triangle.

    W are the star's angular velocities for one motor alone each, S is what turns with the star,
    D what turns with the motors, P what couples both.
    """
    b.section("generalised inertia")
    factors = [b.let(f"s_over_det_{k + 1}", legs.s[k] * A.one_over_det) for k in LEGS]
    W = [b.let_vector(f"w_{k + 1}", scaled(factors[k], A.columns[k])) for k in LEGS]
    S = upper("star_inertia")
    for k in LEGS:
        along_u = field("passive_inertia", k, 0) + field("rotor", k, 0)
        about_u = b.let_vector(f"about_u_{k + 1}", scaled(along_u, legs.u[k]))
        about_n = scaled(field("rotor", k, 1), legs.n[k])
        for axis, m in ((legs.u[k], about_u), (legs.n[k], about_n)):
            pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
            S = [entry + m[i] * axis[j] for entry, (i, j) in zip(S, pairs, strict=True)]
    names = ("xx", "xy", "xz", "yy", "yz", "zz")
    S = [b.let(f"inertia_{name}", x) for name, x in zip(names, S, strict=True)]
    P, D = [], []
    for k in LEGS:
        _, xy, xz, yy, yz, zz = upper("passive_inertia", k)
        rotor, s, c = field("rotor", k, 1), legs.s[k], legs.c[k]
        across = b.let(f"coupling_{k + 1}", xy * s + xz * c)
        turning = b.let(f"c_rotor_{k + 1}", rotor * c)
        coupling = minus(scaled(across, legs.u[k]), scaled(turning, legs.n[k]))
        P.append(b.let_vector(f"coupling_{k + 1}", coupling))
        D.append(field("link_inertia", k) + s * (yy * s + 2.0 * (yz * c)) + c * (zz * c + turning))
    Z = [b.let_vector(f"momentum_{k + 1}", symmetric(S, W[k])) for k in LEGS]
    M = {}
    for i in LEGS:
        for j in range(i, 3):
            entry = dot(W[i], plus(Z[j], P[j])) + dot(P[i], W[j])
            M[i, j] = b.let(f"m_{i + 1}{j + 1}", D[i] + entry if i == j else entry)
    return M


def solve_symmetric(
    b: Body, M: dict[tuple[int, int], Expr], right: list[Expr]
) -> tuple[list[Expr], Expr]:
    """M x = right by elimination, and the last two pivots relative to the diagonal."""
    b.section("solution of the 3 x 3 equations")
    l_2 = b.let("l_21", M[0, 1] / M[0, 0])
    l_3 = b.let("l_31", M[0, 2] / M[0, 0])
    d_2 = b.let("d_2", M[1, 1] - l_2 * M[0, 1])
    t = b.let("t_23", M[1, 2] - l_2 * M[0, 2])
    l_32 = b.let("l_32", t / d_2)
    d_3 = b.let("d_3", M[2, 2] - l_3 * M[0, 2] - l_32 * t)
    r_1 = b.let("r_1", right[0])
    r_2 = b.let("r_2", right[1] - l_2 * r_1)
    r_3 = b.let("r_3", right[2] - l_3 * r_1 - l_32 * r_2)
    x_3 = b.let("x_3", r_3 / d_3)
    x_2 = b.let("x_2", r_2 / d_2 - l_32 * x_3)
    x_1 = b.let("x_1", r_1 / M[0, 0] - l_2 * x_2 - l_3 * x_3)
    return [x_1, x_2, x_3], d_2 * d_3 / (M[1, 1] * M[2, 2])


def _nothing() -> list[Expr]:
    return [Expr.of(0.0)] * 9
