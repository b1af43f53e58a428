# SPDX-License-Identifier: BSD-2-Clause
"""Dyads: planar loops that two joints close: a hinge, and another hinge or a slide.

The closure brings two points together: r, which the hinge turns about its centre h, and s, the
point on the other frame of the closure. Both are complex numbers in the plane, relative to h. The
other joint

- moves s, if it carries the frame of s;
- moves r, if it carries the frame of r and comes after the hinge in the tree;
- moves h and r together, if it carries the frame of r and comes before the hinge. Relative to h, r
  stays where it is, and s moves by the opposite motion.

So in each case it moves one of the two points relative to h, until |r| = |s|. Then a turn of the
hinge by the angle of s / r brings r to s. There are up to two such positions of the other joint.

`dyad_configurations` is the main function. `_dyad` recognises a dyad, and `_Dyad.closing_moves`
solves it, by a triangle (`_Turn`) or a right triangle (`_Shift`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from ..model.closures import Closure, Constraint, holds_points
from ..model.tree import frame_id
from .loops import Loops

#: Directions and cosines that differ by less are equal, and so are lengths, relative to others of
#: the dyad. Exact ones differ by rounding, some 1e-15. Loops of files with fewer digits are no
#: dyads; they are solved from random starts.
_EQUAL = 1e-9


def dyad_configurations(
    loops: Loops, closure: Constraint, rates: Indices, q: Array
) -> list[Array] | None:
    """Configurations in which two joints close a loop; None if the loop is no dyad.

    `rates` are the indices in v of the two joints. The other joints keep their positions in q. The
    positions of the two joints in q do not matter.
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
        entry_of_other: Index of the position of the other joint in q.
        r: The point that the hinge turns, relative to its centre h.
        s: The point on the other frame, relative to h.
        other_moves_r: Whether the other joint moves r relative to h; else it moves s.
        other_motion: How the other joint moves this point.
        sense: 1 if a positive rate of the other joint makes this motion positive, else -1.
    """

    entry_of_hinge: int
    entry_of_other: int
    r: complex
    s: complex
    other_moves_r: bool
    other_motion: _Turn | _Shift
    sense: float

    def closing_moves(self) -> list[_Moves] | None:
        """Moves of both joints that close the loop; None if it is no dyad.

        The other joint moves until |r| = |s|. Then the hinge turns r to s.
        """
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
    # A mimic joint has the index of the joint that it follows. So a rate that moves several joints
    # makes more than two joints here, which are no dyad.
    joints = [joint for joint in list(model.joints)[1:] if joint.idx_v in rates]
    if len(joints) != 2 or any((joint.nq, joint.nv) != (1, 1) for joint in joints):
        return None
    loops.evaluate(q)
    J = loops.data.J.reshape(6, -1) @ tree.S
    twists = J[:, rates].T  # of the two joints at unit speed, in rows
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
    # Which rates of the model move frame B, shape (nv,): those with a rate of the normal tree that
    # moves its body. For the two joints the entries of S are 1.
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
    # Each joint moves one of the two frames: both move the same one if both or none move B.
    is_on_same_side = hinge_moves_b == moves_b[rates[other]]
    if is_on_same_side and other < hinge:
        sense = -sense  # it moves h and r; relative to h, s moves by the opposite motion
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
    """The plane, shape (2, 3), in which two joints move, at least one of them a hinge; or None.

    Its rows are orthonormal vectors. A positive turn of the first hinge goes from the first row to
    the second one. The twists [linear; angular] of the joints at unit speed are in rows.
    """
    turns = np.linalg.norm(angular, axis=1)  # 1 for hinges, 0 for slides
    n = angular[0] if turns[0] else angular[1]
    # The next numbers are zero for hinges parallel to n and slides normal to n.
    not_unit = turns - turns.round()  # not zero if the angular velocity is neither 0 nor 1
    not_parallel = np.cross(n, angular).ravel()
    along_axis = np.vecdot(linear, angular)  # not zero for screws
    along_n = linear @ n  # not zero for slides that leave the plane
    out_of_plane = np.where(turns > 0, along_axis, along_n)
    largest = np.abs(np.concatenate([not_unit, out_of_plane, not_parallel])).max()
    if not n.any() or largest > _EQUAL:
        return None
    plane = np.linalg.svd(n[None])[2][1:]  # two orthonormal vectors normal to n
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
    """Turns about a centre, which is relative to h."""

    centre: complex

    def to_distance(self, p: complex, distance: float) -> list[_Solution] | None:
        """Turns that bring a point p to a distance from h, which is 0 here.

        None if a point is on the axis of the hinge that should move it: then there is no dyad.
        """
        arm = p - self.centre
        to_centre = abs(self.centre)
        on_axis = min(abs(arm), to_centre) <= _EQUAL * distance
        if on_axis or distance <= _EQUAL * abs(p):
            return None
        # |centre + arm| must be the distance, where the turned arm has an angle to the centre:
        # distance^2 = |centre|^2 + |arm|^2 + 2 |centre| |arm| cos(angle).
        cosine = (distance**2 - to_centre**2 - abs(arm) ** 2) / (2 * to_centre * abs(arm))
        if abs(cosine) > 1 + _EQUAL:
            return []
        angle = np.arccos(np.clip(cosine, -1, 1))
        angle_now = np.angle(arm / self.centre)
        turns = [sign * angle - angle_now for sign in (-1, 1)]
        return [_Solution(turn, self.centre + np.exp(1j * turn) * arm) for turn in turns]


@dataclass(frozen=True)
class _Shift:
    """Shifts along a direction, |direction| = 1."""

    direction: complex

    def to_distance(self, p: complex, distance: float) -> list[_Solution] | None:
        """Shifts that bring a point p to a distance from h, which is 0 here.

        None if the other point is on the axis of the hinge, so that the distance is zero.
        """
        if distance <= _EQUAL * abs(p):
            return None
        # The shift to the point of the line that is nearest to h, the foot of the normal. The
        # solutions are at equal distances on both sides of it.
        to_foot = -(p * self.direction.conjugate()).real
        foot = p + to_foot * self.direction
        square = distance**2 - abs(foot) ** 2
        if square < -_EQUAL * distance**2:
            return []
        half = np.sqrt(max(square, 0.0))
        shifts = [to_foot - half, to_foot + half]
        return [_Solution(shift, p + shift * self.direction) for shift in shifts]
