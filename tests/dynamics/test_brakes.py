# SPDX-License-Identifier: BSD-2-Clause
"""Robots that stand: brakes, and structures without a degree of freedom."""

import io

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import ClosedChain, Distance, LineForce, coordinate_motion, frame_motion, robots
from sst_pin.errors import DescriptionError, FileFormatError, InputError, UnknownNameError
from sst_pin.files import read_table
from sst_pin.identification import measured_motion
from sst_pin.loops.start import placed
from sst_pin.simulation.motion_files import read_motion, read_start
from tests.support.files import ROOT

#: Rounding of torques of 1 N m that sums of a hundred products leave.
ROUNDING = 1e-12


def boom(*closures, **more) -> ClosedChain:
    """A boom of 3 kg and 2 m on a hinge, level; its foot A is 1.5 m above the hinge of the strut.

    The strut ends 0.8 m along the boom at B, 1.7 m from the foot of the strut.
    """
    model = pin.Model()
    model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "boom")
    model.appendBodyToJoint(1, pin.Inertia(3, np.array([1.0, 0, 0]), np.eye(3)), pin.SE3.Identity())
    for name, joint, place in (("A", 0, (0, 0, -1.5)), ("B", 1, (0.8, 0, 0))):
        at = pin.SE3(np.eye(3), np.array(place, dtype=float))
        model.addFrame(pin.Frame(name, joint, at, pin.FrameType.OP_FRAME))
    model.referenceConfigurations["home"] = np.zeros(1)
    return ClosedChain(model, closures, more.pop("actuated", []), **more)


def strut_force() -> float:
    """By hand: moments about the hinge, 3 kg at 1 m; the strut pushes B along A to B."""
    lever = 0.8 * 1.5 / 1.7  # of the strut's line about the hinge
    return 3 * 9.81 / lever


@pytest.mark.parametrize("robot", [robots.four_bar, robots.delta, robots.stewart, robots.five_bar])
def test_brakes_of_all_motors_carry_the_holding_torques(robot):
    chain = robot()
    rest = np.zeros(chain.degrees_of_freedom)
    standing = chain.with_brakes(chain.motor_names)
    assert standing.degrees_of_freedom == 0
    w = standing.reactions(chain.home)
    torques = chain.compute_torques(chain.home, rest, rest)
    np.testing.assert_allclose(list(w.brakes.values()), torques, atol=ROUNDING * 100)
    assert tuple(w.brakes) == chain.motor_names
    np.testing.assert_array_equal(standing.compute_torques(chain.home, [], []), 0 * torques)


def test_a_brake_holds_at_any_position():
    chain = robots.delta()
    standing = chain.with_brakes(chain.motor_names)
    q = chain.assemble(dict(zip(chain.motor_names, (0.1, 0.35, 0.2), strict=True)))
    brakes = standing.reactions(np.array([chain.home, q])).brakes
    at_rest = chain.compute_torques([chain.home, q], np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(np.transpose(list(brakes.values())), at_rest, atol=ROUNDING)


def test_bearings_of_a_braked_robot_carry_what_they_carry_under_its_motors():
    chain = robots.delta()
    moved, held = np.zeros(3), chain.with_brakes(chain.motor_names).reactions(chain.home)
    w = chain.reactions(chain.home, moved, moved)
    np.testing.assert_allclose(held.joints, w.joints, atol=ROUNDING)
    np.testing.assert_allclose(held.closures[: len(chain.closures)], w.closures, atol=ROUNDING)
    np.testing.assert_allclose(held.ground, w.ground, atol=ROUNDING)


def test_a_strut_that_makes_a_structure_of_a_boom_has_its_force_by_hand():
    chain = boom(Distance("A", "B", 1.7))
    assert chain.mobility().degrees_of_freedom == 0
    assert "nothing moves" in str(chain.mobility())
    w = chain.reactions([0.0])
    np.testing.assert_allclose(np.linalg.norm(w.of("A - B")), strut_force(), rtol=ROUNDING)
    np.testing.assert_allclose(w.ground[2] + w.ground[5], 3 * 9.81, rtol=ROUNDING)


@pytest.mark.parametrize("compiled", [False, True])
def test_the_locked_valve_of_a_ram_has_its_force_by_hand(compiled):
    ram = LineForce("A", "B", name="ram")
    standing = boom(lines=[ram], actuated=["ram"], brakes=["ram"])
    assert standing.degrees_of_freedom == 0
    np.testing.assert_allclose(standing.reactions([0.0]).brakes["ram"], strut_force(), rtol=1e-12)
    # Half of it by the pump: the valve carries the rest.
    w = standing.reactions([0.0], [], tau=[strut_force() / 2])
    np.testing.assert_allclose(w.brakes["ram"], strut_force() / 2, rtol=1e-12)
    if compiled:
        pytest.importorskip("casadi")
        with pytest.raises(DescriptionError, match="nothing can move"):
            standing.compile()


def test_brakes_beyond_need_are_not_unique_until_stiffnesses_share_the_load():
    chain = robots.four_bar()
    standing = chain.with_brakes(["crank", "rocker"])
    w = standing.reactions(chain.home)
    assert np.isnan(w.brakes["crank"])
    assert np.isnan(w.brakes["rocker"])
    assert "2 redundant" in str(standing.mobility())
    soft = {name: [np.inf, np.inf, np.inf, np.inf, np.inf, np.inf] for name in w.names}
    for name in ("brake of crank", "brake of rocker"):
        soft[name] = [100.0] * 6
    shared = standing.reactions(chain.home, stiffness=soft).brakes
    # The least elastic energy among all brakes (x, y) with x + r y = crank torque, r = dr/dc.
    r = chain.joint_rates(chain.home, [1.0])[list(chain.joint_names).index("rocker")]
    torque = chain.compute_torques(chain.home, [0.0], [0.0])[0]
    np.testing.assert_allclose(shared["crank"], torque / (1 + r**2), rtol=1e-9)
    np.testing.assert_allclose(shared["rocker"], torque * r / (1 + r**2), rtol=1e-9)


def test_a_braked_joint_moves_as_a_locked_one():
    chain = robots.stewart()
    q, name = chain.generic_configuration(), chain.motor_names[0]
    braked = chain.with_brakes([name])
    at = list(chain.joint_names).index(name)
    position = q[chain.model.joints[at + 1].idx_q]
    locked = ClosedChain(
        chain.model,
        chain.closures,
        chain.motor_names[1:],
        coordinates=braked.coordinates,
        locked={name: float(position)},
    )
    q_locked = locked.assemble(np.delete(q, chain.model.joints[at + 1].idx_q))
    random = np.random.default_rng(3)
    va, tau = random.normal(size=(2, 5))
    aa = braked.compute_accelerations(q, va, [7.0, *tau])  # the brake holds against its motor
    np.testing.assert_allclose(aa, locked.compute_accelerations(q_locked, va, tau), rtol=1e-9)
    needed = locked.compute_torques(q_locked, va, aa)
    np.testing.assert_allclose(braked.compute_torques(q, va, aa)[1:], needed, rtol=1e-9)
    assert abs(braked.joint_rates(q, va)[chain.model.joints[at + 1].idx_v]) < 1e-14


def test_kernels_and_casadi_agree_with_the_reference_path_on_brakes():
    pytest.importorskip("casadi")
    chain = robots.five_bar().with_brakes(["shoulder_1"])
    compiled = robots.five_bar().with_brakes(["shoulder_1"])
    compiled.compile()
    q, va, aa = chain.generic_configuration(), np.array([0.3]), np.array([0.5])
    w, other = chain.reactions(q, va, aa), compiled.reactions(q, va, aa)
    np.testing.assert_allclose(other.brakes["shoulder_1"], w.brakes["shoulder_1"], rtol=1e-10)
    np.testing.assert_allclose(other.joints, w.joints, atol=1e-10)
    functions, slopes = chain.casadi(), chain.torque_derivatives(q, va, aa)
    for one, two in zip(functions.torque_derivatives(q, va, aa), slopes, strict=True):
        np.testing.assert_allclose(np.array(one), two, atol=1e-10)
    tau = np.array(functions.torques(q, va, aa)).ravel()
    np.testing.assert_allclose(tau, chain.compute_torques(q, va, aa), rtol=1e-9)


def two_rams() -> tuple[ClosedChain, ClosedChain]:
    """A boom and a jib, each with a ram; the second robot holds the ram of the boom."""
    model = pin.Model()
    joint = 0
    for name, x in (("boom", 0.0), ("jib", 2.0)):
        place = pin.SE3(np.eye(3), np.array([x, 0, 0]))
        joint = model.addJoint(joint, pin.JointModelRY(), place, name)
        body = pin.Inertia(3, np.array([1.0, 0.1, 0.2]), np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    ends = {"A": (0, (0, 0, -1.5)), "B": (1, (0.8, 0, 0)), "C": (1, (1, 0, 1)), "D": (2, (1, 0, 0))}
    for name, (parent, place) in ends.items():
        at = pin.SE3(np.eye(3), np.array(place, dtype=float))
        model.addFrame(pin.Frame(name, parent, at, pin.FrameType.OP_FRAME))
    lines = [LineForce("A", "B", name="ram", damping=3), LineForce("C", "D", name="jib_ram")]
    free = ClosedChain(model, [], ["ram", "jib_ram"], lines=lines)
    return free, free.with_brakes(["ram"])


def test_a_braked_ram_makes_the_rows_of_a_rod_of_its_length():
    free, held = two_rams()
    q, rod = np.array([0.3, -0.5]), Distance("A", "B", float(free.line_lengths([0.3, -0.5])[0]))
    with_rod = ClosedChain(free.model, [rod], ["jib_ram"], coordinates=["jib"], lines=free.lines)
    for state in ((q, [0.7], [0.4]), (q, [-1.0], [2.0])):
        tau = with_rod.compute_torques(*state)
        np.testing.assert_allclose(held.compute_torques(*state), [0.0, *tau], rtol=1e-10)
        w = with_rod.reactions(*state).closures[0]
        size = np.linalg.norm(w)
        np.testing.assert_allclose(abs(held.reactions(*state).brakes["ram"]), size, rtol=1e-10)
        one, two = held.torque_derivatives(*state), with_rod.torque_derivatives(*state)
        np.testing.assert_allclose(one.dq, two.dq, atol=1e-10)


def test_kernels_agree_on_a_braked_ram():
    pytest.importorskip("casadi")
    _, held = two_rams()
    state = np.array([0.3, -0.5]), np.array([0.7]), np.array([0.4])
    functions = held.casadi()
    derivatives = held.torque_derivatives(*state)
    for part, values in zip(derivatives, functions.torque_derivatives(*state), strict=True):
        np.testing.assert_allclose(np.array(values), part, atol=1e-10)
    np.testing.assert_allclose(
        np.array(functions.torques(*state)).ravel(), held.compute_torques(*state), atol=1e-10
    )


#: MuJoCo's tests of forces in bodies that stand, `rne_post`: body 2 hangs from a weld or a point of
#: body 1; a sensor on body 1 reads the force and the moment of both bodies, 1 kg each.
MUJOCO = """<mujoco><option gravity="{gravity}"/><worldbody>
<body name="body1" {tilt}><geom type="box" size=".05 .05 .05"/><site name="sensor" {site}/></body>
<body name="body2" {at}><joint name="j" {joint}/>
<inertial pos="{centre}" mass="1" diaginertia="1 1 1"/></body></worldbody>
<equality>{equality}</equality></mujoco>"""
_WELD = '<weld name="w" body1="body1" body2="body2"/>'
_TILTED = {"tilt": 'euler="0 45 0"', "site": 'euler="0 0 90"'}
_DOWN = {"gravity": "0 0 -1", "joint": 'type="free"'}
_LEVER = _DOWN | {"centre": "1 0 0", "equality": _WELD}
_POINT = '<connect name="w" body1="body1" body2="body2" anchor="{}"/>'
_UPRIGHT = {"tilt": "", "site": "", "centre": "0 0 0"}
ROOT_2 = 1.41421356237


@pytest.mark.parametrize(
    ("parts", "force", "moment"),
    [
        (_LEVER | {"tilt": "", "site": "", "at": 'pos="0 1 0"'}, (0, 0, 2), (1, -1, 0)),
        (
            _LEVER | _TILTED | {"at": 'pos="0 1 0" euler="30 30 30"'},
            (0, ROOT_2, ROOT_2),
            (-0.75, -1.166386108, 1.166386108),
        ),
        (  # connect/torque_free
            _DOWN | _UPRIGHT | {"at": 'pos="0 2 0"', "equality": _POINT.format("0 2 0")},
            (0, 0, 2),
            (2, 0, 0),
        ),
        (  # connect/force_free: the body hangs straight from the point
            _DOWN
            | _UPRIGHT
            | {"gravity": "1 2 3", "at": 'pos="1 2 3"', "equality": _POINT.format("0 0 0")},
            (-2, -4, -6),
            (0, 0, 0),
        ),
    ],
)
def test_a_body_that_cannot_move_is_carried_as_in_the_tests_of_mujoco(
    tmp_path, parts, force, moment
):
    pytest.importorskip("mujoco")
    path = tmp_path / "stands.xml"
    path.write_text(MUJOCO.format(**parts))
    chain = ClosedChain.from_mjcf(path)
    q = chain.home
    rest = np.zeros(chain.degrees_of_freedom)
    on_b, about_b = np.split(chain.reactions(q, rest, rest).of("w_A - w_B"), 2)
    p, R = chain.frame_placement(q, "w_B")
    _, R_sensor = chain.frame_placement(q, "sensor")
    in_base = R @ on_b
    weight = -np.array(parts["gravity"].split(), dtype=float)  # of body 1
    np.testing.assert_allclose(R_sensor.T @ (in_base + weight), force, atol=1e-9)
    about_sensor = R @ about_b + np.cross(p, in_base)
    np.testing.assert_allclose(R_sensor.T @ about_sensor, moment, atol=1e-9)


_WELDED_POINT = '<weld name="w" body1="body1" body2="body2" anchor="0 0 0" torquescale="0"/>'


@pytest.mark.parametrize("equality", [_POINT.format("0 0 0"), _WELDED_POINT])
@pytest.mark.parametrize(
    ("pose", "at", "force"),
    [
        (_UPRIGHT, "0 0 -0.1", (0, 0, 2)),  # connect/force_slide, weld/tfratio0_force_slide
        (_UPRIGHT | _TILTED, "0 0 -0.2", (0, ROOT_2, ROOT_2)),  # and their `_rotated`
    ],
)
def test_a_body_on_a_slide_is_carried_as_in_the_tests_of_mujoco(
    tmp_path, equality, pose, at, force
):
    """The weight is along the slide, where the force is unique; across it the slide shares it."""
    pytest.importorskip("mujoco")
    path = tmp_path / "stands.xml"
    parts = {"gravity": "0 0 -1", "joint": 'type="slide" axis="0 0 1"', "at": f'pos="{at}"'}
    path.write_text(MUJOCO.format(**pose | parts | {"equality": equality}))
    chain = ClosedChain.from_mjcf(path)
    assert chain.degrees_of_freedom == 0
    on_b = chain.reactions(chain.home, axes=np.eye(3)).of("w_A - w_B")[:3]
    assert np.isnan(on_b[:2]).all()
    _, R_sensor = chain.frame_placement(chain.home, "sensor")
    weight = 1.0  # of body 1
    np.testing.assert_allclose(on_b[2] + weight, (R_sensor @ force)[2], atol=1e-9)


def test_what_moves_beside_a_body_that_cannot_does_not_change_what_carries_it(tmp_path):
    """`connect/multiple_constraints`: a block is held by dry friction, here by a brake."""
    pytest.importorskip("mujoco")
    path = tmp_path / "stands.xml"
    path.write_text("""<mujoco><option gravity="1 2 3"/>
        <default><geom size="0.05 0.05 0.05" type="box"/></default><worldbody>
        <body name="body0" pos="-3 0 0"><joint name="joint0" type="slide" axis="0 0 1"/><geom/>
        </body>
        <body name="body1"><geom/><site name="sensor"/></body>
        <body name="body2" pos="1 2 3"><joint type="free"/><geom/></body>
        <body name="body3" pos="3 0 0"><geom/><body name="body3b" pos="3 0 -1">
        <joint name="block" type="slide" axis="0 0 1" frictionloss="9"/><geom/></body></body>
        <body name="body4" pos="4 0 0"><joint type="free"/><geom/></body></worldbody>
        <equality><joint joint1="joint0"/><weld body1="body3" body2="body4"/>
        <connect name="w" body1="body1" body2="body2" anchor="0 0 0"/></equality></mujoco>""")
    chain = ClosedChain.from_mjcf(path)
    assert chain.degrees_of_freedom == 4  # three turns of body 2, and the block
    standing = chain.with_brakes(["block"])
    w = standing.reactions(chain.home)
    _, R = chain.frame_placement(chain.home, "w_B")
    np.testing.assert_allclose(R @ w.of("w_A - w_B")[:3], (-1, -2, -3), atol=1e-9)
    np.testing.assert_allclose(w.brakes["block"], -3.0, atol=1e-9)
    np.testing.assert_allclose(w.of("joint0 after nothing")[2], -3.0, atol=1e-9)


def test_a_rope_that_carries_a_body_carries_it_as_in_the_tests_of_mujoco(tmp_path):
    """`rne_post/tendon/equality_free`: 1 N upwards on the fixed end, 1 N down on the other."""
    pytest.importorskip("mujoco")
    path = tmp_path / "rope.xml"
    path.write_text("""<mujoco><option gravity="0 0 -1"/><worldbody><site name="fixedend"/>
        <body name="mass" pos="0 0 -0.5"><freejoint/><geom size=".05" mass="1"/>
        <site name="massend"/></body></worldbody><tendon><spatial name="rope">
        <site site="fixedend"/><site site="massend"/></spatial></tendon>
        <equality><tendon name="rope" tendon1="rope"/></equality></mujoco>""")
    chain = ClosedChain.from_mjcf(path)
    rest = np.zeros(chain.degrees_of_freedom)
    w = chain.reactions(chain.home, rest, rest)
    _, R = chain.frame_placement(chain.home, "massend")
    (name,) = [str(closure) for closure in chain.closures]
    np.testing.assert_allclose(R @ w.of(name)[:3], (0, 0, 1), atol=1e-12)


def test_brakes_of_a_yaml_are_those_of_python(tmp_path):
    for name in ("delta.urdf", "delta.yaml"):
        (tmp_path / name).write_text((ROOT / "examples" / name).read_text())
    free = ClosedChain.from_urdf(tmp_path / "delta.urdf")
    with (tmp_path / "delta.yaml").open("a") as file:
        file.write("\nbrakes: [motor_1]\n")
    held = ClosedChain.from_urdf(tmp_path / "delta.urdf")
    assert [str(closure) for closure in held.closures][-1] == "brake of motor_1"
    assert held.closures == free.with_brakes(["motor_1"]).closures


def test_wrong_brakes_are_refused():
    chain = robots.four_bar()
    with pytest.raises(UnknownNameError, match="wheel"):
        chain.with_brakes(["wheel"])
    with pytest.raises(InputError, match="appears twice"):
        chain.with_brakes(["crank", "crank"])
    with pytest.raises(InputError, match="crank is a coordinate"):
        ClosedChain(chain.model, chain.closures, ["crank"], coordinates=["crank"], brakes=["crank"])
    with pytest.raises(DescriptionError, match="nothing can move"):
        chain.with_brakes(["crank"]).compute_torques(chain.home, [0.0], [0.0])


def test_closing_the_loops_keeps_braked_joints_where_they_are():
    chain = robots.four_bar()
    guess = chain.home + np.array([0.2, 0.1, 0.1])
    held = chain.with_brakes(["rocker"]).assemble(guess)
    rocker = list(chain.joint_names).index("rocker")
    assert held[rocker] == guess[rocker]
    # Two brakes at positions that contradict each other give way.
    both = chain.with_brakes(["crank", "rocker"]).assemble(guess)
    assert np.abs(chain.residual(both)).max() < 1e-10


def test_whatever_closes_open_loops_keeps_braked_joints_where_they_are():
    """By positions of joints, from several starts, for a frame, and at the start of a motion."""
    chain = robots.planar_3rrr().with_brakes(["shoulder_1"])
    names = list(chain.position_names)
    start = chain.home + np.linspace(-0.1, 0.1, len(names))
    braked = start[names.index("shoulder_1")]
    coordinates = {name: start[names.index(name)] for name in chain.coordinates}
    p, _ = chain.frame_placement(chain.home, "platform")
    for q in (
        placed(chain.engine, coordinates, start),
        chain.assemble(start, tries=3),
        chain.frame_configuration("platform", p + np.array([0.001, 0.002, 0]), start=start),
        coordinate_motion(chain, [0, 1, 2], [[*coordinates.values()]] * 3, start=start).q[0],
    ):
        assert np.abs(chain.residual(q)).max() < 1e-12
        assert q[names.index("shoulder_1")] == braked
    home = dict(zip(names, chain.home, strict=True))
    q = chain.assemble({"shoulder_2": home["shoulder_2"] + 0.05, "elbow_2": home["elbow_2"]})
    assert q[names.index("shoulder_1")] == home["shoulder_1"]


T = np.linspace(0, 4, 801)


@pytest.fixture(scope="module")
def braked():
    """A robot whose first shoulder is held 0.1 rad from home, and this configuration."""
    chain = robots.planar_3rrr()
    start = chain.assemble({"shoulder_1": chain.home[0] + 0.1}, fixed=["shoulder_1"])
    return chain.with_brakes(["shoulder_1"]), start


def motions_by_start(chain, start):
    """Functions of a start that make a motion, by name."""
    names = list(chain.position_names)
    x = start[[names.index(name) for name in chain.coordinates]] + 0.01 * np.sin(3 * T)[:, None]
    p, _ = chain.frame_placement(start, "platform")
    points = p + 0.001 * np.outer(np.sin(T), [1.0, 0.0, 0.0])
    tau = np.cos(3 * T)[:, None] * np.ones(len(chain.motor_names))
    return {
        "coordinate_motion": lambda **more: coordinate_motion(chain, T[:9], x[:9], **more),
        "measured_motion": lambda **more: measured_motion(chain, T, x, tau, cutoff=5, **more),
        "frame_motion": lambda **more: frame_motion(chain, T[:9], "platform", points[:9], **more),
    }


@pytest.mark.parametrize("name", ["coordinate_motion", "measured_motion", "frame_motion"])
def test_a_motion_of_a_braked_robot_needs_a_start(braked, name):
    """The coordinates do not say where a brake holds; home was taken without a word."""
    chain, start = braked
    function = motions_by_start(chain, start)[name]
    with pytest.raises(InputError, match=r"^start: .* brakes hold shoulder_1; give start="):
        function()
    motion = function(start=start)
    shoulder = list(chain.position_names).index("shoulder_1")
    np.testing.assert_allclose(motion.q[:, shoulder], start[shoulder], atol=1e-12)


def test_a_file_of_a_braked_robot_needs_a_column_of_the_joint_that_is_held(braked):
    chain, start = braked
    positions = dict(zip(chain.position_names, start.tolist(), strict=True))

    def file(*joints):
        rows = [",".join([f"{t}", *(f"{positions[name]!r}" for name in joints)]) for t in range(4)]
        head = ",".join(["t_s", *(f"{name}_rad" for name in joints)])
        return io.BytesIO("\n".join([head, *rows]).encode())

    with pytest.raises(FileFormatError, match=r"no columns shoulder_1_rad .* where brakes hold"):
        read_motion(chain.engine, file(*chain.coordinates))
    motion = read_motion(chain.engine, file(*chain.coordinates, "shoulder_1"))
    np.testing.assert_allclose(motion.q, start[None].repeat(4, axis=0), atol=1e-9)

    # The start of a simulation, by names.
    table = read_table(file(*chain.coordinates))
    q0 = {name: positions[name] for name in chain.coordinates}
    with pytest.raises(FileFormatError, match="no shoulder_1 for the initial positions"):
        read_start(chain.engine, table, q0)
    q, _ = read_start(chain.engine, table, {**q0, "shoulder_1": positions["shoulder_1"]})
    np.testing.assert_allclose(q, start, atol=1e-9)


def test_a_file_of_a_robot_with_a_braked_line_needs_columns_of_all_joints():
    bar = robots.five_bar()
    line = LineForce("universe", "platform", name="valve")
    chain = ClosedChain(bar.model, bar.closures, bar.motor_names, lines=[line], brakes=["valve"])
    columns = [f"{name}_rad" for name in chain.coordinates]
    rows = "\n".join(f"{t}" + f",{0.1}" * len(columns) for t in range(3))
    file = io.BytesIO(f"{','.join(['t_s', *columns])}\n{rows}".encode())
    with pytest.raises(FileFormatError, match=r"no columns .* where brakes hold"):
        read_motion(chain.engine, file)

    # The error of a start names each joint once.
    table = read_table(io.BytesIO(b"t_s\n0\n1\n"))
    with pytest.raises(FileFormatError, match="for the initial positions") as caught:
        read_start(chain.engine, table, {})
    for name in chain.position_names:
        assert str(caught.value).count(f"{name}=") == 1


def test_the_regressor_of_a_held_robot_has_a_column_for_each_parameter_and_no_row():
    bar = robots.four_bar()
    line = LineForce("universe", "rocker_pin", stiffness=2.0, coulomb_friction=1.0)
    held = ClosedChain(bar.model, bar.closures, ["crank"], lines=[line], brakes=["crank"])
    assert held.torque_regressor(bar.home, [], []).shape == (0, len(held.dynamic_parameters.names))
