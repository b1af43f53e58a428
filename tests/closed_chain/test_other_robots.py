# SPDX-License-Identifier: BSD-2-Clause
"""`ClosedChain` holds for any closed chain: planar, spatial and spherical, redundant or not."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sst_pin import ClosedChain
from sst_pin.errors import ActuationError, ClosureError, SingularConfigurationError
from tests.support.derivative_cases import close
from tests.support.differences import derivative
from tests.support.link_tables import ROBOTS, Robot, derivatives

STATES = range(2)


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request) -> Robot:
    return ROBOTS[request.param]


@pytest.fixture(scope="module")
def chain(robot) -> ClosedChain:
    return robot.chain()


def random_state(robot, seed):
    """x, its rates and accelerations, and wrenches on the bodies, away from singularities."""
    random, n = np.random.default_rng(seed), len(robot.x)
    x = robot.x + random.uniform(-0.05, 0.05, n)
    return x, *random.uniform(-1, 1, (2, n)), random.uniform(-5, 5, (len(robot.links), 6))


@pytest.fixture(scope="module")
def states(robot):
    """Some states of motion, with the torques of the principle of virtual work."""
    made = (random_state(robot, seed) for seed in STATES)
    return [(robot.motion(*state, wrenches), wrenches) for *state, wrenches in made]


@pytest.mark.parametrize("generic", [True, False])
def test_mobility_counts_the_freedoms_and_the_redundant_rows(robot, chain, generic):
    """The rank of the closures is m - n, and the motors hold all of the n freedoms."""
    report = chain.mobility(None if generic else robot.joints(robot.x).real)
    m, n = len(robot.links), len(robot.x)
    assert (report.degrees_of_freedom, report.rank, report.held) == (n, m - n, n)
    assert report.redundant_rows == robot.redundant_rows
    assert report.sufficient
    assert not report.redundantly_actuated
    assert report.motor_names == tuple(robot.actuated)


def test_L_is_an_orthogonal_complement_of_Phi(robot, chain, states):
    """Phi L = 0 in all rows, the motors' rows of L are the unit matrix, and q_dot = L va."""
    for motion, _ in states:
        terms = chain.noc(motion.q, motion.va)
        m, n = terms.L.shape
        # Rounding times a condition number below 100; first rates by Cauchy's integrals likewise.
        assert_allclose(chain.Phi(motion.q) @ terms.L, 0, atol=1e-13 * np.abs(terms.L).max())
        assert_allclose(terms.L[robot.motors], np.eye(n), atol=1e-13)
        assert terms.Phi.shape == (m - n, m)
        assert np.linalg.matrix_rank(terms.Phi) == m - n
        close(terms.L @ motion.va, motion.q_dot, 1e-13)
        close(chain.joint_rates(motion.q, motion.va), motion.q_dot, 1e-13)


def test_torques_obey_the_principle_of_virtual_work_and_accelerations_invert_them(chain, states):
    """With weight, inertia, rotors, friction in all joints and a wrench on every body."""
    for motion, wrenches in states:
        given = {"external_wrenches": wrenches}
        # Cauchy's integrals leave 1e-16 / 0.1^2, the condition number multiplies it by up to 100.
        close(chain.compute_torques(motion.q, motion.va, motion.aa, **given), motion.tau, 1e-12)
        # Times the condition number of the inertia matrix, below 10.
        close(
            chain.compute_accelerations(motion.q, motion.va, motion.tau, **given), motion.aa, 1e-11
        )


def test_the_long_form_adds_up_to_the_torques(chain, states):
    """tau = inertia aa + coriolis va - gravity - friction, Eq. (92); energies have its terms."""
    for motion, _ in states:
        terms, state = chain.noc(motion.q, motion.va), (motion.q, motion.va)
        close(chain.kinetic_energy(*state), motion.va @ terms.inertia @ motion.va / 2, 1e-12)
        close(chain.friction_power(*state), motion.va @ terms.friction, 1e-12)
        tau = (
            terms.inertia @ motion.aa + terms.coriolis @ motion.va - terms.gravity - terms.friction
        )
        # Two orders of the same sums: rounding times a condition number below 100.
        close(tau, chain.compute_torques(motion.q, motion.va, motion.aa), 1e-12)


@pytest.mark.parametrize(
    ("name", "motors"), [("four-bar", []), ("spherical 3-RRR", ["first_0", "second_0"])]
)
def test_too_few_motors_leave_loose_joints(name, motors):
    robot = ROBOTS[name]
    chain, q = robot.chain(motors), robot.joints(robot.x).real
    report = chain.mobility(q)
    assert not report.sufficient
    assert report.degrees_of_freedom - report.held == len(robot.x) - len(motors)
    assert report.loose_joints
    assert "INSUFFICIENT" in str(report)
    n = chain.degrees_of_freedom
    assert n == len(robot.x)
    with pytest.raises(ActuationError, match="no motor supplies") as caught:
        chain.compute_torques(q, np.ones(n), np.ones(n))
    assert set(caught.value.missing) <= set(chain.coordinates) - set(motors)
    # What cannot be brought about from rest is what happens without torques: that can.
    aa = chain.compute_accelerations(q, np.ones(n), np.zeros(len(motors)))
    assert np.abs(chain.compute_torques(q, np.ones(n), aa)).max(initial=0.0) < 1e-9


def test_an_open_loop_is_refused(robot, chain):
    """Every dynamic quantity wants closed loops, and the error tells by how much they are open."""
    q = robot.joints(robot.x).real
    q[-1] += 1e-3
    zeros = np.zeros(len(robot.x))
    opened = np.abs(chain.residual(q)).max()
    for compute in (
        lambda: chain.compute_torques(q, zeros, zeros),
        lambda: chain.compute_accelerations(q, zeros, zeros),
        lambda: chain.noc(q, zeros),
        lambda: chain.joint_rates(q, zeros),
        lambda: chain.mobility(q),
        lambda: chain.simulate(zeros, q, zeros, [0, 0.1]),
    ):
        with pytest.raises(ClosureError, match=r"assemble\(q\) closes them") as caught:
            compute()
        assert caught.value.residual == pytest.approx(opened)


@pytest.mark.parametrize("name", ["four-bar", "four-bar, coupler aligned and pinned"])
def test_a_stretched_four_bar_is_singular_for_a_motor_at_the_rocker(name):
    """With crank and coupler in line, the rocker's rate does not say where the crank goes."""
    robot = ROBOTS[name]
    chain = robot.chain(["rocker"])
    # Crank and coupler in line, ground and rocker make a triangle: the law of cosines.
    crank = np.arccos((1.5**2 + 1.2**2 - 0.9**2) / (2 * 1.5 * 1.2))
    stretched = robot.joints(np.array([crank])).real
    assert_allclose(stretched[1], 0, atol=1e-12)
    moving = robot.joints(robot.x).real
    conditions = chain.condition_number([[moving, stretched]])
    assert conditions.shape == (1, 2)
    assert conditions[0, 0] == chain.condition_number(moving) < 100
    assert conditions[0, 1] > 1e10
    assert not chain.mobility(stretched).sufficient
    for compute in (chain.compute_torques, chain.compute_accelerations):
        with pytest.raises(SingularConfigurationError, match="condition number") as caught:
            compute(stretched, [0], [0])
        assert caught.value.condition_number > 1e10
        with pytest.raises(
            SingularConfigurationError, match=r"2 of 4 samples \(index 1, 3\)"
        ) as caught:
            compute([moving, stretched] * 2, [0], [0])
        assert caught.value.samples == ((1,), (3,))
    robot.chain().compute_torques(stretched, [0], [0])  # for the crank's motor it is not


def test_the_rates_of_the_complement_are_its_derivatives(robot, chain):
    x, x_dot, *_ = random_state(robot, 0)
    q, q_dot, _ = derivatives(robot.joints, x, x_dot)

    @cache
    def terms(t):
        return chain.noc(robot.joints(x + x_dot * t).real, np.zeros(len(x)))

    now = chain.noc(q, q_dot[robot.motors])
    for name in "LKT":
        rate = derivative(lambda t, name=name: getattr(terms(t), name))
        close(getattr(now, name + "_dot"), rate, 1e-9)  # the differences' truncation
