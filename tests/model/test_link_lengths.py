# SPDX-License-Identifier: BSD-2-Clause
"""A link has a length if all places that are not at its joint are at one point."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import robots
from sst_pin.model.geometry import displacements, parameter_names


@pytest.mark.parametrize("offset", [0.0, 1e-17, -1e-16])
def test_a_place_at_the_joint_up_to_rounding_leaves_the_link_its_length(offset):
    """The crank keeps its length, which displaces its end only."""
    bars = robots.four_bar()
    model = bars.model.copy()
    crank = model.getJointId("crank")
    eye = pin.SE3(np.eye(3), np.array([0.0, offset, 0.0]))
    model.addFrame(pin.Frame("eye", crank, eye, pin.FrameType.OP_FRAME))
    line = sst_pin.LineForce("universe", "eye", name="cable")
    chain = sst_pin.ClosedChain(model, bars.closures, bars.motor_names, lines=[line])
    assert "crank.length" in parameter_names(chain.mechanism)
    moved = displacements(chain.mechanism, {"crank.length": 1e-3})
    assert "coupler" in moved
    assert "eye" not in moved


def test_a_link_whose_only_place_is_at_its_joint_up_to_rounding_has_no_length():
    """The direction of such a length would be rounding."""
    bars = robots.four_bar()
    model = bars.model.copy()
    wheel = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "wheel")
    model.appendBodyToJoint(wheel, pin.Inertia.Random(), pin.SE3.Identity())
    model.referenceConfigurations["home"] = np.append(bars.home, 0.0)
    eye = pin.SE3(np.eye(3), np.array([1e-17, 0.0, 0.0]))
    model.addFrame(pin.Frame("eye", wheel, eye, pin.FrameType.OP_FRAME))
    line = sst_pin.LineForce("universe", "eye", name="cable")
    motors = [*bars.motor_names, "wheel"]
    chain = sst_pin.ClosedChain(model, bars.closures, motors, lines=[line])
    assert "wheel.length" not in parameter_names(chain.mechanism)
