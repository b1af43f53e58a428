# SPDX-License-Identifier: BSD-2-Clause
"""Every fault of a description is found, all at once, and nothing else."""

import re
import warnings

import pytest

import sst_pin
from sst_pin.cli import main
from tests.support.command_line import BARS
from tests.support.files import ROOT

EXAMPLES = ROOT / "examples"
URDF, CUTS = (EXAMPLES / "delta.urdf").read_text(), (EXAMPLES / "delta.yaml").read_text()


@pytest.fixture
def found(tmp_path):
    """Problems of an edited delta."""

    def validate(urdf=URDF, cuts=CUTS):
        (tmp_path / "delta.urdf").write_text(urdf)
        if cuts:
            (tmp_path / "delta.yaml").write_text(cuts)
        return sst_pin.validate(tmp_path / "delta.urdf")

    return validate


def element(text, tag, name):
    """The source of a named link or joint."""
    return re.search(rf'  <{tag} name="{name}".*?</{tag}>\n', text, re.DOTALL)[0]


def edited(tag, name, old, new, urdf=URDF):
    """The delta with a change in one link or joint."""
    source = element(urdf, tag, name)
    assert old in source
    return urdf.replace(source, source.replace(old, new, 1))


ARM = '<inertia ixx="2e-05" ixy="0" ixz="0" iyy="0.00025" iyz="0" izz="0.00025"/>'
MESH = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
SPHERE = '<visual><geometry><sphere radius="0,1"/></geometry></visual>'
#: What other tools dislike in a mesh is one note for all links.
PACKAGE, DAE = "meshes by package://: not resolved by MuJoCo", "meshes .dae: not read by MuJoCo"
FILE = "meshes by file://: not resolved by MuJoCo"
CAPSULE = "<visual><geometry><capsule/></geometry></visual>"
END = "</link>"


#: A link or joint, what is changed there, and what is said of it; see test_unreadable.py as well.
FAULTS = [
    ("joint motor_1", "0 1 0", "0 2 0", "warning: joint motor_1: its axis has length"),
    ("joint motor_2", '"arm_2"', '"arm_1"', "link arm_1 is already the child of joint motor_1"),
    ("joint motor_3", '<parent link="base"/>', "", "error: joint motor_3: no <parent"),
    ("joint elbow_1a", 'lower="-3.2" upper="3.2" ', "", "note: joint elbow_1a: limits"),
    ("joint elbow_1b", ' effort="10"', "", "warning: joints elbow_1b: limit without effort"),
    ("joint elbow_2a", "<limit", "<!--  --><a", "warning: joints elbow_2a: no <limit>: read"),
    ("link arm_1", ' ixy="0"', "", "error: link arm_1: its inertia has no number ixy"),
    # Each pair of diagonal entries reaches the third, only the principal moments do not.
    (
        "link arm_2",
        '2e-05" ixy="0"',
        '0.00025" ixy="0.0002"',
        "link arm_2: impossible inertia, the two smaller moments must reach the third: principal "
        "moments 5e-05, 0.00025, 0.00045 kg",
    ),
    (
        "link arm_3",
        ARM,
        re.sub(r'"[\d.e-]+"', '"0"', ARM),
        "note: link arm_3: moves, has mass but no inertia: refused",
    ),
    (
        "link rod_1b_end",
        'mass value="0"',
        'mass value="1e-9"',
        "note: link rod_1b_end: has mass but no inertia",
    ),
    (
        "link rod_2a_end",
        re.search("<inertial>.*</inertial>", element(URDF, "link", "rod_2a_end"), re.DOTALL)[0],
        "",
        "note: link rod_2a_end: fixed link without <inertial>",
    ),
    ("link rod_1a", END, MESH.format("a.stl") + END, "warning: link rod_1a: mesh a.stl: not found"),
    ("link rod_1b", END, MESH.format("/a.obj") + END, "rod_1b: mesh /a.obj: an absolute path"),
    ("link rod_2a", END, SPHERE + END, "link rod_2a: sphere radius='0,1' is not a number"),
    ("link rod_3a", END, MESH.format("package://p/a.dae") + END, f"rod_3a, rod_3b: {PACKAGE}"),
    ("link rod_3b", END, MESH.format("package://p/b.dae") + END, f"rod_3a, rod_3b: {DAE}"),
    ("link rod_3a_end", END, MESH.format("file://c.obj") + END, f"note: link rod_3a_end: {FILE}"),
    ("link rod_2b", END, CAPSULE + END, "note: link rod_2b: <capsule>: not drawn by Pinocchio"),
]


def test_faults_of_the_urdf_are_told_with_their_places(found):
    urdf = URDF
    for place, old, new, _ in FAULTS:
        urdf = edited(*place.split(), old, new, urdf)
    records = list(map(str, found(urdf, cuts="")))
    for text in (*(text for *_, text in FAULTS), "error: tree: 3 links without a parent: base"):
        assert sum(text in record for record in records) == 1, text


@pytest.mark.parametrize(
    ("urdf", "problem"),
    [
        ("<robot", "error: file: not XML"),
        ("<mujoco/>", "error: file: a URDF starts with <robot>, not with <mujoco>; ClosedChain.fr"),
        ("<robot name='empty'/>", "error: file: no links"),
    ],
)
def test_what_is_no_urdf_has_one_problem(found, urdf, problem):
    (record,) = found(urdf)
    assert problem in str(record)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (
            "closed_loop",
            "closed_lop",
            "closed_lop: unknown; do you mean closed_loop; known",
        ),
        ("[rod_2a_end, platform_2a]", "[arm_2, base]", "closure arm_2 - base: cannot be closed"),
        ("elbow_1a,", "knee,", "error: file: joint knee is missing"),
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
    assert [p.severity for p in problems] == ["error"] * 2 + ["warning"] * 2 + ["note"]
    records = list(map(str, problems))
    assert "error: motor m: no moving joint of this name in the model" in records
    assert "error: closure r - platform_2a: no frame r in the model" in records
    assert {p.where for p in problems[2:]} == {"link arm_2", "link arm_1"}


@pytest.mark.parametrize(
    ("place", "old", "new", "joints"),
    [
        ("joint elbow_2a", 'xyz="0.15 0.04 0"', 'xyz="150 40 0"', "joints 155 m apart"),
        (
            *("link arm_2", 'iyy="0.00025" iyz="0" izz="0.00025"', 'iyy="250" iyz="0" izz="250"'),
            "no link has joints more than",
        ),
    ],
)
def test_lengths_and_moments_in_other_units_are_told(found, place, old, new, joints):
    """The arm's length in mm, or its moments in kg mm^2."""
    (problem,) = found(edited(*place.split(), old, new), cuts="")
    assert str(problem).startswith(f"warning: link arm_2: {joints}")
    assert "URDF needs m, kg" in str(problem)


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
    assert main(["validate", str(EXAMPLES / "delta.urdf")]) == 0
    out = capsys.readouterr().out
    assert out.startswith("no problems found\n")
    assert "degrees of freedom  3" in out
    assert "moving mass         0.51 kg" in out
    cuts = str(EXAMPLES / "delta.yaml")
    path.write_text(edited("joint", "motor_2", '"revolute"', '"continuous"'))
    assert main(["validate", "--robot", str(path), "--cuts", cuts]) == 0
    assert capsys.readouterr().out.startswith("note: joint motor_2: continuous")
    assert main(["validate", str(path)]) == 0
    assert "open tree           no bad.yaml with closures" in capsys.readouterr().out
    assert main(["validate", str(tmp_path / "missing.urdf")]) == 1
    assert "error: file: the URDF cannot be read" in capsys.readouterr().out


OFF = '<flag actuation="disable"/>'
HELD = '<joint joint1="crank" polycoef="1 0 0 0 0"/><joint joint1="rocker" polycoef="2.5 0 0 0 0"/>'


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("", "", []),
        ('"bars">', '"bars"', ["error: file: MuJoCo refuses it: XML parse error"]),
        (BARS, '<robot name="a"><link name="a"/></robot>', ["from_urdf reads a URDF"]),
        pytest.param(
            "<connect ",
            "<weld ",
            ["error: mobility: nothing can move", "that lead to no other pose"],
            marks=pytest.mark.slow,
        ),
        ("<worldbody>", f"<option>{OFF}</option><worldbody>", ["error: file: <flag actuation"]),
        (
            "<actuator>",
            '<actuator><motor joint="rocker"/>',
            ["note: actuation: 2 motors for 1 degree of freedom; the smallest"],
        ),
        ("<connect ", f"{HELD}<connect ", ["error: closures: each can be closed alone, but not"]),
        ("-0.9443 -0.9443", "2 9", ["warning: home"]),
        ("-0.9443 -0.9443", "-0.9443 -0.9", ["rad; if the pose is right, a length"]),
    ],
)
def test_an_mjcf_is_judged_too(tmp_path, old, new, told):
    """What the reader refuses, closures, motors and home; MuJoCo judges the rest."""
    path = tmp_path / "bars.xml"
    path.write_text(BARS.replace(old, new))
    problems = list(map(str, sst_pin.validate(path)))
    if "note: file: contacts are not computed" in problems:
        problems.remove("note: file: contacts are not computed")
    assert len(problems) == len(told)
    for problem, text in zip(problems, told, strict=True):
        assert text in problem
    with pytest.raises(sst_pin.InputError, match="an MJCF contains its closures"):
        sst_pin.validate(path, "cuts.yaml")


def test_an_mjcf_of_no_robot_keeps_the_notes_on_its_file(tmp_path):
    """The search for a home must not end before the notes are told."""
    path = tmp_path / "ball.xml"
    path.write_text(
        "<mujoco><worldbody><body><joint name='b_wx' axis='0 1 0'/><geom size='1'/>"
        "<body pos='9 0 0'><joint name='b' type='ball' range='0 1' limited='true'/>"
        "<geom size='1'/></body></body></worldbody></mujoco>"
    )
    problems = list(map(str, sst_pin.validate(path)))
    assert problems[0].startswith("error: robot: joints b_wx and b: b_wx names a rate of both")
    assert "warning: file: joint b: the limit of a ball is ignored" in problems
    with (
        pytest.warns(sst_pin.DescriptionWarning, match="the limit of a ball is ignored"),
        pytest.raises(sst_pin.DescriptionError, match="b_wx names a rate of both"),
    ):
        sst_pin.ClosedChain.from_mjcf(path)


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
    text = "note: link cross: moves without <inertial>: 1 kg in PyBullet, refused by MuJoCo"
    if urdf is FLOATING:
        text = "note: joint pitch: floating: q has one more entry than v"
    assert text in map(str, problems)
    assert main(["validate", str(path)]) == 0
    out = capsys.readouterr().out
    assert f"degrees of freedom  {chain.degrees_of_freedom}" in out
    assert "moving mass         1 kg" in out
    told = "each joint of one axis that mimics none has a motor" in out
    assert told == (urdf is MIMIC and not cuts)
