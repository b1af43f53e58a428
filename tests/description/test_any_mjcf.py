# SPDX-License-Identifier: BSD-2-Clause
"""Any chain as MJCF: read back it is the same robot, and MuJoCo moves it as we do."""

from dataclasses import replace
from functools import partial

import coal
import mujoco
import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import Coupling, LineForce
from sst_pin.description.mjcf_document import MjcfDocument
from sst_pin.errors import DescriptionWarning
from tests.gallery.cable_printer import cable_printer
from tests.support import any_chain
from tests.support.by_hand import add, at, mark
from tests.support.named_robots import robot_named
from tests.support.planar_bars import planar


def smooth(kind):
    """A body on a ball or in space, without friction and rotors, which MuJoCo has not for it."""
    chain = any_chain.with_joint(kind)
    model = chain.model
    model.armature[:6] = model.damping[:6] = model.friction[:6] = 0
    names = [f"arm_{k}" for k in range(1, 7)]
    actuated = names if kind == "free-flyer" else names[:3]
    return sst_pin.ClosedChain(model, chain.closures, actuated, coordinates=["body"])


def geared():
    """Three joints in a row: one motor by a belt on two of them, and a spring in the third."""
    links = [("a", "universe", 0.0, 1.0), ("b", "a", 1.0, 1.0), ("c", "b", 1.0, 1.0)]
    model = planar(links)
    model.armature = np.array([0.1, 0.2, 0.3])
    model.lowerPositionLimit, model.upperPositionLimit = -np.ones(3), 2 * np.ones(3)
    motors = ["a", {"a": -0.5, "b": 2.0}, "c"]
    springs = {"stiffness": [0, 0, 3.0], "spring_reference": [0, 0, 0.4]}
    return sst_pin.ClosedChain(model, [], motors, **springs)


def mimicking():
    """Four joints in a row; the last one follows the first, with rotors, friction and a motor."""
    links = [("a", "universe", 0.0, 1.0), ("b", "a", 1.0, 1.0), ("c", "b", 1.0, 1.0)]
    model = planar([*links, ("d", "c", 1.0, 1.0)])
    model.armature, model.damping = np.array([[0.1, 0.2, 0.3, 0.4], [1.0, 2.0, 3.0, 4.0]])
    leader, follower = model.getJointId("a"), model.getJointId("d")
    model = pin.transformJointIntoMimic(model, leader, follower, -0.5, 0.2)
    return sst_pin.ClosedChain(model, [], ["a", "b", "c"])


SUM = Coupling("arm_2", {"arm_1": (0.1, -0.5), "body": (0.0, 0.3, 0.2)}, 0.05)
GALLERY = ("five_bar", "rods", "line", "continuous", "translation", "composite", "sst")
ROBOTS = {
    **{name: partial(robot_named, name) for name in GALLERY},
    "ball": partial(smooth, "spherical"),
    "in space": partial(smooth, "free-flyer"),
    "geared": geared,
    "mimicking": mimicking,
    "hinge": partial(any_chain.chain, kind="hinge"),
    "coupled": partial(any_chain.chain, kind="3d", more=[SUM]),
}


def read_back(chain, path):
    """The robot from its file, in the same coordinates, and its q for a q of the first one."""
    sst_pin.write_mjcf(chain, path)
    joints, rates = MjcfDocument(chain.mechanism).joints, chain.mechanism.coordinate_rate_names
    known = {joint.name for joint in joints}
    coordinates = rates if known.issuperset(rates) else chain.coordinates

    def q_there(q):
        """MuJoCo's coordinates, but quaternions have their scalar last."""
        entries = [(joint.kind in ("ball", "free"), joint.qpos(q)) for joint in joints]
        return np.concatenate(
            [np.append(x[:-4], np.roll(x[-4:], -1)) if k else x for k, x in entries]
        )

    return sst_pin.ClosedChain.from_mjcf(path).with_coordinates(coordinates), q_there


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_read_back_is_the_same(name, tmp_path):
    """Forces, and what motors do, to 1e-12 of the largest, at random closed states."""
    chain = ROBOTS[name]()
    again, q_there = read_back(chain, tmp_path / "robot.xml")
    shapes, shapes_there = (x.visual_model.geometryObjects for x in (chain, again))
    assert (again.motor_names, len(shapes_there)) == (chain.motor_names, len(shapes))
    random, start = np.random.default_rng(0), chain.generic_configuration()
    for _ in range(3):
        way = 0.1 * random.normal(size=chain.mechanism.model.nv)
        q = chain.assemble(pin.integrate(chain.mechanism.model, start, way), fixed=())
        va, aa = random.normal(size=(2, chain.degrees_of_freedom))
        forces = chain.generalized_forces(q, va, aa)
        forces_there = again.generalized_forces(q_there(q), va, aa)
        assert np.abs(forces_there - forces).max() < 1e-12 * np.abs(forces).max()
        J = chain.actuator_jacobian(q)
        assert np.abs(again.actuator_jacobian(q_there(q)) - J).max() < 1e-12 * np.abs(J).max()
    if "home" in chain.mechanism.model.referenceConfigurations:
        assert np.abs(again.home - q_there(chain.home)).max() < 1e-14


def test_two_closures_between_the_same_frames_are_read_back(tmp_path):
    bar = robot_named("four_bar")
    (closure,) = bar.closures
    ends = closure.frame_a, closure.frame_b
    closures = [sst_pin.Closure(*ends, "3d"), sst_pin.Closure(*ends, "3d")]
    chain = sst_pin.ClosedChain(bar.model, closures, bar.motor_names)
    again, q_there = read_back(chain, tmp_path / "robot.xml")
    state = np.array([0.3]), np.array([-0.2])
    expected = chain.compute_torques(chain.home, *state)
    np.testing.assert_allclose(again.compute_torques(q_there(chain.home), *state), expected)


def test_limits_efforts_and_points_come_over(tmp_path):
    chain = geared()
    chain.model.upperEffortLimit = np.array([5.0, 0, 7])
    chain = chain.with_model(chain.model)
    sst_pin.write_mjcf(chain, tmp_path / "robot.xml")
    mj = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    assert mj.jnt_range.tolist() == [[-1, 2]] * 3
    assert mj.actuator_ctrlrange.tolist() == [[-5, 5], [0, 0], [-7, 7]]
    assert {mj.site(k).name for k in range(mj.nsite)} == {"a_end", "b_end", "c_end"}
    assert sst_pin.ClosedChain.from_mjcf(tmp_path / "robot.xml").motor_names == chain.motor_names


def test_the_effort_limit_of_a_joint_with_a_geared_motor_comes_over(tmp_path):
    original = sst_pin.robots.five_bar()
    model = pin.Model(original.model)
    model.effortLimit[:] = 10.0
    motors = [{"geared": {"shoulder_1": 2.0}}, "shoulder_2"]
    chain = sst_pin.ClosedChain(model, original.closures, motors)
    back, _ = read_back(chain, tmp_path / "robot.xml")
    shoulders = chain.mechanism.space.rates_of(["shoulder_1", "shoulder_2"])
    assert back.model.effortLimit[shoulders] == pytest.approx([10.0, 10.0])


@pytest.mark.parametrize("name", ["five_bar", "rods", "in space"])
def test_mujoco_simulates_the_file(name, tmp_path):
    """From home at rest under constant torques, for 0.05 s, as far as equalities give way.

    They leave 1e-4 of the accelerations of the open tree, 1e3 rad/s^2 at most here, for their time
    constant of 1e-3 s: 1e-7 rad, which the loops may enlarge by their condition numbers of ten.
    """
    chain = ROBOTS[name]()
    model, none = chain.model, np.zeros(chain.model.nv)
    model.referenceConfigurations["home"] = chain.generic_configuration()
    chain = sst_pin.ClosedChain(model, chain.closures, chain.motor_names, coulomb_friction=none)
    sst_pin.write_mjcf(chain, tmp_path / "robot.xml")
    mj = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    mj.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data, rest = mujoco.MjData(mj), np.zeros(chain.degrees_of_freedom)
    mujoco.mj_resetDataKeyframe(mj, data, mj.key("home").id)
    data.ctrl[:] = tau = np.full(len(chain.motor_names), 0.1)
    mujoco.mj_forward(mj, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-12
    mujoco.mj_step(mj, data, 100)
    ours = chain.simulate(lambda *_: tau, chain.home, rest, [0, 0.05]).q
    there = MjcfDocument(chain.mechanism).qpos(ours[-1])
    assert np.abs(ours[-1] - ours[0]).max() > 0.01
    assert np.abs(data.qpos - there).max() < 1e-6


def heavy_about_one_axis():
    model = planar([("a", "universe", 0.0, 1.0)])
    model.inertias[1] = pin.Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0]))
    return sst_pin.ClosedChain(model, [], ["a"])


UNKNOWN = {
    "body a: one of the principal moments": heavy_about_one_axis,
    "no rolling": partial(any_chain.rolling, False),  # beside the joint that carries the plane
    "no joint Planar": partial(any_chain.with_joint, "planar"),
    "no joint HelicalUnaligned": partial(any_chain.with_joint, "helical"),
    "no closure cylindrical": partial(any_chain.chain, kind="cylindrical"),
    "no damping of single rates of a ball": partial(any_chain.with_joint, "spherical"),
    "more than hinges and slides": partial(any_chain.with_joint, "free-flyer"),
    "no constant force": partial(
        any_chain.chain, lines=[LineForce("point_arm_2", "point_arm_5", preload=3)]
    ),
    "the inertia of a tendon between two branches": partial(
        any_chain.chain, kind="3d", lines=[LineForce("point_body", "point_arm_3", mass=1)]
    ),
    "polynomials of one joint": partial(
        any_chain.chain, more=[Coupling("arm_2", {"arm_1": (0, 1, 1), "body": (0, 1, 1)})]
    ),
}


@pytest.mark.filterwarnings("ignore:.*the closures hold the joints of the motors")
@pytest.mark.parametrize("words", UNKNOWN)
def test_what_mjcf_cannot_say_is_named(words, tmp_path):
    with pytest.raises(sst_pin.DescriptionError, match=words):
        sst_pin.write_mjcf(UNKNOWN[words](), tmp_path / "robot.xml")
    assert not list(tmp_path.iterdir())


def test_a_ball_is_relaxed_at_zero_by_both_quaternions_of_zero(tmp_path):
    model = any_chain.with_joint("spherical").model
    stiffness = np.zeros(model.nv)
    stiffness[:3] = 3.0
    rest = pin.neutral(model)
    rest[3] = -1.0  # x, y, z, w
    model.armature = none = np.zeros(model.nv)
    options = {"viscous_friction": none, "coulomb_friction": none, "stiffness": stiffness}
    chain = sst_pin.ClosedChain(model, [], [], spring_reference=rest, **options)
    sst_pin.write_mjcf(chain, tmp_path / "robot.xml")
    assert sst_pin.ClosedChain.from_mjcf(tmp_path / "robot.xml").mechanism.springs.stiffness.any()


def test_what_is_written_otherwise_is_told(tmp_path):
    """A cross without mass between two hinges, with a frame, and a shape that MuJoCo has not."""
    model, body = pin.Model(), pin.Inertia.FromSphere(1.0, 0.1)
    turned = pin.exp3(np.array([0.3, -0.2, 0.1]))
    cross = add(model, 0, pin.JointModelRX(), "cross", at(0.2, 0.1), pin.Inertia.Zero())
    add(model, cross, pin.JointModelRY(), "arm", at(0.1, 0.3, turned=turned), body)
    mark(model, 1, "pin", at(0.0, 0.1))
    chain = sst_pin.ClosedChain(model, [], ["cross", "arm"])
    chain.visual_model = pin.GeometryModel()
    cone = pin.GeometryObject("cone", 2, at(), coal.Cone(0.1, 0.2))
    chain.visual_model.addGeometryObject(cone)
    with pytest.warns(sst_pin.DescriptionWarning) as caught:
        again, _ = read_back(chain, tmp_path / "robot.xml")
    records = [str(warning.message) for warning in caught]
    assert len(records) == 2
    assert "body cross: MuJoCo needs mass" in records[0]
    assert "shape cone is left out" in records[1]
    state = [0.3, 0.4], [1.0, 2.0], [3.0, 4.0]
    off = again.compute_torques(*state) - chain.compute_torques(*state)
    assert np.abs(off).max() < 1e-10  # 1e-12 kg weigh 1e-11 N


def test_velocity_limits_are_left_out_with_a_warning(tmp_path):
    chain = robot_named("five_bar")
    model = chain.model.copy()
    model.velocityLimit[:] = [5.0, 0.0, 1000.0, np.inf]  # three of them stand for none
    limited = sst_pin.ClosedChain(model, chain.closures, chain.motor_names)
    name = model.names[1]
    with pytest.warns(DescriptionWarning, match=f"velocities of the joints {name} are left out"):
        sst_pin.write_mjcf(limited, tmp_path / "robot.xml")


def _lifted_delta():
    """A delta whose motors are not at zero at home."""
    delta = robot_named("delta")
    model = delta.model.copy()
    lifted = dict(zip(delta.motor_names, (0.1, 0.3, 0.2), strict=True))
    model.referenceConfigurations["home"] = delta.assemble(lifted)
    return sst_pin.ClosedChain(model, delta.closures, delta.motor_names)


def _on_a_line():
    bar = robot_named("four_bar")
    ram = LineForce("universe", "platform", name="ram")
    return sst_pin.ClosedChain(bar.model, bar.closures, ["ram"], lines=[ram])


@pytest.mark.parametrize("make", [_lifted_delta, _on_a_line])
def test_brakes_hold_in_mujoco_what_they_hold_here(make, tmp_path):
    """Equalities of MuJoCo are stiff springs, which sag until they hold 1e-3 of the forces less."""
    chain = make()
    standing = chain.with_brakes(chain.motor_names)
    path = tmp_path / "standing.xml"
    with pytest.warns(DescriptionWarning, match=r"brake of .* holds it at home only"):
        sst_pin.write_mjcf(standing, path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    is_equality = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    held = {
        int(mujoco.mjtEq.mjEQ_JOINT): mujoco.mjtObj.mjOBJ_JOINT,
        int(mujoco.mjtEq.mjEQ_TENDON): mujoco.mjtObj.mjOBJ_TENDON,
    }
    forces = {}
    for k in range(model.neq):
        if kind := held.get(int(model.eq_type[k])):
            (row,) = np.flatnonzero(is_equality & (data.efc_id[: data.nefc] == k))
            name = mujoco.mj_id2name(model, kind, model.eq_obj1id[k])
            forces[name] = data.efc_force[row]
    assert forces == pytest.approx(standing.reactions(chain.home).brakes, rel=1e-3)


def test_a_brake_without_a_home_is_no_equality(tmp_path):
    bar = robot_named("four_bar")
    model = bar.model.copy()
    del model.referenceConfigurations["home"]
    standing = sst_pin.ClosedChain(model, bar.closures, [], brakes=["crank"])
    with pytest.raises(sst_pin.errors.DescriptionError, match="name a configuration home"):
        sst_pin.write_mjcf(standing, tmp_path / "standing.xml")


def test_winches_pull_in_mujoco_as_here(tmp_path):
    """Motors with the factor -1, and one with -2 whose effort is halved."""
    printer = cable_printer()
    lines = [replace(line, effort=60.0) for line in printer.lines]
    motors = [{line.name: -1.0} for line in lines[:3]] + [{lines[3].name: -2.0}]
    chain = sst_pin.ClosedChain(printer.model, [], motors, lines=lines)
    path = tmp_path / "winches.xml"
    with pytest.warns(DescriptionWarning, match="its factor is a gear"):
        sst_pin.write_mjcf(chain, path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = q = [0.1, -0.2, 0.3]
    data.ctrl[:] = tau = [10.0, 20.0, 15.0, 12.0]
    mujoco.mj_forward(model, data)
    assert data.qacc == pytest.approx(chain.compute_accelerations(q, [0, 0, 0], tau), rel=1e-9)
    assert model.actuator_ctrlrange[:, 1].tolist() == [60, 60, 60, 30]
    back = sst_pin.ClosedChain.from_mjcf(path)
    assert back.motor_names == tuple(line.name for line in lines)
    forces = [-10.0, -20.0, -15.0, -24.0]
    assert back.compute_accelerations(q, [0, 0, 0], forces) == pytest.approx(data.qacc, rel=1e-9)
    assert [line.effort for line in back.lines] == pytest.approx([60] * 4)
