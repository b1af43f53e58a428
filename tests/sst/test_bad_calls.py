# SPDX-License-Identifier: BSD-2-Clause
"""Calls with wrong values: parameters, orientations and motions of the SST refuse them."""

from __future__ import annotations  # `faults` reads annotations as texts

import inspect
from functools import partial

import numpy as np
import pytest
from numpy.typing import ArrayLike

import sst_pin
from sst_pin.errors import InputError, SSTError
from sst_pin.simulation.motion_files import read_motion
from sst_pin.sst.star_tables import star_motion
from tests.support.bad_calls import faults

#: The paper's motion: eight times and the orientations at these times.
T = np.linspace(0, 0.1, 8)
R = sst_pin.paper_circle(T).R


# --- each argument of each function -------------------------------------------------------------
#
# `faults` calls a function with good arguments, but one of them replaced by a wrong value. It tries
# the values that no argument with this annotation may have, and returns the calls that raise no
# SSTError.


def parameters_with_star(mass: float, center_of_mass: ArrayLike, inertia: ArrayLike):
    """Parameters with this star. They check the star; `RigidBody` itself does not."""
    return sst_pin.Parameters(star=sst_pin.sst.RigidBody(mass, center_of_mass, inertia))


PARAMETERS = sst_pin.Parameters()
NAMES_OF_PARAMETERS = inspect.signature(sst_pin.Parameters).parameters
#: Functions, each with good arguments.
CALLS = [
    (sst_pin.Parameters, {name: getattr(PARAMETERS, name) for name in NAMES_OF_PARAMETERS}),
    (PARAMETERS.with_payload, {"mass": 2.6, "at": np.ones(3)}),
    (
        parameters_with_star,
        {"mass": 2.6, "center_of_mass": np.full(3, 0.1), "inertia": np.eye(3)},
    ),
    (sst_pin.paper_circle, {"t": 0.1}),
    (sst_pin.sst.interpolate_orientations, {"t": T, "R": R, "at": 0.05}),
    (sst_pin.sst.orientation_path, {"R": R, "count": 5}),
    (sst_pin.sst.orientation, {"theta": 0.1, "phi": 0.1, "psi": 0.1}),
    (
        sst_pin.sst.orientation_motion,
        {"theta": np.ones((3, 2)), "phi": np.ones((3, 2)), "psi": np.ones((3, 2))},
    ),
]


@pytest.mark.parametrize(
    ("function", "good"), CALLS, ids=[function.__name__ for function, _ in CALLS]
)
def test_functions_refuse_each_argument_that_is_wrong(function, good):
    assert faults(function, good) == []


# --- orientations -------------------------------------------------------------------------------

#: Every other orientation is turned by half a turn about its x axis.
HALF_TURNS = R.copy()
HALF_TURNS[1::2] = R[1::2] @ np.diag([1.0, -1.0, -1.0])

#: Wrong arguments t, R, at: times, orientations at these times, and times of the output.
NO_INTERPOLATION = {
    "two samples": (T[:2], R[:2], 0.0),
    "a time without an orientation": (T, R[:-1], T),
    "one orientation": (T, R[0], T),
    "reflections": (T, R * np.array([1, 1, -1]), T),
    "matrices twice as large": (T, 2 * R, T),
    "matrices that are not orthogonal": (T, R + 0.01, T),
    "zeros": (T, 0 * R, T),
    "decreasing times": (T[::-1], R, T),
    "half turns between samples": (T, HALF_TURNS, T),
    "a time before the first": (T, R, [-1.0]),
    "a time after the last": (T, R, [0.2]),
    "times with another axis": (T[None], R, T),
    "orientations with another axis": (T, R[None], T),
}


@pytest.mark.parametrize("case", NO_INTERPOLATION)
def test_orientations_are_interpolated_between_rotations_at_increasing_times(case):
    with pytest.raises(InputError):
        sst_pin.sst.interpolate_orientations(*NO_INTERPOLATION[case])


#: Matrices that are no rotations.
NO_ROTATIONS = {
    "a reflection": np.eye(3)[::-1],
    "twice a rotation": 2 * np.eye(3),
    "zeros": np.zeros((3, 3)),
    "a matrix that is not orthogonal": np.eye(3) + 0.01,
}


@pytest.mark.parametrize("case", NO_ROTATIONS)
def test_inverse_kinematics_takes_rotations_alone(robot, case):
    with pytest.raises(InputError, match="pose"):
        robot.inverse_kinematics(NO_ROTATIONS[case])


@pytest.mark.parametrize("branch", [(1, 1, 0), (1, 1, 2), (1, 1), (0.5, 1, 1)])
def test_a_branch_is_three_signs(robot, branch):
    with pytest.raises(InputError, match="branch"):
        robot.inverse_kinematics(R[0], branch)


# --- tables -------------------------------------------------------------------------------------

#: Quaternions w, x, y, z of a star at rest; in the second table it is turned once by half a turn.
TIMES = 0.01 * np.arange(6.0)
AT_REST = np.tile((1.0, 0.0, 0.0, 0.0), (6, 1))
HALF_A_TURN = AT_REST.copy()
HALF_A_TURN[3] = (0.0, 1.0, 0.0, 0.0)
QUATERNION = "t_s,qw,qx,qy,qz"

#: Tables that are no motion of the star: the header, and the columns after the times.
NO_MOTIONS = {
    "quaternions of length zero": (QUATERNION, 0 * AT_REST),
    "quaternions too short to normalise": (QUATERNION, AT_REST * (1e-318, 1, 1, 1)),
    "half a turn between two samples": (QUATERNION, HALF_A_TURN),
    "one angle of three": ("t_s,theta_rad", AT_REST[:, :1]),
    "one angle twice": ("t_s,theta_rad,theta_deg,phi_rad", AT_REST[:, :3]),
    "angles that are too large": (
        "t_s,gamma_1_rad,gamma_2_rad,gamma_3_rad",
        np.outer(TIMES, np.full(3, 1e300)),
    ),
}


@pytest.mark.parametrize("case", NO_MOTIONS)
def test_tables_without_a_motion_of_the_star_are_refused(robot, here, case):
    header, columns = NO_MOTIONS[case]
    table = np.column_stack([TIMES, columns])
    np.savetxt("a.csv", table, fmt="%r", delimiter=",", header=header, comments="")
    with pytest.raises(SSTError):
        read_motion(robot.engine, "a.csv", partial(star_motion, robot))
