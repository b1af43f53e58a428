# SPDX-License-Identifier: BSD-2-Clause
"""Residual f(q) of the constraints, their Jacobian Phi and its rate, at one configuration.

With the wrenches W of the closures' rows (`closure_kinds`), Pinocchio's joint Jacobian J, and the
supports S of 0 and 1 of the two frames of a closure, Phi = (W_B J) S_B - (W_A J) S_A; `tree` says
what the columns of J are. Columns in both supports are left out: what moves both frames alike
leaves a closed loop as it is. Phi_dot v is W_dot times the twists of the frames, and W times their
accelerations without v_dot. Pinocchio's own constraint functions are not used, they are wrong or
NaN in silence on redundant loops.

Rows run [linear; angular], as Pinocchio's do; the paper's order comes in with the bodies' twists.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import ClosureError, InputError
from .closure_kinds import Frame, Pair, Rows, length, move, pair_of, place, products
from .closures import Closure, Constraint, Coupling, Distance, Rolling, frames_of
from .couplings import Coupled
from .tree import JacobianRates, frame_id, of_rates, rates_of_columns, support

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Loops further open than this are open, relative to the length of the robot or in [rad].
CLOSURE_TOLERANCE = 1e-6
_W, _W_DOT = 0, 1


class Loops:
    """Closures of one tree with memory of their own: one object per thread.

    `evaluate(q)` computes what depends on q; all other methods speak of that configuration.

    Args:
        model: The tree; it must not change afterwards.
        closures: What closes it.

    Attributes:
        rows: How many rows there are.
        slices: Rows of each closure.
        holonomic: Rows that have a residual; the others hold rates only.
        touched: Which rates a row depends on: those that move one of its two frames only.
        pairs: The closures of two frames.
        couplings: The others, with their rows.

    Raises:
        UnknownNameError: For a frame or joint that the model does not have.
        DescriptionError: For a coupling of joints that have several coordinates.
    """

    def __init__(self, model: pin.Model, closures: Sequence[Constraint]) -> None:
        self.model, self.data = model, model.createData()
        starts = np.cumsum([0, *(len(c.rows) for c in closures)])
        self.slices = tuple(slice(a, b) for a, b in pairwise(starts))
        self.rows = int(starts[-1])
        self.holonomic = np.array([not row.startswith("slip") for c in closures for row in c.rows])
        self._jacobian_rates, self._zero = JacobianRates(model), np.zeros(model.nv)
        self._J, self._J_dot = of_rates(self.data.J).T, of_rates(self.data.dJ).T
        self._numbers, self._Phi = Rows(self.rows), np.zeros((self.rows, model.nv))
        self._frames: list[Frame] = []
        self.pairs: list[Pair] = []
        self.couplings: list[tuple[slice, Coupled]] = []
        self.touched = np.zeros((self.rows, model.nv), dtype=bool)
        for closure, rows in zip(closures, self.slices, strict=True):
            if isinstance(closure, Coupling):
                self.couplings.append((rows, Coupled(model, closure)))
                self.touched[rows] = self.couplings[-1][1].touched
            else:
                self._connect(closure, rows)

    def _connect(self, closure: Closure | Distance | Rolling, rows: slice) -> None:
        """Take in a closure of two frames and what moves them."""
        a, b = (frame_id(self.model, name) for name in frames_of(closure))
        pair = pair_of(closure, self._frame(b), self._frame(a), self._numbers, rows)
        self.pairs.append(pair)
        self.touched[rows, pair.rates] = True

    def _frame(self, index: int) -> Frame:
        """A frame of the model, the same one for all closures."""
        for frame in self._frames:
            if frame.index == index:
                return frame
        joint = self.model.frames[index].parentJoint
        columns = np.flatnonzero(support(self.model, joint))
        rates = rates_of_columns(self.model)[columns]
        self._frames.append(Frame(self.data, index, joint, columns, rates))
        return self._frames[-1]

    def evaluate(self, q: Array) -> None:
        """Compute what depends on q."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        place(self._frames, self.pairs)
        self._q = q
        for rows, coupled in self.couplings:
            self._numbers.f[rows] = coupled.residual(q)

    def residual(self) -> Array:
        """f(q) of Eq. (2), shape (rows,), [m] and [rad], zero when the loops are closed."""
        return self._numbers.f.copy()

    def require_closed(self, scale: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """Check that all loops are closed.

        Args:
            scale: Of each row, by which its residual is multiplied, shape (rows,).
            tolerance: Of the scaled residual.

        Raises:
            InputError: When q is not finite.
            ClosureError: When a loop is open.
        """
        f = self._numbers.f
        if length(f, scale) <= tolerance:
            return  # the short way: no row is longer than all
        if not np.abs(f * scale).max(initial=0.0) <= tolerance:
            residual = float(np.abs(f).max())
            if np.isnan(residual):
                raise InputError("q", "not finite")
            raise ClosureError(
                f"the loops are open by {residual:.3g} (m or rad), more than {tolerance:g} of the "
                "robot's length or rad; assemble(q) closes them",
                residual,
            )

    def Phi(self) -> Array:
        """Jacobian of the closures, shape (rows, nv): Phi v = 0, Eqs. (3), (4)."""
        return self.update_Phi().copy()

    def update_Phi(self) -> Array:
        """Phi in memory that stays the same; only what the closures touch is written."""
        products(self.pairs, _W, self._J, self._Phi)
        for rows, coupled in self.couplings:
            self._Phi[rows] = coupled.row(self._q)
        return self._Phi

    def Phi_dot(self, v: Array) -> Array:
        """Rate of Phi at rates v of the tree, shape (rows, nv); J and its rate are at v then."""
        self._move(v)
        self._jacobian_rates.update(self.data, self._q, v)
        Phi_dot, of_axes = np.zeros((2, *self._Phi.shape))
        products(self.pairs, _W, self._J_dot, Phi_dot)
        products(self.pairs, _W_DOT, self._J, of_axes)
        for rows, coupled in self.couplings:
            Phi_dot[rows] = coupled.row_rate(self._q, v)
        return Phi_dot + of_axes

    def drift(self, v: Array) -> Array:
        """Phi_dot v at rates v of the tree, shape (rows,), from accelerations of the frames."""
        self._move(v)
        drift = self._numbers.drift.copy()
        for rows, coupled in self.couplings:
            drift[rows] = coupled.drift(self._q, v)
        return drift

    def _move(self, v: Array) -> None:
        """Compute the rate of W, and accelerations without v_dot."""
        pin.forwardKinematics(self.model, self.data, self._q, v, self._zero)
        move(self._frames, self.pairs)


def connected(touched: NDArray[np.bool_]) -> Iterator[tuple[Indices, Indices]]:
    """Rates that rows connect, in parts that share no row and no rate.

    Args:
        touched: Which rates a row depends on, shape (rows, rates).

    Returns:
        Of each part the indices of its rows and of its rates.
    """
    part = np.arange(touched.shape[1])  # of each rate, by the name of one of them
    for row in touched:
        together = np.unique(part[row])
        part[np.isin(part, together[1:])] = together[:1]
    for name in np.unique(part):
        rates = part == name
        yield np.flatnonzero(touched[:, rates].any(axis=1)), np.flatnonzero(rates)
