# SPDX-License-Identifier: BSD-2-Clause
"""Dyads: planar loops that two joints close: a hinge, and another hinge or a slide.

Points of the plane are complex numbers, relative to the centre h of the hinge. The closure brings
two points together: r, which the hinge turns about h, and s on its other frame. The other joint

- moves s, if it carries the other frame;
- moves r, if it carries the same frame as the hinge and comes after the hinge;
- moves h and r together, if it comes before the hinge. Relative to h, r stays where it is, and s
  moves in the opposite way.

So it moves one of the two points relative to h. The loop closes where |r| = |s|: there a turn of
the hinge by the angle of s / r brings r to s. There are up to two such positions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from ..model.closures import Closure, Constraint, holds_points
from ..model.tree import frame_id
from .loops import Loops

#: Directions and cosines that differ by less are equal, and so are points, in robot lengths. They
#: differ by rounding of placements, some 1e-15; files with fewer digits are searched from starts.
_EQUAL = 1e-9


def dyad_configurations(
    loops: Loops, closure: Constraint, rates: Indices, q: Array
) -> list[Array] | None:
    """Configurations in which two joints close a loop, the others held; None if it is no dyad.

    `rates` are those of the two joints. The positions of these joints in q do not matter.
    """
    dyad = _dyad(loops, closure, rates, q)
    if dyad is None:
        return None
    moves = dyad.closing_moves()
    if moves is None:
        return None
    configurations = list[Array]()
    for move in moves:
        configuration = q.copy()
        configuration[dyad.entry_of_hinge] += move.of_hinge
        configuration[dyad.entry_of_other] += move.of_other
        configurations.append(configuration)
    return configurations


class _Moves(NamedTuple):
    """Changes of the positions of the hinge, [rad], and of the other joint, [rad] or [m]."""

    of_hinge: float
    of_other: float


class _Dyad(NamedTuple):
    """A loop that a hinge and another joint close; the text of the module says how.

    Attributes:
        entry_of_hinge: Index of the position of the hinge in q.
        entry_of_other: Index of that of the other joint.
        r: The point that the hinge turns, relative to its centre h.
        s: The point on the other frame, relative to h.
        other_moves_r: Whether the other joint moves r relative to h; else it moves s.
        other_motion: How it moves this point.
        sense: 1 if the point moves in the positive sense of the other joint, else -1.
    """

    entry_of_hinge: int
    entry_of_other: int
    r: complex
    s: complex
    other_moves_r: bool
    other_motion: _Turn | _Shift
    sense: float

    def closing_moves(self) -> list[_Moves] | None:
        """Moves that close the loop: |r| = |s|, then the hinge turns r to s; None if no dyad."""
        r = self.r
        s = self.s
        if self.other_moves_r:
            solutions = self.other_motion.to_distance(r, abs(s))
        else:
            solutions = self.other_motion.to_distance(s, abs(r))
        if solutions is None:
            return None
        moves: list[_Moves] = []
        for solution in solutions:
            if self.other_moves_r:
                turn = np.angle(s / solution.point)
            else:
                turn = np.angle(solution.point / r)
            moves.append(_Moves(of_hinge=turn, of_other=self.sense * solution.move))
        return moves


def _dyad(loops: Loops, closure: Constraint, rates: Indices, q: Array) -> _Dyad | None:
    """The dyad of two joints with these rates, or None."""
    model = loops.model
    tree = loops.tree
    if not isinstance(closure, Closure) or not holds_points(closure):
        return None
    joints = [joint for joint in list(model.joints)[1:] if joint.idx_v in rates]
    if [(joint.nq, joint.nv) for joint in joints] != [(1, 1), (1, 1)]:
        return None
    loops.evaluate(q)
    J = loops.data.J.reshape(6, -1) @ tree.S
    twists = J[:, rates].T
    linear = twists[:, :3]
    angular = twists[:, 3:]
    plane = _plane(linear, angular)
    if plane is None:
        return None

    # The two joints are numbered 0 and 1 in the order of the tree.
    hinge = 0 if angular[0].any() else 1
    other = 1 - hinge
    h = _centre(plane, twists[hinge])
    frame_a = frame_id(model, closure.frame_a)
    frame_b = frame_id(model, closure.frame_b)
    point_a = _in_plane(plane, loops.data.oMf[frame_a].translation) - h
    point_b = _in_plane(plane, loops.data.oMf[frame_b].translation) - h
    moves_b = tree.supports[tree.model.frames[frame_b].parentJoint] @ tree.S > 0
    hinge_moves_b = moves_b[rates[hinge]]
    if hinge_moves_b:
        r = point_b
        s = point_a
    else:
        r = point_a
        s = point_b

    other_motion: _Turn | _Shift
    if angular[other].any():
        other_motion = _Turn(_centre(plane, twists[other]) - h)
        # The axes may be opposite: then the other hinge turns in the negative sense.
        sense = float(angular[hinge] @ angular[other])
    else:
        other_motion = _Shift(_in_plane(plane, linear[other]))
        sense = 1.0
    is_on_same_side = hinge_moves_b == moves_b[rates[other]]
    if is_on_same_side and other < hinge:
        sense = -sense  # it moves h and r; relative to h, s moves in the opposite way
    return _Dyad(
        entry_of_hinge=joints[hinge].idx_q,
        entry_of_other=joints[other].idx_q,
        r=r,
        s=s,
        other_moves_r=bool(is_on_same_side and other > hinge),
        other_motion=other_motion,
        sense=sense,
    )


def _centre(plane: Array, twist: Array) -> complex:
    """Where the axis of a hinge with this twist meets the plane.

    An axis through the point p with the direction n has the twist [p x n; n], and n x (p x n) is
    the point of the axis nearest to the origin.
    """
    return _in_plane(plane, np.cross(twist[3:], twist[:3]))


def _plane(linear: Array, angular: Array) -> Array | None:
    """The plane, shape (2, 3), in which joints with these twists move, one or both of them hinges.

    Its rows are orthonormal vectors; a turn about the first hinge is one from the first row to the
    second. None if the joints do not move in a plane.
    """
    turns = np.linalg.norm(angular, axis=1)  # 1 for hinges, 0 for slides
    n = angular[0] if turns[0] else angular[1]
    not_unit = turns - turns.round()
    not_parallel = np.cross(n, angular).ravel()
    # Screws have a velocity along their own axis, slides out of the plane one along n.
    out_of_plane = np.where(turns > 0, np.vecdot(linear, angular), linear @ n)
    off = np.abs(np.concatenate([not_unit, out_of_plane, not_parallel])).max()
    if not n.any() or off > _EQUAL:
        return None
    plane = np.linalg.svd(n[None])[2][1:]
    plane[1] *= np.linalg.det([n, *plane])  # 1 or -1: n, first and second row are right-handed
    return np.asarray(plane)


def _in_plane(plane: Array, vector: Array) -> complex:
    """A vector as a complex number."""
    return complex(*(plane @ vector))


class _Solution(NamedTuple):
    """A position of the other joint with which a turn of the hinge closes the loop."""

    #: The motion of the joint to this position, [rad] or [m].
    move: float
    #: The point that the joint has moved, relative to h.
    point: complex


@dataclass(frozen=True)
class _Turn:
    """Turns about a centre."""

    centre: complex

    def to_distance(self, p: complex, distance: float) -> list[_Solution] | None:
        """Turns that bring a point p to a distance from 0.

        None if a point is on the axis of its hinge, which does not move it: then there is no dyad.
        """
        arm = p - self.centre
        to_centre = abs(self.centre)
        on_axis = min(abs(arm), to_centre) <= _EQUAL * distance
        if on_axis or distance <= _EQUAL * abs(p):
            return None
        # The triangle with the sides |centre|, |arm| and the distance; the law of cosines.
        cosine = (distance**2 - to_centre**2 - abs(arm) ** 2) / (2 * to_centre * abs(arm))
        if abs(cosine) > 1 + _EQUAL:
            return []
        # The arm must have this angle to the direction of the centre.
        angle = np.arccos(np.clip(cosine, -1, 1))
        turns = [sign * angle - np.angle(arm / self.centre) for sign in (-1, 1)]
        return [_Solution(turn, self.centre + np.exp(1j * turn) * arm) for turn in turns]


@dataclass(frozen=True)
class _Shift:
    """Shifts along a direction, |direction| = 1."""

    direction: complex

    def to_distance(self, p: complex, distance: float) -> list[_Solution] | None:
        """Shifts that bring a point p to a distance from 0; None as for turns."""
        if distance <= _EQUAL * abs(p):
            return None
        to_middle = -(p * self.direction.conjugate()).real  # where the point is nearest to 0
        middle = p + to_middle * self.direction
        square = distance**2 - abs(middle) ** 2
        if square < -_EQUAL * distance**2:
            return []
        half = np.sqrt(max(square, 0.0))
        shifts = [to_middle - half, to_middle + half]
        return [_Solution(shift, p + shift * self.direction) for shift in shifts]
