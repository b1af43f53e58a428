# SPDX-License-Identifier: BSD-2-Clause
"""The two examples of Sect. 7."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..simulation.energy import energy_error
from ..simulation.trajectories import Trajectory
from .platform_motion import paper_circle
from .robot import SST

#: Duration of one turn on the circle, [s].
PERIOD = np.pi / 6
#: Initial state of Sect. 7.3 as printed, [rad], [rad/s].
ROUNDED_GAMMA = (np.pi / 4, 0.5549, 1.0159)
ROUNDED_GAMMA_DOT = (4.2096, -0.6918, -0.6918)


def example_1(robot: SST, t: ArrayLike) -> Trajectory:
    """Inverse dynamics along the circle (Sect. 7.2)."""
    q, va, aa = robot.joint_motion(*paper_circle(t))
    tau = robot.compute_torques(q, va, aa)
    return Trajectory(t, np.unwrap(q, axis=0), va, aa, tau, robot.joint_names, robot.motor_names)


def example_2(robot: SST, example: Trajectory, rounded: bool = False) -> Trajectory:
    """Direct dynamics with the torques of example 1 (Sect. 7.3).

    It starts at the first state of example 1 or, if `rounded`, at the state printed in the paper.
    """
    q0 = example.q[0]
    va0 = example.va[0]
    if rounded:
        q0 = robot.forward_kinematics(ROUNDED_GAMMA, near=q0)
        va0 = np.array(ROUNDED_GAMMA_DOT)
    return robot.simulate(example, q0, va0, example.t)


class Errors(NamedTuple):
    """Errors of example 2 against example 1."""

    #: Largest angle between the axes s, [rad].
    path_error: float
    #: Largest closure residual, [rad] or [m].
    closure: float
    #: Largest error of the energy balance, [J].
    energy: float


def angles_off_path(robot: SST, example: Trajectory, motion: Trajectory) -> Array:
    """Angles between the axes s at the samples of a motion and an example, shape (N,), [rad]."""
    s = robot.platform_orientation(motion.q)[..., 0]
    s_wanted = robot.platform_orientation(example.q[: len(motion)])[..., 0]
    # |s x s'| keeps the digits of a small angle that the dot product loses.
    sine = np.linalg.norm(np.cross(s, s_wanted), axis=1)
    return np.arctan2(sine, (s * s_wanted).sum(axis=1))


def compare(robot: SST, example: Trajectory, motion: Trajectory) -> Errors:
    """The errors of example 2."""
    return Errors(
        path_error=float(angles_off_path(robot, example, motion).max()),
        closure=float(np.abs(robot.residual(motion.q)).max()),
        energy=float(np.abs(energy_error(robot, motion)).max()),
    )
