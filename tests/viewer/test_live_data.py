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
