# SPDX-License-Identifier: BSD-2-Clause
import mujoco
import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import Contact, Rope
from sst_pin.errors import DescriptionWarning
from tests.gallery.touching import PLANAR, frame, planar

MJCF = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1" friction="0.4"/>
  <geom name="ramp" type="plane" size="1 1 1" pos="1 0 0" euler="0 -30 0" friction="0.6"/>
  <site name="hook" pos="0 0 3"/>
  <body name="block" pos="0 0 1"><freejoint name="block"/>
    <geom name="box" type="box" size=".1 .2 .3" mass="2" friction="0.5"
      contype="1" conaffinity="1"/>
    <site name="top" pos="0 0 .3"/></body>
  <body name="ball" pos="0 1 1"><freejoint name="ball"/>
    <geom name="round" type="sphere" size=".1" mass="1" condim="1"
      contype="1" conaffinity="0"/></body>
</worldbody>
<tendon><spatial name="rope" limited="true" range="0 2">
  <site site="hook"/><site site="top"/></spatial></tendon>
</mujoco>
"""


def test_corners_of_boxes_spheres_and_ropes_are_read_from_mjcf(tmp_path):
    path = tmp_path / "scene.xml"
    path.write_text(MJCF)
    with pytest.warns(DescriptionWarning, match="1 of box on sphere"):
        chain = sst_pin.ClosedChain.from_mjcf(path, actuated=[], contacts=True)
    points = [x for x in chain.contacts if isinstance(x, Contact)]
    assert [x for x in chain.contacts if isinstance(x, Rope)] == [
        Rope("hook", "top", 2.0, name="rope")
    ]
    corners = [x for x in points if x.ground == "universe" and x.radius == 0]
    assert len(corners) == 8
    assert {x.friction for x in corners} == {0.5}
    q = pin.neutral(chain.model)
    places = np.array([chain.frame_placement(q, x.frame)[0] for x in corners])
    assert np.ptp(places, axis=0) == pytest.approx([0.2, 0.4, 0.6])
    (ball, on_ramp) = [x for x in points if x.radius]
    assert (ball.radius, ball.ground, on_ramp.ground) == (0.1, "universe", "ramp")
    assert ball.friction == 1.0  # the larger one of both shapes, of the default here
    assert {x.friction for x in points if x.ground == "ramp" and not x.radius} == {0.6}
    with pytest.warns(DescriptionWarning, match="limits are ignored"):
        assert not sst_pin.ClosedChain.from_mjcf(path, actuated=[]).contacts


def test_a_frame_of_a_contact_has_a_name_of_its_own(tmp_path):
    """Sites have the name of the shape, and the name that it would get then."""
    sites = '<site name="ramp" pos="2 0 0"/><site name="ramp_contact" pos="3 0 0"/>'
    path = tmp_path / "scene.xml"
    path.write_text(MJCF.replace('<site name="hook"', f'{sites}<site name="hook"'))
    with pytest.warns(DescriptionWarning, match="1 of box on sphere"):
        chain = sst_pin.ClosedChain.from_mjcf(path, actuated=[], contacts=True)
    grounds = {x.ground for x in chain.contacts if isinstance(x, Contact)} - {"universe"}
    assert grounds == {"ramp_contact_contact"}
    position, _ = chain.frame_placement(pin.neutral(chain.model), "ramp_contact_contact")
    assert position == pytest.approx([1, 0, 0])


def test_contacts_that_are_written_are_read_again(tmp_path):
    model = planar(1.0, 0.1)
    frame(model, "toe", "turn", (0.1, 0, -0.2))
    frame(model, "heel", "turn", (-0.1, 0, -0.2))
    frame(model, "hook", "universe", (0, 0, 2))
    frame(model, "ramp", "universe", (1, 0, 0), [[0, 0, -1], [0, 1, 0], [1, 0, 0]])
    contacts = [
        Contact("toe", friction=0.7),
        Contact("heel", radius=0.05, friction=0.2, ground="ramp"),
        Rope("hook", "toe", 1.5),
    ]
    chain = sst_pin.ClosedChain(model, [], [], coordinates=PLANAR, contacts=contacts)
    sst_pin.write_mjcf(chain, tmp_path / "robot.xml")
    again = sst_pin.ClosedChain.from_mjcf(tmp_path / "robot.xml", contacts=True)
    assert again.contacts == chain.contacts


PAIRS = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body name="ball" pos="0 0 .05"><freejoint name="ball"/><geom name="round" size=".1"/>
    <body name="carried" pos=".15 0 0"><joint name="carried"/><geom name="near" size=".1"/></body>
  </body>
  <body name="ghost" pos="3 0 .05"><freejoint name="ghost"/><geom name="none" size=".1"/></body>
</worldbody>
<contact>
  <pair geom1="floor" geom2="round" condim="3" friction="0.3 0.3 0.005 0.0001 0.0001"/>
  <exclude body1="ghost" body2="world"/>
</contact>
</mujoco>
"""


def test_shapes_touch_where_they_touch_in_mujoco(tmp_path):
    """Once for a listed pair; not if the file excludes it, nor with the body that carries them."""
    path = tmp_path / "scene.xml"
    path.write_text(PAIRS)
    with pytest.warns(DescriptionWarning, match="contacts are left out: 2 of sphere on sphere"):
        chain = sst_pin.ClosedChain.from_mjcf(path, actuated=[], contacts=True)
    mj = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)  # all spheres reach into the floor
    on_floor = {}
    for contact in data.contact:
        plane, sphere = sorted(contact.geom)
        assert plane == mj.geom("floor").id
        on_floor[mj.body(mj.geom(sphere).bodyid[0]).name] = contact.friction[0]
    assert sorted(on_floor) == ["ball", "carried"]
    assert len(chain.contacts) == 2
    # The frames of the spheres have the names of their bodies.
    assert {x.frame: x.friction for x in chain.contacts} == on_floor


@pytest.mark.parametrize("priorities", [(0, 0), (1, 0), (0, 1)])
@pytest.mark.parametrize("dimensions", [(3, 3), (1, 3), (3, 1)])
def test_friction_is_that_of_mujoco_also_with_priorities(priorities, dimensions, tmp_path):
    """The shape of higher priority decides; of two with the same priority, the larger value."""
    xml = f"""<mujoco><worldbody>
      <geom name="floor" type="plane" size="1 1 1" friction="0.3"
            priority="{priorities[0]}" condim="{dimensions[0]}"/>
      <body name="ball" pos="0 0 .05"><freejoint name="ball"/>
        <geom size=".1" friction="0.8" priority="{priorities[1]}" condim="{dimensions[1]}"/></body>
    </worldbody></mujoco>"""
    path = tmp_path / "scene.xml"
    path.write_text(xml)
    chain = sst_pin.ClosedChain.from_mjcf(path, actuated=[], contacts=True)
    mj = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    (theirs,) = data.contact
    (ours,) = chain.contacts
    assert ours.friction == (theirs.friction[0] if theirs.dim > 1 else 0.0)
