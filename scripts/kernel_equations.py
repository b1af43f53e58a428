# SPDX-License-Identifier: BSD-2-Clause
"""The mechanics of the SST as the kernels compute it.

In the axes of {2k} the star's angular velocity is (mu_dot, gamma_dot sin mu, gamma_dot cos mu +
beta_dot). Its y components are A omega = B gamma_dot, rows of A the axes y_2k and B = diag(sin
mu_k): one 3 x 3 matrix to invert, and all other rates are projections. The forces go back the
same way. Vectors of the star are in the axes of {31}, those of passive link k in {2k}.
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
    unit,
)

LEGS = range(3)
X, Y, Z = unit(0), unit(1), unit(2)


def field(name: str, *indices: int) -> Expr:
    """A number of the parameter vector."""
    return Expr(f"p->{name}" + "".join(f"[{i}]" for i in indices))


def row(name: str, k: int) -> Vector:
    """Row k of a (3, 3) array of the parameter vector; what is trivial for leg 1 is known."""
    if k == 0 and name in _OF_LEG_1:
        return _OF_LEG_1[name]
    x, y, z = (field(name, k, i) for i in range(3))
    return x, y, z


_OF_LEG_1 = dict(zip(("x_0", "y_0", "e", "x_3", "y_3", "n"), (X, Y, Z, X, Y, Z), strict=True))


def upper(name: str, *k: int) -> list[Expr]:
    return [field(name, *k, i) for i in range(6)]


def argument(name: str, size: int = 3) -> list[Expr]:
    return [Expr(f"{name}[{i}]") for i in range(size)]


def columns(matrix: list[Vector], x: list[Expr]) -> Vector:
    """The matrix with the given columns times x."""
    return plus(*(scaled(x_j, column) for x_j, column in zip(x, matrix, strict=True)))


@dataclass
class Legs:
    """Sines, cosines and axes of the three legs; vectors in {31}.

    Attributes:
        s, c: Of mu_k.
        s_gamma, c_gamma: Of gamma_k.
        u, y, n: Axes of {2k}: e_{k+3}, y_2k, e_{k+6}.
    """

    s: list[Expr]
    c: list[Expr]
    s_gamma: list[Expr]
    c_gamma: list[Expr]
    u: list[Vector]
    y: list[Vector]
    n: list[Vector]


def legs(b: Body) -> Legs:
    """Eqs. (26)-(35)."""
    b.section("sines and cosines")
    angles = []
    for i, q in enumerate(argument("q", 9)):
        name = f"{('gamma', 'mu', 'beta')[i % 3]}_{i // 3 + 1}"
        call = f"sst_sincos({q.text}, &s_{name}, &c_{name});"
        results = [f"s_{name}", f"c_{name}"]
        angles.append(b.statement(results, f"real {', '.join(results)};\n{call}"))
    u, y = [], []
    for k in LEGS:
        b.section(f"leg {k + 1}: axes of {{2{k + 1}}}")
        s_beta, c_beta = angles[3 * k + 2]
        x_3, y_3 = row("x_3", k), row("y_3", k)
        u.append(b.let_vector(f"u_{k + 1}", minus(scaled(c_beta, x_3), scaled(s_beta, y_3))))
        y.append(b.let_vector(f"y_{k + 1}", plus(scaled(s_beta, x_3), scaled(c_beta, y_3))))
    return Legs(
        s=[angles[3 * k + 1][0] for k in LEGS],
        c=[angles[3 * k + 1][1] for k in LEGS],
        s_gamma=[angles[3 * k][0] for k in LEGS],
        c_gamma=[angles[3 * k][1] for k in LEGS],
        u=u,
        y=y,
        n=[row("n", k) for k in LEGS],
    )


def base_axes(b: Body, legs: Legs) -> list[Vector]:
    """Axes of {01} as leg 1 sees them, in {31}."""
    b.section("axes of {01} by leg 1")
    s, c, s_gamma, c_gamma = legs.s[0], legs.c[0], legs.s_gamma[0], legs.c_gamma[0]
    y_11 = b.let_vector("y_11", minus(scaled(c, legs.y[0]), scaled(s, legs.n[0])))
    x = b.let_vector("x_01", minus(scaled(c_gamma, legs.u[0]), scaled(s_gamma, y_11)))
    y = b.let_vector("y_01", plus(scaled(s_gamma, legs.u[0]), scaled(c_gamma, y_11)))
    z = b.let_vector("z_01", plus(scaled(s, legs.y[0]), scaled(c, legs.n[0])))
    return [x, y, z]


def axes_by_both_ways(
    b: Body, legs: Legs, base: list[Vector], k: int
) -> tuple[tuple[Vector, Vector], tuple[Vector, Vector]]:
    """e_k and e_{k+3} in {31}: through leg 1 and the base, and through leg k and the star."""
    e = b.let_vector(f"e_{k + 1}", plus(scaled(legs.s[k], legs.y[k]), scaled(legs.c[k], legs.n[k])))
    u_0 = plus(scaled(legs.c_gamma[k], row("x_0", k)), scaled(legs.s_gamma[k], row("y_0", k)))
    u_0 = b.let_vector(f"u_0{k + 1}", u_0)
    e_by_1 = b.let_vector(f"e_{k + 1}_by_1", columns(base, list(row("e", k))))
    u_by_1 = b.let_vector(f"u_{k + 1}_by_1", columns(base, list(u_0)))
    return (e_by_1, u_by_1), (e, legs.u[k])


def openness(b: Body, legs: Legs, base: list[Vector]) -> Expr:
    """Sum of the squares by which the axes of legs 2 and 3 are off."""
    b.section("closures: axes of legs 2 and 3, by leg 1 and by themselves")
    squares = []
    for k in (1, 2):
        by_1, by_k = axes_by_both_ways(b, legs, base, k)
        for name, one, other in zip("eu", by_1, by_k, strict=True):
            off = b.let_vector(f"off_{name}_{k + 1}", minus(one, other))
            squares.append(dot(off, off))
    return b.let("gap", total(squares))


@dataclass
class Inverse:
    """A^-1 = columns / det."""

    columns: list[Vector]
    det: Expr
    one_over_det: Expr

    def times(self, b: Body, name: str, x: list[Expr]) -> Vector:
        return b.let_vector(name, scaled(self.one_over_det, columns(self.columns, x)))

    def transposed_times(self, x: Vector) -> list[Expr]:
        return [self.one_over_det * dot(column, x) for column in self.columns]


def inverse(b: Body, rows: list[Vector]) -> Inverse:
    b.section("inverse of A, whose rows are y_2k")
    a = [b.let_vector(f"a_{k + 1}", cross(rows[(k + 1) % 3], rows[(k + 2) % 3])) for k in LEGS]
    det = b.let("det", dot(rows[0], a[0]))
    return Inverse(a, det, b.let("one_over_det", Expr.of(1.0) / det))


@dataclass
class Rates:
    """Rates of all joints and of the star, and products that recur."""

    gamma: list[Expr]
    mu: list[Expr]
    beta: list[Expr]
    omega: Vector
    s_gamma: list[Expr]
    c_gamma: list[Expr]

    @property
    def joints(self) -> list[Expr]:
        return [x for triple in zip(self.gamma, self.mu, self.beta, strict=True) for x in triple]

    def link(self, k: int) -> Vector:
        """Angular velocity of passive link k in {2k}."""
        return self.mu[k], self.s_gamma[k], self.c_gamma[k]


def rates(b: Body, legs: Legs, A: Inverse, gamma_dot: list[Expr], mark: str = "") -> Rates:
    """A omega = B gamma_dot, and the passive joints by projection: Eq. (16).

    Args:
        b: Where it is written.
        legs: At q.
        A: Inverse of the axes y_2k.
        gamma_dot: Of the motors.
        mark: Tells the names apart when it is done more than once.
    """
    s = [b.let(f"s_gamma_dot{mark}_{k + 1}", legs.s[k] * gamma_dot[k]) for k in LEGS]
    c = [b.let(f"c_gamma_dot{mark}_{k + 1}", legs.c[k] * gamma_dot[k]) for k in LEGS]
    omega = A.times(b, f"omega{mark}_", s)
    mu = [b.let(f"mu_dot{mark}_{k + 1}", dot(legs.u[k], omega)) for k in LEGS]
    beta = [b.let(f"beta_dot{mark}_{k + 1}", dot(legs.n[k], omega) - c[k]) for k in LEGS]
    return Rates(gamma_dot, mu, beta, omega, s, c)


@dataclass
class Accelerations:
    gamma: list[Expr]
    mu: list[Expr]
    beta: list[Expr]
    alpha: Vector
    links: list[Vector]  # angular accelerations of the passive links in {2k}


def accelerations(
    b: Body, legs: Legs, A: Inverse, v: Rates, w: Rates, gamma_ddot: list[Expr], mark: str = ""
) -> Accelerations:
    """Rates of w, itself linear in motor rates, while the robot moves with v: Eqs. (8), (20).

    With w = v it is the motion itself; with w the rates for one motor alone it is a column of
    L_dot. The components in {31} and {2k} are differentiated, as these axes turn.
    """
    right = [legs.s[k] * gamma_ddot[k] + w.c_gamma[k] * v.mu[k] - v.beta[k] * w.mu[k] for k in LEGS]
    right = [b.let(f"y_alpha{mark}_{k + 1}", x) for k, x in enumerate(right)]
    alpha = A.times(b, f"alpha{mark}_", right)
    mu = [
        b.let(f"mu_ddot{mark}_{k + 1}", dot(legs.u[k], alpha) - v.beta[k] * w.s_gamma[k])
        for k in LEGS
    ]
    beta = [
        b.let(
            f"beta_ddot{mark}_{k + 1}",
            dot(legs.n[k], alpha) - legs.c[k] * gamma_ddot[k] + w.s_gamma[k] * v.mu[k],
        )
        for k in LEGS
    ]
    links = [
        b.let_vector(
            f"alpha{mark}_2{k + 1}",
            (
                mu[k],
                legs.s[k] * gamma_ddot[k] + w.c_gamma[k] * v.mu[k],
                legs.c[k] * gamma_ddot[k] - w.s_gamma[k] * v.mu[k],
            ),
        )
        for k in LEGS
    ]
    return Accelerations(gamma_ddot, mu, beta, alpha, links)


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


# --- the kernels: one function body each ----------------------------------------------------


def put_all(b: Body, name: str, values: list[Expr]) -> None:
    for i, value in enumerate(values):
        b.put(f"{name}[{i}]", value)


def inverse_dynamics() -> Body:
    b = Body()
    axes = legs(b)
    base = base_axes(b, axes)
    off = openness(b, axes, base)
    A = inverse(b, axes.y)
    b.section("rates")
    v = rates(b, axes, A, argument("va"))
    b.section("accelerations")
    a = accelerations(b, axes, A, v, v, argument("aa"))
    load = inertial(a) + weights(b, axes, base)
    b.section("inertia")
    load += gyroscopic(b, v)
    load += rubbing(b, v)
    load.star = minus(load.star, platform(b, base))
    b.section("loads, and the torques that carry them")
    put_all(b, "tau", at_the_motors(b, axes, A, load))
    put_all(b, "check", [off, A.det])
    return b


def direct_dynamics() -> Body:
    b = Body()
    axes = legs(b)
    base = base_axes(b, axes)
    off = openness(b, axes, base)
    A = inverse(b, axes.y)
    b.section("rates")
    v = rates(b, axes, A, argument("va"))
    b.section("accelerations with motors at constant rates")
    a = accelerations(b, axes, A, v, v, [Expr.of(0.0)] * 3)
    load = inertial(a) + weights(b, axes, base)
    b.section("inertia")
    load += gyroscopic(b, v)
    load += rubbing(b, v)
    load.star = minus(load.star, platform(b, base))
    b.section("loads, and the torques that are left")
    carried = at_the_motors(b, axes, A, load)
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
    axes = legs(b)
    base = base_axes(b, axes)
    off = openness(b, axes, base)
    A = inverse(b, axes.y)
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
    base = base_axes(b, axes)
    b.section("turns from leg 1 to legs 2 and 3")
    phi: list[Vector] = [(Expr.of(0.0),) * 3]
    squares = []
    for k in (1, 2):
        (e_1, u_1), (e_k, u_k) = axes_by_both_ways(b, axes, base, k)
        third_1 = b.let_vector(f"v_{k + 1}_by_1", cross(e_1, u_1))
        third_k = b.let_vector(f"v_{k + 1}", cross(e_k, u_k))
        twice = plus(cross(e_k, e_1), cross(u_k, u_1), cross(third_k, third_1))
        phi.append(b.let_vector(f"phi_{k + 1}", scaled(Expr("0.5"), twice)))
        off = minus(e_1, e_k), minus(u_1, u_k)
        off = tuple(b.let_vector(f"off_{n}_{k + 1}", o) for n, o in zip("eu", off, strict=True))
        squares += [dot(o, o) for o in off]
    A = inverse(b, axes.y)
    b.section("to where they meet")
    delta = A.times(b, "delta_", [dot(axes.y[k], phi[k]) for k in LEGS])
    for k in LEGS:
        turn = b.let_vector(f"turn_{k + 1}", minus(delta, phi[k]))
        b.put(f"q[{3 * k + 1}]", Expr(f"q[{3 * k + 1}]") + dot(axes.u[k], turn))
        b.put(f"q[{3 * k + 2}]", Expr(f"q[{3 * k + 2}]") + dot(axes.n[k], turn))
    put_all(b, "check", [total(squares), A.det])
    return b
