# SPDX-License-Identifier: BSD-2-Clause
"""Residual f(q) of the constraints, their Jacobian Phi and its rate, at one configuration.

With the wrenches W of the closures' rows (`rows`), Pinocchio's joint Jacobian J, and the
supports S of 0 and 1 of the two frames of a closure, Phi = (W_B J) S_B - (W_A J) S_A; `tree` says
what the columns of J are. Columns in both supports are left out: what moves both frames alike
leaves a closed loop as it is. Phi_dot is W J_dot + W_dot J, and Phi_dot v is W times the
accelerations of the frames without v_dot plus W_dot times their twists. Pinocchio's own constraint
functions are not used, they are wrong or NaN in silence on redundant loops.

Rows run [linear; angular], as Pinocchio's do; the paper's order comes in with the bodies' twists.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags, Indices
from ..errors import ClosureError, InputError
from ..model.closures import Constraint, Coupling, frames_of
from ..model.thresholds import CLOSURE_TOLERANCE
from ..model.tree import (
    JacobianRates,
    frame_id,
    memory_of,
    of_rates,
    rates_of_columns,
    summed,
    support,
)
from ..model.vectors import carrying
from .couplings import Coupled
from .rows import PairRows


class Loops:
    """Closures of one tree with memory of their own: one object per thread.

    `evaluate(q)` computes what depends on q; all other methods speak of that configuration.

    Attributes:
        rows: How many rows there are.
        slices: Rows of each closure.
        holonomic: Rows that have a residual; the others hold rates only.
        touched: Which rates a row depends on: those that move one of its two frames only.
        curved: Which rates change Phi, shape (nv,); linear couplings do not.
        pairs: The rows of all closures of two frames.
        frames: Indices of the frames that they connect, after one for the world.
        supports: For each of these frames 1 for the columns of J that move it.
        couplings: The other closures, with their rows.
    """

    def __init__(self, model: pin.Model, closures: Sequence[Constraint]) -> None:
        self.model, self.data = model, model.createData()
        starts = np.cumsum([0, *(len(c.rows) for c in closures)])
        self.slices = tuple(slice(a, b) for a, b in pairwise(starts))
        self.rows = int(starts[-1])
        holonomic = [not row.startswith("slip") for c in closures for row in c.rows]
        self.holonomic = np.array(holonomic, dtype=bool)
        ends = [[frame_id(model, name) for name in frames_of(closure)] for closure in closures]
        self.frames = [0, *dict.fromkeys(frame for pair in ends for frame in pair)]
        number = {frame: k for k, frame in enumerate(self.frames[1:], start=1)}
        joints = [model.frames[frame].parentJoint for frame in self.frames]
        self._bodies = np.array(joints)
        self.supports = np.array([support(model, joint) for joint in joints])
        self.pairs = PairRows(
            [
                (closure, rows.start, *(number[frame] for frame in pair))
                for closure, rows, pair in zip(closures, self.slices, ends, strict=True)
                if not isinstance(closure, Coupling)
            ],
            len(self.frames),
            self.rows,
        )
        self.couplings = [
            (rows, Coupled(model, closure))
            for closure, rows in zip(closures, self.slices, strict=True)
            if isinstance(closure, Coupling)
        ]
        supports = self.supports[self.pairs.frames]
        #: 1 for the columns of J that move one frame of a row and not the other, by frame and row.
        self._alone = np.asarray(supports > supports[::-1], dtype=float)
        self._rates = rates_of_columns(model)
        self.touched = summed(model, self._alone.sum(axis=0)) > 0
        curved = self.touched.copy()
        for rows, coupled in self.couplings:
            self.touched[rows], curved[rows] = coupled.touched, coupled.curved
        self.curved = curved.any(axis=0)
        self._jacobian_rates = JacobianRates(model)
        self._parts: dict[bytes, list[tuple[Indices, Indices]]] = {}
        self._J, self._J_dot = of_rates(self.data.J), of_rates(self.data.dJ)
        self._placements = [self.data.oMf[frame] for frame in self.frames[1:]]
        #: Frames as `PairRows` has them: origin, axes x, y, z.
        self._at_world = np.tile(np.eye(4)[[3, 0, 1, 2]], (len(self.frames), 1, 1))
        self._numbers: list[Array] = [np.empty((0, 3))]
        for placement in self._placements:
            self._numbers.append(memory_of(placement, "translation")[None])
            self._numbers.append(memory_of(placement, "rotation").T)

    def parts(self, coordinates: Indices) -> list[tuple[Indices, Indices]]:
        """Rows and dependent rates that they connect, for a choice of coordinates."""
        key = coordinates.tobytes()
        if key not in self._parts:
            dependent = np.delete(np.arange(self.model.nv), coordinates)
            found = connected(self.touched[:, dependent])
            self._parts[key] = [(rows, dependent[rates]) for rows, rates in found]
        return self._parts[key]

    def evaluate(self, q: Array) -> None:
        """Compute what depends on q."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        self._q, self._x = q, self._at_world.copy()
        self._x[1:, :, :3] = np.concatenate(self._numbers).reshape(-1, 4, 3)
        self._vectors = self.pairs.vectors(self._x)
        self._f = self.pairs.residual(self._x, self._vectors)
        self._W = self.pairs.wrenches(self._vectors)
        for rows, coupled in self.couplings:
            self._f[rows] = coupled.residual(q)

    @property
    def distance(self) -> float:
        """Largest coordinate of the closures' frames in the world, [m]."""
        return float(np.abs(self._x[:, 0, :3]).max())

    def residual(self) -> Array:
        """f(q) of Eq. (2), shape (rows,), [m] and [rad], zero when the loops are closed."""
        return self._f.copy()

    def require_closed(self, scale: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """Check that all residuals, times the scale of their rows, stay below the tolerance."""
        f = self._f
        scaled = f * scale
        if scaled.dot(scaled) <= tolerance**2:
            return  # the short way: no row is longer than all
        if not np.abs(scaled).max(initial=0.0) <= tolerance:
            residual = float(np.abs(f).max())
            if np.isnan(residual):
                raise InputError("q", "not finite")
            raise ClosureError(
                f"the loops are open by {residual:.3g} (m or rad), more than {tolerance:g} of the "
                "length of its loop or rad; assemble(q) closes them",
                residual,
            )

    def Phi(self) -> Array:
        """Jacobian of the closures, shape (rows, nv): Phi v = 0."""
        Phi = self._rows_times(self._W, self._J)  # Eqs. (3), (4)
        for rows, coupled in self.couplings:
            Phi[rows] = coupled.row(self._q)
        return Phi

    def Phi_dot(self, v: Array) -> Array:
        """Rate of Phi at rates v of the tree, shape (rows, nv); J and its rate are at v then."""
        W_dot, _, _ = self._move(v)
        Phi_dot = self._rows_times(self._W, self._J_dot) + self._rows_times(W_dot, self._J)
        for rows, coupled in self.couplings:
            Phi_dot[rows] = coupled.row_rate(self._q, v)
        return Phi_dot

    def drift(self, v: Array) -> Array:
        """Phi_dot v at rates v of the tree, shape (rows,), from accelerations of the frames."""
        W_dot, twists, accelerations = self._move(v)
        both = self.pairs.frames
        at_b, at_a = np.vecdot(W_dot, twists.take(both, axis=0))
        at_b_too, at_a_too = np.vecdot(self._W, accelerations.take(both, axis=0))
        drift: Array = at_b + at_a + at_b_too + at_a_too
        for rows, coupled in self.couplings:
            drift[rows] = coupled.row_rate(self._q, v).dot(v)
        return drift

    def forces_on_bodies(self, Lambda: Array) -> Array:
        """[force; moment] at the world's origin that closures give to bodies, shape (1 + r, 6, k).

        The columns of Lambda, shape (rows, k), are multipliers: the forces on the tree are Phi^T
        Lambda. The ground comes first.
        """
        given = np.zeros((self.model.njoints, 6, Lambda.shape[1]))
        np.add.at(given, self._bodies[self.pairs.frames], self._W[..., None] * Lambda[:, None])
        return given

    def by_placements(self, joints: Sequence[int], frames: Sequence[int]) -> Array:
        """Derivatives of f by displacements of placements, shape (rows, 6 (joints + frames)).

        A displacement is [linear; angular] in the axes of the joint or frame that it moves.
        """
        model, data, both = self.model, self.data, self.pairs.frames
        supports = [set(model.supports[int(body)]) for body in self._bodies]
        moved = [np.array([j in bodies for bodies in supports]) for j in joints]
        moved += [np.array(self.frames) == k for k in frames]
        at = [data.oMi[model.parents[j]] * model.jointPlacements[j] for j in joints]
        at += [data.oMf[k] for k in frames]
        columns = []
        for moves, place in zip(moved, at, strict=True):
            alone = moves[both] > moves[both[::-1]]
            columns.append((self._W * alone[..., None]).sum(axis=0) @ place.action)
        return np.hstack(columns)

    def on_B(self, rows: slice) -> Array:
        """Wrenches of the rows of a closure on frame B, at the world's origin, shape (rows, 6)."""
        return self._W[0, rows]

    def _move(self, v: Array) -> tuple[Array, Array, Array]:
        """W_dot, and the frames' twists and accelerations with v_dot = 0, shape (frames, 6)."""
        self._jacobian_rates.update(self.data, self._q, v)
        moved_by = self.supports * v[self._rates]
        twists, accelerations = moved_by.dot(self._J.T), moved_by.dot(self._J_dot.T)
        rates = self.pairs.vector_rates(self._x, self._x @ carrying(twists))
        return self.pairs.wrench_rates(self._vectors, rates), twists, accelerations

    def _rows_times(self, W: Array, J: Array) -> Array:
        """W J at B for what moves B only, less that at A for what moves A only: W has the sign."""
        at_b, at_a = (W @ J) * self._alone
        return summed(self.model, at_b + at_a)


def connected(touched: Flags) -> Iterator[tuple[Indices, Indices]]:
    """Rates that rows connect, in parts that share no row and no rate.

    `touched` says which rates a row depends on, shape (rows, rates). Gives the indices of the rows
    and of the rates of each part.
    """
    part = np.arange(touched.shape[1])  # of each rate, by the name of one of them
    for row in touched:
        together = np.unique(part[row])
        part[np.isin(part, together[1:])] = together[:1]
    for name in np.unique(part):
        rates = part == name
        yield np.flatnonzero(touched[:, rates].any(axis=1)), np.flatnonzero(rates)
