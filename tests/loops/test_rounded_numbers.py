# SPDX-License-Identifier: BSD-2-Clause
"""Robots with rounded placements: their overconstrained loops close and move all the same."""

import re
import warnings

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import ClosedChain, Closure, ClosureError, DescriptionWarning, SSTError, robots
from sst_pin.loops.rounded_numbers import half_a_digit
from tests.support.any_chain import states
from tests.support.by_hand import add, at, in_units, mark
from tests.support.planar_bars import planar

#: How far torques of a robot may be off, relative to the largest, in units of its last digit.
EXPLAINED = 300


def bar(kind="hinge", across=0.0, tilt=0.0, tilted=""):
    """A four-bar of 0.4 m, its closure off the plane, or one of its axes tilted."""
    bars = [("crank", "universe", 0.0, 0.1), ("coupler", "crank", 0.1, 0.3)]
    model = planar([*bars, ("rocker", "universe", 0.4, 0.25)])
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    if tilted:
        j = model.getJointId(tilted)
        turn = at(turned=pin.utils.rotate("x", tilt))
        model.jointPlacements[j] = model.jointPlacements[j] * turn
    frame = model.frames[model.getFrameId("coupler_end")]
    frame.placement = frame.placement * at(0, 0, across)
    # The coupler of 0.3 m and the rocker of 0.25 m meet at angles to the way between their starts.
    x, y = 0.4 - 0.1 * np.cos(1.2), -0.1 * np.sin(1.2)
    way, length = np.arctan2(y, x), np.hypot(x, y)
    at_crank = np.arccos((length**2 + 0.3**2 - 0.25**2) / (2 * 0.3 * length))
    at_ground = np.arccos((length**2 + 0.25**2 - 0.3**2) / (2 * 0.25 * length))
    home = [1.2, way + at_crank - 1.2, way + np.pi - at_ground]
    model.referenceConfigurations["home"] = np.array(home)
    return model, [Closure("coupler_end", "rocker_end", kind)], ["crank"]


#: Redundant rows of one loop in a plane, of loops in series, of axes that meet in a point.
ROBOTS = {
    "four-bar with hinge": lambda: ClosedChain(*bar()),
    "scissor": robots.scissor_lift,
    "spherical 3-RRR": robots.agile_wrist,
    "SST": sst_pin.SST,
}


def drawn_by_cad(chain):
    """The same robot: its base elsewhere, link frames turned about and shifted along their axes.

    Its joints, of one coordinate each, are at zero at home.
    """
    random, old = np.random.default_rng(0), chain.model
    model, data = pin.Model(old), old.createData()
    pin.forwardKinematics(old, data, chain.home)
    R = pin.exp3(random.uniform(-1.5, 1.5, 3))
    ways = [pin.SE3(R, random.uniform(-0.3, 0.3, 3)).inverse()]
    for joint in list(data.joints)[1:]:
        axis = np.ravel(joint.S).reshape(2, 3).sum(axis=0)
        turn = pin.exp3(axis * random.uniform(-3, 3))
        ways.append(pin.SE3(turn, axis * random.uniform(-0.1, 0.1)))
    for j in range(1, model.njoints):
        model.jointPlacements[j] = ways[model.parents[j]].inverse() * data.liMi[j] * ways[j]
        model.inertias[j] = ways[j].inverse().act(model.inertias[j])
    for frame in model.frames:
        frame.placement = ways[frame.parentJoint].inverse() * frame.placement
    model.gravity.linear = R @ old.gravity.linear
    model.friction[:] = 0  # its sign would hang on the last digit of a rate
    model.referenceConfigurations["home"] = np.zeros(model.nq)
    return ClosedChain(model, chain.closures, chain.motor_names)


def rounded(chain, digits):
    """The robot whose placements have so many digits after the point, in x, y, z, roll, pitch, yaw.

    Beside it stand the texts of the warnings.
    """
    model = with_digits(chain.model, digits)
    return with_warnings(ClosedChain, model, chain.closures, chain.motor_names)


def with_warnings(make, *arguments):
    """What `make` gives, and the texts of its warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = make(*arguments)
    assert all(w.category is DescriptionWarning for w in caught)
    return result, [str(w.message) for w in caught]


@pytest.mark.parametrize(("name", "digits"), [*((name, 4) for name in ROBOTS), ("scissor", 7)])
def test_a_rounded_robot_moves_as_the_exact_one(name, digits):
    """Freedoms and coordinates are the same, torques are but for its digits.

    Its numbers are corrected once: the robot in other coordinates warns no more.
    """
    exact = drawn_by_cad(ROBOTS[name]())
    chain, records = rounded(exact, digits)
    assert len(records) == 1
    assert with_warnings(chain.with_coordinates, chain.coordinates)[1] == []
    assert chain.coordinates == exact.coordinates
    mobility, other = chain.mobility(), exact.mobility()
    assert (mobility.degrees_of_freedom, mobility.rank, mobility.held) == (
        other.degrees_of_freedom,
        other.rank,
        other.held,
    )
    q, va, aa = states(exact, 3, 0)
    f = exact.generalized_forces(q, va, aa)
    q = np.array([chain.assemble(x, chain.coordinates) for x in q])
    assert np.abs(chain.residual(q)).max() < 1e-11
    difference = chain.generalized_forces(q, va, aa) - f
    assert np.abs(difference).max() < EXPLAINED * 10.0**-digits * np.abs(f).max()
    for x, rates in zip(q, va, strict=True):  # an identity of the exact robot, as exact as there
        assert np.abs(chain.Phi(x) @ chain.noc(x, rates).L).max() < 1e-13


#: A bar drawn along x on its parent, and a link at its end.
LINK = """<link name="{name}"><inertial><origin xyz="{centre} 0 0"/><mass value="1"/>
<inertia ixx="0.004" iyy="0.004" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="{x} 0 0" rpy="{roll} 0 0"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>
<link name="{name}_end"/><joint name="to_{name}_end" type="fixed"><parent link="{name}"/>
<child link="{name}_end"/><origin xyz="{length} 0 0"/></joint>"""


def test_right_angles_of_a_file_may_be_rounded(tmp_path):
    """A four-bar in the x-z plane whose axes, of rolls 1.5708 and 1.571, are parallel to 2e-4."""
    rolls = {"crank": "1.5708", "coupler": "0", "rocker": "1.571"}
    bars = [("crank", "ground", 0.0, 0.1), ("coupler", "crank", 0.1, 0.3)]
    links = ['<robot name="bar"><link name="ground"/>']
    for name, parent, x, length in [*bars, ("rocker", "ground", 0.4, 0.25)]:
        numbers = {"x": x, "length": length, "centre": length / 2, "roll": rolls[name]}
        links.append(LINK.format(name=name, parent=parent, **numbers))
    path = tmp_path / "bar.urdf"
    path.write_text("".join([*links, "</robot>"]))
    path.with_suffix(".yaml").write_text(
        "closed_loop: [[coupler_end, rocker_end]]\ntype: [hinge]\nname_mot: [crank]\n"
    )
    chain, records = with_warnings(ClosedChain.from_urdf, path)
    assert sum("placements are rounded" in text for text in records) == 1
    q = chain.assemble([1.2, -0.725, 1.969], ["crank"])
    exact = ClosedChain(*bar())
    assert_allclose(
        chain.compute_torques(q, [1], [1]), exact.compute_torques(exact.home, [1], [1]), rtol=1e-4
    )
    problems, records = with_warnings(sst_pin.validate, path)
    assert not records
    assert {p.severity for p in problems} == {"note"}
    assert sum("placements are rounded" in p.text for p in problems) == 1


def test_the_warning_says_which_loops_are_open_how_far_and_what_was_changed():
    model, *others = bar(across=2e-4)
    chain, (records,) = with_warnings(ClosedChain, model, *others)
    assert "coupler_end - rocker_end" in records
    assert "placements are rounded" in records
    metres, degrees, by_metres, by_degrees = map(
        float, re.findall(r"([\d.e-]+) (?:m|degrees)\b", records)
    )
    assert metres == pytest.approx(2e-4, rel=0.02)
    places = zip(model.frames, chain.mechanism.model.frames, strict=True)
    ways = [pin.log6(a.placement.actInv(b.placement)).vector for a, b in places]
    places = zip(model.jointPlacements, chain.mechanism.model.jointPlacements, strict=True)
    ways += [pin.log6(a.actInv(b)).vector for a, b in places]
    assert by_metres == pytest.approx(np.abs(ways)[:, :3].max(), rel=0.05)
    assert np.radians(by_degrees) == pytest.approx(np.abs(ways)[:, 3:].max(), rel=0.05)
    assert by_metres < metres
    assert degrees < 0.1


def test_the_model_of_a_robot_has_the_corrected_placements_and_is_its_own():
    """Pinocchio and the robot place frames alike; the given tree stays; a refresh moves nothing."""
    given, *others = bar(across=2e-4)
    before = pin.Model(given)
    chain, _ = with_warnings(ClosedChain, given, *others)
    assert given == before
    model, q = chain.model, chain.assemble([1.2, -0.725, 1.969], ["crank"])

    def as_pinocchio_has_them():
        data = model.createData()
        pin.framesForwardKinematics(model, data, q)
        for frame, place in zip(model.frames, data.oMf, strict=True):
            p, R = chain.frame_placement(q, frame.name)
            assert np.abs(place.translation - p).max() < 1e-15
            assert np.abs(place.rotation - R).max() < 1e-15

    as_pinocchio_has_them()
    mark = pin.Frame("mark", 1, at(0.1, 0.2, 0.3), pin.FrameType.OP_FRAME)
    model.addFrame(mark)
    _, records = with_warnings(chain.refresh)
    assert records == []
    assert chain.model is model
    as_pinocchio_has_them()
    assert chain.frame_placement(q, "mark")[0][2] == pytest.approx(0.3, abs=2e-4)  # as corrected
    model.gravity.linear = np.zeros(3)
    chain.refresh()
    assert np.abs(chain.compute_torques(q, [0], [0])).max() < 1e-15


@pytest.mark.parametrize("kind", ["3d", "hinge"])
def test_a_closure_two_millimetres_across_the_plane_is_refused(kind):
    """On a robot of 0.4 m, when it is made; the error names the loop and the best pose's gap."""
    with pytest.raises(ClosureError, match="coupler_end - rocker_end") as caught:
        ClosedChain(*bar(kind, across=2e-3))
    assert caught.value.residual == pytest.approx(2e-3, rel=0.01)


def test_the_error_of_an_open_loop_names_no_closed_ones():
    """One closure of a scissor lift stands across the plane; the others close to rounding."""
    chain = robots.scissor_lift()
    model = pin.Model(chain.model)
    frame = model.frames[model.getFrameId(chain.closures[1].frame_a)]
    frame.placement = frame.placement * at(0, 0, 5e-3)
    with pytest.raises(ClosureError, match=f"the loops at {chain.closures[1]} stay open by 0.005"):
        ClosedChain(model, chain.closures, chain.motor_names)


def test_the_warning_of_a_correction_names_no_closed_loops():
    """One closure of a scissor lift is a little off the plane; the others close to rounding."""
    chain = robots.scissor_lift()
    model = pin.Model(chain.model)
    frame = model.frames[model.getFrameId(chain.closures[1].frame_a)]
    frame.placement = frame.placement * at(0, 0, 1e-4)
    _, (text,) = with_warnings(ClosedChain, model, chain.closures, chain.motor_names)
    assert f"the loops at {chain.closures[1]} close only to 0.0001 m" in text


@pytest.mark.filterwarnings("ignore:.*the closures hold the joints of the motors")
@pytest.mark.parametrize(
    ("kind", "tilted"), [("3d", "coupler"), ("hinge", "crank"), ("hinge", "rocker")]
)
def test_an_axis_tilted_by_a_degree_holds_the_robot(kind, tilted):
    model, *others = bar(kind, tilt=np.radians(1), tilted=tilted)
    with pytest.raises(SSTError, match=r"nothing can move|the loops at .* stay open"):
        ClosedChain(model, *others).compute_torques(model.referenceConfigurations["home"], [0], [0])


def test_a_motor_whose_joint_is_held_is_named():
    """A loop of three bars holds its motor; an arm beside it moves."""
    bars = [("crank", "universe", 0.0, 0.3), ("strut", "universe", 0.4, 0.2)]
    model = planar([*bars, ("arm", "universe", 1.0, 0.3)])
    closures = [sst_pin.Closure("crank_end", "strut_end", "3d")]
    with pytest.warns(DescriptionWarning, match="joints of the motors crank, which cannot move"):
        chain = ClosedChain(model, closures, ["crank", "arm"])
    assert chain.coordinates == ("arm",)


def hinges(branches, home, world=None):
    """A loop of two branches of hinges about their z axes, closed at home by a weld."""
    model, ends = pin.Model(), []
    model.gravity.linear = np.array([1.0, -9.0, 2.0])
    body = pin.Inertia(1.0, np.array([0.1, 0, 0]), 0.01 * np.eye(3))
    for branch, placements in branches.items():
        joint = 0
        for k, placement in enumerate(placements):
            place = (world or at()) * placement if k == 0 else placement
            joint = add(model, joint, pin.JointModelRZ(), f"{branch}{k}", place, body)
        ends.append(joint)
    return closed_at(model, ends, home), [Closure("A", "B")]


def closed_at(model, ends, home):
    """The model with a frame A on one body, and B where A is at home on another."""
    data = model.createData()
    pin.forwardKinematics(model, data, home)
    place = at(0.4, 0.1)
    mark(model, ends[0], "A", place)
    mark(model, ends[1], "B", data.oMi[ends[1]].actInv(data.oMi[ends[0]] * place))
    model.referenceConfigurations["home"] = home
    return model


def in_plane(random, turned=None):
    """A place in the x-y plane."""
    x, y = random.uniform(0.3, 0.8), random.uniform(-0.5, 0.5)
    return at(x, y, turned=turned)


def with_digits(model, digits):
    """The model with rounded placements."""
    model = pin.Model(model)

    def few(place):
        angles = pin.rpy.matrixToRpy(place.rotation).round(digits)
        return pin.SE3(pin.rpy.rpyToMatrix(angles), place.translation.round(digits))

    for j in range(1, model.njoints):
        model.jointPlacements[j] = few(model.jointPlacements[j])
    for frame in model.frames:
        frame.placement = few(frame.placement)
    return model


def gap_along(chain, model, joint, travel):
    """The largest gap of A and B while a joint travels from home, by Newton's method."""
    data, worst, q = model.createData(), 0.0, chain.home

    def gap(x):
        pin.framesForwardKinematics(model, data, x)
        a, b = (data.oMf[model.getFrameId(name)] for name in "AB")
        return pin.log6(a.actInv(b)).vector

    steps = 1e-6 * np.delete(np.eye(model.nq), joint, axis=0)
    for _ in range(5):
        q[joint] += travel / 5
        for _ in range(10):
            J = np.transpose([(gap(q + step) - gap(q - step)) / 2e-6 for step in steps])
            q[np.arange(model.nq) != joint] -= np.linalg.lstsq(J, gap(q), rcond=1e-13)[0]
        worst = max(worst, float(np.abs(gap(q)).max()))
    return worst


@pytest.mark.parametrize(("seed", "digits"), [(7, None), (8, None), (7, 8), (7, 6)])
def test_axes_that_are_tilted_on_purpose_stay_as_they_are(seed, digits):
    """Seven hinges, six of them parallel to 0.1 degrees, are a loop with one freedom.

    It closes along its motion, by a Newton's method of the test. If its axes were made parallel, it
    would have three.
    """
    random = np.random.default_rng(seed)
    tilts = 1e-3 * random.normal(size=(7, 3))
    tilts[2] *= 700
    places = [in_plane(random, pin.exp3(tilt)) for tilt in tilts]
    branches = {"a": places[:3], "b": places[3:]}
    model, closures = hinges(branches, random.uniform(-1, 1, 7))
    if digits:
        model = with_digits(model, digits)
    chain, texts = with_warnings(ClosedChain, model, closures, ["a0"])
    assert not texts
    assert chain.coordinates == ("a0",)
    assert gap_along(chain, model, 0, 0.1) < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_lengths_of_whole_centimetres_do_not_make_tilted_axes_parallel(seed):
    """The home of the file closes to the rounding of floats, so its lengths are exact."""
    random = np.random.default_rng(seed)
    tilts = 1e-3 * random.normal(size=(7, 3))
    tilts[2] *= 700
    places = [in_plane(random, pin.exp3(tilt)) for tilt in tilts]
    for place in places:
        place.translation = place.translation.round(2)
    branches = {"a": places[:3], "b": places[3:]}
    model, closures = hinges(branches, random.uniform(-1, 1, 7))
    chain, texts = with_warnings(ClosedChain, model, closures, ["a0"])
    assert not texts
    assert chain.degrees_of_freedom == 1
    assert gap_along(chain, model, 0, 1e-3) < 1e-12


@pytest.mark.parametrize("digits", [4, 6, 8])
@pytest.mark.parametrize("seed", range(2))
def test_home_closes_in_rounded_loops_with_hinges_that_rest(seed, digits):
    """Five parallel hinges and two across them, as self-aligning pins: two freedoms.

    With rounded placements the loop has one freedom beside home, along which it closes, but home is
    no pose of it.
    """
    random = np.random.default_rng(seed)
    across = [pin.exp3(random.normal(size=3)) for _ in range(2)]
    places = [in_plane(random) for _ in range(5)]
    branches = {"a": [*places[:2], in_plane(random, across[0])]}
    branches["b"] = [*places[2:], in_plane(random, across[1])]
    world = pin.SE3(pin.exp3(random.normal(size=3)), random.normal(size=3))
    model, closures = hinges(branches, random.uniform(-1, 1, 7), world)
    exact = ClosedChain(model, closures, ["a0", "b0"])
    chain, (_,) = with_warnings(ClosedChain, with_digits(model, digits), closures, ["a0", "b0"])
    assert chain.coordinates == exact.coordinates == ("a0", "b0")
    motion = [1.0, -0.5], [0.3, 2.0]
    tau = exact.compute_torques(exact.home, *motion)
    off = np.abs(chain.compute_torques(chain.home, *motion) - tau).max()
    assert off < EXPLAINED * exact.condition_number(exact.home) * 10.0**-digits * np.abs(tau).max()


@pytest.mark.parametrize("digits", [4, 6, 8])
@pytest.mark.parametrize("seed", range(2))
def test_slides_whose_orientations_a_closure_holds_are_free(seed, digits):
    """The error of the orientation is that of rounding at all poses; no row depends on the joints.

    The torques are those of Pinocchio for the open arm.
    """
    random, model, joint = np.random.default_rng(seed), pin.Model(), 0
    body = pin.Inertia(1.0, np.array([0.1, 0, 0]), 0.01 * np.eye(3))
    for k, kind in enumerate([pin.JointModelPX, pin.JointModelPY, pin.JointModelPX]):
        place = at(*random.uniform(-0.5, 0.5, 3), turned=pin.exp3(random.normal(size=3)))
        joint = add(model, joint, kind(), f"slide_{k}", place, body)
    model = closed_at(model, [joint, 0], random.uniform(-0.5, 0.5, 3))
    names = list(model.names)[1:]
    closures = [Closure("A", "B", "orientation")]
    chain, (_,) = with_warnings(ClosedChain, with_digits(model, digits), closures, names)
    assert chain.coordinates == tuple(names)
    q, va, aa = random.normal(size=(3, 3))
    tau = pin.rnea(model, model.createData(), q, va, aa)
    off = np.abs(chain.compute_torques(q, va, aa) - tau).max()
    assert off < EXPLAINED * 10.0**-digits * np.abs(tau).max()


@pytest.mark.parametrize("length", [1.0, 30.0])
@pytest.mark.parametrize("seed", range(2))
def test_angles_of_long_loops_are_rounded_as_those_of_short_ones(seed, length):
    """Seven parallel hinges, four freedoms; roll, pitch and yaw of both branches have three digits.

    The loop closes exactly at zero, and moves, with two freedoms, as it is.
    """
    random, tree, ends = np.random.default_rng(seed), pin.Model(), []
    turned = pin.SE3(pin.exp3(random.uniform(-1, 1, 3)), np.zeros(3))
    body = pin.Inertia(1.0, np.array([0.1 * length, 0, 0]), 0.01 * length**2 * np.eye(3))
    for branch, count in (("a", 3), ("b", 4)):
        joint = 0
        for k in range(count):
            place = in_plane(random)
            place.translation *= length
            if k == 0:
                turn = pin.exp3(np.array([0, 0, random.uniform(-3, 3)]))
                place = turned * place * pin.SE3(turn, np.zeros(3))
            joint = add(tree, joint, pin.JointModelRZ(), f"{branch}{k}", place, body)
        ends.append(joint)
    model = closed_at(with_digits(tree, 3), ends, np.zeros(7))
    del model.referenceConfigurations["home"]
    chain, records = with_warnings(ClosedChain, model, [Closure("A", "B")], ["a0"])
    assert chain.degrees_of_freedom == 4
    assert sum("placements are rounded" in text for text in records) == 1


def beside(small, large, scale):
    """Both robots in one model, the first one scaled; its names end with `_small`."""
    model, home, closures = pin.Model(), list[float](), list[Closure]()
    turn = pin.exp3(np.array([0.3, -0.5, 0.7]))
    for chain, unit, ending in ((small, scale, "_small"), (large, 1e3, "")):
        old, first = in_units(chain.model, unit), model.njoints - 1
        ground = pin.SE3(turn, unit * np.array([0.11, -0.23, 0.31]))

        def moved(parent, place, first=first, ground=ground):
            return (first + parent, place) if parent else (0, ground * place)

        for j in range(1, old.njoints):
            parent, place = moved(old.parents[j], old.jointPlacements[j])
            add(model, parent, old.joints[j], old.names[j] + ending, place, old.inertias[j])
        for closure in chain.closures:
            ends = closure.frame_a, closure.frame_b
            for name in ends:
                frame = old.frames[old.getFrameId(name)]
                parent, place = moved(frame.parentJoint, frame.placement)
                mark(model, parent, name + ending, place)
            closures.append(Closure(*(name + ending for name in ends), closure.kind))
        home += chain.home.tolist()
    model.referenceConfigurations["home"] = np.array(home)
    return model, closures


@pytest.mark.parametrize("digits", [10, 8])
def test_each_loop_has_its_own_scale(digits):
    """A rounded Bennett loop of half a millimetre moves beside a four-bar of a kilometre."""
    small, large = robots.bennett(), robots.four_bar()
    model, closures = beside(small, large, 5e-4)
    motors = [f"{small.motor_names[0]}_small", large.motor_names[0]]
    exact = ClosedChain(model, closures, motors)
    chain, (text,) = with_warnings(ClosedChain, with_digits(model, digits), closures, motors)
    assert "_small" in text
    assert chain.coordinates == exact.coordinates == tuple(motors)
    q = chain.assemble(exact.generic_configuration(), motors)
    motion = [1.0, 1.0], [0.5, -0.5]
    tau = exact.compute_torques(exact.generic_configuration(), *motion)
    rounding = 10.0**-digits / np.array([5e-4, 1e3])  # relative to each loop
    off = np.abs(chain.compute_torques(q, *motion) / tau - 1)
    assert (off < EXPLAINED * rounding + 1e-9).all()


@pytest.mark.parametrize(
    ("name", "per_metre"),
    [("four-bar with hinge", 1e3), ("scissor", 1e3), ("four-bar with hinge", 1e6)],
)
def test_a_correction_in_other_units_is_that_in_metres(name, per_metre):
    """Rows in radians have no unit: they tell neither a length nor the rounding of positions."""
    exact = drawn_by_cad(ROBOTS[name]())
    model = with_digits(exact.model, 5)
    others = exact.closures, exact.motor_names
    in_metres, _ = with_warnings(ClosedChain, model, *others)
    chain, records = with_warnings(ClosedChain, in_units(model, per_metre), *others)
    assert len(records) == 1
    expected = in_units(in_metres.model, per_metre)
    pairs = zip(chain.model.jointPlacements, expected.jointPlacements, strict=True)
    corrections = zip(model.jointPlacements, in_metres.model.jointPlacements, strict=True)
    largest = max(np.abs(pin.log6(a.actInv(b)).angular).max() for a, b in corrections)
    assert largest > 1e-7  # the axes were tilted
    for a, b in pairs:
        assert_allclose(a.rotation, b.rotation, atol=1e-4 * largest)
        assert_allclose(a.translation, b.translation, atol=1e-4 * largest * per_metre)


def test_a_hexapod_that_is_rigid_and_almost_singular_is_not_rounded():
    """The Jacobian of the six rods by hand is regular, so that only the arm on the platform moves.

    Its smallest singular value, 2e-3, is one that rounding could make, but sixteen digits do not.
    """
    random = np.random.default_rng(0)
    angles = np.radians(60.0 * np.arange(6)) + random.uniform(-0.1, 0.1, 6)
    base = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
    R, p = pin.rpy.rpyToMatrix(0.01, -0.01, np.pi / 2), np.array([0.02, 0.03, 0.9])
    # A platform similar to its base is singular; this one is similar to it by 3e-3.
    platform = 0.6 * base + 3e-3 * random.normal(size=(6, 3))
    ends = platform @ R.T + p
    lengths = np.linalg.norm(ends - base, axis=1)
    directions = (ends - base) / lengths[:, None]
    by_hand = np.hstack([directions, np.cross(ends - p, directions)])
    assert 1e-4 < np.linalg.svd(by_hand, compute_uv=False)[-1] < 3e-3
    model = pin.Model()
    inertia = pin.Inertia(1.0, np.array([0.05, 0.02, 0.1]), 0.01 * np.eye(3))
    plate = add(model, 0, pin.JointModelFreeFlyer(), "plate", at(), inertia)
    add(model, plate, pin.JointModelRZ(), "arm", at(0.1, 0.2, 0.3), inertia)
    closures = []
    for k in range(6):
        mark(model, 0, f"base_{k}", at(*base[k]))
        mark(model, plate, f"plate_{k}", at(*platform[k]))
        closures.append(sst_pin.Distance(f"base_{k}", f"plate_{k}", lengths[k]))
    home = np.concatenate([p, pin.Quaternion(R).coeffs(), [0.3]])
    model.referenceConfigurations["home"] = home
    chain, records = with_warnings(ClosedChain, model, closures, ["arm"])
    assert (chain.degrees_of_freedom, records) == (1, [])


def test_the_rests_of_rounded_right_angles_are_not_rounded_numbers():
    """2.65e-6 is pi - 3.14159: it is 0 at one digit, which tells nothing about other numbers."""
    with_all_digits = np.random.default_rng(0).uniform(0.1, 1.0, 6)
    rests = [np.pi - 3.14159, 1.5708 - np.pi / 2, np.pi / 2 - 1.570796]
    assert half_a_digit(with_all_digits) == 0
    assert half_a_digit(np.append(with_all_digits, rests)) == 0
    assert half_a_digit(np.append(with_all_digits.round(4), rests)) == 0.5e-4


def test_a_closure_frame_with_the_name_of_a_joint_leaves_that_joint_where_it_is():
    """The turntable carries the whole four-bar, so that its place corrects nothing."""
    bars = [("turntable", "universe", 0.0, 0.05), ("crank", "turntable", 0.0, 0.1)]
    bars += [("coupler", "crank", 0.1, 0.3), ("rocker", "turntable", 0.4, 0.25)]
    model = planar(bars)
    end = model.frames[model.getFrameId("coupler_end")]
    end.placement = end.placement * at(0, 0, 2e-4)
    end.name = "turntable"
    of_bar = bar()[0].referenceConfigurations["home"]
    model.referenceConfigurations["home"] = np.array([0.0, *of_bar])
    closures = [Closure("turntable", "rocker_end", "hinge")]
    chain, records = with_warnings(ClosedChain, model, closures, ["turntable", "crank"])
    assert (len(records), chain.degrees_of_freedom) == (1, 2)
    j = model.getJointId("turntable")
    assert chain.model.jointPlacements[j] == model.jointPlacements[j]
