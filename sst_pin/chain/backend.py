# SPDX-License-Identifier: BSD-2-Clause
"""The interface between a `ClosedChain` or an integrator and the code that computes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from .continuity import Way
from .mechanism import Friction

Array = NDArray[np.float64]
#: Indices of samples, or a count for each sample.
Indices = NDArray[np.intp]
#: A result; None if the arguments must be checked first, or a sample fails the checks.
Answer = Array | None
#: Takes arguments as the caller gave them.
Single = Callable[..., Answer]


class Motions(NamedTuple):
    """N motions with a fixed step.

    Attributes:
        dt: Step, [s].
        q0: Starts, shape (N, nq).
        va0: Rates at the starts, shape (N, n).
        tau: Torques, shape (N, steps, motors), or at ends and middles, (N, 2 steps + 1, motors).
        load: Constant external wrenches, shape (N, 6 r), or None.
        q: To be filled, shape (N, steps + 1, nq); NaN behind the end.
        va: To be filled, shape (N, steps + 1, n).
    """

    dt: float
    q0: Array
    va0: Array
    tau: Array
    load: Array | None
    q: Array
    va: Array

    @property
    def steps(self) -> int:
        """How many there are."""
        return self.q.shape[1] - 1

    @property
    def held(self) -> bool:
        """Whether torques are constant in each step."""
        return self.tau.shape[1] == self.steps

    def rest(self, i: int, done: int) -> Motions:
        """Motion i alone, from its state `done` on."""
        one = slice(i, i + 1)
        q0, va0 = (self.q[one, done], self.va[one, done]) if done else (self.q0[one], self.va0[one])
        tau = self.tau[one, (1 if self.held else 2) * done :]
        load = None if self.load is None else self.load[one]
        q, va = self.q[one, done:], self.va[one, done:]
        return Motions(self.dt, q0.copy(), va0.copy(), tau, load, q, va)


class States(Protocol):
    """The state space (q, va) of one mechanism; states have shape (nq + n,) or (N, nq + n)."""

    def closed(self, states: Array) -> Array:
        """q with the dependent joints moved onto the closures, shape (..., nq)."""

    def rate(self, states: Array, tau: Array, wrenches: Array | None) -> Array:
        """Rates of states, shape (..., nq + n)."""

    def regular(self, q: Array, limit: float) -> bool:
        """Whether the condition number of the dependent part of Phi is below a limit."""

    def follow(self, start: Array, way: Way, limit: float) -> tuple[float, Array]:
        """How much of a step stays regular and in its assembly mode; see `Continuity.follow`."""

    def rollout(self, motions: Motions, threads: int) -> Indices:
        """Fill the states of motions; how many of each hold, shape (N,)."""


class Backend(Protocol):
    """Dynamics of one mechanism.

    Its results are those of the methods of `Reference` with the same names. Samples that fail its
    checks (an open loop, a singular configuration, a number that is not finite) are left to the
    reference path, which computes them one by one or raises the error.
    """

    def __str__(self) -> str:
        """What computes, and why."""

    def torques_of(self, q: Any, va: Any, aa: Any, load: Any, out: Any, threads: Any, /) -> Answer:
        """Inverse dynamics of arguments as the caller gave them, for one sample or a batch.

        Returns:
            tau; None if the arguments must be checked first, or if a sample fails the checks.
        """

    def accelerations_of(
        self, q: Any, va: Any, tau: Any, load: Any, out: Any, threads: Any, /
    ) -> Answer:
        """Direct dynamics in the same way."""

    def forces_of(self, q: Any, va: Any, aa: Any, load: Any, out: Any, threads: Any, /) -> Answer:
        """Generalized forces in the same way."""

    def fill(
        self,
        name: str,
        arrays: Sequence[Array | None],
        out: Array,
        threads: int,
        sign_width: float | None = None,
    ) -> Indices:
        """Fill the results of N samples.

        Args:
            name: Of a method of `Reference`; behind it the name of the frame if it takes one.
            arrays: Its arguments, q first, shapes (N, ...); None for no external wrenches.
            out: For the results, flat, shape (N, size).
            threads: How many share the samples.
            sign_width: Of Coulomb friction in derivatives.

        Returns:
            Indices of the samples that fail the checks.
        """

    def derivatives_of(self, name: str, sign_width: float) -> Callable[..., Any]:
        """What gives derivatives of one sample or a batch, or None, in the way of `torques_of`.

        It takes the named tuple to make, q, va, aa or tau, and the threads.

        Args:
            name: "torque_derivatives" or "acceleration_derivatives".
            sign_width: Of Coulomb friction.
        """

    def frame_of(self, name: str, frame: str) -> Single:
        """What gives the same of one sample or a batch, in the way of `torques_of`."""

    def states(self, friction: Friction) -> States:
        """The state space with this friction instead of the mechanism's."""
