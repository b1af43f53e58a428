# SPDX-License-Identifier: BSD-2-Clause
"""Motions and torques of any closed chain in CSV files, and motions in NPZ files.

- `read_motion` reads a motion and computes its torques; `load_motion` takes those of the file.
- `read_log` reads a measured motion with measured torques.
- `read_start` reads the first state of a simulation, and `read_torques` its torques.

A column has the name of a joint or a rate with a unit, such as `crank_rad` (`motion_columns`).
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeGuard

import numpy as np

from ..arrays import Array
from ..engine import Engine
from ..errors import ClosureError, FileFormatError, InputError
from ..files import Table, read_table
from ..loops.start import assemble, placed
from ..model.mechanism import Mechanism
from ..model.named_positions import units_by_joint
from .coordinate_motions import coordinate_trajectory
from .motion_columns import columns_in, columns_of
from .trajectories import Trajectory, require_motion, trajectory_of

#: Computes q, va and aa from a table whose columns are not joints; None for other tables.
TableReader = Callable[[Table], tuple[Array, Array, Array] | None]
#: Factors to SI units by the ending of a joint's column, for joints that turn and that slide.
_ENDINGS = {"rad": {"_rad": 1.0, "_deg": np.pi / 180}, "m": {"_m": 1.0, "_mm": 1e-3}}


def read_motion(
    engine: Engine, source: str | Path | BinaryIO, reader: TableReader | None = None
) -> Trajectory:
    """The motion in a CSV, or in an NPZ of `Trajectory.save`, with computed motor torques.

    The columns are `t_s` and, for each coordinate, `NAME_rad` or `NAME_deg`, or of a sliding joint
    `NAME_m` or `NAME_mm`. The other joints follow from the closures, and rates from splines of
    degree five. If other joints have columns too, their first row selects the assembly mode.
    Joints with brakes need a column: they stay at the position in its first row. A file of
    `Trajectory.save`, with all joints, rates and accelerations, is used as it is. `reader` reads
    tables with other columns. Errors name the line.
    """
    return _motion_of(engine, motion_table(engine.mechanism, source), reader)


def load_motion(
    engine: Engine, source: str | Path | BinaryIO, reader: TableReader | None = None
) -> Trajectory:
    """A motion with the torques of its file, or with computed torques if the file has none.

    The file is one of `Trajectory.save`, or a CSV for `read_motion`; a stream is a CSV.
    """
    if _is_npz(source):
        return _saved_motion(engine.mechanism, source)
    table = read_table(source)
    tau = read_torques(engine.mechanism, table) if columns_in(table, "tau") else None
    return _motion_of(engine, table, reader, tau)


def motion_table(mechanism: Mechanism, source: str | Path | BinaryIO) -> Table:
    """The columns of a motion in a CSV, or in an NPZ that `Trajectory.save` has written."""
    if _is_npz(source):
        return _saved_motion(mechanism, source).table(Path(source))
    return read_table(source)


class Log(NamedTuple):
    """A measured motion.

    Attributes:
        t: Times, shape (N,), [s].
        x: Positions of the coordinates, shape (N, n).
        tau: Motor torques, shape (N, motors).
        start: The first configuration, shape (nq,).
    """

    t: Array
    x: Array
    tau: Array
    start: Array


def read_log(engine: Engine, source: str | Path | BinaryIO) -> Log:
    """The measured motion in a CSV, with columns as for `read_motion` and `read_torques`."""
    table = motion_table(engine.mechanism, source)
    x, start = _coordinates_and_start(engine, table)
    return Log(table.column("t_s"), x, read_torques(engine.mechanism, table), start)


def read_torques(mechanism: Mechanism, table: Table) -> Array:
    """The motor torques in a table, shape (N, motors).

    The columns are `tau_NAME_Nm`, or `tau_NAME_N` for a linear motor. If no column has the name of
    a motor, the numbers of the motors, counted from 1, may replace their names.
    """
    motors = mechanism.motor_names
    units = mechanism.motor_units
    columns = columns_of("tau", motors, units)
    numbered = columns_of("tau", [str(k) for k in range(1, len(motors) + 1)], units)
    present = set(table.columns)
    if present.isdisjoint(columns) and present.issuperset(numbered):
        columns = numbered
    others = {torque.column for torque in columns_in(table, "tau")} - set(columns)
    if others:
        raise FileFormatError(
            table.path,
            f"torques of other motors, {', '.join(sorted(others))}; this robot's are "
            f"{', '.join(motors) or 'none'}",
            1,
        )
    return table.select(columns)


def read_start(
    engine: Engine,
    table: Table,
    q0: Mapping[str, float] | None = None,
    va0: Mapping[str, float] | None = None,
) -> tuple[Array, Array]:
    """Initial q, shape (nq,), and va, shape (n,), by name, or from the first row of a table.

    Args:
        engine: The robot.
        table: Positions as for `read_motion`, and rates `NAME_rad_s` or `NAME_m_s`.
        q0: Positions of joints by name, [rad] or [m]: of the coordinates and of joints with brakes.
            By default they are those of the row.
        va0: Rates of the coordinates by name; those that it leaves out are zero. By default they
            are those of the row, or zero if q0 is given and the row has no rates.
    """
    va = _start_rates(engine.mechanism, table, q0, va0)
    columns = _position_columns(engine.mechanism)
    if q0 is None and set(columns) <= set(table.columns):
        return assemble(engine, table.select(columns)[0]), va
    if q0 is None:
        joints = _joint_positions(engine.mechanism, table)
        q0 = {name: float(positions[0]) for name, positions in joints.items()}
    names = [*engine.mechanism.coordinate_names, *_joints_with_brakes(engine.mechanism)]
    names = list(dict.fromkeys(names))  # each once: for a braked line, coordinates are in both
    missing = [name for name in names if name not in q0]
    if missing:
        cure = f"give --q0 {_example_of_option(names)}"
        problem = f"no {', '.join(missing)} for the initial positions; {cure}"
        raise FileFormatError(table.path, problem)
    return placed(engine, q0), va


def _start_rates(
    mechanism: Mechanism,
    table: Table,
    q0: Mapping[str, float] | None,
    va0: Mapping[str, float] | None,
) -> Array:
    """Initial rates of the coordinates, shape (n,); `read_start` says where they come from."""
    names = mechanism.coordinate_rate_names
    columns = _rate_columns(mechanism)
    if va0 is not None:
        for name in va0:
            if name not in names:
                problem = f"no rate of a coordinate {name}; known: {', '.join(names)}"
                raise FileFormatError(table.path, problem)
        return np.array([va0.get(name, 0.0) for name in names])
    if set(columns) <= set(table.columns):
        return np.asarray(table.select(columns)[0])
    if q0 is not None and not set(columns) & set(table.columns):
        return np.zeros(len(names))
    cure = f"give --va0 {_example_of_option(names)}"
    missing = [column for column in columns if column not in table.columns]
    problem = f"no columns {', '.join(missing)} for the initial rates; {cure}"
    raise FileFormatError(table.path, problem)


def _example_of_option(names: Sequence[str]) -> str:
    """What to write after an option of the shell: `crank=..,rocker=..`."""
    return ",".join(f"{name}=.." for name in names)


def _is_npz(source: str | Path | BinaryIO) -> TypeGuard[str | Path]:
    return isinstance(source, str | Path) and Path(source).suffix.lower() == ".npz"


def _saved_motion(mechanism: Mechanism, source: str | Path) -> Trajectory:
    """A motion of this robot in an NPZ."""
    motion = Trajectory.load(source)
    try:
        require_motion(motion, mechanism)
    except InputError as error:
        raise FileFormatError(source, str(error)) from None
    return motion


def _motion_of(
    engine: Engine, table: Table, reader: TableReader | None, tau: Array | None = None
) -> Trajectory:
    """The motion in a table.

    Args:
        engine: The robot.
        table: The table.
        reader: Reads tables whose columns are not joints, or None.
        tau: Motor torques, shape (N, motors); they are computed if it is None.
    """
    mechanism = engine.mechanism
    t = table.column("t_s")
    joint_motion = _saved_columns(mechanism, table)
    if joint_motion is None and reader is not None:
        joint_motion = reader(table)
    if joint_motion is not None:
        q, va, aa = joint_motion
        if tau is None:
            tau = engine.torques(q, va, aa)
        return trajectory_of(mechanism, t, q, va, aa, tau)
    x, start = _coordinates_and_start(engine, table)
    try:
        motion = coordinate_trajectory(engine, t, x, start)
    except ClosureError as error:
        row = error.samples[0][0] if error.samples else 0  # the sample that cannot be closed
        raise FileFormatError(table.path, str(error), table.lines[row]) from None
    if tau is None:
        return motion
    return trajectory_of(mechanism, t, motion.q, motion.va, motion.aa, tau)


def _saved_columns(mechanism: Mechanism, table: Table) -> tuple[Array, Array, Array] | None:
    """q, va and aa in a table that `Trajectory.save` has written; None if columns are missing."""
    positions = _position_columns(mechanism)
    rates = _rate_columns(mechanism)
    accelerations = [f"{name}2" for name in rates]  # crank_rad_s2 for crank_rad_s
    if not {*positions, *rates, *accelerations} <= set(table.columns):
        return None
    return table.select(positions), table.select(rates), table.select(accelerations)


def _coordinates_and_start(engine: Engine, table: Table) -> tuple[Array, Array]:
    """Positions x of the coordinates in a table, shape (N, n), and the first configuration, (nq,).

    If other joints have columns too, their first row selects the assembly mode. Joints with brakes
    stay at the positions in this row.
    """
    mechanism = engine.mechanism
    mechanism.require_freedom()
    joints = _joint_positions(mechanism, table)
    names = mechanism.coordinate_names
    missing = [name for name in names if name not in joints]
    if missing:
        problem = f"no column of {', '.join(missing)}; {_needed_columns(mechanism, table)}"
        raise FileFormatError(table.path, problem, 1)
    missing = [name for name in _joints_with_brakes(mechanism) if name not in joints]
    if missing:
        units = units_by_joint(mechanism.space)
        columns = ", ".join(f"{name}_{units[name]}" for name in missing)
        problem = f"no columns {columns} (or _deg, _mm), which say where brakes hold"
        raise FileFormatError(table.path, f"{problem}; found: {', '.join(table.columns)}", 1)
    if len(table.lines) < 3:
        raise FileFormatError(table.path, f"{len(table.lines)} rows; rates need at least three")
    x = np.column_stack([joints[name] for name in names])
    first = {name: float(positions[0]) for name, positions in joints.items()}
    return x, placed(engine, first)


def _joints_with_brakes(mechanism: Mechanism) -> list[str]:
    """The joints whose positions say where brakes hold.

    The length of a braked line, or an angle of a braked ball, has no column: it follows from the
    positions of all joints.
    """
    joints = list(units_by_joint(mechanism.space))
    braked = [brake.name for brake in mechanism.brakes]
    return braked if set(braked) <= set(joints) else joints


def _joint_positions(mechanism: Mechanism, table: Table) -> dict[str, Array]:
    """Positions of the joints that have a column, [rad] or [m], by name, each of shape (N,)."""
    joints = dict[str, Array]()
    columns = set(table.columns)
    for name, unit in units_by_joint(mechanism.space).items():
        if unit == "rad":
            moves = "turns"
            wrong_endings = _ENDINGS["m"]
        else:
            moves = "slides"
            wrong_endings = _ENDINGS["rad"]
        wrong = sorted(columns & {f"{name}{ending}" for ending in wrong_endings})
        if wrong:
            text = f"{', '.join(wrong)}: the joint {name} {moves}, in {unit}"
            raise FileFormatError(table.path, text, 1)
        factors = {f"{name}{ending}": factor for ending, factor in _ENDINGS[unit].items()}
        several = [column for column in factors if column in columns]
        if len(several) > 1:
            text = f"one joint has several columns: {', '.join(several)}"
            raise FileFormatError(table.path, text, 1)
        if several:
            joints[name] = factors[several[0]] * table.column(several[0])
    return joints


def _needed_columns(mechanism: Mechanism, table: Table) -> str:
    """The columns that a motion needs, and those of the table, for messages."""
    units = units_by_joint(mechanism.space)
    names = mechanism.coordinate_names
    columns = f"this file has {', '.join(table.columns)}"
    if not set(names) <= units.keys():
        # Some coordinates, such as rates of a ball joint, have no position of their own.
        needed = ", ".join(["t_s", *_position_columns(mechanism), *_rate_columns(mechanism)])
        return f"a motion of this robot has the columns {needed} and accelerations; {columns}"
    needed = ", ".join(["t_s", *(f"{name}_{units[name]}" for name in names)])
    return f"a motion has the columns {needed} (or _deg, _mm); {columns}"


def _position_columns(mechanism: Mechanism) -> list[str]:
    """Names of the columns of q, as `Trajectory.save` writes them."""
    return columns_of("q", mechanism.space.position_names, mechanism.space.position_units)


def _rate_columns(mechanism: Mechanism) -> list[str]:
    """Names of the columns of va."""
    return columns_of("va", mechanism.coordinate_rate_names, mechanism.coordinate_rate_units)
