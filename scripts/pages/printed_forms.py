# SPDX-License-Identifier: BSD-2-Clause
"""Equations of the paper as printed and as they hold, each against something that knows neither.

A form is one side of an equation; its error is relative to the largest entry of what it should be.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import sst_pin
from sst_pin.arrays import Array
from sst_pin.dynamics import dynamics
from sst_pin.sst import kinematics, paper
from tests.referees.virtual_work import VirtualWork
from tests.support.sampling import random_parameters, random_state

#: Central differences of order six over seven samples: what remains is rounding, eps / STEP.
STEP = 1e-4
FIRST = np.array((-1, 9, -45, 0, 45, -9, 1)) / (60 * STEP)


class Forms(NamedTuple):
    """Errors of two forms of one equation."""

    printed: float  # in the paper, under its kindest reading
    ours: float


def error(form: Array, wanted: Array) -> float:
    """The largest difference, relative to the largest entry wanted."""
    return float(np.abs(form - wanted).max() / np.abs(wanted).max())


@dataclass(frozen=True, eq=False)
class Case:
    """An SST in a state of motion."""

    parameters: sst_pin.Parameters
    R: Array  # {E} in the base, (3, 3)
    omega: Array  # of the star, base axes, [rad/s]
    alpha: Array  # [rad/s^2]

    @classmethod
    def random(cls, parameters: sst_pin.Parameters, rng: np.random.Generator) -> "Case":
        """Some motion of an SST, away from its singularities."""
        return cls(parameters, *random_state(sst_pin.SST(parameters), rng))

    @cached_property
    def robot(self) -> sst_pin.SST:
        return sst_pin.SST(self.parameters)

    @cached_property
    def motion(self) -> tuple[Array, Array, Array]:
        """q, va, aa."""
        return self.robot.joint_motion(self.R, self.omega, self.alpha)

    @cached_property
    def terms(self) -> dynamics.Terms:
        """L, K, T and the rest."""
        return self.robot.noc(*self.motion[:2])

    @cached_property
    def rates(self) -> Array:
        """q_dot in closed form, without L."""
        return kinematics.joint_rates(self._legs, self.omega)

    @cached_property
    def accelerations(self) -> Array:
        """q_ddot in closed form, without L."""
        return kinematics.joint_accelerations(
            self.robot.geometry, self._legs, self.rates, self.alpha
        )

    @cached_property
    def _legs(self) -> kinematics.Legs:
        return kinematics.legs_of_joints(self.robot.geometry, self.motion[0])

    @cached_property
    def line(self) -> list[tuple[Array, Array]]:
        """q and va at -3 ... 3 steps on a motion through the state, q on the closures."""
        q, va, aa = self.motion
        samples = []
        for t in STEP * np.arange(-3, 4):
            guess = q + self.rates * t
            guess[::3] = q[::3] + va * t + aa * t**2 / 2
            samples.append((self.robot.assemble(guess), va + aa * t))
        return samples

    def frames(self, q: Array | None = None) -> Array:
        """{0k}, {1k}, {2k}, {3k} in the base by Eqs. (26)-(29), shape (3, 4, 3, 3)."""
        v, e = self.parameters.base_directions, self.parameters.actuated_axes
        found = np.empty((3, 4, 3, 3))
        for k, angles in enumerate((self.motion[0] if q is None else q).reshape(3, 3)):
            found[k, 0] = np.stack([v[k], np.cross(e[k], v[k]), e[k]], axis=-1)
            for i, (axis, angle) in enumerate(zip("zxz", angles, strict=True)):
                turn = Rotation.from_euler(axis, angle).as_matrix()
                found[k, i + 1] = found[k, i] @ turn
        return found

    def star_center(self, q: Array) -> Array:
        """Mass centre of body 7 as the tree has it: that of its three arcs."""
        data = self.robot.model.createData()
        pin.forwardKinematics(self.robot.model, data, q)
        arcs = [self.robot.model.getJointId(f"beta_{k}") for k in (1, 2, 3)]
        inertias = self.robot.model.inertias
        return np.mean([data.oMi[j].act(inertias[j].lever) for j in arcs], axis=0)


def cases(seed: int, states: int, robots: int) -> list[Case]:
    """Random motions of the paper's robot, and one of each of some random robots.

    These have odd geometry, nine bodies, tilted gravity and friction.
    """
    rng = np.random.default_rng(seed)
    found = [Case.random(sst_pin.Parameters(), rng) for _ in range(states)]
    return found + [Case.random(random_parameters(rng), rng) for _ in range(robots)]


def circle(count: int) -> list[Case]:
    """States of the paper's robot along the circle of Sect. 7.2."""
    motion = sst_pin.paper_circle(np.linspace(0, paper.PERIOD, count, endpoint=False))
    return [Case(sst_pin.Parameters(), *state) for state in zip(*motion, strict=True)]


def arc_normal(case: Case) -> Forms:
    """(1): e_{k+6} along s x e_{k+3}; z of {2k}, Eq. (44), where beta_k lies in (0, pi)."""
    frames = case.frames()
    cross = np.cross(case.R[:, 0], frames[:, 1, :, 0])
    cross /= np.linalg.norm(cross, axis=1)[:, None]
    return Forms(error(cross, frames[:, 2, :, 2]), error(-cross, frames[:, 2, :, 2]))


def five_bar() -> sst_pin.ClosedChain:
    """A five-bar: as many motors as passive joints, so that the blocks of (7c) fit as printed."""
    model = pin.Model()
    for leg, x in (("left", 0.0), ("right", 0.4)):
        parent, where = 0, pin.SE3(np.eye(3), np.array([x, 0, 0]))
        for part, length in (("crank", 0.3), ("rod", 0.4)):
            parent = model.addJoint(parent, pin.JointModelRZ(), where, f"{leg}_{part}")
            body = pin.Inertia.FromCylinder(1.0, 0.01, length)
            model.appendBodyToJoint(parent, body, pin.SE3.Identity())
            where = pin.SE3(np.eye(3), np.array([length, 0, 0]))
        model.addFrame(pin.Frame(f"{leg}_tip", parent, where, pin.FrameType.OP_FRAME))
    closure = sst_pin.Closure("left_tip", "right_tip", "3d")
    return sst_pin.ClosedChain(model, [closure], ["left_crank", "right_crank"])


def passive_accelerations(rng: np.random.Generator) -> Forms:
    """(7c): -[Phi_dot^a  Phi^a] q_dot; the accelerations of a five-bar, by differences."""
    chain = five_bar()
    q = chain.assemble(np.array((2.0, -1.4, 1.1, 1.4)) + rng.uniform(-0.2, 0.2, 4))
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

    def solved(second_block: Array) -> Array:
        rest = Phi_dot[:, a] @ va + second_block @ q_dot[u] + Phi[:, a] @ aa
        return -np.linalg.solve(Phi[:, u], rest)

    return Forms(error(solved(Phi[:, a]), wanted), error(solved(Phi_dot[:, u]), wanted))


def rate_of_joint_rates(case: Case) -> Forms:
    """(20): L aa + L_dot va is said to be q_dot; it is q_ddot."""
    _, va, aa = case.motion
    value = case.terms.L @ aa + case.terms.L_dot @ va
    return Forms(error(value, case.rates), error(value, case.accelerations))


def center_of_star(case: Case) -> Forms:
    """(54): the first two factors both lead from the base; the mass centre of the three arcs."""
    arm = np.linalg.norm(case.parameters.star.center_of_mass)  # 2 R / pi for the paper's robot
    frames, turn = case.frames(), case.parameters.arc_angles[1]
    R_02, R_32 = frames[1, 0], frames[1, 3]  # in the base
    to_E = Rotation.from_euler("x", -turn).as_matrix()  # Eq. (31)
    x = arm * np.eye(3)[0]
    wanted = case.star_center(case.motion[0])
    printed = R_02 @ R_32 @ to_E @ x
    ours = R_02 @ (R_02.T @ R_32) @ to_E @ x  # as in Eq. (33)
    return Forms(error(printed, wanted), error(ours, wanted))


def spins_of_passive_links(case: Case) -> Forms:
    """(59)-(61): minus before mu_dot; {2k} turning, by differences."""
    frames = case.frames()
    slopes = np.einsum("t,tkij->kij", FIRST, [case.frames(q)[:, 2] for q, _ in case.line])
    W = slopes @ np.swapaxes(frames[:, 2], 1, 2)
    wanted = np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], axis=-1)
    gamma_dot, mu_dot, _ = case.rates.reshape(3, 3, 1).swapaxes(0, 1)
    e, u = frames[:, 0, :, 2], frames[:, 1, :, 0]
    printed, ours = (gamma_dot * e + sign * mu_dot * u for sign in (-1, 1))
    return Forms(error(printed, wanted), error(ours, wanted))


def velocity_of_star(case: Case) -> Forms:
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
    return Forms(error(printed, wanted), error(ours, wanted))


def gyroscopic_moments(case: Case) -> Forms:
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
    return Forms(min(error(reading, wanted) for reading in readings), error(ours, wanted))


def power_of_inertia(case: Case) -> Forms:
    """(74): with w* = [force; torque], as the words after (63) have it; -d/dt kinetic energy."""
    _, va, aa = case.motion
    t = case.terms
    wanted = -FIRST @ [case.robot.kinetic_energy(*sample) for sample in case.line]
    twist = t.T @ va
    wrench = -t.M @ (t.T @ aa + t.T_dot @ va) - t.Omega @ t.M @ twist
    exchanged = wrench.reshape(-1, 2, 3)[:, ::-1].ravel()
    return Forms(error(twist @ exchanged, wanted), error(twist @ wrench, wanted))


def balance_of_powers(case: Case) -> Forms:
    """(82) with tau^f along the rates, a power dissipated; the motors' power, by virtual work."""
    _, va, aa = case.motion
    t, p = case.terms, case.parameters
    tau = VirtualWork(p).torques(case.R, case.omega, case.alpha)
    inertia_and_weight = (t.inertia @ aa + t.coriolis @ va - t.gravity) @ va
    resistance = p.viscous_friction * case.rates + p.coulomb_friction * np.sign(case.rates)
    printed, ours = (inertia_and_weight - sign * resistance @ case.rates for sign in (1, -1))
    return Forms(error(printed, tau @ va), error(ours, tau @ va))
