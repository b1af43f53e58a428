# SPDX-License-Identifier: BSD-2-Clause
"""Loop closures of a Pinocchio tree: residual f(q), its Jacobian Phi and the rate of Phi.

Pinocchio's joint Jacobian J in world axes, reduced at the world's origin, holds the unit twist of
every joint. The twist of frame B relative to frame A is then J with the columns that move neither,
or both, left out: closing a loop is a matter of signs. Pinocchio's own constraint functions are
not used, they are wrong or NaN in silence on redundant loops.

Rows run [linear; angular], as Pinocchio's do; the paper's order comes in with the bodies' twists.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import ClosureError, DescriptionError, InputError, UnknownNameError

Array = NDArray[np.float64]

#: Frames further apart than this, [m] or [rad], are an open closure.
CLOSURE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Closure:
    """Two frames of the tree that must coincide.

    Attributes:
        frame_a: Name of the first frame.
        frame_b: Name of the second frame.
        kind: "6d" the frames coincide; "3d" their origins do; "orientation" their axes do.
    """

    frame_a: str
    frame_b: str
    kind: str = "6d"

    KINDS: ClassVar[tuple[str, ...]] = ("6d", "3d", "orientation")

    def __post_init__(self) -> None:
        if self.kind not in self.KINDS:
            raise DescriptionError(
                f"closure of {self.frame_a} and {self.frame_b}",
                [f"kind {self.kind!r} unknown; known: {', '.join(self.KINDS)}"],
            )

    @property
    def rows(self) -> list[str]:
        """What each row of Phi keeps equal."""
        linear, angular = (["x", "y", "z"], ["turn x", "turn y", "turn z"])
        return {"6d": linear + angular, "3d": linear, "orientation": angular}[self.kind]


class LoopKinematics:
    """Placements, Jacobians and closures at one configuration; a workspace, one per thread.

    Args:
        model: A tree whose joints have one coordinate each.
        closures: What closes it.

    Raises:
        UnknownNameError: For a frame that the model does not have.
    """

    def __init__(self, model: pin.Model, closures: Sequence[Closure]) -> None:
        self.model, self.data, self.closures = model, model.createData(), tuple(closures)
        frames = [(_frame_id(model, c.frame_a), _frame_id(model, c.frame_b)) for c in closures]
        # References into data, which set_position and set_velocity fill anew.
        placements, self._J, self._J_dot = self.data.oMf, self.data.J, self.data.dJ
        self._placements = [
            (placements[a], placements[b], c.kind)
            for (a, b), c in zip(frames, closures, strict=True)
        ]
        self._support = np.array(
            [[support(model, model.frames[i].parentJoint) for i in pair] for pair in frames]
        )
        signs = self._support[:, 1] - self._support[:, 0]  # of B relative to A
        parts = [_PARTS[c.kind] for c in closures]
        rows = [(c, row) for c, part in enumerate(parts) for row in part]
        # Phi[i, j] = signs * J[row of i, j]: one gather from the flat J (column-major: 6 j + row).
        self._flat_J, self._flat_J_dot = self._J.T.reshape(-1), self._J_dot.T.reshape(-1)
        self._gather = np.array([[6 * j + row for j in range(model.nv)] for _, row in rows])
        self._signs = np.array([signs[c] for c, _ in rows])
        self.rows = len(rows)
        starts = np.cumsum([0, *map(len, parts)])
        self._points = [
            (c, slice(starts[c], starts[c + 1]))
            for c, closure in enumerate(closures)
            if closure.kind == "3d"
        ]

    def set_position(self, q: Array) -> None:
        """Compute what depends on q."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)

    def set_velocity(self, q: Array, v: Array) -> None:
        """Compute what depends on q and on its rate."""
        pin.computeJointJacobiansTimeVariation(self.model, self.data, q, v)

    def require_closed(self, tolerance: float) -> None:
        """Check that all frames coincide within a tolerance in [m] and [rad].

        Raises:
            InputError: When q is not finite.
            ClosureError: When a loop is open.
        """
        for A, B, kind in self._placements:
            if kind == "6d":  # nine in ten: the residual takes longer
                closed = A.actInv(B).isIdentity(tolerance)
            else:
                closed = np.abs(_residual(A, B, kind)).max() <= tolerance
            if not closed:
                residual = float(np.abs(self.residual()).max())
                if np.isnan(residual):
                    raise InputError("q", "not finite")
                raise ClosureError(
                    f"the loops are open by {residual:.3g} (m or rad), more than {tolerance:g}; "
                    "assemble(q) closes them",
                    residual,
                )

    def residual(self) -> Array:
        """f(q) of Eq. (2), shape (rows,), [m] and [rad], zero when the loops are closed."""
        return np.concatenate([_residual(*placement) for placement in self._placements])

    def Phi(self) -> Array:
        """Jacobian of f on the closures, shape (rows, nv): Phi q_dot = 0, Eqs. (3), (4)."""
        Phi: Array = self._flat_J.take(self._gather) * self._signs
        for c, rows in self._points:
            Phi[rows] = self._point_velocities(c, self._J).sum(axis=0)
        return Phi

    def Phi_dot(self, v: Array) -> Array:
        """Rate of Phi at the joint rates v, shape (rows, nv)."""
        J, J_dot = self._J, self._J_dot
        Phi_dot: Array = self._flat_J_dot.take(self._gather) * self._signs
        for c, rows in self._points:
            p_dot = self._point_velocities(c, J) @ v * ((-1,), (1,))
            moved = self._point_velocities(c, J_dot)
            for side, sign in enumerate((-1, 1)):
                angular = J[3:] * self._support[c, side]
                moved[side] += sign * np.cross(angular, p_dot[side], axisb=0, axisa=0, axisc=0)
            Phi_dot[rows] = moved.sum(axis=0)
        return Phi_dot

    def _point_velocities(self, c: int, J: Array) -> Array:
        """Signed velocities of the two origins of closure c per joint rate, shape (2, 3, nv)."""
        velocities = []
        for side, sign in enumerate((-1, 1)):
            columns = J * self._support[c, side]
            p = self._placements[c][:2][side].translation
            velocities.append(sign * (columns[:3] - pin.skew(p) @ columns[3:]))
        return np.stack(velocities)


#: Rows of a world twist [linear; angular] that each kind of closure holds.
_PARTS = {"6d": range(6), "3d": range(3), "orientation": range(3, 6)}


def _residual(A: pin.SE3, B: pin.SE3, kind: str) -> Array:
    if kind == "6d":
        # The displacement from A to B as a screw in world axes: its rate is the relative twist.
        return pin.log6(B * A.inverse()).vector
    if kind == "3d":
        return B.translation - A.translation
    turn: Array = pin.log3(B.rotation @ A.rotation.T)
    return turn


def _frame_id(model: pin.Model, name: str) -> int:
    if not model.existFrame(name):
        raise UnknownNameError("frame", name, [f.name for f in model.frames])
    return int(model.getFrameId(name))


def support(model: pin.Model, joint: int) -> Array:
    """1 for the coordinates that move a joint's body, 0 for the others, shape (nv,)."""
    support = np.zeros(model.nv)
    support[[model.joints[j].idx_v for j in model.supports[joint] if j > 0]] = 1
    return support
