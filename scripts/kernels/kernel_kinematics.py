# SPDX-License-Identifier: BSD-2-Clause
"""Kinematics of the SST as the kernels compute it.

In the axes of {2k} the star's angular velocity is (mu_dot, gamma_dot sin mu, gamma_dot cos mu +
beta_dot). Its y components are A omega = B gamma_dot, rows of A the axes y_2k and B = diag(sin
mu_k): one 3 x 3 matrix to invert, and all other rates are projections. Vectors of the star are in
the axes of {31}, those of passive link k in {2k}.
"""

from __future__ import annotations

from dataclasses import dataclass

from c_expressions import Body, Expr, Vector, cross, dot, minus, plus, scaled, total, unit

#: e_k and e_{k+3} of a leg.
Axes = tuple[Vector, Vector]

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


def axes_by_both_ways(b: Body, legs: Legs, base: list[Vector]) -> list[tuple[Axes, Axes]]:
    """e_k and e_{k+3} of legs 2 and 3 in {31}: by leg 1 and the base, by leg k and the star."""
    b.section("closures: axes of legs 2 and 3, by leg 1 and by themselves")
    ways = []
    for k in (1, 2):
        s, c, s_gamma, c_gamma = legs.s[k], legs.c[k], legs.s_gamma[k], legs.c_gamma[k]
        e = b.let_vector(f"e_{k + 1}", plus(scaled(s, legs.y[k]), scaled(c, legs.n[k])))
        u_0 = plus(scaled(c_gamma, row("x_0", k)), scaled(s_gamma, row("y_0", k)))
        u_0 = b.let_vector(f"u_0{k + 1}", u_0)
        e_by_1 = b.let_vector(f"e_{k + 1}_by_1", columns(base, list(row("e", k))))
        u_by_1 = b.let_vector(f"u_{k + 1}_by_1", columns(base, list(u_0)))
        ways.append(((e_by_1, u_by_1), (e, legs.u[k])))
    return ways


def openness(b: Body, ways: list[tuple[Axes, Axes]]) -> Expr:
    """Sum of the squares by which the axes of legs 2 and 3 are off."""
    squares = []
    for k, way in zip((2, 3), ways, strict=True):
        for name, one, other in zip("eu", *way, strict=True):
            off = b.let_vector(f"off_{name}_{k}", minus(one, other))
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
