# SPDX-License-Identifier: BSD-2-Clause
"""Leading a frame of a closed chain from pose to pose: all joints follow.

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

from ..arrays import Array
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE, RANK_TOLERANCE
from ..model.tree import frame_id, of_rates
from .continuity import CHANGE
from .loops import Loops
from .mobility import scaled_Phi

#: Newton's method: steps; the longest one, [rad] or of the robot's length, and the last one.
_STEPS, _LONGEST, _LAST = 12, 0.5, 1e-9


class Way(NamedTuple):
    """How far a frame came on its way to a pose."""

    #: The last configuration, shape (nq,).
    q: Array
    #: What is left of the way, [rad] or parts of the robot's length; 0 if it is there.
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
    which of the two counts. `drives` gives, at a configuration, the rates that determine the
    motion by those of all joints, free of units, shape (k, nv); by default those of the
    coordinates.
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
        self._frame = frame_id(mechanism.model, frame)
        self._kept = np.repeat([position, orientation], 3)
        self._unit = np.repeat([mechanism.length, 1.0], 3)[self._kept]
        self._rank = _rank(self._place(generic).M[1])

    def pose(self, q: Array) -> pin.SE3:
        """Where the frame is."""
        return self._rows(q)[2]

    def follow(self, q: Array, target: pin.SE3, shortest: float = 2**-10) -> Way:
        """The way from a configuration with closed loops straight on to a pose of the frame.

        It ends where steps would be shorter than a part of it.
        """
        here, done, step, singular = self._place(q), 0.0, 1.0, False
        start, turn = here.pose, pin.log3(here.pose.rotation.T @ target.rotation)
        inverses = self._inverses(here)
        while done < 1 and step >= shortest:
            part = min(1.0, done + step)
            p = start.translation + part * (target.translation - start.translation)
            found = self._solved(here.q, pin.SE3(start.rotation @ pin.exp3(part * turn), p))
            task, drives = 2 * CHANGE, 0.0
            if found is not None:
                pairs = zip(inverses, here.M, found.M, strict=True)
                task, drives = (_change(inverse, b - a) for inverse, a, b in pairs)
            singular = task <= CHANGE < drives
            if found is not None and max(task, drives) <= CHANGE:
                here, inverses, done = found, self._inverses(found), part
            step *= min(2.0, 0.8 * CHANGE / max(task, drives, 0.1))
        if done == 1:
            return Way(here.q, 0.0, False)
        return Way(here.q, float(np.abs(self._error(here.pose, target)).max()), singular)

    def _place(self, q: Array) -> _Place:
        Phi, J, pose = self._rows(q)
        return _Place(q, pose, (np.vstack([Phi, J]), np.vstack([Phi, self._drives(q)])))

    def _rows(self, q: Array) -> tuple[Array, Array, pin.SE3]:
        """Rows of the closures and of the frame, free of units, and the frame's pose."""
        Phi, data = scaled_Phi(self._mechanism, self._loops, q), self._loops.data
        where = pin.LOCAL_WORLD_ALIGNED
        J = of_rates(pin.getFrameJacobian(self._loops.model, data, self._frame, where))
        J = J[self._kept] / self._unit[:, None] * self._mechanism.rate_scale
        return Phi, J, data.oMf[self._frame].copy()

    def _error(self, at: pin.SE3, target: pin.SE3) -> Array:
        error = pose_error(at, target.translation, target.rotation)
        return np.asarray(error[self._kept] / self._unit)

    def _solved(self, q: Array, target: pin.SE3) -> _Place | None:
        """The configuration next to q where loops are closed and the frame is at its target."""
        before, mechanism = _LONGEST, self._mechanism
        for _ in range(_STEPS):
            Phi, J, pose = self._rows(q)
            open_by = self._loops.residual() * mechanism.row_scale
            f = np.concatenate([open_by, -self._error(pose, target)])
            step = np.linalg.lstsq(np.vstack([Phi, J]), -f, rcond=RANK_TOLERANCE)[0]
            size = float(np.abs(step).max())
            if not size <= before:
                break
            q = pin.integrate(mechanism.model, q, step * mechanism.rate_scale)
            before = size
            if size <= _LAST:
                return self._place(q) if np.abs(f).max() <= CLOSURE_TOLERANCE else None
        return None

    def _inverses(self, place: _Place) -> list[Array | None]:
        """Pseudoinverses of M, none where the drives have lost rank."""
        task, drives = (np.asarray(np.linalg.pinv(M, RANK_TOLERANCE), float) for M in place.M)
        return [task, drives if _rank(place.M[1]) >= self._rank else None]


def _change(inverse: Array | None, by: Array) -> float:
    """|M_a^+ (M_b - M_a)|; infinite without an inverse."""
    return np.inf if inverse is None else float(np.linalg.norm(inverse @ by))


def _rank(M: Array) -> int:
    return int(np.linalg.matrix_rank(M, rtol=RANK_TOLERANCE))


def pose_error(at: pin.SE3, position: Array | None, R: Array | None) -> Array:
    """From a pose to a target, in base axes, [m] and [rad], shape (3,) or (6,)."""
    away = [] if position is None else [position - at.translation]
    turn = [] if R is None else [at.rotation @ pin.log3(at.rotation.T @ R)]
    return np.concatenate([*away, *turn])
