# SPDX-License-Identifier: BSD-2-Clause
"""Motions and their files refuse what they cannot be made of."""

import io

import numpy as np
import pytest

import sst_pin
from sst_pin import Trajectory
from sst_pin.errors import FileFormatError, InputError, SSTError
from tests.support.bad_calls import faults

T, ONES = np.linspace(0, 1, 5), np.ones((5, 1))
GOOD = {"t": T, "q": np.ones((5, 3)), "va": ONES, "aa": ONES, "tau": ONES}
GOOD |= {"joint_names": ("a", "b", "c"), "motor_names": ("a",)}
MOTION = Trajectory(**GOOD)
CHAIN = sst_pin.robots.four_bar()
MOVES = {"chain": CHAIN, "t": T, "x": 1 + 0.1 * T[:, None], "start": CHAIN.home, "frame": "coupler"}
MOVES |= {"poses": np.zeros((5, 3)), "motion": CHAIN.simulate([0.0], CHAIN.home, [0.0], T / 500)}
CALLS = {
    "Trajectory": (Trajectory, GOOD, {"stopped", "motor_names", "coordinates"}),
    "between": (MOTION.between, {"start": 0.0, "end": 1.0}),
    "save": (MOTION.save, {"path": "a.csv"}),
    "load": (Trajectory.load, {"path": "a.csv"}),
    "SampledTorque": (sst_pin.SampledTorque, {"function": lambda *x: x[0], "period": 0.1}),
    "energy_error": (sst_pin.energy_error, MOVES),
    "coordinate_motion": (sst_pin.coordinate_motion, MOVES),
    "frame_motion": (sst_pin.frame_motion, MOVES),
}


@pytest.mark.parametrize("name", CALLS)
def test_functions_refuse_bad_arguments(name, here):
    (here / "file").write_text("in the way")
    assert faults(*CALLS[name]) == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": T[:-1]}, "q: shape"),
        ({"t": T[::-1]}, "t: not increasing"),
        ({"t": 0 * T}, "t: not increasing"),
        ({"t": T[:, None]}, "t: shape"),
        ({"q": ONES}, "q: shape"),
    ],
)
def test_times_increase_and_arrays_have_a_row_for_each(changes, message):
    with pytest.raises(InputError, match=message):
        Trajectory(**GOOD | changes)


@pytest.mark.parametrize(
    ("t", "message"),
    [
        ([], "t: shape"),
        ([1.0, 0.0], "t: not increasing"),
        ([[0.0, 1.0]], "t: shape"),
        (1.0, "t: shape"),
        ([0.0, np.inf], "t: inf is not finite"),
        ([1e300, 1.1e300], "step size is less than spacing"),
    ],
)
def test_times_of_simulations_increase_and_are_finite(t, message):
    with pytest.raises(SSTError, match=message):
        CHAIN.simulate([0.0], CHAIN.home, [0.0], t)


@pytest.mark.parametrize("value", [None, "x", np.nan, np.ones((1, 2)), 1j])
def test_torques_that_a_function_returns_are_checked(value):
    with pytest.raises(InputError, match=r"torque\(t, q, va\): "):
        CHAIN.simulate(lambda t, q, va: value, CHAIN.home, [0.0], T / 500)


@pytest.mark.parametrize("moment", [None, [0, 0, 0.1]])
def test_a_load_function_that_returns_none_is_refused(moment):
    robot = sst_pin.SST()
    with pytest.raises(SSTError, match="external_wrenches"):
        robot.simulate(
            np.zeros(3),
            robot.home,
            np.zeros(3),
            [0, 1e-3],
            platform_moment=moment,
            external_wrenches=lambda t, q, va: None,
        )


@pytest.mark.parametrize("shape", [(10**12, 1), (10**12, 3, 1)])
def test_motions_that_do_not_fit_into_memory_are_refused(shape):
    with pytest.raises(InputError, match="do not fit into memory"):
        CHAIN.rollout(np.broadcast_to(0.0, shape), CHAIN.home, [0.0], 1e-3)


def archive(**changes):
    """The bytes of a motion's .npz with some arrays replaced; without an array that is None."""
    names = ("joint_names", "motor_names", "units", "coordinates", "rate_units", "torque_units")
    arrays = {name: getattr(MOTION, name) for name in ("t", "q", "va", "aa", "tau")}
    arrays |= {name: np.array(getattr(MOTION, name)) for name in names}
    arrays |= {"stopped": np.array("")} | changes
    file = io.BytesIO()
    np.savez(file, **{name: value for name, value in arrays.items() if value is not None})
    return file.getvalue()


#: A motion of a robot whose coordinate is its joint a.
CSV = b"t_s,a_rad,a_rad_s,a_rad_s2\n0,1,0,0\n1,1,0,0\n"


@pytest.mark.parametrize(("ending", "content"), [("csv", CSV), ("npz", archive())])
def test_the_files_that_are_spoilt_below_hold_a_motion(here, ending, content):
    (here / f"a.{ending}").write_bytes(content)
    assert Trajectory.load(f"a.{ending}").joint_names[0] == "a"


#: Files by their ending, each with a part of the error.
FILES = {
    "csv": [
        (b"", "missing column t_s"),
        (bytes(range(256)), "not a text file"),
        (CSV.replace(b"1,1", b"1,\0"), r"line 3: a_rad: '\\x00' is not a number"),
        (CSV.decode().replace("a_rad", "\u00e9_rad").encode("latin-1"), "not a text file"),
        (CSV.decode().encode("utf-16"), "not a text file"),
        (CSV.replace(b"a_rad,", b"a" * 200_000 + b","), "field larger than field limit"),
    ],
    "npz": [
        (b"", "No data left in file"),
        (bytes(1000), "pickled"),
        (CSV, "pickled"),
        (archive()[:600], "not a zip file"),
        (archive(q=None), "q is not a file in the archive"),
        (archive(q=MOTION.q.astype(str)), "q: not an array of numbers"),
        (archive(q=MOTION.q.astype(complex)), "q: not an array of numbers"),
        (archive(q=MOTION.q.astype(object)), "Object arrays cannot be loaded"),
        (archive(q=MOTION.q * np.nan), "q: .* is nan"),
        (archive(q=MOTION.q[:-1]), "q: shape"),
        (archive(q=np.array(1.0)), "q: shape"),
        (archive(joint_names=np.array(5)), "joint_names: 5"),
        (archive(joint_names=np.array("x")), "joint_names: 'x'"),
        (archive(joint_names=np.arange(3)), "joint_names: .*must be a string"),
        (archive(t=np.datetime64("2026-01-01") + np.arange(5)), "t: not an array of numbers"),
    ],
}


@pytest.mark.parametrize(
    ("ending", "content", "message"),
    [(ending, *file) for ending, files in FILES.items() for file in files],
)
def test_files_that_hold_no_motion_are_refused(here, ending, content, message):
    (here / f"a.{ending}").write_bytes(content)
    with pytest.raises(FileFormatError, match=message):
        Trajectory.load(f"a.{ending}")
