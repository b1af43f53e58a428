# SPDX-License-Identifier: BSD-2-Clause
"""Motions of the star that people write down: as quaternions, as angles, as motor angles."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..description import MOTOR_NAMES
from ..errors import FileFormatError, SSTError
from ..files import Table, read_table
from ..motion.motion_columns import parts_of
from ..motion.motion_files import is_npz, of_robot
from ..motion.samples import spline
from ..motion.trajectories import Trajectory
from .platform_motion import interpolate_orientations, orientation
from .robot import SST

Array = NDArray[np.float64]

_QUATERNION = ("qx", "qy", "qz", "qw")
_ANGLES = ("theta", "phi", "psi")


def read_motion(robot: SST, source: str | Path | BinaryIO) -> Trajectory:
    """The motor torques of a motion in a CSV, at the times that stand there.

    The columns are `t_s` and one of: `qw, qx, qy, qz`, the orientation of {E} in the base;
    `theta, phi, psi`, the paper's angles; `gamma_1, gamma_2, gamma_3`. Angles may end in `_rad` or
    `_deg` and are radians without; `psi` may be left out and is then zero. Rates come from splines
    of degree five: on the rotation group for orientations, in the angles for motors.

    Args:
        robot: Whose motion it is.
        source: The file, or a stream.

    Returns:
        The motion with its torques, joint angles continuous in time.

    Raises:
        FileFormatError: When the file is not such a motion.
        WorkspaceError, SingularConfigurationError: When the robot cannot follow it.
    """
    return _motion_of(robot, read_table(source))


def _motion_of(robot: SST, table: Table) -> Trajectory:
    path = table.path
    kinds = {
        "qw, qx, qy, qz": any(name in table.columns for name in _QUATERNION),
        "theta, phi, psi": any(_unit(table, name) for name in _ANGLES),
        "gamma_1, gamma_2, gamma_3": any(_unit(table, name) for name in MOTOR_NAMES),
    }
    given = [kind for kind, there in kinds.items() if there]
    if len(given) != 1:
        raise FileFormatError(
            path,
            f"columns of {'several motions' if given else 'no motion'}; use exactly one of: "
            "qw, qx, qy, qz | theta_rad, phi_rad, psi_rad | gamma_1_rad, gamma_2_rad, gamma_3_rad "
            f"(_deg for degrees); found: {', '.join(table.columns)}",
            1,
        )
    t = table.column("t_s")
    if len(t) < 3:
        raise FileFormatError(path, f"{len(t)} rows; rates need at least three")
    if given[0].startswith("gamma"):
        q, va, aa = _from_motor_angles(robot, table, t)
    else:
        read = _rotations if given[0].startswith("q") else _rotations_of_angles
        q, va, aa = robot.joint_motion(*interpolate_orientations(t, read(table), t))
    tau = robot.compute_torques(q, va, aa)
    return Trajectory(t, np.unwrap(q, axis=0), va, aa, tau, robot.joint_names, MOTOR_NAMES)


def load_motion(robot: SST, source: str | Path | BinaryIO) -> Trajectory:
    """A motion with the torques of its file; without these, with computed torques.

    Args:
        robot: Whose motion it is.
        source: What `Trajectory.save` has written, or a CSV for `read_motion`; a stream is a CSV.

    Raises:
        FileFormatError, WorkspaceError, SingularConfigurationError: As `read_motion`.
    """
    if is_npz(source):
        return of_robot(robot, Trajectory.load(source), source)
    table = read_table(source)
    if not {f"{name}_rad" for name in robot.joint_names} | {"tau_1_Nm"} <= set(table.columns):
        return _motion_of(robot, table)
    return of_robot(robot, Trajectory(**parts_of(table)), table.path)


def _unit(table: Table, name: str) -> str | None:
    """The column of an angle, in any unit."""
    names = [c for c in (f"{name}_rad", f"{name}_deg", name) if c in table.columns]
    if len(names) > 1:
        raise FileFormatError(table.path, f"one angle has several columns: {', '.join(names)}", 1)
    return names[0] if names else None


def _angle(table: Table, name: str) -> Array:
    column = _unit(table, name)
    values = table.column(column or f"{name}_rad")  # a missing one is missed in radians
    return np.radians(values) if column == f"{name}_deg" else values


def _rotations(table: Table) -> Array:
    from scipy.spatial.transform import Rotation

    quaternions = table.select(_QUATERNION)
    lengths = np.linalg.norm(quaternions, axis=1)
    wrong = np.abs(lengths - 1) > 1e-3
    if wrong.any():
        i = int(np.argmax(wrong))
        raise FileFormatError(
            table.path, f"quaternion of length {lengths[i]:.6g}, expected 1", table.lines[i]
        )
    return Rotation.from_quat(quaternions).as_matrix()


def _rotations_of_angles(table: Table) -> Array:
    psi = _angle(table, "psi") if _unit(table, "psi") else 0.0
    return orientation(_angle(table, "theta"), _angle(table, "phi"), psi)


def _from_motor_angles(robot: SST, table: Table, t: Array) -> tuple[Array, Array, Array]:
    gamma = np.column_stack([_angle(table, name) for name in MOTOR_NAMES])
    q, near = [], robot.home
    for sample, line in zip(gamma, table.lines, strict=True):
        try:
            near = robot.forward_kinematics(sample, near=near)
        except SSTError as error:
            raise FileFormatError(table.path, str(error), line) from None
        q.append(near)
    curve = spline(t, gamma)
    return np.array(q), curve.derivative(1)(t), curve.derivative(2)(t)
