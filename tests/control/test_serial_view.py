# SPDX-License-Identifier: BSD-2-Clause
"""Parallel joints seen as serial ones: maps, torques, inertia, gains."""

import re

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import robots
from sst_pin.errors import ActuationError, ClosureError, InputError, UnknownNameError
from sst_pin.model.joint_series import Series
from sst_pin.model.rebuilt_tree import rebuilt
from tests.support.planar_bars import planar

LEG = ("hip", "knee", "ankle_pitch", "ankle_roll")


def leg_with_rotors():
    """A leg whose motors have rotors and whose joints have friction."""
    chain = robots.leg()
    model = pin.Model(chain.model)
    armature = np.zeros(model.nv)
    armature[chain.motor_indices] = 0.03, 0.05, 0.02, 0.02
    model.armature = armature
    D = np.linspace(0.01, 0.1, model.nv)
    return sst_pin.ClosedChain(model, chain.closures, chain.motor_names, viscous_friction=D)


@pytest.fixture(scope="module")
def leg():
    return sst_pin.SerialView(leg_with_rotors(), LEG)


def four_bar_on_a_cylinder():
    """The gallery's four-bar, moved by a cylinder of no mass between ground and rocker."""
    bar = robots.four_bar()
    model = pin.Model(bar.model)
    place = pin.SE3(np.eye(3), np.array([0.45, 0.0, 0.0]))
    model.addFrame(pin.Frame("foot", 0, place, pin.FrameType.OP_FRAME))
    cylinder = sst_pin.LineForce("foot", "rocker_pin", name="cylinder")
    how = {"coordinates": ["crank"], "lines": [cylinder]}
    return sst_pin.ClosedChain(model, bar.closures, ["cylinder"], **how)


@pytest.fixture(scope="module", params=["linkages", "a motor on a line"])
def view(request, leg):
    """The leg has three linkages, one of them moves two joints."""
    if request.param == "linkages":
        return leg
    return sst_pin.SerialView(four_bar_on_a_cylinder(), ["crank"])


@pytest.fixture(scope="module")
def positions(view):
    """Positions of the joints about the start."""
    middle = view.joint_positions(view.chain.home)
    return middle + np.random.default_rng(0).uniform(-0.2, 0.2, (8, len(view.joints)))


def test_joints_to_motors_and_back_is_the_identity(view, positions):
    """Newton's method ends at 1e-12 of the robot's length; angles are of order one."""
    q = view.from_joints(positions)
    assert np.abs([view.chain.residual(sample) for sample in q]).max() < 1e-12
    assert_allclose(view.joint_positions(q), positions, rtol=0, atol=1e-14)
    back = view.from_motors(view.motor_positions(q))
    assert_allclose(view.joint_positions(back), positions, rtol=0, atol=1e-12)


def test_the_actuator_jacobian_is_the_slope_of_the_motors_positions(view, positions):
    """Central differences of 1e-5: their error is its square."""
    J = view.actuator_jacobian(view.from_joints(positions[:2]))
    for k, step in enumerate(1e-5 * np.eye(len(view.joints))):
        ends = (view.from_joints(positions[:2] + h) for h in (step, -step))
        ahead, behind = map(view.motor_positions, ends)
        assert_allclose(J[..., k], (ahead - behind) / 2e-5, rtol=0, atol=1e-7)


def test_power_at_the_motors_is_power_at_the_joints(view, positions):
    random, q = np.random.default_rng(1), view.from_joints(positions)
    rates = random.standard_normal(positions.shape)
    tau = random.standard_normal((len(q), len(view.motors)))
    at_motors = (view.motor_rates(q, rates) * tau).sum(axis=-1)
    assert_allclose(at_motors, (rates * view.joint_torques(q, tau)).sum(axis=-1), atol=1e-12)
    assert_allclose(view.joint_rates(q, view.motor_rates(q, rates)), rates, atol=1e-12)
    torques = view.joint_torques(q, tau)
    assert_allclose(view.joint_torques(q, view.motor_torques(q, torques)), torques, atol=1e-12)


def test_a_parallelogram_arm_maps_efforts_as_the_corrected_four_bar_transmission():
    """ros2_control's FourBarLinkageTransmission after its repair (pull request 1837).

    With ratios a of the actuators and j of the joints, both joints' j one here:
    x_j2 = x_a2 / a2 - x_a1 / a1, tau_j1 = a1 tau_a1 + a2 tau_a2, tau_j2 = a2 tau_a2. Before, tau_j2
    was a2 tau_a2 - a1 tau_a1, which does not keep the power.
    """
    ratios = 50.0, -30.0
    arms = [("shoulder", "universe", 0.0, 0.4), ("elbow", "shoulder", 0.4, -0.1)]
    cranks = [("crank", "universe", 0.0, -0.1), ("coupler", "crank", -0.1, 0.4)]
    model = planar([*arms, *cranks])
    at = {"shoulder": 0.7, "elbow": 0.9, "crank": 1.6, "coupler": -0.9}
    model.referenceConfigurations["home"] = np.array([at[name] for name in list(model.names)[1:]])
    motors = [{"shoulder": ratios[0]}, {"crank": ratios[1]}]
    arm = sst_pin.ClosedChain(model, [sst_pin.Closure("elbow_end", "coupler_end", "3d")], motors)
    view = sst_pin.SerialView(arm, ["shoulder", "elbow"])
    q = view.from_joints([[0.7, 0.9], [0.3, 1.4], [1.0, 2.0]])
    x = view.motor_positions(q)
    assert_allclose(view.joint_positions(q)[:, 0], x[:, 0] / ratios[0], atol=1e-12)
    elbow = x[:, 1] / ratios[1] - x[:, 0] / ratios[0]
    assert_allclose(view.joint_positions(q)[:, 1], elbow, atol=1e-12)
    tau = np.array([[0.2, 0.0], [0.0, 0.3], [0.5, -0.1]])
    expected = np.stack([tau @ ratios, ratios[1] * tau[:, 1]], axis=-1)
    assert_allclose(view.joint_torques(q, tau), expected, atol=1e-11)


def test_inertia_is_that_of_the_serial_tree_and_of_what_it_lacks(leg):
    """Pinocchio's mass matrix of four hinges with the same bodies, plus the reflected inertia."""
    full = leg.chain.model
    tree = pin.Model()
    parent = 0
    for name in LEG:
        i = full.getJointId(name)
        above = list(full.supports[i])[-2]
        assert full.names[above] == full.names[full.getJointId(tree.names[parent])]
        kind = pin.JointModelRX() if name == "ankle_roll" else pin.JointModelRY()
        parent = tree.addJoint(parent, kind, full.jointPlacements[i], name)
        tree.appendBodyToJoint(parent, full.inertias[i], pin.SE3.Identity())
    x = np.random.default_rng(2).uniform([-0.7, 0.6, -0.5, -0.1], [-0.3, 1.2, -0.1, 0.1], (5, 4))
    q = leg.from_joints(x)
    alone = []
    for angles in x:
        M = pin.crba(tree, tree.createData(), angles)
        alone.append(np.triu(M) + np.triu(M, 1).T)
    alone = np.array(alone)
    added = leg.reflected_inertia(q)
    rotor = np.zeros((4, 4))
    rotor[0, 0] = 0.03  # the hip's motor sits in its joint: the serial tree has its rotor
    assert_allclose(leg.inertia(q), alone + rotor + added, atol=1e-12)
    assert np.linalg.eigvalsh(added).min() > -1e-12


def test_damping_takes_the_power_of_friction(leg):
    random = np.random.default_rng(3)
    q = leg.from_joints(leg.joint_positions(leg.chain.home) + random.uniform(-0.1, 0.1, (5, 4)))
    rates = random.standard_normal((5, 4))
    taken = np.einsum("bi,bij,bj->b", rates, leg.damping(q), rates)
    assert_allclose(taken, -leg.chain.friction_power(q, rates), rtol=1e-12)


def test_a_leg_moves_as_its_serial_view(leg):
    """All loops by motor coordinates, beside M(x) and C(x, x') of the joints alone."""
    chain, random = leg_with_rotors(), np.random.default_rng(6)
    q = leg.from_joints(leg.joint_positions(chain.home) + random.uniform(-0.2, 0.2, 4))
    rates, tau = random.standard_normal((2, 4))
    va = leg.motor_rates(q, rates)
    v_dot = chain.joint_accelerations(q, va, chain.compute_accelerations(q, va, tau))
    terms = leg.chain.reduced_terms(q, rates)
    drive = leg.joint_torques(q, tau) + terms.gravity + terms.friction
    aa = np.linalg.solve(terms.inertia, drive - terms.coriolis @ rates)
    assert_allclose(v_dot[[chain.position_names.index(name) for name in LEG]], aa, rtol=1e-9)


def test_gains_are_the_slope_of_the_torques_of_drives(leg):
    """Drives that hold positions with kp and torques tau: differences of what the joints feel."""
    view, random, n = leg, np.random.default_rng(4), 4
    x = view.joint_positions(view.chain.home) + 0.1
    q, kp, tau = view.from_joints(x), random.uniform(100, 300, n), random.uniform(-20, 20, n)
    there, slope = view.motor_positions(q), []
    for step in 1e-5 * np.eye(len(x)):
        felt = [
            view.joint_torques(near, tau + kp * (there - view.motor_positions(near)))
            for near in (view.from_joints(x + step), view.from_joints(x - step))
        ]
        slope.append((felt[0] - felt[1]) / 2e-5)
    stiffness = view.joint_gains(q, kp, tau)
    assert_allclose(stiffness, -np.array(slope).T, rtol=0, atol=1e-4)  # of some hundreds
    assert_allclose(view.motor_gains(q, stiffness, tau), np.diag(kp), atol=1e-9)
    assert np.abs(view.joint_gains(q, kp) - stiffness).max() > 0.01


def test_the_torque_polygon_is_what_the_motors_can_give(view):
    """Random torques within limits lie inside; beyond a corner nothing is possible."""
    random, m = np.random.default_rng(5), len(view.motors)
    limits = random.uniform(1, 10, m)
    q = view.chain.home
    corners = view.torque_polygon(q, limits)
    inside = view.joint_torques(q, random.uniform(-limits, limits, (200, m)))
    for direction in random.standard_normal((50, len(view.joints))):
        reach = (corners @ direction).max()
        assert (inside @ direction).max() <= reach + 1e-12
        J = view.actuator_jacobian(q)
        assert reach == pytest.approx(np.abs(J @ direction) @ limits)  # its support function


def test_more_motors_than_joints_share_the_torque():
    """4-RRR: the smallest torques; positions of four motors that fit no pose are refused."""
    chain = robots.planar_4rrr()
    view = sst_pin.SerialView(chain, ["elbow_1", "wrist_1", "elbow_2"])
    assert len(view.motors) == 4
    q, f = chain.home, np.array([0.3, -0.2, 0.1])
    tau = view.motor_torques(q, f)
    assert_allclose(view.joint_torques(q, tau), f, atol=1e-12)
    B = chain.preload_directions(q)
    assert np.abs(B.T @ tau).max() < 1e-12
    with pytest.raises(sst_pin.errors.WorkspaceError, match="no positions of the joints"):
        view.from_motors(view.motor_positions(q) + 0.1 * B[:, 0])


@pytest.mark.parametrize(
    ("robot", "joints", "error", "word"),
    [
        ("leg", ["kne"], UnknownNameError, "knee"),
        ("leg", ["knee", "knee"], InputError, "joint appears twice"),
        ("leg", ["ankle_pitch"], InputError, "name all joints of its linkage"),
        ("leg", ["knee", "motor_knee"], sst_pin.SingularConfigurationError, None),
        ("delta", ["ball"], InputError, "ball: this joint neither turns about one axis"),
    ],
)
def test_bad_joints_are_refused_by_name(robot, joints, error, word):
    with pytest.raises(error, match=word):
        sst_pin.SerialView(getattr(robots, robot)(), joints)


def test_joints_without_motors_and_gains_of_motors_on_lines_are_refused():
    leg = robots.leg()
    idle = sst_pin.ClosedChain(leg.model, leg.closures, ["hip"], coordinates=LEG)
    with pytest.raises(ActuationError, match="do not hold the joints knee"):
        sst_pin.SerialView(idle, ["knee"])
    view = sst_pin.SerialView(four_bar_on_a_cylinder(), ["crank"])
    with pytest.raises(InputError, match="tau: not for motors on lines"):
        view.joint_gains(view.chain.home, [1.0], tau=[1.0])


def test_a_joint_that_no_motor_holds_is_named_with_its_cure():
    """Two rods hold pitch and roll of an ankle, not its yaw."""
    ankle = robots.ankle()
    yaw = {"": pin.JointModelRX(), "_yaw": pin.JointModelRZ()}
    model = rebuilt(ankle.model, {ankle.model.getJointId("ankle_roll"): Series.named(yaw)}).model
    chain = sst_pin.ClosedChain(model, ankle.closures, ankle.motor_names)
    with pytest.raises(ActuationError, match="leave ankle_roll_yaw free") as caught:
        sst_pin.SerialView(chain, LEG[2:])
    locked = re.findall(r"'(\w+)'", str(caught.value))
    cured = sst_pin.ClosedChain(model, ankle.closures, ankle.motor_names, locked=locked)
    assert sst_pin.SerialView(cured, LEG[2:]).motors == ankle.motor_names


def test_a_crank_goes_all_round_past_the_dead_points_of_its_rocker():
    """In one assembly mode: after a turn the rocker is where it was."""
    view = sst_pin.SerialView(robots.four_bar(), ["rocker"])
    first = view.chain.home
    cranks = view.motor_positions(first) + np.linspace(-np.pi, np.pi, 9)[:, None]
    q = view.from_motors(cranks)
    assert_allclose(view.motor_positions(q), cranks, rtol=0, atol=1e-12)
    assert_allclose(view.joint_positions(q[0]), view.joint_positions(q[-1]), rtol=0, atol=1e-9)
    assert np.ptp(view.joint_positions(q)) > 0.3


def test_positions_out_of_reach_name_the_sample(leg):
    x = np.tile(leg.joint_positions(leg.chain.home), (2, 1))
    x[1, 3] = 2.0
    with pytest.raises(ClosureError) as caught:
        leg.from_joints(x)
    assert caught.value.samples == ((1,),)
