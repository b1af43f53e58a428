# SPDX-License-Identifier: BSD-2-Clause
"""What is read is what the file says, or the file is refused."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.model.closures import Coupling
from sst_pin.model.mechanism import Springs
from sst_pin.reading import Urdf
from sst_pin.reading.closing_frames import closures_of_frames
from sst_pin.reading.mjcf import read_mjcf
from tests.support.files import file_of_page

LINK = """
<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>"""
JOINT = """
<joint name="{name}" type="{kind}"><origin xyz="{x} 0 0" rpy="0.1 0.2 0.3"/>
<parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>"""


def chain_urdf(*kinds: str) -> str:
    """Links a, b, c, ... in series, joints j0, j1, ... between them."""
    names = "abcdefg"[: len(kinds) + 1]
    links = "".join(LINK.format(name=name) for name in names)
    joints = "".join(
        JOINT.format(name=f"j{i}", kind=kind, x=0.2, parent=names[i], child=names[i + 1])
        for i, kind in enumerate(kinds)
    )
    return f'<robot name="test">{links}{joints}</robot>'


def body(model, q, name):
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(name)]


def test_a_continuous_joint_counts_as_one_unbounded_angle():
    bounded = Urdf(chain_urdf("revolute", "revolute"), "test").tree()
    endless = Urdf(chain_urdf("continuous", "revolute"), "test").tree()
    assert (endless.nq, endless.nv) == (2, 2)
    assert endless.upperPositionLimit[0] > 1e6
    q = np.array([40.0, 0.5])
    assert body(endless, q, "c").isApprox(body(bounded, q, "c"), 1e-12)


@pytest.mark.parametrize(
    ("kind", "laas", "names", "q", "turn"),
    [
        ("BALL", "SPHERICAL", ["j1"], [0.5, -0.1, 0.7, 0.5], lambda q: pin.Quaternion(q).matrix()),
        ("UNIVERSAL ZX", "UJOINT_ZX", ["j1_Z", "j1_X"], [0.3, -0.5], lambda q: _about("ZX", q)),
        ("FIXED", "FIXED", [], [], lambda q: np.eye(3)),
    ],
)
def test_a_joint_with_several_rates_turns_about_its_axes_in_turn(kind, laas, names, q, turn):
    """In the place of the joint of the URDF, with the same body after it; a ball is one joint."""
    q = np.array(q) / (np.linalg.norm(q) if kind == "BALL" else 1)
    urdf = Urdf(chain_urdf("revolute", "revolute", "prismatic"), "test")
    model, plain = urdf.tree({"j1": kind}), urdf.tree()
    assert urdf.tree({"j1": laas}) == model
    assert list(model.names)[1:] == ["j0", *names, "j2"]
    at = body(plain, np.array([0.7, 0, 0]), "c")
    result = body(model, np.array([0.7, *q, 0.4]), "c")
    assert result.isApprox(at * pin.SE3(turn(q), np.zeros(3)), 1e-12)
    assert pin.computeTotalMass(model) == pin.computeTotalMass(plain)
    for field in ("lowerPositionLimit", "upperPositionLimit", "effortLimit", "velocityLimit"):
        ours, theirs = getattr(model, field), getattr(plain, field)
        assert (ours[0], ours[-1]) == (theirs[0], theirs[-1])


def _about(axes, q):
    R = np.eye(3)
    for axis, angle in zip(axes, q, strict=True):
        R = R @ pin.exp3(angle * np.eye(3)["XYZ".index(axis)])
    return R


def mimic(leader, *kinds, more=""):
    """A chain whose first joint mimics one."""
    text = f'<mimic joint="{leader}" {more}/><limit'
    return chain_urdf("revolute", *kinds).replace("<limit", text, 1)


@pytest.mark.parametrize(
    ("urdf", "word"),
    [
        (chain_urdf("planar"), "joint j0: planar about 0 1 0"),
        (chain_urdf("fixed", "revolute"), "joint j0: SPHERICAL, but fixed in the URDF"),
        (
            chain_urdf("floating").replace("<limit", '<dynamics damping="2"/><limit'),
            "joint j0: damping of a floating joint is not read",
        ),
        (
            chain_urdf("revolute").replace('"b"', '"closing_x_1"'),
            "closing_x_1 and closing_x_2 close a loop; one",
        ),
        (mimic("other"), "joint j0: mimics other, which is not a joint"),
        (mimic("j0"), "joint j0: mimics itself"),
        (mimic("j1", "floating"), "joint j0: mimics j1: j1 is floating"),
        (mimic("j1", "revolute", more='multiplier="x"'), "mimic multiplier='x' is not a number"),
    ],
)
def test_a_urdf_that_cannot_be_meant_is_refused(urdf, word):
    kinds = {"j0": "SPHERICAL"} if "SPHERICAL" in word else {}
    with pytest.raises(sst_pin.DescriptionError) as caught:
        list(closures_of_frames(Urdf(urdf, "test").tree(kinds)))
    assert word in str(caught.value)


FIVE_BAR = file_of_page("own_robot.md", "five_bar.urdf").replace("revolute", "continuous")
FIVE_BAR_CUTS = """
closed_loop: [[left_tip, right_tip]]
type: [3D]
name_mot: [left, right]
"""


def test_a_five_bar_with_endless_joints_is_read_from_two_files(tmp_path):
    """The YAML lies beside the URDF by default; gravity is that of the YAML, or points down."""
    (tmp_path / "robot.urdf").write_text(FIVE_BAR)
    (tmp_path / "robot.yaml").write_text(FIVE_BAR_CUTS)
    (tmp_path / "moon.yaml").write_text(FIVE_BAR_CUTS + "gravity: [0, 0, -1.62]\n")
    earth = sst_pin.ClosedChain.from_urdf(tmp_path / "robot.urdf")
    moon = sst_pin.ClosedChain.from_urdf(tmp_path / "robot.urdf", tmp_path / "moon.yaml")
    assert earth.joint_names == ("left", "left_elbow", "right", "right_elbow")
    assert earth.mobility().degrees_of_freedom == 2
    q = earth.assemble([-2.0, 1.0, -1.0, -1.0])
    held = [chain.compute_torques(q, [0, 0], [0, 0]) for chain in (earth, moon)]
    assert np.abs(held[0]).max() > 0.1
    np.testing.assert_allclose(held[1], held[0] * 1.62 / 9.81, rtol=1e-12)


MIMIC = FIVE_BAR.replace(
    '<parent link="right_arm"/>',
    '<parent link="right_arm"/><mimic joint="left_elbow" multiplier="-2" offset="0.1"/>',
)


def test_a_joint_that_mimics_another_is_coupled_to_it(tmp_path):
    """Offset and multiplier; one freedom goes, and a locked pair holds as it says."""
    assert MIMIC != FIVE_BAR
    (tmp_path / "robot.urdf").write_text(MIMIC)
    (tmp_path / "robot.yaml").write_text(FIVE_BAR_CUTS)
    chain = sst_pin.ClosedChain.from_urdf(tmp_path / "robot.urdf")
    assert chain.closures[1:] == (Coupling("right_elbow", {"left_elbow": (0, -2)}, 0.1),)
    assert chain.mobility().degrees_of_freedom == 1
    q = dict(zip(chain.joint_names, chain.generic_configuration(), strict=True))
    assert abs(q["right_elbow"] - (0.1 - 2 * q["left_elbow"])) < 1e-10
    held = sst_pin.ClosedChain.from_urdf(tmp_path / "robot.urdf", locked=["left_elbow", "right"])
    assert held.closures[1:] == (Coupling("right_elbow", {}, 0.1),)
    assert held.motor_names == ("left",)
    with pytest.raises(sst_pin.DescriptionError, match="right_elbow mimics left_elbow: lock both"):
        sst_pin.ClosedChain.from_urdf(tmp_path / "robot.urdf", locked=["right_elbow"])


@pytest.mark.parametrize("cuts", [None, "name_mot: [left, right]"])
def test_frames_that_mark_a_closure_close_it(tmp_path, cuts):
    """Points that coincide, as onshape-to-robot names them, where no YAML lists closures."""
    text = FIVE_BAR.replace('"left_tip"', '"closing_tip_1"')
    text = text.replace('"right_tip"', '"closing_tip_2"')
    (tmp_path / "robot.urdf").write_text(text)
    if cuts:
        (tmp_path / "robot.yaml").write_text(cuts)
    chain = sst_pin.ClosedChain.from_urdf(tmp_path / "robot.urdf")
    assert chain.closures == (sst_pin.Closure("closing_tip_1", "closing_tip_2", "3d"),)
    assert chain.motor_names == (("left", "right") if cuts else ())
    assert chain.model.gravity.linear[2] == -9.81
    motors = sst_pin.ClosedChain.from_urdf(tmp_path / "robot.urdf", actuated=["left"]).motor_names
    assert motors == ("left",)


#: Anchored, tilted, preloaded joints of all kinds, two in one body, and every form of a closure.
MJCF = """
<mujoco model="odd"><compiler autolimits="true"/><option gravity="0.5 -1 -9"/>
<worldbody>
  <body name="a" pos="0.1 0.2 0.3" euler="20 30 40">
    <joint name="ja" axis="1 2 3" pos=".1 .05 -.02" ref="30" armature="0.2" damping="0.3"/>
    <geom size=".1" mass="1"/>
    <body name="b" pos="0.3 0 .1" euler="-20 10 70">
      <joint name="jb" type="slide" axis="0 1 2" ref="0.1" frictionloss="0.4"/>
      <joint axis="1 0 1" pos="0.1 0 0"/>
      <inertial pos="0.1 0.2 0" mass="2" fullinertia="1 2 2.5 .1 .2 .3"/>
      <site name="s1" pos="0 .2 .4" euler="4 5 60"/>
    </body>
  </body>
  <body name="c" pos="-.3 .4 0" euler="1 2 3">
    <joint name="ball" type="ball" pos="0 0.1 0.1"/>
    <inertial pos="0.1 0 0" mass="3" diaginertia="0.3 0.2 0.2"/>
    <site name="s2" pos=".1 .2 .3" euler="40 50 60"/>
  </body>
  <body name="d"/>
</worldbody>
<equality>
  <weld name="w1" body1="b" body2="c"/>
  <weld name="w2" body1="b" body2="c" relpose="0.3 0.1 0.2 0.5 0.5 0.5 0.5"/>
  <weld name="w3" body1="b" body2="c" anchor="0.3 0.1 0.2"/>
  <weld name="w4" body1="b" body2="c" anchor="0.3 0.1 0.2" relpose="0.3 0.1 0.2 0.5 0.5 0.5 0.5"/>
  <weld name="w5" site1="s1" site2="s2"/>
  <connect name="c1" body1="b" body2="c" anchor=".1 .2 .3"/>
  <connect name="c2" site1="s1" site2="s2"/>
  <connect name="c3" body1="b" anchor=".1 .2 .3"/>
  <connect name="off" body1="b" anchor=".1 .2 .3" active="false"/>
</equality>
<actuator>
  <motor joint="jb" gear="7"/><position joint="ja"/><motor joint="jb"/>
</actuator></mujoco>
"""


@pytest.fixture
def mjcf(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings where it stands
    path = tmp_path / "odd.xml"
    path.write_text(MJCF)
    return path


def states(count=5):
    """Coordinates and rates of the tree, and MuJoCo's coordinates with the scalar first."""
    random = np.random.default_rng(0)
    for angles, v in 0.4 * random.normal(size=(count, 2, 6)):
        x, y, z, w = pin.exp3_quat(angles[3:])
        yield np.r_[angles[:3], x, y, z, w], v, np.r_[angles[:3], w, x, y, z]


SPRUNG = {
    'type="ball"': 'type="ball" stiffness="3" damping="0.5" armature="0.1"',
    'type="slide"': 'type="slide" stiffness="11" springref="0.3"',
    'ref="30"': 'ref="30" stiffness="7" springref="50"',
}


def test_the_tree_moves_as_in_mujoco(mjcf):
    """Forces at random accelerations, springs among them, against `mj_inverse`.

    Coordinates are MuJoCo's `qpos`. Free joints are in tests/description/test_any_mjcf.py.
    """
    text = MJCF
    for old, new in SPRUNG.items():
        assert old in text
        text = text.replace(old, new)
    mjcf.write_text(text)
    mj = mujoco.MjModel.from_xml_path(str(mjcf))
    mj.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    read, data = read_mjcf(mjcf), mujoco.MjData(mj)
    model, springs = read.model, Springs(read.stiffness, read.spring_reference)
    assert list(model.names)[1:] == ["ja", "jb", "b_1", "ball"]
    for q, v, qpos in states():
        data.qpos, data.qvel, data.qacc = qpos, v, v[::-1]
        mujoco.mj_inverse(mj, data)
        forces = pin.rnea(model, model.createData(), q, v, v[::-1])
        forces += model.damping * v - springs.forces(model, q)
        np.testing.assert_allclose(forces, data.qfrc_inverse, atol=1e-11)


COUPLED = """
<mujoco><worldbody>
  <body><joint name="a" axis="0 1 0" ref="10"/><geom size=".1" mass="1"/></body>
  <body><joint name="b" axis="0 1 0" ref="-20"/><geom size=".1" mass="1"/></body>
  <body><joint name="c" axis="0 1 0"/><geom size=".1" mass="1"/></body>
</worldbody>
<tendon>
  <fixed name="ab"><joint joint="a" coef="2"/><joint joint="b" coef="-3"/></fixed>
  <fixed name="bc"><joint joint="b" coef="0.5"/><joint joint="c" coef="1"/></fixed>
</tendon>
<equality>{}</equality>
<actuator><motor tendon="ab" gear="7"/><motor joint="c"/><motor tendon="ab"/></actuator></mujoco>
"""


JOINTS = '<joint joint1="a" joint2="b" polycoef="0.1 0.2 0.3 0.4 0.5"/>'
TENDONS = '<tendon tendon1="ab" tendon2="bc" polycoef="0.1 0.7 0 0 0"/>'


@pytest.mark.filterwarnings("ignore:.*the closures hold the joints of the motors")
@pytest.mark.parametrize(
    ("equality", "locked"),
    [
        (JOINTS, ()),
        (JOINTS, ("b",)),
        (JOINTS, ("a",)),
        ('<joint joint1="a" polycoef="0.1 0 0 0 0"/>', ()),
        ('<joint joint1="a" joint2="b" polycoef="0.1 0 0 0 0"/>', ("b",)),
        (TENDONS, ()),
        (TENDONS, ("b",)),
        ('<tendon tendon1="bc" polycoef="0.1 0 0 0 0"/>', ("b",)),
    ],
)
def test_a_coupling_is_open_by_what_mujoco_measures(mjcf, equality, locked):
    """Up to the factor of the joint that it is solved for; locked joints at their reference."""
    mjcf.write_text(COUPLED.format(equality))
    mj = mujoco.MjModel.from_xml_path(str(mjcf))
    if "joint1" in equality and locked == ("a",):
        with pytest.raises(sst_pin.DescriptionError, match="cannot be solved for a joint"):
            read_mjcf(mjcf, locked)
        return
    chain = sst_pin.ClosedChain.from_mjcf(mjcf, locked=locked)
    data, random, ratios = mujoco.MjData(mj), np.random.default_rng(0), []
    for q in random.normal(size=(5, 3)):
        data.qpos = np.where(np.isin(["a", "b", "c"], locked), mj.qpos0, q)
        mujoco.mj_forward(mj, data)
        free = data.qpos[~np.isin(["a", "b", "c"], locked)]
        ratios.append(chain.residual(free)[0] / data.efc_pos[0])
    np.testing.assert_allclose(ratios, ratios[0], rtol=1e-10)


def test_a_tendon_is_a_motor_of_all_its_joints(mjcf):
    """Its force is shared as the tendon's length is; two actuators on it are one motor.

    test_mjcf_schema.py compares moment arms with MuJoCo's.
    """
    mjcf.write_text(COUPLED.format('<joint joint1="a" joint2="b"/>'))
    assert read_mjcf(mjcf).actuated == ({"ab": {"a": 2, "b": -3}}, "c")
    assert read_mjcf(mjcf, ["b"]).actuated == ({"ab": {"a": 2}}, "c")
    chain = sst_pin.ClosedChain.from_mjcf(mjcf, actuated=["c", "ab"])
    assert chain.motor_names == ("c", "ab")
    np.testing.assert_array_equal(chain.actuation, [[0, 2], [0, -3], [1, 0]])


@pytest.mark.parametrize("loose", [False, True])
def test_closures_are_open_by_what_mujoco_measures(mjcf, loose):
    """Gaps of points in base axes, and turns, of every form of `connect` and `weld`.

    A weld that carries no torque is a point.
    """
    if loose:
        mjcf.write_text(MJCF.replace("<weld", '<weld torquescale="0"'))
    mj = mujoco.MjModel.from_xml_path(str(mjcf))
    read, data = read_mjcf(mjcf), mujoco.MjData(mj)
    assert [c.kind for c in read.closures] == ["3d" if loose else "6d"] * 5 + ["3d"] * 3
    for q, _, qpos in states():
        data.qpos = qpos
        mujoco.mj_forward(mj, data)
        equality = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        assert equality.sum() == 5 * 6 + 3 * 3
        for k, closure in enumerate(read.closures):
            A, B = (body(read.model, q, name) for name in (closure.frame_a, closure.frame_b))
            theirs = data.efc_pos[equality & (data.efc_id == k)]
            np.testing.assert_allclose(A.translation - B.translation, theirs[:3], atol=1e-12)
            half_sine = np.linalg.norm(pin.Quaternion(A.rotation.T @ B.rotation).coeffs()[:3])
            turn = half_sine if closure.kind == "6d" else 0.0
            assert abs(turn - np.linalg.norm(theirs[3:])) < 1e-12


def test_motors_friction_rotors_and_gravity_come_along(mjcf):
    read = read_mjcf(mjcf)
    assert read.actuated == ("jb", "ja")
    np.testing.assert_array_equal(read.model.armature, [0.2, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(read.model.damping, [0.3, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(read.model.friction, [0, 0.4, 0, 0, 0, 0])
    np.testing.assert_array_equal(read.model.gravity.linear, [0.5, -1, -9])
    assert read.model.name == "odd"


def test_locked_joints_stay_at_their_reference(mjcf):
    """The bodies stand as with all coordinates at `ref`, a locked motor is none."""
    free, held = read_mjcf(mjcf), read_mjcf(mjcf, ["ja", "b_1", "ball_wy"])
    assert list(held.model.names)[1:] == ["jb", "ball_wx", "ball_wz"]
    assert held.actuated == ("jb",)
    turned = pin.Quaternion(_about("XZ", [0.4, 0.5])).coeffs()
    at_reference = np.r_[np.radians(30), 0.3, 0, turned]
    for end in ("w4_A", "w4_B", "c3_B"):
        expected = body(free.model, at_reference, end)
        assert body(held.model, np.array([0.3, 0.4, 0.5]), end).isApprox(expected, 1e-12)
    assert list(read_mjcf(mjcf, ["ball"]).model.names)[1:] == ["ja", "jb", "b_1"]
    with pytest.raises(sst_pin.UnknownNameError, match=r"'knee'.*ball_wz"):
        read_mjcf(mjcf, ["knee"])


FIXED = '<tendon><fixed {}="{}"><joint joint="ja" coef="{}"/></fixed></tendon><actuator>'
ZERO = FIXED.format("name", "t", 0)
DC = '<dcmotor joint="jb" motorconst=".5" resistance="1" input="none"/>'
MANY = 500 * '<body><joint axis="1 0 0"/><geom size=".1"/></body>'


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("<mujoco", "<nonsense", "not an MJCF"),
        ('"d"/>', '"d"><joint name="b_1"/><geom size="1"/></body>', "several joints b_1"),
        ("<joint axis", '<joint name="jä" axis', "names that are not UTF-8"),
        ('<body name="d"/>', MANY, "504 moving joints; at most"),
        ('<motor joint="jb"/>', '<motor site="s1" refsite="s2"/>', "an actuator on a site"),
        ('<motor joint="jb"/>', DC, "actuator_2: it acts without a control"),
        ("<actuator>", f'{ZERO}<motor name="m" tendon="t"/>', "m: the coefficients of its tendon"),
        ('"ball" type', '"universe" type', "joint universe: Pinocchio's base has this name"),
        ('damping="0.3"', 'damping="nan"', "joint ja: damping is not finite"),
        ('damping="0.3"', 'damping="-1"', "joint ja: damping -1 is negative"),
        ('ref="30"', 'ref="nan"', "a joint's ref is not finite"),
        ('gravity="0.5', 'gravity="nan', "gravity is not finite"),
        ('"c3" body1="b" anchor=".1', '"c3" body1="b" anchor="nan', "c3: data is not finite"),
        ('gear="7"', 'gear="0"', "actuator_0: its gear is 0"),
        ("<equality>", '<option><flag equality="disable"/></option><equality>', "no closure"),
    ],
)
def test_what_the_dynamics_would_overlook_is_refused(mjcf, old, new, word):
    assert old in MJCF
    mjcf.write_bytes(MJCF.replace(old, new, 1).encode("latin-1"))
    with pytest.raises(sst_pin.DescriptionError) as caught:
        read_mjcf(mjcf)
    assert word in str(caught.value)
    assert str(mjcf) in str(caught.value)


def test_motors_that_are_named_count_in_the_place_of_the_files(mjcf):
    """They count where no motor of the file can be computed, too, as the error says."""
    text = MJCF.replace('<motor joint="jb"/>', '<motor joint="ball" gear="0 1 0"/>')
    mjcf.write_text(text)
    with pytest.raises(sst_pin.DescriptionError, match=r"an actuator on a ball.*by actuated="):
        read_mjcf(mjcf)
    read = read_mjcf(mjcf, actuated=["ja"])
    assert read.actuated == ("ja",)
    assert len(read.shapes.args[1]) == 5  # for pictures
