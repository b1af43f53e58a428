# SPDX-License-Identifier: BSD-2-Clause
"""Forces and inertias of fixed tendons and free joints of an MJCF are those of MuJoCo."""

import re

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import sst_pin

ARM = """<mujoco><worldbody><body name="upper"><joint name="a" axis="0 1 0" ref="20"/>
<geom type="capsule" size=".05" fromto="0 0 0 0 0 .3"/>
<body name="lower" pos="0 0 .3"><joint name="b" axis="0 1 0"/>
<geom type="capsule" size=".04" fromto="0 0 0 0 0 .2"/>
<body name="hand" pos="0 0 .2"><joint name="c" type="slide" axis="0 0 1"/>
<geom type="box" size=".1 .05 .05" contype="0" conaffinity="0"/></body></body></body></worldbody>
<tendon><fixed name="t" {}>{}</fixed></tendon>
<actuator><motor joint="a"/><motor joint="b"/><motor joint="c"/></actuator></mujoco>"""
ALL = '<joint joint="a" coef="1.5"/><joint joint="b" coef="-0.7"/><joint joint="c" coef="2"/>'
ONE = '<joint joint="b" coef="-0.7"/>'


def read(text, tmp_path, **options):
    path = tmp_path / "robot.xml"
    path.write_text(text)
    return sst_pin.ClosedChain.from_mjcf(path, **options)


def forces_of_mujoco(text, qpos, qvel, qacc):
    """What a motion needs on all joints; dry friction, which solves for rates, is left out."""
    mj = mujoco.MjModel.from_xml_string(text)
    mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
    mujoco.mj_inverse(mj, data)
    return data.qfrc_inverse


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("joints", [ALL, ONE])
@pytest.mark.parametrize(
    "numbers",
    ['armature="0.8"', 'stiffness="30" springlength="0.1"', 'damping="4"', 'stiffness="30"'],
)
def test_springs_dampers_and_armature_of_fixed_tendons_are_those_of_mujoco(
    numbers, joints, compiled, tmp_path
):
    text = ARM.format(numbers, joints)
    chain = read(text, tmp_path)
    if compiled:
        chain.compile()
    random = np.random.default_rng(0)
    qpos, qvel, qacc = random.normal(size=(3, 3))
    q = chain.assemble(dict(zip("abc", qpos, strict=True)))
    tau = chain.compute_torques(q, qvel, qacc)
    expected = forces_of_mujoco(text, qpos, qvel, qacc)
    np.testing.assert_allclose(tau, expected, rtol=1e-9)
    np.testing.assert_allclose(chain.compute_accelerations(q, qvel, tau), qacc, rtol=1e-8)


def test_the_joint_of_a_tendon_has_the_length_of_the_tendon(tmp_path):
    """With locked joints too, which stand at their reference."""
    text = ARM.format('stiffness="30"', ALL)
    for locked in ([], ["a"]):
        chain = read(text, tmp_path, locked=locked)
        q = chain.assemble({"b": 0.3, "c": 0.2})
        mj = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(mj)
        a = mj.qpos0[0] if locked else q[chain.position_names.index("a")]
        data.qpos[:] = a, 0.3, 0.2
        mujoco.mj_kinematics(mj, data)
        mujoco.mj_comPos(mj, data)
        mujoco.mj_tendon(mj, data)
        assert q[chain.position_names.index("t")] == pytest.approx(data.ten_length[0], abs=1e-12)


def test_dry_friction_of_a_fixed_tendon_acts_on_its_joints_by_their_coefficients(tmp_path):
    chain = read(ARM.format('frictionloss="2"', ALL), tmp_path)
    without = read(ARM.format("", ALL), tmp_path)
    qpos, qvel = np.array([[0.1, 0.2, 0.3], [1.0, 0.2, -0.1]])
    q = chain.assemble(dict(zip("abc", qpos, strict=True)))
    more = chain.compute_torques(q, qvel, 0 * qvel) - without.compute_torques(qpos, qvel, 0 * qvel)
    # The tendon gets longer: 1.5 - 0.14 - 0.2 > 0.
    np.testing.assert_allclose(more, 2 * np.array([1.5, -0.7, 2.0]), atol=1e-12)


def test_an_actuator_of_a_tendon_with_armature_is_its_motor(tmp_path):
    text = ARM.format('armature="0.8"', ALL).replace('<motor joint="c"/>', '<motor tendon="t"/>')
    chain = read(text, tmp_path)
    assert chain.motor_names == ("a", "b", "t")
    q = chain.assemble({"a": 0.2, "b": 0.4, "c": 0.1})
    J = chain.with_coordinates(["a", "b", "c"]).actuator_jacobian(q)
    np.testing.assert_allclose(J[2], [1.5, -0.7, 2.0], atol=1e-12)


BOX = """<mujoco><worldbody><body name="box" pos="1 2 3"><joint name="f" type="free" {}/>
<geom type="box" size=".1 .2 .3" pos=".1 .2 .3"/><body name="arm" pos="0 0 .3">
<joint name="j" axis="0 1 0"/><geom size=".1" pos=".3 0 0" contype="0" conaffinity="0"/></body>
</body></worldbody></mujoco>"""


@pytest.mark.filterwarnings("ignore:.*three slides and a ball")
@pytest.mark.parametrize(
    "numbers", ['armature="3"', 'damping="2"', 'stiffness="5"', 'armature="3" stiffness="5"']
)
def test_free_joints_have_the_forces_and_inertias_of_mujoco(numbers, tmp_path):
    text = BOX.format(numbers)
    chain = read(text, tmp_path)
    random = np.random.default_rng(1)
    qpos = np.append(random.normal(size=7), 0.4)
    qpos[3:7] /= np.linalg.norm(qpos[3:7])
    qvel, qacc = random.normal(size=(2, 7))
    q = np.r_[qpos[:3], qpos[4:7], qpos[3], qpos[7]]
    expected = forces_of_mujoco(text, qpos, qvel, qacc)
    R = pin.Quaternion(q[3:7]).matrix()
    if "damping" in numbers:  # it stays a free joint: linear rates in axes of the body
        v, omega = R.T @ qvel[:3], qvel[3:6]
        qacc[:3] = R.T @ qacc[:3] - np.cross(omega, v)
        qvel[:3] = v
        expected[:3] = R.T @ expected[:3]
    rates = chain.mechanism.coordinates  # all rates, in some order
    assert sorted(rates) == list(range(7))
    tau = chain.generalized_forces(q, qvel[rates], qacc[rates])
    np.testing.assert_allclose(tau, expected[rates], rtol=1e-9, atol=1e-9)


def test_a_free_joint_that_becomes_slides_and_a_ball_is_named(tmp_path):
    text = BOX.format('armature="3" frictionloss="1"')
    told = "joint f: a free joint with armature, frictionloss is read as three slides and a ball"
    with pytest.warns(sst_pin.DescriptionWarning, match=re.escape(told)):
        chain = read(text, tmp_path)
    assert list(chain.model.names)[1:] == ["f_vx", "f_vy", "f_vz", "f", "j"]
    with pytest.raises(sst_pin.DescriptionError, match=r"f: a free joint with arm.*in part"):
        read(text, tmp_path, locked=["f_vx"])


def test_a_tendon_with_the_name_of_a_joint_is_refused(tmp_path):
    text = ARM.format('damping="1"', ALL).replace('name="t"', 'name="a"')
    with pytest.raises(sst_pin.DescriptionError, match="tendon a: a joint has this name too"):
        read(text, tmp_path)


def test_a_dead_band_of_a_fixed_tendon_is_refused(tmp_path):
    text = ARM.format('stiffness="1" springlength="0 1"', ALL)
    with pytest.raises(sst_pin.DescriptionError, match="tendon t: a springlength with a dead band"):
        read(text, tmp_path)
