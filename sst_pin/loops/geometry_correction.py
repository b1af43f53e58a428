# SPDX-License-Identifier: BSD-2-Clause
"""Corrects placements whose few digits keep overconstrained loops from moving.

An overconstrained loop moves only because its axes are parallel, meet in one point, or the like.
Written with few digits they do so only roughly, and redundant rows contradict each other. The
placements of such a loop are displaced as little as possible, so that it closes exactly in all
poses. All that is computed afterwards is exact again.

A pose can close f but for U^T f, where U are the left singular vectors of Phi beyond its rank. With
F = df/dd for displacements d of the placements, U^T (f + F d) = 0 must hold in many poses at once:
Gauss-Newton's method with the shortest d. The rank is clear where the loops are closed by least
squares: singular values of the mechanism are orders larger than those that rounding makes.
"""

import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import DescriptionWarning
from ..model.closures import frames_of
from ..model.mechanism import Mechanism
from ..model.thresholds import FEW_DIGITS
from ..model.tree import frame_id
from ..summaries import listed
from .assembly import Assembly, displacement, home_of
from .loops import Loops, connected
from .mobility import scaled_Phi

#: Widths of random displacements, [rad] or lengths of the loop: of starts, of poses in which loops
#: must close, the first three of which tell whether they do, and of those that prove it in the end.
_STARTS = np.linspace(0.0, 2.0, 21)
_POSES, _LOOKS, _CHECKS = np.linspace(0.1, 1.0, 16), 3, np.linspace(0.15, 1.05, 8)
#: Largest ratio of a singular value that rounding makes to one of the mechanism.
_GAP = 0.1
#: Gauss-Newton's method: steps, the last gap, and the singular values that count as zero, at least
#: and as multiples of the gap.
_STEPS, _CLOSED, _LEAST, _NOISE = 12, 1e-14, 1e-9, 30.0

#: Rows with a residual, and the rates that they connect.
_Part = tuple[Indices, Indices]


class _Poses:
    """Poses of a mechanism, its loops closed as well as few digits allow."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self._take_geometry()

    def _take_geometry(self) -> None:
        """Take the placements of the model as they are now."""
        self.loops = Loops(self.mechanism.model, self.mechanism.closures)
        self._assembly = Assembly(self.mechanism, self.loops)

    def closest(self, q: Array, rates: Indices, width: float = 0.0) -> Array:
        """The pose next to q whose loops are open least, after a random displacement."""
        way = np.zeros(self.mechanism.model.nv)
        way[rates] = displacement(self.mechanism, width)[rates]
        q = pin.integrate(self.mechanism.model, q, way)
        return self._assembly.closer(q, rates, FEW_DIGITS)

    def start(self, parts: Sequence[_Part]) -> Array:
        """A pose near home, or near `pin.neutral`, in which as many parts as possible close."""
        home = home_of(self.mechanism)
        q = pin.neutral(self.mechanism.model) if home is None else home
        for width in _STARTS:
            wide = [rates for rows, rates in parts if self.gap(q, (rows, rates)) > FEW_DIGITS]
            if not wide:
                break
            q = self.closest(q, np.concatenate(wide), width)
        return q

    def gap(self, q: Array, part: _Part) -> float:
        """How far a part is open, free of units; 0 if it is closed."""
        return self._assembly.gap(q, part[0])

    def rank(self, q: Array, part: _Part) -> int:
        """Rank of a part; 0 where it is open, or its singular values have no gap."""
        Phi = scaled_Phi(self.mechanism, self.loops, q)[np.ix_(*part)]
        sizes = np.append(np.linalg.svd(Phi, compute_uv=False), 0.0)
        rank = int((sizes > FEW_DIGITS * sizes[0]).sum())
        clear = sizes[rank] <= _GAP * sizes[rank - 1] and self.gap(q, part) <= FEW_DIGITS
        return rank if clear else 0

    def correct(self, part: _Part, poses: Sequence[Array], rank: int) -> None:
        """Displace placements of the model, so that a part closes next to these poses."""
        (rows, rates), mechanism, model = part, self.mechanism, self.mechanism.model
        joints, frames = self._places(part)
        scale, ways = mechanism.row_scale[rows], np.zeros((len(poses), model.nv))
        unit = np.tile(np.repeat([1 / scale.max(), 1.0], 3), len(joints) + len(frames))
        for _ in range(_STEPS):
            left, right, closing = list[Array](), list[Array](), list[tuple[Array, Array, Array]]()
            for q in poses:
                U, s, Vt = np.linalg.svd(scaled_Phi(mechanism, self.loops, q)[np.ix_(*part)])
                f = self.loops.f[rows] * scale
                F = self.loops.by_placements(joints, frames)[rows] * scale[:, None] * unit
                left.append(U[:, rank:].T @ F)
                right.append(U[:, rank:].T @ f)
                closing.append((Vt[:rank].T / s[:rank] @ U[:, :rank].T, f, F))
            gap = float(np.abs(right).max())
            if gap < _CLOSED:
                break
            rcond = max(_LEAST, _NOISE * gap)
            d = -np.linalg.lstsq(np.vstack(left), np.concatenate(right), rcond=rcond)[0]
            ways[:, rates] = [-G @ (f + F @ d) for G, f, F in closing] * mechanism.rate_scale[rates]
            poses = [pin.integrate(model, q, way) for q, way in zip(poses, ways, strict=True)]
            displaced = list(map(pin.exp6, (unit * d).reshape(-1, 6)))
            for j, way in zip(joints, displaced, strict=False):
                model.jointPlacements[j] = model.jointPlacements[j] * way
            for k, way in zip(frames, displaced[len(joints) :], strict=True):
                for frame in [x for x in model.frames if x.name == model.frames[k].name]:
                    frame.placement = frame.placement * way
            self._take_geometry()

    def _places(self, part: _Part) -> tuple[list[int], list[int]]:
        """Joints of a part, and frames that no other closure has."""
        model, closures = self.mechanism.model, self.mechanism.closures
        named = Counter(name for closure in closures for name in frames_of(closure))
        own = zip(closures, self.loops.slices, strict=True)
        ends = (frames_of(c) for c, s in own if np.isin(part[0], range(s.start, s.stop)).any())
        names = sorted({name for pair in ends for name in pair if named[name] == 1} - {"universe"})
        joints = [j for j in range(1, model.njoints) if model.joints[j].idx_v in part[1]]
        return joints, [frame_id(model, name) for name in names]


def correct_geometry(mechanism: Mechanism) -> Mechanism:
    """The mechanism with overconstrained loops that close in all their poses.

    Warns:
        DescriptionWarning: If placements were displaced, because their digits are too few.
    """
    rounded, corrected = _Poses(mechanism), mechanism
    rows, touched = np.flatnonzero(rounded.loops.holonomic), rounded.loops.touched
    parts = [(rows[k], rates) for k, rates in connected(touched[rows]) if len(k)]
    start, rates = rounded.start(parts), np.arange(mechanism.model.nv)
    poses = [rounded.closest(start, rates, width) for width in _POSES[:_LOOKS]]
    parts = [p for p in parts if any(rounded.gap(q, p) or not rounded.rank(q, p) for q in poses)]
    poses += [rounded.closest(start, rates, width) for width in _POSES[_LOOKS:] if parts]
    open_by = np.zeros(len(rounded.loops.touched))
    for part in parts:
        trial = _Poses(replace(corrected, model=pin.Model(corrected.model)))
        for q in _corrected(rounded, trial, part, start, poses):
            rounded.loops.evaluate(q)
            own = np.isin(np.arange(len(open_by)), part[0])
            open_by = np.maximum(open_by, own * np.abs(rounded.loops.f))
            corrected = trial.mechanism
    if corrected is not mechanism:
        _warn(mechanism, corrected, open_by)
    return corrected


def _corrected(
    rounded: _Poses, trial: _Poses, part: _Part, start: Array, poses: Sequence[Array]
) -> list[Array]:
    """Poses in which `trial` closes a part, once corrected, as far as `rounded` closes there.

    None if the part is open by more than few digits explain, or closes as it is.
    """
    ranks = [rounded.rank(q, part) for q in poses]
    rank = max(r for r in [0, *ranks] if not r or ranks.count(r) > 2)  # lower near singularities
    fitting = [q for q, r in zip(poses, ranks, strict=True) if r == rank]
    if rank in (0, len(part[0])) or not np.median([rounded.gap(q, part) for q in fitting]):
        return []
    for k in range(3):
        trial.correct(part, fitting, rank)
        checks = [trial.closest(start, part[1], width + k / 100) for width in _CHECKS]
        checks = [q for q in checks if trial.rank(q, part) == rank]
        if checks and not any(trial.gap(q, part) for q in checks):
            closest = [rounded.closest(q, part[1]) for q in checks]
            return closest if all(rounded.gap(q, part) <= FEW_DIGITS for q in closest) else []
        fitting += checks
    return []


def _warn(before: Mechanism, after: Mechanism, open_by: Array) -> None:
    rows = [(str(closure), row) for closure in before.closures for row in closure.rows]
    turns = np.array([row.startswith("turn") for _, row in rows])
    names = dict.fromkeys(name for (name, _), gap in zip(rows, open_by, strict=True) if gap)
    a, b = (
        [*x.jointPlacements, *(f.placement for f in x.frames)] for x in (before.model, after.model)
    )
    ways = [np.abs(pin.log6(x.actInv(y)).vector) for x, y in zip(a, b, strict=True)]
    metres, radians = np.max(ways, axis=0).reshape(2, 3).max(axis=1)
    warnings.warn(
        f"model {before.model.name}: its numbers have few digits, with which the loops at "
        f"{listed(list(names), 4)} close only to {max(open_by * ~turns):.2g} m and "
        f"{np.degrees(max(open_by * turns)):.2g} degrees; placements were corrected by up to "
        f"{metres:.2g} m and {np.degrees(radians):.2g} degrees, so that the loops close in all "
        "poses; write more digits",
        DescriptionWarning,
        stacklevel=6,
    )
