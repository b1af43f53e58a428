# SPDX-License-Identifier: BSD-2-Clause
"""`Trajectory`: a motion of a robot with its torques, and its files.

`trajectory_of` makes one with the names and units of a robot, and `require_motion` checks that one
belongs to a robot.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, names, require_instance, single_array
from ..errors import FileFormatError, InputError, MissingExtraError, OutputError
from ..files import Table, Writer, as_path, read_table, require_ending, table_writer, write_files
from ..former_names import FormerName, former_arguments
from ..model.mechanism import Mechanism
from ..summaries import Summary, listed
from .crossings import Crossing
from .motion_columns import columns_of, parts_of, printed_units
from .samples import rows_of_samples, sample_times, spline, times_within

if TYPE_CHECKING:
    import pandas as pd


#: Fields with a row for each sample.
_ARRAYS = ("t", "q", "va", "aa", "tau")
#: Fields with names and units of the columns of these arrays.
_COLUMNS = ("joint_names", "motor_names", "units", "coordinates", "rate_units", "torque_units")
#: Fields that two motions are compared by. Every file contains them.
_COMPARED = (*_ARRAYS, *_COLUMNS)


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Summary):
    """A motion of a robot with its motor torques.

    `len(motion)` is the number of samples. `motion[10:20]`, `motion[::5]` and
    `motion[motion.t < 1]` are trajectories of some of the samples.

    Attributes:
        t: Times, increasing, shape (N,), [s].
        q: Configurations, shape (N, nq), [rad] or [m].
        va: Rates of the coordinates, shape (N, n).
        aa: Accelerations of the coordinates, shape (N, n).
        tau: Motor torques, shape (N, motors), [N m] or [N].
        joint_names: Names of the entries of q; names of joints if each has one entry.
        motor_names: Names of the motors.
        units: "rad" or "m" for each entry of q; "" for entries of quaternions, cosines and sines.
        coordinates: Names of the rates of the coordinates; the motors by default.
        rate_units: "rad" or "m" for each rate.
        torque_units: "Nm" or "N" for each motor; by default "N" for a motor with the name of a
            prismatic joint or of a coordinate in [m].
        stopped: Why a simulation ended before its last time; empty if it did not. It is ignored
            in comparisons and not saved in a CSV.
        crossings: Singular configurations that a simulation went through, each with `time`, `q`,
            `rank_before` and `rank`. They are ignored in comparisons and not saved.

    Example:
        >>> motion = chain.simulate([0], chain.home, [0], [0, 0.05, 0.1])
        >>> len(motion), motion.joint_names, motion.tau.shape
        (3, ('crank', 'coupler', 'rocker'), (3, 1))
    """

    t: Array
    q: Array
    va: Array
    aa: Array
    tau: Array
    joint_names: tuple[str, ...]
    motor_names: tuple[str, ...]
    units: tuple[str, ...]
    stopped: str
    crossings: tuple[Crossing, ...]
    coordinates: tuple[str, ...]
    rate_units: tuple[str, ...]
    torque_units: tuple[str, ...]

    actuated = FormerName("motor_names")

    @former_arguments(actuated="motor_names")
    def __init__(
        self,
        t: ArrayLike,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        tau: ArrayLike,
        joint_names: Sequence[str],
        motor_names: Sequence[str],
        units: Sequence[str] | None = None,
        stopped: str = "",
        *,
        coordinates: Sequence[str] | None = None,
        rate_units: Sequence[str] | None = None,
        torque_units: Sequence[str] | None = None,
        crossings: Sequence[Crossing] = (),
    ) -> None:
        times = sample_times(t)
        joint_names = _names("joint_names", joint_names)
        motor_names = _names("motor_names", motor_names)
        coordinates = motor_names if coordinates is None else _names("coordinates", coordinates)
        units = _units("units", units or ("rad",) * len(joint_names), joint_names, ("rad", "m", ""))
        # By default, a rate has the unit of the joint with its name, or "rad" if there is none.
        unit_of_joint = dict(zip(joint_names, units, strict=True))
        if rate_units is None:
            rate_units = [unit_of_joint.get(name) or "rad" for name in coordinates]
        rate_units = _units("rate_units", rate_units, coordinates, ("rad", "m"))
        # By default, a motor with the name of a length has a force, and any other motor a torque.
        if torque_units is None:
            unit_of_rate = dict(zip(coordinates, rate_units, strict=True))
            unit_of = unit_of_joint | unit_of_rate
            torque_units = ["N" if unit_of.get(name) == "m" else "Nm" for name in motor_names]
        torque_units = _units("torque_units", torque_units, motor_names, ("Nm", "N"))
        if not isinstance(stopped, str):
            raise InputError("stopped", f"{stopped!r} is not a text")
        in_order = isinstance(crossings, (list, tuple))
        if not in_order or not all(isinstance(crossing, Crossing) for crossing in crossings):
            raise InputError("crossings", f"{crossings!r} are no crossings of a simulation")
        fields = {
            "t": times,
            "q": _samples("q", q, times, joint_names),
            "va": _samples("va", va, times, coordinates),
            "aa": _samples("aa", aa, times, coordinates),
            "tau": _samples("tau", tau, times, motor_names),
            "joint_names": joint_names,
            "motor_names": motor_names,
            "units": units,
            "stopped": stopped,
            "crossings": tuple(crossings),
            "coordinates": coordinates,
            "rate_units": rate_units,
            "torque_units": torque_units,
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)  # the class is frozen

    def __len__(self) -> int:
        return len(self.t)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Trajectory) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in _COMPARED
        )

    __hash__ = None  # type: ignore[assignment]

    def __getitem__(self, samples: slice | Sequence[int] | NDArray[Any]) -> Trajectory:
        """The samples of a slice, of increasing indices, or of a mask."""
        try:
            chosen = np.arange(len(self))[samples]
        except (IndexError, TypeError, ValueError) as error:
            raise InputError("samples", f"{samples!r}: {error}") from None
        if chosen.ndim != 1:
            problem = f"{samples!r} is not a slice, indices or a mask"
            if chosen.ndim == 0:  # one index
                problem += f"; use motion[{samples}:{chosen + 1}]"
            raise InputError("samples", problem)
        if not len(chosen):
            raise InputError("samples", f"{samples!r} selects none of {len(self)} samples")
        if (np.diff(chosen) <= 0).any():
            raise InputError("samples", f"{samples!r} is not in the order of time")
        first, last = self.t[chosen[[0, -1]]]
        arrays = {name: getattr(self, name)[chosen] for name in _ARRAYS}
        crossings = tuple(crossing for crossing in self.crossings if first <= crossing.time <= last)
        stopped = self.stopped if chosen[-1] == len(self) - 1 else ""
        return replace(self, **arrays, crossings=crossings, stopped=stopped)

    def between(self, start: float, end: float) -> Trajectory:
        """The samples from a time to another, both included, [s].

        Raises:
            InputError: If there is no sample between these times.
        """
        first = float(single_array("time", start, ()))
        last = float(single_array("time", end, ()))
        chosen = (self.t >= first) & (self.t <= last)
        if not chosen.any():
            sampled = f"sampled from {self.t[0]:g} to {self.t[-1]:g} s"
            raise InputError("start, end", f"no sample from {first:g} to {last:g} s; {sampled}")
        return self[chosen]

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table with a row for each sample, indexed by `t_s`, and the columns of the CSV.

        Raises:
            MissingExtraError: Without pandas, `sst-pin[pandas]`.
        """
        try:
            import pandas as pd
        except ImportError:
            raise MissingExtraError("pandas", "pandas") from None
        time, *columns = self._columns()
        values = np.column_stack([self.q, self.va, self.aa, self.tau])
        return pd.DataFrame(values, pd.Index(self.t, name=time), columns)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """Title and rows of the printed motion."""
        count = len(self)
        peaks = np.abs(self.tau).max(axis=0)
        largest = zip(self.motor_names, peaks, printed_units(self.torque_units), strict=True)
        forces = [f"{name} {peak:.4g} {unit}" for name, peak, unit in largest]
        rows = [
            ("t", f"{self.t[0]:g} to {self.t[-1]:g} s"),
            ("q", f"{self.q.shape}: {listed(self.joint_names)}"),
            ("va, aa", f"{self.va.shape}: {listed(self.coordinates)}"),
            ("tau", f"{self.tau.shape}, largest: {listed(forces)}"),
        ]
        if self.stopped:
            rows.append(("stopped", self.stopped))
        title = "Trajectory of 1 sample" if count == 1 else f"Trajectory of {count} samples"
        return title, rows

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write the motion to a file; `load` reads it without loss of digits.

        Args:
            path: A file name that ends in .csv or .npz.
            force: Whether an existing file may be replaced.

        Raises:
            OutputError: If the file cannot be written, or exists.

        Example:
            >>> motion = chain.simulate([0], chain.home, [0], [0, 0.05, 0.1])
            >>> motion.save("motion.csv", force=True)
            >>> sst_pin.Trajectory.load("motion.csv") == motion
            True
        """
        write_files({as_path(path): self.writer(path)}, force)

    def writer(self, path: str | Path) -> Writer:
        """A function that writes the motion to a stream, in the format of the path's ending.

        Raises:
            OutputError: If the ending is not .csv or .npz, or a CSV cannot contain a name.
        """
        if require_ending(path, ".csv", ".npz") == ".csv":
            columns = self._columns()
            if any(re.search(r"^\s|[,\"\r\n]", name) for name in columns):
                text = "a name starts with a space, or contains a comma, quote or line break"
                raise OutputError(path, f"{text}; save the motion as .npz")
            return table_writer(columns, self.table(as_path(path)).values)
        fields = (*_COMPARED, "stopped")
        arrays: dict[str, Any] = {name: np.asarray(getattr(self, name)) for name in fields}
        return lambda file: np.savez(file, **arrays)

    def table(self, path: Path) -> Table:
        """The columns of the motion's CSV; errors name `path`."""
        values = np.column_stack([self.t, self.q, self.va, self.aa, self.tau])
        line_numbers = tuple(range(1, len(self.t) + 1))  # errors name the samples, from 1
        return Table(path, tuple(self._columns()), values, line_numbers)

    @classmethod
    def load(cls, path: str | Path) -> Trajectory:
        """Read a motion that `save` has written, from a .csv or .npz.

        Raises:
            FileFormatError: If the file has another format; the message names the wrong line.
        """
        path = as_path(path)
        if path.suffix.lower() != ".npz":
            return cls(**parts_of(read_table(path)))
        fields = _read_npz(path)
        arrays = {name: fields[name] for name in _ARRAYS}
        texts = {name: fields[name].tolist() for name in fields if name not in _ARRAYS}
        try:
            return cls(**arrays, **texts)
        except InputError as error:
            raise FileFormatError(path, f"not a motion: {error}") from None

    def _columns(self) -> list[str]:
        """Names of the columns of t, q, va, aa and tau, in this order."""
        return [
            "t_s",
            *columns_of("q", self.joint_names, self.units),
            *columns_of("va", self.coordinates, self.rate_units),
            *columns_of("aa", self.coordinates, self.rate_units),
            *columns_of("tau", self.motor_names, self.torque_units),
        ]

    def torque(self) -> Callable[[float], Array]:
        """The torques as a smooth function of time, a spline of degree five through the samples.

        Times outside the motion by more than its longest time step raise an `InputError`.
        `simulate` also takes the motion itself.

        Example:
            >>> t = np.linspace(0, 0.1, 21)
            >>> motion = robot.trajectory(t, *robot.joint_motion(*sst_pin.paper_circle(t)))
            >>> motion.torque()(0.05).round(3)
            array([ -4.703,  18.389, -11.313])
        """
        smooth = spline(self.t, self.tau)
        times = self.t
        # Integrators ask for times a little beyond the motion.
        longest_step = float(np.diff(times).max(initial=0.0))
        return lambda t: np.asarray(smooth(times_within("t", t, times, longest_step)))


def trajectory_of(
    mechanism: Mechanism,
    t: ArrayLike,
    q: ArrayLike,
    va: ArrayLike,
    aa: ArrayLike,
    tau: ArrayLike,
    stopped: str = "",
    crossings: Sequence[Crossing] = (),
) -> Trajectory:
    """A motion with the names and units of a mechanism."""
    space = mechanism.space
    return Trajectory(
        t,
        q,
        va,
        aa,
        tau,
        space.position_names,
        mechanism.motor_names,
        space.position_units,
        stopped,
        coordinates=mechanism.coordinate_rate_names,
        rate_units=mechanism.coordinate_rate_units,
        torque_units=mechanism.motor_units,
        crossings=crossings,
    )


def require_motion(motion: Trajectory, mechanism: Mechanism, name: str = "motion") -> None:
    """Check that an argument is a motion of a robot: its joints, coordinates, motors, units."""
    require_instance(name, motion, Trajectory)
    requirements = (
        ("joints", motion.joint_names, mechanism.space.position_names),
        ("coordinates", motion.coordinates, mechanism.coordinate_rate_names),
        ("motors", motion.motor_names, mechanism.motor_names),
        ("units of positions", motion.units, mechanism.space.position_units),
        ("units of rates", motion.rate_units, mechanism.coordinate_rate_units),
    )
    for what, in_motion, in_robot in requirements:
        if in_motion == tuple(in_robot):
            continue
        theirs = _in_one_line(in_motion)
        ours = _in_one_line(in_robot) or "none"
        problem = f"belongs to another robot, with {what} {theirs}; this one has {ours}"
        if what == "coordinates":
            problem += "; chain.with_coordinates([...]) gives it others"
        raise InputError(name, problem)


def _in_one_line(words: Sequence[str]) -> str:
    """Names or units in one line; the empty unit "" of a plain number is written as 1."""
    return ", ".join(word or "1" for word in words)


def _samples(name: str, value: ArrayLike, times: Array, columns: Sequence[str]) -> Array:
    """A read-only copy of an argument with a row for each time."""
    array = rows_of_samples(name, value, (len(times), len(columns))).copy()
    array.setflags(write=False)
    return array


def _names(name: str, value: Sequence[str]) -> tuple[str, ...]:
    """Names as a tuple; repeated names are refused."""
    words = names(name, value)
    if len(set(words)) < len(words):
        raise InputError(name, f"a name appears twice in {', '.join(words)}")
    return words


def _units(
    name: str, value: Sequence[str], columns: Sequence[str], known: Sequence[str]
) -> tuple[str, ...]:
    """Units as a tuple: one for each column, and each of them one of the known units."""
    units = names(name, value)
    if len(units) != len(columns) or not set(units) <= set(known):
        raise InputError(name, f"{units}, expected {len(columns)} of {', '.join(map(repr, known))}")
    return units


def _read_npz(path: Path) -> dict[str, Any]:
    """The fields of a motion in an NPZ, as arrays."""
    try:
        # NumPy leaves a file open that it cannot read.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            fields = dict[str, Any]()
            for name in (*_COMPARED, "stopped"):
                # Early files of versions before 0.3 have no torque_units; the default is taken.
                if name == "torque_units" and name not in file:
                    continue
                # Versions before 0.3 wrote motor_names by another name.
                key = "actuated" if name == "motor_names" and name not in file else name
                fields[name] = file[key]
            return fields
    except Exception as error:  # zipfile and NumPy raise many kinds of errors
        raise FileFormatError(path, f"not a motion: {error}") from None
