# SPDX-License-Identifier: BSD-2-Clause
"""Loops as other tools write them: URDF+, Isaac Sim, Gazebo, urdfdom's proposal, sw2robot."""

import re

import numpy as np
import pinocchio as pin
import pytest
import yaml

import sst_pin
from sst_pin.model.closures import Coupling

LINK = """<link name="{}"><inertial><origin xyz="0.1 0.02 0"/><mass value="{}"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.012" iyz="0" izz="0.013"/></inertial></link>"""
JOINT = """<joint name="{}" type="{}" {}><origin xyz="{}" rpy="{}"/><parent link="{}"/>
<child link="{}"/><axis xyz="{}"/><limit lower="-4" upper="4" effort="9" velocity="9"/>{}</joint>"""
PLACES = {"a": ("0.1 0.2 -0.1", "0.3 -0.2 0.5"), "b": ("-0.2 0.1 0.05", "-0.4 0.1 0.2")}
AXES = {"a": "0.2 0.9 -0.4", "b": "0.5 -0.1 0.8"}
FORMS = {
    "loop": """<loop name="cut" type="{kind}">
        <predecessor link="a"><origin {place_a}/></predecessor>
        <successor link="b"><origin {place_b}/></successor><axis xyz="{axis_a}"/></loop>""",
    "loop_joint": """<loop_joint name="cut" type="{kind}"><link1 link="a" {place_a}/>
        <link2 link="b" {place_b}/><axis xyz="{axis_a}"/></loop_joint>""",
    "constraint": """<constraint name="cut" type="{kind}"><parent link="a"/><child link="b"/>
        <parent_origin {place_a}/><child_origin {place_b}/>
        <parent_axis xyz="{axis_a}"/><child_axis xyz="{axis_b}"/></constraint>""",
    "ball": """<drake:ball_constraint><drake:ball_constraint_body_A name="a"/>
        <drake:ball_constraint_p_AP value="{at_a}"/><drake:ball_constraint_body_B name="b"/>
        <drake:ball_constraint_p_BQ value="{at_b}"/></drake:ball_constraint>""",
}


def two_arms(extra: str) -> str:
    """Two arms of six joints each, whose ends are the links a and b."""
    rng = np.random.default_rng(5)
    parts = ['<robot name="r">', LINK.format("base", 1)]
    for end in "ab":
        for k in range(6):
            parent = f"{end}{k}" if k else "base"
            child = f"{end}{k + 1}" if k < 5 else end
            xyz, rpy, axis = (" ".join(map(str, rng.uniform(-0.3, 0.3, 3))) for _ in range(3))
            parts.append(LINK.format(child, 1 + k))
            joint = (f"j_{end}{k}", "revolute", "", xyz, rpy, parent, child, axis, "")
            parts.append(JOINT.format(*joint))
    return "".join([*parts, extra, "</robot>"])


def form(name: str, kind: str, same_axis: bool) -> str:
    places = {f"place_{end}": f'xyz="{xyz}" rpy="{rpy}"' for end, (xyz, rpy) in PLACES.items()}
    axes = {"axis_a": AXES["a"], "axis_b": AXES["a" if same_axis else "b"]}
    at = {f"at_{end}": xyz for end, (xyz, _) in PLACES.items()}
    return FORMS[name].format(kind=kind, **places, **axes, **at)


def numbers(text: str) -> np.ndarray:
    return np.array(text.split(), dtype=float)


def motions(kind: str, axis_a: np.ndarray, axis_b: np.ndarray) -> np.ndarray:
    """Twists that a joint allows, (columns), linear and angular; by their definition."""
    none, unit = np.zeros(3), np.eye(3)
    across = np.linalg.svd(axis_a[None])[2][1:]
    return np.array(
        {
            "fixed": [],
            "revolute": [[*none, *axis_a]],
            "continuous": [[*none, *axis_a]],
            "prismatic": [[*axis_a, *none]],
            "spherical": [[*none, *e] for e in unit],
            "cylindrical": [[*axis_a, *none], [*none, *axis_a]],
            "planar": [*([*e, *none] for e in across), [*none, *axis_a]],
            "universal": [[*none, *axis_a], [*none, *axis_b]],
        }[kind]
    ).reshape(-1, 6)


KINDS = ["fixed", "revolute", "prismatic", "spherical", "universal", "cylindrical", "planar"]


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("constraint", kind) for kind in KINDS),
        *(("loop", "revolute"), ("loop_joint", "revolute"), ("ball", "spherical")),
    ],
)
def test_links_move_as_the_joint_between_them_allows(name, kind, tmp_path):
    same = name != "constraint" or kind == "prismatic"
    path = tmp_path / "robot.urdf"
    path.write_text(two_arms(form(name, kind, same)))
    chain = sst_pin.ClosedChain.from_urdf(path, actuated=[])
    q = chain.generic_configuration()
    model = chain.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    frames = {}
    for end, (xyz, rpy) in PLACES.items():
        place = pin.SE3(pin.rpy.rpyToMatrix(numbers(rpy)), numbers(xyz))
        frames[end] = data.oMf[model.getFrameId(end)] * place
    axes = {end: frames[end].rotation @ numbers(AXES["a" if same else end]) for end in "ab"}
    axes = {end: axis / np.linalg.norm(axis) for end, axis in axes.items()}
    point = frames["b"].translation
    J = {}
    for end in "ab":  # twist of the link at the joint's point, world axes
        at_link = chain.frame_jacobian(q, end)
        arm = point - data.oMf[model.getFrameId(end)].translation
        J[end] = np.vstack([at_link[:3] - pin.skew(arm) @ at_link[3:], at_link[3:]])
    relative = (J["b"] - J["a"]).T
    allowed = motions(kind, axes["a"], axes["b"])
    # all relative twists are allowed ones, and each allowed one occurs: the ranks are the same
    assert np.linalg.matrix_rank(relative, 1e-8) == len(allowed)
    assert np.linalg.matrix_rank(np.vstack([relative, allowed]), 1e-8) == len(allowed)
    if kind in ("fixed", "revolute", "spherical", "universal"):
        np.testing.assert_allclose(frames["a"].translation, point, atol=1e-9)
    if kind == "universal":
        assert abs(axes["a"] @ axes["b"]) < 1e-9


def parallelogram(extra: str = "", mimic: str = "", independent: str = "") -> str:
    """Two cranks and a coupler; closed at q = 0, where the coupler lies along x."""
    links = [LINK.format(name, m) for name, m in zip("0123", (1, 0.5, 0.7, 0.6), strict=True)]
    rows = [
        ("crank", "revolute", independent, "0 0 0", "0 0 0", "0", "1", "0 0 1", ""),
        ("coupler", "revolute", "", "0 0.4 0", "0 0 0", "1", "2", "0 0 1", mimic),
        ("rocker", "revolute", "", "0.5 0 0", "0 0 0", "0", "3", "0 0 1", ""),
    ]
    joints = [JOINT.format(*row) for row in rows]
    return f'<robot name="r">{"".join([*links, *joints])}{extra}</robot>'


CUT = '<loop name="cut" type="revolute"><predecessor link="2"><origin xyz="0.5 0 0"/>'
CUT += '</predecessor><successor link="3"><origin xyz="0 0.4 0"/></successor>'
CUT += '<axis xyz="0 0 1"/></loop>'
GAZEBO = '<gazebo><joint name="cut" type="revolute"><parent>2</parent><child>3</child>'
GAZEBO += "<pose>0 0.4 0 0 0 0</pose><axis><xyz>0 0 1</xyz></axis></joint></gazebo>"
CLOSURES = {
    "closures": [{"link_a": "2", "link_b": "3", "point": [0.5, 0.4, 0.0], "axis": [0.0, 0.0, 2.0]}],
    "dependent": ["coupler", "rocker"],
    "independent": ["crank"],
}


def torques(chain: sst_pin.ClosedChain) -> np.ndarray:
    q = chain.assemble({"crank": 0.3}, fixed=["crank"])
    return chain.compute_torques(q, [0.7], [1.1])


@pytest.fixture(scope="module")
def expected() -> np.ndarray:
    """Three bodies by hand: the coupler goes in a circle and does not turn, weights act along z."""
    r2 = 0.1**2 + 0.02**2
    turning = sum(0.013 + mass * r2 for mass in (0.5, 0.6))
    return np.array([(turning + 0.7 * 0.4**2) * 1.1])


def test_a_parallelogram_of_gazebo_has_the_torque_of_its_three_bodies(expected, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(parallelogram(GAZEBO))
    chain = sst_pin.ClosedChain.from_urdf(path, actuated=["crank"])
    np.testing.assert_allclose(torques(chain), expected, rtol=1e-12)


@pytest.mark.parametrize(("place", "folder"), [("urdf/r.urdf", "config"), ("r.urdf", "")])
def test_loop_closures_of_a_package_are_found(place, folder, expected, tmp_path):
    (tmp_path / "urdf").mkdir()
    (tmp_path / "config").mkdir()
    text = yaml.safe_dump(CLOSURES, default_flow_style=None)
    (tmp_path / folder / "loop_closures.yaml").write_text("# relay\n" + text)
    path = tmp_path / place
    # what the exporter writes for tools that know no loops: it holds near q = 0 at most
    path.write_text(parallelogram(mimic='<mimic joint="crank" multiplier="-0.8" offset="0.1"/>'))
    chain = sst_pin.ClosedChain.from_urdf(path)
    assert chain.motor_names == ("crank",)
    np.testing.assert_allclose(torques(chain), expected, rtol=1e-12)
    assert not sst_pin.validate(path)


def test_a_mark_beside_a_yaml_with_closures_is_named(tmp_path):
    path = tmp_path / "r.urdf"
    cuts = "closed_loop: [[2, 3]]\ntype: [orientation]\nname_mot: [crank, rocker]\n"
    path.with_suffix(".yaml").write_text(cuts)
    path.write_text(parallelogram(CUT))
    told = "closures: the URDF also has cut, not read because"
    with pytest.warns(sst_pin.DescriptionWarning, match=told):
        chain = sst_pin.ClosedChain.from_urdf(path)
    assert len(chain.closures) == 1
    assert any(told in str(problem) for problem in sst_pin.validate(path))


def test_what_is_written_as_loop_closures_is_read_back(tmp_path, expected):
    path = tmp_path / "r.urdf"
    path.write_text(parallelogram(CUT))
    chain = sst_pin.ClosedChain.from_urdf(path, actuated=["crank"])
    sst_pin.write_loop_closures(chain, tmp_path / "loop_closures.yaml")
    path.write_text(parallelogram())
    again = sst_pin.ClosedChain.from_urdf(path)
    np.testing.assert_allclose(torques(again), expected, rtol=1e-12)
    point = sst_pin.ClosedChain(chain.model, [sst_pin.Closure("cut_A", "cut_B", "3d")], ["crank"])
    sst_pin.write_loop_closures(point, tmp_path / "loop_closures.yaml", force=True)
    again = sst_pin.ClosedChain.from_urdf(path)
    np.testing.assert_allclose(torques(again), expected, rtol=1e-12)


def test_a_point_closure_of_a_structure_becomes_a_hinge(tmp_path):
    """A ball at the end of a bar on a hinge: nothing moves, so that every hinge holds the same."""
    model = pin.Model()
    model.name = "bar"
    bar = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "bar")
    model.appendBodyToJoint(bar, pin.Inertia.Random(), pin.SE3.Identity())
    end = pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0]))
    model.addFrame(pin.Frame("A", 0, end, pin.FrameType.BODY))
    model.addFrame(pin.Frame("B", bar, end, pin.FrameType.BODY))
    chain = sst_pin.ClosedChain(model, [sst_pin.Closure("A", "B", "3d")], [])
    path = tmp_path / "loop_closures.yaml"
    sst_pin.write_loop_closures(chain, path)
    (hinge,) = yaml.safe_load(path.read_text())["closures"]
    assert hinge == {"link_a": "A", "link_b": "B", "point": [1, 0, 0], "axis": [0, 0, 1]}


def test_what_loop_closures_cannot_say_is_refused_by_name(tmp_path):
    target = tmp_path / "loop_closures.yaml"
    with pytest.raises(sst_pin.DescriptionError, match="open at q = 0"):
        sst_pin.write_loop_closures(sst_pin.robots.five_bar(), target)
    with pytest.raises(sst_pin.DescriptionError, match="neither a hinge nor a weld"):
        sst_pin.write_loop_closures(sst_pin.robots.ankle(), target)
    assert not target.exists()


BELT = '<coupling name="belt"><predecessor link="2"/><successor link="3"/>{}</coupling>'


def test_a_coupling_counts_all_turns_along_its_two_paths(tmp_path):
    path = tmp_path / "robot.urdf"
    text = parallelogram(BELT.format('<ratio value="-1.5"/>'))
    path.write_text(text.replace('name="rocker" ', 'name="rocker" independent="0" '))
    chain = sst_pin.ClosedChain.from_urdf(path)
    assert chain.motor_names == chain.coordinates == ("crank", "coupler")
    q = chain.assemble({"crank": 0.3, "coupler": 0.4})
    assert q[chain.joint_names.index("rocker")] == pytest.approx(-1.5 * 0.7, rel=1e-12)


DRAKE = form("ball", "spherical", same_axis=True)


@pytest.mark.parametrize(
    ("extra", "told"),
    [
        (CUT.replace("0 0 1", "0 0 0"), "loop cut: axis '0 0 0' is not a direction"),
        (CUT.replace('link="3"', 'link="2"'), "loop cut: connects 2 with itself"),
        (form("constraint", "prismatic", same_axis=False), "axes of a prismatic joint"),
        (DRAKE, "ball_constraint_1: parent a is not a link of this file"),
        (DRAKE.replace(PLACES["a"][0], "1 0"), "ball_constraint_1: xyz='1 0' is not three numbers"),
        (GAZEBO.replace("0 0.4 0 0 0 0", "0 0.4 0"), "joint cut: its pose is not six numbers"),
        (GAZEBO.replace("<xyz>", '<xyz expressed_in="m">'), "joint cut: <xyz> has no expressed_in"),
        (GAZEBO.replace("<pose>", '<pose relative_to="2">'), "cut: <pose> has no relative_to"),
        (GAZEBO.replace("<pose>", '<pose degrees="true">'), "a <pose> in degrees is not"),
        (
            GAZEBO.replace("</xyz>", "</xyz><use_parent_model_frame>1</use_parent_model_frame>"),
            "use_parent_model_frame is not",
        ),
        (
            GAZEBO.replace("</xyz>", "</xyz><dynamics><damping>5</damping></dynamics>"),
            "<dynamics> with damping '5' is not supported",
        ),
        (CUT.replace("<axis", '<dynamics friction="2"/><axis'), "<dynamics> with friction '2' is"),
        (CUT.replace("<axis", '<mimic joint="crank"/><axis'), "<mimic> in <loop> is not supported"),
        (
            CUT.replace("revolute", "universal"),
            "needs parent_axis and child_axis in a <constraint>",
        ),
        (f"<gazebo>{CUT}</gazebo>", "loop: it must be a direct child of <robot>"),
        (BELT.format(""), "coupling belt: its ratio is not a number"),
    ],
)
def test_faults_are_told_with_the_element(extra, told, tmp_path):
    path = tmp_path / "robot.urdf"
    ends = extra.replace('link="a"', 'link="2"').replace('link="b"', 'link="3"')
    path.write_text(parallelogram(ends))
    with pytest.raises(sst_pin.DescriptionError, match=told):
        sst_pin.ClosedChain.from_urdf(path)
    assert any(told in str(problem) for problem in sst_pin.validate(path))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"closures": []}, "closures: a list of hinges is needed"),
        ({"closures": [{"link_a": "2"}]}, "{'link_a': '2'} needs link_a, link_b, point, axis"),
        (
            {"closures": [{**CLOSURES["closures"][0], "axis": [0, 0, 0]}]},
            r"axis \['0', '0', '0'\] is zero: it has no direction",
        ),
        ({"closures": None}, "closures: a list is needed$"),
        ({"dependent": ["joint_1", "joint_1"]}, "joint_1: named twice"),
        ({"speed": 3}, "speed: unknown; known: closures, dependent, independent"),
        ({"dependent": ["coupler", "rocker", "rod"]}, "dependent: no moving joint rod"),
        ({"closures": [{**CLOSURES["closures"][0], "link_b": "nine"}]}, "nine"),
    ],
)
def test_faults_of_loop_closures_are_told(change, told, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(parallelogram())
    (tmp_path / "loop_closures.yaml").write_text(yaml.safe_dump({**CLOSURES, **change}))
    with pytest.raises(sst_pin.DescriptionError, match=told):
        sst_pin.ClosedChain.from_urdf(path)
    assert any(re.search(told, str(problem)) for problem in sst_pin.validate(path))


def test_couplings_are_part_of_the_urdf_not_of_loop_closures(tmp_path):
    path = tmp_path / "r.urdf"
    mimic = parallelogram(CUT, mimic='<mimic joint="crank" multiplier="-1"/>')
    path.write_text(mimic)
    chain = sst_pin.ClosedChain.from_urdf(path, actuated=["crank"])
    assert any(isinstance(closure, Coupling) for closure in chain.closures)
    sst_pin.write_loop_closures(chain, tmp_path / "out.yaml")
    written = yaml.safe_load((tmp_path / "out.yaml").read_text())
    assert [hinge["link_b"] for hinge in written["closures"]] == ["3"]
