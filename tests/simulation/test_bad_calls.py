# SPDX-License-Identifier: BSD-2-Clause
"""Motions and their files refuse what they cannot be made of."""

import io

import numpy as np
import pytest

import sst_pin
from sst_pin import Trajectory
from sst_pin.errors import SSTError
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
    "changes", [{"t": T[:-1]}, {"t": T[::-1]}, {"t": 0 * T}, {"t": T[:, None]}, {"q": ONES}]
)
def test_times_increase_and_arrays_have_a_row_for_each(changes):
    with pytest.raises(SSTError):
        Trajectory(**GOOD | changes)


@pytest.mark.parametrize("t", [[], [1.0, 0.0], [[0.0, 1.0]], 1.0, [0.0, np.inf], [1e300, 1.1e300]])
def test_times_of_simulations_increase_and_are_finite(t):
    with pytest.raises(SSTError):
        CHAIN.simulate([0.0], CHAIN.home, [0.0], t)


@pytest.mark.parametrize("value", [None, "x", np.nan, np.ones((1, 2)), 1j])
def test_torques_that_a_function_returns_are_checked(value):
    with pytest.raises(SSTError):
        CHAIN.simulate(lambda t, q, va: value, CHAIN.home, [0.0], T / 500)


@pytest.mark.parametrize("shape", [(10**12, 1), (10**12, 3, 1)])
def test_motions_that_do_not_fit_into_memory_are_refused(shape):
    with pytest.raises(SSTError):
        CHAIN.rollout(np.broadcast_to(0.0, shape), CHAIN.home, [0.0], 1e-3)


def archive(**changes):
    arrays = {name: getattr(MOTION, name) for name in ("t", "q", "va", "aa", "tau")}
    arrays |= {
        "joint_names": np.array(MOTION.joint_names),
        "motor_names": np.array(MOTION.motor_names),
    }
    arrays |= {"units": np.array(MOTION.units), "stopped": np.array("")} | changes
    file = io.BytesIO()
    np.savez(file, **{name: value for name, value in arrays.items() if value is not None})
    return file.getvalue()


FILES = {
    "csv": [
        *(b"", bytes(range(256)), b"t_s,a_rad\n0,\0\n", "t_s,é_rad\n0,1\n".encode("latin-1")),
        *("t_s,a_rad\n0,1\n".encode("utf-16"), b"t_s," + b"a" * 200_000 + b"\n0,1\n"),
    ],
    "npz": [
        *(b"", bytes(1000), b"t_s,a_rad\n0,1\n", archive()[:600], archive(q=None)),
        *(archive(q=MOTION.q.astype(kind)) for kind in (str, complex, object)),
        *(archive(q=x) for x in (MOTION.q * np.nan, MOTION.q[:-1], np.array(1.0))),
        *(archive(joint_names=x) for x in (np.array(5), np.array("x"), np.arange(3))),
        archive(t=np.datetime64("2026-01-01") + np.arange(5)),
    ],
}


@pytest.mark.parametrize(
    ("ending", "content"), [(ending, content) for ending in FILES for content in FILES[ending]]
)
def test_files_that_hold_no_motion_are_refused(here, ending, content):
    (here / f"a.{ending}").write_bytes(content)
    with pytest.raises(SSTError):
        Trajectory.load(f"a.{ending}")
