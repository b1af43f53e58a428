# SPDX-License-Identifier: BSD-2-Clause
"""What acts in the file of another tool is read, or named by a warning and by `validate`."""

import warnings
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import sst_pin
from sst_pin.reading.acting_elements import plugin_problem, unread_elements

BODY = """<inertial><mass value="1"/><origin xyz="0.1 0 0"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
ARM = f"""<robot name="r"><link name="base"/><link name="arm">{BODY}</link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/>
<axis xyz="0 0 1"/></joint></robot>"""


def read(folder, *elements, cuts="name_mot: [hinge]\n"):
    """The arm with further elements: texts of the warnings, and the robot."""
    path = folder / "r.urdf"
    path.write_text(ARM.replace("</robot>", "".join(elements) + "</robot>"))
    path.with_suffix(".yaml").write_text(cuts)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        chain = sst_pin.ClosedChain.from_urdf(path)
    problems = [p for p in sst_pin.validate(path) if p.severity != "note"]
    records = [str(warning.message) for warning in caught]
    assert len(records) == len(problems)
    assert all(f"{p.where}: {p.text}" in text for p, text in zip(problems, records, strict=True))
    return records, chain


@pytest.mark.parametrize(
    ("element", "word"),
    [
        ('<spring joint="hinge" stiffness="3"/>', "<spring>: of hinge is not read"),
        ('<spring joint=" hinge " stiffness="3"/>', "<spring>: of hinge is not read"),
        (
            '<gazebo reference="arm"><dampingFactor>0.1</dampingFactor></gazebo>',
            "dampingFactor '0.1'",
        ),
        ("<gazebo><static>true</static></gazebo>", "gazebo: static 'true' is not read"),
        ("<gazebo><buoyancy>true</buoyancy></gazebo>", "buoyancy 'true' is not read"),
        (
            '<transmission name="t"><joint name="knee"/></transmission>',
            "transmission t: 'knee' is not a joint of this file",
        ),
        (
            '<gazebo reference="hing"><springStiffness>3</springStiffness></gazebo>',
            "gazebo hing: springStiffness is not read: 'hing' is no joint of this file",
        ),
        (
            '<gazebo reference="arm"><springStiffness>3</springStiffness></gazebo>',
            "gazebo arm: springStiffness is not read: 'arm' is no joint of this file",
        ),
        (
            '<gazebo><plugin name="w" filename="gz-sim-buoyancy-system"/></gazebo>',
            "gazebo: plugin w gz-sim-buoyancy-system is not read",
        ),
        (
            '<gazebo reference="arm"><plugin name="t" filename="gz-sim-thruster-system"/></gazebo>',
            "gazebo arm: plugin t gz-sim-thruster-system is not read",
        ),
        (
            '<mujoco><compiler settotalmass="3" meshdir="a"/></mujoco>',
            "<mujoco>: <compiler settotalmass='3'> is not read",
        ),
        (
            '<mujoco><option gravity="0 0 -1.6" timestep="0.1"/></mujoco>',
            "<mujoco>: <option gravity='0 0 -1.6'> is not read",
        ),
        (
            '<mujoco><option gravity="0 0 0" wind="0 0 0"/></mujoco>',
            "<mujoco>: <option gravity='0 0 0'> is not read",
        ),
        (
            '<mujoco><option><flag gravity="disable" sensor="disable"/></option></mujoco>',
            "<mujoco>: <flag gravity='disable'> is not read",
        ),
        (
            '<frame name="A" link="base"/><frame name="C" link="arm"/>'
            '<drake:linear_bushing_rpy><drake:bushing_frameA name="A"/>'
            '<drake:bushing_frameC name="C"/></drake:linear_bushing_rpy>',
            "<drake:linear_bushing_rpy>: of A, C is not read",
        ),
        (
            '<ros2_control name="c"><joint name="hinge"><param name="mimic">knee</param></joint>'
            "</ros2_control>",
            "ros2_control: joint hinge: mimic 'knee' is not read",
        ),
        (
            '<gazebo><plugin name="m" filename="libroboticsgroup_mimic_joint.so"/></gazebo>',
            "gazebo: plugin m libroboticsgroup_mimic_joint.so is not read",
        ),
    ],
)
def test_what_acts_and_is_not_read_is_named(tmp_path, element, word):
    records, _ = read(tmp_path, element)
    assert len(records) == 1
    assert word in records[0]


@pytest.mark.parametrize(
    "element",
    [
        '<gazebo reference="arm"><material>Blue</material><gravity>true</gravity></gazebo>',
        '<gazebo><plugin name="control" filename="libgazebo_ros2_control.so"/></gazebo>',
        '<sensor name="s" gz:type="camera"><gz:parent link="arm"/></sensor>',
        '<ros2_control name="c"><joint name="hinge"/></ros2_control>',
        '<mujoco><option><flag gravity="enable" contact="disable"/></option></mujoco>',
        '<mujoco><compiler settotalmass="-1" boundmass="0"/></mujoco>',
        '<mujoco><option gravity="0 0 -9.81"/></mujoco>',
    ],
)
def test_what_does_not_act_is_not_named(tmp_path, element):
    assert read(tmp_path, element)[0] == []


@pytest.mark.parametrize(
    ("filename", "exerts_no_force"),
    [
        ("gz-sim-imu-system", True),
        ("libgazebo_ros_imu.so", True),
        ("libgazebo_ros_gpu_ray.so", True),
        ("libGazeboRosImu.so", True),
        ("libRayPlugin.so", True),
        ("magnet_array", False),
        ("libRayleighDamping.so", False),
        ("rayleigh_damping", False),
    ],
)
def test_sensors_are_known_by_whole_words(filename, exerts_no_force):
    plugin = ET.Element("plugin", filename=filename)
    texts = [problem.text for problem in plugin_problem(plugin, "gazebo")]
    expected = [f"plugin {filename} is not read, nor any force of it"]
    assert texts == ([] if exerts_no_force else expected)


def test_parts_without_names_are_not_named_by_elements_without_texts():
    root = ET.fromstring('<robot><link/><link name="a"/><spring joint="a"> </spring></robot>')
    assert [problem.text for problem in unread_elements(root)] == ["of a is not read"]


@pytest.mark.parametrize(
    "words", ["<gravity>false</gravity>", "<turnGravityOff>1</turnGravityOff>"]
)
def test_gravity_that_is_off_for_each_link_is_off(tmp_path, words):
    records, chain = read(tmp_path, f'<gazebo reference="arm">{words}</gazebo>')
    assert records == []
    assert not chain.model.gravity.linear.any()


@pytest.mark.parametrize(
    "words",
    ["<drake:disable_gravity/>", '</link><gazebo reference="tip"><gravity>0</gravity></gazebo>'],
)
@pytest.mark.parametrize("kind", ["continuous", "fixed"])
def test_gravity_that_is_off_for_one_link_leaves_the_weight_of_the_other(tmp_path, kind, words):
    """1 kg at 0.1 m from the hinge about y, by hand; also if both links are one body."""
    link = f'<link name="tip">{BODY}{words}</link>'.replace("</gazebo></link>", "</gazebo>")
    joint = f"""<joint name="wrist" type="{kind}"><parent link="arm"/><child link="tip"/>
    <origin xyz="0.3 0 0"/><axis xyz="0 1 0"/></joint>"""
    upright = """<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/>
    <axis xyz="0 1 0"/></joint>"""
    path = tmp_path / "r.urdf"
    start, end = ARM.index("<joint"), ARM.index("</robot>")
    path.write_text(ARM[:start] + link + joint + upright + ARM[end:])
    path.with_suffix(".yaml").write_text("name_mot: [hinge]\n")
    chain = sst_pin.ClosedChain.from_urdf(path)  # without a warning
    q = chain.assemble({"hinge": 0.3})
    zero = np.zeros(chain.degrees_of_freedom)
    f = dict(zip(chain.coordinates, chain.generalized_forces(q, zero, zero), strict=True))
    assert f["hinge"] == pytest.approx(-9.81 * 0.1 * np.cos(0.3), abs=1e-12)
    assert f.get("wrist", 0.0) == pytest.approx(0.0, abs=1e-12)


def test_shares_of_weights_in_the_yaml_replace_those_of_the_urdf(tmp_path):
    """Also if a joint is locked, so that its body becomes a part of another one."""
    link = f'<link name="tip">{BODY}<drake:disable_gravity/></link>'
    joint = """<joint name="wrist" type="continuous"><parent link="arm"/><child link="tip"/>
    <axis xyz="0 0 1"/></joint>"""
    shares = "weight_shares: {wrist: 0.5, hinge: [0.7, 0, 0.1, 0]}\n"
    records, chain = read(tmp_path, link, joint, cuts=f"name_mot: [hinge, wrist]\n{shares}")
    assert records == []
    assert chain.weight_shares == {"hinge": [0.7, 0.0, 0.1, 0.0], "wrist": 0.5}
    _, locked = read(tmp_path, link, joint, cuts=f"name_mot: [hinge]\n{shares}locked: [wrist]\n")
    # 2 kg: the mean of both shares, and half of the offset of 1 kg.
    assert locked.weight_shares == {"hinge": pytest.approx([0.6, 0.0, 0.05, 0.0])}


def test_a_wrong_share_in_the_yaml_is_named(tmp_path):
    with pytest.raises(sst_pin.DescriptionError, match="is neither a number nor"):
        read(tmp_path, cuts="name_mot: [hinge]\nweight_shares: {hinge: [1, 2]}\n")


def test_a_spring_of_gazebo_acts(tmp_path):
    """Torque k (q - reference), as the default damper of the URDF."""
    words = "<springStiffness>3</springStiffness><springReference>0.2</springReference>"
    records, chain = read(tmp_path, f'<gazebo reference="hinge">{words}</gazebo>')
    assert records == []
    tau = chain.compute_torques(np.array([0.5]), np.zeros(1), np.zeros(1))
    assert tau == pytest.approx([3 * (0.5 - 0.2)], rel=1e-14)


@pytest.mark.parametrize("text", ["", "soft"])
def test_a_spring_that_is_no_number_is_refused(tmp_path, text):
    words = f"<springStiffness>{text}</springStiffness>"
    with pytest.raises(sst_pin.DescriptionError, match=r"springStiffness '.*' is not a number"):
        read(tmp_path, f'<gazebo reference="hinge">{words}</gazebo>')


@pytest.mark.parametrize("declared", [True, False])
def test_a_rotor_of_drake_counts_by_the_square_of_its_gear(tmp_path, declared):
    """Also where the prefix is not declared, as Pinocchio reads the file."""
    transmission = """<transmission><joint name="hinge"/><actuator name="motor">
    <drake:rotor_inertia value="0.002"/><drake:gear_ratio value="10"/></actuator></transmission>"""
    if declared:
        transmission = transmission.replace("<transmission>", '<transmission xmlns:drake="d">')
    records, chain = read(tmp_path, transmission)
    assert records == []
    tau = chain.compute_torques(np.zeros(1), np.zeros(1), np.ones(1))
    assert tau == pytest.approx([1 + 1 * 0.1**2 + 0.002 * 10**2], rel=1e-14)
