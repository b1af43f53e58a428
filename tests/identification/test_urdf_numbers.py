# SPDX-License-Identifier: BSD-2-Clause
"""URDFs with the numbers of a robot: read again, they give this robot."""

import warnings
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin.identification import write_urdf
from tests.support.files import ROOT

FILES = {"delta": ROOT / "examples" / "delta.urdf", "sst": Path(sst_pin.URDF_PATH)}
#: A crank with a weight at a fixed joint, a slide on it, and a base that nothing moves.
ARM = """<robot name="arm">
<link name="base"><inertial><mass value="7"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="crank"/>
<link name="weight"><inertial><origin xyz="0.1 0 0" rpy="0.3 0 0"/><mass value="2"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.25"/></inertial></link>
<link name="cap"><inertial><mass value="0.5"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<link name="slide"><inertial><mass value="1"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="crank"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="5"/></joint>
<joint name="bolt" type="fixed"><parent link="crank"/><child link="weight"/>
<origin xyz="0 0 0.3" rpy="0 0 1"/></joint>
<joint name="lid" type="fixed"><parent link="weight"/><child link="cap"/>
<origin xyz="0.2 0 0"/></joint>
<joint name="push" type="prismatic"><parent link="weight"/><child link="slide"/>
<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="5" velocity="5"/>
<dynamics damping="0.7" friction="0.1"/></joint>
</robot>"""


def read(path, text=None, **options):
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sst_pin.DescriptionWarning)
        return sst_pin.ClosedChain.from_urdf(path, **options)


def changed(chain):
    """Each body that has a mass and the friction of each motor another number."""
    random, theta = np.random.default_rng(0), chain.dynamic_parameters
    values = np.array(theta.values)
    bodies = values[: 10 * (chain.model.njoints - 1)].reshape(-1, 10)
    for k in np.flatnonzero(bodies[:, 0]):
        bodies[k] += pin.Inertia.Random().toDynamicParameters()
    named = dict(zip(theta.names[: bodies.size], bodies.ravel(), strict=True))
    named |= {
        name: random.uniform(0.1, 1)
        for name in theta.names
        if name.endswith((".viscous", ".coulomb")) and name.split(".")[0] in chain.motor_names
    }
    return chain.with_parameters(named)


@pytest.mark.parametrize("name", FILES)
def test_a_robot_read_from_what_was_written_has_the_same_parameters(name, tmp_path):
    pin.seed(0)
    robot = changed(read(FILES[name]))
    path = tmp_path / "found.urdf"
    write_urdf(robot, FILES[name], path)
    cuts = FILES[name].with_suffix(".yaml")
    path.with_suffix(".yaml").write_bytes(cuts.read_bytes())
    again = read(path)
    assert again.dynamic_parameters.names == robot.dynamic_parameters.names
    assert_allclose(again.dynamic_parameters.values, robot.dynamic_parameters.values, atol=1e-12)


def test_links_at_fixed_joints_get_one_inertia_and_the_base_keeps_its_own(tmp_path):
    pin.seed(1)
    source = tmp_path / "arm.urdf"
    robot = changed(read(source, ARM))
    write_urdf(robot, source, tmp_path / "found.urdf")
    again = read(tmp_path / "found.urdf")
    assert_allclose(again.dynamic_parameters.values, robot.dynamic_parameters.values, atol=1e-12)
    text = (tmp_path / "found.urdf").read_text(encoding="utf-8")
    assert text.count("<inertial>") == 3
    assert '<mass value="7"' in text


@pytest.mark.parametrize("locked", [{"push": 0.4}, {"turn": -0.7}])
def test_locked_joints_are_fixed_in_the_file(locked, tmp_path):
    """The file alone is the robot; also if the joint is locked once more."""
    source, result = tmp_path / "arm.urdf", tmp_path / "found.urdf"
    arm = read(source, ARM)
    (free,) = {"turn", "push"} - set(locked)
    robot = sst_pin.ClosedChain(arm.model, [], [free], locked=locked)
    write_urdf(robot, source, result)
    q, v, a = np.array([[0.3], [-0.7], [1.1]])
    for again in (read(result), read(result, locked=[*locked])):
        assert again.joint_names == (free,)
        assert_allclose(
            again.compute_torques(q, v, a), robot.compute_torques(q, v, a), rtol=1e-12, atol=1e-12
        )
        assert_allclose(
            again.frame_placement(q, "slide")[0], robot.frame_placement(q, "slide")[0], atol=1e-12
        )


@pytest.mark.filterwarnings("ignore:.*its limits of -1 to 1 are not used")
def test_locked_rates_of_a_joint_are_told_by_name(tmp_path):
    source = tmp_path / "arm.urdf"
    source.write_text(ARM)
    source.with_suffix(".yaml").write_text("name_mot: []\njoint_type: {turn: ball}")
    robot = sst_pin.ClosedChain.from_urdf(source, locked=["turn_wx"])
    with pytest.warns(sst_pin.DescriptionWarning, match=r"cannot store turn \(lock it again\)"):
        write_urdf(robot, source, tmp_path / "found.urdf")


def test_what_a_urdf_cannot_have_is_told_by_name(tmp_path):
    source = tmp_path / "arm.urdf"
    robot = read(source, ARM).with_parameters({"turn.armature": 0.2, "push.stiffness": 3.0})
    with pytest.warns(sst_pin.DescriptionWarning, match=r"cannot store .*turn\.armature.*push\.st"):
        write_urdf(robot, source, tmp_path / "found.urdf")


def test_friction_of_a_universal_joint_replaces_that_of_the_file(tmp_path):
    """Equal friction of both hinges is written, other friction is told, none stays."""
    source, result = tmp_path / "arm.urdf", tmp_path / "found.urdf"
    source.with_suffix(".yaml").write_text("name_mot: []\njoint_type: {turn: UJOINT_XY}")
    robot = read(source, ARM.replace('velocity="5"/>', 'velocity="5"/><dynamics damping="2"/>', 1))
    assert_allclose(robot.friction.viscous[:2], 2)
    equal = robot.with_parameters({"turn_X.viscous": 0.3, "turn_Y.viscous": 0.3})
    write_urdf(equal, source, result)
    result.with_suffix(".yaml").write_bytes(source.with_suffix(".yaml").read_bytes())
    assert_allclose(read(result).friction.viscous, equal.friction.viscous)
    other = robot.with_parameters({"turn_X.viscous": 0.3, "turn_Y.viscous": 0.1})
    with pytest.warns(sst_pin.DescriptionWarning, match=r"store turn_X\.viscous, turn_Y\.viscous;"):
        write_urdf(other, source, result, force=True)
    assert_allclose(read(result).friction.viscous[:2], 0)


def test_the_yaml_stores_what_a_urdf_cannot(tmp_path):
    """Parameters that it gives are no loss; others are told, with the file that stores them."""
    source, result = tmp_path / "arm.urdf", tmp_path / "found.urdf"
    line = "{frames: [base, slide], name: gas, stiffness: 40}"
    source.with_suffix(".yaml").write_text(f"name_mot: [turn]\nline_force: [{line}]")
    robot = read(source, ARM)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_urdf(robot, source, result)
    stiffer = robot.with_parameters({"gas.stiffness": 50.0})
    text = r"a URDF cannot store gas\.stiffness; write them into arm\.yaml beside it"
    with pytest.warns(sst_pin.DescriptionWarning, match=text):
        write_urdf(stiffer, source, result, force=True)


def test_meshes_are_at_the_same_files_from_another_folder(tmp_path):
    mesh = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
    urdf = ARM.replace('<link name="crank"/>', f'<link name="crank">{mesh}</link>')
    (tmp_path / "a" / "meshes").mkdir(parents=True)
    source = tmp_path / "a" / "arm.urdf"
    for name, moves in (("meshes/x.stl", True), ("package://p/x.stl", False), ("/x.stl", False)):
        (tmp_path / "b").mkdir(exist_ok=True)
        write_urdf(read(source, urdf.format(name)), source, tmp_path / "b" / "f.urdf", force=True)
        root = ET.parse(tmp_path / "b" / "f.urdf").getroot()
        written = next(root.iter("mesh")).get("filename")
        if moves:
            assert (tmp_path / "b" / written).resolve() == (source.parent / name).resolve()
        else:
            assert written == name


def test_files_of_other_robots_are_refused(tmp_path):
    source = tmp_path / "arm.urdf"
    robot = read(source, ARM)
    with pytest.raises(sst_pin.DescriptionError, match="no link is moved by joint turn"):
        write_urdf(robot, FILES["delta"], tmp_path / "found.urdf")
    with pytest.raises(sst_pin.DescriptionError, match="cannot be read"):
        write_urdf(robot, tmp_path / "none.urdf", tmp_path / "found.urdf")
    with pytest.raises(sst_pin.OutputError, match="exists"):
        write_urdf(robot, source, source)


def named(*names: str) -> str:
    """A row of links on hinges with these names."""
    body = '<inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" '
    body += 'iyy="0.2" iyz="0" izz="0.25"/></inertial>'
    links = '<link name="l0"/>'
    for k, name in enumerate(names):
        links += f'<link name="l{k + 1}">{body}</link><joint name="{name}" type="continuous">'
        links += f'<parent link="l{k}"/><child link="l{k + 1}"/><origin xyz="0 0 0.2"/>'
        links += '<axis xyz="0 1 0"/></joint>'
    return f'<robot name="r">{links}</robot>'


def test_joints_whose_names_end_like_rates_are_joints(tmp_path):
    """`left_elbow` is no rate of `left`; what a URDF cannot store of it is told by its name."""
    path = tmp_path / "r.urdf"
    chain = read(path, named("left", "left_elbow", "left_x"), actuated=["left"])
    model = chain.model
    model.armature[:] = [0.0, 0.3, 0.0]
    heavy = sst_pin.ClosedChain(model, [], ["left"], stiffness=[0, 0, 2.0])
    with pytest.warns(sst_pin.DescriptionWarning, match="left_elbow.armature") as caught:
        write_urdf(heavy, path, tmp_path / "new.urdf")
    text = str(caught[0].message)
    assert "left_x.stiffness" in text
    assert "lock it again" not in text


def test_a_locked_joint_is_fixed_beside_joints_named_like_its_axes(tmp_path):
    path = tmp_path / "r.urdf"
    whole = read(path, named("arm", "arm_X", "arm_wy"), actuated=["arm_X"])
    locked = sst_pin.ClosedChain(whole.model, [], ["arm_X"], locked={"arm": 0.3})
    write_urdf(locked, path, tmp_path / "new.urdf")
    again = read(tmp_path / "new.urdf", actuated=["arm_X"])
    assert again.joint_names == ("arm_X", "arm_wy")
    q, va, aa = np.random.default_rng(0).normal(size=(3, 2))
    forces = locked.generalized_forces(q, va, aa)
    assert_allclose(again.generalized_forces(q, va, aa), forces, rtol=1e-10)


def test_states_of_an_srdf_name_joints_by_whole_names(tmp_path):
    path = tmp_path / "r.urdf"
    state = (
        '<robot name="r"><{0} name="home" group="all"><joint name="arm" value="0"/></{0}></robot>'
    )
    (tmp_path / "r.srdf").write_text(state.format("group_state"))
    text = named("arm", "arm_X").replace('"arm" type="continuous"', '"arm" type="fixed"')
    assert read(path, text, actuated=["arm_X"]).home.tolist() == [0.0]
    (tmp_path / "r.srdf").write_text(state.format("group_states"))
    with pytest.raises(sst_pin.DescriptionError, match="did you mean group_state"):
        read(path, actuated=["arm_X"])


def test_shares_of_weights_that_a_urdf_cannot_store_are_named_with_a_cure(tmp_path):
    """The weight and the cap become one link; the cure is what the warning tells."""
    off = '<gazebo reference="cap"><gravity>false</gravity></gazebo></robot>'
    chain = read(tmp_path / "arm.urdf", ARM.replace("</robot>", off))
    with pytest.warns(sst_pin.DescriptionWarning, match="turn: .* in weight_shares"):
        write_urdf(chain, tmp_path / "arm.urdf", tmp_path / "new.urdf")
    shares = f"weight_shares: {chain.weight_shares}\n"
    (tmp_path / "new.yaml").write_text("name_mot: [turn, push]\n" + shares)
    again = read(tmp_path / "new.urdf")
    state = np.random.default_rng(0).normal(size=(3, 2))
    expected = chain.generalized_forces(*state)
    assert_allclose(again.generalized_forces(*state), expected, rtol=1e-9)
