# SPDX-License-Identifier: BSD-2-Clause
# cython: annotation_typing=False
"""The dynamics of a chain as control loops call it; compiled by Cython, a call takes less time."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import samples
from .current import CurrentMechanism
from .samples import by_kernel

Array = NDArray[np.float64]


class Calls:
    """Inverse and direct dynamics of a `ClosedChain`."""

    _current: CurrentMechanism

    def compute_torques(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        weights: ArrayLike | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """Inverse dynamics: the motor torques of a motion, Eq. (92).

        With more motors than degrees of freedom these are the smallest torques for the motion.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            aa: Accelerations of the coordinates, shape (..., n).
            external_wrenches: [moment; force] that acts on each body at its mass centre, in base
                axes, bodies in the order of the joints, shape (..., r, 6).
            weights: Weights of the squared torques, positive, shape (motors,); one by default.
            out: Array for the result, shape (..., motors).
            threads: Number of threads for batches in compiled kernels; the reference path uses
                one.
            on_error: "raise", or "nan" to set the results of bad samples to NaN.

        Returns:
            tau, shape (..., motors), [N m] or [N].

        Raises:
            InputError: For a wrong shape or a number that is not finite.
            ClosureError: If q is open.
            SingularConfigurationError: If the coordinates do not determine the motion at q.
            ActuationError: If the motors cannot produce the motion.

        Example:
            >>> chain.compute_torques(chain.home, [1], [0]).round(3)
            array([0.166])
        """
        current = self._current
        if current.unseen:
            current.look()
        if external_wrenches is weights is None and on_error == "raise":
            tau = current.torques_of(q, va, aa, None, out, threads)
            if tau is not None:
                return tau
        mechanism, arrays = current.arguments(q, va=va, aa=aa)
        chosen = None if weights is None else samples.motor_weights(mechanism, weights)
        return by_kernel(
            current,
            partial(current.reference.torques, weights=chosen),
            "torques" if weights is None else None,
            [*arrays, samples.external_wrenches(mechanism, external_wrenches, on_error)],
            (1, 1, 1, 2),
            (mechanism.motors.shape[1],),
            out=out,
            threads=threads,
            on_error=on_error,
        )

    def generalized_forces(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        on_error: str = "raise",
    ) -> Array:
        """Generalized forces that a motion needs: L^T times the joint forces of the tree.

        They do not depend on the motors.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            aa: Accelerations of the coordinates, shape (..., n).
            external_wrenches: As in `compute_torques`.
            out: Array for the result, shape (..., n).
            on_error: As in `compute_torques`.

        Returns:
            f, shape (..., n), [N m] or [N].

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.

        Example:
            >>> arm = sst_pin.robots.planar_4rrr()
            >>> arm.generalized_forces(arm.home, np.zeros(3), [1, 0, 0]).shape
            (3,)
        """
        current = self._current
        if current.unseen:
            current.look()
        if external_wrenches is None and on_error == "raise":
            f = current.backend.forces_of(q, va, aa, None, out, 1)
            if f is not None:
                return f
        mechanism, arrays = current.arguments(q, va=va, aa=aa)
        return by_kernel(
            current,
            current.reference.generalized_forces,
            "generalized_forces",
            [*arrays, samples.external_wrenches(mechanism, external_wrenches, on_error)],
            (1, 1, 1, 2),
            (len(mechanism.coordinates),),
            out=out,
            on_error=on_error,
        )

    def compute_accelerations(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """Direct dynamics: the accelerations of the coordinates for given torques, Eq. (92).

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            tau: Motor torques, shape (..., motors), [N m] or [N].
            external_wrenches: As in `compute_torques`.
            out: Array for the result, shape (..., n).
            threads: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Returns:
            aa, shape (..., n).

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.

        Example:
            >>> chain.compute_accelerations(chain.home, [0], [0]).round(3)
            array([-32.345])
        """
        current = self._current
        if current.unseen:
            current.look()
        if external_wrenches is None and on_error == "raise":
            aa = current.accelerations_of(q, va, tau, None, out, threads)
            if aa is not None:
                return aa
        mechanism, arrays = current.arguments(q, va=va, tau=tau)
        return by_kernel(
            current,
            current.reference.accelerations,
            "accelerations",
            [*arrays, samples.external_wrenches(mechanism, external_wrenches, on_error)],
            (1, 1, 1, 2),
            (len(mechanism.coordinates),),
            out=out,
            threads=threads,
            on_error=on_error,
        )
