# SPDX-License-Identifier: BSD-2-Clause
import pytest

import sst_pin
from sst_pin import Contact, LineForce, Rope
from sst_pin.errors import DescriptionError
from sst_pin.reading import parse_cuts

YAML = """
name_mot: [a]
contacts:
  - {frame: sole, friction: 0.8}
  - {frame: ball, radius: 0.1, restitution: 0.5, ground: table, name: bounce}
  - {rope: [hook, load], length: 1.2}
line_force:
  - {frames: [hook, load], stiffness: 900, rest_length: 1, pulls_only: true, name: cable}
"""


def test_contacts_ropes_and_cables_are_read_from_yaml():
    cuts = parse_cuts(YAML, "robot.yaml")
    bounce = Contact("ball", radius=0.1, restitution=0.5, ground="table", name="bounce")
    assert cuts.contacts == (Contact("sole", friction=0.8), bounce, Rope("hook", "load", 1.2))
    numbers = {"stiffness": 900, "rest_length": 1, "pulls_only": True}
    assert cuts.lines == (LineForce("hook", "load", name="cable", **numbers),)


@pytest.mark.parametrize(
    ("entry", "problem"),
    [
        ("{friction: 0.8}", "no frame and no rope"),
        ("{frame: sole, mu: 0.8}", "mu unknown"),
        ("{frame: sole, friction: -1}", "negative"),
        ("{rope: [a, b]}", "has no length"),
        ("{rope: [a], length: 1}", "not a pair"),
    ],
)
def test_wrong_contacts_are_named(entry, problem):
    with pytest.raises(DescriptionError, match=problem):
        parse_cuts(f"name_mot: [a]\ncontacts: [{entry}]", "robot.yaml")


def test_a_robot_from_files_has_its_contacts(tmp_path):
    (tmp_path / "slider.urdf").write_text(
        """<robot name="slider"><link name="world"/><link name="block"><inertial>
        <mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
        </link><joint name="z" type="prismatic"><parent link="world"/><child link="block"/>
        <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="9" velocity="9"/></joint></robot>"""
    )
    text = "name_mot: [z]\ncontacts: [{frame: block, radius: 0.2}]\n"
    (tmp_path / "slider.yaml").write_text(text)
    chain = sst_pin.ClosedChain.from_urdf(tmp_path / "slider.urdf")
    assert chain.contacts == (Contact("block", radius=0.2),)
