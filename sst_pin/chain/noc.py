# SPDX-License-Identifier: BSD-2-Clause
"""The natural orthogonal complement: L, K, T and their rates, Eqs. (3)-(25), one configuration.

Sect. 3 of the paper with its letters. Joints keep the order of the tree instead of being sorted
into actuated and unactuated.
Twists are [omega; v] at the mass centres in base axes, as in the paper; Pinocchio's run [v; omega]
at the frame's origin, and `body_jacobians` is the one place that crosses from one to the other.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import SingularConfigurationError
from ..summaries import listed
from .blocks import Block, Blocks
from .loops import connected
from .mechanism import Mechanism
from .mobility import condition_number
from .tree import columns, of_rates, summed, support

Array = NDArray[np.float64]

#: Where the constraints count as singular: half of the sixteen digits are lost by then.
MAX_CONDITION_NUMBER = 1e8


class JointComplement(Blocks):
    """Solver of the velocity constraints with given rates of the coordinates; one per thread.

    Redundant rows of Phi stay in: they are consistent, so that least squares over all rows equals
    the inverse over independent ones. Rows and rates are made free of units first.

    Args:
        mechanism: Whose constraints they are.
        touched: Which rates each row of Phi depends on, shape (rows, nv).
    """

    def __init__(self, mechanism: Mechanism, touched: NDArray[np.bool_]) -> None:
        self._mechanism = mechanism
        blocks = list(_blocks(mechanism, touched))
        super().__init__(blocks, mechanism.coordinates, mechanism.model.nv)

    def factorise(self, Phi: Array) -> None:
        """Take in a configuration.

        Args:
            Phi: Jacobian of the closures, shape (rows, nv).

        Raises:
            SingularConfigurationError: When the closures do not fix the dependent rates.
        """
        if not self.decompose(Phi, 1 / MAX_CONDITION_NUMBER):
            mechanism = self._mechanism
            scaled = Phi * mechanism.row_scale[:, None] * mechanism.rate_scale
            loose = [k for b in self.blocks if not b.smallest > self.least for k in b.dependent]
            names = listed([mechanism.space.rate_names[k] for k in loose])
            raise SingularConfigurationError(
                "singular configuration: the coordinates do not determine the rates of the "
                f"dependent joints {names}; move away, or choose other coordinates=",
                condition_number(scaled, mechanism.coordinates),
            )


def _blocks(mechanism: Mechanism, touched: NDArray[np.bool_]) -> Iterator[Block]:
    coordinates, dependent = mechanism.coordinates, mechanism.dependent
    for rows, rates in connected(touched[:, dependent]):
        numbers = np.flatnonzero(touched[rows][:, coordinates].any(axis=0))
        yield Block(
            rows,
            dependent[rates],
            coordinates[numbers],
            numbers,
            mechanism.row_scale[rows],
            mechanism.rate_scale[dependent[rates]],
        )


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
    return _reduce_to_mass_centers(model, of_rates(data.J), mass_centers(model, data)).reshape(
        -1, model.nv
    )


def bodies(model: pin.Model, data: pin.Data, q_dot: Array) -> Bodies:
    """K, K_dot, M, Omega and w^g.

    Args:
        model: The tree.
        data: With joint Jacobians and their rates up to date.
        q_dot: Joint rates, shape (m,).
    """
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


def decoupled(model: pin.Model, data: pin.Data) -> tuple[Array, Array]:
    """The decoupled form K = N_l N_d of the paper's [5, 6].

    N_d holds the twists of each body that its own joint gives it, N_l carries the twists of a body
    to all that it bears: the forward recursion of inverse dynamics is N_l, the backward one its
    transpose.

    Args:
        model: The tree.
        data: With joint Jacobians up to date.

    Returns:
        N_l, shape (6 r, 6 r), with unit blocks on the diagonal and zero blocks above it, and N_d,
        shape (6 r, nv), block diagonal.
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
