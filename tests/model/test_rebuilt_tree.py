# SPDX-License-Identifier: BSD-2-Clause
"""A tree with locked joints keeps the frames of the caller, whatever their type and name."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin

TYPES = (pin.FrameType.JOINT, pin.FrameType.OP_FRAME, pin.FrameType.BODY, pin.FrameType.SENSOR)
PLACE = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.2, 0.3]))
Q = np.array([0.3, 0.0, 0.6])


def bars(framed):
    """The tree of a four-bar, with a frame at each joint as in a URDF, or without."""
    model = pin.Model(sst_pin.robots.four_bar().model)
    for j in range(1, model.njoints) if framed else ():
        model.addJointFrame(j)
    return model


@pytest.mark.parametrize(("framed", "name"), [(True, "mine"), (False, "mine"), (False, "crank")])
@pytest.mark.parametrize("kind", TYPES)
def test_frames_stay_where_they_are(framed, name, kind):
    """On a body whose joint is locked; also one with the name of a joint that has no frame."""
    old = bars(framed)
    old.addFrame(pin.Frame(name, old.getJointId("coupler"), PLACE, kind))
    chain = sst_pin.ClosedChain(old, [], [], locked=["coupler"])
    before = old.createData()
    pin.framesForwardKinematics(old, before, Q)
    position, R = chain.frame_placement(Q[[0, 2]], name)
    there = before.oMf[old.getFrameId(name, kind)]
    np.testing.assert_allclose(position, there.translation, atol=1e-14)
    np.testing.assert_allclose(R, there.rotation, atol=1e-14)
    assert chain.model.nframes == old.nframes


def test_frames_keep_the_frames_that_bear_them():
    old = pin.Model(sst_pin.ClosedChain.from_urdf(sst_pin.URDF_PATH).model)
    new = sst_pin.ClosedChain(old, [], [], locked=["mu_1"]).model
    bearers = [
        {
            f.name: model.frames[f.parentFrame].name
            for f in model.frames
            if f.type == pin.FrameType.BODY
        }
        for model in (old, new)
    ]
    assert bearers[0] == bearers[1]
