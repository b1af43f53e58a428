# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives along the motions that keep the loops closed."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from sst_pin import robots
from sst_pin.errors import InputError
from tests.support.derivative_cases import (
    CASES,
    CONSTRAINTS,
    TREES,
    WIDTH,
    assert_daa_is_the_inertia_and_dtau_its_inverse,
    assert_derivatives_are_those_of_differences,
    assert_frames_move_as_differences_say,
    close,
    derivative,
    floating_four_bar,
    geared,
    of_tree,
    without_coulomb,
)
from tests.support.link_tables import ROBOTS

#: The others take a second for each state.
QUICK = ("floating four-bar", "four_bar", "geared", "n_four_bar")
#: Those of the table obey the principle of virtual work.
SOME = [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
    for name in CASES
    if not name.endswith("(table)")
]


@pytest.mark.parametrize("name", SOME)
def test_derivatives_of_robots_are_those_of_differences(name):
    """Friction, springs and wrenches everywhere; also daa is the inertia."""
    make, *arguments = CASES[name]
    some, random = make(*arguments), np.random.default_rng(1)
    for state in some.states(2):
        assert_derivatives_are_those_of_differences(some, *state, random)
        assert_daa_is_the_inertia_and_dtau_its_inverse(some, *state)


@pytest.mark.parametrize("name", ROBOTS)
def test_derivatives_obey_the_principle_of_virtual_work(name):
    """Along any curve of states tau' = dq q_a' + dva va' + daa aa', by virtual work alone."""
    robot = without_coulomb(name)
    chain, random = robot.chain(), np.random.default_rng(3)
    n = len(robot.x)
    wrenches = random.uniform(-5, 5, (len(robot.links), 6))
    state = np.array([robot.x, *random.uniform(-1, 1, (2, n))])
    way = random.uniform(-1, 1, (3, n))

    def motion(s):
        m = robot.motion(*(state + s * way), wrenches)
        return np.array([m.q[robot.motors], m.va, m.aa, m.tau]).real

    m = robot.motion(*state, wrenches)
    loads = {"external_wrenches": wrenches, "sign_width": WIDTH}
    df = chain.torque_derivatives(m.q.real, m.va, m.aa, **loads)
    d_q, d_va, d_aa, d_tau = derivative(motion, 2e-3)
    # Cauchy's integrals leave 1e-14 of the torques, over the step; assembled to 1e-15.
    close(df.dq @ d_q + df.dva @ d_va + df.daa @ d_aa, d_tau, 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("kind", CONSTRAINTS)
@pytest.mark.parametrize("name", TREES)
def test_derivatives_through_every_closure_and_every_joint(name, kind):
    """Trees that were not added depth-first, with joints whose axes move."""
    case, random = of_tree(name, kind), np.random.default_rng(1)
    for state in case.states(2):
        assert_derivatives_are_those_of_differences(case, *state, random)


def test_linearize_is_the_motion_next_to_a_state():
    """A floating four-bar: neighbouring motions drift by A; the moving axes carry them on."""
    case = floating_four_bar()
    chain, model = case.chain, case.chain.model
    random, n = np.random.default_rng(4), chain.degrees_of_freedom
    (q, va, _, _) = next(case.states(1))
    tau = random.uniform(-2, 2, len(chain.motor_names))
    A, B = chain.linearize(q, va, tau, sign_width=WIDTH)
    way = random.uniform(-1, 1, 2 * n)
    columns = [chain.position_names.index("crank") - 1]  # after a quaternion
    columns = [*range(6), *columns]

    def flow(s, t):
        """How far the coordinates of a neighbour are from q's, both moved for a time t."""
        at = case.at(q, way[:n], s)
        ends = [
            pin.integrate(model, x, t * chain.joint_rates(x, rates))
            for x, rates in ((q, va), (at, va + s * way[n:]))
        ]
        return pin.difference(model, *ends)[columns]

    drift = derivative(lambda t: derivative(lambda s: flow(s, t), 1e-2), 1e-2)
    close((A @ way)[:n], drift, 1e-8)
    da = chain.acceleration_derivatives(q, va, tau, sign_width=WIDTH)
    assert_allclose(A[n:], np.hstack([da.dq, da.dva]), rtol=0, atol=0)
    assert_allclose(B[n:], da.dtau, rtol=0, atol=0)
    assert not B[:n].any()


def test_the_discrete_system_is_the_motion_next_to_an_equilibrium():
    robot = robots.delta()
    q, dt, rest = robot.home, 0.02, np.zeros(3)
    hold = robot.compute_torques(q, rest, rest)
    A, B = robot.linearize(q, rest, hold)
    A_d, B_d = robot.linearize(q, rest, hold, dt=dt)
    step = expm(np.block([[A, B], [np.zeros((3, 9))]]) * dt)
    assert_allclose(A_d, step[:6, :6], rtol=1e-12, atol=1e-14)
    columns = [robot.position_names.index(name) for name in robot.motor_names]
    random = np.random.default_rng(0)
    way, push = random.uniform(-1, 1, 6), random.uniform(-1, 1, 3)

    def end(s):
        step = s * robot.joint_rates(q, way[:3])
        at = robot.assemble(pin.integrate(robot.model, q, step))
        motion = robot.simulate(lambda *_: hold + s * push, at, s * way[3:], [0, dt])
        return np.concatenate([motion.q[-1][columns], motion.va[-1]])

    close(A_d @ way + B_d @ push, derivative(end, 1e-3), 1e-7)


def test_a_step_and_a_width_are_positive():
    robot = robots.four_bar()
    with pytest.raises(InputError, match="dt: 0 is not above 0"):
        robot.linearize(robot.home, [0.0], [0.0], dt=0)
    with pytest.raises(InputError, match="sign_width: 0 is not above 0"):
        robot.torque_derivatives(robot.home, [0.0], [0.3], sign_width=0)


@pytest.mark.parametrize("make", [floating_four_bar, geared, lambda: of_tree("composite", "hinge")])
def test_frames_move_as_differences_say(make):
    case, random = make(), np.random.default_rng(2)
    for q, va, _, _ in case.states(2):
        assert_frames_move_as_differences_say(case, q, va, random)
