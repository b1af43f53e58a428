# SPDX-License-Identifier: BSD-2-Clause
"""Every fault of a description is found, all at once, and nothing else."""

import re
import warnings
from pathlib import Path

import pytest

import sst_pin
from sst_pin.cli import main
from tests.support.command_line import BARS

EXAMPLES = Path(__file__).parents[2] / "examples"
URDF, CUTS = (EXAMPLES / "delta.urdf").read_text(), (EXAMPLES / "delta.yaml").read_text()


@pytest.fixture
def found(tmp_path):
    """Problems of an edited delta."""

    def validate(urdf=URDF, cuts=CUTS):
        (tmp_path / "delta.urdf").write_text(urdf)
        (tmp_path / "delta.yaml").write_text(cuts)
        return sst_pin.validate(tmp_path / "delta.urdf")

    return validate


def element(text, tag, name):
    """The source of a named link or joint."""
    return re.search(rf'  <{tag} name="{name}".*?</{tag}>\n', text, re.DOTALL)[0]


def edited(tag, name, old, new):
    """The delta with a change in one link or joint."""
    source = element(URDF, tag, name)
    assert old in source
    return URDF.replace(source, source.replace(old, new, 1))


@pytest.mark.parametrize("path", [sst_pin.URDF_PATH, EXAMPLES / "delta.urdf"])
def test_the_shipped_robots_have_no_problems(path):
    assert sst_pin.validate(path) == []


ARM = '<inertia ixx="2e-05" ixy="0" ixz="0" iyy="0.00025" iyz="0" izz="0.00025"/>'
SPHERE = '<visual><origin xyz="{}"/><geometry><sphere radius="{}"/></geometry></visual>'
MESH = '<visual><geometry><mesh filename="{}"/></geometry></visual>'


#: What is changed in the joint motor_2, and what is said of it; see test_unreadable.py as well.
OF_THE_JOINT = [
    ('"base"', '"bass"', "error: joint motor_2: parent bass is no"),
    ('<parent link="base"/>', "", "error: joint motor_2: no <parent"),
    ('"arm_2"', '"arm_1"', "link arm_1 is already the child of joint motor_1"),
    ('"arm_2"', '"arm_1"', "error: tree: 2 links without a parent"),
    ('"revolute"', '"floating"', "motor_2: floating: q has one more"),
    ('"revolute"', '"continuous"', "note: joint motor_2: continuous: two coordinates"),
    ("0 1 0", "0 2 0", "warning: joint motor_2: its axis has length"),
    ('lower="-3.2" upper="3.2" ', "", "note: joint motor_2: limits"),
    (' effort="10"', "", "error: joint motor_2: limit without effort"),
    ("<limit", "<!--  --><a", "revolute without <limit>"),
    ("<axis", '<mimic joint="motr_1"/><axis', "mimics motr_1"),
    ('"revolute"', '"fixed"', "error: motor motor_2: no moving joint of this name"),
]
#: What is changed in the link arm_2.
OF_THE_LINK = [
    ('value="0.08"', 'value="0"', "warning: link arm_2: inertia without mass"),
    (' ixy="0"', "", "link arm_2: its inertia has no number ixy"),
    ("2e-05", "-2e-05", "link arm_2: inertia not positive definite"),
    ("2e-05", "0.001", "link arm_2: impossible inertia"),
    # Each pair of diagonal entries reaches the third, only the principal moments do not.
    ('2e-05" ixy="0"', '0.00025" ixy="0.0002"', "principal moments 5e-05, 0.00025, 0.00045 kg"),
    (
        ARM,
        re.sub(r'"[\d.e-]+"', '"0"', ARM),
        "note: link arm_2: moves, has mass but no inertia: refused",
    ),
]
#: What the link arm_2 gets besides.
SHAPES = [
    (MESH.format("a.stl"), "a.stl: not found"),
    (MESH.format("a.dae"), "note: link arm_2: meshes .dae: not read by MuJoCo and Drake"),
    (
        MESH.format("package://p/a.obj"),
        "note: link arm_2: meshes by package://: not resolved by MuJoCo",
    ),
    (MESH.format("/a.obj"), "warning: link arm_2: mesh /a.obj: an absolute path"),
    (SPHERE.format("1 0 0", "0,1"), "arm_2: sphere radius='0,1' is not a number"),
    (
        "<visual><geometry><capsule/></geometry></visual>",
        "note: link arm_2: <capsule>: not drawn by Pinocchio",
    ),
]
END = element(URDF, "link", "rod_1b_end")
OF_THE_WHOLE = [
    ("<robot", "error: file: not XML"),
    ("<model/>", "error: file: a URDF starts with <robot>"),
    ("<mujoco/>", "not with <mujoco>; ClosedChain.from_mjcf reads an MJCF"),
    ("<robot name='empty'/>", "error: file: no links"),
    (re.sub(r"<inertial>.*?</inertial>", "", URDF, count=1, flags=re.DOTALL), "1 kg in PyBullet"),
    (URDF.replace(END, '<link name="rod_1b_end"/>'), "rod_1b_end: fixed link without <inertial>"),
    (
        URDF.replace(END, END.replace('mass value="0"', 'mass value="1e-9"', 1)),
        "note: link rod_1b_end: has mass but no inertia",
    ),
]
FAULTS = [
    *((edited("joint", "motor_2", old, new), problem) for old, new, problem in OF_THE_JOINT),
    *((edited("link", "arm_2", old, new), problem) for old, new, problem in OF_THE_LINK),
    *((edited("link", "arm_2", "<inertial>", s + "<inertial>"), problem) for s, problem in SHAPES),
    *OF_THE_WHOLE,
]


@pytest.mark.parametrize(("urdf", "problem"), FAULTS, ids=[problem for _, problem in FAULTS])
def test_a_fault_of_the_urdf_is_told_with_its_place(found, urdf, problem):
    records = [str(p) for p in found(urdf) if problem in str(p)]
    assert len(records) == 1


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("closed_loop", "closed_lop", "error: cuts: closed_lop: unknown; known: closed_loop"),
        ("rod_2a_end", "rod_2", "error: closure rod_2 - platform_2a: no frame rod_2 in the model"),
        ("motor_2", "motr_2", "error: motor motr_2: no moving joint of this name"),
        ("[rod_2a_end, platform_2a]", "[arm_2, base]", "closure arm_2 - base: cannot be closed"),
        ("[rod_2a_end", "[rod_3a_end", "error: closures: each can be closed alone, but not all"),
        (", motor_3]", "]", "2 motors for 3 degrees of freedom; 1 of them moves with the motors"),
        (
            "motor_3]",
            "motor_3, elbow_1a_X]",
            "note: actuation: 4 motors for 3 degrees of freedom; the smallest",
        ),
        ("elbow_1a,", "knee,", "error: file: joint knee is missing"),
        (
            CUTS,
            "closed_loop: []\ntype: []\nname_mot: []",
            "warning: actuation: 0 motors for 10 degrees of freedom; 10 of them move",
        ),
    ],
)
def test_a_fault_of_the_cuts_is_told_with_its_place(found, old, new, problem):
    assert old in CUTS
    records = [str(p) for p in found(cuts=CUTS.replace(old, new, 1)) if problem in str(p)]
    assert len(records) == 1


def test_a_motor_too_few_is_told_with_the_joints_that_stay_loose(found):
    """Where redundant closures hide it from a count of equations."""
    pair = "  - [rod_2a_end, platform_2a]\n"
    cuts = CUTS.replace(pair, 2 * pair).replace("[3d, ", "[3d, 3d, ").replace(", motor_3]", "]")
    (problem,) = found(cuts=cuts)
    assert str(problem).startswith(
        "warning: actuation: 2 motors for 3 degrees of freedom; 1 of them moves with the motors "
        "locked: elbow_1a_X, "
    )


def test_all_faults_are_told_at_once(found):
    urdf = edited("link", "arm_2", 'value="0.08"', 'value="0"')
    urdf = urdf.replace("<inertial>", MESH.format("none.stl") + "<inertial>", 1)
    problems = found(urdf, CUTS.replace("motor_1", "m").replace("rod_2a_end", "r"))
    assert [p.severity for p in problems] == ["error"] * 3 + ["warning", "note"]
    places = {"motor m", "closure r - platform_2a", "link arm_2", "link arm_1"}
    assert {p.where for p in problems} == places


def test_a_mesh_is_sought_beside_the_urdf_and_in_packages(tmp_path):
    """`package://name/...` in any folder above that holds the package."""
    folder = tmp_path / "robots" / "delta_description" / "urdf"
    folder.mkdir(parents=True)
    (tmp_path / "robots" / "delta_description" / "arm.obj").touch()
    for name in ("../arm.obj", "package://delta_description/arm.obj"):
        text = URDF.replace("<inertial>", MESH.format(name) + "<inertial>", 1)
        (folder / "robot.urdf").write_text(text)
        records = [p for p in sst_pin.validate(folder / "robot.urdf") if "not found" in p.text]
        assert records == []


def test_an_open_tree_needs_no_cuts(tmp_path):
    (tmp_path / "delta.urdf").write_text(URDF)
    assert sst_pin.validate(tmp_path / "delta.urdf") == []
    problems = sst_pin.validate(tmp_path / "delta.urdf", tmp_path / "none.yaml")
    assert [p.where for p in problems] == ["cuts"]


def test_the_command_prints_a_problem_a_line_and_fails(tmp_path, capsys):
    """Exit code 1 for errors; for a good robot 0 and its mobility."""
    path = tmp_path / "bad.urdf"
    path.write_text(edited("link", "arm_2", 'value="0.08"', 'value="-1"'))
    assert main(["validate", str(path)]) == 1
    records = "error: link arm_2: its mass is negative, -1 kg\n1 error\n"
    assert capsys.readouterr().out == records
    delta = str(EXAMPLES / "delta.urdf")
    assert main(["validate", delta]) == main(["validate", "--robot", delta]) == 0
    out = capsys.readouterr().out
    half = len(out) // 2
    assert out[:half] == out[half:]  # the same command twice
    assert out.startswith("no problems found\n")
    assert "degrees of freedom  3" in out
    assert "moving mass         0.51 kg" in out
    cuts = str(EXAMPLES / "delta.yaml")
    path.write_text(edited("joint", "motor_2", '"revolute"', '"continuous"'))
    assert main(["validate", str(path), "--cuts", cuts]) == 0
    assert capsys.readouterr().out.startswith("note: joint motor_2: continuous")
    assert main(["validate", str(path)]) == 0
    assert "open tree           no bad.yaml with closures" in capsys.readouterr().out
    assert main(["validate", str(tmp_path / "missing.urdf")]) == 1
    assert "error: file: the URDF cannot be read" in capsys.readouterr().out


OFF = '<flag actuation="disable"/>'


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("", "", []),
        ('"bars">', '"bars"', ["error: file: XML parse error"]),
        (BARS, '<robot name="a"><link name="a"/></robot>', ["from_urdf reads a URDF"]),
        (
            "<connect ",
            '<connect active="false" ',
            ["warning: actuation: 1 motor for 3 degrees of freedom; 2 of them move"],
        ),
        pytest.param(
            "<connect ", "<weld ", ["warning: home: cannot be closed"], marks=pytest.mark.slow
        ),
        ("<worldbody>", f"<option>{OFF}</option><worldbody>", ["error: file: <flag actuation"]),
        (
            "<actuator>",
            '<actuator><motor joint="rocker"/>',
            ["note: actuation: 2 motors for 1 degree of freedom; the smallest"],
        ),
        ("-0.9443 -0.9443", "2 9", ["warning: home"]),
        ("-0.9443 -0.9443", "-0.9443 -0.9", ["rad; if the pose is right, a length"]),
    ],
)
def test_an_mjcf_is_judged_too(tmp_path, capsys, old, new, told):
    """What the reader refuses, closures, motors and home; MuJoCo judges the rest."""
    path = tmp_path / "bars.xml"
    path.write_text(BARS.replace(old, new))
    problems = list(map(str, sst_pin.validate(path)))
    assert len(problems) == len(told)
    for problem, text in zip(problems, told, strict=True):
        assert text in problem
    assert main(["validate", str(path)]) == any("error" in problem for problem in problems)
    with pytest.raises(sst_pin.InputError, match="an MJCF contains its closures"):
        sst_pin.validate(path, "cuts.yaml")


UNIVERSAL = """<robot name="r"><link name="base"/><link name="cross"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pitch" type="continuous"><parent link="base"/><child link="cross"/>
<axis xyz="0 1 0"/></joint>
<joint name="yaw" type="continuous"><parent link="cross"/><child link="arm"/>
<axis xyz="0 0 1"/></joint></robot>"""
MIMIC = UNIVERSAL.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><mimic joint="pitch"/>')
FLOATING = UNIVERSAL.replace('name="pitch" type="continuous"', 'name="pitch" type="floating"')


@pytest.mark.parametrize("urdf", [UNIVERSAL, MIMIC, FLOATING])
@pytest.mark.parametrize("cuts", ["", "name_mot: [yaw]\n"])
def test_a_robot_that_can_be_computed_has_no_errors(tmp_path, capsys, urdf, cuts):
    """A link without mass between two joints, joints that mimic, a floating base, few motors."""
    path = tmp_path / "r.urdf"
    path.write_text(urdf)
    if cuts:
        path.with_suffix(".yaml").write_text(cuts)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sst_pin.DescriptionWarning)
        chain = sst_pin.ClosedChain.from_urdf(path)
    problems = sst_pin.validate(path)
    assert [p for p in problems if p.severity == "error"] == []
    if urdf is not FLOATING:
        text = "note: link cross: moves without <inertial>: 1 kg in PyBullet, refused by MuJoCo"
        assert text in map(str, problems)
    assert main(["validate", str(path)]) == 0
    out = capsys.readouterr().out
    assert f"degrees of freedom  {chain.degrees_of_freedom}" in out
    assert "moving mass         1 kg" in out
    assert ("each joint that mimics none has a motor" in out) == (urdf is MIMIC and not cuts)


def test_what_other_tools_dislike_is_one_note_for_all_links(found):
    """Here meshes by packages, which some do not find."""
    mesh = MESH.format("package://none/{}.dae")
    urdf = URDF
    for k in range(3):
        urdf = urdf.replace("<inertial>", mesh.format(k) + "<inertial >", 1)
    notes = [str(problem) for problem in found(urdf) if problem.severity == "note"]
    assert notes == [
        "note: links arm_1, rod_1a, rod_1b: meshes by package://: not resolved by MuJoCo; use "
        "relative paths",
        "note: links arm_1, rod_1a, rod_1b: meshes .dae: not read by MuJoCo and Drake",
    ]
