# SPDX-License-Identifier: BSD-2-Clause
"""Placements, and angles of inverse kinematics in closed form, which are NaN out of reach."""

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from pinocchio.rpy import rpyToMatrix

from ..arrays import Array, in_one_turn

#: At the joint of the parent, and along its axes.
HERE = pin.SE3.Identity()
#: From a plane of motion, x to the right and y up, to the base, where z points up.
UPRIGHT = pin.SE3(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3))


def shift(origin: ArrayLike) -> pin.SE3:
    """A placement that does not turn, by its origin: x, y and perhaps z, [m]."""
    translation = np.zeros(3)
    translation[: np.size(origin)] = origin
    return pin.SE3(np.eye(3), translation)


def planar(x: float, y: float, angle: float) -> pin.SE3:
    """A placement in the plane of x and y; [m], [m], [rad]."""
    return pin.SE3(rpyToMatrix(0.0, 0.0, angle), np.array([x, y, 0.0]))


def rotated_about_x(angle: float) -> pin.SE3:
    """A turn about x, [rad]."""
    return pin.SE3(rpyToMatrix(angle, 0.0, 0.0), np.zeros(3))


def rotation_x_then_y(x: float, y: float) -> Array:
    """Orientation by turns about x and then the moved y, shape (3, 3)."""
    return np.asarray(rpyToMatrix(x, 0.0, 0.0) @ rpyToMatrix(0.0, y, 0.0))


def circle(radius: float, angles: ArrayLike) -> Array:
    """Points on a circle about z, shape (n, 3); [m], [rad]."""
    angles = np.asarray(angles, dtype=float)
    return radius * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)


def angle_of(vector: ArrayLike) -> float:
    """Angle of a planar vector from the x axis, [rad]; shape (2,) or longer."""
    x, y, *_ = np.asarray(vector, dtype=float)
    return float(np.arctan2(y, x))


def angle_about_z(R: Array) -> float:
    """Angle of a turn about z, [rad]; shape (3, 3)."""
    return angle_of(R[:, 0])


def two_link(target: ArrayLike, first: float, second: float, *, elbow: int) -> tuple[float, float]:
    """Angles of a planar two-link arm whose tip is at a point relative to its shoulder, [rad].

    The shoulder angle is from the x axis, the elbow angle from the first link. Of the two
    solutions, the one whose elbow angle has the sign `elbow`, 1 or -1, is returned. Both angles are
    NaN if the arm cannot reach the point.
    """
    x, y, *_ = np.asarray(target, dtype=float)
    # The law of cosines in the triangle of both links and the target.
    cosine = (x**2 + y**2 - first**2 - second**2) / (2 * first * second)
    with np.errstate(invalid="ignore"):
        bend = elbow * np.arccos(cosine)
    shoulder = np.arctan2(y, x) - np.arctan2(second * np.sin(bend), first + second * cosine)
    return float(in_one_turn(shoulder)), float(bend)


def universal_angles(vector: ArrayLike) -> tuple[float, float]:
    """Turns about x and then y that bring the z axis to a direction; shape (3,)."""
    x, y, z = np.asarray(vector, dtype=float)
    return float(np.arctan2(-y, z)), float(np.arctan2(x, np.hypot(y, z)))


def rotation_z_to(direction: Array) -> Array:
    """A rotation that brings the z axis to a direction of any length, shape (3, 3)."""
    return pin.Quaternion.FromTwoVectors(np.array([0.0, 0, 1]), direction).matrix()
