# SPDX-License-Identifier: BSD-2-Clause
"""Motions given by a frame, and orientations along smooth paths through a few."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import sst_pin
from tests.support.planar_bars import planar

T = np.linspace(0, 1, 41)
CIRCLE = np.column_stack([np.cos(2 * np.pi * T), np.sin(2 * np.pi * T)])


def test_the_delta_follows_a_circle_as_its_closed_form_says_and_no_farther():
    delta = sst_pin.robots.delta()
    points = np.column_stack([0.05 * CIRCLE, np.full(41, -0.25)])
    poses = np.tile(np.eye(4), (41, 1, 1))
    poses[:, :3, 3] = points
    wanted = delta.inverse_kinematics(poses)
    for samples in (points, poses):
        result = sst_pin.frame_motion(delta, T, "platform", samples)
        assert np.abs(result.q - wanted).max() < 1e-9  # the last step of Newton's method
    points[17:, 2] = -2.0
    with pytest.raises(sst_pin.WorkspaceError, match="platform does not reach") as error:
        sst_pin.frame_motion(delta, T, "platform", points)
    assert error.value.samples == ((17,),)


def test_a_stewart_platform_follows_poses():
    platform = sst_pin.robots.stewart()
    home = platform.platform_pose(platform.home)
    poses = np.tile(home, (41, 1, 1))
    turns = Rotation.from_rotvec(0.1 * np.column_stack([CIRCLE - CIRCLE[0], T]))
    poses[:, :3, :3] = turns.as_matrix() @ home[:3, :3]
    poses[:, :2, 3] += 0.02 * (CIRCLE - CIRCLE[0])
    motion = sst_pin.frame_motion(platform, T, "platform", poses)
    assert np.abs(platform.platform_pose(motion.q) - poses).max() < 1e-9
    coordinates = list(platform.mechanism.coordinates)
    wanted = platform.inverse_kinematics(poses)[:, platform.motor_indices]
    assert coordinates == list(platform.motor_indices)
    assert np.abs(motion.q[:, platform.motor_indices] - wanted).max() < 1e-9


def test_the_star_follows_orientations(robot):
    R = sst_pin.paper_circle(np.pi / 6 * T).R
    q, va, aa = robot.joint_motion(*sst_pin.paper_circle(np.pi / 6 * T))
    frame = "closedloop1_A"
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, q[0])
    fixed = R[0].T @ data.oMf[model.getFrameId(frame)].rotation
    motion = sst_pin.frame_motion(robot, np.pi / 6 * T, frame, R @ fixed, q[0])
    assert np.abs(motion.q - np.unwrap(q, axis=0)).max() < 1e-9
    # Derivatives of splines through 41 samples.
    assert np.abs(motion.va - va)[5:-5].max() < 1e-4 * np.abs(va).max()
    assert np.abs(motion.aa - aa)[5:-5].max() < 1e-2 * np.abs(aa).max()


@pytest.mark.parametrize("elbow", [0.8, -0.8])
def test_the_elbow_stays_on_its_side(elbow):
    """Three links in a plane, one more freedom than the task; far targets at the first sample."""
    links = [("a", "universe", 0.0, 1.0), ("b", "a", 1.0, 1.0), ("c", "b", 1.0, 1.0)]
    arm = sst_pin.ClosedChain(planar(links), [], ["a", "b", "c"])
    points = np.column_stack([1.5 + 0.5 * CIRCLE, np.zeros(41)])
    motion = sst_pin.frame_motion(arm, T, "c_end", points, [0.1, elbow, elbow])
    assert (np.sign(motion.q[:, 1:]) == np.sign(elbow)).all()
    x = np.cumsum(motion.q, axis=1)
    assert np.abs(np.cos(x).sum(axis=1) - points[:, 0]).max() < 1e-9
    assert np.abs(np.sin(x).sum(axis=1) - points[:, 1]).max() < 1e-9


def test_a_path_of_orientations_goes_through_its_samples():
    """At the angles between them, on the group, in any axes, without a jump of acceleration."""
    samples = Rotation.random(5, rng=np.random.default_rng(3))
    R = samples.as_matrix()
    steps = (samples[:-1].inv() * samples[1:]).magnitude()
    s = np.append(0, np.cumsum(steps)) / steps.sum()
    path = sst_pin.sst.orientation_path(R, 100_001)
    near = np.round(s * 100_000).astype(int)
    assert np.abs(path[near] - R).max() < 1e-4  # samples lie within half a step
    assert np.abs(path[[0, -1]] - R[[0, -1]]).max() < 1e-12
    assert np.abs(path @ np.swapaxes(path, 1, 2) - np.eye(3)).max() < 1e-14
    A = Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    turned = sst_pin.sst.orientation_path(A @ R, 50)
    assert np.abs(turned - A @ sst_pin.sst.orientation_path(R, 50)).max() < 1e-12
    turns = Rotation.from_matrix(path)
    omega = (turns[:-1].inv() * turns[1:]).as_rotvec() * 100_000
    alpha = np.diff(omega, axis=0) * 100_000
    assert np.abs(np.diff(alpha, axis=0)).max() < 0.01 * np.abs(alpha).max()


@pytest.mark.parametrize(
    ("R", "word"),
    [
        (np.eye(3), "shape"),
        (np.tile(np.eye(3), (2, 1, 1)), "0 degrees between samples 0 and 1"),
        (np.array([np.eye(3), np.diag([1.0, -1, -1])]), "180 degrees"),
        (np.array([np.eye(3), 2 * np.eye(3)]), "rotation"),
    ],
)
def test_orientations_without_one_path_between_are_refused(R, word):
    with pytest.raises(sst_pin.InputError, match=word):
        sst_pin.sst.orientation_path(R)
