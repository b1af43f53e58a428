# SPDX-License-Identifier: BSD-2-Clause
"""What a frame reaches, against closed forms of a five-bar and an arm, and against the dynamics."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.ndimage import label

import sst_pin
from sst_pin.control.reach_search import REASONS
from sst_pin.files import read_table
from tests.support.by_hand import wrenches_of
from tests.support.planar_bars import planar

REACHED, LIMITS, SINGULAR, OUT, CUT_OFF = range(len(REASONS))
SPAN, PROXIMAL, DISTAL = 0.118, 0.09, 0.07


def five_bar(points):
    """Closed form with elbows outwards: where the circles meet, links of both arms as vectors."""
    meets, links = np.ones(points.shape[:-1], bool), []
    for side in (-1, 1):
        away = points - (side * SPAN / 2, 0)
        r = np.linalg.norm(away, axis=-1)
        meets &= (abs(PROXIMAL - DISTAL) < r) & (r < PROXIMAL + DISTAL)
        with np.errstate(invalid="ignore"):
            elbow = np.arccos((PROXIMAL**2 + r**2 - DISTAL**2) / (2 * PROXIMAL * r))
        angle = np.arctan2(away[..., 1], away[..., 0]) - side * elbow
        upper = PROXIMAL * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        links.append((upper, away - upper))
    return meets, links


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


@pytest.fixture(scope="module")
def mapped():
    lift = sst_pin.robots.five_bar(span=SPAN, proximal=PROXIMAL, distal=DISTAL)
    x, y = np.linspace(-0.16, 0.16, 17), np.linspace(-0.16, 0.16, 17)
    result = sst_pin.reach_map(lift, "platform", 2.0, x=x, y=y)
    return lift, result, np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)


def test_a_map_is_printed_in_a_few_lines(mapped):
    _, result, _ = mapped
    title, *lines = str(result).splitlines()
    assert title == "ReachMap of 289 poses"
    words = [line.split() for line in lines]
    assert words[0] == ["x", "-0.16", "to", "0.16", "m,", "17", "values"]
    assert sum(int(line[-1]) for line in words[2:] if line[0] != "the") == 289


def test_a_five_bar_reaches_what_its_circles_and_singular_curves_leave(mapped):
    """The part of two rings, on home's side of det = 0, that hangs together with home."""
    lift, result, points = mapped
    meets, ((_, left), (_, right)) = five_bar(points)
    home = lift.platform_pose(lift.home)[:2, 3]
    at = tuple(np.argwhere((np.abs(points - home) < 0.0101).all(axis=-1))[0])
    turn = cross(left, right)
    regular = turn * np.sign(turn[at]) > 0
    parts, _ = label(meets & regular)
    wanted = parts == parts[at]
    assert not (result.reached & ~wanted).any()
    # What is left out lies next to an end: the last steps towards one are not taken.
    assert (wanted & ~result.reached).sum() <= 0.02 * wanted.sum()
    assert (meets & (result.why == SINGULAR)).sum() > 0.8 * (result.why == SINGULAR).sum()
    assert (~meets & (result.why == OUT)).sum() > 0.8 * (result.why == OUT).sum()
    poses = np.tile(np.eye(4), (result.reached.sum(), 1, 1))
    poses[:, :2, 3] = points[result.reached]
    off = result.q[result.reached] - lift.inverse_kinematics(poses)
    assert np.abs(np.angle(np.exp(1j * off))).max() < 1e-9
    assert np.isnan(result.q[~result.reached]).all()
    cell = 0.02**2
    assert result.area == pytest.approx(result.reached.sum() * cell, rel=1e-9)


def arm(low=-np.inf):
    model = planar([("hinge_0", "universe", 0.0, 1.0), ("hinge_1", "hinge_0", 1.0, 0.6)])
    model.lowerPositionLimit = np.array([-np.inf, low])
    return sst_pin.ClosedChain(model, [], ["hinge_0", "hinge_1"])


@pytest.mark.parametrize("name", ["delta", "stewart"])
def test_torques_hold_the_pose_against_its_wrench(name):
    """Inverse dynamics with the wrench on the body's mass centre; also as parts of limits."""
    chain = getattr(sst_pin.robots, name)()
    side, push = np.array([-0.04, 0.03]), np.array([3.0, -4.0, -20.0, 0.4, 0.2, -0.3])
    limits = np.array([(-1.0 - k, 9.0) for k in range(len(chain.motor_names))])
    held = {"yaw": 0.0} if name == "stewart" else {}
    result = sst_pin.reach_map(chain, "platform", limits, x=side, y=side, wrench=push, **held)
    model, data, rest = chain.model, chain.model.createData(), np.zeros(chain.degrees_of_freedom)
    for place in np.ndindex(2, 2):
        q = result.q[place]
        pin.framesForwardKinematics(model, data, q)
        tip = data.oMf[model.getFrameId("platform")]
        assert np.abs(tip.translation[:2] - side[list(place)]).max() < 1e-9
        load = wrenches_of(chain, q, push[:3], push[3:])
        tau = chain.compute_torques(q, rest, rest, external_wrenches=load)
        assert np.abs(result.torque[place] - tau).max() < 1e-8 * np.abs(tau).max()
        part = np.abs(tau - limits.mean(axis=1)) / (limits[:, 1] - limits[:, 0]) * 2
        assert result.used[place] == pytest.approx(part.max())


@pytest.mark.parametrize("psi", [0.0, 0.5])
def test_the_star_points_where_its_arcs_allow(robot, psi):
    """Yaw, pitch + 90 degrees, roll are theta, phi, psi; psi = 0 leaves an eighth of a sphere."""
    side = np.linspace(-0.15, 1.7, 10)
    result = sst_pin.reach_map(
        robot,
        "E",
        yaw=side,
        pitch=side - np.pi / 2,
        roll=psi,
        rotation=sst_pin.sst.orientation(0.0, np.pi / 2, 0.0),
    )
    phi, theta = np.meshgrid(side, side, indexing="ij")
    R = sst_pin.sst.orientation(theta, phi, psi)
    assert np.abs(result.poses[..., :3, :3] - R).max() < 1e-12
    assert (
        np.abs(robot.platform_orientation(result.q[result.reached]) - R[result.reached]).max()
        < 1e-9
    )
    allowed = [
        not any("arc" in finding.problem for finding in robot.check_limits(q))
        for q in robot.inverse_kinematics(R.reshape(-1, 3, 3))
    ]
    assert np.array_equal(result.reached, np.reshape(allowed, result.why.shape))
    assert (result.why == LIMITS).any()
    if psi == 0:
        assert np.array_equal(result.reached, (R[..., 0] > 0).all(axis=-1))


def test_a_file_has_a_row_for_each_pose(robot, tmp_path):
    angles = np.linspace(-0.1, 0.1, 3)
    result = sst_pin.reach_map(robot, "star_1", roll=angles[:2], yaw=angles)
    result.save(tmp_path / "map.csv")
    table = read_table(tmp_path / "map.csv", timed=False)
    names = ("roll_rad", "yaw_rad", "why", "condition", "used", "tau_gamma_1_Nm")
    assert table.columns[:6] == names
    assert (table.column("yaw_rad").reshape(2, 3) == angles).all()
    assert (table.column("beta_3_rad").reshape(2, 3) == result.q[..., 8]).all()
    assert (table.column("used").reshape(2, 3) == np.abs(result.torque).max(axis=-1)).all()
    with pytest.raises(sst_pin.OutputError, match="exists"):
        result.save(tmp_path / "map.csv")


def test_a_slice_out_of_reach_is_a_map_without_area():
    side = np.linspace(-0.1, 0.1, 3)
    result = sst_pin.reach_map(sst_pin.robots.delta(), "platform", x=side, y=side, z=-3.0)
    assert result.area == 0
    assert set(result.why.ravel()) == {OUT, CUT_OFF}
    assert np.isnan(result.used).all()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"y": None}, "two of them"),
        ({"z": [0.0, 1.0]}, "two of them"),
        ({"y": np.zeros((2, 2))}, "two of them"),
        ({"y": [0.1, 0.1]}, "increasing"),
        ({"y": [0.1]}, "increasing"),
        ({"yaw": 0.0}, "cannot move the frame along it with y, z, roll, pitch, yaw fixed"),
        ({"y": None, "z": [0.0, 0.1]}, "z: at the start the motors cannot move the frame"),
        ({"torques": -1.0}, "torques"),
    ],
)
def test_what_is_no_map_is_refused(changes, word):
    arguments = {"frame": "platform", "x": [0.0, 0.1], "y": [0.1, 0.2]} | changes
    with pytest.raises(sst_pin.SSTError, match=word):
        sst_pin.reach_map(sst_pin.robots.five_bar(), **arguments)


def test_a_start_beyond_its_limits_and_idle_motors_are_refused():
    with pytest.raises(sst_pin.InputError, match="outside the limits of hinge_1"):
        sst_pin.reach_map(arm(1.0), "hinge_1_end", x=[0, 1], y=[0, 1], start=[0.1, 0.5])
    tree = arm().model
    tree.gravity.linear = np.array([0, -9.81, 0])
    loose = sst_pin.ClosedChain(tree, [], ["hinge_0"], coordinates=["hinge_0", "hinge_1"])
    with pytest.raises(sst_pin.ActuationError):
        sst_pin.reach_map(loose, "hinge_1_end", x=[0, 1], y=[0, 1], start=[0.1, 0.5])


def two_turns(first, second):
    """A body behind a universal joint of two hinges."""
    model = pin.Model()
    middle = model.addJoint(0, first, pin.SE3.Identity(), "first")
    last = model.addJoint(middle, second, pin.SE3.Identity(), "second")
    model.appendBodyToJoint(last, pin.Inertia.FromBox(1, 0.1, 0.1, 0.1), pin.SE3.Identity())
    model.addFrame(pin.Frame("tool", last, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.referenceConfigurations["home"] = np.zeros(2)
    return sst_pin.ClosedChain(model, [], ["first", "second"])


def test_the_ankle_reaches_angles_from_the_base_though_it_starts_oblique():
    """Its cross turns about y, then about x: all rolls and pitches in the base are possible."""
    ankle = sst_pin.robots.ankle()
    roll, pitch = np.linspace(-0.1, 0.15, 4), np.linspace(-0.1, 0.2, 5)
    reach = sst_pin.reach_map(ankle, "platform", roll=roll, pitch=pitch, rotation=np.eye(3))
    assert reach.reached.all()
    _, R = ankle.frame_placement(reach.q, "platform")
    for i, j in np.ndindex(reach.reached.shape):
        expected = pin.rpy.rpyToMatrix(roll[i], pitch[j], 0.0)
        assert R[i, j] == pytest.approx(expected, abs=1e-9)
    # By default the angles are zero at the start, where it leans: these rolls are impossible.
    with pytest.raises(sst_pin.InputError, match="orientation at the start: rotation="):
        sst_pin.reach_map(ankle, "platform", roll=roll, pitch=pitch)


def test_a_map_is_a_cross_where_axes_turn_in_the_other_order_and_this_is_told():
    """Rx(a) Ry(b) is Ry(pitch) Rx(roll) only where one of the angles is 0."""
    angles = np.linspace(-0.4, 0.4, 9)
    with pytest.warns(RuntimeWarning, match="take the joints as the grid"):
        cross = sst_pin.reach_map(
            two_turns(pin.JointModelRX(), pin.JointModelRY()), "tool", roll=angles, pitch=angles
        )
    on_cross = (np.abs(angles)[:, None] < 1e-12) | (np.abs(angles) < 1e-12)
    assert np.array_equal(cross.reached, on_cross)
    right = two_turns(pin.JointModelRY(), pin.JointModelRX())  # no warning, which would raise
    assert sst_pin.reach_map(right, "tool", roll=angles, pitch=angles).reached.all()
