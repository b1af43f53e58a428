# SPDX-License-Identifier: BSD-2-Clause
"""Residual f(q) of the constraints, their Jacobian Phi and its rate, at one configuration.

With the wrenches W of the closures' rows (`closure_kinds`), Pinocchio's joint Jacobian J, and the
supports S of 0 and 1 of the two frames of a closure, Phi = (W J) S_B - (W J) S_A; `tree` says what
the columns of J are. Phi_dot v is W_dot times the twists of the frames, and W times their
accelerations without v_dot. Pinocchio's own constraint functions are not used, they are wrong or
NaN in silence on redundant loops.

Rows run [linear; angular], as Pinocchio's do; the paper's order comes in with the bodies' twists.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import ClosureError, InputError
from .closure_kinds import Ends, Kind, Rates, Welds, kinds_of
from .closures import Constraint, Coupling, frames_of
from .couplings import Coupled
from .tree import JacobianRates, frame_id, memory_of, of_rates, summed, support
from .vectors import cross

Array = NDArray[np.float64]

#: Loops further open than this are open, relative to the length of the robot or in [rad].
CLOSURE_TOLERANCE = 1e-6


class _Group(NamedTuple):
    """Closures of one kind: which of all, counted kind by kind, their frames B, A and wrenches."""

    kind: Kind
    of_all: slice
    indices: NDArray[np.intp]
    frames: list[tuple[pin.SE3, pin.SE3]]
    rows: slice
    W: Array
    W_dot: Array


class Loops:
    """Closures of one tree with memory of their own: one object per thread.

    `evaluate(q)` computes what depends on q; all other methods speak of that configuration.

    Args:
        model: The tree; it must not change afterwards.
        closures: What closes it.

    Raises:
        UnknownNameError: For a frame or joint that the model does not have.
        DescriptionError: For a coupling of joints that have several coordinates.
    """

    def __init__(self, model: pin.Model, closures: Sequence[Constraint]) -> None:
        self.model, self.data = model, model.createData()
        starts = np.cumsum([0, *(len(c.rows) for c in closures)])
        #: Rows of each closure.
        self.slices = tuple(slice(a, b) for a, b in pairwise(starts))
        self.rows = int(starts[-1])
        #: Rows that have a residual; the others hold rates only.
        self.holonomic = np.array([not row.startswith("slip") for c in closures for row in c.rows])
        self._couplings = [
            (rows, Coupled(model, closure))
            for rows, closure in zip(self.slices, closures, strict=True)
            if isinstance(closure, Coupling)
        ]
        self._jacobian_rates = JacobianRates(model)
        self._put_together(closures)
        #: Which rates a row depends on: those that move one of its two frames only.
        self.touched = np.zeros((self.rows, model.nv), dtype=bool)
        at_b, at_a = np.split(self._S, 2)
        moving = summed(model, at_b + at_a != 0)  # at A the signs are turned
        self.touched[self._at] = moving.astype(bool)
        for rows, coupled in self._couplings:
            self.touched[rows] = coupled.touched
        self._J, self._J_dot = of_rates(self.data.J), of_rates(self.data.dJ)

    def _put_together(self, closures: Sequence[Constraint]) -> None:
        """Closures kind by kind, with the joints that bear their frames and room for wrenches."""
        model, placements = self.model, self.data.oMf
        kinds = list(kinds_of(closures))
        members = [i for _, group in kinds for i in group]
        counts = [len(closures[i].rows) for i in members]
        #: Where the rows of pairs of frames, kind by kind, go among all rows.
        self._at = np.concatenate(
            [np.empty(0, dtype=np.intp)] + [np.r_[self.slices[i]] for i in members]
        )
        self._in_order = np.array_equal(self._at, np.arange(self.rows))
        self._pair_rows = len(self._at)
        ends = np.array(
            [[frame_id(model, n) for n in frames_of(closures[i])][::-1] for i in members],
            dtype=np.intp,
        ).reshape(-1, 2)
        #: Which of the joints that bear closures bears frames B and A.
        joints = sorted({model.frames[f].parentJoint for f in ends.ravel().tolist()})
        bearers = [
            [joints.index(model.frames[f].parentJoint) for f in side] for side in ends.T.tolist()
        ]
        self._bearers = np.array(bearers, dtype=np.intp).reshape(2, -1)
        self._bearers_of_rows = np.repeat(self._bearers, counts, axis=1)
        supports = np.array([support(model, j) for j in joints]).reshape(-1, model.nvExtended)
        self._supports = supports
        self._S = supports[self._bearers_of_rows].reshape(-1, model.nvExtended)
        self._S[self._pair_rows :] *= -1
        self._wrenches = np.zeros((2, self._pair_rows, 12))  # [W_dot, W] at B and A
        self._W_dot, self._W = np.split(self._wrenches.reshape(-1, 12), 2, axis=1)
        self._p, self._R = (memory_of(placements, x) for x in ("translation", "rotation"))
        #: Of each column, its twist and acceleration.
        self._motions = np.empty((12, model.nvExtended))
        self._groups: list[_Group] = []
        first = row = 0
        for kind, alike in kinds:
            k, size = len(alike), len(closures[alike[0]].rows)
            rows = slice(row, row + k * size)
            both = self._wrenches[:, rows].reshape(2, k, size, 12)
            frames = [(placements[b], placements[a]) for b, a in ends[first : first + k].tolist()]
            of_all = slice(first, first + k)
            self._groups.append(
                _Group(kind, of_all, ends[of_all].T, frames, rows, both[..., 6:], both[..., :6])
            )
            first, row = first + k, row + k * size
        for group in self._groups:
            group.kind.constant(group.W)
        self._moving = [group for group in self._groups if not group.kind.fixed]
        # Rows that are the same at both frames see the relative twist alone.
        one_row = all(group.kind.same_row for group in self._groups)
        at_b, at_a = np.split(self._S, 2)
        self._relative = at_b + at_a if one_row else None
        self._welds_only = not self._couplings and all(
            type(group.kind) is Welds for group in self._groups
        )

    def evaluate(self, q: Array) -> None:
        """Compute what depends on q."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        self._q, self._fresh = q, False
        self._known_ends: dict[int, Ends] = {}

    def _ends(self, group: _Group) -> Ends:
        """Frames of a group, read once for each configuration."""
        known, first = self._known_ends, group.rows.start
        if first not in known:
            p = self._p.take(group.indices, axis=0)
            R = self._R.take(group.indices, axis=0) if group.kind.axes else p
            known[first] = Ends(group.frames, p, R)
        return known[first]

    def _update_wrenches(self) -> None:
        """Compute W, once for each configuration."""
        if not self._fresh:
            for group in self._moving:
                group.kind.wrenches(self._ends(group), group.W)
            self._fresh = True

    def _update_wrench_rates(self, twists: Array) -> None:
        """Compute the rates of W.

        Args:
            twists: Of the joints that bear closures, shape (joints, 6).
        """
        if not self._moving:
            return
        of_ends = twists.take(self._bearers, axis=0)
        for group in self._moving:
            ends, of_group = self._ends(group), of_ends[:, group.of_all]
            omega = of_group[..., 3:]
            rates = Rates(of_group[..., :3] + cross(omega, ends.p), omega)
            group.kind.wrench_rates(ends, rates, group.W_dot)

    def residual(self) -> Array:
        """f(q) of Eq. (2), shape (rows,), [m] and [rad], zero when the loops are closed."""
        of_groups = [group.kind.residual(self._ends(group)).ravel() for group in self._groups]
        if self._in_order:
            return np.concatenate(of_groups) if len(of_groups) > 1 else of_groups[0]
        f = np.empty(self.rows)
        for group, of_group in zip(self._groups, of_groups, strict=True):
            f[self._at[group.rows]] = of_group
        for rows, coupled in self._couplings:
            f[rows] = coupled.residual(self._q)
        return f

    def coincide(self, tolerance: float) -> bool:
        """Whether all frames are welded and coincide: at a third of the time of `residual`."""
        return self._welds_only and all(
            A.actInv(B).isIdentity(tolerance) for group in self._groups for B, A in group.frames
        )

    def require_closed(self, scale: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """Check that all loops are closed.

        Args:
            scale: Of each row, by which its residual is multiplied, shape (rows,).
            tolerance: Of the scaled residual.

        Raises:
            InputError: When q is not finite.
            ClosureError: When a loop is open.
        """
        f = self.residual()
        if not (np.abs(f) * scale).max(initial=0.0) <= tolerance:
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
        self._update_wrenches()
        Phi = self._all_rows(self._relative_rows(self._W, self._J))
        for rows, coupled in self._couplings:
            Phi[rows] = coupled.row(self._q)
        return Phi

    def Phi_dot(self, v: Array) -> Array:
        """Rate of Phi at rates v of the tree, shape (rows, nv); J and its rate are at v then."""
        self._move(v)
        Phi_dot = self._relative_rows(self._W, self._J_dot)
        if self._moving:
            Phi_dot += self._relative_rows(self._W_dot, self._J)
        Phi_dot = self._all_rows(Phi_dot)
        for rows, coupled in self._couplings:
            Phi_dot[rows] = coupled.row_rate(self._q, v)
        return Phi_dot

    def drift(self, v: Array) -> Array:
        """Phi_dot v at rates v of the tree, shape (rows,), from accelerations of the frames."""
        motions = self._move(v).take(self._bearers_of_rows, axis=0)
        motions *= self._wrenches
        at_b, at_a = motions.sum(axis=2)
        if self._in_order:
            return np.asarray(at_b - at_a)
        drift = np.empty(self.rows)
        drift[self._at] = at_b - at_a
        for rows, coupled in self._couplings:
            drift[rows] = coupled.drift(self._q, v)
        return drift

    def _move(self, v: Array) -> Array:
        """Compute the rates of J and W.

        Returns:
            Twists, and accelerations without v_dot, of the joints that bear closures, shape
            (joints, 12).
        """
        self._jacobian_rates.update(self.data, self._q, v)
        of_columns, motions = self._jacobian_rates.of_columns(v), self._motions
        np.multiply(self._J, of_columns, out=motions[:6])
        np.multiply(self._J_dot, of_columns, out=motions[6:])
        of_joints: Array = self._supports.dot(motions.T)
        self._update_wrenches()
        self._update_wrench_rates(of_joints[:, :6])
        return of_joints

    def _relative_rows(self, W: Array, J: Array) -> Array:
        """Rows at frame B, for what moves it, less those at frame A, for what moves that."""
        n = self._pair_rows
        if self._relative is not None:
            return W[:n].dot(J) * self._relative
        both = W.dot(J)
        both *= self._S
        return both[:n] + both[n:]

    def _all_rows(self, of_pairs: Array) -> Array:
        """Rows of the rates of the tree, closure after closure; those of couplings are free."""
        of_pairs = summed(self.model, of_pairs)
        if self._in_order:
            return of_pairs
        rows = np.empty((self.rows, self.model.nv))
        rows[self._at] = of_pairs
        return rows
