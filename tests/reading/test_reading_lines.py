# SPDX-License-Identifier: BSD-2-Clause
"""Forces along lines from files: spatial tendons of an MJCF, `line_force` of a YAML."""

import warnings

import mujoco
import numpy as np
import pytest

import sst_pin
from sst_pin import LineForce
from tests.support.files import ROOT

MJCF = """
<mujoco><option gravity="0.4 -0.3 -9.7"/>
<worldbody>
  <site name="ceiling" pos="0.1 0.3 0.9"/>
  <body name="base" pos="0 0 0.4"><joint name="left" axis="0 1 0" damping=".1"/>
    <geom type="capsule" fromto="0 0 0 .2 0 .1" size=".02" mass="1"/>
    <site name="on_left" pos=".1 .05 .1"/>
    <body pos=".2 0 .1"><joint name="elbow" axis="0 1 0" stiffness="2"/>
      <geom type="capsule" fromto="0 0 0 .2 0 -.1" size=".02" mass="1"/>
      <site name="on_elbow" pos=".1 .02 -.05"/><site name="tip" pos=".2 0 -.1"/></body></body>
  <body pos=".5 0 .3"><joint name="right" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 -.1 .0 .2" size=".02" mass="1"/>
    <site name="on_right" pos="-.05 -.1 .1"/>
    <body pos="-.1 0 .2"><joint name="wrist" axis="0 1 0"/><joint name="spin" axis="0 0 1"/>
      <geom type="capsule" fromto="0 0 0 -.1 .02 -.1" size=".02" mass="1"/>
      <site name="hand" pos="-.1 .02 -.1"/></body></body>
</worldbody>
<equality><joint joint1="right" joint2="left" polycoef="0.1 0.7 0 0 0"/></equality>
<tendon>
  <spatial name="spring" stiffness="40" springlength="0.15" armature="0.8"><site site="ceiling"/><site site="on_elbow"/></spatial>
  <spatial name="damper" damping="7"><site site="on_left"/><site site="on_right"/></spatial>
  <spatial name="both" stiffness="30" damping="3"><site site="hand"/><site site="tip"/></spatial>
  <spatial name="cylinder"><site site="ceiling"/><site site="hand"/></spatial>
  <spatial name="idle"><site site="ceiling"/><site site="tip"/></spatial>
</tendon>
<actuator><motor joint="left"/><motor tendon="cylinder" gear="3"/><motor joint="elbow"/>
  <motor joint="wrist"/><motor joint="spin"/></actuator>
</mujoco>
"""  # noqa: E501

LEFT, HAND, TIP = (f'<site site="{name}"/>' for name in ("on_left", "hand", "tip"))


@pytest.fixture
def mjcf(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(MJCF)
    return path


def test_spatial_tendons_are_lines_as_in_mujoco(mjcf):
    """Forces, accelerations and moment arms of a robot with a coupling, within 1e-9."""
    chain, mj = sst_pin.ClosedChain.from_mjcf(mjcf), mujoco.MjModel.from_xml_path(str(mjcf))
    assert [str(line) for line in chain.lines] == ["spring", "damper", "both", "cylinder"]
    assert chain.motor_names == ("left", "cylinder", "elbow", "wrist", "spin")
    mj.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, random = mujoco.MjData(mj), np.random.default_rng(0)
    for _ in range(5):
        q = chain.assemble(random.uniform(-1, 1, 5))
        va, aa = random.normal(size=(2, 4))
        L = chain.joint_rates(q, np.eye(4)).T
        data.qpos, data.qvel = q, chain.joint_rates(q, va)
        data.qacc = chain.joint_accelerations(q, va, aa)
        mujoco.mj_inverse(mj, data)
        f = chain.generalized_forces(q, va, aa)
        np.testing.assert_allclose(f, L.T @ data.qfrc_inverse, rtol=0, atol=1e-9 * abs(f).max())
        np.testing.assert_allclose(chain.line_lengths(q), data.ten_length[:4], rtol=1e-12)
        J = np.array(chain.actuator_jacobian(q))
        J[1] *= 3  # tau is the force in the tendon: gear times control
        moments = np.zeros((mj.nu, mj.nv))
        places = data.moment_rownnz, data.moment_rowadr, data.moment_colind
        mujoco.mju_sparse2dense(moments, data.actuator_moment, *places)
        np.testing.assert_allclose(J, moments @ L, atol=1e-12)
        tau = chain.compute_torques(q, va, aa)
        np.testing.assert_allclose(chain.compute_accelerations(q, va, tau), aa, atol=1e-9)


def test_a_spring_without_force_from_length_zero_on_is_a_cable(mjcf, tmp_path):
    """Slack and taut it pulls as in MuJoCo, and `write_mjcf` writes it so."""
    text = MJCF.replace('springlength="0.15" armature="0.8"', 'springlength="0 0.6"')
    mjcf.write_text(text)
    chain, mj = sst_pin.ClosedChain.from_mjcf(mjcf), mujoco.MjModel.from_xml_string(text)
    assert chain.lines[0].pulls_only
    mj.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, random = mujoco.MjData(mj), np.random.default_rng(0)
    slack = []
    for _ in range(8):
        q = chain.assemble(random.uniform(-1, 1, 5))
        data.qpos = q
        mujoco.mj_inverse(mj, data)
        L = chain.joint_rates(q, np.eye(4)).T
        f = chain.generalized_forces(q, np.zeros(4), np.zeros(4))
        np.testing.assert_allclose(f, L.T @ data.qfrc_inverse, atol=1e-9 * abs(f).max())
        slack.append(bool(data.ten_length[0] < 0.6))
    assert set(slack) == {True, False}
    sst_pin.write_mjcf(chain, tmp_path / "again.xml")
    assert sst_pin.ClosedChain.from_mjcf(tmp_path / "again.xml").lines[0] == chain.lines[0]


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        (
            '"0.15"',
            '"0.1 0.2"',
            "tendon spring: a springlength with a dead band is supported from 0",
        ),
        ('"0.15"', '"0 0.2"', "tendon spring: a springlength with a dead band, and damping"),
        (f"{HAND}{TIP}", f"{HAND}{TIP}{HAND}", "tendon both: a tendon through 3 sites"),
        (LEFT, f'{LEFT}{TIP}<pulley divisor="2"/>{TIP}', "tendon damper: a tendon with pulleys"),
        ('name="damper"', 'name="elbow"', "tendon elbow: a joint has this name too"),
        (
            "<equality>",
            '<equality><tendon tendon1="idle" tendon2="both"/>',
            "a spatial tendon in an equality",
        ),
        ('stiffness="40"', 'stiffness="-40"', "stiffness of line spring: -40 is negative"),
    ],
)
def test_tendons_that_are_no_lines_are_refused_by_name(mjcf, old, new, word):
    assert old in MJCF
    mjcf.write_text(MJCF.replace(old, new, 1))
    with pytest.raises(sst_pin.SSTError, match=word) as caught:
        sst_pin.ClosedChain.from_mjcf(mjcf)
    assert str(mjcf) in str(caught.value)


FIXED = '<fixed name="f" range="0 1"><joint joint="left" coef="1"/></fixed>'
BALL = '<body><joint name="b" type="ball" range="0 9"/><geom size="1"/></body>'


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('name="idle"', 'name="idle" range="0 1"', "tendon idle: its limits are ignored"),
        ("<tendon>", f"<tendon>{FIXED}", "tendon f: its limits are ignored"),
        ("</worldbody>", f"{BALL}</worldbody>", "joint b: the limit of a ball is ignored"),
    ],
)
def test_limits_of_tendons_and_balls_are_ignored_with_a_warning(mjcf, old, new, told):
    """For the line of the caller; in `validate` it is a finding."""
    mjcf.write_text(MJCF.replace(old, new))
    with pytest.warns(sst_pin.DescriptionWarning, match=told) as caught:
        chain = sst_pin.ClosedChain.from_mjcf(mjcf)
    assert [warning.filename for warning in caught] == [__file__]
    assert len(chain.lines) == 4
    with warnings.catch_warnings():
        warnings.simplefilter("error", sst_pin.DescriptionWarning)
        assert f"warning: file: {told}" in map(str, sst_pin.validate(mjcf))


def test_a_tendon_named_as_a_motor_is_a_line(mjcf):
    chain = sst_pin.ClosedChain.from_mjcf(mjcf, actuated=["idle", "left"])
    assert [str(line) for line in chain.lines] == ["spring", "damper", "both", "idle"]
    assert chain.motor_units == ("N", "Nm")


DELTA = ROOT / "examples" / "delta.urdf"
LINES = """
line_force:
  - {frames: [universe, platform], name: gas, stiffness: 60, rest_length: 0.4, damping: 2, preload: -8}
  - {frames: [universe, rod_2a_end]}
"""  # noqa: E501


@pytest.fixture
def delta(tmp_path):
    """A URDF with its YAML, to which lines can be added."""
    (tmp_path / "delta.urdf").write_text(DELTA.read_text())

    def write(lines, motors="motor_1"):
        cuts = DELTA.with_suffix(".yaml").read_text().replace("[motor_1", f"[{motors}")
        (tmp_path / "delta.yaml").write_text(cuts + lines)
        return tmp_path / "delta.urdf"

    return write


def test_a_yaml_lists_forces_along_lines(delta):
    path = delta(LINES, "universe-rod_2a_end, motor_1")
    chain = sst_pin.ClosedChain.from_urdf(path)
    gas = {"name": "gas", "stiffness": 60, "rest_length": 0.4, "damping": 2, "preload": -8}
    plain = LineForce("universe", "rod_2a_end")
    assert chain.lines == (LineForce("universe", "platform", **gas), plain)
    assert chain.motor_names[0] == "universe-rod_2a_end"
    assert "error" not in {problem.severity for problem in sst_pin.validate(path)}


@pytest.mark.parametrize(
    ("lines", "word"),
    [
        ("line_force: [gas]", "line_force: 'gas' is not a mapping"),
        ("line_force: [{frames: [a]}]", "is not a pair of frame names"),
        (
            "line_force: [{frames: [a, b], stiff: 3}]",
            "stiff unknown; do you mean stiffness; known: name",
        ),
        ("line_force: [{frames: [a, b], damping: much}]", "damping 'much' is not a number"),
        ("line_force: [{frames: [a, b], damping: -1}]", "damping of line a-b: -1 is negative"),
        ("line_force: [{frames: [a, a]}]", "two different frames"),
        ("line_force: [{frames: [universe, b]}]", "frame 'b' not in the model"),
    ],
)
def test_lines_that_cannot_be_used_are_refused(delta, lines, word):
    path = delta(lines)
    with pytest.raises(sst_pin.SSTError, match="delta") as caught:
        sst_pin.ClosedChain.from_urdf(path)
    assert word in str(caught.value)
    assert word.startswith("frame") or any(word in p.text for p in sst_pin.validate(path))


def test_the_friction_of_a_spatial_tendon_is_dry_friction_of_a_line(mjcf, tmp_path):
    """Read, written and read again."""
    mjcf.write_text(MJCF.replace('damping="7"', 'damping="7" frictionloss="1.5"'))
    chain = sst_pin.ClosedChain.from_mjcf(mjcf)
    assert [line.coulomb_friction for line in chain.lines] == [0, 1.5, 0, 0]
    sst_pin.write_mjcf(chain, tmp_path / "again.xml")
    again = sst_pin.ClosedChain.from_mjcf(tmp_path / "again.xml")
    assert [line.coulomb_friction for line in again.lines] == [0, 1.5, 0, 0]
