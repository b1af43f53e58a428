# SPDX-License-Identifier: BSD-2-Clause
"""Corrects rounded placements that keep overconstrained loops from moving.

An overconstrained loop moves only because its axes are parallel, meet in one point, or the like.
With rounded placements they do so only roughly, and redundant rows contradict each other. The
placements of such a loop are displaced as little as possible, so that it closes in all poses.

At a pose, motions of the joints change f within the range of Phi only. Let the columns of U be an
orthonormal basis of the rest: the left singular vectors of Phi beyond its rank. No motion changes
U^T f. So the loops close next to this pose if displacements d of the placements fulfil

    U^T (f + F d) = 0,    F = df/dd.

This must hold in many poses at once, home among them. Gauss-Newton's method finds the shortest d.
With rounded placements, Phi has no exact rank. The loops are closed by least squares; there, the
singular values of the mechanism are orders larger than those that rounding makes, and the rank is
the number of the former.

Axes may be almost parallel on purpose. So a correction is kept only where the errors of the
original are rounding. `_is_justified` refuses it

1. if the original is far from closed where the corrected loop closes: that is another robot;
2. if the original closes exactly at the start, and its numbers are not rounded;
3. if the original moves as it is, from a home that is closed to the rounding of floats;
4. if the original moves as it is, and the displacements are larger than the rounding of its
   numbers, or the gap at the start, explains.
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
from .guesses import home_of, random_step
from .loops import Loops, connected
from .ranks import free_motions, scaled_Phi

# The robots of test_rounded_numbers are corrected as well with a third and three times `_GAP` and
# `_FAR`, with a tenth and ten times `_NOISE`, and with 0.1 and 0.5 for `_MANY`.

#: Widths of random displacements until the loops close, [rad] or lengths of the loop. The first try
#: starts from home or `pin.neutral`, each further one from the pose of the last.
_STARTS = np.linspace(0.0, 2.0, 21)
#: Widths of random displacements from the start to poses in which a corrected loop must close.
_POSES = np.linspace(0.1, 1.0, 16)
#: The number of these poses that tell whether a loop closes as it is.
_LOOKS = 3
#: Widths of random displacements to poses that check the result.
_CHECKS = np.linspace(0.15, 1.05, 8)
#: The rank is clear if the largest singular value that rounding makes is at most this part of the
#: smallest one of the mechanism: it stays the same even if rounding makes ten times as much.
_GAP = 0.1
#: Loops that stay open by more in all poses may be far from the poses in which they close.
_FAR = 10 * ROUNDED_PLACEMENTS
#: Gauss-Newton's method: most steps. Each step squares the gap, so that three are enough from
#: `ROUNDED_PLACEMENTS`; more are needed where small singular values count only as the gap falls.
_STEPS = 12
#: It ends at this gap, some tens of roundings of numbers of size one.
_CLOSED = 1e-14
#: Singular values of its equations count as zero below this part of the largest one: smaller ones
#: are rounding. With 1e-11, the correction of a scissor depends on the unit of length.
_LEAST = 1e-9
#: They count as zero also below this multiple of the gap, as the equations are wrong by about the
#: gap.
_NOISE = 30.0
#: Corrections of a part: in the poses, then twice with poses in which it stayed open.
_TRIES = 3
#: A loop moves as it is if it closes after each of some steps: their number.
_MOTION_STEPS = 3
#: Their length, [rad] or lengths of the loop. A rigid part may seem closed up to some 1e-5 in a
#: singular pose, where its error grows with the square of the motion.
_MOTION = 0.05


@dataclass(frozen=True)
class _Part:
    """Loops that share no row and no rate with others.

    Attributes:
        rows: Indices of the rows that have an error.
        rates: Indices of the rates that they connect.
    """

    rows: Indices
    rates: Indices


@dataclass(frozen=True)
class _Correction:
    """What corrects one part: a robot in which it closes.

    Attributes:
        robot: The robot with displaced placements.
        size: The largest displacement, [rad] or lengths of the loop.
        poses: Regular poses in which the part closes.
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
        # Independent rows contradict each other nowhere.
        suspects = [p for p in original.parts if not original.has_independent_rows(start, p)]
        if not suspects:
            return mechanism
        # A few poses show most parts that close as they are; only the others need all poses.
        poses = [original.closest(start, rates, width) for width in _POSES[:_LOOKS]]
        suspects = [p for p in suspects if not all(original.closes(q, p) for q in poses)]
        if not suspects:
            return mechanism
        poses += [original.closest(start, rates, width) for width in _POSES[_LOOKS:]]
        return _corrected(original, suspects, start, poses)


def _corrected(
    original: "_Robot", parts: Sequence[_Part], start: Array, poses: Sequence[Array]
) -> Mechanism:
    """The mechanism with these parts corrected, one after the other, where that is justified.

    The poses are those around the start.
    """
    corrected = original
    errors_before = np.zeros(len(original.loops.f))  # for the warning
    for part in parts:
        original.require_closing([start, *poses], part)
        correction = _justified_correction(original, corrected, part, start, poses)
        if correction is None:
            continue
        corrected = correction.robot
        for q in correction.poses:
            error = original.errors(original.closest(q, part.rates), part)
            errors_before = np.maximum(errors_before, error)
    if corrected is not original:
        _warn(original.mechanism, corrected.mechanism, errors_before)
    return corrected.mechanism


def _justified_correction(
    original: "_Robot", corrected: "_Robot", part: _Part, start: Array, poses: Sequence[Array]
) -> _Correction | None:
    """A correction of one part of `corrected`, which has the placements of the parts before.

    There is none if the part closes as it is, if no small displacement makes it close, or if it is
    not justified.
    """
    closed = [q for q in [start, *poses] if original.gap(q, part) <= ROUNDED_PLACEMENTS]
    rank = _rank_of_overconstrained(original, part, closed)
    if rank is None:
        return None  # its rank is not clear, or its rows are independent
    fitting = [q for q in closed if original.rank(q, part) == rank]
    # Exact loops may stay open in a few poses, next to which there is no closed one.
    closes_mostly = np.median([original.gap(q, part) for q in fitting]) == 0
    if closes_mostly:
        return None
    correction = _find_correction(corrected, part, rank, start, fitting)
    if correction is None:
        return None  # no small displacement makes it close
    if not _is_justified(correction, original, part, start):
        return None
    return correction


def _is_justified(correction: _Correction, original: "_Robot", part: _Part, start: Array) -> bool:
    """Whether the errors of the original are rounding, and not what somebody wanted."""
    # The numbers of the reasons are those in the text of the module.
    for q in correction.poses:
        if original.gap(original.closest(q, part.rates), part) > ROUNDED_PLACEMENTS:
            return False  # 1
    rounding = original.rounding(start, part)
    if rounding == 0:
        return False  # 2: it closes at the start, perhaps in this pose only
    home = home_of(original.mechanism)
    if home is not None and not original.gap(home, part) and original.moves(home, part):
        # 3: loops with rounded placements would be open at the home of the file. So its short
        # numbers, such as 0.25, are exact.
        return False
    if correction.size <= EXPLAINED * rounding:
        return True  # the errors are rounding
    # 4: if it does not move as it is, it would be a rigid frame without the correction.
    return not original.moves(start, part)


def _rank_of_overconstrained(robot: "_Robot", part: _Part, poses: Sequence[Array]) -> int | None:
    """The rank of an overconstrained part in poses in which it is closed; None if there is none.

    It is the largest rank of at least three poses, as ranks are lower near singularities.
    """
    counts = Counter(robot.rank(q, part) for q in poses)
    ranks = [rank for rank, count in counts.items() if rank is not None and count > 2]
    if not ranks or max(ranks) == len(part.rows):
        return None
    return max(ranks)


def _find_correction(
    robot: "_Robot", part: _Part, rank: int, start: Array, poses: Sequence[Array]
) -> _Correction | None:
    """A correction with which a part closes in these poses and in others; None if none is found.

    Each try displaces the placements further, so that the part closes in the poses. Then other
    poses around the `start` check it. If the part stays open in a regular one of them, the next try
    has all these regular poses too.
    """
    corrected = robot
    # Poses of earlier placements: `with_displacements` moves the joints on to closed poses.
    fitting = list(poses)
    total = np.zeros(6 * len(robot.places(part)))  # the sum of the displacements
    for k in range(_TRIES):
        corrected, displacements = corrected.with_displacements(fitting, part, rank)
        total += displacements
        # Another width gives another random direction: these poses are not those of other tries.
        widths = [0.0, *(_CHECKS + k / 100)]
        checks = [corrected.closest(start, part.rates, width) for width in widths]
        # Poses with larger gaps are next to no closed pose, and those of lower rank are singular.
        closed = [q for q in checks if corrected.gap(q, part) <= ROUNDED_PLACEMENTS]
        regular = [q for q in closed if corrected.rank(q, part) == rank]
        if regular and not any(corrected.gap(q, part) for q in regular):
            size = float(np.abs(total).max(initial=0.0))
            return _Correction(corrected, size, poses=regular)
        fitting += regular
    return None


class _Robot:
    """A mechanism, with its poses in which the loops are closed as far as rounding allows.

    Attributes:
        mechanism: The mechanism.
        loops: Its loops.
        parts: Loops that share no row and no rate.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.loops = Loops(mechanism.model, mechanism.closures)
        self._assembly = Assembly(mechanism, self.loops)
        self.parts = list[_Part]()
        rows = np.flatnonzero(self.loops.holonomic)
        for in_part, rates in connected(self.loops.touched[rows]):
            if len(in_part):
                self.parts.append(_Part(rows[in_part], rates))

    # --- poses ------------------------------------------------------------------------------

    def start(self) -> Array:
        """A pose near home, or near `pin.neutral`, in which as many parts as possible close."""
        home = home_of(self.mechanism)
        q = pin.neutral(self.mechanism.model) if home is None else home
        for width in _STARTS:
            open_parts = [p for p in self.parts if self.gap(q, p) > ROUNDED_PLACEMENTS]
            if not open_parts:
                break
            q = self.closest(q, np.concatenate([part.rates for part in open_parts]), width)
        return q

    def closest(self, q: Array, rates: Indices, width: float = 0.0) -> Array:
        """The pose next to q with the smallest gaps, after a random displacement of some rates.

        The same width always gives the same displacement, another width another direction.
        """
        step = np.zeros(self.mechanism.model.nv)
        step[rates] = random_step(self.mechanism, width)[rates]
        q = pin.integrate(self.mechanism.model, q, step)
        return self._assembly.closer(q, rates, ROUNDED_PLACEMENTS)

    def moves(self, q: Array, part: _Part) -> bool:
        """Whether a part closes, to rounding, along a motion from near q.

        All rows must be satisfied, also those that contradict each other because placements are
        rounded. So the loops are closed by `Assembly.closer` with its own tolerance: `closest`
        takes the small singular values of such rows for zero.
        """
        rates = part.rates
        model = self.mechanism.model
        scale = self.mechanism.rate_scale[rates]
        q = self._assembly.closer(q, rates)
        random = random_step(self.mechanism, 1.0)[rates] / scale  # free of units
        for _ in range(_MOTION_STEPS):
            if self.gap(q, part):
                return False
            motions = free_motions(self._Phi(q, part))
            if not motions.shape[1]:
                return False
            along = motions @ (motions.T @ random)
            step = _MOTION * along / np.abs(along).max()
            rates_step = np.zeros(model.nv)
            rates_step[rates] = step * scale
            ahead = self._assembly.closer(pin.integrate(model, q, rates_step), rates)
            moved = pin.difference(model, q, ahead)[rates] / scale
            if moved.dot(step) < step.dot(step) / 2:
                return False  # closing the loops leads back by more than half of the step
            q = ahead
        return not self.gap(q, part)

    # --- at a pose --------------------------------------------------------------------------

    def gap(self, q: Array, part: _Part) -> float:
        """How far a part is open, free of units; 0 if it is closed."""
        return self._assembly.gap(q, part.rows)

    def closes(self, q: Array, part: _Part) -> bool:
        """Whether a part is closed to rounding at q, and its rank is clear."""
        return not self.gap(q, part) and self.rank(q, part) is not None

    def has_independent_rows(self, q: Array, part: _Part) -> bool:
        """Whether a part is closed and no row is redundant, so that none contradict each other."""
        return self.gap(q, part) <= ROUNDED_PLACEMENTS and self.rank(q, part) == len(part.rows)

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
        errors[part.rows] = np.abs(self.loops.f[part.rows])
        return errors

    def require_closing(self, poses: Sequence[Array], part: _Part) -> None:
        """Refuse an overconstrained part that is open in all poses by more than rounding.

        A part that is open by more than `_FAR` passes: its poses may be far from closed ones.
        """
        best = min(poses, key=lambda q: self.gap(q, part))
        rank = self.rank(best, part)
        is_open = ROUNDED_PLACEMENTS < self.gap(best, part) < _FAR
        is_overconstrained = rank is not None and rank < len(part.rows)
        if not (is_open and is_overconstrained):
            return
        errors = self.errors(best, part)
        scaled = errors * self.mechanism.row_scale
        # Beside the open rows, the others have errors of rounding.
        least = ROUNDED_PLACEMENTS * scaled.max()
        names = [
            str(closure)
            for closure, rows in zip(self.mechanism.closures, self.loops.slices, strict=True)
            if scaled[rows].max(initial=0.0) > least
        ]
        raise ClosureError(
            f"the loops at {listed(names, 4)} stay open by {errors.max():.3g} (m or rad) in the "
            "best pose; correct the placements and axes of their joints and frames",
            float(errors.max()),
        )

    def _Phi(self, q: Array, part: _Part) -> Array:
        return scaled_Phi(self.mechanism, self.loops, q)[np.ix_(part.rows, part.rates)]

    # --- placements -------------------------------------------------------------------------

    def with_displacements(
        self, poses: Sequence[Array], part: _Part, rank: int
    ) -> tuple["_Robot", Array]:
        """The robot with displaced placements, so that a part closes next to these poses.

        Also returns the displacements d of all places, [linear; angular] for each, in lengths of
        the loop and [rad], shape (6 places,).
        """
        places = self.places(part)
        # Each step of Gauss-Newton's method makes another robot. Its joints follow in each pose.
        robot = self
        total = np.zeros(6 * len(places))
        for _ in range(_STEPS):
            equations = [robot._equations(q, part, rank, places) for q in poses]
            gap = max(float(np.abs(x.f_left).max(initial=0.0)) for x in equations)
            if gap < _CLOSED:
                break
            # The shortest d with U^T (f + F d) = 0 in all poses.
            F_left = np.vstack([x.F_left for x in equations])
            f_left = np.concatenate([x.f_left for x in equations])
            d = -np.linalg.lstsq(F_left, f_left, rcond=max(_LEAST, _NOISE * gap))[0]
            poses = [robot._followed(q, part, x, d) for q, x in zip(poses, equations, strict=True)]
            robot = robot._displaced(part, places, d)
            total += d
        return robot, total

    def _equations(
        self, q: Array, part: _Part, rank: int, places: Mapping[str, int | None]
    ) -> "_Equations":
        """The equations U^T (f + F d) = 0 at one pose, d in lengths of the loop and [rad].

        The columns of U in the text of the module are `U_left` here. G is the pseudoinverse of Phi
        with this rank.
        """
        U, s, Vt = np.linalg.svd(self._Phi(q, part))  # evaluates the loops at q
        row_scale = self.mechanism.row_scale[part.rows]
        f = self.loops.f[part.rows] * row_scale
        F = by_displacements(self.loops, places)[part.rows] * row_scale[:, None]
        F = F * self._units_of_d(part, places)
        U_left = U[:, rank:]
        G = Vt[:rank].T / s[:rank] @ U[:, :rank].T
        return _Equations(f=f, F=F, f_left=U_left.T @ f, F_left=U_left.T @ F, G=G)

    def _followed(self, q: Array, part: _Part, equations: "_Equations", d: Array) -> Array:
        """The pose next to q after displacements d: joint motions remove what they can of f."""
        step = np.zeros(self.mechanism.model.nv)
        step[part.rates] = -equations.G @ (equations.f + equations.F @ d)
        return pin.integrate(self.mechanism.model, q, step * self.mechanism.rate_scale)

    def _displaced(self, part: _Part, places: Mapping[str, int | None], d: Array) -> "_Robot":
        """The robot with places displaced by d."""
        in_metres_and_radians = (self._units_of_d(part, places) * d).reshape(-1, 6)
        changes = dict(zip(places, in_metres_and_radians, strict=True))
        model = displaced(self.mechanism.model, changes)
        return _Robot(replace(self.mechanism, model=model))

    def _units_of_d(self, part: _Part, places: Mapping[str, int | None]) -> Array:
        """One unit of each displacement: a length of the loop, [m], or 1 rad, shape (6 places,)."""
        length = 1 / self._per_length(part)
        return np.tile(np.repeat([length, 1.0], 3), len(places))

    def _per_length(self, part: _Part) -> float:
        """One over the length of the loops of a part, [1/m]."""
        return float(1 / self.mechanism.row_lengths[part.rows].min())

    def rounding(self, q: Array, part: _Part) -> float:
        """Size of the rounding of a part, [rad] or lengths of the loop.

        It is the rounding of its placements, or the gap that is left at q, if larger. It is 0 if
        the part closes at q and its numbers are not rounded.
        """
        # Files write angles with as many digits as lengths, so that all numbers count together.
        numbers = list[float]()
        for place in self.places(part):
            _, placement = place_of(self.mechanism.model, place)
            numbers += [*placement.translation, *pin.rpy.matrixToRpy(placement.rotation)]
        last_digit = half_a_digit(np.array(numbers)) * self._per_length(part)
        return max(last_digit, self.gap(self.closest(q, part.rates), part))

    def places(self, part: _Part) -> dict[str, int | None]:
        """The places that may be displaced: joints of a part, and frames of one closure only.

        The keys are names. The value of a joint is None, that of a frame its index. A name that
        joints and frames share means the joint, so such a frame is not displaced.
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
    """How the errors of a part depend on displacements d at a pose, all free of units.

    Attributes:
        f: Errors, shape (rows,).
        F: Their derivatives by d, shape (rows, displacements).
        f_left: U^T f, the part of f that no motion of joints removes.
        F_left: U^T F: d has to fulfil f_left + F_left d = 0.
        G: Joints move by -G f to remove the rest of f, shape (rates, rows).
    """

    f: Array
    F: Array
    f_left: Array
    F_left: Array
    G: Array


# --- derivatives by displacements ----------------------------------------------------------------


def by_displacements(loops: Loops, places: Mapping[str, int | None]) -> Array:
    """Derivatives of f by displacements of places, see `geometry`, shape (rows, 6 places).

    A place is a joint, with None, or a frame, with its index.
    """
    model = loops.model
    W = loops.W
    by = np.zeros((len(loops.f), len(places), 6))
    for k, (place, frame) in enumerate(places.items()):
        # Column i: the twist [v; omega] in the world of a unit of displacement i, linear along the
        # axes of the body that carries the place, angular about the axes of the place.
        body, placement = place_of(model, place)
        oMcarrier = loops.data.oMi[loops.tree.bodies[body]]
        twists = (oMcarrier * placement).action
        twists[:3, :3] = oMcarrier.rotation
        for rows in loops.of_frames:
            frame_b, frame_a = rows.frames  # in the normal tree, which keeps the indices of frames
            moves_b = _moves(model, place, frame, frame_b)
            moves_a = _moves(model, place, frame, frame_a)
            W_b = W[rows.at, :6]  # f_dot = W_b twist_b + W_a twist_a
            W_a = W[rows.at, 6:]
            # A place that moves both frames in the same way does not change the closure.
            if moves_b and not moves_a:
                by[rows.at, k] = W_b @ twists
            if moves_a and not moves_b:
                by[rows.at, k] = W_a @ twists
    return by.reshape(len(by), -1)


def _moves(model: pin.Model, place: str, frame: int | None, end: int) -> bool:
    """Whether a displacement of a place moves the frame `end`: itself, or one after the joint."""
    if frame is not None:
        return frame == end
    return model.frames[end].parentJoint in model.subtrees[model.getJointId(place)]


# --- rounded numbers ------------------------------------------------------------------------------

#: A number is rounded if it has fewer digits after the point than this.
_DIGITS = 9
#: Numbers count as rounded to k digits if more than this part of them have at most k digits after
#: the point: the others may be products of rounded numbers.
_MANY = 0.25
#: A number is whole if it is off by less. Random numbers are so with a probability of 2e-4.
_WHOLE = 1e-4


def half_a_digit(numbers: Array) -> float:
    """Half a unit of the last digit of rounded numbers; 0 if they are not rounded.

    Exact short numbers, such as 0.25, count as rounded: the text of a file cannot tell.
    """
    numbers = np.abs(numbers[np.abs(numbers) > 10.0**-_DIGITS])
    for digits in range(1, _DIGITS):
        tens = numbers * 10.0**digits
        # Smaller numbers are almost 0, whether they are rounded or not: rests of 3.14159, say.
        tens = tens[tens > _WHOLE]
        if len(tens) and np.mean(np.abs(tens - tens.round()) < _WHOLE) > _MANY:
            return 0.5 * 10.0**-digits
    return 0.0


# --- the warning ----------------------------------------------------------------------------------


def _warn(before: Mechanism, after: Mechanism, errors: Array) -> None:
    """Say how far loops were open, and how far placements were displaced.

    `errors` are those of f, whose rows are those of all closures in their order: [m], or [rad] for
    rows that hold a turn.
    """
    names = list[str]()
    turns = list[bool]()
    for closure in before.closures:
        for row in closure.rows:
            names.append(str(closure))
            turns.append(row.startswith("turn"))
    of_turns = np.array(turns)
    open_loops = list(dict.fromkeys(np.array(names)[errors > 0].tolist()))
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
