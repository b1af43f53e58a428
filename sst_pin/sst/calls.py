# SPDX-License-Identifier: BSD-2-Clause
# cython: annotation_typing=False
"""The dynamics of an SST as control loops call it, with moments on the star; see `chain/calls`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..chain.closed_chain import ClosedChain
from .kernel_path import with_moment

Array = NDArray[np.float64]


class Calls(ClosedChain):
    """Inverse and direct dynamics of an `SST`."""

    def compute_torques(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        platform_moment: ArrayLike | None = None,
        external_wrenches: ArrayLike | None = None,
        weights: ArrayLike | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """Inverse dynamics: the motor torques of a motion, Eq. (92).

        Args:
            q: Joint coordinates on the closures, shape (..., 9), [rad].
            va: Motor rates, shape (..., 3), [rad/s].
            aa: Motor accelerations, shape (..., 3), [rad/s^2].
            platform_moment: External moment on the star, in base axes, shape (..., 3), [N m].
            external_wrenches: External [moment; force] on each of the nine bodies at its mass
                centre, in base axes, shape (..., 9, 6).
            weights: As in `ClosedChain.compute_torques`; no effect, because there are as many
                motors as degrees of freedom.
            out: Array for the result, shape (..., 3).
            threads: Number of threads for batches; the reference path uses one.
            on_error: "raise", or "nan" to set the results of bad samples to NaN.

        Returns:
            tau, shape (..., 3), [N m].

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `ClosedChain.compute_torques`.

        Example:
            >>> robot.compute_torques(robot.home, [1, 0, 0], [0, 0, 0]).round(3)
            array([-0.   ,  4.475, -4.475])
        """
        current = self._current
        if current.unseen:
            current.look()
        if external_wrenches is weights is None and on_error == "raise":
            tau = current.torques_of(q, va, aa, platform_moment, out, threads)
            if tau is not None:
                return tau
        wrenches = with_moment(platform_moment, external_wrenches)
        return super().compute_torques(
            q,
            va,
            aa,
            external_wrenches=wrenches,
            weights=weights,
            out=out,
            threads=threads,
            on_error=on_error,
        )

    def compute_accelerations(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        platform_moment: ArrayLike | None = None,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """Direct dynamics: motor accelerations for given torques, Eq. (92).

        Args:
            q: Joint coordinates on the closures, shape (..., 9), [rad].
            va: Motor rates, shape (..., 3), [rad/s].
            tau: Motor torques, shape (..., 3), [N m].
            platform_moment: As in `compute_torques`.
            external_wrenches: As in `compute_torques`.
            out: As in `compute_torques`.
            threads: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Returns:
            aa, shape (..., 3), [rad/s^2].

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.

        Example:
            >>> robot.compute_accelerations(robot.home, [0, 0, 0], [0, 4.3, -4.3]).round(3)
            array([ 0.   ,  0.116, -0.116])
        """
        current = self._current
        if current.unseen:
            current.look()
        if external_wrenches is None and on_error == "raise":
            aa = current.accelerations_of(q, va, tau, platform_moment, out, threads)
            if aa is not None:
                return aa
        wrenches = with_moment(platform_moment, external_wrenches)
        return super().compute_accelerations(
            q, va, tau, external_wrenches=wrenches, out=out, threads=threads, on_error=on_error
        )
