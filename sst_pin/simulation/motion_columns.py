# SPDX-License-Identifier: BSD-2-Clause
"""Columns of a motion in a CSV: their names, with units, and what they say."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import FileFormatError
from ..files import Table
from ..summaries import listed

#: The name or number, and the unit, of a torque's column.
TORQUE = re.compile(r"tau_(.+)_(Nm|N)")
#: Units of a rate; those of an acceleration have a 2 behind.
RATE = re.compile(r"(.+)_(rad|m)_s(2?)")
#: A quaternion whose length is farther from 1 is no rounded one.
_NOT_UNIT = 1e-3
_POSITION = re.compile(r"(.+)_(?:(rad|m)|1)")


def motion_columns(
    joint_names: Sequence[str],
    units: Sequence[str],
    coordinates: Sequence[str],
    rate_units: Sequence[str],
    motors: Sequence[str],
    forces: Sequence[str],
) -> list[str]:
    """Header of the CSV: `t_s`, `gamma_1_rad`, `gamma_1_rad_s`, `gamma_1_rad_s2`, `tau_1_Nm`, ...

    Motor k's torque is `tau_k_Nm` (`tau_k_N` for a force), k counted from 1, and that of a motor
    that is not the coordinate of the same number goes by its name; what has no unit, as
    the entries of a quaternion, ends in `_1`.
    """
    positions = position_columns(joint_names, units)
    rates = rate_columns(coordinates, rate_units)
    torques = [f"tau_{motor}_{unit}" for motor, unit in zip(motors, forces, strict=True)]
    return ["t_s", *positions, *rates, *(f"{rate}2" for rate in rates), *torques]


def position_columns(names: Sequence[str], units: Sequence[str]) -> list[str]:
    """Columns of a CSV for the entries of q."""
    return [f"{name}_{unit or 1}" for name, unit in zip(names, units, strict=True)]


def rate_columns(names: Sequence[str], units: Sequence[str]) -> list[str]:
    """Columns of a CSV for rates; those of accelerations end in 2 besides."""
    return [f"{name}_{unit}_s" for name, unit in zip(names, units, strict=True)]


def is_number(name: str) -> bool:
    """Whether the name of a motor cannot be told from a motor's number."""
    return name.isascii() and name.isdigit()


def rotations_in(table: Table, columns: Sequence[str]) -> Array:
    """Orientations by unit quaternions x, y, z, w in four columns, shape (N, 3, 3)."""
    from scipy.spatial.transform import Rotation

    quaternions = table.select(columns)
    lengths = np.linalg.norm(quaternions, axis=1)
    if (wrong := np.abs(lengths - 1) > _NOT_UNIT).any():
        i = int(np.argmax(wrong))
        problem = f"quaternion of length {lengths[i]:.6g}, expected 1, in {listed(columns)}"
        raise FileFormatError(table.path, problem, table.lines[i])
    return Rotation.from_quat(quaternions).as_matrix()


def parts_of(table: Table) -> dict[str, Any]:
    """What a CSV that `Trajectory.save` has written says, by the arguments of `Trajectory`."""
    rates = [RATE.fullmatch(name) for name in table.columns]
    coordinates, accelerations = (
        [(p[1], p[2]) for p in rates if p and p[3] == power] for power in ("", "2")
    )
    torques = [p for p in map(TORQUE.fullmatch, table.columns) if p]
    positions = [(p[1], p[2] or "") for p in map(_POSITION.fullmatch, table.columns) if p]
    if not coordinates or not positions:
        raise FileFormatError(
            table.path, "not a motion: no columns like gamma_1_rad, gamma_1_rad_s"
        )
    names, units = zip(*positions, strict=True)
    n, m = len(coordinates), len(names)
    rate_names, rate_units = zip(*coordinates, strict=True)
    labels, forces, actuated = [p[1] for p in torques], [p[2] for p in torques], rate_names
    if (labels or coordinates == accelerations) and not any(map(is_number, labels)):
        actuated = tuple(labels)
    else:  # by number: those of the coordinates, in their units
        labels = [str(k + 1) for k in range(n)]
        forces = ["N" if unit == "m" else "Nm" for unit in rate_units]
    values = table.select(motion_columns(names, units, rate_names, rate_units, labels, forces))
    if coordinates != accelerations:
        raise FileFormatError(table.path, "not a motion: accelerations of joints without rates", 1)
    t, q, va, aa, tau = np.split(values, np.cumsum([1, m, n, n]), axis=1)
    numbers = {"t": t[:, 0], "q": q, "va": va, "aa": aa, "tau": tau}
    joints = {"joint_names": names, "units": units, "actuated": actuated, "torque_units": forces}
    return numbers | joints | {"coordinates": rate_names, "rate_units": rate_units}
