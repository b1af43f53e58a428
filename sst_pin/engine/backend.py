# SPDX-License-Identifier: BSD-2-Clause
"""The interface between a `ClosedChain` or an integrator and the code that computes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from ..arrays import Array, Indices
from ..dynamics.quantities import QUANTITIES, Name, Quantity
from ..loops.continuity import Way
from ..model.mechanism import Friction

#: Indices of samples, or a count for each sample.
#: A result; None if the arguments must be checked first, or a sample fails the checks.
Answer = Array | None
D = TypeVar("D")


class Key(NamedTuple):
    """What a kernel computes.

    Attributes:
        quantity: Its name in the table of quantities.
        frame: Name of the frame, for a quantity of a frame.
        loaded: Whether external wrenches act.
        along: Whether it takes one sample at a time, several directions of derivatives at once.
        sign_width: Width within which Coulomb friction is smooth, for derivatives.
    """

    quantity: Name
    frame: str | None = None
    loaded: bool = False
    along: bool = False
    sign_width: float | None = None

    @property
    def kind(self) -> Quantity:
        """Properties of the quantity."""
        return QUANTITIES[self.quantity]

    @property
    def entry(self) -> str:
        """The name of its functions in C."""
        return "_".join([self.quantity, *["along"] * self.along, *["loaded"] * self.loaded])

    def __str__(self) -> str:
        return self.entry if self.frame is None else f"{self.entry} {self.frame}"


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

    def torques(self, i: int, s: int) -> Array:
        """Torques at the start, in the middle and at the end of step s of motion i."""
        return self.tau[i, [s] * 3 if self.held else slice(2 * s, 2 * s + 3)]

    def rest(self, i: int, done: int) -> Motions:
        """Motion i alone, from its state `done` on."""
        one = slice(i, i + 1)
        q0, va0 = (self.q[one, done], self.va[one, done]) if done else (self.q0[one], self.va0[one])
        tau = self.tau[one, (1 if self.held else 2) * done :]
        load = None if self.load is None else self.load[one]
        q, va = self.q[one, done:], self.va[one, done:]
        return Motions(self.dt, q0.copy(), va0.copy(), tau, load, q, va)


class States(Protocol):
    """The state space (q, va) of one mechanism; states have shape (nq + n,) or (N, nq + n).

    Attributes:
        coordinates: Indices in v of the rates va.
    """

    coordinates: Indices

    def closed(self, states: Array) -> Array:
        """q with the dependent joints moved onto the closures, shape (..., nq)."""

    def rate(self, states: Array, tau: Array, wrenches: Array | None) -> Array:
        """Rates of states, shape (..., nq + n)."""

    def derivatives(self, state: Array, tau: Array, wrenches: Array | None) -> tuple[Array, Array]:
        """Derivatives of `rate` by the state and by tau, shapes (nq + n, nq + n), (nq + n, motors).

        Not where wheels roll: there the state has more freedoms than the coordinates.
        """

    def joint_rates(self, q: Array, va: Array) -> Array:
        """v of one state whose loops are closed, shape (nv,)."""

    def joint_motion(self, q: Array, va: Array, aa: Array) -> tuple[Array, Array]:
        """v and v_dot of one state whose loops are closed, shapes (nv,)."""

    def Phi(self, q: Array) -> Array:
        """Jacobian of the closures, free of units, shape (rows, nv)."""

    def condition_number(self, q: Array) -> float:
        """Condition number of the dependent part of Phi, infinite if it is singular."""

    def suited(self, q: Array) -> tuple[States, float]:
        """These states if their condition is sound, or much better ones, and the condition."""

    def follow(
        self, start: Array, way: Way, limit: float, first: float = 1.0
    ) -> tuple[float, Array]:
        """How much of a step stays regular and in its assembly mode; see `Continuity.follow`."""

    def rollout(self, motions: Motions, threads: int) -> Indices:
        """Fill the states of motions; how many of each hold, shape (N,)."""


class Kernel(Protocol):
    """Computes one quantity; `NoKernel` leaves all samples to the reference path."""

    def answer(self, a: Any, b: Any, c: Any, load: Any, out: Any, threads: Any, /) -> Answer:
        """The result for arguments as the caller gave them, for one sample or a batch.

        None if the arguments must be checked first, or a sample fails the checks.
        """

    def derivatives(
        self, kind: Callable[..., D], a: Any, b: Any, c: Any, threads: Any, /
    ) -> D | None:
        """Derivatives by a, b and c as a named tuple of this kind, or None as `answer`."""

    def many(self, arrays: tuple[Array, ...], out: Array, threads: int = 1, /) -> Indices:
        """Fill flat results of N samples, shape (N, size); indices of those that fail the checks.

        Arguments have shapes (N, ...), q first; external wrenches have shape (N, 6 r).
        """


class NoKernel:
    """Stands where there is no kernel."""

    def answer(self, *_: Any) -> None:
        """Nothing."""

    derivatives = answer

    def many(self, arrays: tuple[Array, ...], out: Array, threads: int = 1) -> Indices:
        """All samples."""
        return np.arange(len(out))


class Backend(Protocol):
    """Dynamics of one mechanism.

    Its results are those of the methods of `Reference` with the same names. Samples that fail its
    checks (an open loop, a singular configuration, a number that is not finite) are left to the
    reference path, which computes them one by one or raises the error.
    """

    def __str__(self) -> str:
        """What computes, and why."""

    def kernel(self, key: Key, /) -> Kernel:
        """What computes a quantity; it is made at its first use."""

    def states(self, friction: Friction) -> States:
        """The state space with this friction instead of the mechanism's."""
