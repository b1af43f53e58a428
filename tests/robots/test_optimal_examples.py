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
ground = least_energy.ground
least = least_energy.least
plain = least_energy.plain
robot = least_energy.robot


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


@pytest.mark.slow
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
