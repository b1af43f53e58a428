# SPDX-License-Identifier: BSD-2-Clause
"""The paper's equations on the SST by vectors written out, and its misprints.

docs/paper.md lists all equations; those that hold for any chain are tested where any chain is. A
witness does not use what is tested: vectors, closed-form kinematics, differences in time, virtual
work. Errors are relative to the largest entry.
"""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import sst_pin
from sst_pin.sst import kinematics, paper
from tests.referees.virtual_work import VirtualWork
from tests.support.sampling import random_parameters, random_state

#: Central differences of order six over seven samples: what remains is rounding, eps / STEP.
STEP = 1e-4
FIRST = np.array((-1, 9, -45, 0, 45, -9, 1)) / (60 * STEP)
#: Sums and products of a dozen numbers, times condition numbers up to 30 squared.
ROUNDING = 1e-11
#: Witnesses that are differences in time: rounding over the step of 1e-4 s, and the same again.
DIFFERENCES = 1e-8
#: What counts as wrong: a slip that would be seen in a plot.
WRONG = 0.05


def error(form, wanted):
    """The largest difference, relative to the largest entry wanted."""
    return float(np.abs(form - wanted).max() / np.abs(wanted).max())


@dataclass(frozen=True, eq=False)
class Case:
    """An SST in a state of motion."""

    parameters: sst_pin.Parameters
    R: np.ndarray  # {E} in the base, (3, 3)
    omega: np.ndarray  # of the star, base axes, [rad/s]
    alpha: np.ndarray  # [rad/s^2]

    @cached_property
    def robot(self):
        return sst_pin.SST(self.parameters)

    @property
    def bodies(self):
        """Links, passive links, star."""
        return *self.parameters.links, *self.parameters.passive_links, self.parameters.star

    @cached_property
    def motion(self):
        """q, va, aa."""
        return self.robot.joint_motion(self.R, self.omega, self.alpha)

    @cached_property
    def terms(self):
        """L, K, T and the rest."""
        return self.robot.noc(*self.motion[:2])

    @cached_property
    def rates(self):
        """q_dot in closed form, without L."""
        return kinematics.joint_rates(self._legs, self.omega)

    @cached_property
    def accelerations(self):
        """q_ddot in closed form, without L."""
        return kinematics.joint_accelerations(
            self.robot.geometry, self._legs, self.rates, self.alpha
        )

    @cached_property
    def _legs(self):
        return kinematics.legs_of_joints(self.robot.geometry, self.motion[0])

    @cached_property
    def line(self):
        """q and va at -3 ... 3 steps on a motion through the state, q on the closures."""
        q, va, aa = self.motion
        samples = []
        for t in STEP * np.arange(-3, 4):
            guess = q + self.rates * t
            guess[::3] = q[::3] + va * t + aa * t**2 / 2
            samples.append((self.robot.assemble(guess), va + aa * t))
        return samples

    def frames(self, q=None):
        """{0k}, {1k}, {2k}, {3k} in the base by Eqs. (26)-(29), shape (3, 4, 3, 3)."""
        v, e = self.parameters.base_directions, self.parameters.actuated_axes
        result = np.empty((3, 4, 3, 3))
        for k, angles in enumerate((self.motion[0] if q is None else q).reshape(3, 3)):
            result[k, 0] = np.stack([v[k], np.cross(e[k], v[k]), e[k]], axis=-1)
            for i, (axis, angle) in enumerate(zip("zxz", angles, strict=True)):
                turn = Rotation.from_euler(axis, angle).as_matrix()
                result[k, i + 1] = result[k, i] @ turn
        return result

    def star_center(self, q):
        """Mass centre of body 7 as the tree has it: that of its three arcs."""
        data = self.robot.model.createData()
        pin.forwardKinematics(self.robot.model, data, q)
        arcs = [self.robot.model.getJointId(f"beta_{k}") for k in (1, 2, 3)]
        inertias = self.robot.model.inertias
        return np.mean([data.oMi[j].act(inertias[j].lever) for j in arcs], axis=0)


@cache
def cases():
    """Motions of the paper's robot, then one of each of as many random ones, with friction."""
    rng = np.random.default_rng(2012)
    parameters = [sst_pin.Parameters()] * 3 + [random_parameters(rng) for _ in range(3)]
    return [Case(p, *random_state(sst_pin.SST(p), rng)) for p in parameters]


@pytest.fixture(params=range(6))
def case(request):
    return cases()[request.param]


#: Rows of K and T that are the paper's seven bodies, in its order.
SEVEN = np.array([0, 3, 6, 1, 4, 7, 2])


def seven(rows):
    return rows.reshape(9, 6, *rows.shape[1:])[SEVEN]


def vectors(case):
    """Axes, mass centres, twists and their rates of the seven bodies, by vector geometry."""
    frames = case.frames()
    e, u = frames[:, 0, :, 2], frames[:, 1, :, 0]
    gamma_dot, mu_dot, _ = np.moveaxis(case.rates.reshape(3, 3, 1), 1, 0)
    gamma_ddot, mu_ddot, _ = np.moveaxis(case.accelerations.reshape(3, 3, 1), 1, 0)
    link, link_rate = gamma_dot * e, gamma_ddot * e
    passive = link + mu_dot * u
    passive_rate = link_rate + mu_ddot * u + mu_dot * np.cross(link, u)
    spin = np.vstack([link, passive, case.omega])
    spin_rate = np.vstack([link_rate, passive_rate, case.alpha])
    axes = np.array([*frames[:, 1], *frames[:, 2], case.R])
    c = np.array([A @ body.center_of_mass for A, body in zip(axes, case.bodies, strict=True)])
    velocity = np.cross(spin, c)
    acceleration = np.cross(spin_rate, c) + np.cross(spin, velocity)
    return axes, c, np.hstack([spin, velocity]), np.hstack([spin_rate, acceleration])


def test_twists_and_their_rates_are_those_of_seven_bodies(case):
    """(9)-(15), (21), (24): t = K q_dot = T va."""
    (_, va, aa), t = case.motion, case.terms
    *_, twists, rates = vectors(case)
    for result in (t.K @ case.rates, t.T @ va):
        assert error(seven(result), twists) < ROUNDING
    by_joints = t.K @ case.accelerations + t.K_dot @ case.rates
    for result in (by_joints, t.T @ aa + t.T_dot @ va):
        assert error(seven(result), rates) < ROUNDING


def test_K_holds_the_axes_and_their_levers_with_plus_signs(case):
    """(38)-(62)."""
    frames, (_, c, *_) = case.frames(), vectors(case)
    axes = np.stack([frames[:, 0, :, 2], frames[:, 1, :, 0], frames[:, 2, :, 2]], axis=1)
    K = np.zeros((7, 6, 9))
    for body in range(7):
        leg, joints = (body % 3, body // 3 + 1) if body < 6 else (0, 3)
        for j in range(joints):
            axis = axes[leg, j]
            K[body, :, 3 * leg + j] = [*axis, *np.cross(axis, c[body])]
    assert error(seven(case.terms.K), K) < ROUNDING


def test_momenta_change_by_the_wrenches(case):
    """(63)-(71): w* = -M t_dot - Omega M t."""
    (_, va, aa), t = case.motion, case.terms
    wrench = t.M @ (t.T @ aa + t.T_dot @ va) + t.Omega @ t.M @ t.T @ va
    near = [(case.robot.noc(*sample), sample[1]) for sample in case.line]
    assert error(wrench, FIRST @ [n.M @ n.T @ rates for n, rates in near]) < 1e-9


def test_torques_are_those_of_the_wrenches(case):
    """(83)-(91): inertia, weight and friction through T and L."""
    (_, va, aa), t = case.motion, case.terms
    weights = np.zeros((9, 6))
    for i, body in enumerate(list(case.robot.model.inertias)[1:]):
        weights[i, 3:] = body.mass * case.parameters.gravity
    inertia = -t.M @ (t.T @ aa + t.T_dot @ va) - t.Omega @ t.M @ t.T @ va
    tau = -t.T.T @ (inertia + weights.ravel()) - t.friction
    assert error(case.robot.compute_torques(*case.motion), tau) < ROUNDING


def test_the_inertia_gives_the_kinetic_energy_of_seven_bodies(case):
    """(93)."""
    axes, _, twists, _ = vectors(case)
    energy, va = 0.0, case.motion[1]
    for A, body, twist in zip(axes, case.bodies, twists, strict=True):
        spin, velocity = A.T @ twist[:3], twist[3:]
        energy += (body.mass * velocity @ velocity + spin @ body.inertia @ spin) / 2
    assert error(va @ case.terms.inertia @ va / 2, energy) < ROUNDING


def test_the_rate_of_the_inertia_less_twice_the_coriolis_matrix_is_skew(case):
    """(94)."""
    slope = np.einsum("t,tij->ij", FIRST, [case.robot.noc(*sample).inertia for sample in case.line])
    skew = slope - 2 * case.terms.coriolis
    assert np.abs(skew + skew.T).max() < 1e-8 * np.abs(slope).max()


# Errors of an equation as printed, under its kindest reading, and as it holds.


def arc_normal(case):
    """(1): e_{k+6} along s x e_{k+3}; z of {2k}, Eq. (44), where beta_k lies in (0, pi)."""
    frames = case.frames()
    cross = np.cross(case.R[:, 0], frames[:, 1, :, 0])
    cross /= np.linalg.norm(cross, axis=1)[:, None]
    return (error(cross, frames[:, 2, :, 2]), error(-cross, frames[:, 2, :, 2]))


def passive_accelerations(rng):
    """(7c): -[Phi_dot^a  Phi^a] q_dot; the accelerations of a five-bar, by differences.

    It has as many motors as passive joints, so that the blocks fit as printed.
    """
    chain = sst_pin.robots.five_bar()
    q = chain.assemble(chain.home + rng.uniform(-0.2, 0.2, 4))
    va, aa = rng.normal(scale=3, size=(2, 2))
    a, u = [0, 2], [1, 3]
    q_dot = chain.joint_rates(q, va)
    passive_rates = []
    for t in STEP * np.arange(-3, 4):
        guess = q + q_dot * t
        guess[a] = q[a] + va * t + aa * t**2 / 2
        passive_rates.append(chain.joint_rates(chain.assemble(guess), va + aa * t)[u])
    wanted = FIRST @ passive_rates

    rows = slice(0, 2)  # the tips cannot part along z
    Phi, Phi_dot = chain.Phi(q)[rows], chain.Phi_dot(q, q_dot)[rows]

    def solved(second_block):
        rest = Phi_dot[:, a] @ va + second_block @ q_dot[u] + Phi[:, a] @ aa
        return -np.linalg.solve(Phi[:, u], rest)

    return (error(solved(Phi[:, a]), wanted), error(solved(Phi_dot[:, u]), wanted))


def rate_of_joint_rates(case):
    """(20): L aa + L_dot va is said to be q_dot; it is q_ddot."""
    _, va, aa = case.motion
    value = case.terms.L @ aa + case.terms.L_dot @ va
    return (error(value, case.rates), error(value, case.accelerations))


def center_of_star(case):
    """(54): the first two factors both lead from the base; the mass centre of the three arcs."""
    arm = np.linalg.norm(case.parameters.star.center_of_mass)  # 2 R / pi for the paper's robot
    frames, turn = case.frames(), case.parameters.arc_angles[1]
    R_02, R_32 = frames[1, 0], frames[1, 3]  # in the base
    to_E = Rotation.from_euler("x", -turn).as_matrix()  # Eq. (31)
    x = arm * np.eye(3)[0]
    wanted = case.star_center(case.motion[0])
    printed = R_02 @ R_32 @ to_E @ x
    ours = R_02 @ (R_02.T @ R_32) @ to_E @ x  # as in Eq. (33)
    return (error(printed, wanted), error(ours, wanted))


def spins_of_passive_links(case):
    """(59)-(61): minus before mu_dot; {2k} turning, by differences."""
    frames = case.frames()
    slopes = np.einsum("t,tkij->kij", FIRST, [case.frames(q)[:, 2] for q, _ in case.line])
    W = slopes @ np.swapaxes(frames[:, 2], 1, 2)
    wanted = np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], axis=-1)
    gamma_dot, mu_dot, _ = case.rates.reshape(3, 3, 1).swapaxes(0, 1)
    e, u = frames[:, 0, :, 2], frames[:, 1, :, 0]
    printed, ours = (gamma_dot * e + sign * mu_dot * u for sign in (-1, 1))
    return (error(printed, wanted), error(ours, wanted))


def velocity_of_star(case):
    """(62), lower row: minus before mu_dot and beta_dot; the mass centre moving, by differences."""
    frames = case.frames()
    wanted = FIRST @ [case.star_center(q) for q, _ in case.line]
    r_17 = case.star_center(case.motion[0])
    axes = frames[0, 0, :, 2], frames[0, 1, :, 0], frames[0, 2, :, 2]  # r_14 is along e_4
    printed, ours = (
        sum(
            sign * rate * np.cross(axis, r_17)
            for sign, rate, axis in zip(signs, case.rates, axes, strict=False)
        )
        for signs in ((1, -1, -1), (1, 1, 1))
    )
    return (error(printed, wanted), error(ours, wanted))


def gyroscopic_moments(case):
    """(67): omega_i 1 as diag(omega_i) or |omega_i| times 1; d/dt (M t) less M t_dot."""
    _, va, aa = case.motion
    t = case.terms
    momenta = []
    for q, va_t in case.line:
        near = case.robot.noc(q, va_t)
        momenta.append(near.M @ near.T @ va_t)
    rest = FIRST @ momenta - t.M @ (t.T @ aa + t.T_dot @ va)
    wanted = rest.reshape(-1, 6)[:, :3]
    spins, momenta_now = ((x @ va).reshape(-1, 6)[:, :3] for x in (t.T, t.M @ t.T))
    sizes = np.linalg.norm(spins, axis=1)[:, None]
    readings = (spins * momenta_now, sizes * momenta_now)
    ours = (t.Omega @ t.M @ t.T @ va).reshape(-1, 6)[:, :3]
    return (min(error(reading, wanted) for reading in readings), error(ours, wanted))


def power_of_inertia(case):
    """(74): with w* = [force; torque], as the words after (63) have it; -d/dt kinetic energy."""
    _, va, aa = case.motion
    t = case.terms
    wanted = -FIRST @ [case.robot.kinetic_energy(*sample) for sample in case.line]
    twist = t.T @ va
    wrench = -t.M @ (t.T @ aa + t.T_dot @ va) - t.Omega @ t.M @ twist
    exchanged = wrench.reshape(-1, 2, 3)[:, ::-1].ravel()
    return (error(twist @ exchanged, wanted), error(twist @ wrench, wanted))


def balance_of_powers(case):
    """(82) with tau^f along the rates, a power dissipated; the motors' power, by virtual work."""
    _, va, aa = case.motion
    t, p = case.terms, case.parameters
    tau = VirtualWork(p).torques(case.R, case.omega, case.alpha)
    inertia_and_weight = (t.inertia @ aa + t.coriolis @ va - t.gravity) @ va
    resistance = p.viscous_friction * case.rates + p.coulomb_friction * np.sign(case.rates)
    printed, ours = (inertia_and_weight - sign * resistance @ case.rates for sign in (1, -1))
    return (error(printed, tau @ va), error(ours, tau @ va))


def circle():
    """States along the circle of Sect. 7.2, where all beta_k lie in (0, pi)."""
    motion = sst_pin.paper_circle(np.linspace(0, paper.PERIOD, 8, endpoint=False))
    result = [Case(sst_pin.Parameters(), *state) for state in zip(*motion, strict=True)]
    assert all((np.sin(case.motion[0][2::3]) > 0.2).all() for case in result)
    return result


#: Of each misprint: its forms, the cases, and what the corrected form may be off by.
MISPRINTS = {
    "(1)": (arc_normal, circle, ROUNDING),
    "(7c)": (passive_accelerations, lambda: map(np.random.default_rng, range(5)), DIFFERENCES),
    "(20)": (rate_of_joint_rates, cases, ROUNDING),
    "(54)": (center_of_star, lambda: cases()[:3], ROUNDING),
    "(59)-(61)": (spins_of_passive_links, cases, DIFFERENCES),
    "(62), lower row": (velocity_of_star, cases, DIFFERENCES),
    "(67)": (gyroscopic_moments, cases, DIFFERENCES),
    "(63), (74)-(76)": (power_of_inertia, cases, DIFFERENCES),
    "(87)-(96)": (balance_of_powers, lambda: cases()[3:], ROUNDING),
}


@pytest.mark.parametrize("where", MISPRINTS)
def test_the_printed_form_fails_and_ours_holds(where):
    forms, some, tolerance = MISPRINTS[where]
    printed, ours = zip(*map(forms, some()), strict=True)
    assert min(printed) > WRONG
    assert max(ours) < tolerance


def test_printed_minus_signs_do_not_give_the_twist_of_the_star():
    """Eq. (62) as printed: gamma_dot e_1 - mu_dot e_4 - beta_dot e_7 is not omega_7."""
    for case in cases():
        legs = kinematics.legs_of_joints(case.robot.geometry, case.motion[0])
        axes = np.array((case.robot.geometry.e[0], legs.u[0], legs.n[0]))
        assert np.abs(case.rates[:3] @ axes - case.omega).max() < 1e-12
        assert np.abs(case.rates[:3] * (1, -1, -1) @ axes - case.omega).max() > 0.1
