# SPDX-License-Identifier: BSD-2-Clause
"""Measures of the equations and of the misprints that docs/paper.md lists.

A measure holds what the function gives against something that does not use it: vectors written
out, closed-form kinematics, differences in time, virtual work. Residuals are relative to the
largest entry, but for rows that name a unit.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import filterfalse
from typing import NamedTuple

import numpy as np

import printed_forms as forms
from example_1 import EXAMPLE_1
from printed_forms import FIRST, Case, Forms, error
from sst_pin import BRANCHES, SST, RigidBody, paper_circle
from sst_pin.arrays import Array
from sst_pin.sst import paper
from tests.referees.virtual_work import VirtualWork

SEED = 2012
#: Motions of the paper's robot, then one of each of as many random robots; seeds of five-bars.
STATES, ROBOTS, FIVE_BARS = 20, 20, range(SEED, SEED + 20)


def _worst(measure: Callable[[Case], float], cases: Sequence[Case]) -> float:
    return max(map(measure, cases))


class _Vectors(NamedTuple):
    axes: list[Array]
    c: Array
    spin: Array
    velocity: Array
    spin_rate: Array
    acceleration: Array


def _bodies(case: Case) -> list[RigidBody]:
    """The paper's seven: links, passive links, star."""
    p = case.parameters
    return [*p.links, *p.passive_links, p.star]


def _vectors(case: Case) -> _Vectors:
    """The seven bodies by vector geometry."""
    frames = case.frames()
    e, u = frames[:, 0, :, 2], frames[:, 1, :, 0]
    gamma_dot, mu_dot, _ = np.moveaxis(case.rates.reshape(3, 3, 1), 1, 0)
    gamma_ddot, mu_ddot, _ = np.moveaxis(case.accelerations.reshape(3, 3, 1), 1, 0)
    link, link_rate = gamma_dot * e, gamma_ddot * e
    passive = link + mu_dot * u
    passive_rate = link_rate + mu_ddot * u + mu_dot * np.cross(link, u)
    spin = np.vstack([link, passive, case.omega])
    spin_rate = np.vstack([link_rate, passive_rate, case.alpha])
    axes = [*frames[:, 1], *frames[:, 2], case.R]
    c = np.array([A @ body.center_of_mass for A, body in zip(axes, _bodies(case), strict=True)])
    velocity = np.cross(spin, c)
    acceleration = np.cross(spin_rate, c) + np.cross(spin, velocity)
    return _Vectors(axes, c, spin, velocity, spin_rate, acceleration)


#: Rows of K and T that are the paper's seven bodies, in its order.
_SEVEN = np.array([0, 3, 6, 1, 4, 7, 2])


def _seven(rows: Array) -> Array:
    return rows.reshape(9, 6, *rows.shape[1:])[_SEVEN]


def _blocks(case: Case) -> tuple[Array, Array, Array, Array, list[int], list[int]]:
    """(Phi^u)^-1, Phi^a, Phi_dot^a, Phi_dot^u, actuated and unactuated columns."""
    t, q = case.terms, case.motion[0]
    a = list(case.robot.actuated)
    u = [i for i in range(9) if i not in a]
    rows = [np.flatnonzero((case.robot.Phi(q) == row).all(axis=1))[0] for row in t.Phi]
    Phi_dot = case.robot.Phi_dot(q, case.rates)[rows]
    return np.linalg.inv(t.Phi[:, u]), t.Phi[:, a], Phi_dot[:, a], Phi_dot[:, u], a, u


def _arc_normals(case: Case) -> float:
    frames = case.frames()
    cross = np.cross(frames[:, 1, :, 0], case.R[:, 0])
    n = cross / np.linalg.norm(cross, axis=1)[:, None]
    n *= np.sign(np.sin(case.motion[0][2::3]))[:, None]
    return error(frames[:, 2, :, 2], n)


def _closures(case: Case) -> float:
    q = case.robot.inverse_kinematics(case.R, BRANCHES)
    return max(float(np.abs(case.robot.residual(x)).max()) for x in q)


def _slope_of_residual(case: Case) -> float:
    q, h = case.motion[0], 1e-5
    f = case.robot.residual
    slope = np.array([(f(q + h * d) - f(q - h * d)) / (2 * h) for d in np.eye(9)]).T
    return error(case.robot.Phi(q), slope)


def _no_open_rate(case: Case) -> float:
    Phi = case.robot.Phi(case.motion[0])
    return float(np.abs(Phi @ case.rates).max() / np.abs(case.rates).max())


def _complement(case: Case) -> float:
    inverse, Phi_a, *_, a, u = _blocks(case)
    L = np.empty((9, 3))
    L[a], L[u] = np.eye(3), -inverse @ Phi_a
    return error(case.terms.L, L)


def _annihilated(case: Case) -> float:
    Phi = case.robot.Phi(case.motion[0])
    return float(np.abs(Phi @ case.terms.L).max() / np.abs(case.terms.L).max())


def _rates(case: Case) -> float:
    return error(case.robot.joint_rates(*case.motion[:2]), case.rates)


def _accelerations(case: Case) -> float:
    _, va, aa = case.motion
    inverse, Phi_a, A_dot, U_dot, a, u = _blocks(case)
    printed = np.empty(9)
    q_dot = case.rates
    printed[a], printed[u] = aa, -inverse @ (A_dot @ va + U_dot @ q_dot[u] + Phi_a @ aa)
    ours = case.terms.L @ aa + case.terms.L_dot @ va
    return max(error(x, case.accelerations) for x in (printed, ours))


def _twists(case: Case) -> float:
    v = _vectors(case)
    return error(_seven(case.terms.T @ case.motion[1]), np.hstack([v.spin, v.velocity]))


def _twist_rates(case: Case) -> float:
    _, va, aa = case.motion
    v, t = _vectors(case), case.terms
    wanted = np.hstack([v.spin_rate, v.acceleration])
    by_joints = t.K @ case.accelerations + t.K_dot @ case.rates
    return max(error(_seven(x), wanted) for x in (by_joints, t.T @ aa + t.T_dot @ va))


def _complement_of_bodies(case: Case) -> float:
    inverse, Phi_a, A_dot, U_dot, a, u = _blocks(case)
    t, X = case.terms, inverse @ Phi_a
    T = t.K[:, a] - t.K[:, u] @ X
    T_dot = t.K_dot[:, a] - t.K_dot[:, u] @ X + t.K[:, u] @ inverse @ (U_dot @ X - A_dot)
    return max(error(t.T, T), error(t.T_dot, T_dot))


def _orientation(case: Case) -> float:
    ends = case.frames()[:, 3]  # {3k}
    _, alpha_2, alpha_3 = case.parameters.arc_angles
    chains = []
    for end, angle in zip(ends, (0.0, -alpha_2, -(alpha_2 + alpha_3)), strict=True):
        c, s = np.cos(angle), np.sin(angle)
        chains.append(end @ ((1, 0, 0), (0, c, -s), (0, s, c)))
    found = case.robot.platform_orientation(case.motion[0])
    return max(error(found, case.R), *(error(chain, case.R) for chain in chains))


def _body_jacobians(case: Case) -> float:
    frames, c = case.frames(), _vectors(case).c
    axes = np.stack([frames[:, 0, :, 2], frames[:, 1, :, 0], frames[:, 2, :, 2]], axis=1)
    K = np.zeros((7, 6, 9))
    for body in range(7):
        leg, joints = (body % 3, body // 3 + 1) if body < 6 else (0, 3)
        for j in range(joints):
            axis = axes[leg, j]
            K[body, :, 3 * leg + j] = [*axis, *np.cross(axis, c[body])]
    return error(_seven(case.terms.K), K)


def _momenta(case: Case) -> float:
    _, va, aa = case.motion
    t = case.terms
    wrench = t.M @ (t.T @ aa + t.T_dot @ va) + t.Omega @ t.M @ t.T @ va
    near = [(case.robot.noc(*sample), sample[1]) for sample in case.line]
    return error(wrench, FIRST @ [n.M @ n.T @ va_t for n, va_t in near])


def _inertia_and_weight(case: Case) -> float:
    _, va, aa = case.motion
    t = case.terms
    weights = np.zeros((9, 6))
    for i, body in enumerate(list(case.robot.model.inertias)[1:]):
        weights[i, 3:] = body.mass * case.parameters.gravity
    inertia = -t.M @ (t.T @ aa + t.T_dot @ va) - t.Omega @ t.M @ t.T @ va
    tau = -t.T.T @ (inertia + weights.ravel()) - t.friction
    return error(case.robot.compute_torques(*case.motion), tau)


def _virtual_work(case: Case, *moment: Array) -> Array:
    return VirtualWork(case.parameters).torques(case.R, case.omega, case.alpha, *moment)


def _powers(case: Case) -> float:
    _, va, aa = case.motion
    t = case.terms
    inertia, weight = -(t.inertia @ aa + t.coriolis @ va) @ va, t.gravity @ va
    parts = [_virtual_work(case) @ va, inertia, weight, case.robot.friction_power(*case.motion[:2])]
    return float(abs(sum(parts)) / max(map(abs, parts)))


def _friction(case: Case) -> float:
    p, va = case.parameters, case.motion[1]
    force = -(p.viscous_friction * case.rates + p.coulomb_friction * np.sign(case.rates))
    power = force @ case.rates
    if not power:
        return 0.0
    found = case.terms.friction @ va, case.robot.friction_power(*case.motion[:2])
    return max(error(x, power) for x in found)


def _long_form(case: Case) -> float:
    _, va, aa = case.motion
    t = case.terms
    long = t.inertia @ aa + t.coriolis @ va - t.gravity - t.friction
    return error(long, _virtual_work(case))


def _kinetic_energy(case: Case) -> float:
    v, va, energy = _vectors(case), case.motion[1], 0.0
    for i, body in enumerate(_bodies(case)):
        spin = v.axes[i].T @ v.spin[i]
        energy += (body.mass * v.velocity[i] @ v.velocity[i] + spin @ body.inertia @ spin) / 2
    return error(va @ case.terms.inertia @ va / 2, energy)


def _passivity(case: Case) -> float:
    slope = np.einsum("t,tij->ij", FIRST, [case.robot.noc(*sample).inertia for sample in case.line])
    skew = slope - 2 * case.terms.coriolis
    return float(np.abs(skew + skew.T).max() / np.abs(slope).max())


def _weight(case: Case) -> float:
    still = VirtualWork(case.parameters).torques(case.R, np.zeros(3), np.zeros(3))
    return error(-case.terms.gravity, still)


def _inverse_dynamics(case: Case) -> float:
    moment = np.array((3.0, -1, 2))
    found = case.robot.compute_torques(*case.motion, platform_moment=moment)
    return error(found, _virtual_work(case, moment))


def _direct_dynamics(case: Case) -> float:
    q, va, aa = case.motion
    return error(case.robot.compute_accelerations(q, va, _virtual_work(case)), aa)


def _example_1(_: Sequence[Case]) -> float:
    motion = paper.example_1(SST(), list(EXAMPLE_1))
    return float(np.abs(motion.tau - list(EXAMPLE_1.values())).max())


def _initial_state(_: Sequence[Case]) -> float:
    q, va, _ = SST().joint_motion(*paper_circle(0.0))
    printed = (*paper.ROUNDED_GAMMA, *paper.ROUNDED_GAMMA_DOT)
    return float(np.abs(np.subtract((*q[::3], *va), printed)).max())


def _example_2(_: Sequence[Case]) -> float:
    robot = SST()
    example = paper.example_1(robot, np.linspace(0, paper.PERIOD, 201))
    return paper.compare(robot, example, paper.example_2(robot, example)).path_error


#: The residual of each row of the page's table of equations in one case.
_OF_A_CASE: dict[str, Callable[[Case], float]] = {
    "(1)": _arc_normals,
    "(2), (37)": _closures,
    "(3)": _no_open_rate,
    "(4), (5)": _slope_of_residual,
    "(6), (7), (17)": _complement,
    "(7b), (8), (20)": _accelerations,
    "(9)-(14), (21)": _twists,
    "(15), (24)": _twist_rates,
    "(16)": _rates,
    "(18), (19)": _annihilated,
    "(22), (23), (25)": _complement_of_bodies,
    "(26)-(36)": _orientation,
    "(38)-(62)": _body_jacobians,
    "(63)-(71)": _momenta,
    "(72)-(82)": _powers,
    "(83)-(91)": _inertia_and_weight,
    "(87), (88), (96)": _friction,
    "(92)": _long_form,
    "(93)": _kinetic_energy,
    "(94)": _passivity,
    "(95)": _weight,
    "Sect. 6.1": _inverse_dynamics,
    "Sect. 6.2": _direct_dynamics,
}
#: The worst residual of each row of the page's table of equations in some cases.
EQUATIONS: dict[str, Callable[[Sequence[Case]], float]] = {
    **{numbers: partial(_worst, measure) for numbers, measure in _OF_A_CASE.items()},
    "Sect. 7.2": _example_1,
    "Sect. 7.3": _initial_state,
    "Sects. 6.2, 7.3": _example_2,
}


def _rubs(case: Case) -> bool:
    """Whether the joints have friction: the random robots' have, the paper's have none."""
    return bool(case.parameters.coulomb_friction.any())


#: Errors of both forms of the misprints; the others are words or shapes.
MISPRINTS: dict[str, Callable[[Sequence[Case]], Iterator[Forms]]] = {
    "(1)": lambda _: map(forms.arc_normal, forms.circle(24)),
    "(7c)": lambda _: map(forms.passive_accelerations, map(np.random.default_rng, FIVE_BARS)),
    "(20)": partial(map, forms.rate_of_joint_rates),
    "(54)": lambda cases: map(forms.center_of_star, filterfalse(_rubs, cases)),
    "(59)-(61)": partial(map, forms.spins_of_passive_links),
    "(62), lower row": partial(map, forms.velocity_of_star),
    "(67)": partial(map, forms.gyroscopic_moments),
    "(63), (74)-(76)": partial(map, forms.power_of_inertia),
    "(87)-(96)": lambda cases: map(forms.balance_of_powers, filter(_rubs, cases)),
}
