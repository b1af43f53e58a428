# SPDX-License-Identifier: BSD-2-Clause
"""Motions of the star in tables: as quaternions, as angles, as motor angles."""

import numpy as np

from ..arrays import Array
from ..description import MOTOR_NAMES
from ..errors import FileFormatError
from ..files import Table
from .platform_motion import PlatformMotion, interpolate_orientations, orientation

_QUATERNION = ("qx", "qy", "qz", "qw")
_ANGLES = ("theta", "phi", "psi")


def motion_in(table: Table) -> PlatformMotion | Array:
    """The motion of the star in a table, or the motor angles, shape (N, 3), [rad].

    The columns are `t_s` and one of: `qw, qx, qy, qz`, the orientation of {E} in the base; `theta,
    phi, psi`, the paper's angles; `gamma_1, gamma_2, gamma_3`. Angles may end in `_rad` or `_deg`
    and are radians without; `psi` may be left out and is then zero.
    """
    kinds = {
        "quaternion": any(name in table.columns for name in _QUATERNION),
        "angles": any(_unit(table, name) for name in _ANGLES),
        "motors": any(_unit(table, name) for name in MOTOR_NAMES),
    }
    given = [kind for kind, there in kinds.items() if there]
    if len(given) != 1:
        raise FileFormatError(
            table.path,
            f"columns of {'several motions' if given else 'no motion'}; use exactly one of: "
            "qw, qx, qy, qz | theta_rad, phi_rad, psi_rad | gamma_1_rad, gamma_2_rad, gamma_3_rad "
            f"(_deg for degrees); found: {', '.join(table.columns)}",
            1,
        )
    t = table.column("t_s")
    if len(t) < 3:
        raise FileFormatError(table.path, f"{len(t)} rows; rates need at least three")
    if given == ["motors"]:
        return np.column_stack([_angle(table, name) for name in MOTOR_NAMES])
    if given == ["quaternion"]:
        R = _rotations(table)
    else:
        psi = _angle(table, "psi") if _unit(table, "psi") else 0.0
        R = orientation(_angle(table, "theta"), _angle(table, "phi"), psi)
    return interpolate_orientations(t, R, t)


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
        problem = f"quaternion of length {lengths[i]:.6g}, expected 1"
        raise FileFormatError(table.path, problem, table.lines[i])
    return Rotation.from_quat(quaternions).as_matrix()
