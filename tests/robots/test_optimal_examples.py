# SPDX-License-Identifier: BSD-2-Clause
"""Examples: a pick and place of least energy, and the SST held where it would fall over."""

import numpy as np
import pytest

from tests.support.files import load

lqr_hold = load("examples/lqr_hold.py")
STEP = lqr_hold.STEP
regulator = lqr_hold.regulator
starts = lqr_hold.starts
swing = lqr_hold.swing
least_energy = load("examples/least_energy.py")
PICK = least_energy.PICK
PLACE = least_energy.PLACE
energy = least_energy.energy
energy_of_held = least_energy.energy_of_held
ground = least_energy.ground
least = least_energy.least
plain = least_energy.plain
robot = least_energy.robot
simulated = least_energy.simulated
DEGREE = load("examples/collocation.py").DEGREE


@pytest.mark.slow
def test_least_energy_is_less_than_the_plain_motions_and_its_work_is_potential_energy():
    """Rest to rest without friction: the mechanical work is the change of potential energy."""
    chain = robot()
    solution = least(chain, 8)
    motion = simulated(chain, solution, 10)
    total, copper = energy_of_held(chain, solution)
    before, lost = energy(plain(chain, np.linspace(0, 1, 201)))
    assert total < 0.5 * before
    ends = chain.potential_energy(solution.q[[0, -1]])
    # To what the collocation, or Simpson's rule, makes of some 0.3 J that go to and fro.
    assert total - copper == pytest.approx(ends[1] - ends[0], abs=1e-5)
    assert before - lost == pytest.approx(ends[1] - ends[0], abs=1e-5)
    assert np.abs(motion.q[10::10] - solution.q[DEGREE::DEGREE]).max() < 1e-3
    assert np.abs([chain.residual(q) for q in solution.q]).max() < 1e-7


def test_the_plain_motion_clears_the_ground_and_comes_to_rest():
    """Its accelerations are those of its rates, by differences of second order."""
    chain = robot()
    motion = plain(chain, np.linspace(0, 1, 41))
    p = chain.platform_pose(motion.q)[:, :3, 3]
    np.testing.assert_allclose(p[[0, -1]], [PICK, PLACE], atol=1e-12)
    assert (p[:, 2] - PICK[2] - ground(p[:, 0])).min() > -1e-9
    np.testing.assert_allclose(motion.va[[0, -1]], 0, atol=1e-12)
    slopes = np.gradient(motion.va, motion.t, axis=0)[1:-1]
    assert np.abs(slopes - motion.aa[1:-1]).max() < 0.05 * np.abs(motion.aa).max()


def test_the_regulator_holds_a_pose_that_is_unstable(compiled_robot):
    """The linear system comes to rest, and near the pose so does the robot, at the same rate."""
    control = regulator(compiled_robot)
    assert control.poles.real.max() > 4
    rest = np.zeros(3)
    A, B = compiled_robot.linearize(control.q, rest, control.hold, dt=STEP)
    closed = A - B @ control.gain
    slowest = np.abs(np.linalg.eigvals(closed)).max()
    assert slowest < 1
    q = starts(compiled_robot, np.array([1e-4]))[0]
    x = np.concatenate(
        [q[0, compiled_robot.actuated] - control.q[list(compiled_robot.actuated)], rest]
    )
    expected = []
    for _ in range(100):
        expected.append(np.abs(x[:3]).max())
        x = closed @ x
    # The robot is off its linear system by the square of the error, 1e-8 of 1e-4.
    np.testing.assert_allclose(
        swing(compiled_robot, control, q, 100 * STEP)[:, 0], expected, atol=1e-7
    )
