# SPDX-License-Identifier: BSD-2-Clause
"""`Trajectory`: a motion of the robot as a value, and its files."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, make_interp_spline

from ..arrays import finite_array
from ..errors import FileFormatError, InputError, OutputError
from ..files import Writer, read_table, table_writer, write_files

Array = NDArray[np.float64]

#: What makes two motions the same, and what a file holds.
_COMPARED = ("t", "q", "va", "aa", "tau", "joint_names", "actuated", "units")


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion of the robot with the motor torques that go with it.

    Attributes:
        t: Times, increasing, shape (N,), [s].
        q: Joint coordinates, shape (N, m), [rad] or [m].
        va: Rates of the actuated joints, shape (N, n).
        aa: Accelerations of the actuated joints, shape (N, n).
        tau: Motor torques, shape (N, n), [N m] or [N].
        joint_names: Names of the m joints.
        actuated: Names of the n actuated joints.
        units: "rad" or "m" for each joint.
        stopped: Why a simulation ended before its last time; empty when it did not. A remark:
            it does not take part in comparisons and is not kept in a CSV.
    """

    t: Array
    q: Array
    va: Array
    aa: Array
    tau: Array
    joint_names: tuple[str, ...]
    actuated: tuple[str, ...]
    units: tuple[str, ...]
    stopped: str

    def __init__(
        self,
        t: ArrayLike,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        tau: ArrayLike,
        joint_names: Sequence[str],
        actuated: Sequence[str],
        units: Sequence[str] | None = None,
        stopped: str = "",
    ) -> None:
        times = sample_times(t)
        arrays = {"q": (q, len(joint_names))} | {
            name: (value, len(actuated)) for name, value in (("va", va), ("aa", aa), ("tau", tau))
        }
        for name, (value, columns) in arrays.items():
            array = finite_array(name, value, (columns,)).copy()
            if array.shape != (len(times), columns):
                raise InputError(name, f"shape {array.shape}, expected {(len(times), columns)}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "t", times)
        object.__setattr__(self, "joint_names", tuple(joint_names))
        object.__setattr__(self, "actuated", tuple(actuated))
        units = ("rad",) * len(joint_names) if units is None else tuple(units)
        object.__setattr__(self, "units", units)
        object.__setattr__(self, "stopped", stopped)

    def __len__(self) -> int:
        return len(self.t)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Trajectory) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in _COMPARED
        )

    __hash__ = None  # type: ignore[assignment]

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write the motion to a file from which it comes back to the last bit.

        Args:
            path: Ends in .csv or .npz.
            force: Whether a file that is there may be replaced.

        Raises:
            OutputError: When it cannot be written, or exists.
        """
        write_files({Path(path): self.writer(path)}, force)

    def writer(self, path: str | Path) -> Writer:
        """What writes the motion in the format the path's ending asks for.

        Raises:
            OutputError: For another ending than .csv or .npz.
        """
        kind = Path(path).suffix.lower()
        if kind == ".csv":
            values = np.column_stack([self.t, self.q, self.va, self.aa, self.tau])
            return table_writer(_columns(self.joint_names, self.actuated, self.units), values)
        if kind == ".npz":
            arrays: dict[str, Any] = {
                name: np.asarray(getattr(self, name)) for name in (*_COMPARED, "stopped")
            }
            return lambda file: np.savez(file, **arrays)
        raise OutputError(path, f"ending {kind!r} unknown; known: .csv, .npz")

    @classmethod
    def load(cls, path: str | Path) -> Trajectory:
        """Read a motion that `save` has written.

        Args:
            path: Ends in .csv or .npz.

        Raises:
            FileFormatError: When it is not such a file, with the line at fault.
        """
        path = Path(path)
        return cls._load_npz(path) if path.suffix.lower() == ".npz" else cls._load_csv(path)

    @classmethod
    def _load_npz(cls, path: Path) -> Trajectory:
        try:
            with np.load(path, allow_pickle=False) as file:
                content = {name: file[name] for name in (*_COMPARED, "stopped")}
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            raise FileFormatError(path, f"not a motion: {error}") from None
        words = {
            key: tuple(map(str, content.pop(key))) for key in ("joint_names", "actuated", "units")
        }
        stopped = str(content.pop("stopped"))
        return cls(**content, **words, stopped=stopped)

    @classmethod
    def _load_csv(cls, path: Path) -> Trajectory:
        table = read_table(path)
        parts = [re.fullmatch(r"(.+?)_(rad|m)(_s2|_s)?", name) for name in table.columns]
        joints = [(p[1], p[2]) for p in parts if p and not p[3]]
        actuated = [p[1] for p in parts if p and p[3] == "_s"]
        if not joints or not actuated:
            raise FileFormatError(path, "not a motion: no columns like gamma_1_rad, gamma_1_rad_s")
        names, units = zip(*joints, strict=True)
        n, m = len(actuated), len(names)
        values = table.select(_columns(names, actuated, units))
        t, q, va, aa, tau = np.split(values, [1, 1 + m, 1 + m + n, 1 + m + 2 * n], axis=1)
        return cls(t[:, 0], q, va, aa, tau, names, actuated, units)

    def torque(self) -> Callable[[float], Array]:
        """The torques as a smooth function of time, for `simulate`.

        Returns:
            A spline of degree five through the samples (lower for fewer than six of them).
        """
        smooth = spline(self.t, self.tau)
        return lambda t: np.asarray(smooth(t))


def _columns(
    joint_names: Sequence[str], actuated: Sequence[str], units: Sequence[str]
) -> list[str]:
    """Header of the CSV: `t_s`, `gamma_1_rad`, `gamma_1_rad_s`, `gamma_1_rad_s2`, `tau_1_Nm`, ...

    Motor k's torque is `tau_k_Nm` (`tau_k_N` for a prismatic one), k counted from 1.
    """
    unit = dict(zip(joint_names, units, strict=True))
    rates = [f"{name}_{unit[name]}_s" for name in actuated]
    torques = [
        f"tau_{k}_{'Nm' if unit[name] == 'rad' else 'N'}" for k, name in enumerate(actuated, 1)
    ]
    positions = [f"{name}_{unit[name]}" for name in joint_names]
    return ["t_s", *positions, *rates, *(f"{rate}2" for rate in rates), *torques]


def sample_times(t: ArrayLike, least: int = 1) -> Array:
    """Times as a read-only array.

    Raises:
        InputError: When they are not increasing, or fewer than `least`.
    """
    times = finite_array("t", t, ()).copy()
    if times.ndim != 1 or len(times) < least:
        raise InputError("t", f"shape {times.shape}, expected (N,) with N >= {least}")
    steps = np.diff(times)
    if (steps <= 0).any():
        i = int(np.argmax(steps <= 0)) + 1
        raise InputError("t", f"not increasing: t[{i}] = {times[i]:g} after {times[i - 1]:g}")
    times.setflags(write=False)
    return times


def spline(t: Array, values: Array) -> BSpline:
    """A smooth curve through samples: of degree five, lower for fewer than six of them.

    Args:
        t: Increasing times, shape (N,).
        values: Shape (N, ...).
    """
    return make_interp_spline(t, values, k=min(5, len(t) - 1))
