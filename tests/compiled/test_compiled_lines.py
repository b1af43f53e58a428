# SPDX-License-Identifier: BSD-2-Clause
"""Forces and motors on lines by kernels: numbers that stay open, samples that are refused."""

import numpy as np
import pinocchio as pin
import pytest

import any_chain
import sst_pin
from any_chain import GAS, SPRING, lines
from derivative_cases import close
from sst_pin import ClosedChain, LineForce, robots


@pytest.fixture(scope="module")
def both():
    fast = lines()
    fast.compile(derivatives=True)
    return fast, lines()


def test_numbers_of_lines_change_without_a_new_compilation_and_ends_with_one(both):
    """Kernels hold the ends, not the numbers: both give what the reference path gives."""
    q, va, aa = any_chain.states(both[1], 3, 0)
    soft = LineForce("wall", "platform", name="gas", stiffness=7, damping=1, preload=2)
    for where, forces in (((-0.3, 0.1, 0.3), (soft, SPRING)), ((-0.2, 0, 0.3), (GAS, SPRING))):
        robot, twin = lines(where, forces), lines(where, forces)
        robot.compile()
        close(robot.compute_torques(q, va, aa), twin.compute_torques(q, va, aa), 1e-12)


def test_samples_whose_line_has_no_direction_are_refused_by_kernels_too(both):
    home = robots.four_bar().home
    data = lines().model.createData()
    pin.framesForwardKinematics(lines().model, data, home)
    at = data.oMf[lines().model.getFrameId("platform")].translation
    robot = lines(at)
    robot.compile()
    q = np.array([both[1].assemble([*home[:2], home[2] + 0.2]), home])
    with pytest.raises(sst_pin.SingularConfigurationError, match="gas is not determined"):
        robot.compute_torques(q, [0], [0])
    tau = robot.compute_torques(q, [0], [0], on_error="nan")
    assert np.isnan(tau).any(axis=1).tolist() == [False, True]


def test_a_motor_between_frames_of_one_body_moves_nothing():
    """On both paths it is refused, alone; beside another motor its force is zero."""
    line, bar = LineForce("coupler_pin", "platform", name="idle"), robots.four_bar()
    for motors in (["idle"], ["idle", "crank"]):
        fast, plain = (ClosedChain(bar.model, bar.closures, motors, forces=[line]) for _ in "ab")
        fast.compile()
        if len(motors) == 1:
            for robot in (fast, plain):
                with pytest.raises(sst_pin.ActuationError):
                    robot.compute_torques(bar.home, [1], [0])
        else:
            tau = plain.compute_torques(bar.home, [1], [0])
            assert tau[0] == 0
            close(fast.compute_torques(bar.home, [1], [0]), tau, 1e-12)
