# SPDX-License-Identifier: BSD-2-Clause
"""Motions of the star in tables: orientations as quaternions or the paper's angles."""

import numpy as np

from ..arrays import Array
from ..description.frames import MOTOR_NAMES
from ..errors import FileFormatError
from ..files import Table
from ..summaries import listed
from .platform_motion import PlatformMotion, interpolate_orientations, orientation
from .robot import SST

_QUATERNION = ("qw", "qx", "qy", "qz")
_ANGLES = ("theta", "phi", "psi")
#: Quaternions are rounded; their lengths differ from 1 by less than this.
_NOT_UNIT = 1e-3


def star_motion(robot: SST, table: Table) -> tuple[Array, Array, Array] | None:
    """q, va, aa of an SST from a table of the star's orientation; None for motor angles.

    The columns are `t_s` and either `qw, qx, qy, qz`, the orientation of {E} in the base, or the
    paper's angles `theta, phi, psi` with the ending `_rad` or `_deg`; `psi` is zero by default.

    Raises:
        FileFormatError: If the columns do not describe exactly one motion.
    """
    motion = _platform_motion(table)
    if motion is None:
        return None
    q, va, aa = robot.joint_motion(*motion)
    return np.unwrap(q, axis=0), va, aa


def _platform_motion(table: Table) -> PlatformMotion | None:
    """The motion of the star in a table; None if the table has motor angles."""
    has_quaternion = any(name in table.columns for name in _QUATERNION)
    has_angles = any(_column(table, name) for name in _ANGLES)
    has_motors = any(_column(table, name) for name in MOTOR_NAMES)
    if [has_quaternion, has_angles, has_motors].count(True) != 1:
        raise FileFormatError(
            table.path,
            "the columns do not describe a motion of the SST; use exactly one of: qw, qx, qy, qz | "
            "theta_rad, phi_rad, psi_rad | gamma_1_rad, gamma_2_rad, gamma_3_rad (_deg for "
            "degrees); for another robot, name it: --robot FILE; columns: "
            f"{', '.join(table.columns)}",
            1,
        )
    if has_motors:
        return None
    t = table.column("t_s")
    if len(t) < 3:
        raise FileFormatError(table.path, f"{len(t)} rows; rates need at least three")
    if has_quaternion:
        R = _rotations(table)
    else:
        psi = _angle(table, "psi") if _column(table, "psi") else 0.0
        R = orientation(_angle(table, "theta"), _angle(table, "phi"), psi)
    return interpolate_orientations(t, R, t)


def _rotations(table: Table) -> Array:
    """Orientations by unit quaternions, shape (N, 3, 3)."""
    from scipy.spatial.transform import Rotation

    quaternions = table.select(_QUATERNION)
    lengths = np.linalg.norm(quaternions, axis=1)
    is_wrong = np.abs(lengths - 1) > _NOT_UNIT
    if is_wrong.any():
        i = int(np.argmax(is_wrong))
        problem = f"quaternion of length {lengths[i]:.6g}, expected 1, in {listed(_QUATERNION)}"
        raise FileFormatError(table.path, problem, table.lines[i])
    return Rotation.from_quat(np.roll(quaternions, -1, axis=1)).as_matrix()


def _column(table: Table, name: str) -> str | None:
    """The column of an angle, in any unit."""
    names = [c for c in (f"{name}_rad", f"{name}_deg") if c in table.columns]
    if len(names) > 1:
        raise FileFormatError(table.path, f"one angle has several columns: {', '.join(names)}", 1)
    return names[0] if names else None


def _angle(table: Table, name: str) -> Array:
    column = _column(table, name) or f"{name}_rad"  # errors name the column in radians
    values = table.column(column)
    return np.radians(values) if column == f"{name}_deg" else values
