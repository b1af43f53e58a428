# SPDX-License-Identifier: BSD-2-Clause
"""Error f(q) of the closures, their Jacobian Phi and its rate, at one configuration.

Pinocchio computes placements and Jacobians of the frames on the normal tree, and `rows` the rows of
each closure. Pinocchio's own constraint functions are not used: they are wrong or NaN in silence on
redundant loops. Rows run [linear; angular], as Pinocchio's do; the paper's order comes in with the
bodies' twists.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags, Indices
from ..errors import ClosureError, InputError
from ..model.closures import Constraint
from ..model.normal_tree import NormalTree
from ..model.thresholds import CLOSURE_TOLERANCE
from .rows import CouplingRow, FrameRows, rows_of


class Loops:
    """The closures of one tree; one object per thread.

    `evaluate(q)` computes what depends on q. All other methods are about that configuration.

    Attributes:
        model: The tree.
        tree: Its normal tree; `data` belongs to it.
        closures: The rows of each closure.
        slices: Where they are in Phi.
        holonomic: Rows that have an error; the others hold rates only.
        touched: Which rates a row depends on, shape (rows, nv).
        curved: Which rates change Phi, shape (nv,); linear couplings do not.
        at, q: The configuration, of the model and of the normal tree.
        f: Errors of the closures, Eq. (2), shape (rows,), [m] and [rad], zero in closed loops.
        Phi: Their Jacobian, Eq. (3), shape (rows, nv): Phi v = 0.
    """

    def __init__(self, model: pin.Model, closures: Sequence[Constraint]) -> None:
        self.model, self.tree = model, NormalTree(model)
        self.data = self.tree.model.createData()
        self.closures = [rows_of(model, self.tree, closure) for closure in closures]
        ends = np.cumsum([0, *(len(closure.rows) for closure in closures)])
        self.slices = tuple(slice(a, b) for a, b in pairwise(ends))
        holonomic = [not row.startswith(("slip", "brake")) for c in closures for row in c.rows]
        self.holonomic = np.array(holonomic, dtype=bool)
        none = np.zeros((0, model.nv), dtype=bool)
        self._none = np.zeros(0), np.zeros((0, model.nv))
        self.touched = np.vstack([none, *(rows.touched for rows in self.closures)])
        curved = np.vstack([none, *(rows.curved for rows in self.closures)])
        self.curved: Flags = np.asarray(curved.any(axis=0))
        self._parts: dict[bytes, list[tuple[Indices, Indices]]] = {}

    @property
    def of_frames(self) -> list[tuple[slice, FrameRows]]:
        """The closures of two frames, and where their rows are in Phi."""
        pairs = zip(self.slices, self.closures, strict=True)
        return [(at, rows) for at, rows in pairs if isinstance(rows, FrameRows)]

    @property
    def couplings(self) -> list[tuple[slice, CouplingRow]]:
        """The other closures, and where their rows are in Phi."""
        pairs = zip(self.slices, self.closures, strict=True)
        return [(at, rows) for at, rows in pairs if isinstance(rows, CouplingRow)]

    def parts(self, coordinates: Indices) -> list[tuple[Indices, Indices]]:
        """Rows and dependent rates that they connect, for a choice of coordinates."""
        key = coordinates.tobytes()
        if key not in self._parts:
            dependent = np.delete(np.arange(self.model.nv), coordinates)
            parts = connected(self.touched[:, dependent])
            self._parts[key] = [(rows, dependent[rates]) for rows, rates in parts]
        return self._parts[key]

    def evaluate(self, q: Array) -> None:
        """Compute what depends on q."""
        tree, data, self.at = self.tree, self.data, q
        self.q = tree.factors * q[tree.entries] + tree.offsets
        pin.computeJointJacobians(tree.model, data, self.q)
        pin.updateFramePlacements(tree.model, data)
        J = data.J.reshape(6, -1)
        for rows in self.closures:
            rows.evaluate(q, data, J)
        no_f, no_Phi = self._none
        self.f: Array = np.concatenate([no_f, *[rows.f for rows in self.closures]])
        self.Phi: Array = np.concatenate([no_Phi, *[rows.Phi for rows in self.closures]])

    def evaluate_closed(self, q: Array, scale: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """`evaluate`; all errors, times the scale of their rows, must be below the tolerance."""
        self.evaluate(q)
        self.require_closed(scale, tolerance)

    @property
    def largest_coordinates(self) -> Array:
        """Largest absolute coordinate of the frames of each row in the world, (rows,), [m].

        The rounding of f is that of these coordinates. Couplings have no frames: 0.
        """
        largest = np.zeros(len(self.f))
        for at, rows in self.of_frames:
            largest[at] = rows.largest_coordinate
        return largest

    def require_closed(self, scale: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """Check that all errors, times the scale of their rows, are below the tolerance."""
        scaled = self.f * scale
        if scaled.dot(scaled) <= tolerance**2:
            return  # sufficient: no entry is larger than the norm
        if not np.abs(scaled).max(initial=0.0) <= tolerance:
            residual = float(np.abs(self.f).max())
            if np.isnan(residual):
                raise InputError("q", "not finite")
            raise ClosureError(
                f"the loops are open by {residual:.3g} (m or rad), more than {tolerance:g} "
                "(rad, or lengths of the loop); assemble(q) closes them",
                residual,
            )

    def Phi_dot(self, v: Array) -> Array:
        """Rate of Phi at rates v, shape (rows, nv); sets the rates of `frame_jacobian_rate` too."""
        model, data = self.tree.model, self.data
        pin.computeJointJacobiansTimeVariation(model, data, self.q, self.tree.S.dot(v))
        J_dot = data.dJ.reshape(6, -1)
        rates = [rows.Phi_dot(v, data, J_dot) for rows in self.closures]
        return np.concatenate([self._none[1], *rates])

    def frame_jacobian(self, frame: int) -> Array:
        """[linear; angular] of a frame, world axes at its origin, shape (6, nv)."""
        where = self.tree.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED
        return pin.getFrameJacobian(*where).reshape(6, -1).dot(self.tree.S)

    def frame_jacobian_rate(self, frame: int) -> Array:
        """Rate of `frame_jacobian`, shape (6, nv), at the rates of `Phi_dot`."""
        where = self.tree.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED
        return pin.getFrameJacobianTimeVariation(*where).reshape(6, -1).dot(self.tree.S)

    def forces_on_bodies(self, Lambda: Array) -> Array:
        """[force; moment] at the world's origin that closures give to bodies.

        The columns of Lambda, shape (rows, k), are multipliers: the forces on the tree are Phi^T
        Lambda. Shape (joints of the normal tree, 6, k), the ground first.
        """
        forces = np.zeros((self.tree.model.njoints, 6, Lambda.shape[1]))
        for at, rows in self.of_frames:
            on_frames = (rows.W.T @ Lambda[at]).reshape(2, 6, -1)
            for body, force in zip(rows.bodies, on_frames, strict=True):
                forces[body] += force
        return forces


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
