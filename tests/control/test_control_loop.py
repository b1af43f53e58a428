# SPDX-License-Identifier: BSD-2-Clause
"""The example of a loop at 1 kHz computes what it should, and reports the periods that it kept."""

import numpy as np
import pytest

import control_loop
import sst_pin


def test_the_loop_computes_the_torques_of_the_motion():
    robot = sst_pin.robots.five_bar()
    motion = control_loop.swing(robot, 0.1)
    step, count = control_loop.steps(robot, 0.1)
    torques = np.array([step(k) for k in range(count)])
    # Rates are differences of encoders over a period, half a period late.
    wanted = np.array([np.interp(1e-3 * np.arange(count), motion.t, tau) for tau in motion.tau.T]).T
    assert np.abs(torques - wanted)[10:].max() < 0.05 * np.abs(motion.tau).max()


def test_periods_that_begin_late_are_counted():
    began, took = np.array([0.0, 1e-3, 2.1e-3, 3.4e-3, 4e-3]), np.full(5, 2e-4)
    told = control_loop.report(began, took)
    assert "5 periods of 1 ms: 50.00 % within 0.2 ms" in told
    assert "computed for 200 us (median)" in told


def test_every_period_is_run_once():
    done = []
    began, took = control_loop.run(done.append, 20)
    assert done == list(range(20))
    assert (began >= np.arange(20) * 1e-3 - 1e-9).all()
    assert (took >= 0).all()
    assert began[0] == pytest.approx(0, abs=0.1)
