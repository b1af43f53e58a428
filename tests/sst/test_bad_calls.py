# SPDX-License-Identifier: BSD-2-Clause
"""Calls with wrong values: parameters, orientations and motions of the SST refuse them."""

from __future__ import annotations  # `faults` reads annotations as texts

import inspect
from functools import partial

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

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
# SSTError. `tests.support.bad_calls` has these values, for instance for `float` and `ArrayLike`. It
# has none for an annotation that it does not list.


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
        # Each angle has rows: itself, its rate and its acceleration.
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

#: Wrong arguments t, R, at: times, orientations at these times, and times of the output. The last
#: value is a part of the error.
NO_INTERPOLATION = {
    "two samples": (T[:2], R[:2], 0.0, "t: shape"),
    "a time without an orientation": (T, R[:-1], T, "R: shape"),
    "one orientation": (T, R[0], T, "R: shape"),
    "reflections": (T, R * np.array([1, 1, -1]), T, "R: not a rotation matrix"),
    "matrices twice as large": (T, 2 * R, T, "R: not a rotation matrix"),
    "matrices that are not orthogonal": (T, R + 0.01, T, "R: not a rotation matrix"),
    "zeros": (T, 0 * R, T, "R: not a rotation matrix"),
    "decreasing times": (T[::-1], R, T, "t: not increasing"),
    "half turns between samples": (T, HALF_TURNS, T, "R: .* more than a quarter turn"),
    "a time before the first": (T, R, [-1.0], "at: -1 s"),
    "a time after the last": (T, R, [0.2], "at: 0.2 s"),
    "times with another axis": (T[None], R, T, "t: shape"),
    "orientations with another axis": (T, R[None], T, "R: shape"),
}


@pytest.mark.parametrize("case", NO_INTERPOLATION)
def test_orientations_are_interpolated_between_rotations_at_increasing_times(case):
    *arguments, message = NO_INTERPOLATION[case]
    with pytest.raises(InputError, match=message):
        sst_pin.sst.interpolate_orientations(*arguments)


#: Matrices that are no rotations.
NO_ROTATIONS = {
    "a reflection": np.eye(3)[::-1],
    "twice a rotation": 2 * np.eye(3),
    "zeros": np.zeros((3, 3)),
    "a matrix that is not orthogonal": np.eye(3) + 0.01,
}


@pytest.mark.parametrize("case", NO_ROTATIONS)
def test_inverse_kinematics_takes_rotations_alone(robot, case):
    with pytest.raises(InputError, match="pose"):  # `inverse_kinematics` calls its argument pose
        robot.inverse_kinematics(NO_ROTATIONS[case])


@pytest.mark.parametrize("branch", [(1, 1, 0), (1, 1, 2), (1, 1), (0.5, 1, 1)])
def test_a_branch_is_three_signs(robot, branch):
    with pytest.raises(InputError, match="branch"):
        robot.inverse_kinematics(R[0], branch)


# --- tables -------------------------------------------------------------------------------------

#: The paper's motion as quaternions w, x, y, z. In the second array one of them is turned by half a
#: turn about x.
QUATERNIONS = Rotation.from_matrix(R).as_quat(scalar_first=True)
HALF_A_TURN = QUATERNIONS.copy()
HALF_A_TURN[3] = Rotation.from_matrix(HALF_TURNS[3]).as_quat(scalar_first=True)
#: Columns of a constant angle, in [rad].
ANGLE = np.full((len(T), 1), 0.1)
QUATERNION = "t_s,qw,qx,qy,qz"
MOTOR_ANGLES = "t_s,gamma_1_rad,gamma_2_rad,gamma_3_rad"

#: Tables of motions: the header, and the columns after the times. The tables that are no motions
#: differ from one of these in one thing.
MOTIONS = {
    "quaternions": (QUATERNION, QUATERNIONS),
    "two angles": ("t_s,theta_rad,phi_rad", ANGLE.repeat(2, axis=1)),
    "motor angles": (MOTOR_ANGLES, ANGLE.repeat(3, axis=1)),
}
#: Tables that are no motion of the star, each with a part of the error.
NO_MOTIONS = {
    "quaternions of length zero": (QUATERNION, 0 * QUATERNIONS, "quaternion of length 0,"),
    "quaternions of length two": (QUATERNION, 2 * QUATERNIONS, "quaternion of length 2,"),
    "quaternions too short to normalise": (
        QUATERNION,
        1e-318 * QUATERNIONS,
        "quaternion of length 0,",
    ),
    "half a turn between two samples": (QUATERNION, HALF_A_TURN, "more than a quarter turn"),
    "no angle phi": ("t_s,theta_rad", ANGLE, "phi_rad"),
    "theta in two units": (
        "t_s,theta_rad,theta_deg,phi_rad",
        ANGLE.repeat(3, axis=1),
        "one angle has several columns: theta_rad, theta_deg",
    ),
    "motor angles that are too large": (
        MOTOR_ANGLES,
        np.outer(1e300 * T, np.ones(3)),
        "loops cannot",
    ),
}


def motion_of_table(robot, header: str, columns):
    """The motion that is read from a table with the times T and these columns.

    The table is written to the working directory, which the fixture `here` sets.
    """
    table = np.column_stack([T, columns])
    np.savetxt("a.csv", table, fmt="%.17g", delimiter=",", header=header, comments="")
    return read_motion(robot.engine, "a.csv", partial(star_motion, robot))


@pytest.mark.parametrize("case", MOTIONS)
def test_tables_with_a_motion_of_the_star_are_read(robot, here, case):
    motion = motion_of_table(robot, *MOTIONS[case])
    assert motion.q.shape == (len(T), robot.model.nq)


@pytest.mark.parametrize("case", NO_MOTIONS)
def test_tables_without_a_motion_of_the_star_are_refused(robot, here, case):
    header, columns, message = NO_MOTIONS[case]
    with pytest.raises(SSTError, match=message):
        motion_of_table(robot, header, columns)
