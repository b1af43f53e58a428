# SPDX-License-Identifier: BSD-2-Clause
"""What an engine needs of compiled kernels; `compiled` implements it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from .arrays import Array, Indices
from .dynamics.nonsmooth_rows import NonsmoothRows
from .dynamics.quantities import Quantity
from .model.mechanism import Friction
from .states import StateSpace


class Kernel(Protocol):
    """Compiled code of one quantity."""

    @property
    def answer(self) -> Callable[..., Array | None] | None:
        """A function (a, b, c, load, out, threads) of unchecked arguments for control loops.

        It returns the result, or None if the arguments need a check or a sample fails one. The
        property is None if the kernel computes by `many` only.
        """

    @property
    def derivatives(self) -> Callable[..., Any] | None:
        """A function (kind, a, b, c, threads), as `answer`, for a kernel of derivatives.

        It returns the derivatives by a, b and c as a named tuple of this kind.
        """

    def many(self, arrays: tuple[Array, ...], out: Array, threads: int = 1, /) -> Indices:
        """Fill results of N samples, shape (N, size); indices of those that fail the checks.

        Arguments have shapes (N, ...), q first; external wrenches have shape (N, 6 r).
        """


class Kernels(Protocol):
    """Compiled kernels of one mechanism, with the results of `Reference`.

    The reference path computes samples that fail a check: an open loop, a singular configuration,
    or a number that is not finite.
    """

    def __str__(self) -> str:
        """A sentence that says which backend is in use, and why."""

    def kernel(self, key: Quantity, /) -> Kernel | None:
        """The kernel of a quantity, made at its first use; None if it cannot be compiled."""

    def closed(self, q: Array, /) -> Array | None:
        """The closed configuration near q with the coordinates fixed; None to ask the reference."""

    def state_space(self, friction: Friction) -> StateSpace:
        """The state space with this friction instead of the mechanism's."""

    def nonsmooth(self, rows: NonsmoothRows, loaded: bool) -> Any:
        """Steps with stops, friction and contacts; None if they cannot be compiled."""
