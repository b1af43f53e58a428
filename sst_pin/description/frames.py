# SPDX-License-Identifier: BSD-2-Clause
"""Joints and frames of an SST, by its parameters."""

import numpy as np

from ..arrays import Array
from .parameters import Parameters, RigidBody

#: Names of all joints, leg by leg, in the order of q.
JOINT_NAMES = (
    "gamma_1",
    "mu_1",
    "beta_1",
    "gamma_2",
    "mu_2",
    "beta_2",
    "gamma_3",
    "mu_3",
    "beta_3",
)
#: Joints of the motors, in the order of va, aa and tau.
MOTOR_NAMES = JOINT_NAMES[::3]


def base_orientations(parameters: Parameters) -> Array:
    """R_0k: {0k} in the base, x = v_k and z = e_k, shape (3, 3, 3) (Eqs. 32, 36)."""
    v = parameters.base_directions
    e = parameters.actuated_axes
    return np.stack([v, np.cross(e, v), e], axis=-1)


def star_orientations(parameters: Parameters) -> Array:
    """Orientations of {E} in {31}, {32}, {33}, shape (3, 3, 3).

    They are Rot(x, 0), Rot(x, -alpha_2) and Rot(x, -(alpha_2 + alpha_3)), because the arcs are
    turned by these angles about x.
    """
    _, alpha_2, alpha_3 = parameters.arc_angles
    rotations = []
    for angle in (0.0, -alpha_2, -(alpha_2 + alpha_3)):  # Eqs. (30), (31), (35)
        c = np.cos(angle)
        s = np.sin(angle)
        rotations.append(((1, 0, 0), (0, c, -s), (0, s, c)))
    return np.array(rotations)


def star_arcs(parameters: Parameters) -> tuple[RigidBody, ...]:
    """The star's three arcs in {31}, {32}, {33}, each with a third of its mass and inertia."""
    star = parameters.star
    # Mass centre and inertia are written in {3k}, not in {E} with a rotation, because MuJoCo before
    # 3.14 ignores the rpy of an inertial without a warning.
    arcs = []
    for R in star_orientations(parameters):
        arc = RigidBody(star.mass / 3, R @ star.center_of_mass, R @ star.inertia @ R.T / 3)
        arcs.append(arc)
    return tuple(arcs)
