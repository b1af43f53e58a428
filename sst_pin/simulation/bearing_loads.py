# SPDX-License-Identifier: BSD-2-Clause
"""Peak and RMS loads of joints and closures along a motion, to choose bearings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..dynamics.quantities import Quantity
from ..dynamics.reactions import Reactions
from ..engine import Engine
from ..errors import InputError, MissingExtraError
from ..files import as_path, text_writer, write_files
from ..summaries import Summary
from .trajectories import Trajectory, require_motion

if TYPE_CHECKING:
    import pandas as pd


#: Largest relative difference between a motion's accelerations and those that its torques cause.
_DIFFERENCE = 1e-6


class Load(NamedTuple):
    """Magnitude of the force or the moment of a joint or closure along a motion.

    Attributes:
        name: Name of the joint or closure.
        kind: "force" [N] or "moment" [N m].
        peak: Largest magnitude; NaN where it is not unique.
        time: Time of the peak, [s]; NaN without a peak.
        x: First component of the direction at the peak, a unit vector in the axes of the wrench.
        y: Second component.
        z: Third component.
        rms: Root mean square of the magnitude over time, by the trapezoidal rule.
        determined: Whether it is unique in the rigid robot at all samples.
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
            (
                f"{row.name}, {row.kind}",
                f"peak {row.peak:.4g} {units[row.kind]} at {row.time:.4g} s, rms {row.rms:.4g}"
                if np.isfinite(row.peak)
                else "not unique; see stiffness=",
            )
            for row in self.rows
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


def reactions_along(
    engine: Engine, motion: Trajectory, stiffness: Mapping[str, ArrayLike] | None
) -> Reactions:
    """Reactions along a motion under its torques and gravity; other loads are an error."""
    require_motion(motion, engine.mechanism)
    q, va, tau = motion.q, motion.va, motion.tau
    w = engine.reactions(q, va, None, tau, stiffness)
    aa = engine.compute(Quantity("accelerations"), q, va=va, tau=tau)
    largest = np.abs(motion.aa).max(initial=0.0)
    if np.abs(aa - motion.aa).max(initial=0.0) > _DIFFERENCE * (1 + largest):
        raise InputError("motion", "other forces than its torques and the weights act on it")
    return w


def loads(engine: Engine, motion: Trajectory, stiffness: Mapping[str, ArrayLike] | None) -> Loads:
    """Loads along a motion under its torques and the weights."""
    w = reactions_along(engine, motion, stiffness)
    wrenches = np.concatenate([w.joints, w.closures], axis=-2)
    unique = np.all(np.concatenate(w.determined, axis=-2), axis=0)
    half = np.diff(motion.t, prepend=motion.t[0], append=motion.t[-1]) / 2
    weights = half[:-1] + half[1:] if len(motion) > 1 else np.ones(1)
    rows = []
    for k, name in enumerate(w.names):
        for kind, part in (("force", slice(0, 3)), ("moment", slice(3, 6))):
            vectors = wrenches[:, k, part]
            sizes = np.linalg.norm(vectors, axis=1)
            peak = float(sizes.max())  # NaN if any is
            at = int(np.argmax(~(sizes < (1 - 1e-9) * peak)))  # first of equal peaks
            time = float(motion.t[at]) if np.isfinite(peak) else np.nan
            rms = np.sqrt(np.average(sizes**2, weights=weights))
            x, y, z = (vectors[at] / (peak or 1.0)).tolist()
            determined = bool(np.all(unique[k, part]))
            rows.append(Load(name, kind, peak, time, x, y, z, float(rms), determined))
    return Loads(tuple(rows))
