# SPDX-License-Identifier: BSD-2-Clause
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import sst_pin
from sst_pin.files import read_table, write_files
from sst_pin.simulation.motion_files import load_motion, read_torques
from sst_pin.sst import paper
from tests.support.by_hand import add, at
from tests.support.planar_bars import planar

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@pytest.fixture
def motion(robot):
    return paper.example_1(robot, np.linspace(0, 0.1, 7))


@settings(max_examples=30, deadline=None)
@given(
    q=arrays(float, (3, 3), elements=NUMBERS),
    v=arrays(float, (3, 2), elements=NUMBERS),
    start=st.floats(-1e6, 1e6),
)
def test_any_finite_numbers_survive_the_files(tmp_path_factory, q, v, start):
    """Tiny, huge, negative zeros; a prismatic joint among revolute ones."""
    folder = tmp_path_factory.mktemp("motions")
    t = start + np.array((0.0, 1.0, 2.5))
    names, units = ("gamma_1", "mu_1", "slide"), ("rad", "rad", "m")
    motion = sst_pin.Trajectory(t, q, v, 2 * (v / 4), v, names, ("slide", "mu_1"), units)
    for name in ("motion.csv", "motion.npz"):
        motion.save(folder / name)
        copy = sst_pin.Trajectory.load(folder / name)
        assert copy == motion
        assert np.signbit(copy.q).tolist() == np.signbit(motion.q).tolist()


def test_torque_of_a_motion_passes_through_its_samples_and_is_not_guessed_outside(motion):
    """A polynomial of degree five leads to any number there."""
    torque = motion.torque()
    assert np.abs([torque(t) for t in motion.t] - motion.tau).max() < 1e-12
    for t in (-1.0, 1e3, np.nan, None, "now"):
        with pytest.raises(sst_pin.InputError, match="t: "):
            torque(t)


@pytest.mark.parametrize("name", ["a,b", '"a"', " a", "a\nb"])
def test_a_name_that_a_csv_cannot_hold_is_refused_there_only(tmp_path, name):
    none = np.zeros((2, 1))
    motion = sst_pin.Trajectory([0, 1], none, none, none, none, [name], [name])
    with pytest.raises(sst_pin.OutputError, match=r"save the motion as \.npz"):
        motion.save(tmp_path / "odd.csv")
    motion.save(tmp_path / "odd.npz")
    assert sst_pin.Trajectory.load(tmp_path / "odd.npz") == motion


def test_why_a_motion_stopped_is_kept_in_npz(motion, tmp_path):
    stopped = replace(motion, stopped="singular")
    stopped.save(tmp_path / "m.npz")
    assert sst_pin.Trajectory.load(tmp_path / "m.npz").stopped == "singular"
    assert stopped == motion
    assert stopped[3:].stopped == "singular"  # of its last sample
    assert stopped[:3].stopped == ""


@pytest.mark.parametrize(
    ("text", "line", "word"),
    [
        ("t_s,a\n0,1\n1,x\n", 3, "a: 'x' is not a number"),
        ("t_s,a\n0,1\n1,nan\n", 3, "a: nan is not finite"),
        ("t_s,a\n0,1\n\n2,1\n1,1\n", 5, "times must increase: t_s = 1 after 2"),
        ("t_s,a\n0,1\n1\n", 3, "1 cells, the header has 2"),
        ("t_s,a,a\n0,1,1\n", 1, "column a appears twice"),
        ("when,a\n0,1\n", 1, "missing column t_s; found: when, a"),
        ("t,time,a\n0,1,1\n", 1, "column t_s appears twice"),
        ("t_s,a\n", None, "no rows"),
        ("", 1, "missing column t_s; found: none"),
        ('t_s,a\n0,"1\n1,2\n', 3, "is not a number"),  # a quotation mark without its twin
    ],
)
def test_a_table_says_where_it_is_wrong(tmp_path, text, line, word):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(sst_pin.FileFormatError, match=word) as caught:
        read_table(path)
    if line is not None:
        assert caught.value.line == line
        assert f"line {line}" in str(caught.value)


def test_tables_of_spreadsheets_are_read(tmp_path):
    path = tmp_path / "table.csv"
    path.write_bytes("\ufefft_s, a\r\n0, 1\r\n1, 2.5e-3\r\n\r\n".encode())
    table = read_table(path)
    assert table.columns == ("t_s", "a")
    assert table.column("a").tolist() == [1, 2.5e-3]
    with pytest.raises(sst_pin.FileFormatError, match="missing columns b, c; found: t_s, a"):
        table.select(["b", "a", "c"])


def test_a_part_of_a_motion_is_a_motion(motion):
    for samples in (slice(2, 5), slice(None, None, 3), [0, 4, 6], np.arange(7) > 3):
        part = motion[samples]
        for name in ("t", "q", "va", "aa", "tau"):
            assert np.array_equal(getattr(part, name), getattr(motion, name)[samples])
        for name in ("joint_names", "motor_names", "units", "coordinates", "rate_units"):
            assert getattr(part, name) == getattr(motion, name)
    assert motion[:] == motion


def test_a_motion_between_two_times_holds_the_samples_at_both(motion):
    assert motion.between(motion.t[1], motion.t[4]) == motion[1:5]
    assert motion.between(-1, 1) == motion
    with pytest.raises(sst_pin.InputError, match="no sample from 2 to 3 s"):
        motion.between(2, 3)
    with pytest.raises(sst_pin.InputError, match="no sample from 1 to 0 s"):
        motion.between(1, 0)


def test_a_motion_prints_as_a_few_lines(motion):
    lines = repr(motion).splitlines()
    assert lines[0] == "Trajectory of 7 samples"
    assert "0 to 0.1 s" in lines[1]
    assert "(7, 9): gamma_1, mu_1" in lines[2]
    peak = np.abs(motion.tau[:, 1]).max()
    assert f"gamma_2 {peak:.4g} N m" in lines[4]
    assert len(lines) == 5
    page = motion._repr_html_()
    assert page.count("<tr>") == 4
    many = [f"joint_{k}<" for k in range(40)]
    none = np.zeros((1, 40))
    wide = sst_pin.Trajectory([0], none, none, none, none, many, many)
    assert "joint_8< and 31 more" in repr(wide)
    assert "joint_8&lt; and 31 more" in wide._repr_html_()
    assert max(map(len, repr(wide).splitlines())) < 250


def test_a_tendon_over_sliding_joints_gives_newtons(tmp_path):
    """What it acts on tells the unit, not its name; in files and what is read of them, too."""
    model = pin.Model()
    for name in ("left", "right"):
        add(model, 0, pin.JointModelPX(), name, at(), pin.Inertia.Random())
    together = sst_pin.Coupling("right", {"left": (0, 1)})
    chain = sst_pin.ClosedChain(model, [together], [{"left": 0.5, "right": 0.5}])
    assert chain.motor_units == ("N",)
    zero = np.zeros((2, 1))
    motion = chain.trajectory([0, 1], np.zeros((2, 2)), zero, zero)
    assert motion.torque_units == motion[:1].torque_units == ("N",)
    for name in ("m.csv", "m.npz"):
        motion.save(tmp_path / name)
        assert sst_pin.Trajectory.load(tmp_path / name) == motion
        assert load_motion(chain.engine, tmp_path / name) == motion
    with np.load(tmp_path / "m.npz") as file:
        older = {key: file[key] for key in file.files if key != "torque_units"}
    np.savez(tmp_path / "older.npz", **older)
    assert sst_pin.Trajectory.load(tmp_path / "older.npz").torque_units == ("Nm",)


@pytest.mark.parametrize("what", ["motors", "coordinates"])
def test_a_motion_with_other_motors_or_coordinates_is_refused(what, tmp_path):
    """Its columns have the same number; only their names tell that they are swapped."""
    chain = sst_pin.robots.five_bar()
    names = {"motors": list(chain.motor_names), "coordinates": list(chain.coordinates)}
    swapped = names | {what: names[what][::-1]}
    other = sst_pin.ClosedChain(
        chain.model, chain.closures, swapped["motors"], coordinates=swapped["coordinates"]
    )
    t, rest, tau = np.linspace(0, 0.1, 4), np.zeros((4, 2)), np.tile([0.1, 0.3], (4, 1))
    motion = other.trajectory(t, np.tile(chain.home, (4, 1)), rest, rest, tau)
    for use in (
        lambda: sst_pin.energy_error(chain, motion),
        lambda: chain.simulate(motion, chain.home, [0, 0], motion.t),
        lambda: chain.check_limits(motion),
    ):
        with pytest.raises(sst_pin.InputError, match=f"another robot, with {what}") as caught:
            use()
        assert ("chain.with_coordinates" in str(caught.value)) == (what == "coordinates")
    motion.save(tmp_path / "other.npz")
    with pytest.raises(sst_pin.FileFormatError, match=f"another robot, with {what}"):
        load_motion(chain.engine, tmp_path / "other.npz")
    motion.save(tmp_path / "other.csv")  # has names for all columns, or is refused
    read = load_motion(chain.engine, tmp_path / "other.csv")
    assert read.coordinates == chain.coordinates
    for name in chain.motor_names:
        ours, theirs = (m.tau[:, m.motor_names.index(name)] for m in (read, motion))
        assert np.array_equal(ours, theirs)


def test_a_motion_belongs_to_robots_whose_joints_move_alike(tmp_path):
    arms = []
    for joint in (pin.JointModelRY(), pin.JointModelPX()):
        model = pin.Model()
        add(model, 0, joint, "a", at(), pin.Inertia.Identity())
        arms.append(sst_pin.ClosedChain(model, [], ["a"]))
    t = np.linspace(0, 1, 7)
    motion = sst_pin.coordinate_motion(arms[0], t, t[:, None])
    with pytest.raises(sst_pin.InputError, match="units of positions rad; this one has m"):
        arms[1].check_limits(motion)


def arm(names, motors=None, joint=pin.JointModelRY):
    """Joints in series that turn or slide, with these names."""
    bars = [(n, on, 0.4 * (on != "universe"), 0.4) for on, n in pairwise(["universe", *names])]
    return sst_pin.ClosedChain(planar(bars, joint), [], list(motors or names))


def test_torques_of_motors_that_are_named_by_numbers_are_never_swapped(tmp_path):
    """`tau_1_Nm` is the motor 1, not the first one."""
    right, swapped = arm(["1", "2"]), arm(["1", "2"], ["2", "1"])
    path, t = tmp_path / "m.csv", np.linspace(0, 0.5, 11)
    motion = sst_pin.coordinate_motion(right, t, 0.2 * np.sin(3 * t)[:, None] * [1, 2])
    motion.save(path)
    assert sst_pin.Trajectory.load(path) == load_motion(right.engine, path) == motion
    assert np.array_equal(load_motion(swapped.engine, path).tau, motion.tau[:, ::-1])
    other = arm(["2", "3"])
    with pytest.raises(sst_pin.FileFormatError, match="torques of other motors, tau_1_Nm"):
        read_torques(other.mechanism, read_table(path))


def test_the_number_of_a_motor_may_stand_for_its_name(tmp_path):
    robot, path = arm(["a", "b"]), tmp_path / "m.csv"
    path.write_text("t_s,tau_2_Nm,tau_1_Nm\n0,2,1\n1,4,3\n")
    assert read_torques(robot.mechanism, read_table(path)).tolist() == [[1, 2], [3, 4]]


def test_a_position_in_the_unit_of_another_kind_of_joint_is_refused(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("t_s,a_rad,b_rad\n" + "".join(f"{0.1 * k},0,{0.1 * k}\n" for k in range(5)))
    with pytest.raises(sst_pin.FileFormatError, match="the joint a slides, in m"):
        load_motion(arm(["a", "b"], joint=pin.JointModelPX).engine, path)


def test_nothing_is_left_half_written(tmp_path):
    path = tmp_path / "out.bin"
    path.write_bytes(b"old")

    def fail(file):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(sst_pin.OutputError, match="No space left on device"):
        write_files({path: fail}, force=True)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
