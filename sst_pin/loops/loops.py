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
from .rows import CouplingRow, FrameRows, JointMotion, rows_of


class Loops:
    """The closures of one tree; one object per thread.

    `evaluate(q)` goes to a configuration. All other methods are about that configuration.

    Attributes:
        model: The tree.
        tree: Its normal tree; `data` belongs to it.
        slices: Where the rows of each closure are in Phi.
        of_frames: The closures of two frames, those of one kind together.
        couplings: The other closures, one by one.
        holonomic: Which rows have an error, shape (rows,); the others hold rates only.
        touched: Which rates a row depends on, shape (rows, nv).
        curved: Which rates change Phi, shape (nv,); linear couplings do not.
        at, q: The configuration, of the model and of the normal tree.
        f: Errors of the closures, Eq. (2), shape (rows,), [m] and [rad], zero in closed loops.
    """

    def __init__(self, model: pin.Model, closures: Sequence[Constraint]) -> None:
        self.model, self.tree = model, NormalTree(model)
        self.data = self.tree.model.createData()
        self._rows = rows_of(model, self.tree, closures)
        self.of_frames = [rows for rows in self._rows if isinstance(rows, FrameRows)]
        self.couplings = [rows for rows in self._rows if isinstance(rows, CouplingRow)]
        ends = np.cumsum([0, *(len(closure.rows) for closure in closures)])
        self.slices = tuple(slice(a, b) for a, b in pairwise(ends))
        holonomic = [not row.startswith(("slip", "brake")) for c in closures for row in c.rows]
        self.holonomic = np.array(holonomic, dtype=bool)
        self.touched = np.zeros((len(holonomic), model.nv), dtype=bool)
        self.curved: Flags = np.zeros(model.nv, dtype=bool)
        for rows in self._rows:
            self.touched[rows.at] = rows.touched
            self.curved |= rows.curved.reshape(-1, model.nv).any(axis=0)
        self._parts: dict[bytes, list[tuple[Indices, Indices]]] = {}

    def parts(self, coordinates: Indices) -> list[tuple[Indices, Indices]]:
        """Rows and dependent rates that they connect, for a choice of coordinates."""
        key = coordinates.tobytes()
        if key not in self._parts:
            dependent = np.delete(np.arange(self.model.nv), coordinates)
            parts = connected(self.touched[:, dependent])
            self._parts[key] = [(rows, dependent[rates]) for rows, rates in parts]
        return self._parts[key]

    def evaluate(self, q: Array) -> None:
        """Go to a configuration: compute placements and f. Phi is computed at its first use."""
        tree, data = self.tree, self.data
        q = self.at = q.copy()  # the caller may change q before Phi is computed
        self.q = tree.configurations(q)
        pin.computeJointJacobians(tree.model, data, self.q)
        pin.updateFramePlacements(tree.model, data)
        self._J = np.array(data.J).reshape(6, -1)
        self.f: Array = np.zeros(len(self.touched))
        self._Phi: Array | None = None
        for rows in self._rows:
            rows.evaluate(q, data)
            self.f[rows.at] = rows.f

    @property
    def Phi(self) -> Array:
        """Jacobian of f, Eq. (3), shape (rows, nv): Phi v = 0."""
        if self._Phi is None:
            self._Phi = np.zeros(self.touched.shape)
            for rows in self._rows:
                self._Phi[rows.at] = rows.Phi(self._J)
        return self._Phi

    def evaluate_closed(self, q: Array, scale: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """`evaluate`; all errors, times the scale of their rows, must be below the tolerance."""
        self.evaluate(q)
        self.require_closed(scale, tolerance)

    @property
    def largest_coordinates(self) -> Array:
        """Largest absolute coordinate of the frames of each row in the world, (rows,), [m].

        The rounding of f is that of these coordinates. Couplings have no frames: 0.
        """
        largest = np.zeros(len(self.touched))
        for closures in self.of_frames:
            largest[closures.at] = closures.largest_coordinates[:, None]
        return largest

    @property
    def W(self) -> Array:
        """[W_B, -W_A], the wrenches of the rows, shape (rows, 12); 0 for couplings."""
        W = np.zeros((len(self.touched), 12))
        for closures in self.of_frames:
            W[closures.at] = closures.W
        return W

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
        motion = self._motion(v)
        Phi_dot = np.zeros(self.touched.shape)
        for rows in self._rows:
            Phi_dot[rows.at] = rows.Phi_dot(motion)
        return Phi_dot

    def drift(self, v: Array) -> Array:
        """Phi_dot v, shape (rows,)."""
        motion = self._motion(v)
        drift = np.zeros(len(self.touched))
        for rows in self._rows:
            drift[rows.at] = rows.drift(motion)
        return drift

    def _motion(self, v: Array) -> JointMotion:
        rates, data = self.tree.S.dot(v), self.data
        pin.computeJointJacobiansTimeVariation(self.tree.model, data, self.q, rates)
        J, J_dot = self._J, np.array(data.dJ).reshape(6, -1)
        return JointMotion(v, (J * rates).T, (J_dot * rates).T, J, J_dot)

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
        for closures in self.of_frames:
            on_frames = closures.W.swapaxes(1, 2) @ Lambda[closures.at]
            np.add.at(forces, closures.bodies.ravel(), on_frames.reshape(-1, 6, Lambda.shape[1]))
        return forces


def connected(touched: Flags) -> Iterator[tuple[Indices, Indices]]:
    """Rates that rows connect, in parts that share no row and no rate.

    `touched` says which rates a row depends on, shape (rows, rates). Gives the indices of the rows
    and of the rates of each part.
    """
    # The label of each rate's part is the index of one rate in it.
    labels = np.arange(touched.shape[1])
    for row in touched:
        connected_labels = np.unique(labels[row])
        labels[np.isin(labels, connected_labels[1:])] = connected_labels[:1]
    for label in np.unique(labels):
        in_part = labels == label
        yield np.flatnonzero(touched[:, in_part].any(axis=1)), np.flatnonzero(in_part)
