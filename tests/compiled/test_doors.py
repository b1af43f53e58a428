# SPDX-License-Identifier: BSD-2-Clause
"""NumPy arrays on both paths and CasADi's functions satisfy the same theorems."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from sst_pin import ClosedChain
from tests.support.derivative_cases import (
    CASES,
    WIDTH,
    assert_daa_is_the_inertia_and_dtau_its_inverse,
    assert_derivatives_are_those_of_differences,
    carried_four_bar,
    close,
    derivative,
    of_gallery,
    without_coulomb,
)
from tests.support.doors import DOORS, Kernels
from tests.support.link_tables import ROBOTS

#: The others take seconds.
QUICK = ("four_bar", "five_bar")
SOME = [
    ("four_bar", "arrays"),
    ("four_bar", "CasADi"),
    ("five_bar", "kernels"),
    ("five_bar", "CasADi"),
    ("floating four-bar", "kernels"),
    ("floating four-bar", "CasADi"),
    ("delta", "CasADi"),
    ("a motor on a line", "CasADi"),
    ("two motors on lines", "kernels"),
]


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(pair, id=", ".join(pair), marks=[pytest.mark.slow] * (pair[0] not in QUICK))
        for pair in SOME
    ],
)
def behind(request):
    """A robot with friction and springs everywhere, and a door to it."""
    name, door = request.param
    make, *arguments = CASES[name]
    case = make(*arguments)
    return case, DOORS[door](case)


def short(chain, q, va, tau):
    """A step that is a small part of the shortest time constant, [s]."""
    A, _ = chain.linearize(q, va, tau, sign_width=WIDTH)
    return 0.03 / np.abs(np.linalg.eigvals(A)).max()


def test_rates_keep_the_loops_closed_and_the_coordinates(behind):
    case, door = behind
    for q, va, _, _ in case.states(3):
        v = door.rates(q, va)
        assert np.abs(case.chain.Phi(q) @ v).max() < 1e-13 * max(np.abs(v).max(), 1)
        assert_allclose(v[case.chain.mechanism.coordinates], va, rtol=0, atol=1e-15)


def test_a_step_keeps_the_loops_closed_and_its_error_is_of_fifth_order(behind):
    """Against an integrator of eighth order: half the step leaves a 32nd."""
    case, door = behind
    if isinstance(door, Kernels):
        pytest.skip("test_same_numbers.py holds compiled rollouts to those of the reference path")
    chain, errors = case.chain, []
    q, va, _, _ = next(case.states(1))
    tau = np.linspace(-1, 1, len(chain.motor_names))
    h = short(chain, q, va, tau)
    for dt in (h, h / 2):
        exact = chain.simulate(
            tau, q, va, [0, dt], method="DOP853", rtol=1e-13, atol=1e-13, sign_width=WIDTH
        )
        q_next, va_next = door.step(q, va, tau, dt)
        assert np.abs(chain.residual(q_next)).max() < 1e-12
        errors.append(np.abs(np.concatenate([q_next - exact.q[1], va_next - exact.va[1]])).max())
    assert 28 < errors[0] / errors[1] < 40  # 32, and terms of the next order


OBEYING = [(name, "arrays") for name in ROBOTS]
OBEYING += [("four-bar", "CasADi")]


@pytest.mark.parametrize(("name", "door"), OBEYING)
def test_dynamics_and_derivatives_obey_the_principle_of_virtual_work(name, door):
    """Along any curve of states tau' = dq q_a' + dva va' + daa aa', by virtual work alone."""
    robot = without_coulomb(name)
    chain, random = robot.chain(), np.random.default_rng(3)
    n = len(robot.x)
    wrenches = random.uniform(-5, 5, (len(robot.links), 6))
    door = DOORS[door](SimpleNamespace(chain=chain, home=robot.joints(robot.x).real))
    loads = {"external_wrenches": wrenches}
    state = np.array([robot.x, *random.uniform(-1, 1, (2, n))])
    way = random.uniform(-1, 1, (3, n))

    def motion(s):
        m = robot.motion(*(state + s * way), wrenches)
        return np.array([m.q[robot.motors], m.va, m.aa, m.tau]).real

    m = robot.motion(*state, wrenches)
    q, va, aa, tau = m.q.real, m.va, m.aa, m.tau
    close(door.forces(q, va, aa, **loads), tau, 1e-9)
    close(door.accelerations(q, va, tau, **loads), aa, 1e-9)
    d_q, d_va, d_aa, d_tau = derivative(motion, 2e-3)
    df = door.torque_derivatives(q, va, aa, **loads)
    # Cauchy's integrals leave 1e-14 of the torques, over the step; assembled to 1e-15.
    close(df.dq @ d_q + df.dva @ d_va + df.daa @ d_aa, d_tau, 1e-9)


def test_derivatives_are_those_of_differences(behind):
    case, door = behind
    random = np.random.default_rng(1)
    for state in case.states(3):
        assert_derivatives_are_those_of_differences(case, door, *state, random)
        assert_daa_is_the_inertia_and_dtau_its_inverse(case, door, *state)


@pytest.mark.parametrize("door", ["arrays", "CasADi"])
def test_a_turn_of_the_base_about_the_vertical_changes_nothing(door):
    """The yaw column of a four-bar on a yaw joint is zero, for forces and accelerations."""
    model, closures, motors, start = carried_four_bar(pin.JointModelRZ())
    chain, random = ClosedChain(model, closures, motors), np.random.default_rng(0)
    door = DOORS[door](SimpleNamespace(chain=chain, home=chain.assemble(start)))
    for _ in range(20):
        q = chain.assemble(start + random.uniform(-0.1, 0.1, 4))
        va, aa, tau = random.uniform(-2, 2, (3, 2))
        dq = door.torque_derivatives(q, va, aa).dq
        assert np.abs(dq[:, 0]).max() < 1e-12 * np.abs(dq).max()
        dq = door.acceleration_derivatives(q, va, tau).dq
        assert np.abs(dq[:, 0]).max() < 1e-12 * np.abs(dq).max()


def assert_second_derivatives_are_those_of_differences(case, door):
    """Differences of exact first derivatives; symmetric, as the coordinates are single joints."""
    q, va, aa, _ = next(case.states(1))
    n, (way, dva, daa) = len(va), (case.way(q, np.random.default_rng(k)) for k in range(3))

    def first(s):
        at = case.at(q, way, s), va + s * dva, aa + s * daa
        return np.concatenate(case.chain.torque_derivatives(*at, sign_width=WIDTH), axis=1)

    second = door.second_derivatives(q, va, aa)
    close(second @ np.concatenate([way, dva, daa]), derivative(first), 1e-7)
    close(second, np.swapaxes(second, 1, 2), 1e-12)
    assert not second[:, 2 * n :, n:].any()  # torques are linear in aa, with factors of q


def test_second_derivatives_are_those_of_differences_and_symmetric(behind):
    case, door = behind
    if not hasattr(door, "second_derivatives") or case.chain.degrees_of_freedom > 3:
        pytest.skip("first order, or coordinates whose axes move")
    assert_second_derivatives_are_those_of_differences(case, door)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scissor_lift", "excavator", "planar_4rrr", "hexaglide"])
def test_second_derivatives_of_other_robots_are_those_of_differences(name):
    case = of_gallery(name)
    assert_second_derivatives_are_those_of_differences(case, DOORS["CasADi"](case))


def test_derivatives_of_a_step_are_those_of_differences():
    """Differences of rollouts by the chain, from neighbours and with other torques."""
    make, *arguments = CASES["five_bar"]
    case, random = make(*arguments), np.random.default_rng(0)
    door, chain = DOORS["CasADi"](case), case.chain
    q, va, _, _ = next(case.states(1))
    tau, push = random.uniform(-1, 1, (2, len(chain.motor_names)))
    way, dva = case.way(q, random), case.way(q, random)
    dt = short(chain, q, va, tau)

    def end(s):
        at = case.at(q, way, s), va + s * dva
        motion = chain.rollout([tau + s * push], *at, dt, sign_width=WIDTH)
        return np.concatenate([motion.q[1], motion.va[1]])

    by = door.step_derivatives(q, va, tau, dt)
    close(by @ np.concatenate([way, dva, push]), derivative(end), 1e-7)
