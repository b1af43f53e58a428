# SPDX-License-Identifier: BSD-2-Clause
"""Corrects rounded placements that keep overconstrained loops from moving.

An overconstrained loop moves only because its axes are parallel, meet in one point, or the like.
With rounded placements they do so only roughly, and redundant rows contradict each other. The
placements of such a loop are displaced as little as possible, so that it closes in all poses.

Joint motions can remove all of f but U^T f, where U are the left singular vectors of Phi beyond its
rank. With F = df/dd for displacements d of the placements, U^T (f + F d) = 0 must hold in many
poses at once, home among them. Gauss-Newton's method finds the shortest d. The rank is found where
the loops are closed by least squares: there the singular values of the mechanism are orders larger
than those from rounding.

Axes may be almost parallel on purpose. A loop that can move as it is, is corrected only if the
rounding of its numbers, or the gap in its home, explains the displacements.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import ClosureError, DescriptionWarning, warn_caller
from ..model.closures import frames_of
from ..model.geometry import displaced, place_of
from ..model.mechanism import Mechanism
from ..model.thresholds import EXPLAINED, ROUNDED_PLACEMENTS
from ..model.tree import frame_id
from ..progress import announced
from ..summaries import listed
from .assembly import Assembly
from .guesses import displacement, home_of
from .loops import Loops, connected
from .mobility import rank_of, scaled_Phi

#: Widths of random displacements, [rad] or lengths of the loop: of starts, of poses in which loops
#: must close, and of poses that check the result. The first three poses tell whether loops close.
_STARTS = np.linspace(0.0, 2.0, 21)
_POSES, _LOOKS, _CHECKS = np.linspace(0.1, 1.0, 16), 3, np.linspace(0.15, 1.05, 8)
#: Largest ratio of a singular value that rounding makes to one of the mechanism.
_GAP = 0.1
#: Loops that stay open by more in all poses may be far from the poses in which they close.
_FAR = 10 * ROUNDED_PLACEMENTS
#: Gauss-Newton's method: steps, the last gap, and the singular values that count as zero, at least
#: and as multiples of the gap.
_STEPS, _CLOSED, _LEAST, _NOISE = 12, 1e-14, 1e-9, 30.0
#: Corrections of a part: in the poses, then also in poses in which it stayed open.
_TRIES = 3
#: A loop moves as it is if it closes after each of these steps, [rad] or lengths of the loop.
_MOTION, _MOTION_STEPS = 0.05, 3
#: Numbers of a file have so many digits after the point at most; numbers of more are not rounded.
#: They have k digits if this part of them has. Random numbers have so with a probability of 2e-4.
_DIGITS, _MANY, _WHOLE = 9, 0.25, 1e-4

#: Rows with an error, and the rates that they connect.
_Part = tuple[Indices, Indices]


def correct_geometry(mechanism: Mechanism) -> Mechanism:
    """The mechanism with overconstrained loops that close in all their poses.

    Warns:
        DescriptionWarning: If placements were displaced, because they are rounded.

    Raises:
        ClosureError: For an overconstrained loop that is open by more in its best pose.
    """
    with announced(f"model {mechanism.model.name}: checking its closures"):
        return _corrected(mechanism)


def _corrected(mechanism: Mechanism) -> Mechanism:
    rounded = corrected = _Robot(mechanism)
    start, rates = rounded.start(), np.arange(mechanism.model.nv)
    suspects = [part for part in rounded.parts if not rounded.has_independent_rows(start, part)]
    if not suspects:
        return mechanism
    poses = [rounded.closest(start, rates, width) for width in _POSES[:_LOOKS]]
    suspects = [part for part in suspects if not all(rounded.closes(q, part) for q in poses)]
    if not suspects:
        return mechanism
    poses += [rounded.closest(start, rates, width) for width in _POSES[_LOOKS:]]
    errors = [np.zeros(len(rounded.loops.f))]
    for part in suspects:
        rounded.require_closing([start, *poses], part)
        trial, checks = _corrected_part(rounded, corrected, part, start, poses)
        if checks:
            corrected = trial
            errors += [rounded.errors(q, part) for q in checks]
    if corrected is rounded:
        return mechanism
    _warn(mechanism, corrected.mechanism, np.max(errors, axis=0))
    return corrected.mechanism


def _corrected_part(
    rounded: "_Robot", corrected: "_Robot", part: _Part, start: Array, poses: Sequence[Array]
) -> tuple["_Robot", list[Array]]:
    """`corrected` with one more part, and poses in which `rounded` closes that part best.

    There are no poses if the part closes as it is, or if rounding does not explain its gaps.
    """
    nothing = corrected, list[Array]()
    closed = [q for q in [start, *poses] if rounded.gap(q, part) <= ROUNDED_PLACEMENTS]
    # Ranks are lower near singularities.
    ranks = [rank for rank in (rounded.rank(q, part) for q in closed) if rank is not None]
    rank = max((r for r in ranks if ranks.count(r) > 2), default=len(part[0]))
    fitting = [q for q in closed if rounded.rank(q, part) == rank]
    if rank == len(part[0]) or not np.median([rounded.gap(q, part) for q in fitting]):
        return nothing
    for k in range(_TRIES):
        corrected, size = corrected.with_closing(fitting, part, rank)
        widths = [0.0, *(_CHECKS + k / 100)]
        checks = [corrected.closest(start, part[1], width) for width in widths]
        # Poses with larger gaps are next to no closed pose.
        closed = [q for q in checks if corrected.gap(q, part) <= ROUNDED_PLACEMENTS]
        regular = [q for q in closed if corrected.rank(q, part) == rank]
        if regular and not any(corrected.gap(q, part) for q in regular):
            break
        fitting += regular
    else:
        return nothing
    closest = [rounded.closest(q, part[1]) for q in regular]
    if any(rounded.gap(q, part) > ROUNDED_PLACEMENTS for q in closest):
        return nothing
    if rounded.moves(start, part) and size > EXPLAINED * rounded.rounding(start, part):
        return nothing
    return corrected, closest


class _Robot:
    """Poses of a mechanism whose loops are closed as far as rounding allows.

    Attributes:
        parts: Rows with an error and their rates, in parts that share no row and no rate.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.loops = mechanism, Loops(mechanism.model, mechanism.closures)
        self._assembly = Assembly(mechanism, self.loops)
        rows, touched = np.flatnonzero(self.loops.holonomic), self.loops.touched
        self.parts = [(rows[k], rates) for k, rates in connected(touched[rows]) if len(k)]

    # --- poses ------------------------------------------------------------------------------

    def start(self) -> Array:
        """A pose near home, or near `pin.neutral`, in which as many parts as possible close."""
        home = home_of(self.mechanism)
        q = pin.neutral(self.mechanism.model) if home is None else home
        for width in _STARTS:
            wide = [part[1] for part in self.parts if self.gap(q, part) > ROUNDED_PLACEMENTS]
            if not wide:
                break
            q = self.closest(q, np.concatenate(wide), width)
        return q

    def closest(self, q: Array, rates: Indices, width: float = 0.0) -> Array:
        """The pose next to q with the smallest gaps, after a random displacement."""
        step = np.zeros(self.mechanism.model.nv)
        step[rates] = displacement(self.mechanism, width)[rates]
        q = pin.integrate(self.mechanism.model, q, step)
        return self._assembly.closer(q, rates, ROUNDED_PLACEMENTS)

    def moves(self, q: Array, part: _Part) -> bool:
        """Whether a part closes, to rounding, along a motion from near q."""
        rows, rates = part
        model, scale = self.mechanism.model, self.mechanism.rate_scale[rates]
        q = self._assembly.closer(q, rates)
        random = (displacement(self.mechanism, 1.0) / self.mechanism.rate_scale)[rates]
        for _ in range(_MOTION_STEPS):
            if self._assembly.gap(q, rows):
                return False
            _, sizes, Vt = np.linalg.svd(self._Phi(q, part))
            motions = Vt[rank_of(sizes) :]
            along = motions.T @ (motions @ random)
            if not len(motions):
                return False
            step = np.zeros(model.nv)
            step[rates] = _MOTION * along / np.abs(along).max() * scale
            ahead = self._assembly.closer(pin.integrate(model, q, step), rates)
            moved = pin.difference(model, q, ahead)[rates] / scale
            if moved.dot(along) < _MOTION / 2 * along.dot(along) / np.abs(along).max():
                return False
            q = ahead
        return not self._assembly.gap(q, rows)

    # --- at a pose --------------------------------------------------------------------------

    def gap(self, q: Array, part: _Part) -> float:
        """How far a part is open, free of units; 0 if it is closed."""
        return self._assembly.gap(q, part[0])

    def closes(self, q: Array, part: _Part) -> bool:
        """Whether a part is closed to rounding at q, and its rank is clear."""
        return not self.gap(q, part) and self.rank(q, part) is not None

    def has_independent_rows(self, q: Array, part: _Part) -> bool:
        """Whether a part is closed and no row is redundant, so that none contradict each other."""
        return self.gap(q, part) <= ROUNDED_PLACEMENTS and self.rank(q, part) == len(part[0])

    def rank(self, q: Array, part: _Part) -> int | None:
        """Rank of a part; None if its singular values have no gap."""
        sizes = np.append(np.linalg.svd(self._Phi(q, part), compute_uv=False), 0.0)
        rank = int((sizes > ROUNDED_PLACEMENTS * sizes.max(initial=1.0)).sum())
        smallest = sizes[rank - 1] if rank else 1.0
        return rank if sizes[rank] <= _GAP * smallest else None

    def errors(self, q: Array, part: _Part) -> Array:
        """Sizes of f at q in the rows of a part, zero in the others, shape (rows,)."""
        self.loops.evaluate(q)
        errors = np.zeros(len(self.loops.f))
        errors[part[0]] = np.abs(self.loops.f[part[0]])
        return errors

    def require_closing(self, poses: Sequence[Array], part: _Part) -> None:
        """Refuse an overconstrained part that is open in all poses by more than rounding."""
        best = min(poses, key=lambda q: self.gap(q, part))
        rank = self.rank(best, part)
        if not ROUNDED_PLACEMENTS < self.gap(best, part) < _FAR or rank in {None, len(part[0])}:
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

    def _Phi(self, q: Array, part: _Part) -> Array:
        return scaled_Phi(self.mechanism, self.loops, q)[np.ix_(*part)]

    # --- placements -------------------------------------------------------------------------

    def with_closing(
        self, poses: Sequence[Array], part: _Part, rank: int
    ) -> tuple["_Robot", float]:
        """The robot with displaced placements, so that a part closes next to these poses.

        Beside it stands the largest displacement, [rad] or lengths of the loop.
        """
        result, (rows, rates), places = self, part, self._places(part)
        scale = self.mechanism.row_scale[rows]
        unit = np.tile(np.repeat([1 / scale.max(), 1.0], 3), len(places))
        total = np.zeros(len(unit))
        for _ in range(_STEPS):
            mechanism, loops = result.mechanism, result.loops
            left, right, closing = list[Array](), list[Array](), list[tuple[Array, Array, Array]]()
            for q in poses:
                U, s, Vt = np.linalg.svd(result._Phi(q, part))
                f = loops.f[rows] * scale
                F = by_displacements(loops, places)[rows] * scale[:, None] * unit
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
            result = _Robot(replace(mechanism, model=displaced(mechanism.model, changes)))
            total += d
        return result, float(np.abs(total).max(initial=0.0))

    def rounding(self, q: Array, part: _Part) -> float:
        """Size of the rounding of a part, [rad] or lengths of the loop.

        It is that of the last digits of its placements, or the gap that is left at q, if larger.
        """
        numbers = list[float]()
        for place in self._places(part):
            _, placement = place_of(self.mechanism.model, place)
            numbers += [*placement.translation, *pin.rpy.matrixToRpy(placement.rotation)]
        last_digit = half_a_digit(np.array(numbers)) * self.mechanism.row_scale[part[0]].max()
        return max(last_digit, self.gap(self.closest(q, part[1]), part))

    def _places(self, part: _Part) -> dict[str, int]:
        """Joints of a part, and frames that only one closure has: their frame indices, or 0."""
        model, closures = self.mechanism.model, self.mechanism.closures
        uses = Counter(name for closure in closures for name in frames_of(closure))
        pairs = zip(closures, self.loops.slices, strict=True)
        ends = (frames_of(c) for c, s in pairs if np.isin(part[0], range(s.start, s.stop)).any())
        frames = sorted({name for pair in ends for name in pair if uses[name] == 1} - {"universe"})
        joints = [j for j in range(1, model.njoints) if model.joints[j].idx_v in part[1]]
        places = dict.fromkeys((model.names[j] for j in joints), 0)
        return places | {x: frame_id(model, x) for x in frames if x not in places}


def by_displacements(loops: Loops, places: Mapping[str, int]) -> Array:
    """Derivatives of f by displacements of places, see `geometry`, shape (rows, 6 places).

    A place is a joint, or a frame with its index.
    """
    model, data, bodies = loops.model, loops.data, loops.tree.bodies
    supports = [set(model.supports[j]) for j in range(model.njoints)]
    by = np.zeros((len(loops.f), len(places), 6))
    for k, (place, frame) in enumerate(places.items()):
        body, placement = place_of(model, place)
        bearer = data.oMi[bodies[body]]
        # Linear along the axes of the bearer, angular about those of the place.
        twists = (bearer * placement).action
        twists[:3, :3] = bearer.rotation
        joint = 0 if frame else model.getJointId(place)
        for closures in loops.of_frames:
            frames = closures.frames.tolist()  # Pinocchio takes Python's integers
            for pair, at, W in zip(frames, closures.at, closures.W, strict=True):
                if joint:
                    moves_b, moves_a = (
                        joint in supports[model.frames[x].parentJoint] for x in pair
                    )
                else:
                    moves_b, moves_a = (x == frame for x in pair)
                if moves_b != moves_a:
                    of_one = W[:, :6] if moves_b else W[:, 6:]
                    by[at, k] = of_one @ twists
    return by.reshape(len(by), -1)


def half_a_digit(numbers: Array) -> float:
    """Half a unit of the last digit of rounded numbers; 0 if they are not rounded.

    Some of them may be products of rounded numbers, or exact.
    """
    numbers = np.abs(numbers[np.abs(numbers) > 10.0**-_DIGITS])
    for digits in range(1, _DIGITS):
        tens = numbers * 10.0**digits
        if len(numbers) and np.mean(np.abs(tens - tens.round()) < _WHOLE) > _MANY:
            return 0.5 * 10.0**-digits
    return 0.0


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
        f"model {before.model.name}: its placements are rounded, so that the loops at "
        f"{listed(list(names), 4)} close only to {max(errors * ~turns):.2g} m and "
        f"{np.degrees(max(errors * turns)):.2g} degrees; placements were corrected by up to "
        f"{metres:.2g} m and {np.degrees(radians):.2g} degrees, so that the loops close in all "
        "poses; write more digits",
        DescriptionWarning,
    )
