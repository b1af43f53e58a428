# SPDX-License-Identifier: BSD-2-Clause
"""URDF files as Drake, Gazebo and Bullet read them: motors, welds, defaults, almost XML."""

import warnings

import numpy as np
import pytest

import sst_pin

BODY = """<inertial><origin xyz="0 0 0.5"/><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
LIMIT = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'


def link(name: str, inside: str = BODY) -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(name: str, parent: str, child: str, xyz: str = "0 0 0", inside: str = LIMIT) -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
    return f'<joint name="{name}" type="revolute">{ends}<axis xyz="0 1 0"/>{inside}</joint>'


ARM = [link("base", ""), link("arm"), joint("hinge", "base", "arm")]
FOUR_BAR = [
    *map(link, ("base", "crank", "coupler", "rocker")),
    joint("a", "base", "crank"),
    joint("b", "crank", "coupler", "0 0 1"),
    joint("c", "base", "rocker", "1 0 0"),
]
CUT = """<constraint name="k" type="{}"><parent link="coupler"/><parent_origin xyz="1 0 0"/>
<child link="rocker"/><child_origin xyz="0 0 1"/></constraint>"""
TRANSMISSION = '<transmission name="t"><joint name="{}"/><actuator name="m"/></transmission>'


def read(folder, *parts: str) -> tuple[sst_pin.ClosedChain, list[str]]:
    """A robot and the texts of the warnings; `validate` has no errors and the same warnings."""
    path = folder / "r.urdf"
    text = (
        parts[0]
        if parts[0].lstrip().startswith("<?xml")
        else f'<robot name="r">{"".join(parts)}</robot>'
    )
    path.write_text(text)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        chain = sst_pin.ClosedChain.from_urdf(path)
    texts = [str(warning.message) for warning in caught]
    problems = sst_pin.validate(path)
    assert [str(problem) for problem in problems if problem.severity == "error"] == []
    for problem in problems:
        if problem.severity == "warning" and problem.where not in ("actuation", "home"):
            assert any(problem.text in text for text in texts)
    return chain, texts


@pytest.mark.parametrize(
    "driver",
    [
        TRANSMISSION.format("a"),
        '<ros2_control name="c" type="system"><joint name="a"><command_interface name="effort"/>'
        '</joint><joint name="b"><state_interface name="position"/></joint></ros2_control>',
        '<gazebo><plugin name="gz::sim::systems::JointPositionController"><joint_name> a '
        '</joint_name></plugin><plugin name="gz::sim::systems::JointStatePublisher"><joint_name>b'
        "</joint_name></plugin></gazebo>",
    ],
)
def test_transmissions_command_interfaces_and_controllers_name_the_motors(tmp_path, driver):
    chain, texts = read(tmp_path, *FOUR_BAR, CUT.format("spherical"), driver)
    assert chain.motor_names == ("a",)
    assert texts == []


def test_a_joint_that_follows_another_by_ros2_control_is_coupled_to_it(tmp_path):
    follows = '<param name="mimic">a</param><param name="multiplier">-2</param>'
    control = f'<ros2_control name="s"><joint name="c">{follows}</joint></ros2_control>'
    chain, _ = read(tmp_path, *FOUR_BAR, control)
    assert chain.motor_names == ("a", "b")
    q = chain.assemble({"a": 0.3, "b": 0.1})
    assert q[chain.joint_names.index("c")] == pytest.approx(-0.6, abs=1e-12)


def test_a_floating_base_has_no_motors_by_default(tmp_path):
    base = joint("base", "world", "arm", inside="").replace("revolute", "floating")
    floats = [link("world", ""), link("arm"), link("hand"), base, joint("j", "arm", "hand")]
    chain, _ = read(tmp_path, *floats)
    assert chain.motor_names == ("j",)
    assert not chain.mobility().sufficient


def test_links_without_a_joint_float_beside_the_world(tmp_path):
    """Beside a `world` of the file, and beside one that a joint names only."""
    floor = link("floor", "") + joint("weld", "world", "floor").replace("revolute", "fixed")
    for world in (link("world", ""), ""):
        chain, texts = read(
            tmp_path, world, floor, link("arm"), link("hand"), joint("j", "arm", "hand")
        )
        assert chain.joint_names == ("arm_floats", "j")
        assert (chain.degrees_of_freedom, chain.motor_names) == (7, ("j",))
        assert any("link arm: no joint holds it" in text for text in texts)


def test_the_joint_of_a_floating_link_has_a_name_of_its_own(tmp_path):
    arm = link("arm") + link("hand") + joint("arm_floats", "arm", "hand")
    chain, texts = read(tmp_path, link("world", ""), arm)
    assert chain.joint_names == ("arm_floats_", "arm_floats")
    assert any("it floats, by the joint arm_floats_" in text for text in texts)


@pytest.mark.parametrize("word", ["spherical", "spherical_joint", "ball"])
def test_a_ball_of_the_proposal_for_urdfdom_has_three_names(tmp_path, word):
    chain, _ = read(tmp_path, *FOUR_BAR, CUT.format(word), TRANSMISSION.format("a"))
    assert chain.degrees_of_freedom == 1
    assert chain.closures == (sst_pin.Closure("k_A", "k_B", "3d"),)


def test_a_detachable_joint_of_gazebo_is_a_weld(tmp_path):
    tip = link("tip", "") + joint("t", "rocker", "tip", "0 0 1")
    plugin = """<gazebo><plugin filename="libgz-sim-detachable-joint-system.so" name="d">
    <parent_link>tip</parent_link><child_model>r</child_model><child_link>coupler</child_link>
    </plugin></gazebo>"""
    chain, _ = read(tmp_path, *FOUR_BAR, tip, plugin)
    (weld,) = chain.closures
    assert (weld.kind, chain.degrees_of_freedom) == ("6d", 1)
    assert np.abs(chain.residual(np.zeros(4))).max() < 1e-15
    path = tmp_path / "r.urdf"
    path.write_text(path.read_text().replace("<child_model>r<", "<child_model>box<"))
    with pytest.raises(sst_pin.DescriptionError, match="a link of another model, 'box'"):
        sst_pin.ClosedChain.from_urdf(path)


def test_a_robot_without_any_mass_is_named(tmp_path):
    _, texts = read(tmp_path, link("base", ""), link("arm", ""), joint("hinge", "base", "arm"))
    assert any("links arm: no moving link has mass" in text for text in texts)


DECLARED = f'<?xml version="1.0"?><robot name="r">{"".join(ARM)}</robot>'
ALMOST = [
    ("\n" + DECLARED, "not XML"),
    (DECLARED.replace("<link", "<!-- a *---* b -->\n<link", 1), "not XML"),
    (DECLARED.replace("<axis", '<axis rpy="0 0 1"'), "axis rpy=... is not read"),
    (DECLARED.replace(LIMIT, ""), "joints hinge: no <limit>: read without limits"),
    (DECLARED.replace(' effort="1"', ""), "joints hinge: limit without effort: read as none"),
    (DECLARED.replace('lower="-3" upper="3" ', ""), "joints hinge: limit without lower and upper"),
    (DECLARED.replace(link("base", ""), "").replace('"base"', '"world"'), "link world: it is"),
]


@pytest.mark.parametrize(("text", "told"), ALMOST)
def test_files_that_other_tools_read_are_read_with_a_warning(tmp_path, text, told):
    chain, texts = read(tmp_path, text)
    assert sum(told in each for each in texts) == 1
    assert chain.compute_torques([np.pi / 2], [0], [1]) == pytest.approx(1.25 - 0.5 * 9.81)


@pytest.mark.parametrize("text", [DECLARED.replace("</robot>", ""), "\n" + DECLARED + "<a/>"])
def test_what_is_no_xml_at_all_has_the_fault_of_the_whole_file(tmp_path, text):
    path = tmp_path / "r.urdf"
    path.write_text(text)
    with pytest.raises(sst_pin.DescriptionError, match=r"not a URDF: not XML: .*line \d+"):
        sst_pin.ClosedChain.from_urdf(path)


def test_a_coupling_in_a_cycle_of_joints_is_refused(tmp_path):
    cycle = [joint("x", "crank", "coupler"), joint("y", "coupler", "crank")]
    gear = '<coupling name="g"><predecessor link="crank"/><successor link="rocker"/>'
    gear += '<ratio value="2"/></coupling>'
    links = map(link, ("base", "crank", "coupler", "rocker"))
    path = tmp_path / "r.urdf"
    text = "".join([*links, *cycle, joint("z", "base", "rocker"), gear])
    path.write_text(f'<robot name="r">{text}</robot>')
    with pytest.raises(sst_pin.DescriptionError, match="not connected to the base"):
        sst_pin.ClosedChain.from_urdf(path)
    assert any("a URDF is a tree" in problem.text for problem in sst_pin.validate(path))


UNIVERSAL = "name_mot: [hinge_Y]\njoint_type: {{hinge: universal {}}}\n{}"


@pytest.mark.parametrize(
    ("axes", "more", "limits", "told"),
    [
        ("xy", "", {"hinge_Y": (-2, 3)}, ""),
        ("zy", "", {"hinge_Y": (-2, 3)}, ""),
        ("xz", "", {}, "its limits of -2 to 3, effort 1, velocity 1 are not used"),
        ("xz", "joint_limit: {hinge_X: {lower: -1, upper: 1}}\n", {"hinge_X": (-1, 1)}, ""),
        ("xy", "joint_limit: {hinge_Y: {upper: 1}}\n", {"hinge_Y": (-2, 1)}, ""),
    ],
)
def test_limits_of_a_universal_joint_stay_with_their_axis(tmp_path, axes, more, limits, told):
    path = tmp_path / "r.urdf"
    text = "".join(ARM).replace("-3", "-2")
    path.write_text(f'<robot name="r">{text}</robot>')
    motors = UNIVERSAL.format(axes, more).replace("hinge_Y]", f"hinge_{axes[0].upper()}]")
    path.with_suffix(".yaml").write_text(motors)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = sst_pin.ClosedChain.from_urdf(path).model
    ends = zip(model.names[1:], model.lowerPositionLimit, model.upperPositionLimit, strict=True)
    finite = {name: (low, high) for name, low, high in ends if abs(low) < 1e9}
    assert finite == limits
    assert [told in str(warning.message) for warning in caught] == ([True] if told else [])
    problems = [p.text for p in sst_pin.validate(path) if p.where == "joint hinge"]
    assert len(problems) == bool(told)


@pytest.mark.filterwarnings("ignore::sst_pin.DescriptionWarning")
def test_a_joint_of_another_kind_may_have_any_name(tmp_path):
    """Also one with a quotation mark, such as of French."""
    path = tmp_path / "r.urdf"
    text = "".join(ARM).replace('"hinge"', '"axe d\'arm"')
    path.write_text(f'<robot name="r">{text}</robot>')
    path.with_suffix(".yaml").write_text("name_mot: []\njoint_type: {axe d'arm: ball}\n")
    model = sst_pin.ClosedChain.from_urdf(path).model
    assert (list(model.names)[1:], model.nv) == (["axe d'arm"], 3)
    assert any("its limits of -3 to 3 are not used" in p.text for p in sst_pin.validate(path))


@pytest.mark.parametrize(
    ("kind", "axis", "kept", "told"),
    [
        ("ball", "0 1 0", {"hinge_wy"}, ""),
        ("ball", "0 1 1", set(), "joint hinge: its limits effort 7, velocity 5 are not used"),
        ("universal XY", "0 -1 0", {"hinge_Y"}, ""),
        ("universal XZ", "0 1 0", set(), "joint hinge: its limits effort 7, velocity 5 are not"),
    ],
)
def test_limits_of_effort_and_velocity_stay_with_their_axis_or_are_named(
    tmp_path, kind, axis, kept, told
):
    """Half a turn to both sides, which is no limit of the position."""
    path = tmp_path / "r.urdf"
    wide = '<limit lower="-3.2" upper="3.2" effort="7" velocity="5"/>'
    hinge = joint("hinge", "base", "arm", inside=wide).replace("0 1 0", axis)
    path.write_text(f'<robot name="r">{link("base", "")}{link("arm")}{hinge}</robot>')
    path.with_suffix(".yaml").write_text(f"name_mot: []\njoint_type: {{hinge: {kind}}}\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = sst_pin.ClosedChain.from_urdf(path)
    model = robot.model
    for numbers, limit in ((model.effortLimit, 7), (model.velocityLimit, 5)):
        named = zip(robot.rate_names, numbers, strict=True)
        assert {name for name, value in named if value == limit} == kept
    assert [told in str(warning.message) for warning in caught] == ([True] if told else [])
