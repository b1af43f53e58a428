# SPDX-License-Identifier: BSD-2-Clause
"""Parameters, orientations and motions of the SST refuse what they cannot be."""

import inspect
from functools import partial

import numpy as np
import pytest

import sst_pin
from sst_pin.errors import SSTError
from sst_pin.simulation.motion_files import read_motion
from sst_pin.sst.star_tables import star_motion
from tests.support.bad_calls import faults

T = np.linspace(0, 0.1, 8)
R = sst_pin.paper_circle(T).R
PARAMETERS = sst_pin.Parameters()
BODY = {"mass": 2.6, "center_of_mass": np.full(3, 0.1), "inertia": np.eye(3), "at": np.ones(3)}


def star(mass: "float", center_of_mass: "ArrayLike", inertia: "ArrayLike"):  # noqa: F821
    return sst_pin.Parameters(star=sst_pin.sst.RigidBody(mass, center_of_mass, inertia))


CALLS = {
    "Parameters": (
        sst_pin.Parameters,
        {n: getattr(PARAMETERS, n, None) for n in inspect.signature(sst_pin.Parameters).parameters},
    ),
    "with_payload": (PARAMETERS.with_payload, BODY),
    "star": (star, BODY),
    "interpolate_orientations": (
        sst_pin.sst.interpolate_orientations,
        {"t": T, "R": R, "at": 0.05},
    ),
    "orientation_path": (sst_pin.sst.orientation_path, {"R": R, "count": 5}),
    "paper_circle": (sst_pin.paper_circle, {"t": 0.1}),
    "orientation": (sst_pin.sst.orientation, {"theta": 0.1, "phi": 0.1, "psi": 0.1}),
    "orientation_motion": (
        sst_pin.sst.orientation_motion,
        dict.fromkeys(("theta", "phi", "psi"), np.ones((3, 2))),
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_functions_refuse_bad_arguments(name):
    assert faults(*CALLS[name]) == []


HALF_TURNS = R @ np.diag([1.0, -1, -1]) ** np.arange(8)[:, None, None]


@pytest.mark.parametrize(
    "arguments",
    [
        *((T[:2], R[:2], 0.0), (T, R[:-1], T), (T, R[0], T), (T, R * np.array([1, 1, -1]), T)),
        *((T, 2 * R, T), (T, R + 0.01, T), (T, 0 * R, T), (T[::-1], R, T), (T, HALF_TURNS, T)),
        *((T, R, [-1.0]), (T, R, [0.2]), (T[None], R, T), (T, R[None], T)),
    ],
)
def test_orientations_are_interpolated_between_rotations_at_increasing_times(arguments):
    with pytest.raises(SSTError):
        sst_pin.sst.interpolate_orientations(*arguments)


@pytest.mark.parametrize("turned", [np.eye(3)[::-1], 2 * np.eye(3), 0 * R[0], np.eye(3) + 0.01])
def test_inverse_kinematics_takes_rotations_alone(robot, turned):
    with pytest.raises(SSTError):
        robot.inverse_kinematics(turned)


@pytest.mark.parametrize("branch", [(1, 1, 0), (1, 1, 2), (1, 1), (0.5, 1, 1)])
def test_a_branch_is_three_signs(robot, branch):
    with pytest.raises(SSTError):
        robot.inverse_kinematics(np.eye(3), branch)


STILL = np.column_stack([np.arange(6) * 0.01, np.tile((1.0, 0, 0, 0), (6, 1))])
TURNED = STILL.copy()
TURNED[3, 1:] = (0.0, 1, 0, 0)


@pytest.mark.parametrize(
    ("header", "rows"),
    [
        ("t_s,qw,qx,qy,qz", STILL * (1, 0, 0, 0, 0)),
        ("t_s,qw,qx,qy,qz", TURNED),  # half a turn between two samples
        ("t_s,qw,qx,qy,qz", STILL * (1e-318, 1, 1, 1, 1)),
        ("t_s,theta_rad", STILL[:, :2]),
        ("t_s,theta_rad,theta_deg,phi_rad", STILL[:, :4]),
        ("t_s,gamma_1_rad,gamma_2_rad,gamma_3_rad", STILL[:, [0, 0, 0, 0]] * (1, *[1e300] * 3)),
    ],
)
def test_tables_that_hold_no_motion_of_the_star_are_refused(robot, here, header, rows):
    np.savetxt("a.csv", rows, "%r", ",", header=header, comments="")
    with pytest.raises(SSTError):
        read_motion(robot.engine, "a.csv", partial(star_motion, robot))
