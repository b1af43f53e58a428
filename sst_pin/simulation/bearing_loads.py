# SPDX-License-Identifier: BSD-2-Clause
"""Peak and RMS loads of joints and closures along a motion, to choose bearings.

`loads` makes the table `Loads`, with two rows of type `Load` for each joint and closure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..engine import Engine
from ..errors import InputError, MissingExtraError
from ..files import as_path, text_writer, write_files
from ..summaries import Summary
from .trajectories import Trajectory, require_motion

if TYPE_CHECKING:
    import pandas as pd


#: The accelerations of a motion and those that its torques cause may differ by this part of the
#: largest one, plus as many rad/s^2 or m/s^2.
_DIFFERENCE = 1e-6
#: Components of wrenches below this part of the largest one are rounding. Peaks that differ by less
#: than this part are equal.
_ROUNDING = 1e-9


class Load(NamedTuple):
    """Magnitude of the force or the moment of a joint or closure along a motion.

    Sometimes only some components of the force or moment are known. For example, in a planar robot
    only the force in the plane may be unique. The magnitude is that of the known components: they
    are unique, or follow from given stiffnesses, at all samples.

    Attributes:
        name: Name of the joint or closure.
        kind: "force" [N] or "moment" [N m].
        peak: Largest magnitude of the known components; NaN if there are none.
        time: Time of the peak, [s]; NaN without a peak.
        x: First component of the direction at the peak, a unit vector in the axes of the wrench, or
            in `axes`; NaN if it is not known.
        y: Second component.
        z: Third component.
        rms: Root mean square of the magnitude over time, by the trapezoidal rule.
        determined: Whether all components are unique in the rigid robot at all samples.
        components: The known components: "x", "y" and "z" in one word, such as "xy".
    """

    name: str
    kind: str
    peak: float
    time: float
    x: float
    y: float
    z: float
    rms: float
    determined: bool
    components: str


@dataclass(frozen=True, repr=False)
class Loads(Summary):
    """A table of loads, two rows for each joint and closure.

    Attributes:
        rows: Force and moment of each joint, then of each closure.

    Example:
        >>> delta = sst_pin.robots.delta()
        >>> motion = delta.simulate(np.zeros(3), delta.home, np.zeros(3), [0, 0.01, 0.02])
        >>> delta.loads(motion).rows[0].name
        'motor_1'
    """

    rows: tuple[Load, ...]

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        units = {"force": "N", "moment": "N m"}
        return f"Loads of {len(self.rows) // 2} joints and closures", [
            (f"{row.name}, {row.kind}", _described(row, units[row.kind])) for row in self.rows
        ]

    def to_dataframe(self) -> pd.DataFrame:
        """The table for pandas, with a column for each attribute of a `Load`.

        Raises:
            MissingExtraError: Without pandas, `sst-pin[pandas]`.
        """
        try:
            import pandas as pd
        except ImportError:
            raise MissingExtraError("pandas", "pandas") from None
        return pd.DataFrame(self.rows, columns=Load._fields)

    @property
    def csv(self) -> str:
        """The table as CSV."""
        lines = [",".join(map(str, row)) for row in self.rows]
        return "\n".join([",".join(Load._fields), *lines]) + "\n"

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write the table as CSV; an existing file is replaced only with `force`.

        Raises:
            OutputError: If the file cannot be written, or exists.
        """
        write_files({as_path(path): text_writer(self.csv)}, force)


def loads(
    engine: Engine,
    motion: Trajectory,
    stiffness: Mapping[str, ArrayLike] | None,
    axes: ArrayLike | None,
) -> Loads:
    """Loads along a motion under its torques and the weights; see `ClosedChain.loads`."""
    require_no_other_loads(engine, motion)
    w = engine.reactions(motion.q, motion.va, None, motion.tau, stiffness, axes)
    # Wrenches [force; moment] of the joints, then of the closures, (N, joints + closures, 6).
    wrenches = _without_noise(
        np.concatenate([w.joints, w.closures], axis=-2), engine.mechanism.length
    )
    # Which components the rigid robot determines at all samples, shape (joints + closures, 6).
    determined = np.all(np.concatenate(w.determined, axis=-2), axis=0)
    weights = np.ones(1)
    if len(motion) > 1:
        # The trapezoidal rule: half of the steps before and after each sample.
        half_steps = np.diff(motion.t, prepend=motion.t[0], append=motion.t[-1]) / 2
        weights = half_steps[:-1] + half_steps[1:]
    rows = []
    for k, name in enumerate(w.names):
        for kind, part in (("force", slice(0, 3)), ("moment", slice(3, 6))):
            vectors = wrenches[:, k, part]
            all_determined = bool(np.all(determined[k, part]))
            rows.append(_load(name, kind, vectors, motion.t, weights, all_determined))
    return Loads(tuple(rows))


def require_no_other_loads(engine: Engine, motion: Trajectory) -> None:
    """Raise an error if other forces than its torques and the weights act in a motion."""
    require_motion(motion, engine.mechanism)
    aa = engine.accelerations(motion.q, motion.va, motion.tau)
    largest = np.abs(motion.aa).max(initial=0.0)
    if np.abs(aa - motion.aa).max(initial=0.0) > _DIFFERENCE * (1 + largest):
        raise InputError("motion", "other forces than its torques and the weights act on it")


def _without_noise(wrenches: Array, length: float) -> Array:
    """Wrenches [force; moment], shape (..., 6), with zeros in place of rounding.

    Moments are divided by a length of the robot, so that all components can be compared in [N].
    """
    units = np.repeat([1.0, length], 3)
    largest = np.nanmax(np.abs(wrenches) / units, initial=0.0)
    return np.where(np.abs(wrenches) < _ROUNDING * largest * units, 0.0, wrenches)


def _load(name: str, kind: str, vectors: Array, t: Array, weights: Array, determined: bool) -> Load:
    """A row of the table.

    Args:
        name: Name of the joint or closure.
        kind: "force" or "moment".
        vectors: The forces or moments, shape (N, 3); NaN where a component is not known.
        t: Times, shape (N,), [s].
        weights: Weights of the samples in the mean over time, shape (N,).
        determined: The attribute of this name.
    """
    is_known = np.asarray(np.isfinite(vectors).all(axis=0))
    peak = np.nan
    time = np.nan
    rms = np.nan
    direction = np.full(3, np.nan)
    if is_known.any():
        magnitudes = np.linalg.norm(vectors[:, is_known], axis=1)
        peak = float(magnitudes.max())
        first_peak = int(np.argmax(magnitudes >= (1 - _ROUNDING) * peak))
        time = float(t[first_peak])
        rms = float(np.sqrt(np.average(magnitudes**2, weights=weights)))
        direction[is_known] = vectors[first_peak, is_known] / (peak or 1.0)
    x, y, z = direction.tolist()
    return Load(
        name=name,
        kind=kind,
        peak=peak,
        time=time,
        x=x,
        y=y,
        z=z,
        rms=rms,
        determined=determined,
        components="".join(axis for axis, known in zip("xyz", is_known, strict=True) if known),
    )


def _described(row: Load, unit: str) -> str:
    """A row in words."""
    if not row.components:
        return "not unique; see stiffness="
    text = f"peak {row.peak:.4g} {unit} at {row.time:.4g} s, rms {row.rms:.4g}"
    others = [axis for axis in "xyz" if axis not in row.components]
    if others:
        verb = "is" if len(others) == 1 else "are"
        text += f"; {', '.join(others)} {verb} not unique"
    return text
