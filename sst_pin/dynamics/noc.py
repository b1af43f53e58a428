# SPDX-License-Identifier: BSD-2-Clause
"""The natural orthogonal complement: L, K, T and their rates, Eqs. (3)-(25), one configuration.

Sect. 3 of the paper with its letters. Joints keep the order of the tree instead of being sorted
into actuated and unactuated. Twists are [omega; v] at the mass centres in base axes, as in the
paper; Pinocchio's run [v; omega] at the frame's origin, and `body_jacobians` is the one place that
crosses from one to the other.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags, Indices
from ..errors import SingularConfigurationError
from ..loops.loops import connected
from ..loops.mobility import choose_coordinates, condition_number
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE, INCONSISTENT, MAX_CONDITION_NUMBER
from ..model.tree import columns, of_rates, summed, support
from ..summaries import listed


class _Block:
    """Part of Phi^u: rows, and dependent rates that are in these rows only.

    Attributes:
        rows, rates: Indices of the rows, and of the dependent rates in v.
        scale: What makes Phi^u free of units, shape (rows, rates).
        of_u, of_a: Where the block's Phi^u and Phi^a stand in Phi.
        of_inverse: Where its inverse stands in that of all.
    """

    def __init__(
        self, mechanism: Mechanism, touched: Flags, rows: Indices, dependent: Indices
    ) -> None:
        self.rows, self.rates = rows, mechanism.dependent[dependent]
        column, nv = rows[:, None], mechanism.model.nv
        self.scale = mechanism.row_scale[column] * mechanism.rate_scale[self.rates]
        self.of_u, self.of_a = column * nv + self.rates, column * nv + mechanism.coordinates
        self.of_inverse = self.rates[:, None] * len(touched) + rows


class JointComplement:
    """L and the inverse of Phi^u at one configuration; one object per thread.

    Redundant rows of Phi stay in: they are consistent, so that least squares over all rows equals
    the inverse over independent ones. Rows and rates are made free of units first. Loops that share
    no dependent joint are inverted apart, so that the cost is linear in their number.

    Attributes:
        blocks: The parts of Phi^u that share no dependent rate.
        L: Joint orthogonal complement, shape (nv, n), Eq. (17): Phi L = 0.
        inverse: G, shape (nv, rows): x = G c solves Phi x = c with coordinates at rest.
    """

    def __init__(self, mechanism: Mechanism, touched: Flags) -> None:
        from scipy.linalg import blas, lapack  # an import takes a microsecond at each call

        self._mechanism, self._lapack, self._dtrsm = mechanism, lapack, blas.dtrsm
        self._row_scale = mechanism.row_scale[:, None]
        self._units = mechanism.rate_scale[:, None], mechanism.rate_scale[mechanism.coordinates]
        self.blocks = [
            _Block(mechanism, touched, *part) for part in connected(touched[:, mechanism.dependent])
        ]
        self.inverse = np.zeros(touched.T.shape)

    def factorise(self, Phi: Array, f: Array | float = 0.0) -> None:
        """Compute L and the inverse; the error says which rates the closures do not fix.

        Redundant rows must hold too, but for what loops that are open by f, Eq. (2), explain.
        """
        self.L: Array = self._mechanism.selection.T.copy()
        smallest, largest = [], 1.0  # pivots of the coordinates are 1
        for block in self.blocks:
            inverse, pivots = self._least_squares(Phi.take(block.of_u) * block.scale)
            inverse *= block.scale.T
            self.inverse.put(block.of_inverse, inverse)
            self.L[block.rates] = -inverse.dot(Phi.take(block.of_a))  # Eqs. (7), (17)
            largest = max(largest, pivots[0])
            smallest.append(pivots[1])
        if not all(pivot * MAX_CONDITION_NUMBER > largest for pivot in smallest):
            self._refuse(Phi, largest / MAX_CONDITION_NUMBER, smallest)
        per_rate, per_coordinate = self._units
        left = (self._row_scale * Phi.dot(self.L) * per_coordinate).ravel()  # Phi L = 0
        bound = INCONSISTENT * CLOSURE_TOLERANCE * largest
        if left.dot(left) <= bound**2:
            return  # the short way: no entry of L is as large as those of its coordinates, 1
        gap = np.abs(self._row_scale.ravel() * f).max() * largest / min(smallest, default=1.0)
        bound *= (1 + gap / CLOSURE_TOLERANCE) * np.abs(self.L / per_rate * per_coordinate).max()
        if not np.abs(left).max() <= bound:
            self._refuse(Phi, 0.0, smallest)

    def _least_squares(self, A: Array) -> tuple[Array, tuple[float, float]]:
        """(A^T A)^-1 A^T by a QR decomposition with column pivoting; first and last pivot."""
        m, d = A.shape
        if m < d:
            return np.zeros((d, m)), (0.0, 0.0)
        QR, order, tau, _, _ = self._lapack.dgeqp3(A)
        first, last = abs(QR[0, 0]), abs(QR[d - 1, d - 1])
        if not last * MAX_CONDITION_NUMBER > first:
            return np.zeros((d, m)), (first, last)  # the inverse could be infinite
        inverse = np.empty((d, m))
        Q, _, _ = self._lapack.dorgqr(QR, tau)
        inverse[order - 1] = self._dtrsm(1.0, QR[:d], Q.T)  # dtrtrs starts threads, which wait long
        return inverse, (first, last)

    def _refuse(self, Phi: Array, least: float, smallest: list[float]) -> None:
        mechanism = self._mechanism
        verdicts = zip(self.blocks, smallest, strict=True)
        loose = [rate for block, pivot in verdicts if not pivot > least for rate in block.rates]
        scaled = Phi * mechanism.row_scale[:, None] * mechanism.rate_scale
        names = listed(mechanism.coordinate_rate_names)
        why = f"the closures hold the coordinates {names} themselves"
        if loose:
            names = listed([mechanism.space.rate_names[k] for k in loose])
            why = f"the coordinates do not determine the rates of the dependent joints {names}"
        others = choose_coordinates(mechanism, np.nan_to_num(scaled))
        names, k = listed(mechanism.space.names_of(others.tolist())), len(others)
        n = len(mechanism.coordinates)
        cure = (
            f"move away, or choose other coordinates=, for example {names} describe the motion here"
        )
        if k > n:
            cure = (
                f"the closures leave {k} freedoms here to {n} coordinates; move away, or where "
                f"they do so everywhere give {k} coordinates=, for example {names}"
            )
        if not k:
            cure = "nothing can move here"
        raise SingularConfigurationError(
            f"singular configuration: {why}; {cure}",
            condition_number(
                mechanism, scaled, [(block.rows, block.rates) for block in self.blocks]
            ),
        )

    def accelerations(self, aa: Array, drift: Array) -> Array:
        """v_dot with Phi v_dot = -drift, drift = Phi_dot v, shape (nv,)."""
        return self.L.dot(aa) - self.inverse.dot(drift)  # Eqs. (8), (20)

    def L_dot(self, Phi_dot: Array) -> Array:
        """Rate of L, shape (nv, n): the rate of Phi L = 0 is Phi L_dot = -Phi_dot L."""
        return -self.inverse.dot(Phi_dot.dot(self.L))  # Eq. (20)


class Bodies(NamedTuple):
    """Jacobians and inertias of all r bodies."""

    #: t = K q_dot, shape (6 r, m), Eqs. (11), (12).
    K: Array
    #: Its rate, shape (6 r, m), Eq. (15).
    K_dot: Array
    #: Stacked mass matrix, shape (6 r, 6 r), Eqs. (67), (69).
    M: Array
    #: Stacked angular velocities as cross-product matrices, shape (6 r, 6 r), Eq. (70).
    Omega: Array
    #: w^g, wrenches of the weights, shape (6 r,), Eq. (77).
    gravity: Array


def body_jacobians(model: pin.Model, data: pin.Data) -> Array:
    """K alone, shape (6 r, m), from joint Jacobians that are up to date."""
    return _reduce_to_mass_centers(model, of_rates(data.J), mass_centers(model, data)).reshape(
        -1, model.nv
    )


def bodies(model: pin.Model, data: pin.Data, q_dot: Array) -> Bodies:
    """K, K_dot, M, Omega and w^g; joint Jacobians and their rates in `data` are up to date."""
    c = mass_centers(model, data)
    K = _reduce_to_mass_centers(model, of_rates(data.J), c)
    # The reduction moves with the mass centre: d/dt (omega x c) has the term omega x c_dot.
    K_dot = _reduce_to_mass_centers(model, of_rates(data.dJ), c)
    c_dot = K[:, 3:] @ q_dot
    K_dot[:, 3:] += np.cross(K[:, :3], c_dot[:, :, None], axis=1)
    omega = K[:, :3] @ q_dot

    r = model.njoints - 1
    M, Omega, weights = np.zeros((r, 6, r, 6)), np.zeros((r, 6, r, 6)), np.zeros((r, 6))
    for i, body in enumerate(list(model.inertias)[1:]):
        R = data.oMi[i + 1].rotation
        M[i, :3, i, :3] = R @ body.inertia @ R.T  # Eq. (67)
        M[i, 3:, i, 3:] = body.mass * np.eye(3)
        Omega[i, :3, i, :3] = pin.skew(omega[i])  # Eq. (67), as a cross-product matrix
        weights[i, 3:] = body.mass * model.gravity.linear
    return Bodies(
        K.reshape(-1, model.nv),
        K_dot.reshape(-1, model.nv),
        M.reshape(6 * r, 6 * r),
        Omega.reshape(6 * r, 6 * r),
        weights.ravel(),
    )


def natural_complement(bodies: Bodies, L: Array, L_dot: Array) -> tuple[Array, Array]:
    """T and its rate, shape (6 r, n): t = T va, t_dot = T aa + T_dot va, Eqs. (21), (24)."""
    T = bodies.K @ L  # Eqs. (22), (23)
    T_dot = bodies.K_dot @ L + bodies.K @ L_dot  # Eq. (25)
    return T, T_dot


def decoupled(model: pin.Model, data: pin.Data) -> tuple[Array, Array]:
    """N_l, shape (6 r, 6 r), and N_d, shape (6 r, nv), with K = N_l N_d, of the paper's [5, 6].

    N_d, block diagonal, holds the twists of each body that its own joint gives it; N_l, with unit
    blocks on the diagonal and zeros above, carries the twists of a body to all that it bears. The
    forward recursion of inverse dynamics is N_l, the backward one its transpose.
    """
    c = mass_centers(model, data)
    r = len(c)
    N_l, N_d = np.zeros((r, 6, r, 6)), np.zeros((r, 6, model.nv))
    for i in range(r):
        own = np.zeros(model.nvExtended)
        own[columns(model, i + 1)] = 1
        N_d[i] = _reduced(model, of_rates(data.J) * own, c[i])
        for bearer in list(model.supports[i + 1])[1:]:
            carried = np.eye(6)
            carried[3:, :3] = -pin.skew(c[i] - c[bearer - 1])  # v_i = v_j + omega x (c_i - c_j)
            N_l[i, :, bearer - 1] = carried
    return N_l.reshape(6 * r, 6 * r), N_d.reshape(6 * r, model.nv)


def mass_centers(model: pin.Model, data: pin.Data) -> Array:
    """Mass centres in base axes, shape (r, 3)."""
    return np.array([data.oMi[j].act(model.inertias[j].lever) for j in range(1, model.njoints)])


def _reduce_to_mass_centers(model: pin.Model, J: Array, c: Array) -> Array:
    """World Jacobian [v; omega] at the world's origin -> [omega; v] at each c, shape (r, 6, m)."""
    supports = np.array([support(model, j) for j in range(1, model.njoints)])
    return _reduced(model, supports[:, None, :] * J, c)


def _reduced(model: pin.Model, twists: Array, c: Array) -> Array:
    v, omega = np.split(summed(model, twists), 2, axis=-2)
    return np.concatenate([omega, v + np.cross(omega, c[..., None], axis=-2)], axis=-2)
