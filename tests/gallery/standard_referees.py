# SPDX-License-Identifier: BSD-2-Clause
"""The standard problems by equations of motion written by hand, sharing no code with the package.

A problem of one freedom without losses is its energy, a function of one angle x and its rate:
M(x) x'^2 / 2 + V(x) = E. Where the angle does not turn round, x' follows from it.
"""

import numpy as np
from scipy.integrate import solve_ivp

X, Y, Z = np.eye(3)


def turn(axis, angle):
    """Rotation about a coordinate axis."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R = np.eye(3)
    R[i, i] = R[j, j] = np.cos(angle)
    R[j, i] = np.sin(angle)
    R[i, j] = -R[j, i]
    return R


def by_energy(energy, x, rate, t):
    """The angle at times t: `energy(x)` gives M and V."""
    M, V = energy(x)
    total = M * rate**2 / 2 + V

    def slope(_, x):
        M, V = energy(x[0])
        return [np.sqrt(2 * (total - V) / M)]

    result = solve_ivp(slope, (t[0], t[-1]), [x], "DOP853", t, rtol=1e-13, atol=1e-13)
    return result.y[0]


def n_four_bar(loops, t):
    """A02: place of B0 at times t; all vertical bars turn alike, the others do not turn.

    They are loops + 1 bars of m L^2 / 3, half as high as the loops masses m at L.
    """
    inertia = (loops + 1) / 3 + loops
    weight = 9.81 * ((loops + 1) / 2 + loops)

    def slope(_, x):  # x from the upright, to the right
        return [x[1], weight / inertia * np.sin(x[0])]

    result = solve_ivp(slope, (0, t[-1]), [0.0, 1.0], "DOP853", t, rtol=1e-13, atol=1e-13)
    return np.stack([np.sin(result.y[0]), np.cos(result.y[0])], axis=1)


#: Bricard's linkage: the axes of its hinges, and the rods from one to the next.
AXES = (1, 2, 0, 1, 2)
EDGES = np.array([(1, 0, 0), (0, -1, 0), (0, 0, 1), (-1, 0, 0), (0, 1, 0)], dtype=float)
#: Differences of eighth order.
STEPS, WEIGHTS = np.array([1, 2, 3, 4]), np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])


def _bricard_at(q):
    """Ends of the rods, axes of the hinges and orientations of the rods."""
    R, ends, axes, turns = np.eye(3), [np.zeros(3)], [], []
    for axis, angle, edge in zip(AXES, q, EDGES, strict=True):
        axes.append(R[:, axis])
        R = R @ turn(axis, angle)
        turns.append(R)
        ends.append(ends[-1] + R @ edge)
    return np.array(ends), np.array(axes), turns


def _bricard_energy(first, guess):
    """M, V and all angles for the first, by Newton's method on the last hinge."""
    q = np.r_[first, guess[1:]]
    for _ in range(8):
        ends, axes, turns = _bricard_at(q)
        J = np.vstack([np.cross(axes, ends[-1] - ends[:-1]).T, np.cross(axes, turns[-1][:, 0]).T])
        gap = np.r_[ends[-1] - Z, turns[-1][:, 0] - X]
        step = np.linalg.lstsq(J[:, 1:], -gap, 1e-10)[0]
        q[1:] += step
        if np.abs(step).max() < 1e-14:
            break
    rates = np.r_[1.0, np.linalg.lstsq(J[:, 1:], -J[:, 0], 1e-10)[0]]
    M = V = 0.0
    for k, (R, edge) in enumerate(zip(turns, EDGES, strict=True)):
        omega = rates[: k + 1] @ axes[: k + 1]
        middle = (ends[k] + ends[k + 1]) / 2
        v = rates[: k + 1] @ np.cross(axes[: k + 1], middle - ends[: k + 1])
        squares = np.maximum(np.abs(edge), 0.1) ** 2  # of the edges of a box
        local = R.T @ omega
        M += v @ v + local @ ((squares.sum() - squares) / 12 * local)
        V += 9.81 * middle[1]
    return M, V, q


def bricard(t):
    """A04: place of P3 at times t; the equation of motion of the first hinge by differences."""
    last = np.zeros(5)

    def slope(_, x, h=0.01):
        nonlocal last
        M, _, last = _bricard_energy(x[0], last)
        sides = [[_bricard_energy(x[0] + s * k * h, last)[:2] for k in STEPS] for s in (1, -1)]
        M_x, V_x = WEIGHTS @ (np.array(sides[0]) - sides[1]) / h
        return [x[1], -(M_x * x[1] ** 2 / 2 + V_x) / M]

    result = solve_ivp(slope, (0, t[-1]), [0.0, 0.0], "DOP853", t, rtol=1e-11, atol=1e-11)
    places, last = [], np.zeros(5)
    for x in result.y[0]:
        last = _bricard_energy(x, last)[2]
        places.append(_bricard_at(last)[0][2])
    return np.array(places)


def _rod(centre, at, P, turns, target_rate, slide):
    """Rate of a slider, velocity of a rod's mass centre, and its angular velocity.

    The rod is held at `at` on the slider, which slides along `slide`, and turns about two axes; its
    end P has a given velocity, its mass centre lies at `centre` from `at`.
    """
    columns = [slide, *(np.cross(axis, P - at) for axis in turns)]
    s, a, b = np.linalg.solve(np.stack(columns, axis=1), target_rate)
    omega = a * turns[0] + b * turns[1]
    return s, s * slide + np.cross(omega, centre), omega


def slider_crank(t):
    """Crank angle and place of the slider at times t."""
    A, r, length = np.array([0, 0.1, 0.12]), 0.08, 0.3

    def placed(x):
        P = A + r * (np.cos(x) * Z - np.sin(x) * Y)
        return P, np.sqrt(length**2 - P[1] ** 2 - P[2] ** 2)

    def energy(x):
        P, slider = placed(x)
        P_rate = -r * (np.sin(x) * Z + np.cos(x) * Y)
        at = slider * X
        a = np.arctan2(-P[1], P[2])
        b = np.arctan2(np.hypot(P[1], P[2]), slider)
        R = turn(0, a) @ turn(1, b)
        axes = X, turn(0, a) @ Y
        s, v, omega = _rod((P - at) / 2, at, P, axes, P_rate, X)
        local = R.T @ omega
        M = 1e-4 + 0.12 * (r / 2) ** 2 + 2 * s**2 + 0.5 * v @ v
        M += local @ ([4e-4, 4e-3, 4e-3] * local)
        V = 9.81 * (0.12 * (A[2] + P[2]) / 2 + 0.5 * P[2] / 2)
        return M, V

    x = by_energy(energy, 0.0, 6.0, t)
    return x, np.array([placed(angle)[1] for angle in x])


#: Modelica's four-bar: vectors of the three bodies, radius and density of the cylinders.
BARS = (np.array([0, 0.5, 0.1]), np.array([0, 0.2, 0]), np.array([-1, 0.3, 0.1]))
RADIUS, DENSITY, RATE = 0.025, 7700.0, 5.235987755982989


def cylinder(bar):
    """Mass, and inertia about the mass centre, of a cylinder along a vector."""
    length = np.linalg.norm(bar)
    mass = DENSITY * np.pi * RADIUS**2 * length
    along, across = RADIUS**2 / 2, RADIUS**2 / 4 + length**2 / 12
    u = bar / length
    return mass, mass * (across * np.eye(3) + (along - across) * np.outer(u, u))


def modelica_four_bar(t, rod=True):
    """Angle of the first joint of Modelica's Fourbar1 at times t; of Fourbar2 without the rod.

    The rod of Fourbar2 has no mass.
    """
    first, second, third = BARS
    (m1, I1), (m2, _), (m3, I3) = map(cylinder, BARS)
    if not rod:
        m3, I3 = 0.0, 0 * I3

    def energy(x):
        R1 = turn(0, x)
        P = R1 @ first
        P_rate = np.cross(X, P)
        way = np.sqrt(third @ third - (P[1] - second[1]) ** 2 - P[2] ** 2)
        at = second + (P[0] + way) * X
        d = P - at
        # Turns about y and z take `third` to d.
        c = np.arctan2(third[1], third[0])
        gamma = np.pi - np.arcsin(d[1] / np.hypot(third[0], third[1])) - c
        inner = turn(2, gamma) @ third
        beta = np.arctan2(d[0], d[2]) - np.arctan2(inner[0], inner[2])
        R = turn(1, beta) @ turn(2, gamma)
        s, v, omega = _rod(d / 2, at, P, (Y, turn(1, beta) @ Z), P_rate, X)
        M = X @ I1 @ X + m1 * (P_rate @ P_rate) / 4 + m2 * s**2 + m3 * v @ v
        M += omega @ R @ I3 @ R.T @ omega
        V = 9.80665 * (m1 * P[1] / 2 + m3 * (at + d / 2)[1])
        return M, V

    return by_energy(energy, 0.0, RATE, t)


def governor(t, K=8e5, C=4e4):
    """A05: turn of the shaft, angle of the arms and height of the slider at times t.

    Both arms do the same. The angular momentum about the shaft, which nothing drives, is constant.
    """
    g, thin = 9.81, 0.01**2
    along, across = 0.3 * thin / 6, 0.3 * (1 + thin) / 12
    arm = 5 + 0.3 / 4 + across  # about its hinge
    around = along + 3 * 0.1**2 / 6  # shaft and slider about z

    def about_shaft(a):
        c, s = np.cos(a), np.sin(a)
        J = 5 * (0.05 + c) ** 2 + 0.3 * (0.05 + c / 2) ** 2 + across * c**2 + along * s**2
        J_a = -10 * s * (0.05 + c) - 0.3 * s * (0.05 + c / 2) - 2 * (across - along) * c * s
        return around + 2 * J, 2 * J_a

    def slope(_, x):
        _, a, z, a_rate, z_rate = x
        J, J_a = about_shaft(a)
        spin = momentum / J
        c, s = np.cos(a), np.sin(a)
        dx, dz = c / 2, 1 - s / 2 - z
        length = np.hypot(dx, dz)
        l_a, l_z = (-dx * s / 2 - dz * c / 2) / length, -dz / length
        pull = K * (length - 0.5) + C * (l_a * a_rate + l_z * z_rate)
        a_acceleration = J_a * spin**2 / 4 + g * c * (5 + 0.15) - pull * l_a
        return [spin, a_rate, z_rate, a_acceleration / arm, -2 * pull * l_z / 3 - g]

    start = [0.0, np.pi / 6, 0.5, 0.0, 0.0]
    momentum = 2 * np.pi * about_shaft(start[1])[0]
    with np.errstate(over="ignore"):  # SciPy's differences along the shaft's angle, which is free
        result = solve_ivp(slope, (0, t[-1]), start, "Radau", t, rtol=1e-11, atol=1e-12)
    return result.y[:3].T


def planar_loops(angle, rate, acceleration, h=0.01):
    """Torque of Modelica's planar loops; each argument has shape (N,).

    The upper hinges are where circles meet: the next one is on the bar from the one before and on
    the massless bar from its foot.
    """
    at_start = np.array([(0, 0.5), (0.6, 0.5), (1.1, 0.6), (1.5, 0.55)])
    feet = np.array([(0, 0), (0.5, 0), (1.0, 0), (1.5, 0)])
    bars = np.linalg.norm(np.diff(at_start, axis=0), axis=1)
    posts = np.linalg.norm(at_start - feet, axis=1)

    def middles(x):
        """Mass centres and angles of the three bars, (3, 3)."""
        upper = 0.5 * np.array([-np.sin(x), np.cos(x)])
        rows = []
        for k in (1, 2, 3):
            across = feet[k] - upper
            distance = np.hypot(*across)
            along = (bars[k - 1] ** 2 - posts[k] ** 2 + distance**2) / (2 * distance)
            up = np.sqrt(bars[k - 1] ** 2 - along**2)
            u = across / distance
            step = along * u + up * np.array([-u[1], u[0]])
            rows.append([*(upper + step / 2), np.arctan2(step[1], step[0])])
            upper = upper + step
        return np.array(rows)

    def slope(f, x):
        return (
            sum(w * (f(x + k * h) - f(x - k * h)) for k, w in zip(STEPS, WEIGHTS, strict=True)) / h
        )

    def M(x):
        rates = slope(middles, x)
        return np.sum(rates[:, :2] ** 2) + 0.001 * np.sum(rates[:, 2] ** 2)

    def V(x):
        return 9.80665 * middles(x)[:, 1].sum()

    return np.array(
        [
            M(x) * a + slope(M, x) * w**2 / 2 + slope(V, x)
            for x, w, a in zip(angle, rate, acceleration, strict=True)
        ]
    )
