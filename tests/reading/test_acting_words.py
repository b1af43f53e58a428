# SPDX-License-Identifier: BSD-2-Clause
"""What acts in the file of another tool is read, or named by a warning and by `validate`."""

import warnings

import numpy as np
import pytest

import sst_pin

BODY = """<inertial><mass value="1"/><origin xyz="0.1 0 0"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
ARM = f"""<robot name="r"><link name="base"/><link name="arm">{BODY}</link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/>
<axis xyz="0 0 1"/></joint></robot>"""


def read(folder, *elements):
    """The arm with further elements: texts of the warnings, and the robot."""
    path = folder / "r.urdf"
    path.write_text(ARM.replace("</robot>", "".join(elements) + "</robot>"))
    path.with_suffix(".yaml").write_text("name_mot: [hinge]\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        chain = sst_pin.ClosedChain.from_urdf(path)
    problems = [p for p in sst_pin.validate(path) if p.severity != "note"]
    told = [str(warning.message) for warning in caught]
    assert len(told) == len(problems)
    assert all(f"{p.where}: {p.text}" in text for p, text in zip(problems, told, strict=True))
    return told, chain


@pytest.mark.parametrize(
    ("element", "word"),
    [
        (
            '<drake:linear_bushing_rpy><drake:bushing_frameA name="arm"/>'
            "</drake:linear_bushing_rpy>",
            "<linear_bushing_rpy>: of arm is not read",
        ),
        ('<spring joint="hinge" stiffness="3"/>', "<spring>: of hinge is not read"),
        *(
            (
                f'<gazebo reference="hinge"><{word}>{value}</{word}></gazebo>',
                f"gazebo hinge: <{word}> is not read",
            )
            for word, value in (
                ("springStiffness", "3"),
                ("dampingFactor", "0.1"),
                ("gravity", "false"),
                ("turnGravityOff", "true"),
            )
        ),
        (
            '<gazebo><plugin name="m" filename="libroboticsgroup_mimic_joint.so"/></gazebo>',
            "gazebo: plugin m libroboticsgroup_mimic_joint.so is not read",
        ),
    ],
)
def test_what_acts_and_is_not_read_is_named(tmp_path, element, word):
    told, _ = read(tmp_path, element)
    assert len(told) == 1
    assert word in told[0]


@pytest.mark.parametrize(
    "element",
    [
        '<gazebo reference="arm"><material>Blue</material><gravity>true</gravity></gazebo>',
        '<gazebo><plugin name="control" filename="libgazebo_ros2_control.so"/></gazebo>',
        '<sensor name="s"><parent link="arm"/></sensor>',
        '<ros2_control name="c"><joint name="hinge"/></ros2_control>',
    ],
)
def test_what_does_not_act_is_not_named(tmp_path, element):
    assert read(tmp_path, element)[0] == []


@pytest.mark.parametrize("declared", [True, False])
def test_a_rotor_of_drake_counts_by_the_square_of_its_gear(tmp_path, declared):
    """Also where the prefix is not declared, as Pinocchio reads the file."""
    transmission = """<transmission><joint name="hinge"/><actuator name="motor">
    <drake:rotor_inertia value="0.002"/><drake:gear_ratio value="10"/></actuator></transmission>"""
    if declared:
        transmission = transmission.replace("<transmission>", '<transmission xmlns:drake="d">')
    told, chain = read(tmp_path, transmission)
    assert told == []
    (mass,) = [1 + 1 * 0.1**2]
    tau = chain.compute_torques(np.zeros(1), np.zeros(1), np.ones(1))
    assert tau == pytest.approx([mass + 0.002 * 10**2], rel=1e-14)
