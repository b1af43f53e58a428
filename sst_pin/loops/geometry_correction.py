# SPDX-License-Identifier: BSD-2-Clause
"""Corrects placements whose few digits keep overconstrained loops from moving.

An overconstrained loop moves only because its axes are parallel, meet in one point, or the like.
With few digits they do so only roughly, and redundant rows contradict each other. The placements of
such a loop are displaced as little as possible, so that it closes exactly in all poses.

Joint motions can remove all of f but U^T f, where U are the left singular vectors of Phi beyond its
rank. With F = df/dd for displacements d of the placements, U^T (f + F d) = 0 must hold in many
poses at once. Gauss-Newton's method finds the shortest d. The rank is found where the loops are
closed by least squares: there the singular values of the mechanism are orders larger than those
from rounding. A loop that is open by more in its best pose is refused.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import ClosureError, DescriptionWarning, warn_caller
from ..model.closures import frames_of
from ..model.geometry import displaced
from ..model.mechanism import Mechanism
from ..model.thresholds import FEW_DIGITS
from ..summaries import listed
from .assembly import Assembly, displacement, home_of
from .loops import Loops, connected
from .mobility import scaled_Phi

#: Widths of random displacements, [rad] or lengths of the loop: of starts, of poses in which loops
#: must close, and of poses that check the result. The first three poses tell whether loops close.
_STARTS = np.linspace(0.0, 2.0, 21)
_POSES, _LOOKS, _CHECKS = np.linspace(0.1, 1.0, 16), 3, np.linspace(0.15, 1.05, 8)
#: Largest ratio of a singular value that rounding makes to one of the mechanism.
_GAP = 0.1
#: Loops that stay open by more in all poses may be far from the poses in which they close.
_FAR = 10 * FEW_DIGITS
#: Gauss-Newton's method: steps, the last gap, and the singular values that count as zero, at least
#: and as multiples of the gap.
_STEPS, _CLOSED, _LEAST, _NOISE = 12, 1e-14, 1e-9, 30.0

#: Rows with an error, and the rates that they connect.
_Part = tuple[Indices, Indices]


class _Poses:
    """Poses of a mechanism whose loops are closed as far as few digits allow."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.loops = mechanism, Loops(mechanism.model, mechanism.closures)
        self._assembly = Assembly(mechanism, self.loops)
        rows, touched = np.flatnonzero(self.loops.holonomic), self.loops.touched
        self.parts = [(rows[k], rates) for k, rates in connected(touched[rows]) if len(k)]

    def closest(self, q: Array, rates: Indices, width: float = 0.0) -> Array:
        """The pose next to q with the smallest gaps, after a random displacement."""
        step = np.zeros(self.mechanism.model.nv)
        step[rates] = displacement(self.mechanism, width)[rates]
        q = pin.integrate(self.mechanism.model, q, step)
        return self._assembly.closer(q, rates, FEW_DIGITS)

    def start(self) -> Array:
        """A pose near home, or near `pin.neutral`, in which as many parts as possible close."""
        home = home_of(self.mechanism)
        q = pin.neutral(self.mechanism.model) if home is None else home
        for width in _STARTS:
            wide = [part[1] for part in self.parts if self.gap(q, part) > FEW_DIGITS]
            if not wide:
                break
            q = self.closest(q, np.concatenate(wide), width)
        return q

    def gap(self, q: Array, part: _Part) -> float:
        """How far a part is open, free of units; 0 if it is closed."""
        return self._assembly.gap(q, part[0])

    def rank(self, q: Array, part: _Part) -> int:
        """Rank of a part; 0 if its singular values have no gap."""
        Phi = scaled_Phi(self.mechanism, self.loops, q)[np.ix_(*part)]
        sizes = np.append(np.linalg.svd(Phi, compute_uv=False), 0.0)
        rank = int((sizes > FEW_DIGITS * sizes[0]).sum())
        return rank if sizes[rank] <= _GAP * sizes[rank - 1] else 0

    def errors(self, q: Array, part: _Part) -> Array:
        """Sizes of f at q in the rows of a part, zero in the others, shape (rows,)."""
        self.loops.evaluate(q)
        errors = np.zeros(len(self.loops.f))
        errors[part[0]] = np.abs(self.loops.f[part[0]])
        return errors

    def require_closing(self, poses: Sequence[Array], part: _Part) -> None:
        """Refuse an overconstrained part that is open in all poses by more than few digits."""
        best = min(poses, key=lambda q: self.gap(q, part))
        gap, rank = self.gap(best, part), self.rank(best, part)
        if not (FEW_DIGITS < gap < _FAR and 0 < rank < len(part[0])):
            return
        errors = self.errors(best, part)
        names = [
            str(closure)
            for closure, rows in zip(self.mechanism.closures, self.loops.slices, strict=True)
            if errors[rows].any()
        ]
        raise ClosureError(
            f"the loops at {listed(names, 4)} stay open by {errors.max():.3g} (m or rad) in the "
            "best pose; correct the placements and axes of their joints and frames",
            float(errors.max()),
        )

    def corrected(self, poses: Sequence[Array], part: _Part, rank: int) -> "_Poses":
        """Poses of the mechanism whose placements let a part close next to these poses."""
        result, (rows, rates) = self, part
        places, scale = self._places(part), self.mechanism.row_scale[rows]
        unit = np.tile(np.repeat([1 / scale.max(), 1.0], 3), len(places))
        for _ in range(_STEPS):
            mechanism, loops = result.mechanism, result.loops
            left, right, closing = list[Array](), list[Array](), list[tuple[Array, Array, Array]]()
            for q in poses:
                U, s, Vt = np.linalg.svd(scaled_Phi(mechanism, loops, q)[np.ix_(*part)])
                f, F = loops.f[rows] * scale, loops.by_displacements(places)[rows]
                F = F * scale[:, None] * unit
                left.append(U[:, rank:].T @ F)
                right.append(U[:, rank:].T @ f)
                closing.append((Vt[:rank].T / s[:rank] @ U[:, :rank].T, f, F))
            gap = float(np.abs(right).max())
            if gap < _CLOSED:
                break
            rcond = max(_LEAST, _NOISE * gap)
            d = -np.linalg.lstsq(np.vstack(left), np.concatenate(right), rcond=rcond)[0]
            steps = np.zeros((len(poses), mechanism.model.nv))
            steps[:, rates] = [-G @ (f + F @ d) for G, f, F in closing]
            steps *= mechanism.rate_scale
            poses = [pin.integrate(mechanism.model, *x) for x in zip(poses, steps, strict=True)]
            changes = dict(zip(places, (unit * d).reshape(-1, 6), strict=True))
            result = _Poses(replace(mechanism, model=displaced(mechanism.model, changes)))
        return result

    def _places(self, part: _Part) -> list[str]:
        """Names of the joints of a part, and of frames that no other closure has."""
        model, closures = self.mechanism.model, self.mechanism.closures
        uses = Counter(name for closure in closures for name in frames_of(closure))
        pairs = zip(closures, self.loops.slices, strict=True)
        ends = (frames_of(c) for c, s in pairs if np.isin(part[0], range(s.start, s.stop)).any())
        frames = sorted({name for pair in ends for name in pair if uses[name] == 1} - {"universe"})
        joints = [j for j in range(1, model.njoints) if model.joints[j].idx_v in part[1]]
        return list(dict.fromkeys([*(model.names[j] for j in joints), *frames]))


def correct_geometry(mechanism: Mechanism) -> Mechanism:
    """The mechanism with overconstrained loops that close in all their poses.

    Warns:
        DescriptionWarning: If placements were displaced, because their digits are too few.

    Raises:
        ClosureError: For an overconstrained loop that is open by more in its best pose.
    """
    rounded = corrected = _Poses(mechanism)
    start, rates = rounded.start(), np.arange(mechanism.model.nv)
    # Rows that are independent in a closed pose do not contradict each other.
    parts = [
        part
        for part in rounded.parts
        if rounded.gap(start, part) > FEW_DIGITS or rounded.rank(start, part) < len(part[0])
    ]
    poses = [rounded.closest(start, rates, width) for width in _POSES[:_LOOKS] if parts]
    parts = [
        part
        for part in parts
        if any(rounded.gap(q, part) or not rounded.rank(q, part) for q in poses)
    ]
    poses += [rounded.closest(start, rates, width) for width in _POSES[_LOOKS:] if parts]
    errors = np.zeros((1, len(rounded.loops.touched)))
    for part in parts:
        rounded.require_closing([start, *poses], part)
        trial, checks = _corrected(rounded, corrected, part, start, poses)
        if checks:
            corrected = trial
            errors = np.vstack([errors, *(rounded.errors(q, part) for q in checks)])
    if corrected is not rounded:
        _warn(mechanism, corrected.mechanism, errors.max(axis=0))
    return corrected.mechanism


def _corrected(
    rounded: _Poses, corrected: _Poses, part: _Part, start: Array, poses: Sequence[Array]
) -> tuple[_Poses, list[Array]]:
    """`corrected` with one more part, and poses in which `rounded` closes that part best.

    There are no poses if the part is open by more than few digits explain, or closes as it is.
    """
    closed = [q for q in poses if rounded.gap(q, part) <= FEW_DIGITS]
    ranks = [rounded.rank(q, part) for q in closed]
    rank = max(r for r in [0, *ranks] if not r or ranks.count(r) > 2)  # lower near singularities
    fitting = [q for q, r in zip(closed, ranks, strict=True) if r == rank]
    if rank in (0, len(part[0])) or not np.median([rounded.gap(q, part) for q in fitting]):
        return corrected, []
    for k in range(3):
        corrected = corrected.corrected(fitting, part, rank)
        checks = [corrected.closest(start, part[1], width + k / 100) for width in _CHECKS]
        checks = [q for q in checks if corrected.rank(q, part) == rank]
        if checks and not any(corrected.gap(q, part) for q in checks):
            closest = [rounded.closest(q, part[1]) for q in checks]
            near = all(rounded.gap(q, part) <= FEW_DIGITS for q in closest)
            return corrected, closest if near else []
        fitting += checks
    return corrected, []


def _warn(before: Mechanism, after: Mechanism, errors: Array) -> None:
    """Say how far loops were open, by the rows' errors, and how far placements were displaced."""
    rows = [(str(closure), row) for closure in before.closures for row in closure.rows]
    turns = np.array([row.startswith("turn") for _, row in rows])
    names = dict.fromkeys(name for (name, _), gap in zip(rows, errors, strict=True) if gap)
    a, b = (
        [*x.jointPlacements, *(f.placement for f in x.frames)] for x in (before.model, after.model)
    )
    moves = [np.abs(pin.log6(x.actInv(y)).vector) for x, y in zip(a, b, strict=True)]
    metres, radians = np.max(moves, axis=0).reshape(2, 3).max(axis=1)
    warn_caller(
        f"model {before.model.name}: its numbers have few digits, with which the loops at "
        f"{listed(list(names), 4)} close only to {max(errors * ~turns):.2g} m and "
        f"{np.degrees(max(errors * turns)):.2g} degrees; placements were corrected by up to "
        f"{metres:.2g} m and {np.degrees(radians):.2g} degrees, so that the loops close in all "
        "poses; write more digits",
        DescriptionWarning,
    )
