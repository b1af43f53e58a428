# SPDX-License-Identifier: BSD-2-Clause
"""The example of the fastest motion of the SST."""

import numpy as np
import pytest

import sst_pin
from tests.support.files import load

time_optimal = load("examples/time_optimal.py")
GOAL = time_optimal.GOAL
LIMIT = time_optimal.LIMIT
START = time_optimal.START
at_limit = time_optimal.at_limit
fastest = time_optimal.fastest
pose = time_optimal.pose
replayed = time_optimal.replayed
simulated = time_optimal.simulated
DEGREE = load("examples/collocation.py").DEGREE


def found(robot, intervals, limit=LIMIT):
    return fastest(robot, pose(robot, START), pose(robot, GOAL), intervals, limit)


@pytest.mark.slow
def test_bang_bang_within_the_arcs_and_replayed_in_mujoco(robot):
    """The example as it is: two motors switch, the first one rides along the end of its arc."""
    pytest.importorskip("mujoco", reason="mujoco is not installed (extra 'mjcf')")
    solution = found(robot, 40)
    assert at_limit(solution).min() > 0.85
    ends, motion = solution.q[DEGREE::DEGREE], simulated(robot, solution)
    assert np.abs(motion.q[4::4] - ends).max() < 1e-5
    assert np.abs(replayed(solution) - ends).max() < 1e-3
    assert robot.check(motion) == ()
    assert np.degrees(motion.q[:, 0].min()) < 1
    assert solution.duration < found(robot, 20).duration  # whose torques are among its own


@pytest.mark.slow
def test_without_gravity_four_times_the_torque_takes_half_the_time():
    """Inertia and velocity forces alone: the same path, twice as fast, under four times as much."""
    robot = sst_pin.SST(sst_pin.Parameters(gravity=(0, 0, 0)))
    slow, fast = found(robot, 10, 4.0), found(robot, 10, 16.0)
    assert fast.duration == pytest.approx(slow.duration / 2, rel=1e-6)
    np.testing.assert_allclose(fast.tau, 4 * slow.tau, atol=1e-3)
