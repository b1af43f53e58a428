# SPDX-License-Identifier: BSD-2-Clause
"""The interface between a `ClosedChain` or an integrator and the code that computes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from ..arrays import Array, Indices
from ..dynamics.quantities import QUANTITIES, Name, Quantity
from ..model.mechanism import Friction
from ..states import States

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
