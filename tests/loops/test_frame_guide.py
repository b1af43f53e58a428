# SPDX-License-Identifier: BSD-2-Clause
"""Where a frame is, and the configurations that put it there."""

import numpy as np
import pytest

import sst_pin
from tests.support.planar_bars import planar

#: The last step of Newton's method is shorter, [rad] or [m].
LAST = 1e-9


def _poses(robot, size):
    """Poses of the platform near home, and the configurations of a closed form."""
    random, home = np.random.default_rng(0), robot.frame_placement(robot.home, "platform")
    poses = np.tile(np.eye(4), (2, 3, 1, 1))
    moving = np.abs(robot.frame_jacobian(robot.home, "platform")[:3]).max(axis=1) > 1e-9
    poses[..., :3, 3] = home[0] + size * random.uniform(-1, 1, (2, 3, 3)) * moving
    poses[..., :3, :3] = home[1]
    return poses, robot.inverse_kinematics(poses)


@pytest.mark.parametrize(
    ("name", "size", "turned"),
    [("five_bar", 0.015, False), ("delta", 0.05, False), ("stewart", 0.02, True)],
)
def test_the_configuration_of_a_frame_is_that_of_the_closed_form(name, size, turned):
    """For a position, or for a position and a rotation."""
    robot = getattr(sst_pin.robots, name)()
    poses, expected = _poses(robot, size)
    rotations = poses[..., :3, :3] if turned else None
    q = robot.frame_configuration("platform", poses[..., :3, 3], rotations)
    motors = robot.motor_indices
    assert np.abs(q[..., motors] - expected[..., motors]).max() < LAST
    p, R = robot.frame_placement(q, "platform")
    assert np.abs(p - poses[..., :3, 3]).max() < LAST
    assert np.abs(R - robot.platform_pose(q)[..., :3, :3]).max() < 1e-14


def test_the_star_takes_an_orientation_alone(robot):
    R = sst_pin.paper_circle(0.2).R
    q = robot.inverse_kinematics(R)
    _, turned = robot.frame_placement(q, "closedloop1_A")
    assert np.abs(robot.frame_configuration("closedloop1_A", None, turned) - q).max() < LAST


def test_no_configuration_of_another_assembly_mode_is_returned():
    """The coupler's point of a four-bar traces another curve in its other mode."""
    bars = sst_pin.robots.four_bar()
    other = bars.assemble(bars.home + np.array([0, 0, -2]))
    assert abs(other[1] - bars.home[1]) > 1
    p, _ = bars.frame_placement(other, "platform")
    with pytest.raises(sst_pin.SSTError, match=r"misses it by 0\.\d+ m"):
        bars.frame_configuration("platform", p)
    assert np.abs(bars.frame_configuration("platform", p, start=other) - other).max() < LAST


def test_a_position_out_of_reach_is_named_in_metres():
    """In any unit of length: two links of 1 m, so that 1.5 m of the way to 3.5 m are missing."""
    arm = sst_pin.ClosedChain(planar([("a", "universe", 0, 1), ("b", "a", 1, 1)]), [], ["a", "b"])
    start = [0.6, -1.2]
    with pytest.raises(sst_pin.WorkspaceError, match=r"1 of 2 .*by 1\.5 m; it is out") as error:
        arm.frame_configuration("b_end", [[1.8, 0, 0], [3.5, 0, 0]], start=start)
    assert error.value.samples == ((1,),)
    with pytest.raises(sst_pin.WorkspaceError, match="too few freedoms"):
        arm.frame_configuration("b_end", [1.6, 0, 0.1], start=start)
    with pytest.raises(sst_pin.SingularConfigurationError, match="start elsewhere"):
        arm.frame_configuration("b_end", [1.5, 0, 0], start=[0, 0])


def test_arguments_are_checked():
    robot = sst_pin.robots.five_bar()
    with pytest.raises(sst_pin.ClosureError, match="the loops are open"):
        robot.frame_placement(robot.home + 0.1, "platform")
    with pytest.raises(sst_pin.InputError, match="position, a rotation"):
        robot.frame_configuration("platform", None)
    with pytest.raises(sst_pin.InputError, match="rotation"):
        robot.frame_configuration("platform", [0, 0.14, 0], np.ones((3, 3)))


def test_a_frame_with_few_freedoms_takes_the_poses_that_it_has():
    """Those on the straight way to them it has not."""
    robot = sst_pin.robots.leg()
    mechanism = robot.mechanism
    step = 0.3 * np.random.default_rng(1).normal(size=robot.degrees_of_freedom)
    q = robot.engine.reference.moved(robot.home, step * mechanism.rate_scale[mechanism.coordinates])
    pose = robot.frame_placement(q, "platform")
    assert np.abs(robot.frame_configuration("platform", *pose) - q).max() < LAST
