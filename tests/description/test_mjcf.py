# SPDX-License-Identifier: BSD-2-Clause
"""The closed robot of sst.xml in MuJoCo: what it is, and that it moves as ours does."""

from copy import copy
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sst_pin
from sst_pin.description.sst_mjcf import mjcf_of
from sst_pin.sst.robot_wrapper import configurations_of
from tests.support.sampling import random_parameters, random_state

#: The shipped meshes serve any robot here: they are for the eye.
SHIPPED = Path(sst_pin.sst.PACKAGE_PATH)
MESHES = {f"meshes/{path.name}": path.read_bytes() for path in SHIPPED.rglob("*.obj")}


@pytest.fixture(scope="module")
def closed():
    return mujoco.MjModel.from_xml_path(sst_pin.sst.MJCF_PATH)


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
    model = mujoco.MjModel.from_xml_path(f"{sst_pin.sst.PACKAGE_PATH}/{name}")
    data = mujoco.MjData(model)
    for key in range(model.nkey):
        mujoco.mj_resetDataKeyframe(model, data, key)
        mujoco.mj_step(model, data, 20)
        assert data.ncon == 0
    assert not data.warning.number.any()
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("seed", range(2))
def test_motors_and_welds_give_our_direct_dynamics(seed):
    """Accelerations of the welded robot under motor torques are those of the closed chain.

    A weld of impedance d = 0.9999 leaves 1 - d of the way that an open loop would go, which the
    condition number, 30 at most here, may enlarge.
    """
    rng = np.random.default_rng(seed)
    p = random_parameters(rng, friction=False)
    robot = sst_pin.SST(p)
    model = mujoco.MjModel.from_xml_string(mjcf_of(p, configurations_of(p)), MESHES)
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


def test_parts_of_the_robot_meet_the_world_but_not_one_another(closed):
    scene = mujoco.MjModel.from_xml_path(f"{sst_pin.sst.PACKAGE_PATH}/scene.xml")
    visual = closed.geom_group == 2
    collides = (closed.geom_contype[:, None] & closed.geom_conaffinity) != 0
    assert not collides.any()
    assert not closed.geom_conaffinity[visual].any()
    assert (scene.geom("floor").contype & scene.geom_conaffinity[scene.geom_group == 3]).all()


def test_fall_under_gravity_is_that_of_simulate(closed, robot):
    """Motors free, from home through 87 degrees, up to what the welds give way.

    In eight steps a time constant of the welds: at two steps, as in the file, the integrator's own
    error is larger. At 0.43 s the robot falls through a singularity, where nobody's motion means
    anything.
    """
    model = copy(closed)
    model.opt.timestep = 1e-3 / 8
    data = mujoco.MjData(model)
    data.qpos[:] = robot.home
    mujoco.mj_step(model, data, 3200)
    mujoco.mj_forward(model, data)
    ours = robot.simulate(np.zeros(3), robot.home, np.zeros(3), [0, 0.4])
    first, last = map(Rotation.from_matrix, robot.platform_orientation(ours.q))
    assert (first.inv() * last).magnitude() > 1.5
    there = Rotation.from_matrix(data.site("E").xmat.reshape(3, 3))
    assert (last.inv() * there).magnitude() < 1e-7
