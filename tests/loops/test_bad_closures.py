# SPDX-License-Identifier: BSD-2-Clause
"""What is no closure is refused, with what to write instead."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin


@pytest.mark.parametrize(
    ("contact", "kind"), [(pin.ContactType.CONTACT_3D, "3d"), (pin.ContactType.CONTACT_6D, "6d")]
)
def test_a_constraint_of_pinocchio_says_what_to_write(contact, kind):
    """The five-bar that follows the advice is closed as the one of the gallery."""
    robot = sst_pin.robots.five_bar()
    (closure,), model = robot.closures, pin.Model(robot.model)
    a, b = (model.frames[model.getFrameId(name)] for name in (closure.frame_a, closure.frame_b))
    ends = a.parentJoint, a.placement, b.parentJoint, b.placement
    c = pin.RigidConstraintModel(contact, model, *ends, pin.ReferenceFrame.LOCAL)
    with pytest.raises(sst_pin.InputError, match=f'and Closure."a", "b", "{kind}".') as caught:
        sst_pin.ClosedChain(model, [c], robot.motor_names)
    assert 'model.addFrame(pin.Frame("a", c.joint1_id, c.joint1_placement, ' in str(caught.value)
    model.addFrame(pin.Frame("a", c.joint1_id, c.joint1_placement, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("b", c.joint2_id, c.joint2_placement, pin.FrameType.OP_FRAME))
    chain = sst_pin.ClosedChain(model, [sst_pin.Closure("a", "b", "3d")], robot.motor_names)
    q = robot.home + 0.1
    np.testing.assert_array_equal(chain.residual(q), robot.residual(q))
