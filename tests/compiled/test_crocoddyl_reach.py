# SPDX-License-Identifier: BSD-2-Clause
"""The example that hands the SST to Crocoddyl."""

import numpy as np
import pytest

from tests.support.files import load

crocoddyl = pytest.importorskip("crocoddyl", reason="crocoddyl is not installed (extra 'optimal')")
example = load("examples/crocoddyl_reach.py")


def test_crocoddyl_differentiates_the_closed_chain_as_we_do(robot):
    """Its forward differences of our action, along its moves of our state."""
    rng = np.random.default_rng(0)
    state = example.ClosedState(robot, robot.home)
    goal = state.zero()
    model = example.ClosedAction(state, goal, np.ones(6), 1e-2)
    x, u = state.integrate(goal, 0.2 * rng.normal(size=6)), rng.normal(size=3)
    data = model.createData()
    model.calc(data, x, u)
    model.calcDiff(data, x, u)
    differences = crocoddyl.DifferentialActionModelNumDiff(model)
    numbers = differences.createData()
    differences.calc(numbers, x, u)
    differences.calcDiff(numbers, x, u)
    # One-sided, with steps of 1e-8 or so: eight digits of an O(10) acceleration's slope.
    scale = np.abs(data.Fx).max()
    np.testing.assert_allclose(numbers.Fx, data.Fx, atol=1e-5 * scale)
    np.testing.assert_allclose(numbers.Fu, data.Fu, atol=1e-5 * np.abs(data.Fu).max())
    np.testing.assert_allclose(numbers.Lx, data.Lx, atol=1e-5)


def test_box_fddp_brings_the_sst_to_a_pose_within_its_torques(robot):
    """The loops stay closed, and the torques are what `rollout` needs, up to Euler's steps."""
    solver, converged = example.reach(robot, (0.15, -0.2, 0.25), 40)
    assert converged
    assert solver.iter < 30
    q, tau = np.array(solver.xs)[:, :9], np.array(solver.us)
    assert np.abs(tau).max() <= example.LIMIT + 1e-12
    assert np.abs([robot.residual(x) for x in q]).max() < 1e-9
    goal = solver.problem.terminalModel.differential.goal
    assert np.abs(q[-1] - goal[:9]).max() < 1e-3
    motion = robot.rollout(tau, robot.home, np.zeros(3), example.STEP)
    # Symplectic Euler at 10 ms: an error of the size of the step times the rate, some 1 rad/s.
    assert np.abs(motion.q - q).max() < 0.02
