# SPDX-License-Identifier: BSD-2-Clause
"""The closed robot of sst.xml in MuJoCo: what it is, and that it moves as ours does.

The welds give way: a weld of time constant c and impedance d is critically damped and keeps a
reaction f at the price of a gap r: r = -R f / (K d), K = 1 / (c d)^2, R proportional to
(1 - d) / d. So the gap goes with (1 - d) c^2, and what it does to the motion is proportional to it.
"""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import sst_pin
from sst_pin.description.frames import JOINT_NAMES
from sst_pin.description.sst_mjcf import mjcf_of
from sst_pin.sst.robot_wrapper import configurations_of
from tests.support.sampling import random_parameters, random_state

#: The shipped meshes serve any robot here: they are for the eye.
SHIPPED = Path(sst_pin.PACKAGE_PATH)
MESHES = {f"meshes/{path.name}": path.read_bytes() for path in SHIPPED.rglob("*.obj")}


def random_robot(seed):
    p = random_parameters(np.random.default_rng(seed), friction=False)
    xml = mjcf_of(p, configurations_of(p))
    return sst_pin.SST(p), mujoco.MjModel.from_xml_string(xml, MESHES)


@pytest.fixture(scope="module")
def closed():
    return mujoco.MjModel.from_xml_path(sst_pin.MJCF_PATH)


@pytest.fixture(scope="module")
def scene():
    return mujoco.MjModel.from_xml_path(f"{sst_pin.PACKAGE_PATH}/scene.xml")


def at(model, robot, state, tau=(0, 0, 0)):
    """MuJoCo's data in a state of motion of the closed robot, under motor torques."""
    data = mujoco.MjData(model)
    R, omega, _ = state
    q, va, _ = robot.joint_motion(R, omega, np.zeros(3))
    data.qpos[:], data.qvel[:], data.ctrl[:] = q, robot.joint_rates(q, va), tau
    mujoco.mj_forward(model, data)
    return data, q, va


@pytest.mark.parametrize("name", ["sst.xml", "scene.xml"])
def test_mujoco_compiles_and_steps_without_a_word(name, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_path(f"{sst_pin.PACKAGE_PATH}/{name}")
    data = mujoco.MjData(model)
    for key in range(model.nkey):
        mujoco.mj_resetDataKeyframe(model, data, key)
        mujoco.mj_step(model, data, 20)
        assert data.ncon == 0
    assert not data.warning.number.any()
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


def test_mjcf_has_nine_hinges_three_motors_and_the_right_mass(closed):
    assert (closed.nq, closed.nv, closed.nu, closed.neq) == (9, 9, 3, 2)
    assert closed.body_mass.sum() == pytest.approx(3.68, abs=1e-14)
    assert [closed.joint(i).name for i in range(9)] == list(JOINT_NAMES)


@pytest.mark.parametrize("name", ["home", "circle_start"])
def test_loops_are_closed_at_the_keyframes(closed, robot, name):
    """To the rounding of 14 decimals in nine angles, and the pose is the one of its name."""
    data = mujoco.MjData(closed)
    mujoco.mj_resetDataKeyframe(closed, data, closed.key(name).id)
    mujoco.mj_forward(closed, data)
    # Six rows each; what O does has no Jacobian and MuJoCo may leave it out.
    assert data.ne >= 6
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-14
    start = robot.inverse_kinematics(sst_pin.paper_circle(0.0).R)
    assert data.qpos == pytest.approx(robot.home if name == "home" else start, abs=1e-14)


@pytest.mark.parametrize("seed", range(3))
def test_tree_dynamics_of_mujoco_and_pinocchio_agree(seed):
    robot, model = random_robot(seed)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    for _ in range(10):
        data.qpos[:], data.qvel[:], data.qacc[:] = rng.normal(size=(3, 9)) * [[2], [3], [20]]
        mujoco.mj_inverse(model, data)
        state = data.qpos, data.qvel, data.qacc.copy()
        expected = pin.rnea(robot.model, robot.model.createData(), *state)
        assert data.qfrc_inverse == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_motors_and_welds_give_our_direct_dynamics(seed):
    """Accelerations of the welded robot under motor torques are those of the closed chain.

    A weld of impedance d = 0.9999 leaves 1 - d of the way that an open loop would go, which the
    condition number, 30 at most here, may enlarge.
    """
    robot, model = random_robot(seed)
    rng = np.random.default_rng(seed)
    for _ in range(5):
        tau = rng.normal(size=3) * 10
        data, q, va = at(model, robot, random_state(robot, rng), tau)
        aa = robot.compute_accelerations(q, va, tau)
        open_loop = np.abs(data.qacc_smooth).max()
        assert np.abs(data.qacc[::3] - aa).max() < 30e-4 * open_loop


def test_sensors_measure_what_they_are_called(closed, robot):
    R, omega, alpha = random_state(robot, np.random.default_rng(0))
    tau = np.array((1.0, -2.0, 3.0))
    data, q, va = at(closed, robot, (R, omega, alpha), tau)
    read = {closed.sensor(i).name: data.sensor(i).data for i in range(closed.nsensor)}
    for k in range(3):
        assert read[f"gamma_{k + 1}_position"] == pytest.approx(q[3 * k])
        assert read[f"gamma_{k + 1}_velocity"] == pytest.approx(va[k])
        assert read[f"gamma_{k + 1}_torque"] == pytest.approx(tau[k])
    result = Rotation.from_quat(read["star_orientation"][[1, 2, 3, 0]]).as_matrix()
    assert result == pytest.approx(R, abs=1e-14)
    assert read["star_angular_velocity"] == pytest.approx(omega, abs=1e-13)


def test_parts_of_the_robot_meet_the_world_but_not_one_another(closed, scene):
    visual = closed.geom_group == 2
    collides = (closed.geom_contype[:, None] & closed.geom_conaffinity) != 0
    assert not collides.any()
    assert not closed.geom_conaffinity[visual].any()
    assert (scene.geom("floor").contype & scene.geom_conaffinity[scene.geom_group == 3]).all()


#: Softness of the welds as the file has them.
TIME_CONSTANT, IMPEDANCE = 1e-3, 0.9999


def load(time_constant=TIME_CONSTANT, impedance=IMPEDANCE):
    """The shipped file, its welds of another make, eight steps of Runge-Kutta in a time constant.

    At two steps, as in the file, the integrator's own error is not small beside the gap.
    """
    model = mujoco.MjModel.from_xml_path(sst_pin.MJCF_PATH)
    assert (model.eq_solref == [TIME_CONSTANT, 1]).all()
    assert (model.eq_solimp[:, :2] == IMPEDANCE).all()
    model.eq_solref[:, 0] = time_constant
    model.eq_solimp[:, :2] = impedance
    model.opt.timestep = time_constant / 8
    return model


def stepped(model, q, q_dot, torque, duration):
    """Times, orientation of {E} and gaps of the welds at each step; torques at each stage of it."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q, q_dot
    steps = round(duration / model.opt.timestep)
    R, gaps = np.empty((steps + 1, 3, 3)), np.empty((steps + 1, 12))

    def control(_, state):
        state.ctrl[:] = torque(state.time)

    mujoco.set_mjcb_control(control)
    try:
        for i in range(steps + 1):
            mujoco.mj_forward(model, data)
            R[i], gaps[i] = data.site("E").xmat.reshape(3, 3), data.efc_pos
            mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_control(None)
    return np.arange(steps + 1) * model.opt.timestep, R, gaps


def test_fall_under_gravity_is_that_of_simulate(compiled_robot):
    """Motors free, from home through 87 degrees, up to what the welds give way.

    At 0.43 s the robot falls through a singularity, where nobody's motion means anything.
    """

    robot = compiled_robot

    def off(model):
        q_dot, torque = np.zeros(9), lambda _: np.zeros(3)
        t, R, _ = stepped(model, robot.home, q_dot, torque, 0.4)
        ours = robot.simulate(np.zeros(3), robot.home, np.zeros(3), t)
        wanted = Rotation.from_matrix(robot.platform_orientation(ours.q))
        assert (wanted[0].inv() * wanted[-1]).magnitude() > 1.5
        return (wanted.inv() * Rotation.from_matrix(R)).as_rotvec()

    deviation, stiffer = off(load()), off(load(TIME_CONSTANT / 2))[::2]
    size = np.abs(deviation).max()
    assert size < 1e-7
    assert np.abs(4 * stiffer - deviation).max() < 0.1 * size
