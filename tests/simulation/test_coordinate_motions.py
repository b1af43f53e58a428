# SPDX-License-Identifier: BSD-2-Clause
"""Motions given by the coordinates alone, in arrays and in files."""

import io
import warnings

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.files import read_table
from sst_pin.loops.start import placed
from sst_pin.simulation.coordinate_motions import coordinate_motion
from sst_pin.simulation.motion_files import load_motion, read_motion, read_start
from sst_pin.sst import paper
from tests.support.by_hand import add, at


def stream(text):
    return io.BytesIO(text.encode())


@pytest.fixture(scope="module")
def delta():
    return sst_pin.robots.delta()


@pytest.fixture(scope="module")
def stroke(delta):
    """A motion of the delta's motors about its home."""
    t = np.linspace(0, 1, 41)
    motors = [delta.position_names.index(name) for name in delta.coordinates]
    x = delta.home[motors] + 0.2 * np.sin(t[:, None] + np.arange(3))
    return coordinate_motion(delta, t, x, delta.home), x


def test_joints_follow_the_coordinates_of_an_sst_as_its_own_kinematics_say(robot):
    """Closed form there, Newton's method along the way here."""
    example = paper.example_1(robot, np.linspace(0, paper.PERIOD, 61))
    motion = coordinate_motion(robot, example.t, example.q[:, ::3], example.q[0])
    assert np.abs(motion.q - example.q).max() < 1e-9
    # Splines through 61 samples know rates to some digits, less at the ends.
    assert np.abs(motion.va - example.va)[6:-6].max() < 1e-4
    assert np.abs(motion.tau - example.tau)[6:-6].max() < 0.05


def test_loops_are_closed_and_torques_those_of_the_motion(delta, stroke):
    motion, x = stroke
    motors = [motion.joint_names.index(name) for name in delta.coordinates]
    assert np.abs(motion.q[:, motors] - x).max() < 1e-12
    assert max(np.abs(delta.residual(q)).max() for q in motion.q) < 1e-9
    expected = delta.compute_torques(motion.q, motion.va, motion.aa)
    assert np.array_equal(motion.tau, expected)


def test_coarse_samples_stay_on_their_assembly():
    """Steps of ninety degrees of a crank, and of one degree, end in the same place."""
    chain = sst_pin.robots.four_bar()
    crank = chain.home[chain.position_names.index("crank")]
    ends = []
    for count in (5, 361):
        turn = np.linspace(0, 2 * np.pi, count)
        motion = coordinate_motion(chain, turn, crank + turn[:, None], chain.home)
        ends.append(motion.q[[0, -1]])
    assert np.abs(ends[0] - ends[1]).max() < 1e-9
    others = [i for i, name in enumerate(chain.position_names) if name != "crank"]
    turns = (ends[0][1] - ends[0][0])[others] / (2 * np.pi)
    assert np.abs(turns - turns.round()).max() < 1e-9


def test_a_file_of_coordinates_is_the_motion(delta, stroke):
    """One motor in degrees; passive joints may be there."""
    motion, _ = stroke
    passive = [name for name in motion.joint_names if name not in delta.coordinates]
    revolute = [n for n in passive if motion.units[motion.joint_names.index(n)] == "rad"]
    names = (*delta.coordinates, *revolute)
    values = motion.q[:, [motion.joint_names.index(name) for name in names]].copy()
    values[:, 0] *= 180 / np.pi
    file, endings = io.StringIO(), ["_deg", *["_rad"] * (len(names) - 1)]
    head = ["t_s", *(f"{name}{e}" for name, e in zip(names, endings, strict=True))]
    table = np.column_stack([motion.t, values])
    np.savetxt(file, table, "%.17g", ",", header=",".join(head), comments="")
    read = read_motion(delta.engine, stream(file.getvalue()))
    assert np.abs(read.q - motion.q).max() < 1e-9
    assert np.abs(read.tau - motion.tau).max() < 1e-6


def test_a_whole_file_is_taken_as_it_stands(delta, stroke, tmp_path):
    """`load_motion` keeps its torques, `read_motion` computes them."""
    motion, _ = stroke
    arrays = [motion.t, motion.q, motion.va, motion.aa]
    halved = delta.trajectory(*arrays, motion.tau / 2)
    for name in ("m.csv", "m.npz"):
        halved.save(tmp_path / name)
        assert load_motion(delta.engine, tmp_path / name) == halved
    assert np.abs(read_motion(delta.engine, tmp_path / "m.csv").tau - motion.tau).max() < 1e-12


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t_s,x\n0,1\n1,1\n2,1\n", "line 1: no column of "),
        ("x\n0\n", "missing column t_s"),
        ("t_s,{0}_rad,{0}_deg,{1}_rad,{2}_rad\n0,0,0,0,0\n", "one joint has several columns"),
        ("t_s,{0}_rad,{1}_rad,{2}_rad\n0,0,0,0\n1,0,0,0\n", "2 rows; rates need at least three"),
        (
            "t_s,{0}_rad,{1}_rad,{2}_rad\n0,0,0,0\n1,0.1,0,0\n2,4,0,0\n",
            "line 4: .*cannot be closed",
        ),
    ],
)
def test_a_file_that_is_no_motion_says_where(delta, text, words):
    file = stream(text.format(*delta.coordinates))
    with pytest.raises(sst_pin.FileFormatError, match=words):
        read_motion(delta.engine, file)


@pytest.mark.parametrize("digits", [3, 16])
def test_dependent_joints_that_are_given_choose_the_assembly(digits):
    """The slider left of the crank, the rod left out; also rounded, and where it cannot be."""
    chain = sst_pin.robots.slider_crank()
    names, home = chain.position_names, chain.home
    assert chain.coordinates == ("crank",)
    (slider,) = [k for k, unit in enumerate(chain.position_units) if unit == "m"]
    guess = home.copy()
    guess[slider] *= -1
    assert chain.home[slider] > 0.01
    other = chain.assemble(np.where(np.arange(len(home)) == slider, guess, home + np.pi), [])
    q = dict(zip(names, other, strict=True))
    positions = {name: round(float(q[name]), digits) for name in ("crank", names[slider])}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = placed(chain.engine, positions)
    assert abs(result[slider] - other[slider]) < 2 * 10.0**-digits + 1e-9
    for far in (5.0, -5.0):
        with pytest.warns(sst_pin.DescriptionWarning, match=f"{names[slider]} at {far:g} "):
            placed(chain.engine, positions | {names[slider]: far})


def test_a_simulation_starts_where_names_or_the_first_row_say(delta, stroke):
    motion, _ = stroke
    table = read_table(stream("t_s,tau_1_Nm\n0,0\n"))
    q = dict(zip(motion.joint_names, motion.q[0], strict=True))
    positions = {name: value for name, value in q.items() if name in delta.coordinates}
    first = delta.coordinates[0]
    q0, va0 = read_start(delta.engine, table, positions, {first: 2.0})
    assert va0.tolist() == [2, 0, 0]
    assert np.abs(delta.residual(q0)).max() < 1e-9
    assert read_start(delta.engine, table, positions)[1].tolist() == [0, 0, 0]
    some = read_table(stream(f"t_s,tau_1_Nm,{first}_rad_s\n0,0,1\n"))
    for of, start in ((table, None), (some, positions)):
        with pytest.raises(sst_pin.FileFormatError, match="give --va0"):
            read_start(delta.engine, of, start)
    others = ", ".join(f"{name}_rad_s" for name in delta.coordinates[1:])
    with pytest.raises(sst_pin.FileFormatError, match=f"no columns {others} for the initial rates"):
        read_start(delta.engine, some, positions)
    with pytest.raises(sst_pin.FileFormatError, match="give --q0"):
        read_start(delta.engine, table, None, {})
    with pytest.raises(sst_pin.FileFormatError, match="no rate of a coordinate wheel"):
        read_start(delta.engine, table, positions, {"wheel": 1.0})


def test_a_parallelogram_does_not_go_on_through_its_flat_position():
    """Where the coupler could also turn back; any distance of the samples."""
    chain = sst_pin.robots.four_bar(crank=0.3, coupler=0.8, rocker=0.3, ground=0.8)
    start = chain.home[chain.position_names.index("crank")]
    for count in (4, 61):
        x = np.linspace(start, start + 2 * np.pi + 0.1, count)[:, None]
        with pytest.raises(sst_pin.ClosureError, match="singular"):
            coordinate_motion(chain, np.linspace(0, 1, count), x, chain.home)


def test_angles_modulo_one_turn_are_told_and_those_of_endless_joints_go_on():
    """Two turns of a crank, logged from -180 to 180 deg."""
    t = np.linspace(0, 4, 161)
    x = np.pi * t[:, None]
    wrapped = np.angle(np.exp(1j * x))
    four_bar = sst_pin.robots.four_bar()
    with pytest.warns(sst_pin.DescriptionWarning, match="crank jump by a full turn"):
        coordinate_motion(four_bar, t, wrapped)
    model = pin.Model()
    add(model, 0, pin.JointModelRUBZ(), "wheel", at(), pin.Inertia(1.0, np.ones(3), np.eye(3)))
    wheel = sst_pin.ClosedChain(model, [], ["wheel"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        coordinate_motion(four_bar, t, x)
        turning = coordinate_motion(wheel, t, wrapped)
    assert np.abs(turning.va - np.pi).max() < 1e-9


@pytest.mark.slow
def test_a_jump_of_a_thousand_turns_is_refused_and_says_so():
    chain = sst_pin.robots.four_bar()
    x = chain.home[0] + np.array([[0.0], [0.0], [2e3 * np.pi], [2e3 * np.pi]])
    with pytest.warns(match="full turn"), pytest.raises(sst_pin.ClosureError) as caught:
        coordinate_motion(chain, range(4), x, chain.home)
    assert "index 2" in str(caught.value)
    assert "give poses in between" in str(caught.value)
