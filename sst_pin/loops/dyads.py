# SPDX-License-Identifier: BSD-2-Clause
"""Dyads: planar loops that two joints close, a hinge and another hinge or a slide.

Points of the plane are complex numbers. The closure brings two points together, one on each of its
frames. The hinge turns its point on a circle about h. The other joint changes the distance of one
of the points from h; where both distances are equal, a turn of the hinge closes the loop. There are
up to two such positions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from ..model.closures import Closure, Constraint, holds_points
from ..model.tree import frame_id
from .loops import Loops

#: Directions and cosines that differ by less are equal, and so are points, in robot lengths.
_EQUAL = 1e-9


class _Meeting(NamedTuple):
    """A position of the other joint with which a turn of the hinge closes the loop."""

    #: The motion of the joint to this position, [rad] or [m].
    move: float
    #: Where it moves its point, relative to h.
    point: complex


def dyad_configurations(
    loops: Loops, closure: Constraint, rates: Indices, q: Array
) -> list[Array] | None:
    """Configurations in which two joints close a loop, the others held; None if it is no dyad.

    `rates` are those of the two joints.
    """
    model, tree = loops.model, loops.tree
    if not isinstance(closure, Closure) or not holds_points(closure):
        return None
    joints = [joint for joint in list(model.joints)[1:] if joint.idx_v in rates]
    if [(joint.nq, joint.nv) for joint in joints] != [(1, 1), (1, 1)]:
        return None
    loops.evaluate(q)
    data = loops.data
    twists = (data.J.reshape(6, -1) @ tree.S)[:, rates].T
    linear, axes = twists[:, :3], twists[:, 3:]
    plane = _plane(linear, axes)
    if plane is None:
        return None

    hinge = 0 if axes[0].any() else 1
    other = 1 - hinge
    other_slides = not axes[other].any()
    frame_b = frame_id(model, closure.frame_b)
    moves_b = tree.supports[tree.model.frames[frame_b].parentJoint] @ tree.S > 0
    hinge_moves_b, other_moves_b = moves_b[rates[hinge]], moves_b[rates[other]]
    on_one_side = hinge_moves_b == other_moves_b
    other_is_after = on_one_side and other > hinge

    point_a, point_b = (
        _in_plane(plane, data.oMf[frame_id(model, name)].translation)
        for name in (closure.frame_a, closure.frame_b)
    )
    of_hinge, opposite = (point_b, point_a) if hinge_moves_b else (point_a, point_b)
    h = _in_plane(plane, np.cross(axes[hinge], linear[hinge]))
    g = None if other_slides else _in_plane(plane, np.cross(axes[other], linear[other])) - h
    direction = _in_plane(plane, linear[other])
    # A joint after the hinge moves the hinge's point. One before the hinge moves it too, together
    # with h: this is the same as the opposite motion of the opposite point.
    moved, fixed = (of_hinge, opposite) if other_is_after else (opposite, of_hinge)
    meetings = _meetings(moved - h, abs(fixed - h), g, direction)
    if meetings is None:
        return None
    sense = -1.0 if on_one_side and not other_is_after else 1.0
    if not other_slides:
        sense *= float(axes[hinge] @ axes[other])
    configurations = list[Array]()
    for move, point in meetings:
        ratio = (fixed - h) / point
        turn = np.angle(ratio) if other_is_after else -np.angle(ratio)
        configuration = q.copy()
        configuration[joints[hinge].idx_q] += turn
        configuration[joints[other].idx_q] += sense * move
        configurations.append(configuration)
    return configurations


def _plane(linear: Array, axes: Array) -> Array | None:
    """The plane, shape (2, 3), in which joints with these twists move, one or both of them hinges.

    A turn about the first hinge is one from its first to its second direction. None if the joints
    do not move in a plane.
    """
    turns = np.linalg.norm(axes, axis=1)
    n = axes[0] if turns[0] else axes[1]
    out_of_plane = np.where(turns > 0, np.vecdot(linear, axes), linear @ n)  # of screws, of slides
    not_unit = turns - turns.round()
    not_parallel = np.cross(n, axes).ravel()
    off = np.abs(np.concatenate([not_unit, out_of_plane, not_parallel])).max()
    if not n.any() or off > _EQUAL:
        return None
    plane = np.linalg.svd(n[None])[2][1:]
    plane[1] *= np.linalg.det([n, *plane])
    return np.asarray(plane)


def _in_plane(plane: Array, vector: Array) -> complex:
    """A vector as a complex number."""
    return complex(*(plane @ vector))


def _meetings(p: complex, r: float, g: complex | None, d: complex) -> list[_Meeting] | None:
    """Motions that bring a point p to the distance r from 0: turns about g, or shifts along d.

    They are shifts if g is None. None if a point is on the axis of its hinge, which does not move
    it: then there is no dyad.
    """
    if r <= _EQUAL * abs(p):
        return None
    if g is None:
        return _shifts(p, r, d)
    arm = p - g
    if min(abs(arm), abs(g)) <= _EQUAL * r:
        return None
    # The triangle with the sides |g|, |arm| and r.
    cosine = (r * r - abs(g) ** 2 - abs(arm) ** 2) / (2 * abs(g) * abs(arm))
    if abs(cosine) > 1 + _EQUAL:
        return []
    corner = np.arccos(np.clip(cosine, -1, 1))
    turns = [sign * corner - np.angle(arm / g) for sign in (-1, 1)]
    return [_Meeting(turn, g + np.exp(1j * turn) * arm) for turn in turns]


def _shifts(p: complex, r: float, d: complex) -> list[_Meeting]:
    """Shifts along d that bring a point p to the distance r from 0."""
    to_middle = -(p * d.conjugate()).real  # where the point is nearest to 0
    square = r * r - abs(p + to_middle * d) ** 2
    if square < -_EQUAL * r * r:
        return []
    half = np.sqrt(max(square, 0.0))
    return [_Meeting(shift, p + shift * d) for shift in (to_middle - half, to_middle + half)]
