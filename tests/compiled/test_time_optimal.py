# SPDX-License-Identifier: BSD-2-Clause
"""The example of the fastest motion of the SST."""

import numpy as np
import pytest

from tests.support.files import load

time_optimal = load("examples/time_optimal.py")
DEGREE = load("examples/collocation.py").DEGREE


def found(robot, intervals):
    ends = (time_optimal.pose(robot, x) for x in (time_optimal.START, time_optimal.GOAL))
    return time_optimal.fastest(robot, *ends, intervals, time_optimal.LIMIT)


@pytest.mark.slow
def test_bang_bang_within_the_arcs_and_replayed_in_mujoco(robot):
    """The example as it is: two motors switch, the first one rides along the end of its arc."""
    pytest.importorskip("mujoco", reason="mujoco is not installed (extra 'mjcf')")
    solution = found(robot, 40)
    assert time_optimal.at_limit(solution).min() > 0.85
    ends, motion = solution.q[DEGREE::DEGREE], time_optimal.simulated(robot, solution)
    assert np.abs(motion.q[4::4] - ends).max() < 1e-5
    assert np.abs(time_optimal.replayed(solution) - ends).max() < 1e-3
    assert robot.check_limits(motion) == ()
    assert np.degrees(motion.q[:, 0].min()) < 1
    assert solution.duration < found(robot, 20).duration  # whose torques are among its own
