# SPDX-License-Identifier: BSD-2-Clause
"""What a `ClosedChain` and an integrator ask of whatever computes the dynamics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .mechanism import Friction

Array = NDArray[np.float64]
#: Indices of samples, or a count for each sample.
Indices = NDArray[np.intp]
#: A result; None where the arguments need more care.
Answer = Array | None
#: Takes arguments as the caller gave them.
Single = Callable[..., Answer]


class States(Protocol):
    """The state space (q, va) of one mechanism; states have shape (nq + n,) or (N, nq + n)."""

    def closed(self, states: Array) -> Array:
        """q with the dependent joints moved onto the closures, shape (..., nq)."""

    def rate(self, states: Array, tau: Array, wrenches: Array | None) -> Array:
        """Rates of states, shape (..., nq + n)."""

    def near_singularity(self, q: Array, limit: float) -> bool:
        """Whether the condition number of the dependent part of Phi is above a limit."""

    def passes_singularity(self, before: Array, after: Array) -> bool:
        """Whether the coordinates lose hold of the robot between two configurations."""

    def rollout(
        self,
        dt: float,
        q0: Array,
        va0: Array,
        tau: Array,
        wrenches: Array | None,
        q: Array,
        va: Array,
        threads: int,
    ) -> Indices:
        """Fill q and va with the states of N motions; how many of each hold, shape (N,)."""


class Backend(Protocol):
    """Dynamics of one mechanism.

    Samples come as rows, float64 arrays of shape (N, ...); results are filled into the array
    before `threads`. What is returned are the samples that a backend does not vouch for: the
    reference path computes them one by one, or raises the error that is due.
    """

    def __str__(self) -> str:
        """What computes, and why."""

    def torques_of(self, q: Any, va: Any, aa: Any, load: Any, out: Any, threads: Any, /) -> Answer:
        """Inverse dynamics of arguments as the caller gave them, for one sample or a batch.

        Returns:
            tau; None when the arguments need more care, or when a sample is not vouched for.
        """

    def accelerations_of(
        self, q: Any, va: Any, tau: Any, load: Any, out: Any, threads: Any, /
    ) -> Answer:
        """Direct dynamics likewise."""

    def forces_of(self, q: Any, va: Any, aa: Any, load: Any, out: Any, threads: Any, /) -> Answer:
        """Forces along the coordinates likewise."""

    def torques(
        self, q: Array, va: Array, aa: Array, wrenches: Array | None, tau: Array, threads: int
    ) -> Indices:
        """Fill tau."""

    def generalized_forces(
        self, q: Array, va: Array, aa: Array, wrenches: Array | None, f: Array, threads: int
    ) -> Indices:
        """Fill f."""

    def accelerations(
        self, q: Array, va: Array, tau: Array, wrenches: Array | None, aa: Array, threads: int
    ) -> Indices:
        """Fill aa."""

    def derivatives_of(self, name: str, sign_width: float) -> Callable[..., Any]:
        """What gives derivatives of one sample or a batch, or None, in the way of `torques_of`.

        It takes the named tuple to make, q, va, aa or tau, and the threads.

        Args:
            name: "torque_derivatives" or "acceleration_derivatives".
            sign_width: Of Coulomb friction.
        """

    def derivatives(
        self,
        name: str,
        sign_width: float,
        q: Array,
        va: Array,
        x: Array,
        wrenches: Array | None,
        rows: Array,
        threads: int,
    ) -> Indices:
        """Fill rows of derivatives by q, va and x, which is aa or tau, side by side."""

    def displacement_rates(self, q: Array, va: Array, rows: Array, threads: int) -> Indices:
        """Fill rows of what moving axes of joints do to a displacement, shape (N, n n)."""

    def joint_rates(self, q: Array, va: Array, v: Array, threads: int) -> Indices:
        """Fill v, the rates of the tree."""

    def joint_accelerations(
        self, q: Array, va: Array, aa: Array, dv: Array, threads: int
    ) -> Indices:
        """Fill dv, the accelerations of the tree."""

    def frame_of(self, name: str, frame: str) -> Single:
        """What gives the same of one sample or a batch, in the way of `torques_of`."""

    def of_frame(
        self, name: str, frame: str, arrays: tuple[Array, ...], rows: Array, threads: int
    ) -> Indices:
        """Fill rows of what there is of a frame.

        Args:
            name: A method of `Reference`: "frame_jacobian", "frame_drift" and so on.
            frame: Its name.
            arrays: q, and va where it is needed.
            rows: Shape (N, size).
            threads: How many share the samples.
        """

    def reduced_terms(self, q: Array, va: Array, rows: Array, threads: int) -> Indices:
        """Fill rows of inertia, coriolis, gravity, friction, shape (N, 2 n (n + 1))."""

    def states(self, friction: Friction) -> States:
        """The state space with a friction in the place of the mechanism's own."""
