# SPDX-License-Identifier: BSD-2-Clause
"""Motions and torques of any closed chain that people write down as CSV."""

from collections.abc import Mapping
from copy import copy
from pathlib import Path
from typing import BinaryIO, TypeGuard

import numpy as np

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import ClosureError, FileFormatError, InputError
from ..files import Table, read_table
from ..loops.starts import placed
from ..model.named_positions import angles_and_lengths
from .coordinate_motions import coordinate_motion
from .motion_columns import columns_in, columns_of
from .moving_robot import require_motion
from .trajectories import Trajectory

#: What the endings of a joint's column mean in SI.
_ENDINGS = {"rad": {"_rad": 1.0, "_deg": np.pi / 180}, "m": {"_m": 1.0, "_mm": 1e-3}}


def read_motion(chain: ClosedChain, source: str | Path | BinaryIO) -> Trajectory:
    """The motor torques of a motion in a CSV, at the times that stand there.

    The columns are `t_s` and, for each coordinate of the robot, `NAME_rad` or `NAME_deg`, or of a
    joint that slides `NAME_m` or `NAME_mm`.
    The other joints follow from the closures, rates come from splines of degree five. Where other
    joints have columns too, their numbers in the first row choose the assembly. A file with the
    positions of all joints and the rates and accelerations of the coordinates, as
    `Trajectory.save` writes it, is taken as it stands. The error names the line at fault.
    """
    return _motion_of(copy(chain), motion_table(chain, source), keep_torques=False)


def load_motion(chain: ClosedChain, source: str | Path | BinaryIO) -> Trajectory:
    """A motion with the torques of its file; without these, with computed torques.

    The file is what `Trajectory.save` has written, or a CSV for `read_motion`; a stream is a CSV.
    """
    chain = copy(chain)
    if _is_npz(source):
        return _saved(chain, source)
    return _motion_of(chain, read_table(source), keep_torques=True)


def motion_table(chain: ClosedChain, source: str | Path | BinaryIO) -> Table:
    """The columns of a motion in a CSV, or in an NPZ that `Trajectory.save` has written."""
    if _is_npz(source):
        return _saved(chain, source)._table(Path(source))
    return read_table(source)


def _is_npz(source: str | Path | BinaryIO) -> TypeGuard[str | Path]:
    return isinstance(source, str | Path) and Path(source).suffix.lower() == ".npz"


def _saved(chain: ClosedChain, source: str | Path) -> Trajectory:
    """A motion of this robot in an NPZ."""
    motion = Trajectory.load(source)
    try:
        require_motion(motion, chain.mechanism)
    except InputError as error:
        raise FileFormatError(source, str(error)) from None
    return motion


def read_log(
    chain: ClosedChain, source: str | Path | BinaryIO
) -> tuple[Array, Array, Array, Array]:
    """Measured positions and torques in a CSV, as `read_motion` and `read_torques` name columns.

    They are times, (N,), positions of the coordinates, (N, n), torques of the motors, (N, motors),
    and the configuration at the start, (nq,).
    """
    table = motion_table(chain, source)
    x, start = _coordinates(chain, table)
    return table.column("t_s"), x, read_torques(chain, table), start


def read_torques(chain: ClosedChain, table: Table) -> Array:
    """The motors' torques in a table, shape (N, motors).

    The columns are `tau_NAME_Nm`, or `tau_NAME_N` of a motor that pushes. If no column has the name
    of a motor, the numbers of the motors, counted from 1, may stand for their names.
    """
    columns, given = columns_of("tau", chain.motor_names, chain.motor_units), set(table.columns)
    numbers = [str(k) for k in range(1, len(columns) + 1)]
    numbered = columns_of("tau", numbers, chain.motor_units)
    if not given & {*columns} and given >= {*numbered}:
        columns = numbered
    others = {torque.column for torque in columns_in(table, "tau")} - {*columns}
    if others:
        raise FileFormatError(
            table.path,
            f"torques of other motors, {', '.join(sorted(others))}; this robot's are "
            f"{', '.join(chain.motor_names) or 'none'}",
            1,
        )
    return table.select(columns)


def read_start(
    chain: ClosedChain,
    table: Table,
    q0: Mapping[str, float] | None = None,
    va0: Mapping[str, float] | None = None,
) -> tuple[Array, Array]:
    """Where a simulation begins: as given by name, else as in the first row of a table.

    The table has positions as `read_motion` takes them, and `NAME_rad_s`, `NAME_m_s` for rates.
    Without `va0` rates are those of the row, or zero where q0 is given and the row has none; rates
    left out of `va0` are zero. Gives a closed configuration, shape (nq,), and rates, shape (n,).
    """
    rate_names, rate_columns = _rates(chain)
    if va0 is not None:
        for name in va0:
            if name not in rate_names:
                raise FileFormatError(
                    table.path, f"no rate of a coordinate {name}; known: {', '.join(rate_names)}"
                )
        va = np.array([va0.get(name, 0.0) for name in rate_names])
    elif set(rate_columns) <= set(table.columns):
        va = table.select(rate_columns)[0]
    elif q0 is not None and not set(rate_columns) & set(table.columns):
        va = np.zeros(len(rate_names))
    else:
        wanted = ",".join(f"{name}=.." for name in rate_names)
        raise FileFormatError(
            table.path,
            f"no columns {', '.join(rate_columns)} for the initial rates; give --va0 {wanted}",
        )
    positions = _position_columns(chain)
    if q0 is None and set(positions) <= set(table.columns):
        return chain.assemble(table.select(positions)[0]), va
    columns = {} if q0 is not None else _joints(chain, table)
    given = q0 if q0 is not None else {name: float(c[0]) for name, c in columns.items()}
    missing = [name for name in chain.coordinates if name not in given]
    if missing:
        wanted = ",".join(f"{name}=.." for name in chain.coordinates)
        raise FileFormatError(
            table.path, f"no {', '.join(missing)} for the initial positions; give --q0 {wanted}"
        )
    return placed(chain, given), va


def _motion_of(chain: ClosedChain, table: Table, *, keep_torques: bool) -> Trajectory:
    t = table.column("t_s")
    _, rates = _rates(chain)
    positions, accelerations = _position_columns(chain), [f"{name}2" for name in rates]
    given = keep_torques and columns_in(table, "tau")
    tau = read_torques(chain, table) if given else None
    if {*positions, *rates, *accelerations} <= set(table.columns):
        q, va, aa = (table.select(columns) for columns in (positions, rates, accelerations))
        return chain.trajectory(t, q, va, aa, tau)
    if (other := chain._motion_in(table)) is not None:
        return chain.trajectory(t, *other, tau)
    x, start = _coordinates(chain, table)
    try:
        motion = coordinate_motion(chain, t, x, start)
    except ClosureError as error:
        line = table.lines[error.samples[0][0]] if error.samples else table.lines[0]
        raise FileFormatError(table.path, str(error), line) from None
    if tau is None:
        return motion
    return chain.trajectory(motion.t, motion.q, motion.va, motion.aa, tau)


def _coordinates(chain: ClosedChain, table: Table) -> tuple[Array, Array]:
    """Positions of the coordinates, shape (N, n), and the configuration at the start."""
    chain.mechanism.require_freedom()
    found = _joints(chain, table)
    missing = [name for name in chain.coordinates if name not in found]
    if missing:
        raise FileFormatError(
            table.path, f"no column of {', '.join(missing)}; {_wanted(chain, table)}", 1
        )
    if len(table.lines) < 3:
        raise FileFormatError(table.path, f"{len(table.lines)} rows; rates need at least three")
    x = np.column_stack([found[name] for name in chain.coordinates])
    return x, placed(chain, {name: float(c[0]) for name, c in found.items()})


def _wanted(chain: ClosedChain, table: Table) -> str:
    """What a motion needs, and what there is."""
    known = angles_and_lengths(chain.mechanism.space)
    there = f"found: {', '.join(table.columns)}"
    if not set(chain.coordinates) <= known.keys():
        columns = ", ".join(["t_s", *_position_columns(chain), *_rates(chain)[1]])
        return f"a motion of this robot has the columns {columns} and accelerations; {there}"
    columns = ", ".join(["t_s", *(f"{name}_{known[name]}" for name in chain.coordinates)])
    return f"a motion has the columns {columns} (or _deg, _mm); {there}"


def _position_columns(chain: ClosedChain) -> list[str]:
    return columns_of("q", chain.position_names, chain.joint_units)


def _rates(chain: ClosedChain) -> tuple[list[str], list[str]]:
    """Names of the coordinates' rates, and their columns."""
    names, units = chain.mechanism.coordinate_rate_names, chain.mechanism.coordinate_rate_units
    return list(names), columns_of("va", names, units)


def _joints(chain: ClosedChain, table: Table) -> dict[str, Array]:
    """Positions of the joints that have a column, in SI."""
    joints, given = dict[str, Array](), set(table.columns)
    for name, unit in angles_and_lengths(chain.mechanism.space).items():
        columns = [column for end in _ENDINGS[unit] if (column := f"{name}{end}") in given]
        if len(columns) > 1:
            listed = ", ".join(columns)
            raise FileFormatError(table.path, f"one joint has several columns: {listed}", 1)
        for column in columns:
            factor = _ENDINGS[unit][column.removeprefix(name)]
            joints[name] = factor * table.column(column)
        other, moves = ("m", "turns") if unit == "rad" else ("rad", "slides")
        if wrong := sorted(given & {f"{name}{end}" for end in _ENDINGS[other]}):
            text = f"{', '.join(wrong)}: the joint {name} {moves}, in {unit}"
            raise FileFormatError(table.path, text, 1)
    return joints
