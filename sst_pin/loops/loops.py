# SPDX-License-Identifier: BSD-2-Clause
"""Error f(q) of the closures, their Jacobian Phi and its rate, at one configuration.

Pinocchio computes placements and Jacobians of the frames on the normal tree (`NormalTree`), and
`closure_formulas` the errors and wrenches of each closure. Pinocchio's own constraint functions are
not used: on redundant loops their results are wrong or NaN without an error. Twists are [linear;
angular], as in Pinocchio; only the results of `ClosedChain.noc` have the paper's order.
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
from .closure_formulas import FramePair
from .rows import FrameRows, JointRow, rows_of


class Loops:
    """The closures of one tree; one object per thread.

    `evaluate(q)` goes to a configuration. All other methods are about that configuration, and so
    are `data` and the attributes from `q_of_model` on.

    Attributes:
        model: The tree.
        tree: Its normal tree.
        data: Pinocchio's data of the normal tree: placements of joints and frames, Jacobians.
        slices: For each closure the slice of its rows in f and Phi.
        of_frames: The rows of closures of two frames; see `rows`.
        couplings: The rows of couplings of joints, and of brakes of joints.
        holonomic: Which rows have an error, shape (rows,). The others hold rates only: those of the
            slip of wheels and of brakes.
        touched: Which rates a row depends on, shape (rows, nv).
        curved: Which rates change Phi, shape (nv,); linear couplings do not.
        q_of_model: The configuration, shape (nq,).
        q: The configuration of the normal tree, which Pinocchio's functions take with `data`.
        f: Errors of the closures, Eq. (2), shape (rows,), [m] and [rad], zero in closed loops.
    """

    def __init__(self, model: pin.Model, closures: Sequence[Constraint]) -> None:
        self.model = model
        self.tree = NormalTree(model)
        self.data = self.tree.model.createData()
        all_rows = rows_of(model, self.tree, closures)
        self.of_frames = [rows for rows in all_rows if isinstance(rows, FrameRows)]
        self.couplings = [rows for rows in all_rows if isinstance(rows, JointRow)]
        ends = np.cumsum([0, *(len(closure.rows) for closure in closures)])
        self.slices = tuple(slice(a, b) for a, b in pairwise(ends))

        names = [name for closure in closures for name in closure.rows]
        holonomic = [not name.startswith(("slip", "brake")) for name in names]
        self.holonomic = np.array(holonomic, dtype=bool)
        self.touched = np.zeros((len(names), model.nv), dtype=bool)
        self.curved: Flags = np.zeros(model.nv, dtype=bool)
        for rows in all_rows:
            self.touched[rows.at] = rows.touched
            self.curved |= rows.curved
        self._parts: dict[bytes, list[tuple[Indices, Indices]]] = {}

    def parts(self, coordinates: Indices) -> list[tuple[Indices, Indices]]:
        """The parts of Phi that share no row and no dependent rate, for a choice of coordinates.

        For each part the indices of its rows, and those of its dependent rates in v.
        """
        key = coordinates.tobytes()
        if key not in self._parts:
            dependent = np.delete(np.arange(self.model.nv), coordinates)
            parts = connected(self.touched[:, dependent])
            self._parts[key] = [(rows, dependent[rates]) for rows, rates in parts]
        return self._parts[key]

    # --- f, Phi and its rate ----------------------------------------------------------------

    def evaluate(self, q: Array) -> None:
        """Go to a configuration: compute placements and f. Phi is computed at its first use."""
        tree = self.tree
        data = self.data
        self.q_of_model = q = q.copy()  # the caller may change q before Phi is computed
        self.q = tree.configurations(q)
        pin.computeJointJacobians(tree.model, data, self.q)
        pin.updateFramePlacements(tree.model, data)
        self._J = np.array(data.J).reshape(6, -1)
        self._W_of_frames: list[Array] | None = None
        self._Phi: Array | None = None

        self.f: Array = np.zeros(len(self.touched))
        #: The placements of the frames of each item of `of_frames`.
        self._pairs: list[FramePair] = []
        placements = data.oMf
        for rows in self.of_frames:
            frame_b, frame_a = rows.frames
            pair = FramePair.of_placements(placements[frame_b], placements[frame_a])
            self._pairs.append(pair)
            self.f[rows.at] = rows.error(pair, q)
        for coupling in self.couplings:
            self.f[coupling.at] = coupling.error(q)

    def evaluate_closed(self, q: Array, scale: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """`evaluate`; all errors, times the scale of their rows, must be below the tolerance."""
        self.evaluate(q)
        self.require_closed(scale, tolerance)

    @property
    def Phi(self) -> Array:
        """Jacobian of f, Eqs. (3), (4), shape (rows, nv): Phi v = 0.

        The rows of two frames are W [J_B; J_A], where W is [W_B, -W_A], the wrenches of the rows.
        """
        if self._Phi is None:
            self._Phi = np.zeros(self.touched.shape)
            for rows, W in zip(self.of_frames, self._wrenches(), strict=True):
                self._Phi[rows.at] = rows.Phi(W, self._J)
            for coupling in self.couplings:
                self._Phi[coupling.at] = coupling.Phi(self.q_of_model)
        return self._Phi

    def Phi_dot(self, v: Array) -> Array:
        """Rate of Phi at rates v, shape (rows, nv).

        The rows of two frames are W_dot [J_B; J_A] + W [J_dot_B; J_dot_A].
        """
        rates = self.tree.S.dot(v)
        twists_of_rates = (self._J * rates).T  # row k is the twist by rate k of the normal tree
        J_dot = self._jacobian_rate(rates)
        Phi_dot = np.zeros(self.touched.shape)
        for rows, pair, W in zip(self.of_frames, self._pairs, self._wrenches(), strict=True):
            t_B, t_A = rows.twists(twists_of_rates)
            W_dot = rows.formulas.W_dot(pair, W, t_B, t_A)
            by_W_dot = W_dot.dot(rows.jacobians(self._J))
            Phi_dot[rows.at] = by_W_dot + W.dot(rows.jacobians(J_dot))
        for coupling in self.couplings:
            Phi_dot[coupling.at] = coupling.Phi_dot(self.q_of_model, v)
        return Phi_dot

    def drift(self, v: Array) -> Array:
        """Phi_dot v, shape (rows,): the rate of Phi v if v_dot = 0.

        The rows of two frames are W_dot [t_B; t_A] + W [t_dot_B; t_dot_A], by the twists of the
        frames and their rates.
        """
        rates = self.tree.S.dot(v)
        twists_of_rates = (self._J * rates).T
        twist_rates_of_rates = (self._jacobian_rate(rates) * rates).T
        drift = np.zeros(len(self.touched))
        for rows, pair, W in zip(self.of_frames, self._pairs, self._wrenches(), strict=True):
            t = rows.twists(twists_of_rates)
            t_dot = rows.twists(twist_rates_of_rates)
            W_dot = rows.formulas.W_dot(pair, W, t_B=t[0], t_A=t[1])
            drift[rows.at] = W_dot.dot(t.ravel()) + W.dot(t_dot.ravel())
        for coupling in self.couplings:
            drift[coupling.at] = coupling.Phi_dot(self.q_of_model, v).dot(v)
        return drift

    def _jacobian_rate(self, rates: Array) -> Array:
        """The rate of J at rates of the normal tree, shape (6, rates); also stored in `data`."""
        pin.computeJointJacobiansTimeVariation(self.tree.model, self.data, self.q, rates)
        return np.array(self.data.dJ).reshape(6, -1)

    def _wrenches(self) -> list[Array]:
        """W for each item of `of_frames`, shapes (rows, 12)."""
        if self._W_of_frames is None:
            self._W_of_frames = [
                rows.formulas.W(pair)
                for rows, pair in zip(self.of_frames, self._pairs, strict=True)
            ]
        return self._W_of_frames

    @property
    def W(self) -> Array:
        """[W_B, -W_A], the wrenches of the rows, shape (rows, 12); 0 for couplings."""
        W = np.zeros((len(self.touched), 12))
        for rows, W_of_rows in zip(self.of_frames, self._wrenches(), strict=True):
            W[rows.at] = W_of_rows
        return W

    # --- other quantities at the configuration ----------------------------------------------

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
        for rows, pair in zip(self.of_frames, self._pairs, strict=True):
            largest[rows.at] = max(np.abs(pair.B[:3, 3]).max(), np.abs(pair.A[:3, 3]).max())
        return largest

    def frame_jacobian(self, frame: int) -> Array:
        """Jacobian of a frame, [linear; angular], world axes at its origin, shape (6, nv).

        Frames have the same index in the model and in its normal tree.
        """
        J = pin.getFrameJacobian(self.tree.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED)
        return J.reshape(6, -1).dot(self.tree.S)

    def frame_jacobian_rate(self, frame: int, v: Array) -> Array:
        """Rate of `frame_jacobian` at rates v, shape (6, nv)."""
        self._jacobian_rate(self.tree.S.dot(v))  # stores what the next function needs in `data`
        J_dot = pin.getFrameJacobianTimeVariation(
            self.tree.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED
        )
        return J_dot.reshape(6, -1).dot(self.tree.S)

    def forces_on_bodies(self, Lambda: Array) -> Array:
        """Wrenches of the closures on the bodies, [force; moment] at the world's origin.

        The columns of Lambda, shape (rows, k), are sets of multipliers, for which the forces on the
        tree are Phi^T Lambda. The result has the shape (joints of the normal tree, 6, k), with the
        ground first.
        """
        forces = np.zeros((self.tree.model.njoints, 6, Lambda.shape[1]))
        for rows, W in zip(self.of_frames, self._wrenches(), strict=True):
            on_B_and_A = W.T @ Lambda[rows.at]
            body_of_B, body_of_A = rows.bodies
            forces[body_of_B] += on_B_and_A[:6]
            forces[body_of_A] += on_B_and_A[6:]
        return forces


def connected(touched: Flags) -> Iterator[tuple[Indices, Indices]]:
    """The parts of a matrix that share no row and no rate.

    `touched` says on which rates a row depends, shape (rows, rates). Yields for each part the
    indices of its rows and those of its rates. A rate on which no row depends is a part without
    rows.
    """
    # Each rate is a part of its own at first. The label of a part is the index of one of its rates.
    labels = np.arange(touched.shape[1])
    for row in touched:
        labels_of_row = np.unique(labels[row])
        if len(labels_of_row) > 1:  # the row connects these parts
            labels[np.isin(labels, labels_of_row)] = labels_of_row[0]
    for label in np.unique(labels):
        in_part = labels == label
        yield np.flatnonzero(touched[:, in_part].any(axis=1)), np.flatnonzero(in_part)
