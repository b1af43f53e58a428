# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of the SST, and the factors of K of any robot."""

import numpy as np
import pytest

import sst_pin
from sst_pin.dynamics.dynamics import Context, Friction
from tests.support.files import load
from tests.support.sampling import random_parameters, random_state

EXAMPLE_1 = load("scripts/pages/example_1.py").EXAMPLE_1


@pytest.mark.parametrize("t", EXAMPLE_1)
def test_torques_of_example_1_are_the_reference(robot, t):
    """To 1e-10 N m of numbers with thirteen digits."""
    q, va, aa = robot.joint_motion(*sst_pin.paper_circle(t))
    assert np.abs(robot.compute_torques(q, va, aa) - EXAMPLE_1[t]).max() < 1e-10


@pytest.mark.parametrize("seed", range(3))
def test_power_of_the_motors_is_the_rate_of_the_energy_and_the_losses(seed):
    """tau . va = d/dt (kinetic + potential) - friction power, Eq. (82), rates by differences."""
    rng = np.random.default_rng(seed)
    robot = sst_pin.SST(random_parameters(rng))
    q, va, aa = robot.joint_motion(*random_state(robot, rng))
    h = 1e-3
    energy = []
    for t in h * np.arange(-3, 4):
        guess = q + robot.joint_rates(q, va) * t
        guess[::3] = q[::3] + va * t + aa * t**2 / 2
        q_t, va_t = robot.assemble(guess), va + aa * t
        energy.append(robot.kinetic_energy(q_t, va_t) + robot.potential_energy(q_t))
    rate = np.array((-1, 9, -45, 0, 45, -9, 1)) @ energy / (60 * h)
    power = robot.compute_torques(q, va, aa) @ va
    # Sixth-order differences: h^6 times the seventh derivative, a few times 1e3 here.
    assert power == pytest.approx(rate - robot.friction_power(q, va), rel=1e-7, abs=1e-6)


def test_smoothed_coulomb_friction_tends_to_the_sign():
    """tanh(x / width): odd, 76 % at the width, the sign far beyond."""
    smooth = Friction(np.zeros(3), np.ones(3), sign_width=1e-3)
    assert smooth.forces(np.array((0, 1e-3, -1.0))) == pytest.approx([0, -np.tanh(1), 1])
    assert Friction(np.zeros(2), np.ones(2)).forces(np.array((0, -2.0))).tolist() == [0, 1]


@pytest.mark.parametrize("compiled", [pytest.param(True, marks=pytest.mark.slow), False])
def test_joints_at_rest_have_no_coulomb_friction(compiled):
    """All motors alike at home: by symmetry beta_k rest, and mu_k turn by sqrt(2) each.

    So each motor needs F_c (1 + sqrt(2)) more than without friction; a sign of rounding would add
    F_c to some of them.
    """
    parameters = sst_pin.Parameters(coulomb_friction=0.3)
    rough, bare = sst_pin.SST(parameters), sst_pin.SST()
    for robot in (rough, bare) if compiled else ():
        robot.compile(robot.home)
    motion = rough.home, [1, 1, 1], [0, 0, 0]
    v = rough.joint_rates(*motion[:2])
    assert np.abs(v[2::3]).max() < 1e-14
    result = rough.compute_torques(*motion) - bare.compute_torques(*motion)
    assert np.allclose(result, 0.3 * (1 + np.sqrt(2)), rtol=0, atol=1e-12)


@pytest.mark.parametrize("make", [sst_pin.SST, sst_pin.robots.stewart])
def test_the_decoupled_factors_of_K_are_lower_triangular_and_diagonal(make):
    """In blocks of six: a body is moved by its own joint, and by the bodies that bear it.

    All joints of the SST have one axis; the Stewart platform has a free-flyer and universal joints.
    """
    chain = make()
    terms = chain.noc(chain.home, np.ones(chain.degrees_of_freedom))
    assert np.abs(terms.N_l @ terms.N_d - terms.K).max() < 1e-13
    r = len(terms.N_l) // 6
    N_l = terms.N_l.reshape(r, 6, r, 6).swapaxes(1, 2)
    for i in range(r):
        assert np.array_equal(N_l[i, i], np.eye(6))
        assert not N_l[i, i + 1 :].any()
        joint = chain.model.joints[i + 1]
        rates = np.arange(joint.idx_v, joint.idx_v + joint.nv)
        assert not np.delete(terms.N_d[6 * i : 6 * i + 6], rates, axis=1).any()


def test_friction_of_every_joint_reaches_the_motors(robot):
    """tau - tau_frictionless = L^T (D q_dot + F_c sign q_dot), joint after joint."""
    q, va, aa = robot.joint_motion(*random_state(robot, np.random.default_rng(2)))
    L = robot.noc(q, va).L
    bare = robot.compute_torques(q, va, aa)
    for joint in range(9):
        D, F = np.zeros(9), np.zeros(9)
        D[joint], F[joint] = 0.7, 0.4
        rubbing = sst_pin.SST(sst_pin.Parameters(viscous_friction=D, coulomb_friction=F))
        q_dot = rubbing.joint_rates(q, va)
        expected = L.T @ (D * q_dot + F * np.sign(q_dot))
        assert np.abs(rubbing.compute_torques(q, va, aa) - bare - expected).max() < 1e-12


def test_a_mass_matrix_that_is_not_finite_is_an_error_with_its_reason(monkeypatch):
    chain = sst_pin.robots.four_bar()
    monkeypatch.setattr(Context, "tree_inertia", lambda self: np.full((3, 3), np.nan))
    with pytest.raises(sst_pin.SingularConfigurationError, match="not finite numbers"):
        chain.compute_accelerations(chain.home, [0.0], [0.0])
