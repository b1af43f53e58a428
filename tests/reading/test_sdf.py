# SPDX-License-Identifier: BSD-2-Clause
"""An SDF is the robot that it describes: poses, reversed joints, loops, gravity."""

import warnings

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.reading import Urdf

LINK = """<link name="{name}"><pose{of}>{pose}</pose><inertial><pose>{at}</pose><mass>{mass}</mass>
<inertia><ixx>0.02</ixx><iyy>0.03</iyy><izz>0.025</izz><ixy>0.001</ixy></inertia></inertial></link>"""


def link(name: str, pose: str, of: str = "", at: str = "0.1 0 0.05 0.2 0.1 0", mass: float = 1.0):
    attribute = f' relative_to="{of}"' if of else ""
    return LINK.format(name=name, pose=pose, of=attribute, at=at, mass=mass)


def joint(name: str, kind: str, parent: str, child: str, inside: str = "") -> str:
    ends = f"<parent>{parent}</parent><child>{child}</child>"
    return f'<joint name="{name}" type="{kind}">{ends}{inside}</joint>'


def axis(xyz: str, more: str = "", tag: str = "axis", frame: str = "") -> str:
    attribute = f' expressed_in="{frame}"' if frame else ""
    return f"<{tag}><xyz{attribute}>{xyz}</xyz>{more}</{tag}>"


def sdf(*parts: str, pose: str = "0.1 0.2 0.3 0.3 -0.2 0.5", world: str = "") -> str:
    model = f'<model name="r"><pose>{pose}</pose>{"".join(parts)}</model>'
    return f'<sdf version="1.9"><world name="w">{world}{model}</world></sdf>'


TREE = [
    link("a", "0.1 0 0.2 0.1 0 0"),
    link("b", "0.2 0.1 0 0 0.3 0", of="a", mass=2.0),
    link("c", "0 0.3 0.1 0 0 0.4", of="j_b", mass=0.7),
    link("d", "0.3 -0.2 0.1 0.5 0 0", mass=1.3),
    joint("j_a", "revolute", "world", "a", "<pose>0 0 -0.1 0 0.2 0</pose>" + axis("0 0.6 0.8")),
    joint("j_b", "prismatic", "a", "b", axis("1 0 0.1")),
    # the next one is written from the far link to the near one
    joint("j_c", "revolute", "c", "b", axis("0 1 0", frame="__model__")),
    joint("weld", "fixed", "b", "d", '<pose relative_to="__model__">0 0 1 0 0 0</pose>'),
]


A, B = link("a", "0 0 0 0 0 0"), link("b", "0 0 0.3 0 0 0")


def write(text: str, tmp_path):
    path = tmp_path / "robot.sdf"
    path.write_text(text)
    return path


def chain_of(text: str, tmp_path, *motors: str) -> sst_pin.ClosedChain:
    return sst_pin.ClosedChain.from_urdf(write(text, tmp_path), actuated=motors)


@pytest.mark.tools
def test_a_tree_is_drakes(tmp_path):
    parsing = pytest.importorskip("pydrake.multibody.parsing", reason="Drake is the referee")
    plants = pytest.importorskip("pydrake.multibody.plant", reason="Drake is the referee")
    text = sdf(*TREE)
    plant = plants.MultibodyPlant(0.0)
    parsing.Parser(plant).AddModelsFromString(text, "sdf")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    chain = chain_of(text, tmp_path, "j_a", "j_b", "j_c")
    rng = np.random.default_rng(3)
    q, v, a = rng.normal(size=(3, 3)) * 0.5
    order = [plant.GetJointByName(name).velocity_start() for name in chain.joint_names]
    for mine, theirs in ((q, plant.SetPositions), (v, plant.SetVelocities)):
        values = np.zeros(3)
        values[order] = mine
        theirs(context, values)
    for name in "abcd":
        body = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name))
        position, R = chain.frame_placement(q, name)
        np.testing.assert_allclose(position, body.translation(), atol=1e-12)
        np.testing.assert_allclose(R, body.rotation().matrix(), atol=1e-12)
    from pydrake.multibody.tree import MultibodyForces

    forces = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    values = np.zeros(3)
    values[order] = a
    expected = plant.CalcInverseDynamics(context, values, forces)[order]
    chain.model.gravity.linear = plant.gravity_field().gravity_vector()
    chain.refresh()
    np.testing.assert_allclose(chain.compute_torques(q, v, a), expected, rtol=1e-11)


FIVE_BAR = [
    link("left", "-0.1 0 0 0 0 0", at="0 0 0.1 0 0 0"),
    link("left_rod", "-0.1 0 0.2 0 0.5 0", at="0 0 0.15 0 0 0"),
    link("right", "0.1 0 0 0 0 0", at="0 0 0.1 0 0 0"),
    link("right_rod", "0.1 0 0.2 0 -0.5 0", at="0 0 0.15 0 0 0"),
    joint("m1", "revolute", "world", "left", axis("0 1 0")),
    joint("e1", "revolute", "left", "left_rod", axis("0 1 0")),
    joint("m2", "revolute", "world", "right", axis("0 1 0")),
    joint("e2", "revolute", "right", "right_rod", axis("0 1 0")),
]
TIP = joint("tip", "{}", "left_rod", "right_rod", f"<pose>0 0 {0.1 / np.sin(0.5)} 0 0 0</pose>{{}}")


@pytest.mark.parametrize(("kind", "inside"), [("ball", ""), ("continuous", axis("0 2 0"))])
def test_a_link_with_two_parents_closes_a_loop(kind, inside, tmp_path):
    text = sdf(*FIVE_BAR, TIP.format(kind, inside), pose="0 0 0 0 0 0")
    chain = chain_of(text, tmp_path, "m1", "m2")
    assert chain.mobility().degrees_of_freedom == 2
    assert abs(chain.residual(np.zeros(4))).max() < 1e-15
    q = chain.assemble({"m1": 0.1, "m2": -0.2})
    # by energy: the power of the motors is that of gravity in a motion without acceleration
    tau = chain.compute_torques(q, [0, 0], [0, 0])
    heights = []
    for step in (-1e-5, 1e-5):
        at = chain.assemble({"m1": 0.1 + step, "m2": -0.2})
        data = chain.model.createData()
        heights.append(pin.computePotentialEnergy(chain.model, data, at))
    assert tau[0] == pytest.approx((heights[1] - heights[0]) / 2e-5, rel=1e-7)


def test_the_order_of_joints_and_their_direction_do_not_count(tmp_path):
    parts = closing("")
    chain = chain_of(sdf(*parts, pose="0 0 0 0 0 0"), tmp_path, "m1", "m2")
    turned = [part for part in parts if 'name="e1"' not in part]
    place = '<pose relative_to="left_rod">0 0 0 0 0 0</pose>'
    turned.insert(0, joint("e1", "revolute", "left_rod", "left", place + axis("0 -1 0")))
    again = chain_of(sdf(*turned, pose="0 0 0 0 0 0"), tmp_path, "m1", "m2")
    q, p = (each.assemble({"m1": 0.1, "m2": -0.2}) for each in (chain, again))
    for name in chain.joint_names:  # turned about the opposite axis, seen from the other link
        k, m = chain.joint_names.index(name), again.joint_names.index(name)
        assert q[k] == pytest.approx(p[m], abs=1e-12)
    tau = chain.compute_torques(q, [0.3, 0.2], [1, 2])
    np.testing.assert_allclose(again.compute_torques(p, [0.3, 0.2], [1, 2]), tau, rtol=1e-11)


def test_what_the_reader_makes_of_two_axes_is_no_problem_of_the_file(tmp_path):
    limit = "<limit><lower>-1</lower><upper>1</upper></limit>"
    axes = axis("1 0 0", limit) + axis("0 1 0", limit, tag="axis2")
    path = write(sdf(A, joint("u", "universal", "world", "a", axes)), tmp_path)
    assert sst_pin.validate(path) == []


@pytest.mark.parametrize("ends", [("world", "a"), ("a", "world")])
def test_springs_act_about_the_axis_also_if_the_joint_is_reversed(tmp_path, ends):
    """Torque k (q - reference) beside that of a robot without springs."""
    spring = SPRING.replace("</dyn", "<spring_reference>0.2</spring_reference></dyn")
    free, sprung = (
        chain_of(sdf(A, joint("j", "revolute", *ends, axis("0 0.6 0.8", inside))), tmp_path, "j")
        for inside in ("", spring)
    )
    q, v, a = np.array([[0.7], [-0.4], [1.3]])
    more = sprung.compute_torques(q, v, a) - free.compute_torques(q, v, a)
    np.testing.assert_allclose(more, [3 * (0.7 - 0.2)], rtol=1e-12)


def test_a_model_that_nothing_holds_floats_and_gravity_is_the_worlds(tmp_path):
    text = sdf(A, world="<gravity>0 1.62 0</gravity>")
    chain = chain_of(text, tmp_path)
    assert chain.joint_names == ("floating_base",)
    R = pin.rpy.rpyToMatrix(0.3, -0.2, 0.5)  # of the model
    falls = chain.compute_accelerations(pin.neutral(chain.model), np.zeros(6), [])
    np.testing.assert_allclose(R @ falls[:3], [0, 1.62, 0], atol=1e-12)
    np.testing.assert_allclose(falls[3:], np.zeros(3), atol=1e-12)
    old = sdf(A, world="<physics><gravity>0 1.62 0</gravity></physics>").replace("1.9", "1.4")
    chain = chain_of(old, tmp_path)
    np.testing.assert_array_equal(chain.model.gravity.linear, [0, 1.62, 0])


def test_names_of_the_file_stand_where_the_reader_would_take_them(tmp_path):
    """A joint as a floating base would be named, a frame as a link before an offset hinge."""
    offset = "<pose>0 0 0.1 0 0 0</pose>"
    hinge = joint("floating_base", "continuous", "a", "b", offset + axis("0 1 0"))
    frame = '<frame name="b_at_floating_base" attached_to="a"><pose>0 0 2 0 0 0</pose></frame>'
    chain = chain_of(sdf(A, B, hinge, frame, pose="0 0 0 0 0 0"), tmp_path)
    assert chain.joint_names == ("floating_base_", "floating_base")
    position, _ = chain.frame_placement(pin.neutral(chain.model), "b_at_floating_base")
    np.testing.assert_allclose(position, [0, 0, 2], atol=1e-15)


@pytest.mark.filterwarnings("ignore:.*no configuration is named home")
def test_limits_friction_and_mimicry_are_those_of_the_axis(tmp_path):
    limits = "<limit><lower>-0.5</lower><upper>0.7</upper><effort>9</effort></limit>"
    rubs = "<dynamics><damping>0.3</damping><friction>0.2</friction></dynamics>"
    follows = '<mimic joint="j_a"><multiplier>2</multiplier><offset>0.1</offset>'
    follows += "<reference>0.3</reference></mimic>"
    j_a = joint("j_a", "revolute", "world", "a", axis("1 0 0", limits + rubs))
    j_b = joint("j_b", "revolute", "a", "b", axis("1 0 0", follows))
    chain = chain_of(sdf(A, B, j_a, j_b), tmp_path, "j_a")
    model = chain.model
    assert (model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (-0.5, 0.7)
    assert (model.damping[0], model.friction[0], model.effortLimit[0]) == (0.3, 0.2, 9)
    q = chain.assemble({"j_a": 0.4})
    assert q[1] == pytest.approx(2 * (0.4 - 0.3) + 0.1, abs=1e-12)


@pytest.mark.filterwarnings("ignore:.*no configuration is named home")
def test_a_mimic_of_drake_is_multiplier_times_the_leader_plus_offset(tmp_path):
    follows = '<drake:mimic joint="j_a" multiplier="{}" offset="0.1"/>'
    same = '<mimic joint="j_a"><multiplier>2</multiplier><offset>0.1</offset></mimic>'
    j_a = joint("j_a", "revolute", "world", "a", axis("1 0 0"))
    j_b = joint("j_b", "revolute", "a", "b", axis("1 0 0", same) + follows)
    for parts in (j_b, j_b.replace(same, "")):
        chain = chain_of(sdf(A, B, j_a, parts.format(2)), tmp_path, "j_a")
        assert chain.assemble({"j_a": 0.4})[1] == pytest.approx(2 * 0.4 + 0.1, abs=1e-12)
    for multiplier, told in (("3", "differ"), ("two", "'two'> is not a number")):
        with pytest.raises(sst_pin.DescriptionError, match=told):
            chain_of(sdf(A, B, j_a, j_b.format(multiplier)), tmp_path)


@pytest.mark.parametrize(
    ("follows", "told"),
    [
        ('<drake:mimic joint="j_a" multiplyer="2"/>', "multiplyer=...> is unknown; did you mean"),
        ('<drake:mimic joint="j_a" reference="1"/>', "<drake:mimic> has no reference"),
        ('<mimic joint="j_a"><multiplyer>2</multiplyer></mimic>', "<multiplyer> is unknown; did"),
        ('<mimic joint="j_a" multiplier="2"/>', "<mimic> has no multiplier; it has joint, axis"),
    ],
)
def test_what_a_mimic_does_not_have_is_refused(follows, told, tmp_path):
    in_axis = follows if follows.startswith("<mimic") else ""
    j_a = joint("j_a", "revolute", "world", "a", axis("1 0 0"))
    j_b = joint("j_b", "revolute", "a", "b", axis("1 0 0", in_axis) + follows * (not in_axis))
    with pytest.raises(sst_pin.DescriptionError, match=told):
        chain_of(sdf(A, B, j_a, j_b), tmp_path)


@pytest.mark.parametrize(
    ("in_axis", "in_joint", "told"),
    [
        ('<drake:mimic joint="j_a" multiplier="2"/>', "", "joint j_b: <drake:mimic> is not read"),
        ("", '<mimic joint="j_a"/>', "joint j_b: <mimic> is not read; put it into <axis>"),
    ],
)
def test_a_mimic_in_the_wrong_place_has_a_note(in_axis, in_joint, told, tmp_path):
    j_a = joint("j_a", "revolute", "world", "a", axis("1 0 0"))
    j_b = joint("j_b", "revolute", "a", "b", axis("1 0 0", in_axis) + in_joint)
    with pytest.warns(sst_pin.DescriptionWarning, match=told):
        chain_of(sdf(A, B, j_a, j_b), tmp_path, "j_a")


def test_a_frame_that_is_missing_is_named_once(tmp_path):
    """Several poses may be relative to it."""
    links = [link(name, "0 0 0 0 0 0", of="ghost") for name in "ab"]
    with pytest.raises(sst_pin.DescriptionError) as caught:
        Urdf.read(write(sdf(*links), tmp_path))
    assert caught.value.problems == ["frame ghost is not in this model"]


DECAY = "<velocity_decay><linear>.5</linear></velocity_decay>"
SPRING = "<dynamics><spring_stiffness>3</spring_stiffness></dynamics>"
LIMITS = "<limit><lower>2</lower><upper>1</upper></limit>"
RUBS = "<dynamics><damping>3</damping></dynamics>"
FOLLOWS = '<mimic joint="m1"/>'
WATER = "gz::sim::systems::Hydrodynamics"
FRAME_A = "<drake:bushing_frameA> a </drake:bushing_frameA>"
BUSHING = f"<drake:linear_bushing_rpy>{FRAME_A}</drake:linear_bushing_rpy>"
ROTOR = "<drake:rotor_inertia>0.1</drake:rotor_inertia>"


def turning(inside: str = "", xyz: str = "0 0 1", kind: str = "revolute") -> list[str]:
    """A link on a joint with some contents of its axis."""
    return [A, joint("j", kind, "world", "a", axis(xyz, inside))]


def closing(inside: str) -> list[str]:
    """A five-bar with some contents of the axis that closes its loop."""
    return [*FIVE_BAR, TIP.format("revolute", axis("0 1 0", inside))]


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ([link("a", "0 0 0 0 0")], "link a: its pose '0 0 0 0 0' is not six or seven numbers"),
        ([link("a", "0 0 0 0 0 0", of="b")], "frame b is not in this model"),
        ([link("a", "0 0 0 0 0 0", of="a")], "frame a: its pose is relative to itself"),
        ([A, joint("j", "rack", "world", "a")], "joint j: type 'rack' is not supported; suppor"),
        ([A, joint("j", "revolute", "world", "nine")], "joint j: its child 'nine' is not a link"),
        (turning(xyz="0 0 0"), "joint j: its <axis> is not a direction"),
        ([A, "<include/>"], "<include> : parts of a model in other files are not supported"),
        (
            [A.replace("<pose>", '<pose frame="b">', 2)],
            "link a: its <pose> of inertial relative to b is not",
        ),
        ([A.replace("<inert", "<kinematic>1</kinematic><inert", 1)], "link a: a kinematic link"),
        (
            [A.replace("<inertial", '<inertial auto="True"')],
            "link a: the inertia of shapes",
        ),
        ([A, A], "link a: 2 have this name"),
        ([A, '<frame name="f" attached_to="b"/>'], "frame f: it is not attached to a link of"),
        ([A, '<frame name="f" attached_to="f"/>'], "frame f: it is not attached to a link of"),
        ([A, *[joint("j", "fixed", "world", "a")] * 2], "joint j: 2 have this name"),
        (turning(RUBS, kind="ball"), "j: ball, and does not have the axis of its axis/dynamics/da"),
        (closing(FOLLOWS), "joint tip: closes a loop and has mimic"),
        (closing(SPRING), "joint tip: closes a loop and has spring_stiffness"),
        (turning(LIMITS), "joint j: its lower limit is above the upper one"),
        (
            [A, B, joint("u", "universal", "world", "a"), joint("u_1", "fixed", "a", "b")],
            "joint u: a part of it gets the name u_1, which another joint has",
        ),
    ],
)
def test_faults_are_told_with_the_element(parts, told, tmp_path):
    path = write(sdf(*parts), tmp_path)
    with pytest.raises(sst_pin.DescriptionError, match=told.replace("(", r"\(")):
        Urdf.read(path)
    assert any(told in str(problem) for problem in sst_pin.validate(path))


def test_axes_are_in_the_joints_frame_since_version_1_5(tmp_path):
    j_a = joint("j_a", "revolute", "world", "a", axis("1 0 0"))
    j_b = joint("j_b", "revolute", "a", "b", axis("0 0 1"))
    text, tilted = sdf(A, link("b", "0 0 0.3 0.4 0 0"), j_a, j_b), []
    for version in ("1.4", "1.5", "1.9", "1.10", "1.12"):
        chain = chain_of(text.replace("1.9", version), tmp_path, "j_a", "j_b")
        turns = chain.frame_jacobian(np.zeros(2), "b")[3:]
        tilted.append(turns[:, 0] @ np.cross(turns[:, 1], [0.3, -0.2, 0.5]))
    assert tilted[0] != pytest.approx(tilted[1])
    assert tilted[1:] == pytest.approx([tilted[1]] * 4)


def test_the_placement_frame_of_a_model_stands_where_its_pose_says(tmp_path):
    """Degrees in any spelling of true; the links' frames are those of their joints."""
    parts = [
        link("a", "0 0 0.3 0.1 0 0"),
        link("b", "0 0.2 0.5 0.1 0.2 0.3"),
        joint("j_a", "revolute", "world", "a", axis("0 1 0")),
        joint("j_b", "revolute", "a", "b", axis("1 0 0")),
    ]
    text = sdf(*parts, pose="1 2 3 0 90 30").replace('name="r"', 'name="r" placement_frame="b"')
    text = text.replace("<pose>1 2", '<pose degrees="True">1 2')
    chain = chain_of(text, tmp_path)
    data = chain.model.createData()
    pin.framesForwardKinematics(chain.model, data, np.zeros(2))
    result = data.oMf[chain.model.getFrameId("b")]
    np.testing.assert_allclose(result.translation, [1, 2, 3], atol=1e-12)
    R = pin.rpy.rpyToMatrix(0, np.pi / 2, np.pi / 6)
    np.testing.assert_allclose(result.rotation, R, atol=1e-12)


def test_a_joint_written_from_far_to_near_keeps_its_limits(tmp_path):
    """Its position is the turn of its child in its parent, whichever of them comes first."""
    limits = "<limit><lower>-0.2</lower><upper>0.7</upper></limit>"
    turn = joint("j", "revolute", "b", "a", axis("1 0 0", limits))
    parts = A, link("b", "0 0 0 0 0 0"), joint("weld", "fixed", "world", "a"), turn
    model = chain_of(sdf(*parts), tmp_path).model
    assert (model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (-0.2, 0.7)
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array([0.7]))
    a, b = (data.oMf[model.getFrameId(name)].rotation for name in "ab")
    np.testing.assert_allclose(pin.log3(b.T @ a), [0.7, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (sdf("").replace("1.9", "1.x"), "version '1.x' is none of SDF"),
        (sdf(A, world="<gravity>0 down 0</gravity>"), "gravity '0 down 0' is not three numbers"),
        ('<sdf version="1.7"/>', "no model that moves; one is needed"),
        (sdf(A).replace("</sdf>", '<world name="v"/></sdf>'), "2 worlds; one is needed"),
    ],
)
def test_a_world_that_cannot_be_meant_is_refused(text, told, tmp_path):
    with pytest.raises(sst_pin.DescriptionError, match=told):
        Urdf.read(write(text, tmp_path))


def told_of(text: str, tmp_path) -> tuple[sst_pin.ClosedChain, str]:
    """A robot, and the texts of its warnings; `validate` has them too, and no errors."""
    path = write(text, tmp_path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        chain = sst_pin.ClosedChain.from_urdf(path)
    texts = "\n".join(str(warning.message) for warning in caught)
    problems = sst_pin.validate(path)
    assert not [p for p in problems if p.severity == "error"]
    assert all(p.text in texts for p in problems if p.severity == "warning" and "link" in p.where)
    return chain, texts


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<inert", f"{DECAY}<inert", "link a: <velocity_decay/linear> is not read"),
        ("<mass", "<fluid_added_mass/><mass", "link a: <fluid_added_mass> is not read"),
        ("<inert", "<enable_wind>1</enable_wind><inert", "model: wind is not read"),
        ("</link>", f'</link><plugin name="{WATER}"/>', f"plugin {WATER} is not read"),
        (
            '"a"><pose>',
            '"a"><pose relative_to="world">',
            "link a: its pose is relative to the world",
        ),
        ("<axis><xyz>0 0 1</xyz></axis>", "", "joint j: revolute without <axis>"),
        ("</model>", "</model><include><uri>box</uri></include>", "in <world>: box is not read"),
        ("</link>", f"</link>{BUSHING}", "<drake:linear_bushing_rpy>: of a is not read"),
        ("<axis>", f"{ROTOR}<axis>", "joint j: <drake:rotor_inertia> is not read"),
        ("<axis>", '<tool:spring k="3"/><axis>', "joint j: <tool:spring> is not read"),
        ("<inert", "<gravity>false</gravity><inert", ""),
    ],
)
def test_what_acts_in_other_tools_and_is_not_read_is_named(old, new, told, tmp_path):
    text = sdf(*turning())
    assert old in text
    chain, texts = told_of(text.replace(old, new, 1), tmp_path)
    assert told in texts
    assert chain.model.gravity.linear.any() == bool(told)


@pytest.mark.parametrize("end", ["lower", "upper"])
def test_limits_of_a_joint_that_closes_a_loop_are_named(end, tmp_path):
    _, texts = told_of(sdf(*closing(f"<limit><{end}>0</{end}></limit>")), tmp_path)
    assert "joint tip: limits of a joint that closes a loop are ignored" in texts


def test_a_link_without_numbers_has_those_of_the_specification(tmp_path):
    text = sdf("<link name='a'/>", joint("j", "revolute", "world", "a", axis("0 1 0")))
    chain, texts = told_of(text, tmp_path)
    assert "links a: no mass, inertia/ixx, inertia/iyy, inertia/izz: 1 kg and the unit" in texts
    assert chain.model.inertias[1].mass == 1
    np.testing.assert_allclose(chain.compute_torques([0.3], [0], [2]), [2.0], rtol=1e-12)


def test_a_model_of_several_is_chosen_by_name(tmp_path):
    text = sdf(*turning()).replace("</world>", '<model name="s"><link name="b"/></model></world>')
    path = write(text, tmp_path)
    with pytest.raises(sst_pin.DescriptionError, match="2 models that move: r, s; model= chooses"):
        sst_pin.ClosedChain.from_urdf(path)
    with pytest.raises(sst_pin.DescriptionError, match="0 models are named t; the models are r, s"):
        sst_pin.ClosedChain.from_urdf(path, model="t")
    assert sst_pin.ClosedChain.from_urdf(path, model="r", actuated=["j"]).joint_names == ("j",)
    assert [p for p in sst_pin.validate(path, model="r") if p.severity == "error"] == []


SCREW = "<{}>{}</{}>" + axis("0 0 1", RUBS)


@pytest.mark.parametrize(
    ("tag", "pitch", "lead"),
    [("screw_thread_pitch", 0.02, 0.02), ("thread_pitch", -100, 0.02 * np.pi)],
)
@pytest.mark.parametrize("ends", [("world", "a"), ("a", "world")])
def test_a_nut_advances_by_its_lead_in_each_turn(tag, pitch, lead, ends, tmp_path):
    """Over several turns; the torque that holds it is weight times lead by angle."""
    inside = "<pose>0 0 0 0 0 0</pose>" + SCREW.format(tag, pitch, tag)
    parts = link("a", "0 0 1 0 0 0", at="0 0 0 0 0 0", mass=3.0), joint("j", "screw", *ends, inside)
    chain, _ = told_of(sdf(*parts, pose="0 0 0 0 0 0"), tmp_path)
    assert (chain.motor_names, chain.degrees_of_freedom) == (("j",), 1)
    angle = 5 * 2 * np.pi + 0.3
    q = chain.assemble({"j": angle})
    sense = 1 if ends[0] == "world" else -1
    height = 1 + sense * lead * angle / (2 * np.pi)
    np.testing.assert_allclose(chain.frame_placement(q, "a")[0], [0, 0, height], atol=1e-12)
    tau = chain.compute_torques(q, [0], [0])
    np.testing.assert_allclose(tau, [sense * 3 * 9.81 * lead / (2 * np.pi)], rtol=1e-12)


@pytest.mark.parametrize("ends", [("world", "b"), ("b", "world")])
@pytest.mark.parametrize("second", ["0 0 1", "0 0 -1"])
def test_a_gear_box_turns_its_child_against_its_parent(ends, second, tmp_path):
    """theta_2 = -ratio theta_1, both from the reference body about the axes of the gear box."""
    gear = "<gearbox_ratio>3</gearbox_ratio><gearbox_reference_body>base</gearbox_reference_body>"
    gear += axis("0 0 1") + axis(second, tag="axis2")
    base = link("base", "0 0 0 0 0 0"), joint("w", "fixed", "world", "base")
    ends = tuple("base" if end == "world" else end for end in ends)
    hinges = (
        joint("j_a", "revolute", "base", "a", axis("0 0 1")),
        joint("j_b", "revolute", *ends, axis("0 0 1")),
    )
    text = sdf(
        *base,
        A,
        link("b", "1 0 0 0 0 0"),
        *hinges,
        joint("g", "gearbox", "a", "b", gear),
        pose="0 0 0 0 0 0",
    )
    chain, _ = told_of(text, tmp_path)
    assert chain.motor_names == ("j_a",)
    q = chain.assemble({"j_a": 0.2})
    _, R = chain.frame_placement(q, "b")
    theta_2 = -3 * 0.2 * (1 if second == "0 0 1" else -1)
    np.testing.assert_allclose(pin.log3(R), [0, 0, theta_2], atol=1e-12)


def test_models_in_other_models_are_parts_of_them(tmp_path):
    """Each link, joint and axis stands where poses composed by hand put it; depth two."""
    hand_pose, arm_pose, link_pose = "0.1 0 0.2 0.3 0 0", "0.2 0.3 0 0 0.4 0.5", "0 0.1 0 0.2 0 0.1"
    finger = link("tip", link_pose, mass=0.4)
    finger += joint("bend", "revolute", "palm", "tip", axis("0 1 0", frame="__model__"))
    hand = f'<model name="hand"><pose>{hand_pose}</pose>{link("palm", "0 0 0.05 0 0 0")}{finger}'
    hand += '<frame name="grip" attached_to="tip"><pose>0 0 0.3 0 0 0</pose></frame></model>'
    arm = f'<model name="arm" canonical_link="upper"><pose relative_to="base">{arm_pose}</pose>'
    arm += link("upper", "0.1 0 0 0 0 0") + hand
    arm += joint("wrist", "revolute", "upper", "hand::palm", axis("0 0 1")) + "</model>"
    nested = [link("base", "0 0 0.5 0 0 0.2"), arm]
    nested.append(joint("shoulder", "revolute", "base", "arm::upper", axis("1 0 0", frame="arm")))

    def place(text):
        values = np.array(text.split(), dtype=float)
        return pin.SE3(pin.rpy.rpyToMatrix(*values[3:]), values[:3])

    def text(at):
        numbers = np.concatenate([at.translation, pin.rpy.matrixToRpy(at.rotation)])
        return " ".join(map(repr, numbers.tolist()))

    base = place("0 0 0.5 0 0 0.2")
    in_arm = base * place(arm_pose)
    in_hand = in_arm * place(hand_pose)
    tip = in_hand * place(link_pose)
    upper = in_arm * place("0.1 0 0 0 0 0")
    bend = tip.rotation.T @ in_hand.rotation @ [0, 1, 0]
    shoulder = upper.rotation.T @ in_arm.rotation @ [1, 0, 0]
    flat = [
        link("base", text(base)),
        link("arm::upper", text(upper)),
        link("arm::hand::palm", text(in_hand * place("0 0 0.05 0 0 0"))),
        link("arm::hand::tip", text(tip), mass=0.4),
        joint("shoulder", "revolute", "base", "arm::upper", axis(" ".join(map(str, shoulder)))),
        joint("arm::wrist", "revolute", "arm::upper", "arm::hand::palm", axis("0 0 1")),
        joint(
            "arm::hand::bend",
            "revolute",
            "arm::hand::palm",
            "arm::hand::tip",
            axis(" ".join(map(str, bend))),
        ),
    ]
    fixed = joint("fixed", "fixed", "world", "base")
    chains = []
    for name, parts in (("nested", nested), ("flat", flat)):
        path = tmp_path / f"{name}.sdf"
        path.write_text(sdf(*parts, fixed))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            chains.append(sst_pin.ClosedChain.from_urdf(path))
    inner, outer = chains
    assert set(inner.joint_names) == set(outer.joint_names)
    random = np.random.default_rng(0)
    q, va, aa = random.normal(size=(3, 3))
    order = [outer.joint_names.index(name) for name in inner.joint_names]
    torques = outer.compute_torques(q, va, aa)[order]
    assert inner.compute_torques(q[order], va[order], aa[order]) == pytest.approx(torques, rel=1e-9)
    grip, _ = inner.frame_placement(q[order], "arm::hand::grip")
    p, R = outer.frame_placement(q, "arm::hand::tip")
    assert grip == pytest.approx(p + R @ [0, 0, 0.3], abs=1e-12)


def test_what_inner_models_cannot_be_is_named(tmp_path):
    path = tmp_path / "r.sdf"
    inner = f"<static>true</static>{link('a', '0 0 0 0 0 0')}"
    inner = f'<model name="x" placement_frame="a">{inner}</model>'
    path.write_text(sdf(link("b", "0 0 0 0 0 0"), inner))
    with pytest.raises(sst_pin.DescriptionError) as caught:
        sst_pin.ClosedChain.from_urdf(path)
    assert "placement_frame of an inner model" in str(caught.value)
    assert "an inner model that is static" in str(caught.value)


def test_a_link_without_gravity_has_no_weight(tmp_path):
    """In a world with another gravity, and with a joint that is not at the link's origin.

    The referee has two parts: Pinocchio's torques without gravity, and those at rest of the robot
    whose link has no mass.
    """
    at_b = "<pose>0.1 0 0.05 0.2 0 0</pose>" + axis("0 1 0")
    text = sdf(
        link("a", "0 0 0 0 0 0", mass=2.0),
        link("b", "0.3 0 0 0.2 0.3 0.4", at="0.05 0.02 0.1 0 0 0", mass=1.5),
        joint("j_a", "revolute", "world", "a", axis("0.6 0.8 0")),
        joint("j_b", "revolute", "a", "b", at_b),
        world="<gravity>0.5 0 -3.7</gravity>",
    )
    motors = ("j_a", "j_b")
    q, va, aa = np.random.default_rng(1).normal(size=(3, 2))
    weightless = text.replace("<gravity>0.5 0 -3.7</gravity>", "<gravity>0 0 0</gravity>")
    light = text.replace("<mass>1.5</mass>", "<mass>1e-12</mass>")
    chain = chain_of(weightless, tmp_path, *motors)
    expected = pin.rnea(chain.model, chain.model.createData(), q, va, aa)
    expected += chain_of(light, tmp_path, *motors).compute_torques(q, [0, 0], [0, 0])

    start = text.index("<inertial>", text.index('<link name="b"'))
    text = text[:start] + "<gravity>false</gravity>" + text[start:]
    chain = chain_of(text, tmp_path, *motors)
    np.testing.assert_allclose(chain.compute_torques(q, va, aa), expected, atol=1e-10)


def test_a_detachable_joint_of_gazebo_is_a_fixed_joint(tmp_path):
    """A four-bar; the plugin and a joint of the file hold the same links, in the same pose."""
    bars = [
        *(link(name, pose) for name, pose in (("a", "0 0 0 0 0 0"), ("b", "0 0 1 0 0.2 0"))),
        *(link(name, pose) for name, pose in (("c", "1 0 0 0 0 0"), ("tip", "1 0 1.1 0 0 0.3"))),
        *(joint(f"j_{x}", "revolute", "world", x, axis("0 1 0", frame="__model__")) for x in "ac"),
        joint("j_b", "revolute", "a", "b", axis("0 1 0", frame="__model__")),
        joint("j_tip", "revolute", "c", "tip", axis("0 1 0", frame="__model__")),
    ]
    text = "<parent_link>b</parent_link><child_model>{}</child_model><child_link>{}</child_link>"
    plugin = f'<plugin name="gz::sim::systems::DetachableJoint">{text}</plugin>'
    welded = chain_of(sdf(*bars, joint("weld", "fixed", "b", "tip")), tmp_path, "j_a")
    for model in ("r", "__model__"):
        chain = chain_of(sdf(*bars, plugin.format(model, "tip")), tmp_path, "j_a")
        assert chain.degrees_of_freedom == 1
        q = chain.assemble({"j_a": 0.2})
        f = welded.compute_torques(welded.assemble({"j_a": 0.2}), [0.3], [0.5])
        assert np.abs(chain.compute_torques(q, [0.3], [0.5]) - f).max() < 1e-11 * np.abs(f).max()
    with pytest.raises(sst_pin.DescriptionError, match="'no' is not a link of this model"):
        chain_of(sdf(*bars, plugin.format("r", "no")), tmp_path)
    with pytest.warns(sst_pin.DescriptionWarning, match="DetachableJoint is not read"):
        chain_of(sdf(*bars, plugin.format("box", "tip")), tmp_path, "j_a")


def test_a_ball_constraint_of_drake_holds_points_of_two_links_together(tmp_path):
    bars = [
        *(link(name, pose) for name, pose in (("a", "0 0 0 0 0 0"), ("b", "0 0 1 0 0.2 0"))),
        link("c", "1 0 0 0 0.4 0"),
        *(joint(f"j_{x}", "revolute", "world", x, axis("0 1 0", frame="__model__")) for x in "ac"),
        joint("j_b", "revolute", "a", "b", axis("0 1 0", frame="__model__")),
    ]
    points = {"b": np.array([0.9, 0.1, 0.2]), "c": np.array([0.1, 0.1, 0.8])}
    tag = "drake:ball_constraint"
    parts = [("body_A", "b"), ("p_AP", "0.9 0.1 0.2"), ("body_B", "c"), ("p_BQ", "0.1 0.1 0.8")]
    ball = "".join(f"<{tag}_{part}>{text}</{tag}_{part}>" for part, text in parts)
    text = sdf(*bars, f"<{tag}>{ball}</{tag}>")
    chain = chain_of(text, tmp_path, "j_a")
    assert [closure.kind for closure in chain.closures] == ["3d"]
    q = chain.generic_configuration()
    ends = []
    for name, point in points.items():
        place, rotation = chain.frame_placement(q, name)
        ends.append(place + rotation @ point)
    assert np.abs(ends[0] - ends[1]).max() < 1e-12
    with pytest.raises(sst_pin.DescriptionError, match="no is not a link"):
        chain_of(text.replace("_body_B>c<", "_body_B>no<"), tmp_path)
