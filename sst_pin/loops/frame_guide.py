# SPDX-License-Identifier: BSD-2-Clause
"""Leads a frame of a closed chain from pose to pose; all joints follow.

The closures and the wanted pose are one system of equations in all joints, M dq = -f, which
Newton's method solves. M has the rows of Phi and those of the frame's Jacobian. Two configurations
a and b count as neighbours where |M_a^+ (M_b - M_a)| < 1/2: then M is regular between them, and the
frame stays in its working mode. A second matrix D has the rows of Phi and those of the drives, by
default the coordinates. Where it is regular too, the loops stay in their assembly mode; see
`loops/continuity.py`.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, for_each_sample
from ..errors import InputError, SingularConfigurationError, SSTError, WorkspaceError
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE, RANK_TOLERANCE
from ..model.tree import frame_id
from .assembly import Assembly
from .continuity import CHANGE
from .loops import Loops
from .ranks import scaled_Phi

#: Newton's method: number of steps, and the longest step, [rad] or lengths of the loop.
_STEPS, _LONGEST = 12, 0.5
#: A step of less than this size is the last one; the second is for a pose that is only approached.
_LAST, _LAST_NEARBY = 1e-9, 1e-5
#: Weight of the closures where a pose is only approached.
_HEAVY = 1e4


class Approach(NamedTuple):
    """The end of a motion to a pose."""

    #: The last configuration, shape (nq,).
    q: Array
    #: The distance left to the pose, [rad] or parts of the robot's length; 0 at the pose.
    missed: float
    #: Whether it ends where the drives do not determine the motion.
    singular: bool


class _Place(NamedTuple):
    """A configuration, the pose of the frame there, and both matrices."""

    q: Array
    pose: pin.SE3
    M: Array
    D: Array


class _Anchor(NamedTuple):
    """A place with which later ones are compared: it and the pseudoinverses of its matrices."""

    place: _Place
    M_inverse: Array
    #: None where the drives do not determine the motion.
    D_inverse: Array | None


class FrameGuide:
    """Leads a frame of a robot from pose to pose, in its working and assembly modes.

    `generic` is a configuration without symmetry, shape (nq,). `position` and `orientation` say
    which of the two count. `drives(q)` is a matrix, shape (k, nv), free of units: times v it gives
    the rates that determine the motion, by default those of the coordinates.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        generic: Array,
        frame: str,
        position: bool,
        orientation: bool,
        drives: Callable[[Array], Array] | None = None,
    ) -> None:
        coordinates = np.eye(mechanism.model.nv)[mechanism.coordinates]
        self._mechanism, self._drives = mechanism, drives or (lambda _: coordinates)
        self._loops = Loops(mechanism.model, mechanism.closures)
        self._name, self._frame = frame, frame_id(mechanism.model, frame)
        #: Which components of a twist [linear; angular] count, and their units.
        self._counts = np.repeat([position, orientation], 3)
        self._unit = np.repeat([mechanism.length, 1.0], 3)[self._counts]
        place = self._place(generic)
        self._M_rank, self._D_rank = _rank(place.M), _rank(place.D)

    def pose(self, q: Array) -> pin.SE3:
        """Where the frame is."""
        return self._rows(q)[2]

    def follow(
        self, q: Array, target: pin.SE3, shortest: float = 2**-10, nearby: bool = False
    ) -> Approach:
        """Move the frame from a configuration with closed loops straight to a pose.

        The motion ends where steps would be shorter than the fraction `shortest` of it. With
        `nearby`, poses in between need not be reached exactly: some frames cannot move in all
        directions.
        """
        anchor = self._anchor(self._place(q))
        start = anchor.place.pose
        turn = pin.log3(start.rotation.T @ target.rotation)
        done, step, singular = 0.0, 1.0, False
        while done < 1 and step >= shortest:
            part = min(1.0, done + step)
            p = start.translation + part * (target.translation - start.translation)
            pose = pin.SE3(start.rotation @ pin.exp3(part * turn), p)
            place = self._solved(anchor.place.q, pose, exact=part == 1 or not nearby)
            if place is None:
                M_change, D_change = 2 * CHANGE, 0.0
            else:
                M_change = _change(anchor.M_inverse, place.M - anchor.place.M)
                D_change = _change(anchor.D_inverse, place.D - anchor.place.D)
            singular = M_change <= CHANGE < D_change
            change = max(M_change, D_change)
            if place is not None and change <= CHANGE:
                anchor, done = self._anchor(place), part
            # The change is about proportional to the step; the next one aims at 0.8 of the limit.
            step *= min(2.0, 0.8 * CHANGE / max(change, 0.1))
        end = anchor.place
        if done == 1:
            return Approach(end.q, 0.0, singular=False)
        return Approach(end.q, float(np.abs(self._error(end.pose, target)).max()), singular)

    def lead(self, q: Array, target: pin.SE3) -> Array:
        """The configuration that puts the frame at a pose; an error if it misses the pose."""
        end = self.follow(q, target, nearby=True)
        if end.missed:
            raise self._unreached(end, target)
        return end.q

    def _unreached(self, end: Approach, target: pin.SE3) -> SSTError:
        """The error of a motion that ends before its target."""
        here = self._place(end.q)
        error = pose_error(here.pose, target.translation, target.rotation)
        distances = list[str]()
        if self._counts[0]:
            distances.append(f"{np.linalg.norm(error[:3]):.3g} m")
        if self._counts[3]:
            distances.append(f"{np.linalg.norm(error[3:]):.3g} rad")
        problem = (
            f"frame {self._name} does not reach the pose: it misses it by {' and '.join(distances)}"
        )
        ends = "; the motion ends where {} cannot move in all directions; start elsewhere"
        if end.singular:
            problem += ends.format("the coordinates")
            return SingularConfigurationError(problem, _condition(here.D, self._D_rank))
        if _rank(here.M) < self._M_rank:
            problem += ends.format("the frame")
            return SingularConfigurationError(problem, _condition(here.M, self._M_rank))
        # No joint rates move the frame towards the target while the loops stay closed.
        wanted = self._error(here.pose, target)
        right = np.append(np.zeros(len(here.M) - len(wanted)), wanted)
        missing = right - here.M @ np.linalg.lstsq(here.M, right, rcond=RANK_TOLERANCE)[0]
        if np.abs(missing).max() > np.sqrt(RANK_TOLERANCE) * np.abs(wanted).max():
            return WorkspaceError(f"{problem}, in a direction in which it has too few freedoms")
        return WorkspaceError(
            f"{problem}; it is out of reach, or behind a singular configuration on the straight "
            "path; start closer to it"
        )

    def _place(self, q: Array) -> _Place:
        Phi, J, pose = self._rows(q)
        return _Place(q, pose, np.vstack([Phi, J]), np.vstack([Phi, self._drives(q)]))

    def _rows(self, q: Array) -> tuple[Array, Array, pin.SE3]:
        """Rows of the closures and of the frame, free of units, and the frame's pose."""
        Phi, data = scaled_Phi(self._mechanism, self._loops, q), self._loops.data
        J = self._loops.frame_jacobian(self._frame)
        J = J[self._counts] / self._unit[:, None] * self._mechanism.rate_scale
        return Phi, J, data.oMf[self._frame].copy()

    def _error(self, at: pin.SE3, target: pin.SE3) -> Array:
        """What counts of `pose_error`, free of units."""
        error = pose_error(at, target.translation, target.rotation)
        return np.asarray(error[self._counts] / self._unit)

    def _solved(self, q: Array, target: pin.SE3, exact: bool) -> _Place | None:
        """The configuration next to q with closed loops and the frame at its target.

        Unless it is `exact`, the frame is as near to its target as it can be.
        """
        mechanism, rows = self._mechanism, len(self._mechanism.row_scale)
        before = _LONGEST
        weights = np.ones(rows + len(self._unit))
        weights[:rows] = 1.0 if exact else _HEAVY
        for _ in range(_STEPS):
            Phi, J, pose = self._rows(q)
            open_by = self._loops.f * mechanism.row_scale
            f = np.concatenate([open_by, -self._error(pose, target)])
            M = np.vstack([Phi, J]) * weights[:, None]
            step = np.linalg.lstsq(M, -f * weights, rcond=RANK_TOLERANCE)[0]
            size = float(np.abs(step).max())
            if not size <= before:
                break
            q = pin.integrate(mechanism.model, q, step * mechanism.rate_scale)
            before = size
            if size > (_LAST if exact else _LAST_NEARBY):
                continue
            must_vanish = f if exact else f[:rows]
            if np.abs(must_vanish).max(initial=0.0) <= CLOSURE_TOLERANCE:
                return self._place(q)
            break
        return None

    def _anchor(self, place: _Place) -> _Anchor:
        M_inverse = np.asarray(np.linalg.pinv(place.M, RANK_TOLERANCE), dtype=float)
        if _rank(place.D) < self._D_rank:
            return _Anchor(place, M_inverse, None)
        return _Anchor(place, M_inverse, np.asarray(np.linalg.pinv(place.D, RANK_TOLERANCE)))


def _change(inverse: Array | None, by: Array) -> float:
    """|M_a^+ (M_b - M_a)|; infinite without an inverse."""
    return np.inf if inverse is None else float(np.linalg.norm(inverse @ by))


def _rank(M: Array) -> int:
    return int(np.linalg.matrix_rank(M, rtol=RANK_TOLERANCE))


def _condition(M: Array, rank: int) -> float:
    """Condition number of a matrix that has this rank elsewhere."""
    sizes = np.linalg.svd(M, compute_uv=False)
    return float(sizes[0] / max(sizes[rank - 1], 1e-300))


def frame_configurations(
    assembly: Assembly,
    generic: Array,
    frame: str,
    position: ArrayLike | None,
    rotation: ArrayLike | None,
    start: ArrayLike,
) -> Array:
    """`ClosedChain.frame_configuration`, from a start."""
    if position is None and rotation is None:
        raise InputError("position", "give a position, a rotation, or both")
    mechanism = assembly.mechanism
    p = None if position is None else finite_array("position", position, (3,))
    R = None if rotation is None else rotations("rotation", rotation)
    size, free = (mechanism.model.nq,), mechanism.dependent
    guide = FrameGuide(mechanism, generic, frame, p is not None, R is not None)
    q = finite_array("start", start, size)
    q = for_each_sample(lambda q: assembly.assemble(q, free), [q], (1,), size)
    return for_each_sample(lambda q, p, R: guide.lead(q, pose_of(p, R)), [q, p, R], (1, 1, 2), size)


def rotations(name: str, value: ArrayLike) -> Array:
    """Rotation matrices, shape (..., 3, 3)."""
    R = finite_array(name, value, (3, 3))
    gap = np.abs(R @ R.mT - np.eye(3)).max(initial=0.0)
    if gap > 1e-6 or (np.linalg.det(R) < 0).any():
        raise InputError(name, "not all are rotation matrices")
    return R


def pose_of(position: Array | None, R: Array | None) -> pin.SE3:
    """A pose; components that do not count are zero."""
    return pin.SE3(np.eye(3) if R is None else R, np.zeros(3) if position is None else position)


def pose_error(at: pin.SE3, position: Array | None, R: Array | None) -> Array:
    """From a pose to a target, in base axes, [m] and [rad], shape (3,) or (6,)."""
    away = [] if position is None else [position - at.translation]
    turn = [] if R is None else [at.rotation @ pin.log3(at.rotation.T @ R)]
    return np.concatenate([*away, *turn])
