# SPDX-License-Identifier: BSD-2-Clause
"""Examples: a pick and place of least energy, and the SST held where it would fall over."""

import numpy as np
import pytest

from tests.support.files import load

lqr = load("examples/lqr_hold.py")
transfer = load("examples/least_energy.py")


def test_the_plain_motion_clears_the_ground_and_comes_to_rest():
    """Its accelerations are those of its rates, by differences of second order."""
    chain = transfer.robot()
    motion = transfer.plain(chain, np.linspace(0, 1, 41))
    p = chain.platform_pose(motion.q)[:, :3, 3]
    np.testing.assert_allclose(p[[0, -1]], [transfer.PICK, transfer.PLACE], atol=1e-12)
    assert (p[:, 2] - transfer.PICK[2] - transfer.ground(p[:, 0])).min() > -1e-9
    np.testing.assert_allclose(motion.va[[0, -1]], 0, atol=1e-12)
    slopes = np.gradient(motion.va, motion.t, axis=0)[1:-1]
    assert np.abs(slopes - motion.aa[1:-1]).max() < 0.05 * np.abs(motion.aa).max()


@pytest.mark.slow
def test_the_regulator_holds_a_pose_that_is_unstable(compiled_robot):
    """The linear system comes to rest, and near the pose so does the robot, at the same rate."""
    control = lqr.regulator(compiled_robot)
    assert control.poles.real.max() > 4
    rest = np.zeros(3)
    A, B = compiled_robot.linearize(control.q, rest, control.hold, dt=lqr.STEP)
    closed = A - B @ control.gain
    slowest = np.abs(np.linalg.eigvals(closed)).max()
    assert slowest < 1
    q = lqr.starts(compiled_robot, np.array([1e-4]))[0]
    motors = list(compiled_robot.motor_indices)
    x = np.concatenate([q[0, motors] - control.q[motors], rest])
    expected = []
    for _ in range(100):
        expected.append(np.abs(x[:3]).max())
        x = closed @ x
    # The robot is off its linear system by the square of the error, 1e-8 of 1e-4.
    swung = lqr.swing(compiled_robot, control, q, 100 * lqr.STEP)[:, 0]
    np.testing.assert_allclose(swung, expected, atol=1e-7)
