# SPDX-License-Identifier: BSD-2-Clause
"""Direct dynamics of many coordinates by kernels of inverse dynamics.

The mass matrix of many coordinates is too large to be written out. Its column k is the generalized
forces that the accelerations e_k need at rest, without weights and springs; a kernel computes all
columns of a sample side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Indices
from ..chain.backend import NoKernel
from ..chain.dynamics import solved
from ..chain.mechanism import Mechanism

if TYPE_CHECKING:
    from ._binding import Kernel


class ByColumns(NoKernel):
    """Accelerations from Eq. (92) with the mass matrix column by column.

    `forces` gives the kernel of generalized forces, with or without loads, `inertial` is the one
    without weights and springs, `rates` that of v = L va.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        forces: Callable[[bool], Kernel],
        inertial: Kernel,
        rates: Kernel,
    ) -> None:
        self._mechanism, self._forces = mechanism, forces
        self._inertial, self._rates = inertial, rates
        self._unit = np.eye(len(mechanism.coordinates))

    def many(self, arrays: tuple[Array, ...], out: Array, threads: int = 1) -> Indices:
        """Fill the accelerations; indices of samples that fail the checks of the kernels."""
        q, va, tau, *load = arrays
        f = np.empty(out.shape)
        left = np.zeros(len(out), dtype=bool)
        left[self._forces(bool(load)).many((q, va, None, *load), f, threads)] = True
        for i in np.flatnonzero(~left):
            inertia = np.empty(self._unit.shape)  # Eq. (93), symmetric
            failed = self._inertial.many((q[i], None, self._unit), inertia, threads)
            given = tau[i] if self._mechanism.driven_one_to_one else self._given(q[i], tau[i])
            aa = solved(inertia, given - f[i])
            left[i] = len(failed) or aa is None or not np.isfinite(aa).all()
            out[i] = np.nan if aa is None else aa
        return np.flatnonzero(left)

    def _given(self, q: Array, tau: Array) -> Array:
        """L^T B tau: what the motors give along the coordinates; NaN at a singularity."""
        L = np.empty((len(self._unit), self._mechanism.model.nv))  # transposed
        if len(self._rates.many((q, self._unit), L)):
            return np.full(len(L), np.nan)
        return L.dot(self._mechanism.motors.dot(tau))

    def state_rate(self, q: Array, va: Array, tau: Array, wrenches: Array | None) -> Array | None:
        """Rates of q and va at one closed configuration; None where the kernels fail."""
        load = () if wrenches is None else (wrenches.reshape(1, -1),)
        aa, v = np.empty((1, len(va))), np.empty((1, self._mechanism.model.nv))
        state = q[None], va[None]
        if len(self.many((*state, tau[None], *load), aa)) or len(self._rates.many(state, v)):
            return None
        return np.concatenate([self._mechanism.space.coordinate_rates(q, v[0]), aa[0]])
