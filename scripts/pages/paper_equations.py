# SPDX-License-Identifier: BSD-2-Clause
"""Equations and misprints of the paper: our function, the tests, and a measure of each.

A measure holds what the function gives against something that does not use it: vectors written
out, closed-form kinematics, differences in time, virtual work. Residuals are relative to the
largest entry, but for rows that name a unit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import printed_forms as forms
from printed_forms import FIRST, Case, Forms, error
from reference import EXAMPLE_1
from sst_pin import BRANCHES, SST, paper_circle
from sst_pin.sst import paper
from sst_pin.verification.virtual_work import VirtualWork

Array = NDArray[np.float64]

SEED = 2012
#: Motions of the paper's robot, then one of each of as many random robots.
STATES, ROBOTS = 20, 20


class Equation(NamedTuple):
    """A row of the table of equations.

    Attributes:
        numbers: Numbers of the equations, or of the section.
        what: They are about.
        functions: Ours, with the module, without the package.
        tests: As file::name, without the ending of the file.
        against: What the measure compares with.
        measure: Worst residual of some cases.
    """

    numbers: str
    what: str
    functions: tuple[str, ...]
    tests: tuple[str, ...]
    against: str
    measure: Callable[[Sequence[Case]], float]


class Misprint(NamedTuple):
    """A row of the table of misprints.

    Attributes:
        where: Equation or section.
        printed: What stands there.
        holds: What holds.
        test: As in `Equation`.
        forms: Errors of both forms in some cases; None where words or shapes decide.
    """

    where: str
    printed: str
    holds: str
    test: str
    forms: Callable[[Sequence[Case]], Iterator[Forms]] | None


# --- measures -----------------------------------------------------------------------------------


def _worst(measure: Callable[[Case], float]) -> Callable[[Sequence[Case]], float]:
    """A measure of one case as one of many."""
    return lambda cases: max(map(measure, cases))


class _Vectors(NamedTuple):
    """Seven bodies by vector geometry: links, passive links, star."""

    c: Array
    spin: Array
    velocity: Array
    spin_rate: Array
    acceleration: Array


def _vectors(case: Case) -> _Vectors:
    p, frames = case.parameters, case.frames()
    e, u = frames[:, 0, :, 2], frames[:, 1, :, 0]
    gamma_dot, mu_dot, _ = np.moveaxis(case.rates.reshape(3, 3, 1), 1, 0)
    gamma_ddot, mu_ddot, _ = np.moveaxis(case.accelerations.reshape(3, 3, 1), 1, 0)
    link, link_rate = gamma_dot * e, gamma_ddot * e
    passive = link + mu_dot * u
    passive_rate = link_rate + mu_ddot * u + mu_dot * np.cross(link, u)
    spin = np.vstack([link, passive, case.omega])
    spin_rate = np.vstack([link_rate, passive_rate, case.alpha])
    axes = [*frames[:, 1], *frames[:, 2], case.R]
    bodies = [*p.links, *p.passive_links, p.star]
    c = np.array([A @ body.center_of_mass for A, body in zip(axes, bodies, strict=True)])
    velocity = np.cross(spin, c)
    acceleration = np.cross(spin_rate, c) + np.cross(spin, velocity)
    return _Vectors(c, spin, velocity, spin_rate, acceleration)


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


@_worst
def _arc_normals(case: Case) -> float:
    frames = case.frames()
    cross = np.cross(frames[:, 1, :, 0], case.R[:, 0])
    n = cross / np.linalg.norm(cross, axis=1)[:, None]
    n *= np.sign(np.sin(case.motion[0][2::3]))[:, None]
    return error(frames[:, 2, :, 2], n)


@_worst
def _closures(case: Case) -> float:
    q = case.robot.inverse_kinematics(case.R, BRANCHES)
    return max(float(np.abs(case.robot.residual(x)).max()) for x in q)


@_worst
def _slope_of_residual(case: Case) -> float:
    q, h = case.motion[0], 1e-5
    f = case.robot.residual
    slope = np.array([(f(q + h * d) - f(q - h * d)) / (2 * h) for d in np.eye(9)]).T
    return error(case.robot.Phi(q), slope)


@_worst
def _no_open_rate(case: Case) -> float:
    Phi = case.robot.Phi(case.motion[0])
    return float(np.abs(Phi @ case.rates).max() / np.abs(case.rates).max())


@_worst
def _complement(case: Case) -> float:
    inverse, Phi_a, *_, a, u = _blocks(case)
    L = np.empty((9, 3))
    L[a], L[u] = np.eye(3), -inverse @ Phi_a
    return error(case.terms.L, L)


@_worst
def _annihilated(case: Case) -> float:
    Phi = case.robot.Phi(case.motion[0])
    return float(np.abs(Phi @ case.terms.L).max() / np.abs(case.terms.L).max())


@_worst
def _rates(case: Case) -> float:
    return error(case.robot.joint_rates(*case.motion[:2]), case.rates)


@_worst
def _accelerations(case: Case) -> float:
    _, va, aa = case.motion
    inverse, Phi_a, A_dot, U_dot, a, u = _blocks(case)
    printed = np.empty(9)
    q_dot = case.rates
    printed[a], printed[u] = aa, -inverse @ (A_dot @ va + U_dot @ q_dot[u] + Phi_a @ aa)
    ours = case.terms.L @ aa + case.terms.L_dot @ va
    return max(error(x, case.accelerations) for x in (printed, ours))


@_worst
def _twists(case: Case) -> float:
    v = _vectors(case)
    return error(_seven(case.terms.T @ case.motion[1]), np.hstack([v.spin, v.velocity]))


@_worst
def _twist_rates(case: Case) -> float:
    _, va, aa = case.motion
    v, t = _vectors(case), case.terms
    wanted = np.hstack([v.spin_rate, v.acceleration])
    by_joints = t.K @ case.accelerations + t.K_dot @ case.rates
    return max(error(_seven(x), wanted) for x in (by_joints, t.T @ aa + t.T_dot @ va))


@_worst
def _complement_of_bodies(case: Case) -> float:
    inverse, Phi_a, A_dot, U_dot, a, u = _blocks(case)
    t, X = case.terms, inverse @ Phi_a
    T = t.K[:, a] - t.K[:, u] @ X
    T_dot = t.K_dot[:, a] - t.K_dot[:, u] @ X + t.K[:, u] @ inverse @ (U_dot @ X - A_dot)
    return max(error(t.T, T), error(t.T_dot, T_dot))


@_worst
def _orientation(case: Case) -> float:
    ends = case.frames()[:, 3]  # {3k}
    _, alpha_2, alpha_3 = case.parameters.arc_angles
    chains = []
    for end, angle in zip(ends, (0.0, -alpha_2, -(alpha_2 + alpha_3)), strict=True):
        c, s = np.cos(angle), np.sin(angle)
        chains.append(end @ ((1, 0, 0), (0, c, -s), (0, s, c)))
    found = case.robot.platform_orientation(case.motion[0])
    return max(error(found, case.R), *(error(chain, case.R) for chain in chains))


@_worst
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


@_worst
def _momenta(case: Case) -> float:
    _, va, aa = case.motion
    t = case.terms
    wrench = t.M @ (t.T @ aa + t.T_dot @ va) + t.Omega @ t.M @ t.T @ va
    near = [(case.robot.noc(*sample), sample[1]) for sample in case.line]
    return error(wrench, FIRST @ [n.M @ n.T @ va_t for n, va_t in near])


@_worst
def _inertia_and_weight(case: Case) -> float:
    _, va, aa = case.motion
    t = case.terms
    weights = np.zeros((9, 6))
    for i, body in enumerate(list(case.robot.model.inertias)[1:]):
        weights[i, 3:] = body.mass * case.parameters.gravity
    inertia = -t.M @ (t.T @ aa + t.T_dot @ va) - t.Omega @ t.M @ t.T @ va
    tau = -t.T.T @ (inertia + weights.ravel()) - t.friction
    return error(case.robot.compute_torques(*case.motion), tau)


@_worst
def _powers(case: Case) -> float:
    _, va, aa = case.motion
    t = case.terms
    parts = np.array(
        [
            VirtualWork(case.parameters).torques(case.R, case.omega, case.alpha) @ va,
            -(t.inertia @ aa + t.coriolis @ va) @ va,
            t.gravity @ va,
            case.robot.friction_power(*case.motion[:2]),
        ]
    )
    return float(abs(parts.sum()) / np.abs(parts).max())


@_worst
def _friction(case: Case) -> float:
    p, va = case.parameters, case.motion[1]
    force = -(p.viscous_friction * case.rates + p.coulomb_friction * np.sign(case.rates))
    power = force @ case.rates
    if not power:
        return 0.0
    found = case.terms.friction @ va, case.robot.friction_power(*case.motion[:2])
    return max(error(x, power) for x in found)


@_worst
def _long_form(case: Case) -> float:
    _, va, aa = case.motion
    t = case.terms
    long = t.inertia @ aa + t.coriolis @ va - t.gravity - t.friction
    return error(long, VirtualWork(case.parameters).torques(case.R, case.omega, case.alpha))


@_worst
def _kinetic_energy(case: Case) -> float:
    p, v, va = case.parameters, _vectors(case), case.motion[1]
    frames = case.frames()
    axes = [*frames[:, 1], *frames[:, 2], case.R]
    energy = 0.0
    for i, body in enumerate((*p.links, *p.passive_links, p.star)):
        spin = axes[i].T @ v.spin[i]
        energy += (body.mass * v.velocity[i] @ v.velocity[i] + spin @ body.inertia @ spin) / 2
    return error(va @ case.terms.inertia @ va / 2, energy)


@_worst
def _passivity(case: Case) -> float:
    slope = np.einsum("t,tij->ij", FIRST, [case.robot.noc(*sample).inertia for sample in case.line])
    skew = slope - 2 * case.terms.coriolis
    return float(np.abs(skew + skew.T).max() / np.abs(slope).max())


@_worst
def _weight(case: Case) -> float:
    still = VirtualWork(case.parameters).torques(case.R, np.zeros(3), np.zeros(3))
    return error(-case.terms.gravity, still)


@_worst
def _inverse_dynamics(case: Case) -> float:
    moment = np.array((3.0, -1, 2))
    wanted = VirtualWork(case.parameters).torques(case.R, case.omega, case.alpha, moment)
    return error(case.robot.compute_torques(*case.motion, platform_moment=moment), wanted)


@_worst
def _direct_dynamics(case: Case) -> float:
    q, va, aa = case.motion
    tau = VirtualWork(case.parameters).torques(case.R, case.omega, case.alpha)
    return error(case.robot.compute_accelerations(q, va, tau), aa)


def _example_1(_: Sequence[Case]) -> float:
    motion = paper.example_1(SST(kernels=False), list(EXAMPLE_1))
    return float(np.abs(motion.tau - list(EXAMPLE_1.values())).max())


def _initial_state(_: Sequence[Case]) -> float:
    q, va, _ = SST().joint_motion(*paper_circle(0.0))
    printed = (*paper.ROUNDED_GAMMA, *paper.ROUNDED_GAMMA_DOT)
    return float(np.abs(np.subtract((*q[::3], *va), printed)).max())


def _example_2(_: Sequence[Case]) -> float:
    robot = SST(kernels=False)
    example = paper.example_1(robot, np.linspace(0, paper.PERIOD, 201))
    return paper.compare(robot, example, paper.example_2(robot, example)).path_error


# --- tables -------------------------------------------------------------------------------------

_NOC, _DYNAMICS, _KINEMATICS, _WORK = (
    f"test_{name}::test_" for name in ("noc", "dynamics", "kinematics", "virtual_work")
)
_MISPRINTS, _REFEREES, _TIME = (
    f"test_{name}::test_" for name in ("misprints", "referees", "simulation")
)

EQUATIONS = (
    Equation(
        "(1)", "normals e_{k+6} of the arcs", ("kinematics.Legs", "kinematics.legs_of_orientation"),
        (_MISPRINTS + "cross_product_of_eq_1_points_against_the_axis_of_eq_44",),
        "z axes of {2k}, Eqs. (27), (28), with the sign that beta_k asks for", _arc_normals,
    ),
    Equation(
        "(2), (37)", "closures f(q) = 0",
        ("closed_chain.ClosedChain.residual", "robot.SST.inverse_kinematics"),
        (_KINEMATICS + "inverse_kinematics_closes_the_loops_on_all_branches",),
        "zero, on all eight branches (rad)", _closures,
    ),
    Equation(
        "(3)", "Phi q_dot = 0", ("closed_chain.ClosedChain.Phi",),
        ("test_other_robots::test_L_is_an_orthogonal_complement_of_Phi",),
        "joint rates in closed form", _no_open_rate,
    ),
    Equation(
        "(4), (5)", "Phi, the Jacobian of f", ("loops.Loops.Phi",),
        (_NOC + "phi_is_the_derivative_of_the_residual",),
        "differences of f of second order, off the closures", _slope_of_residual,
    ),
    Equation(
        "(6), (7), (17)", "L", ("noc.JointComplement.factorise",),
        (_NOC + "L_is_the_block_formula_of_the_paper",), "the blocks of (17), sorted as in (6)",
        _complement,
    ),
    Equation(
        "(7b), (8), (20)", "q_ddot, L_dot", ("noc.JointComplement.L_dot", "loops.Loops.Phi_dot"),
        (_NOC + "rates_are_the_derivatives_along_the_motion",
         _MISPRINTS + "eq_20_gives_accelerations"),
        "joint accelerations in closed form", _accelerations,
    ),
    Equation(
        "(9)-(14), (21)", "twists t = K q_dot = T va", ("noc.body_jacobians",),
        (_NOC + "twists_are_those_of_the_mass_centres",),
        "spins and velocities of seven bodies, vectors written out", _twists,
    ),
    Equation(
        "(15), (24)", "their rates, K_dot and T_dot", ("noc.bodies",),
        (_NOC + "rates_are_the_derivatives_along_the_motion",),
        "accelerations of seven bodies, vectors written out", _twist_rates,
    ),
    Equation(
        "(16)", "q_dot = L va", ("closed_chain.ClosedChain.joint_rates",),
        (_KINEMATICS + "platform_velocity_inverts_joint_motion",), "joint rates in closed form",
        _rates,
    ),
    Equation(
        "(18), (19)", "Phi L = 0", ("noc.JointComplement",),
        (_NOC + "the_closures_keep_nothing_of_L",), "zero, all twelve rows", _annihilated,
    ),
    Equation(
        "(22), (23), (25)", "T, T_dot", ("noc.natural_complement",),
        (_NOC + "T_and_its_rate_are_the_block_formulas_of_the_paper",),
        "the blocks of (23) and (25)", _complement_of_bodies,
    ),
    Equation(
        "(26)-(36)", "three chains to {E}",
        ("kinematics.orientation_of_joints", "frames.base_orientations"),
        (_KINEMATICS + "inverse_kinematics_closes_the_loops_on_all_branches",),
        "products of rotations, leg by leg", _orientation,
    ),
    Equation(
        "(38)-(62)", "K of the seven bodies", ("noc.bodies",),
        (_NOC + "K_of_the_seven_bodies_is_that_of_the_paper",),
        "e_i and r_ij written out, plus signs", _body_jacobians,
    ),
    Equation(
        "(63)-(71)", "w* = -M t_dot - Omega M t", ("noc.bodies",),
        (_NOC + "kinetic_energy_is_half_the_quadratic_form_of_the_inertia",
         _MISPRINTS + "omega_of_eq_67_is_a_cross_product_matrix"),
        "differences of the momenta M t in time", _momenta,
    ),
    Equation(
        "(72)-(82)", "sum of powers", ("closed_chain.ClosedChain.friction_power",),
        (_DYNAMICS + "power_of_the_motors_is_the_rate_of_the_energy_and_the_losses",),
        "zero, the motors' power by virtual work", _powers,
    ),
    Equation(
        "(83)-(91)", "tau from the wrenches",
        ("dynamics.inverse_dynamics", "robot.SST.compute_torques"),
        (_DYNAMICS + "long_form_equals_short_form",), "(89) with the wrenches of (68)",
        _inertia_and_weight,
    ),
    Equation(
        "(87), (88), (96)", "friction through L", ("mechanism.Friction.forces",),
        (_NOC + "friction_dissipates_and_maps_through_L",
         _DYNAMICS + "friction_of_every_joint_reaches_the_motors"),
        "power of friction in the nine joints", _friction,
    ),
    Equation(
        "(92)", "tau = I aa + C va - tau^g - tau^f",
        ("dynamics.terms", "closed_chain.ClosedChain.noc"),
        (_WORK + "terms_of_the_long_form_add_up_to_the_torques",), "virtual work", _long_form,
    ),
    Equation(
        "(93)", "I", ("dynamics.Terms",), (_NOC + "inertia_is_symmetric_and_positive_definite",),
        "kinetic energy of seven bodies, vectors written out", _kinetic_energy,
    ),
    Equation(
        "(94)", "C", ("dynamics.Terms",), (_NOC + "inertia_rate_minus_twice_coriolis_is_skew",),
        "I_dot - 2 C skew, I_dot by differences", _passivity,
    ),
    Equation(
        "(95)", "tau^g", ("dynamics.Terms",),
        (_NOC + "gravity_is_minus_the_gradient_of_the_potential_energy",), "virtual work at rest",
        _weight,
    ),
    Equation(
        "Sect. 6.1", "inverse dynamics", ("robot.SST.compute_torques", "robot.SST.joint_motion"),
        (_WORK + "torques_of_any_robot_agree_at_any_motion",
         _REFEREES + "a_referee_agrees_for_random_robots"),
        "virtual work, a moment on the star", _inverse_dynamics,
    ),
    Equation(
        "Sect. 6.2", "direct dynamics",
        ("dynamics.direct_dynamics", "robot.SST.compute_accelerations"),
        (_WORK + "accelerations_agree_at_any_torques",),
        "the motion whose torques virtual work gave", _direct_dynamics,
    ),
    Equation(
        "Sect. 7.2", "example 1", ("paper.example_1", "platform_motion.paper_circle"),
        (_DYNAMICS + "torques_of_example_1_are_the_reference",),
        "40-digit arithmetic at four instants (N m)", _example_1,
    ),
    Equation(
        "Sect. 7.3", "initial state", ("robot.SST.joint_motion",),
        (_KINEMATICS + "initial_conditions_of_the_paper_come_out_to_every_printed_digit",),
        "the four printed decimals (rad, rad/s)", _initial_state,
    ),
    Equation(
        "Sects. 6.2, 7.3", "example 2", ("paper.example_2", "simulation.simulate"),
        (_TIME + "example_2_returns_to_the_circle",), "the circle (rad)", _example_2,
    ),
)  # fmt: skip


def _each(form: Callable[[Case], Forms]) -> Callable[[Sequence[Case]], Iterator[Forms]]:
    return lambda cases: map(form, cases)


def _of_the_papers(form: Callable[[Case], Forms]) -> Callable[[Sequence[Case]], Iterator[Forms]]:
    return lambda cases: map(form, cases[:STATES])


def _rubbing(form: Callable[[Case], Forms]) -> Callable[[Sequence[Case]], Iterator[Forms]]:
    return lambda cases: map(form, cases[STATES:])


def _on_the_circle(_: Sequence[Case]) -> Iterator[Forms]:
    return map(forms.arc_normal, forms.circle(24))


def _five_bars(_: Sequence[Case]) -> Iterator[Forms]:
    return (forms.passive_accelerations(np.random.default_rng(SEED + i)) for i in range(20))


MISPRINTS = (
    Misprint(
        "(1)", "e_{k+6} along s x e_{k+3}",
        "along e_{k+3} x s where 0 < beta_k < pi, as on the whole path of Sect. 7.2: "
        "otherwise it is minus the axis of (29) and (44)",
        _MISPRINTS + "cross_product_of_eq_1_points_against_the_axis_of_eq_44", _on_the_circle,
    ),
    Misprint(
        "(7c)", "[Phi_dot^a  Phi^a]", "[Phi_dot^a  Phi_dot^u]",
        _MISPRINTS + "second_block_of_eq_7c_is_the_rate_of_phi_u", _five_bars,
    ),
    Misprint(
        "(7c)", "its blocks on the nine rates of the SST", "six columns do not fit nine rates",
        _MISPRINTS + "second_block_of_eq_7c_is_the_rate_of_phi_u", None,
    ),
    Misprint(
        "(20)", "q_dot on the left", "q_ddot", _MISPRINTS + "eq_20_gives_accelerations",
        _each(forms.rate_of_joint_rates),
    ),
    Misprint(
        "(54)", "first two factors both lead from the base",
        "the chain of (33), hence r_17 = (2R/pi) s",
        _MISPRINTS + "chain_of_eq_54_starts_from_the_base_once",
        _of_the_papers(forms.center_of_star),
    ),
    Misprint(
        "(59)-(61)", "minus before mu_dot", "plus, with the rotations of (27)-(29)",
        _MISPRINTS + "minus_signs_of_eqs_59_to_61_do_not_turn_the_passive_links",
        _each(forms.spins_of_passive_links),
    ),
    Misprint(
        "(62), upper row", "minus before mu_dot and beta_dot", "plus",
        _NOC + "printed_minus_signs_do_not_give_the_twist_of_the_star", None,
    ),
    Misprint(
        "(62), lower row", "minus before mu_dot and beta_dot", "plus",
        _MISPRINTS + "minus_signs_of_eq_62_do_not_move_the_star", _each(forms.velocity_of_star),
    ),
    Misprint(
        "(67)", "omega_i 1 in Omega_i", "the cross-product matrix of omega_i, as (65) asks",
        _MISPRINTS + "omega_of_eq_67_is_a_cross_product_matrix", _each(forms.gyroscopic_moments),
    ),
    Misprint(
        "(68)", "M_i on the stacked twist", "the stacked M of (69): 6 x 6 does not fit 6 r numbers",
        "test_noc::test_kinetic_energy_is_half_the_quadratic_form_of_the_inertia", None,
    ),
    Misprint(
        "(63), (74)-(76)", "words under (63): first the force, then the torque",
        "[moment; force], on the twist [omega; v] of (9)",
        _MISPRINTS + "powers_of_eqs_74_to_76_need_the_moment_first", _each(forms.power_of_inertia),
    ),
    Misprint(
        "(87)-(96)", "tau^f as a power dissipated",
        "tau^f opposes the rates: tau^f = -(D q_dot + F_c sign q_dot)",
        _MISPRINTS + "friction_of_eqs_87_to_96_opposes_the_rates",
        _rubbing(forms.balance_of_powers),
    ),
    Misprint(
        "Sect. 7.2, words", "virtual work slightly faster than the NOC",
        "37 % slower, by the times printed there and by Sect. 6.1",
        "test_cost::test_the_page_has_the_papers_times", None,
    ),
)  # fmt: skip
