# SPDX-License-Identifier: BSD-2-Clause
"""The natural orthogonal complement: L, K, T and their rates, Eqs. (3)-(25), one configuration.

Sect. 3 of the paper with its letters. Joints keep the order of the tree instead of being sorted
into actuated and unactuated.
Twists are [omega; v] at the mass centres in base axes, as in the paper; Pinocchio's run [v; omega]
at the frame's origin, and `body_jacobians` is the one place that crosses from one to the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import eigenpy
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import qr

from ..errors import SingularConfigurationError
from .closures import support

Array = NDArray[np.float64]

#: Where Phi^u counts as singular: half of the sixteen digits are lost by then.
MAX_CONDITION_NUMBER = 1e8


class Actuation(NamedTuple):
    """Which coordinates are driven.

    Attributes:
        actuated: Indices of the actuated coordinates, shape (n,).
        unactuated: Indices of the others, shape (m - n,).
        selection: Rows that pick them, q^a = selection q, shape (n, m).
    """

    actuated: NDArray[np.intp]
    unactuated: NDArray[np.intp]
    selection: Array

    @classmethod
    def of(cls, actuated: Sequence[int], m: int) -> Actuation:
        """The actuation of a robot of m coordinates."""
        a = np.array(actuated, dtype=np.intp)
        return cls(a, np.setdiff1d(np.arange(m), a), np.eye(m)[a])


class JointComplement:
    """Solver of the velocity constraints with given motor rates; a workspace, one per thread.

    Phi x = c and x^a = a are solved as one system [Phi; selection] x = [c; a], which is Eqs. (7)
    and (8) without sorting the joints. Redundant rows of Phi stay in: they are consistent, so that
    least squares over all rows equals the inverse over independent ones, and the column-pivoted
    QR tells when they are too few.

    Args:
        rows: Number of rows of Phi, redundant ones included.
        actuation: Which columns are driven.
    """

    def __init__(self, rows: int, actuation: Actuation) -> None:
        self.actuation = actuation
        n, m = actuation.selection.shape
        self._system = np.concatenate((np.zeros((rows, m)), actuation.selection))
        self._Phi = self._system[:rows]
        self._unit = np.eye(rows + n, n, -rows)
        self._factors = eigenpy.ColPivHouseholderQR(rows + n, m)
        self._factors.setThreshold(1 / MAX_CONDITION_NUMBER)

    def factorise(self, Phi: Array) -> Array:
        """Take in a configuration and return L: Phi L = 0, the unit matrix in the actuated rows.

        Args:
            Phi: Jacobian of the closures, shape (rows, m).

        Returns:
            L of Eq. (17), shape (m, n).

        Raises:
            SingularConfigurationError: When the closures do not fix the unactuated rates.
        """
        self._Phi[:] = Phi
        self._factors.compute(self._system)
        if self._factors.rank() < self._system.shape[1]:
            raise SingularConfigurationError(
                "singular configuration: the closures do not fix the unactuated joint rates",
                float(np.linalg.cond(Phi[:, self.actuation.unactuated])),
            )
        return self._solve(self._unit)  # Eq. (17)

    def solve(self, closures: Array, actuated: Array) -> Array:
        """x with Phi x = closures and x^a = actuated, for vectors or for columns side by side."""
        return self._solve(np.concatenate((closures, actuated)))

    def _solve(self, right: Array) -> Array:
        x = self._factors.solve(right)
        return x if x.ndim == right.ndim else x[:, None]  # eigenpy makes a vector of one column


def independent_rows(Phi: Array, tolerance: float = 1e-8) -> NDArray[np.intp]:
    """Indices of rows that carry the rank of Phi, by a column-pivoted QR of its transpose.

    Args:
        Phi: Shape (rows, m).
        tolerance: A pivot this much smaller than the largest counts as zero; assembled closures
            leave noise of 1e-12, a mechanism that still moves at 1e-8 is of no use.
    """
    R, order = qr(Phi.T, pivoting=True, mode="r")
    pivots = np.abs(np.diag(R))
    return np.sort(order[: np.count_nonzero(pivots > tolerance * pivots[0])])


class Bodies(NamedTuple):
    """Jacobians and inertias of all r bodies.

    Attributes:
        K: t = K q_dot, shape (6 r, m), Eqs. (11), (12).
        K_dot: Its rate, shape (6 r, m), Eq. (15).
        M: Stacked mass matrix, shape (6 r, 6 r), Eqs. (67), (69).
        Omega: Stacked angular velocities as cross-product matrices, shape (6 r, 6 r), Eq. (70).
        gravity: w^g, wrenches of the weights, shape (6 r,), Eq. (77).
    """

    K: Array
    K_dot: Array
    M: Array
    Omega: Array
    gravity: Array


def body_jacobians(model: pin.Model, data: pin.Data) -> Array:
    """K alone, shape (6 r, m), from joint Jacobians that are up to date."""
    return _reduce_to_mass_centers(model, data.J, _mass_centers(model, data)).reshape(-1, model.nv)


def bodies(model: pin.Model, data: pin.Data, q_dot: Array) -> Bodies:
    """K, K_dot, M, Omega and w^g.

    Args:
        model: The tree.
        data: With joint Jacobians and their rates up to date.
        q_dot: Joint rates, shape (m,).
    """
    c = _mass_centers(model, data)
    K = _reduce_to_mass_centers(model, data.J, c)
    # The reduction moves with the mass centre: d/dt (omega x c) has the term omega x c_dot.
    K_dot = _reduce_to_mass_centers(model, data.dJ, c)
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


def _mass_centers(model: pin.Model, data: pin.Data) -> Array:
    """Mass centres in base axes, shape (r, 3)."""
    return np.array([data.oMi[j].act(model.inertias[j].lever) for j in range(1, model.njoints)])


def _reduce_to_mass_centers(model: pin.Model, J: Array, c: Array) -> Array:
    """World Jacobian [v; omega] at the world's origin -> [omega; v] at each c, shape (r, 6, m)."""
    supports = np.array([support(model, j) for j in range(1, model.njoints)])
    columns = supports[:, None, :] * J
    v, omega = columns[:, :3], columns[:, 3:]
    return np.concatenate([omega, v + np.cross(omega, c[:, :, None], axis=1)], axis=1)
