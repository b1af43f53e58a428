# SPDX-License-Identifier: BSD-2-Clause
"""The example that holds the SST where it would fall over."""

import numpy as np
import pytest

from lqr_hold import STEP, Regulator, region, regulator, starts, swing


def test_the_regulator_holds_a_pose_that_is_unstable(robot):
    """The linear system comes to rest, and near the pose so does the robot, at the same rate."""
    control = regulator(robot)
    assert control.poles.real.max() > 4
    rest = np.zeros(3)
    A, B = robot.linearize(control.q, rest, control.hold, dt=STEP)
    closed = A - B @ control.gain
    slowest = np.abs(np.linalg.eigvals(closed)).max()
    assert slowest < 1
    q = starts(robot, np.array([1e-4]))[0]
    x = np.concatenate([q[0, robot.actuated] - control.q[list(robot.actuated)], rest])
    expected = []
    for _ in range(100):
        expected.append(np.abs(x[:3]).max())
        x = closed @ x
    # The robot is off its linear system by the square of the error, 1e-8 of 1e-4.
    np.testing.assert_allclose(swing(robot, control, q, 100 * STEP)[:, 0], expected, atol=1e-7)


@pytest.mark.slow
def test_it_falls_without_and_far_from_the_pose(robot):
    control = regulator(robot)
    held = region(robot, control, np.array([-0.7, -0.2, 0.2]), seconds=2.0)
    assert held[1:, 1:].all()
    assert not held[0, 2]
    idle = Regulator(control.q, control.hold, 0 * control.gain, control.poles)
    assert not region(robot, idle, np.array([0.01]), seconds=2.0).any()
