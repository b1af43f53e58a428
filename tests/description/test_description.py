# SPDX-License-Identifier: BSD-2-Clause
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yaml

import sst_pin
from sst_pin.description.frames import base_orientations
from tests.support.files import load


@pytest.mark.parametrize("script", ["make_description", "make_sample_motion"])
def test_what_is_shipped_is_current(script, monkeypatch):
    monkeypatch.setattr(sys, "argv", [script, "--check"])
    assert load(f"scripts/description/{script}.py").main() == 0


def test_no_moving_link_is_massless_and_frames_weigh_an_explicit_nothing():
    """The two rules that keep MuJoCo and PyBullet from refusing or inventing mass."""
    tree = ET.parse(sst_pin.URDF_PATH)
    child = {j.find("child").get("link"): j.get("type") for j in tree.iter("joint")}
    for link in (link for link in tree.iter("link") if link.get("name") in child):
        mass = float(link.find("inertial/mass").get("value"))
        assert mass > 0 if child[link.get("name")] == "revolute" else mass == 0


@pytest.mark.parametrize("tilt", [0.0, 1e-15, 3e-8, 1e-4])
def test_rpy_is_exact_next_to_gimbal_lock(tilt):
    """{03} of the paper has pitch -90 degrees; its neighbours must not be rounded onto it."""
    v = np.eye(3) + tilt * np.array([[0, 1, 2], [3, 0, -1], [1, 2, 0]])
    p = sst_pin.Parameters(base_directions=v)
    assert np.abs(sst_pin.SST(p).geometry.R_0 - base_orientations(p)).max() < 1e-14


def test_the_three_arcs_make_up_body_seven(robot):
    """With closed loops the arcs' masses and inertias add up to the star's, Sect. 7.1 (c)."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.home)
    arcs = [data.oMi[j].act(robot.model.inertias[j]) for j in (3, 6, 9)]
    total = arcs[0] + arcs[1] + arcs[2]
    R = robot.platform_orientation(robot.home)
    assert total.mass == pytest.approx(2.6, abs=1e-14)
    assert total.lever == pytest.approx(R @ (0.8 / np.pi, 0, 0), abs=1e-14)
    assert total.inertia == pytest.approx(R @ np.diag((0.224, 0.224, 0.150)) @ R.T, abs=1e-14)


def test_cuts_are_in_the_schema_of_laas():
    """closed_loop, type and name_mot; gravity is an additional key."""
    assert yaml.safe_load(Path(sst_pin.sst.YAML_PATH).read_text()) == {
        "closed_loop": [[f"closedloop{k}_{end}" for end in "AB"] for k in (1, 2)],
        "type": ["6d", "6d"],
        "name_mot": ["gamma_1", "gamma_2", "gamma_3"],
        "gravity": [0, 0, -9.81],
    }


def test_the_star_frame_may_be_turned_in_an_edited_urdf(tmp_path):
    text = Path(sst_pin.URDF_PATH).read_text()
    for loop in (1, 2):
        head, joint, tail = text.partition(f'<joint name="closedloop{loop}_A_fixed"')
        text = head + joint + tail.replace('rpy="0.0 0.0 0.0"', 'rpy="0.1 -0.2 0.3"', 1)
    path = tmp_path / "turned.urdf"
    path.write_text(text)
    robot = sst_pin.SST.from_urdf(path)
    R = sst_pin.sst.orientation(0.9, 0.8, 0.1)
    q = robot.inverse_kinematics(R)
    assert np.abs(robot.platform_orientation(q) - R).max() < 1e-14
    assert np.abs(robot.residual(q)).max() < 1e-14
    solutions = robot.forward_kinematics(q[::3])
    assert np.abs(robot.platform_orientation(solutions) - R).max(axis=(1, 2)).min() < 1e-12
    path.write_text(text.replace('rpy="0.1 -0.2 0.3"', 'rpy="0.0 0.0 0.0"', 1))
    with pytest.raises(sst_pin.DescriptionError, match="closedloop2_A: must coincide"):
        sst_pin.SST.from_urdf(path)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('name="mu_2"', 'name="nu_2"', "joint mu_2 is missing"),
        ('<axis xyz="1 0 0" />', '<axis xyz="0 1 0" />', "joint mu_1: type JointModelRY"),
        ("closedloop2_B", "closedloop2_C", "frame closedloop2_B of the cuts is missing"),
        ('parent link="star_3"', 'parent link="star_1"', "must be fixed to star_3"),
        ('parent link="link_2"', 'parent link="link_1"', "must be gamma_k, mu_k, beta_k"),
        ('xyz="0.0 0.0 0.0" rpy="0.0 0.0 0.0"', 'xyz="0 0 0.1" rpy="0 0.1 0"', "rpy must be 0 0 0"),
        ("</robot>", "", "not a URDF"),
    ],
)
def test_a_urdf_of_another_topology_is_refused_by_name(tmp_path, old, new, word):
    path = tmp_path / "other.urdf"
    path.write_text(Path(sst_pin.URDF_PATH).read_text().replace(old, new))
    with pytest.raises(sst_pin.DescriptionError) as caught:
        sst_pin.SST.from_urdf(path)
    assert word in str(caught.value)
    assert str(path) in str(caught.value)


def test_mujoco_loads_the_urdf_with_the_same_mass_matrix(robot):
    model = mujoco.MjModel.from_xml_path(sst_pin.URDF_PATH)
    data = mujoco.MjData(model)
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(model.njnt)]
    order = [names.index(n) for n in robot.joint_names]
    for q in np.random.default_rng(0).uniform(-3, 3, size=(10, 9)):
        data.qpos[order] = q
        mujoco.mj_forward(model, data)
        M = np.zeros((9, 9))
        mujoco.mj_fullM(model, *((M, data.qM) if hasattr(data, "qM") else (data, M)))
        expected = pin.crba(robot.model, robot.model.createData(), q)
        assert np.abs(M[np.ix_(order, order)] - expected).max() < 1e-12
