# SPDX-License-Identifier: BSD-2-Clause
"""A tree with locked joints moves as the whole one, and keeps the frames of the caller."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.model.enlarged_tree import RestingJoint, enlarged
from sst_pin.model.geometry import displaced
from sst_pin.model.locked_joints import without_locked
from tests.support import any_chain

TYPES = (pin.FrameType.JOINT, pin.FrameType.OP_FRAME, pin.FrameType.BODY, pin.FrameType.SENSOR)
PLACE = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.2, 0.3]))


@pytest.mark.parametrize("framed", [False, True])
@pytest.mark.parametrize("locked", [[1], [2], [4], [2, 4], [1, 3]])
def test_locked_joints_stay_where_they_are_in_a_tree_of_any_order(locked, framed):
    """So do frames of any type on their bodies, also one named as a joint without a frame."""
    tree = any_chain.tree("RY", ["revolute", "PX"], ["RY"])
    tree.referenceConfigurations["home"] = np.arange(4.0)
    names, free = list(tree.names), [k for k in range(4) if k + 1 not in locked]
    for joint in range(1, 5):
        for kind in TYPES:
            tree.addFrame(pin.Frame(f"{kind} of {joint}", joint, PLACE, kind))
        if framed:
            tree.addJointFrame(joint)
        else:
            tree.addFrame(pin.Frame(names[joint], joint, PLACE, pin.FrameType.OP_FRAME))
    q, v = np.random.default_rng(1).normal(size=(2, 4))
    v[[k - 1 for k in locked]] = 0.0
    fixed = without_locked(tree, {names[k]: q[k - 1] for k in locked}).model
    assert list(fixed.names)[1:] == [names[k + 1] for k in free]
    assert fixed.nframes == tree.nframes
    forces = pin.rnea(tree, tree.createData(), q, v, v)[free]
    data, whole = fixed.createData(), tree.createData()
    # Rounding of sums in another order.
    np.testing.assert_allclose(pin.rnea(fixed, data, q[free], v[free], v[free]), forces, atol=1e-12)
    pin.framesForwardKinematics(fixed, data, q[free])
    pin.framesForwardKinematics(tree, whole, q)
    for frame, there in zip(tree.frames, whole.oMf, strict=True):
        assert data.oMf[fixed.getFrameId(frame.name)].isApprox(there, 1e-12)
    assert fixed.referenceConfigurations["home"].tolist() == free


def test_frames_keep_the_frames_that_bear_them():
    old = pin.Model(sst_pin.ClosedChain.from_urdf(sst_pin.URDF_PATH).model)
    new = sst_pin.ClosedChain(old, [], [], locked=["mu_1"]).model

    def carriers(model):
        bodies = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
        return {frame.name: model.frames[frame.parentFrame].name for frame in bodies}

    assert carriers(new) == carriers(old)


def test_a_frame_on_a_joint_frame_that_is_left_out_gets_the_frame_before_it():
    """The joint is fixed, and its frame is left out because a fixed frame has its name."""
    tree = any_chain.tree("RY", ["revolute"], [])
    first = tree.addJointFrame(1)
    last = tree.addJointFrame(2, first)
    name = tree.names[2]
    tree.addFrame(pin.Frame(name, 1, first, PLACE, pin.FrameType.FIXED_JOINT))
    tree.addFrame(pin.Frame("tip", 2, last, PLACE, pin.FrameType.BODY))
    fixed = without_locked(tree, {name: 0.0}).model
    tip = fixed.frames[fixed.getFrameId("tip")]
    assert fixed.frames[tip.parentFrame].name == tree.names[1]
    assert tip.parentJoint == 1


@pytest.mark.parametrize("locked", [0.0, 0.4, 3.0])
def test_a_ball_with_a_locked_turn_keeps_its_pose_by_more_than_a_quarter_turn(locked):
    """SciPy's angles have the second turn within a quarter turn, and then a third of half a one."""
    tree = any_chain.tree("spherical", [], [])
    name = tree.names[1]
    turns = pin.rpy.rpyToMatrix(0, 0.2, 0) @ pin.rpy.rpyToMatrix(0, 0, 2.0)
    R = turns @ pin.rpy.rpyToMatrix(locked, 0, 0)
    tree.referenceConfigurations["turned"] = pin.Quaternion(R).coeffs()
    fixed = without_locked(tree, {f"{name}_wx": locked}).model
    np.testing.assert_allclose(fixed.referenceConfigurations["turned"], [0.2, 2.0], atol=1e-12)


def test_a_fixed_joint_with_the_name_of_a_link_elsewhere_is_not_displaced_with_it():
    """The name means the link. The frame of the fixed joint comes first, on another body."""
    tree = any_chain.tree("RY", ["revolute"], [])
    tree.addFrame(pin.Frame("tip", 1, pin.SE3.Identity(), pin.FrameType.FIXED_JOINT))
    tree.addFrame(pin.Frame("tip", 2, PLACE, pin.FrameType.BODY))
    large = enlarged(tree, [RestingJoint("tip.x", "tip", np.eye(6)[0])])
    moved = displaced(tree, {"tip": 0.1 * np.eye(6)[0]})
    assert large.parents[large.getJointId("tip.x")] == 2
    for model in (large, moved):
        fixed_joint, link = [frame for frame in model.frames if frame.name == "tip"]
        assert fixed_joint.parentJoint == 1
        assert fixed_joint.placement == pin.SE3.Identity()
    expected = PLACE.translation + np.array([0.1, 0, 0])
    assert link.placement == pin.SE3(PLACE.rotation, expected)
