# SPDX-License-Identifier: BSD-2-Clause
"""Motions of the star in tables: as quaternions, as angles, as motor angles."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..description import MOTOR_NAMES
from ..errors import FileFormatError, SSTError
from ..files import Table
from ..motion.samples import spline
from .platform_motion import interpolate_orientations, orientation

_QUATERNION = ("qx", "qy", "qz", "qw")
_ANGLES = ("theta", "phi", "psi")


class Star(Protocol):
    """What this module needs of an SST."""

    @property
    def home(self) -> Array:
        """See `SST.home`."""

    def joint_motion(
        self, R: ArrayLike, omega: ArrayLike, alpha: ArrayLike
    ) -> tuple[Array, Array, Array]:
        """See `SST.joint_motion`."""

    def forward_kinematics(self, gamma: ArrayLike, near: ArrayLike | None = None) -> Array:
        """See `SST.forward_kinematics`."""


def motion_in(robot: Star, table: Table) -> tuple[Array, Array, Array]:
    """The motion in a table: q continuous in time, va, aa.

    The columns are `t_s` and one of: `qw, qx, qy, qz`, the orientation of {E} in the base; `theta,
    phi, psi`, the paper's angles; `gamma_1, gamma_2, gamma_3`. Angles may end in `_rad` or `_deg`
    and are radians without; `psi` may be left out and is then zero. Rates come from splines of
    degree five: on the rotation group for orientations, in the angles for motors.
    """
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
    return np.unwrap(q, axis=0), va, aa


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


def _from_motor_angles(robot: Star, table: Table, t: Array) -> tuple[Array, Array, Array]:
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
