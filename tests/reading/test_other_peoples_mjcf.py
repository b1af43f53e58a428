# SPDX-License-Identifier: BSD-2-Clause
"""MJCF files of others: missing meshes, weights that are compensated, contacts, idle spins."""

import re
import warnings

import mujoco
import numpy as np
import pytest

import sst_pin

INERTIAL = '<inertial pos="0 0 .1" mass="1" diaginertia=".1 .1 .1"/>'
ARM = """<mujoco>{assets}<worldbody><body name="arm"{of_arm}><joint name="j" axis="0 1 0"/>
{inertial}{geoms}<body name="hand" pos="0 0 .3"{of_hand}><joint name="k" axis="1 0 0"/>
<geom type="box" size=".1 .1 .2" pos=".1 0 .1" {of_geom}/></body></body></worldbody></mujoco>"""
MESH = '<asset><mesh name="m" file="a.stl"/><texture name="t" type="2d" file="a.png"/>'
MESH += '<material name="c" texture="t"/></asset>'
OF_MESH = '<geom type="mesh" mesh="m" material="c"/>'


def mjcf(**parts: str) -> str:
    words = ("assets", "of_arm", "inertial", "geoms", "of_hand", "of_geom")
    return ARM.format(**{word: parts.get(word, "") for word in words})


def read(text: str, tmp_path, **options) -> tuple[sst_pin.ClosedChain, list[str]]:
    path = tmp_path / "robot.xml"
    path.write_text(text)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        chain = sst_pin.ClosedChain.from_mjcf(path, **options)
    return chain, [str(warning.message) for warning in caught]


def forces_of_mujoco(text: str, q, v, a) -> np.ndarray:
    mj = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
    mujoco.mj_inverse(mj, data)
    return data.qfrc_inverse


STATE = np.array([[0.4, -0.7], [1.0, 2.0], [0.5, -3.0]])


@pytest.mark.parametrize("pointer", ["", "version https://git-lfs.github.com/spec/v1\n"])
def test_a_mesh_that_is_missing_is_not_needed_where_bodies_have_their_mass(tmp_path, pointer):
    """Missing, or not fetched by Git LFS."""
    if pointer:
        (tmp_path / "a.stl").write_text(pointer)
    text = mjcf(inertial=INERTIAL, assets=MESH, geoms=OF_MESH)
    chain, texts = read(text, tmp_path, actuated=["j", "k"])
    assert len(texts) == 1
    assert "files of m, t are missing; the robot is read without these shapes" in texts[0]
    expected = forces_of_mujoco(mjcf(inertial=INERTIAL), *STATE)
    np.testing.assert_allclose(chain.compute_torques(*STATE), expected, rtol=1e-10)
    problems = sst_pin.validate(tmp_path / "robot.xml")
    assert [p.severity for p in problems if "missing" in p.text] == ["warning"]


KEYS = """<mujoco><worldbody>
<body name="target" mocap="true" pos="1 0 0" quat="0.6 0.8 0 0"/>
<body name="arm"><joint name="j" axis="0 1 0"/><geom size=".1"/>
<body name="hand" pos="0 0 .3"><joint name="ball" type="ball"/><geom size=".1"/></body>
</body></worldbody><actuator><motor joint="j"/></actuator>
<keyframe><key name="up" qpos="1 {ball}" mpos="1 0 0" mquat="{target}"/></keyframe></mujoco>"""


@pytest.mark.parametrize("sign", [1, -1])
def test_the_quaternions_of_a_keyframe_may_have_either_sign(tmp_path, sign):
    """Of a mocap body that it does not move, and of a ball that is locked where it is."""
    text = KEYS.format(ball=f"{sign} 0 0 0", target=f"{0.6 * sign} {0.8 * sign} 0 0")
    chain, texts = read(text, tmp_path, locked=["ball"])
    assert not any("key up" in text for text in texts)
    assert chain.model.referenceConfigurations["up"] == pytest.approx([1.0])


def test_a_keyframe_that_moves_a_fixed_body_or_a_locked_joint_is_named(tmp_path):
    text = KEYS.format(ball="0 1 0 0", target="0.6 0.8 0 0")
    _, texts = read(text, tmp_path, locked=["ball"])
    assert any("key up: ball is locked elsewhere" in text for text in texts)
    with pytest.raises(sst_pin.DescriptionError, match="it moves the mocap body target"):
        read(text.replace('mpos="1', 'mpos="2'), tmp_path)


def test_a_mass_that_a_missing_mesh_has_is_an_error_by_name(tmp_path):
    told = "body arm: its mass is that of the mesh m, whose file is missing"
    with pytest.raises(sst_pin.DescriptionError, match=told):
        read(mjcf(assets=MESH, geoms=OF_MESH), tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        mjcf(inertial=INERTIAL, of_geom='mass="-1"'),
        mjcf(inertial=INERTIAL, of_geom='colour="1"'),
        mjcf(inertial=INERTIAL, assets='<extension><plugin plugin="no.such"/></extension>'),
        mjcf(inertial=INERTIAL, of_geom='mass="-1"', assets=MESH, geoms=OF_MESH),
    ],
)
def test_what_mujoco_refuses_is_called_so(text, tmp_path):
    with pytest.raises(sst_pin.DescriptionError, match="MuJoCo refuses it: "):
        read(text, tmp_path)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_weights_that_are_compensated_alike_are_those_of_mujoco(share, tmp_path):
    gravcomp = f' gravcomp="{share}"'
    text = mjcf(inertial=INERTIAL, of_arm=gravcomp, of_hand=gravcomp)
    chain, _ = read(text, tmp_path, actuated=["j", "k"])
    expected = forces_of_mujoco(text, *STATE)
    np.testing.assert_allclose(chain.compute_torques(*STATE), expected, rtol=1e-10)


@pytest.mark.parametrize(
    ("shares", "flags", "joints"),
    [
        ((0.3, 0.8, -0.5), "", ["j", "k"]),
        ((0.3, 0.8, -0.5), '<flag spring="disable" damper="disable"/>', []),
        ((0, 0, -0.5), "", []),
    ],
    ids=["some", "without passive forces", "negative ones alone"],
)
def test_weights_that_are_compensated_in_part_are_those_of_mujoco(shares, flags, joints, tmp_path):
    """Also of a tool that is fixed to the hand. In two cases MuJoCo compensates nothing."""
    of_arm, of_hand, of_tool = (f' gravcomp="{share}"' for share in shares)
    gravity = f'<option gravity="1 2 -9">{flags}</option>'
    text = mjcf(inertial=INERTIAL, of_arm=of_arm, of_hand=of_hand, assets=gravity)
    tool = f'<body pos=".1 .2 .3" euler="10 20 30"{of_tool}>{INERTIAL}</body>'
    text = text.replace("</body></body>", f"{tool}</body></body>")
    chain, texts = read(text, tmp_path, actuated=["j", "k"])
    assert texts == []
    assert list(chain.weight_shares) == joints
    tau = chain.compute_torques(*STATE)
    np.testing.assert_allclose(tau, forces_of_mujoco(text, *STATE), rtol=1e-10)


def test_compensation_by_the_motors_is_refused_with_a_cure(tmp_path):
    """Without gravcomp the torques are those of control and compensation together."""
    text = mjcf(inertial=INERTIAL, of_hand=' gravcomp="1"')
    text = text.replace('axis="1 0 0"', 'axis="1 0 0" actuatorgravcomp="true"')
    with pytest.raises(sst_pin.DescriptionError, match="remove gravcomp; the torques"):
        read(text, tmp_path)


@pytest.mark.parametrize(
    ("of_geom", "told"),
    [
        ("", "contacts are not computed"),
        ('contype="0" conaffinity="0"', ""),
        ('contype="0" conaffinity="0" adhesion="5"', "contacts are not computed, nor adhesion"),
    ],
)
def test_contacts_are_one_note(of_geom, told, tmp_path):
    _, texts = read(mjcf(inertial=INERTIAL, of_geom=of_geom), tmp_path, actuated=["j", "k"])
    assert texts == []
    notes = [p.text for p in sst_pin.validate(tmp_path / "robot.xml") if "contacts" in p.text]
    assert notes == ([told] if told else [])


ROD = """<mujoco><default><joint damping=".01" frictionloss=".02"/></default><worldbody>
<body name="crank"><joint name="crank" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 .3"
 size=".01"/><body name="rod" pos="0 0 .3"><joint name="rod" type="ball"/>
 <geom type="capsule" fromto="0 0 0 .6 0 0" size=".01"/>
 <site name="end" pos=".6 0 0"/></body></body>
<body name="slider" pos=".6 0 .3"><joint name="slider" type="slide" axis="1 0 0"/>
<geom type="box" size=".02 .02 .02"/><site name="pin"/></body></worldbody>
<equality><connect site1="end" site2="pin"/></equality>
<actuator><motor joint="crank"/></actuator></mujoco>"""


def test_the_cure_for_an_idle_spin_works_where_the_ball_has_friction(tmp_path):
    chain, _ = read(ROD, tmp_path)
    (advice,) = re.findall(r"locked=\[([^\]]*)\]", str(chain.mobility()))
    locked = re.findall(r"'(\w+)'", advice)
    held, texts = read(ROD, tmp_path, locked=locked)
    assert held.degrees_of_freedom == 1
    assert any("friction acts about each axis that is not locked" in text for text in texts)
    rod = [k for k, name in enumerate(held.rate_names) if name.startswith("rod_w")]
    assert held.mechanism.friction.coulomb[rod].tolist() == [0.02, 0.02]
    assert held.mechanism.friction.viscous[rod].tolist() == [0.01, 0.01]


def test_friction_that_a_file_switches_off_is_not_noted(tmp_path):
    flags = '<mujoco><option><flag frictionloss="disable" damper="disable"/></option>'
    text = ROD.replace("<mujoco>", flags)
    held, texts = read(text, tmp_path, locked=["rod_wx"])
    assert texts == []
    assert not held.mechanism.friction.viscous.any()


NUT = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="nut" pos="0 0 1">
<joint name="turn" axis="0 0 1"/><joint name="lift" type="slide" axis="0 0 1"/>
<geom type="box" size=".1 .1 .1" mass="3"/></body></worldbody>
<equality><joint joint1="lift" joint2="turn" polycoef="0 0.005"/></equality>
<actuator><motor joint="turn"/></actuator></mujoco>"""


def test_a_nut_advances_in_each_of_several_turns(tmp_path):
    chain, _ = read(NUT, tmp_path)
    q = chain.assemble({"turn": 20 * np.pi})
    np.testing.assert_allclose(q, [20 * np.pi, 0.005 * 20 * np.pi], rtol=1e-12)
    np.testing.assert_allclose(chain.compute_torques(q, [0], [0]), [3 * 9.81 * 0.005], rtol=1e-12)
