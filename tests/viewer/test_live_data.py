# SPDX-License-Identifier: BSD-2-Clause
"""Data of the live page that need no browser."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.viewer.live_data import live_data
from sst_pin.viewer.robot_scene import Scene


def test_the_weight_of_the_live_page_is_that_of_the_moving_bodies():
    chain = sst_pin.robots.four_bar()
    model = pin.Model(chain.model)
    model.inertias[0] = pin.Inertia.FromSphere(100.0, 0.1)  # a heavy base, fixed to the world
    heavy = sst_pin.ClosedChain(model, chain.closures, chain.motor_names)
    weights = []
    for robot in (chain, heavy):
        scene = Scene(robot, None)
        weights.append(live_data(robot, scene, scene.start, np.zeros(1))["weight"])
    assert weights[1] == pytest.approx(weights[0])


def test_the_effort_limits_of_motors_are_those_of_check_limits():
    # A motor with a gear of 2 on one joint, and a cylinder. Alone, each motor reaches the limit of
    # its joint or line at the limit of the page.
    original = sst_pin.robots.five_bar()
    model = pin.Model(original.model)
    model.effortLimit[:] = 10.0
    line = sst_pin.LineForce("platform", "universe", name="cylinder", effort=3.0)
    motors = [{"geared": {"shoulder_1": 2.0}}, "cylinder"]
    chain = sst_pin.ClosedChain(model, original.closures, motors, lines=[line])
    scene = Scene(chain, None)
    va = np.zeros(len(chain.coordinates))
    limits = live_data(chain, scene, scene.start, va)["motors"]["limits"]
    assert limits == pytest.approx([5.0, 3.0])
    for tau, joint_or_line in (((5.1, 0.0), "shoulder_1"), ((0.0, 3.1), "cylinder")):
        samples = np.ones((2, 1))
        motion = chain.trajectory(
            [0.0, 1.0], samples * scene.start, samples * va, samples * va, samples * tau
        )
        (finding,) = chain.check_limits(motion)
        assert finding.joints == (joint_or_line,)
