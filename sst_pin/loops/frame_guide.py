# SPDX-License-Identifier: BSD-2-Clause
"""Leads a frame of a closed chain from pose to pose; all joints follow.

The closures and the wanted pose are one system of equations in all joints, M dq = -f, which
Newton's method solves. Two configurations a and b count as neighbours where
|M_a^+ (M_b - M_a)| < 1/2: then M is regular between them, and the frame stays in its working mode.
With the rates of coordinates or motors in the place of the frame's, the loops stay in their
assembly mode; see `loops/continuity.py`.
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

#: Newton's method: number of steps, the longest step, [rad] or lengths of the loop, and the size
#: below which a step is the last one.
_STEPS, _LONGEST, _LAST = 12, 0.5, 1e-9
#: The same size for a pose that is only approached, and the weight of the closures there.
_NEAR, _HEAVY = 1e-5, 1e4


class Approach(NamedTuple):
    """The end of a motion to a pose."""

    #: The last configuration, shape (nq,).
    q: Array
    #: The distance left to the pose, [rad] or parts of the robot's length; 0 at the pose.
    missed: float
    #: Whether it ends where the drives do not determine the motion.
    singular: bool


class _Place(NamedTuple):
    """A configuration, the pose of the frame, and M with rows of the frame and of the drives."""

    q: Array
    pose: pin.SE3
    M: tuple[Array, Array]


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
        self._kept = np.repeat([position, orientation], 3)
        self._unit = np.repeat([mechanism.length, 1.0], 3)[self._kept]
        self._ranks = [_rank(M) for M in self._place(generic).M]

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
        here, done, step, singular = self._place(q), 0.0, 1.0, False
        start, turn = here.pose, pin.log3(here.pose.rotation.T @ target.rotation)
        inverses = self._inverses(here)
        while done < 1 and step >= shortest:
            part = min(1.0, done + step)
            p = start.translation + part * (target.translation - start.translation)
            pose = pin.SE3(start.rotation @ pin.exp3(part * turn), p)
            place = self._solved(here.q, pose, part == 1 or not nearby)
            task, drives = 2 * CHANGE, 0.0
            if place is not None:
                pairs = zip(inverses, here.M, place.M, strict=True)
                task, drives = (_change(inverse, b - a) for inverse, a, b in pairs)
            singular = task <= CHANGE < drives
            if place is not None and max(task, drives) <= CHANGE:
                here, inverses, done = place, self._inverses(place), part
            step *= min(2.0, 0.8 * CHANGE / max(task, drives, 0.1))
        if done == 1:
            return Approach(here.q, 0.0, False)
        return Approach(here.q, float(np.abs(self._error(here.pose, target)).max()), singular)

    def lead(self, q: Array, target: pin.SE3) -> Array:
        """The configuration that puts the frame at a pose; an error if it misses the pose."""
        end = self.follow(q, target, nearby=True)
        if end.missed:
            raise self._unreached(end, target)
        return end.q

    def _unreached(self, end: Approach, target: pin.SE3) -> SSTError:
        """The error of a motion that ends before its target."""
        here = self._place(end.q)
        error = pose_error(here.pose, target.translation, target.rotation).reshape(2, 3)
        sizes = zip(np.linalg.norm(error, axis=1), ("m", "rad"), self._kept[[0, 3]], strict=True)
        by = " and ".join(f"{size:.3g} {unit}" for size, unit, counts in sizes if counts)
        problem = f"frame {self._name} does not reach the pose: it misses it by {by}"
        if end.singular or _rank(here.M[0]) < self._ranks[0]:
            k, who = (1, "the coordinates") if end.singular else (0, "the frame")
            s = np.linalg.svd(here.M[k], compute_uv=False)[[0, self._ranks[k] - 1]]
            problem += (
                f"; the motion ends where {who} cannot move in all directions; start elsewhere"
            )
            return SingularConfigurationError(problem, s[0] / max(s[1], 1e-300))
        wanted = self._error(here.pose, target)
        right = np.append(np.zeros(len(here.M[0]) - len(wanted)), wanted)
        left = right - here.M[0] @ np.linalg.lstsq(here.M[0], right, rcond=RANK_TOLERANCE)[0]
        if np.abs(left).max() > np.sqrt(RANK_TOLERANCE) * np.abs(wanted).max():
            return WorkspaceError(f"{problem}, in a direction in which it has too few freedoms")
        return WorkspaceError(
            f"{problem}; it is out of reach, or behind a singular configuration on the straight "
            "path; start closer to it"
        )

    def _place(self, q: Array) -> _Place:
        Phi, J, pose = self._rows(q)
        return _Place(q, pose, (np.vstack([Phi, J]), np.vstack([Phi, self._drives(q)])))

    def _rows(self, q: Array) -> tuple[Array, Array, pin.SE3]:
        """Rows of the closures and of the frame, free of units, and the frame's pose."""
        Phi, data = scaled_Phi(self._mechanism, self._loops, q), self._loops.data
        J = self._loops.frame_jacobian(self._frame)
        J = J[self._kept] / self._unit[:, None] * self._mechanism.rate_scale
        return Phi, J, data.oMf[self._frame].copy()

    def _error(self, at: pin.SE3, target: pin.SE3) -> Array:
        error = pose_error(at, target.translation, target.rotation)
        return np.asarray(error[self._kept] / self._unit)

    def _solved(self, q: Array, target: pin.SE3, exact: bool) -> _Place | None:
        """The configuration next to q with closed loops and the frame at its target.

        Unless it is `exact`, the frame is as near to its target as it can be.
        """
        before, mechanism, rows = _LONGEST, self._mechanism, len(self._mechanism.row_scale)
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
            if size <= (_LAST if exact else _NEAR):
                gap = np.abs(f if exact else f[:rows]).max(initial=0.0)
                return self._place(q) if gap <= CLOSURE_TOLERANCE else None
        return None

    def _inverses(self, place: _Place) -> list[Array | None]:
        """Pseudoinverses of M, none where the drives have lost rank."""
        task, drives = (np.asarray(np.linalg.pinv(M, RANK_TOLERANCE), float) for M in place.M)
        return [task, drives if _rank(place.M[1]) >= self._ranks[1] else None]


def _change(inverse: Array | None, by: Array) -> float:
    """|M_a^+ (M_b - M_a)|; infinite without an inverse."""
    return np.inf if inverse is None else float(np.linalg.norm(inverse @ by))


def _rank(M: Array) -> int:
    return int(np.linalg.matrix_rank(M, rtol=RANK_TOLERANCE))


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
