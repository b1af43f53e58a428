# SPDX-License-Identifier: BSD-2-Clause
"""Corrects rounded placements that keep overconstrained loops from moving.

An overconstrained loop has redundant rows in Phi. It moves only because its axes are parallel, meet
in one point, or the like. With rounded placements this holds only roughly, and the redundant rows
contradict each other. This module displaces the placements of such a loop as little as possible, so
that the loop closes in all poses.

Terms:

- A *part* is a set of loops that share no row and no rate with other loops. Parts are corrected one
  after the other.
- A *place* is a joint or a frame of a closure; see `model/geometry`. The vector d has displacements
  of all places of a part, [linear; angular] for each place, in lengths of the loop and [rad].
- The *gap* of a part at a pose is its largest error, free of units. It is 0 if the part is closed
  to the rounding of floats.
- The *start* is a pose near home, closed as well as possible. The other poses are found around it.
- A pose is *regular* if Phi has its usual rank there; at singular poses the rank is lower.

At a pose, let the columns of N be an orthonormal basis of the left null space of Phi: N^T Phi = 0.
Motions dq of the joints change f by Phi dq, so that they do not change N^T f. Displacements d of
the places change f by F d. So the loops can be closed next to this pose if

    N^T (f + F d) = 0,    F = df/dd.

This must hold at many poses at once. Gauss-Newton's method finds the shortest d.

N depends on the rank of Phi, which is not exact if placements are rounded. So the rank is judged at
poses where the loops are closed as well as possible, by least squares. There the singular values
that rounding makes are orders of magnitude smaller than the others. The rank is the number of the
others.

The designer of a robot may want axes that are almost, but not exactly, parallel. Such a robot must
stay as it is: only errors that come from rounded numbers are corrected. `_is_justified` decides
this. It refuses a correction

1. if the original is far from closed at a pose where the corrected part closes: the correction
   would make another robot;
2. if the original closes at the start, and its numbers do not look rounded;
3. if the original moves without a correction, from a home that is closed to the rounding of floats.
   Then its numbers are exact, even if they look rounded because they are short, such as 0.25. With
   rounded placements the loops would be open at home;
4. if the original moves without a correction, and the displacements are larger than its rounding
   explains. The rounding is that of its numbers, or its gap at the start if this is larger.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

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
from .displacement_derivatives import by_displacements
from .guesses import home_of, random_step
from .loops import Loops, connected
from .ranks import free_motions, scaled_Phi
from .rounded_numbers import half_a_digit

# Numbers of poses, tries and steps, and the widths of random steps, are choices. Widths are [rad],
# or lengths of the loop.

#: Widths of random steps to the start. The first try steps from home or `pin.neutral`, each other
#: try from the pose of the last one. The last try spreads angles over the whole turn. With fewer
#: tries more parts may stay open at the start.
_STARTS = np.linspace(0.0, 2.0, 21)
#: Widths of random steps from the start to poses in which a corrected part must close.
_POSES = np.linspace(0.1, 1.0, 16)
#: Number of the first poses of `_POSES`. A part needs no correction if it closes in all of them.
#: With fewer poses, a part that is open elsewhere would pass more often.
_FIRST_POSES = 3
#: Widths of random steps from the start to poses that check a correction. With fewer poses, a
#: correction that leaves the part open elsewhere would pass more often.
_CHECKS = np.linspace(0.15, 1.05, 8)
#: Largest number of tries to correct a part. Each one after the first has more poses. If none
#: succeeds, the part stays as it is in the file.
_TRIES = 3
#: A part moves without a correction if it closes after each of this number of steps. With fewer
#: steps, a rigid part would seem to move more often, and then it may not be corrected.
_MOTION_STEPS = 3
#: Length of these steps. A rigid part in a singular pose may seem closed after steps of 1e-5, as
#: its error grows with the square of the step; this step is much longer.
_MOTION = 0.05

# The results do not depend much on the next three numbers: all robots of
# tests/loops/test_rounded_numbers.py are also corrected if `_RANK_GAP` and `_FAR` are three times
# smaller or larger, and if `_NOISE` is ten times smaller or larger.

#: The rank is clear if the largest singular value that rounding makes is at most this part of the
#: smallest other one. Then it stays the same even if rounding makes ten times as much.
_RANK_GAP = 0.1
#: A part that stays open by more than this in all poses is neither corrected nor refused: its poses
#: may be far from those in which it closes.
_FAR = 10 * ROUNDED_PLACEMENTS
#: Gauss-Newton's method ignores singular values of N^T F that are smaller, relative to the largest
#: one, than this multiple of the error |N^T f|. The equations, which are linear in d, are wrong by
#: about this error.
_NOISE = 30.0

#: Gauss-Newton's method also ignores singular values below this part of the largest one: they are
#: rounding. With 1e-11, the correction of a scissor lift depended on the unit of length.
_ROUNDED = 1e-9
#: It ends at this error |N^T f|, some tens of roundings of numbers of size one.
_SOLVED = 1e-14
#: Its largest number of steps. Each step about squares the error, so that three are enough from
#: `ROUNDED_PLACEMENTS`. The others are for small singular values, which the error hides at first.
_STEPS = 12

#: The error for loops that stay open names the closures whose errors are larger than this part of
#: the largest error. A choice.
_NAMED = 3e-3


@dataclass(frozen=True)
class _Part:
    """Loops that share no row and no rate with other loops.

    Attributes:
        rows: Indices of its rows in f and Phi, without rows that hold rates only.
        rates: Indices in v of the rates on which these rows depend.
    """

    rows: Indices
    rates: Indices


@dataclass(frozen=True)
class _Correction:
    """The correction of one part.

    Attributes:
        robot: The robot with displaced places, in which the part closes.
        size: The largest displacement, [rad] or lengths of the loop.
        poses: Regular poses of this robot in which the part closes.
    """

    robot: "_Robot"
    size: float
    poses: list[Array]


def correct_geometry(mechanism: Mechanism) -> Mechanism:
    """The mechanism with overconstrained loops that close in all their poses.

    Warns:
        DescriptionWarning: If placements were displaced, because they are rounded.

    Raises:
        ClosureError: For an overconstrained loop that is open in its best pose by more than
            `ROUNDED_PLACEMENTS`, but less than `_FAR`.
    """
    with announced(f"model {mechanism.model.name}: checking its closures"):
        original = _Robot(mechanism)
        start = original.start()
        rates = np.arange(mechanism.model.nv)
        # Independent rows cannot contradict each other. The suspects are all other parts: those
        # with redundant rows, but also those that are open at the start or have no clear rank.
        suspects = [
            part for part in original.parts if not original.has_independent_rows(start, part)
        ]
        if not suspects:
            return mechanism
        # Most parts close without a correction, and a few poses show this.
        poses = [original.closest(start, rates, width) for width in _POSES[:_FIRST_POSES]]
        suspects = [part for part in suspects if not all(original.closes(q, part) for q in poses)]
        if not suspects:
            return mechanism
        poses += [original.closest(start, rates, width) for width in _POSES[_FIRST_POSES:]]
        return _corrected(original, suspects, start, poses)


def _corrected(
    original: "_Robot", parts: Sequence[_Part], start: Array, poses: Sequence[Array]
) -> Mechanism:
    """The mechanism with these parts corrected, one after the other, where that is justified.

    The poses are those around the start.
    """
    corrected = original
    # For the warning: the largest error of each row of the original, shape (rows,).
    errors_before = np.zeros(len(original.loops.f))
    for part in parts:
        original.require_closing([start, *poses], part)
        correction = _justified_correction(original, corrected, part, start, poses)
        if correction is None:
            continue
        corrected = correction.robot
        for q in correction.poses:
            # The corrected part closes at q. The original stays open there by these errors.
            best = original.closest(q, part.rates)
            errors_before = np.maximum(errors_before, original.errors(best, part))
    if corrected is not original:
        _warn(original.mechanism, corrected.mechanism, errors_before)
    return corrected.mechanism


def _justified_correction(
    original: "_Robot", corrected: "_Robot", part: _Part, start: Array, poses: Sequence[Array]
) -> _Correction | None:
    """A correction of one part, if it is needed, found and justified; else None.

    `corrected` is the robot with the corrections of the parts before. The part is judged on the
    original, and then corrected on `corrected`.
    """
    # Poses where the part is closed as far as rounded placements allow.
    near_closed = [q for q in [start, *poses] if original.gap(q, part) <= ROUNDED_PLACEMENTS]
    rank = _rank_of_overconstrained(original, part, near_closed)
    if rank is None:
        return None  # its rank is not clear, or its rows are independent
    regular_poses = [q for q in near_closed if original.rank(q, part) == rank]
    # A few poses of an exact loop may stay open, if no closed pose is near them. So the part needs
    # no correction if it closes in more than half of the poses: then the median of the gaps is 0.
    if np.median([original.gap(q, part) for q in regular_poses]) == 0:
        return None
    correction = _find_correction(corrected, part, rank, start, regular_poses)
    if correction is None:
        return None  # no small displacement makes it close
    if not _is_justified(correction, original, part, start):
        return None
    return correction


def _is_justified(correction: _Correction, original: "_Robot", part: _Part, start: Array) -> bool:
    """Whether the errors of the original are rounding, and not what somebody wanted.

    The four reasons against a correction have the numbers of the list in the module's docstring.
    """
    # 1. The original is far from closed at a pose where the corrected part closes.
    for q in correction.poses:
        if original.gap(original.closest(q, part.rates), part) > ROUNDED_PLACEMENTS:
            return False
    # 2. The original closes at the start, and its numbers do not look rounded.
    rounding = original.rounding(start, part)
    if rounding == 0:
        return False
    # 3. The original moves from a closed home: its numbers look rounded, but they are exact.
    home = home_of(original.mechanism)
    if home is not None and original.gap(home, part) == 0 and original.moves(home, part):
        return False
    # 4. Rounding does not explain the displacements, and the original moves. If it does not move,
    # it is corrected all the same: nobody wants a rigid frame as a loop of a robot.
    is_explained = correction.size <= EXPLAINED * rounding
    return is_explained or not original.moves(start, part)


def _rank_of_overconstrained(robot: "_Robot", part: _Part, poses: Sequence[Array]) -> int | None:
    """The rank of Phi in an overconstrained part, from poses in which the part is closed.

    Near singularities the rank is lower, so the result is the largest rank that at least three
    poses have. It is None if the rank is not clear, or if the rows are independent.
    """
    counts = Counter(robot.rank(q, part) for q in poses)
    ranks = [rank for rank, count in counts.items() if rank is not None and count > 2]
    if not ranks or max(ranks) == len(part.rows):
        return None
    return max(ranks)


def _find_correction(
    robot: "_Robot", part: _Part, rank: int, start: Array, poses: Sequence[Array]
) -> _Correction | None:
    """A correction with which a part closes in all regular poses; None if none is found.

    Regular poses have the rank `rank`. Each try displaces the places further, so that the part
    closes in the given poses. Then other poses around the start check the result. If the part stays
    open in a regular one of them, the next try has these poses too.
    """
    corrected = robot
    poses_to_close = list(poses)
    total = np.zeros(6 * len(robot.places(part)))  # the sum of the displacements
    for k in range(_TRIES):
        # The poses were found with earlier placements: those of the file, or those of tries before
        # this one. So the part may be open in them. Each step of `with_displacements` moves the
        # joints too, so that the part closes.
        corrected, displacements = corrected.with_displacements(poses_to_close, part, rank)
        total += displacements
        # Random steps have other directions if their widths differ by 0.001 or more. So each try
        # has other poses.
        widths = [0.0, *(_CHECKS + k / 100)]
        checks = [corrected.closest(start, part.rates, width) for width in widths]
        # A pose with a larger gap has no closed pose near it. A pose of lower rank is singular.
        near_closed = [q for q in checks if corrected.gap(q, part) <= ROUNDED_PLACEMENTS]
        regular_poses = [q for q in near_closed if corrected.rank(q, part) == rank]
        if regular_poses and all(corrected.gap(q, part) == 0 for q in regular_poses):
            size = float(np.abs(total).max(initial=0.0))
            return _Correction(corrected, size, poses=regular_poses)
        poses_to_close += regular_poses
    return None


class _Robot:
    """A mechanism with methods that find and judge its poses, and displace its places.

    Attributes:
        mechanism: The mechanism.
        loops: Its loops.
        parts: The parts of its loops.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.loops = Loops(mechanism.model, mechanism.closures)
        self._assembly = Assembly(mechanism, self.loops)
        self.parts = list[_Part]()
        rows = np.flatnonzero(self.loops.holonomic)
        for members, rates in connected(self.loops.touched[rows]):  # members: indices in `rows`
            if len(members):
                self.parts.append(_Part(rows[members], rates))

    # --- poses ------------------------------------------------------------------------------

    def start(self) -> Array:
        """A pose near home, or near `pin.neutral`, in which all parts close if possible.

        In each try, only the parts that are still open move.
        """
        home = home_of(self.mechanism)
        q = pin.neutral(self.mechanism.model) if home is None else home
        for width in _STARTS:
            open_parts = [part for part in self.parts if self.gap(q, part) > ROUNDED_PLACEMENTS]
            if not open_parts:
                break
            q = self.closest(q, np.concatenate([part.rates for part in open_parts]), width)
        return q

    def closest(self, q: Array, rates: Indices, width: float = 0.0) -> Array:
        """The pose of least gaps near q, after a random step of some rates.

        The same width always gives the same step, another width another direction. Small singular
        values, which rounded placements make, count as zero.
        """
        step = np.zeros(self.mechanism.model.nv)
        step[rates] = random_step(self.mechanism, width)[rates]
        q = pin.integrate(self.mechanism.model, q, step)
        return self._assembly.closer(q, rates, ROUNDED_PLACEMENTS)

    def moves(self, q: Array, part: _Part) -> bool:
        """Whether a part closes to the rounding of floats along a motion from near q.

        Unlike in `closest`, small singular values count here: rows that contradict each other
        because placements are rounded must be satisfied too.
        """
        rates = part.rates
        model = self.mechanism.model
        scale = self.mechanism.rate_scale[rates]
        q = self._assembly.closer(q, rates)
        random = random_step(self.mechanism, 1.0)[rates] / scale  # free of units
        for _ in range(_MOTION_STEPS):
            if self.gap(q, part) != 0:
                return False
            motions = free_motions(self._Phi(q, part))
            if not motions.shape[1]:
                return False
            # Step in the direction of the motion that is nearest to the random one, and close the
            # loops again. `step` has the rates of the part, free of units.
            along = motions @ (motions.T @ random)
            step = _MOTION * along / np.abs(along).max()
            step_of_all_rates = np.zeros(model.nv)
            step_of_all_rates[rates] = step * scale
            guess = pin.integrate(model, q, step_of_all_rates)
            ahead = self._assembly.closer(guess, rates)
            moved = pin.difference(model, q, ahead)[rates] / scale
            if moved.dot(step) < step.dot(step) / 2:
                return False  # closing the loops leads back by more than half of the step
            q = ahead
        return self.gap(q, part) == 0

    # --- at a pose --------------------------------------------------------------------------

    def gap(self, q: Array, part: _Part) -> float:
        """Largest error of a part, free of units; 0 if it is closed to the rounding of floats."""
        return self._assembly.gap(q, part.rows)

    def closes(self, q: Array, part: _Part) -> bool:
        """Whether a part is closed to the rounding of floats, and its rank is clear."""
        return self.gap(q, part) == 0 and self.rank(q, part) is not None

    def has_independent_rows(self, q: Array, part: _Part) -> bool:
        """Whether a part is closed as far as rounded placements allow, and no row is redundant."""
        return self.gap(q, part) <= ROUNDED_PLACEMENTS and self.rank(q, part) == len(part.rows)

    def rank(self, q: Array, part: _Part) -> int | None:
        """Rank of Phi in a part; None if it is not clear which singular values are rounding."""
        values = np.linalg.svd(self._Phi(q, part), compute_uv=False)  # in decreasing order
        values = np.append(values, 0.0)  # so that there is a value after the last one that counts
        rank = int((values > ROUNDED_PLACEMENTS * values.max(initial=1.0)).sum())
        # If no value counts, rounding is compared with 1, the usual size, as in the line above.
        smallest = values[rank - 1] if rank else 1.0
        largest_rounding = values[rank]
        return rank if largest_rounding <= _RANK_GAP * smallest else None

    def errors(self, q: Array, part: _Part) -> Array:
        """|f| at q in the open rows of a part, [m] or [rad], and 0 in other rows, shape (rows,)."""
        open_rows = self._assembly.open_rows(q, part.rows)  # evaluates the loops at q
        errors = np.zeros(len(self.loops.f))
        errors[open_rows] = np.abs(self.loops.f[open_rows])
        return errors

    def require_closing(self, poses: Sequence[Array], part: _Part) -> None:
        """Refuse an overconstrained part that is open in all poses by more than rounding explains.

        A part that is open by more than `_FAR` is not refused.
        """
        best = min(poses, key=lambda q: self.gap(q, part))
        rank = self.rank(best, part)
        is_open = ROUNDED_PLACEMENTS < self.gap(best, part) < _FAR
        is_overconstrained = rank is not None and rank < len(part.rows)
        if not (is_open and is_overconstrained):
            return
        errors = self.errors(best, part)
        scaled = errors * self.mechanism.row_scale
        bound = _NAMED * scaled.max()
        names = [
            str(closure)
            for closure, rows in zip(self.mechanism.closures, self.loops.slices, strict=True)
            if scaled[rows].max(initial=0.0) > bound
        ]
        raise ClosureError(
            f"the loops at {listed(names, 4)} stay open by {errors.max():.3g} (m or rad) in the "
            "best pose; correct the placements and axes of their joints and frames",
            float(errors.max()),
        )

    def _Phi(self, q: Array, part: _Part) -> Array:
        """Phi of a part at q, free of units, shape (its rows, its rates)."""
        return scaled_Phi(self.mechanism, self.loops, q)[np.ix_(part.rows, part.rates)]

    # --- placements -------------------------------------------------------------------------

    def with_displacements(
        self, poses: Sequence[Array], part: _Part, rank: int
    ) -> tuple["_Robot", Array]:
        """A robot with displaced places, in which a part closes next to these poses.

        Also returns the displacements d of all places, [linear; angular] for each, in lengths of
        the loop and [rad], shape (6 places,).
        """
        places = self.places(part)
        robot = self
        total = np.zeros(6 * len(places))
        # Each step of Gauss-Newton's method displaces the places by d, and moves the joints of each
        # pose such that the loops close after the displacement.
        for _ in range(_STEPS):
            equations_of_poses = [robot._equations(q, part, rank, places) for q in poses]
            # The equations N^T F d = -N^T f of all poses, one pose below the other.
            N_F = np.vstack([equations.N_F for equations in equations_of_poses])
            N_f = np.concatenate([equations.N_f for equations in equations_of_poses])
            error = float(np.abs(N_f).max(initial=0.0))
            if error < _SOLVED:
                break
            # Their shortest least-squares solution d.
            d = -np.linalg.lstsq(N_F, N_f, rcond=max(_ROUNDED, _NOISE * error))[0]
            # The new poses are computed before the places are displaced. This is right, because
            # the equations of the present places already include the displacements, as F d.
            poses = [
                robot._followed(q, part, equations, d)
                for q, equations in zip(poses, equations_of_poses, strict=True)
            ]
            robot = robot._displaced(part, places, d)
            total += d
        return robot, total

    def _equations(
        self, q: Array, part: _Part, rank: int, places: Mapping[str, int | None]
    ) -> "_Equations":
        """The equations N^T (f + F d) = 0 at one pose, for Phi of this rank."""
        U, s, Vt = np.linalg.svd(self._Phi(q, part))  # evaluates the loops at q
        row_scale = self.mechanism.row_scale[part.rows]
        f = self.loops.f[part.rows] * row_scale
        F = by_displacements(self.loops, places)[part.rows] * row_scale[:, None]
        F = F * self._units_of_d(part, places)
        N = U[:, rank:]
        # V diag(1 / s) U^T, with the first singular values only
        pseudoinverse = (Vt[:rank].T / s[:rank]) @ U[:, :rank].T
        return _Equations(f=f, F=F, N_f=N.T @ f, N_F=N.T @ F, Phi_inverse=pseudoinverse)

    def _followed(self, q: Array, part: _Part, equations: "_Equations", d: Array) -> Array:
        """The pose next to q after displacements d: Phi dq = -(f + F d), by least squares."""
        step = np.zeros(self.mechanism.model.nv)
        step[part.rates] = -equations.Phi_inverse @ (equations.f + equations.F @ d)
        return pin.integrate(self.mechanism.model, q, step * self.mechanism.rate_scale)

    def _displaced(self, part: _Part, places: Mapping[str, int | None], d: Array) -> "_Robot":
        """The robot with places displaced by d."""
        in_metres_and_radians = (self._units_of_d(part, places) * d).reshape(-1, 6)
        changes = dict(zip(places, in_metres_and_radians, strict=True))
        model = displaced(self.mechanism.model, changes)
        return _Robot(replace(self.mechanism, model=model))

    def _units_of_d(self, part: _Part, places: Mapping[str, int | None]) -> Array:
        """The units of d: the length of the loops, [m], or 1 rad, shape (6 places,)."""
        return np.tile(np.repeat([self._length(part), 1.0], 3), len(places))

    def _length(self, part: _Part) -> float:
        """The length of the loops of a part, [m]; the least one if there are several."""
        return float(self.mechanism.row_lengths[part.rows].min())

    def rounding(self, q: Array, part: _Part) -> float:
        """Size of the rounding of a part, [rad] or lengths of the loop.

        It is the largest of the rounding of lengths, the rounding of angles, and the gap that is
        left at q. It is 0 if the part closes at q and its numbers are not rounded.
        """
        lengths = list[float]()
        angles = list[float]()
        for place in self.places(part):
            _, placement = place_of(self.mechanism.model, place)
            lengths += placement.translation.tolist()
            angles += pin.rpy.matrixToRpy(placement.rotation).tolist()
        # Most files write angles with as many digits as lengths. So the digits of lengths are
        # judged from all numbers together, because there may be too few lengths to judge alone.
        # Angles may have more digits, such as 1.5708 beside lengths with three digits. So angles
        # are also judged alone, and their rounding is the smaller one of both results.
        half_digit_of_all = half_a_digit(np.array(lengths + angles))
        half_digit_of_angles = min(half_digit_of_all, half_a_digit(np.array(angles)))
        gap = self.gap(self.closest(q, part.rates), part)
        return max(half_digit_of_all / self._length(part), half_digit_of_angles, gap)

    def places(self, part: _Part) -> dict[str, int | None]:
        """The places that may be displaced, by their names: None for a joint, the index of a frame.

        They are the joints of the part, and the frames of its closures. A frame that several
        closures use is not displaced, because the closures may belong to different parts. A frame
        with the name of a joint is not displaced either: as a place, this name is the joint.
        """
        model = self.mechanism.model
        closures = self.mechanism.closures
        uses = Counter[str]()
        for closure in closures:
            uses.update(frames_of(closure))
        places = dict[str, int | None]()
        for j in range(1, model.njoints):
            if model.joints[j].idx_v in part.rates:
                places[model.names[j]] = None
        ends = set[str]()
        for closure, rows in zip(closures, self.loops.slices, strict=True):
            if np.isin(part.rows, range(rows.start, rows.stop)).any():
                ends.update(frames_of(closure))
        for name in sorted(ends - {"universe"}):
            if uses[name] == 1 and not model.existJointName(name):
                places[name] = frame_id(model, name)
        return places


@dataclass(frozen=True)
class _Equations:
    """The equations N^T (f + F d) = 0 of a part at a pose; d is in lengths of the loop and [rad].

    Attributes:
        f: Errors, free of units, shape (rows,).
        F: Their derivatives by d, shape (rows, 6 places).
        N_f: N^T f, the errors that no motion of the joints removes, shape (rows - rank,).
        N_F: N^T F, shape (rows - rank, 6 places).
        Phi_inverse: Pseudoinverse of Phi, shape (rates, rows).
    """

    f: Array
    F: Array
    N_f: Array
    N_F: Array
    Phi_inverse: Array


# --- the warning ----------------------------------------------------------------------------------


def _warn(before: Mechanism, after: Mechanism, errors: Array) -> None:
    """Say how far loops were open, and how far placements were displaced.

    `errors` are |f| of all rows, [m], or [rad] for rows that hold a turn, shape (rows,).
    """
    closure_of_row = list[str]()
    turns = list[bool]()
    for closure in before.closures:
        for row in closure.rows:
            closure_of_row.append(str(closure))
            turns.append(row.startswith("turn"))  # the name of a row that holds a turn
    of_turns = np.array(turns)
    open_loops = list(dict.fromkeys(np.array(closure_of_row)[errors > 0].tolist()))
    metres, radians = _largest_displacement(before.model, after.model)
    warn_caller(
        f"model {before.model.name}: its placements are rounded, so that the loops at "
        f"{listed(open_loops, 4)} close only to {errors[~of_turns].max(initial=0.0):.2g} m and "
        f"{np.degrees(errors[of_turns].max(initial=0.0)):.2g} degrees; placements were corrected "
        f"by up to {metres:.2g} m and {np.degrees(radians):.2g} degrees, so that the loops close "
        "in all poses; write more digits",
        DescriptionWarning,
    )


def _largest_displacement(before: pin.Model, after: pin.Model) -> tuple[float, float]:
    """The largest displacement of joints and frames, [m] and [rad]."""
    pairs = list(zip(before.jointPlacements, after.jointPlacements, strict=True))
    frames = zip(before.frames, after.frames, strict=True)
    pairs += [(a.placement, b.placement) for a, b in frames]
    twists = np.abs([pin.log6(a.actInv(b)).vector for a, b in pairs])
    return float(twists[:, :3].max()), float(twists[:, 3:].max())
