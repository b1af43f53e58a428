# SPDX-License-Identifier: BSD-2-Clause
"""Error f(q) of the closures, their Jacobian Phi and its rate, at one configuration.

Pinocchio computes placements and Jacobians of the frames on the normal tree, and `rows` the rows of
each closure. Pinocchio's own constraint functions are not used: they are wrong or NaN in silence on
redundant loops. Rows run [linear; angular], as Pinocchio's do; the paper's order comes in with the
bodies' twists.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags, Indices
from ..errors import ClosureError, InputError
from ..model.closures import Constraint
from ..model.normal_tree import NormalTree
from ..model.thresholds import CLOSURE_TOLERANCE
from .rows import CouplingRow, FrameRows, rows_of
from .vectors import bracket_matrix, hat


class Loops:
    """The closures of one tree; one object per thread.

    `evaluate(q)` goes to a configuration. All other methods are about that configuration, and so
    are the attributes from `at` on.

    Attributes:
        model: The tree.
        tree: Its normal tree; `data` belongs to it.
        slices: Where the rows of each closure are in Phi.
        of_frames: The closures of two frames.
        couplings: The other closures: couplings of joints, and brakes of joints.
        holonomic: Which rows have an error, shape (rows,); the others hold rates only.
        touched: Which rates a row depends on, shape (rows, nv).
        curved: Which rates change Phi, shape (nv,); linear couplings do not.
        at, q: The configuration, of the model and of the normal tree.
        f: Errors of the closures, Eq. (2), shape (rows,), [m] and [rad], zero in closed loops.
    """

    def __init__(self, model: pin.Model, closures: Sequence[Constraint]) -> None:
        self.model = model
        self.tree = NormalTree(model)
        self.data = self.tree.model.createData()
        all_rows = rows_of(model, self.tree, closures)
        self.slices = tuple(rows.at for rows in all_rows)
        self.of_frames = [rows for rows in all_rows if isinstance(rows, FrameRows)]
        self.couplings = [rows for rows in all_rows if isinstance(rows, CouplingRow)]

        names = [name for closure in closures for name in closure.rows]
        holonomic = [not name.startswith(("slip", "brake")) for name in names]
        self.holonomic = np.array(holonomic, dtype=bool)
        self.touched = np.zeros((len(names), model.nv), dtype=bool)
        self.curved: Flags = np.zeros(model.nv, dtype=bool)
        for rows in all_rows:
            self.touched[rows.at] = rows.touched
            self.curved |= rows.curved
        self._parts: dict[bytes, list[tuple[Indices, Indices]]] = {}

        # For the rows of all closures of two frames together:
        #: Number of the closure of each row, shape (rows,).
        self._closure_of_row = np.zeros(len(names), dtype=np.intp)
        for k, rows in enumerate(self.of_frames):
            self._closure_of_row[rows.at] = k
        #: 1 for each rate of the normal tree that moves frame B or A of each closure, in turn, else
        #: 0, shape (2 k, rates).
        self._carries = np.array([rows.carries for rows in self.of_frames])
        self._carries = self._carries.reshape(-1, self.tree.model.nv)

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
        tree = self.tree
        data = self.data
        self.at = q = q.copy()  # the caller may change q before Phi is computed
        self.q = tree.configurations(q)
        pin.computeJointJacobians(tree.model, data, self.q)
        pin.updateFramePlacements(tree.model, data)
        self._J = np.array(data.J).reshape(6, -1)

        placements = data.oMf
        X = []
        Ad = []
        for rows in self.of_frames:
            frame_b, frame_a = rows.frames
            A = placements[frame_a]
            X.append(A.actInv(placements[frame_b]).homogeneous)
            Ad.append(A.actionInverse)
        #: Placements of B in A of each closure, shape (k, 4, 4).
        self._X = np.array(X).reshape(-1, 4, 4)
        #: Matrices that take twists in the world to twists in A, shape (k, 6, 6).
        self._Ad = np.array(Ad).reshape(-1, 6, 6)

        self.f: Array = np.zeros(len(self.touched))
        for k, rows in enumerate(self.of_frames):
            self.f[rows.at] = rows.formulas.error(self._X[k])
        for coupling in self.couplings:
            self.f[coupling.at] = coupling.error(q)
        self._W: Array | None = None
        self._Phi: Array | None = None

    @property
    def W(self) -> Array:
        """Wrenches of the rows on frame B, on A the opposite, shape (rows, 6); 0 for couplings.

        They are [force; moment] at the world's origin. A wrench W_A in the axes and at the origin
        of A is W = W_A Ad in the world: so the product with a twist t is the same, W_A Ad t.
        """
        if self._W is None:
            self._W = np.zeros((len(self.touched), 6))
            for k, rows in enumerate(self.of_frames):
                W_A = rows.formulas.W(self._X[k])
                self._W[rows.at] = W_A.dot(self._Ad[k])
        return self._W

    @property
    def Phi(self) -> Array:
        """Jacobian of f, Eqs. (3), (4), shape (rows, nv): Phi v = 0. Rows are W (J_B - J_A)."""
        if self._Phi is None:
            W = self.W
            self._Phi = np.zeros(self.touched.shape)
            for rows in self.of_frames:
                self._Phi[rows.at] = W[rows.at].dot(rows.relative_jacobian(self._J))
            for coupling in self.couplings:
                self._Phi[coupling.at] = coupling.Phi(self.at)
        return self._Phi

    def Phi_dot(self, v: Array) -> Array:
        """Rate of Phi at rates v, shape (rows, nv); sets the rates of `frame_jacobian_rate` too.

        Rows are W_dot (J_B - J_A) + W (J_dot_B - J_dot_A).
        """
        J_dot = self._jacobian_rate(v)
        W_dot = self._W_dot(self._twists(self._J, v))
        Phi_dot = np.zeros(self.touched.shape)
        for rows in self.of_frames:
            by_W_dot = W_dot[rows.at].dot(rows.relative_jacobian(self._J))
            by_J_dot = self.W[rows.at].dot(rows.relative_jacobian(J_dot))
            Phi_dot[rows.at] = by_W_dot + by_J_dot
        for coupling in self.couplings:
            Phi_dot[coupling.at] = coupling.Phi_dot(self.at, v)
        return Phi_dot

    def drift(self, v: Array) -> Array:
        """Phi_dot v, shape (rows,): W_dot t + W t_dot.

        t is the twist of B relative to A, t_B - t_A, and t_dot its rate where v_dot = 0.
        """
        drift = np.zeros(len(self.touched))
        if self.of_frames:
            twists = self._twists(self._J, v)
            accelerations = self._twists(self._jacobian_rate(v), v)
            t = (twists[:, 0] - twists[:, 1])[self._closure_of_row]
            t_dot = (accelerations[:, 0] - accelerations[:, 1])[self._closure_of_row]
            drift += np.vecdot(self._W_dot(twists), t) + np.vecdot(self.W, t_dot)
        for coupling in self.couplings:
            drift[coupling.at] = coupling.Phi_dot(self.at, v).dot(v)
        return drift

    def _jacobian_rate(self, v: Array) -> Array:
        """The rate of J at rates v of the model, shape (6, rates of the normal tree)."""
        rates = self.tree.S.dot(v)
        pin.computeJointJacobiansTimeVariation(self.tree.model, self.data, self.q, rates)
        return np.array(self.data.dJ).reshape(6, -1)

    def _twists(self, J: Array, v: Array) -> Array:
        """Twists J v of the frames B and A of each closure, shape (k, 2, 6)."""
        twists_of_rates = (J * self.tree.S.dot(v)).T
        return self._carries.dot(twists_of_rates).reshape(-1, 2, 6)

    def _W_dot(self, twists: Array) -> Array:
        """The rate of W = W_A Ad at twists of B and A of each closure, shape (k, 2, 6).

        It is W_A_dot Ad - W_A Ad [t_A x]: as A has the twist t_A, Ad has the rate -Ad [t_A x].
        """
        relative = twists[:, 0] - twists[:, 1]
        in_A = (self._Ad @ relative[:, :, None])[:, :, 0]
        X_dot = hat(in_A) @ self._X
        turning_of_A = bracket_matrix(twists[:, 1])
        W = self.W
        W_dot = np.zeros((len(self.touched), 6))
        for k, rows in enumerate(self.of_frames):
            W_A_dot = rows.formulas.W_dot(self._X[k], X_dot[k])
            W_dot[rows.at] = W_A_dot.dot(self._Ad[k]) - W[rows.at].dot(turning_of_A[k])
        return W_dot

    def evaluate_closed(self, q: Array, scale: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """`evaluate`; all errors, times the scale of their rows, must be below the tolerance."""
        self.evaluate(q)
        self.require_closed(scale, tolerance)

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

    @property
    def largest_coordinates(self) -> Array:
        """Largest absolute coordinate of the frames of each row in the world, (rows,), [m].

        The rounding of f is that of these coordinates. Couplings have no frames: 0.
        """
        largest = np.zeros(len(self.touched))
        for rows in self.of_frames:
            origins = [self.data.oMf[frame].translation for frame in rows.frames]
            largest[rows.at] = np.abs(origins).max()
        return largest

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
        for rows in self.of_frames:
            on_B = self.W[rows.at].T @ Lambda[rows.at]
            body_of_B, body_of_A = rows.bodies
            forces[body_of_B] += on_B
            forces[body_of_A] -= on_B
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
