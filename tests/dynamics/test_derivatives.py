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
    of_gallery,
    of_tree,
    without_coulomb,
)
from tests.support.link_tables import ROBOTS

#: The others take a second for each of twenty states.
QUICK = ("floating four-bar", "geared")
SOME = [
    pytest.param(name, marks=() if name in QUICK or "four" in name else pytest.mark.slow)
    for name in CASES
]


@pytest.mark.parametrize("name", SOME)
def test_derivatives_of_robots_are_those_of_differences(name):
    """4 states; friction, springs and wrenches everywhere; also daa is the inertia."""
    make, *arguments = CASES[name]
    some, random = make(*arguments), np.random.default_rng(1)
    for state in some.states(4):
        assert_derivatives_are_those_of_differences(some, *state, random)
        assert_daa_is_the_inertia_and_dtau_its_inverse(some, *state)


@pytest.mark.parametrize("name", ROBOTS)
def test_dynamics_and_derivatives_obey_the_principle_of_virtual_work(name):
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
    q, va, aa, tau = m.q.real, m.va, m.aa, m.tau
    loads = {"external_wrenches": wrenches}
    close(chain.generalized_forces(q, va, aa, **loads), tau, 1e-9)
    close(chain.compute_accelerations(q, va, tau, **loads), aa, 1e-9)
    d_q, d_va, d_aa, d_tau = derivative(motion, 2e-3)
    df = chain.torque_derivatives(q, va, aa, sign_width=WIDTH, **loads)
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


def test_direct_and_inverse_dynamics_have_the_same_derivatives():
    """aa_x = -I^-1 f_x at the accelerations that the torques bring about."""
    robot, random = without_coulomb("6-UPS"), np.random.default_rng(0)
    none = np.zeros((len(robot.links), 6))
    motion, chain = robot.motion(robot.x, *random.uniform(-1, 1, (2, 6)), none), robot.chain()
    df = chain.torque_derivatives(motion.q.real, motion.va, motion.aa)
    da = chain.acceleration_derivatives(motion.q.real, motion.va, motion.tau)
    close(df.daa @ da.dq, -df.dq, 1e-10)
    close(df.daa @ da.dva, -df.dva, 1e-10)
    close(df.daa @ da.dtau, np.eye(6), 1e-10)


def test_friction_slopes_are_those_of_the_width():
    """At rest every joint's Coulomb friction adds F_c / width to viscous friction."""
    chain = ROBOTS["four-bar"].chain()
    robot = ROBOTS["four-bar"]
    q, L = robot.joints(robot.x).real, None
    L = chain.joint_rates(q, [1.0])
    wide, narrow = (
        chain.torque_derivatives(q, [0.0], [0.3], sign_width=width).dva for width in (0.1, 1e-3)
    )
    assert_allclose(narrow - wide, [[(1e3 - 10) * robot.coulomb @ L**2]], rtol=1e-12)
    with pytest.raises(InputError, match="sign_width: 0 is not above 0"):
        chain.torque_derivatives(q, [0.0], [0.3], sign_width=0)


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


@pytest.mark.parametrize("dt", [np.nan, np.inf, 0, -1])
def test_a_step_is_a_positive_number_and_a_number_has_no_index(dt):
    robot = robots.four_bar()
    said = "is not above 0" if np.isfinite(dt) else "is not finite"
    with pytest.raises(InputError, match=f"dt: {dt} {said}"):
        robot.linearize(robot.home, [0.0], [0.0], dt=dt)


@pytest.mark.parametrize(
    "make",
    [floating_four_bar, geared, lambda: of_gallery("delta"), lambda: of_tree("composite", "hinge")],
)
def test_frames_move_as_differences_say(make):
    case, random = make(), np.random.default_rng(2)
    for q, va, _, _ in case.states(5):
        assert_frames_move_as_differences_say(case, q, va, random)
