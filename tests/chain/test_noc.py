# SPDX-License-Identifier: BSD-2-Clause
"""Identities of the natural orthogonal complement, at random configurations and geometries."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.sst import kinematics
from sst_pin.verification.sampling import random_parameters, random_state


@pytest.fixture(params=range(8))
def case(request):
    """A random SST in a random state of motion: robot, q, va, aa."""
    rng = np.random.default_rng(100 + request.param)
    robot = sst_pin.SST(random_parameters(rng))
    return robot, *robot.joint_motion(*random_state(robot, rng))


def along(robot, q, va, aa, h):
    """q and va at -3h ... 3h on the motion with constant aa, q on the closures."""
    motion = []
    for t in h * np.arange(-3, 4):
        gamma = q[::3] + va * t + aa * t**2 / 2
        guess = q + robot.joint_rates(q, va) * t
        guess[::3] = gamma
        motion.append((robot.assemble(guess), va + aa * t))
    return motion


#: Central differences of order six: rounding of eps / h is what remains at h = 1e-3.
STEP = 1e-3
FIRST = np.array((-1, 9, -45, 0, 45, -9, 1)) / (60 * STEP)


def test_the_closures_keep_nothing_of_L(case):
    """Phi L = 0, Eq. (19), with the six independent rows and with all twelve."""
    robot, q, va, _ = case
    terms = robot.noc(q, va)
    assert terms.Phi.shape == (6, 9)
    assert np.linalg.matrix_rank(terms.Phi) == 6
    assert np.abs(terms.Phi @ terms.L).max() < 1e-13 * np.abs(terms.L).max()
    assert np.abs(robot.Phi(q) @ terms.L).max() < 1e-13 * np.abs(terms.L).max()


def test_L_is_the_block_formula_of_the_paper(case):
    """Eq. (17): unit matrix over -(Phi^u)^-1 Phi^a, the joints sorted as in Eq. (6)."""
    robot, q, va, _ = case
    terms = robot.noc(q, va)
    a = list(robot.actuated)
    u = [i for i in range(9) if i not in a]
    expected = -np.linalg.solve(terms.Phi[:, u], terms.Phi[:, a])
    assert np.abs(terms.L[a] - np.eye(3)).max() < 1e-13 * np.abs(terms.L).max()
    assert np.abs(terms.L[u] - expected).max() < 1e-12 * np.abs(expected).max()


def test_T_and_its_rate_are_the_block_formulas_of_the_paper(case):
    """Eqs. (22), (23) and the printed four-term Eq. (25)."""
    robot, q, va, _ = case
    t = robot.noc(q, va)
    a = list(robot.actuated)
    u = [i for i in range(9) if i not in a]
    rows = [np.flatnonzero((robot.Phi(q) == row).all(axis=1))[0] for row in t.Phi]
    Phi_dot = robot.Phi_dot(q, t.L @ va)[rows]
    inverse = np.linalg.inv(t.Phi[:, u])
    X = inverse @ t.Phi[:, a]
    assert np.abs(t.T - (t.K[:, a] - t.K[:, u] @ X)).max() < 1e-12 * np.abs(t.T).max()
    T_dot = (
        t.K_dot[:, a]
        - t.K_dot[:, u] @ X
        + t.K[:, u] @ inverse @ Phi_dot[:, u] @ X
        - t.K[:, u] @ inverse @ Phi_dot[:, a]
    )
    assert np.abs(t.T_dot - T_dot).max() < 1e-11 * np.abs(T_dot).max()


def test_phi_is_the_derivative_of_the_residual(case):
    """Eq. (4), by central differences off the closures in every direction."""
    robot, q, _, _ = case
    h = 1e-5
    slope = np.array(
        [(robot.residual(q + h * d) - robot.residual(q - h * d)) / (2 * h) for d in np.eye(9)]
    ).T
    # Second order: h^2 of truncation, eps / h of rounding.
    assert np.abs(slope - robot.Phi(q)).max() < 1e-9


@pytest.mark.parametrize("name", ["Phi", "L", "K", "T"])
def test_rates_are_the_derivatives_along_the_motion(case, name):
    robot, q, va, aa = case
    values = [
        robot.Phi(q_t) if name == "Phi" else getattr(robot.noc(q_t, va_t), name)
        for q_t, va_t in along(robot, q, va, aa / 10, STEP)
    ]
    slope = np.einsum("t,tij->ij", FIRST, values)
    terms = robot.noc(q, va)
    rate = robot.Phi_dot(q, terms.L @ va) if name == "Phi" else getattr(terms, f"{name}_dot")
    assert np.abs(slope - rate).max() < 1e-8 * max(1, np.abs(rate).max())


def test_K_of_the_seven_bodies_is_that_of_the_paper(robot):
    """Eqs. (38)-(62), plus signs in (59)-(62), vectors written out; for the paper's robot."""
    rng = np.random.default_rng(0)
    radius, star_radius = 0.35, 0.4
    for _ in range(10):
        q, va, _ = robot.joint_motion(*random_state(robot, rng))
        terms = robot.noc(q, va)
        gamma, mu, beta = q.reshape(3, 3).T
        R_0 = np.array(
            [np.eye(3), [[0, 0, 1], [1, 0, 0], [0, 1, 0]], [[0, 1, 0], [0, 0, 1], [1, 0, 0]]]
        )
        e = np.zeros((8, 3))  # e[i] is e_i of the paper
        e[1:4] = np.eye(3)[[2, 0, 1]]  # Eqs. (38)-(40)
        for k in range(3):  # Eqs. (41)-(43)
            e[4 + k] = R_0[k] @ pin.utils.rotate("z", gamma[k]) @ (1, 0, 0)
        R_21 = pin.utils.rotate("z", gamma[0]) @ pin.utils.rotate("x", mu[0])
        e[7] = R_21 @ (0, 0, 1)  # Eq. (44)
        r_17 = 2 * star_radius / np.pi * (R_21 @ pin.utils.rotate("z", beta[0]) @ (1, 0, 0))
        K = np.zeros((7, 6, 9))
        for k in range(3):
            r = 0.5 * radius * e[4 + k]  # Eqs. (45)-(47), (56)-(58)
            K[k, :, 3 * k] = [*e[1 + k], *np.cross(e[1 + k], r)]
            r = radius * e[4 + k]  # Eqs. (48)-(53), (59)-(61)
            K[3 + k, :, 3 * k] = [*e[1 + k], *np.cross(e[1 + k], r)]
            K[3 + k, :, 3 * k + 1] = [*e[4 + k], 0, 0, 0]
        r_47 = r_17 - radius * e[4]  # Eq. (55)
        for column, (axis, arm) in enumerate([(e[1], r_17), (e[4], r_47), (e[7], r_17)]):
            K[6, :, column] = [*axis, *np.cross(axis, arm)]  # Eq. (62)
        of_body = dict(zip(robot.joint_names, terms.K.reshape(9, 6, 9), strict=True))
        names = [f"{joint}_{k}" for joint in ("gamma", "mu") for k in (1, 2, 3)] + ["beta_1"]
        for name, expected in zip(names, K, strict=True):
            assert np.abs(of_body[name] - expected).max() < 1e-14


def test_printed_minus_signs_do_not_give_the_twist_of_the_star(robot):
    """Eq. (62) as printed: gamma_dot e_1 - mu_dot e_4 - beta_dot e_7 is not omega_7."""
    R, omega, alpha = random_state(robot, np.random.default_rng(1))
    q, va, _ = robot.joint_motion(R, omega, alpha)
    rates = robot.joint_rates(q, va)[:3]
    legs = kinematics.legs_of_joints(robot.geometry, q)
    axes = np.array((robot.geometry.e[0], legs.u[0], legs.n[0]))
    assert np.abs(rates @ axes - omega).max() < 1e-13
    assert np.abs(rates * (1, -1, -1) @ axes - omega).max() > 0.1


def test_twists_are_those_of_the_mass_centres(case):
    """T va = [omega; v] of every body, v by differences of the mass centres."""
    robot, q, va, aa = case
    data = robot.model.createData()

    def centers(q):
        pin.forwardKinematics(robot.model, data, q)
        return [data.oMi[j].act(robot.model.inertias[j].lever) for j in range(1, 10)]

    positions = [centers(q_t) for q_t, _ in along(robot, q, va, aa / 10, STEP)]
    velocities = np.einsum("t,tbi->bi", FIRST, positions)
    twists = (robot.noc(q, va).T @ va).reshape(9, 6)
    assert np.abs(twists[:, 3:] - velocities).max() < 1e-9 * max(1, np.abs(velocities).max())


def test_the_three_arcs_turn_as_one_body(case):
    """The rows of T for star_1, star_2 and star_3 have one angular velocity."""
    robot, q, va, _ = case
    omega = robot.noc(q, va).T.reshape(9, 6, 3)[2::3, :3]
    assert np.abs(omega - omega[0]).max() < 1e-12 * np.abs(omega).max()


def test_inertia_is_symmetric_and_positive_definite(case):
    """Eq. (93)."""
    robot, q, va, _ = case
    inertia = robot.noc(q, va).inertia
    assert np.abs(inertia - inertia.T).max() < 1e-14 * np.abs(inertia).max()
    assert np.linalg.eigvalsh(inertia).min() > 0


def test_inertia_rate_minus_twice_coriolis_is_skew(case):
    """The passivity of Eq. (94), inertia_dot by differences."""
    robot, q, va, aa = case
    values = [robot.noc(q_t, va_t).inertia for q_t, va_t in along(robot, q, va, aa / 10, STEP)]
    inertia_dot = np.einsum("t,tij->ij", FIRST, values)
    skew = inertia_dot - 2 * robot.noc(q, va).coriolis
    assert np.abs(skew + skew.T).max() < 1e-8 * np.abs(skew).max()


def test_gravity_is_minus_the_gradient_of_the_potential_energy(case):
    """Eq. (95): tau^g = -dV/dq^a along the closures."""
    robot, q, va, _ = case
    terms = robot.noc(q, va)
    slope = []
    for direction in np.eye(3):
        line = along(robot, q, direction, np.zeros(3), STEP)
        slope.append(FIRST @ [robot.potential_energy(q_t) for q_t, _ in line])
    assert np.abs(terms.gravity + slope).max() < 1e-8 * max(1, np.abs(terms.gravity).max())


def test_kinetic_energy_is_half_the_quadratic_form_of_the_inertia(case):
    """va^T I va / 2, and t^T M t / 2 with t = T va."""
    robot, q, va, _ = case
    terms = robot.noc(q, va)
    energy = robot.kinetic_energy(q, va)
    t = terms.T @ va
    assert va @ terms.inertia @ va / 2 == pytest.approx(energy, rel=1e-12)
    assert t @ terms.M @ t / 2 == pytest.approx(energy, rel=1e-12)


def test_friction_dissipates_and_maps_through_L(case):
    """Eqs. (87), (88): power q_dot . tau^f = va . L^T tau^f < 0."""
    robot, q, va, _ = case
    power = robot.friction_power(q, va)
    assert power < 0
    assert robot.noc(q, va).friction @ va == pytest.approx(power, rel=1e-12)


ROBOTS = {
    "SST": sst_pin.SST,
    "hexaglide": sst_pin.robots.hexaglide,
    "planar 3-RRR": sst_pin.robots.planar_3rrr,
    "Stewart": sst_pin.robots.stewart,
}


@pytest.fixture(params=ROBOTS)
def chain(request):
    return ROBOTS[request.param]()


def test_the_product_of_the_decoupled_factors_is_K(chain):
    """Two ways to the twists: all joints at once, and from body to body."""
    terms = chain.noc(chain.home, np.ones(chain.degrees_of_freedom))
    assert np.abs(terms.N_l @ terms.N_d - terms.K).max() < 1e-13


def test_the_factors_are_lower_triangular_and_diagonal(chain):
    """In blocks of six: a body is moved by its own joint, and by the bodies that bear it."""
    terms = chain.noc(chain.home, np.zeros(chain.degrees_of_freedom))
    r = len(terms.N_l) // 6
    N_l = terms.N_l.reshape(r, 6, r, 6).swapaxes(1, 2)
    for i in range(r):
        assert np.array_equal(N_l[i, i], np.eye(6))
        assert not N_l[i, i + 1 :].any()
        joint = chain.model.joints[i + 1]
        own = np.arange(joint.idx_v, joint.idx_v + joint.nv)
        assert not np.delete(terms.N_d[6 * i : 6 * i + 6], own, axis=1).any()


def test_momenta_carried_backward_by_N_l_are_the_generalised_ones(chain):
    """The backward recursion: N_d^T N_l^T M t = K^T M t, here held against the inertia matrix."""
    va = np.linspace(-1, 1, chain.degrees_of_freedom)
    terms = chain.noc(chain.home, va)
    momenta = terms.N_d.T @ (terms.N_l.T @ (terms.M @ (terms.T @ va)))
    rotors = chain.model.armature * (terms.L @ va)
    carried = terms.L.T @ (momenta + rotors)
    assert np.abs(carried - terms.inertia @ va).max() < 1e-12 * np.abs(carried).max()
