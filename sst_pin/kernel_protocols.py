# SPDX-License-Identifier: BSD-2-Clause
"""What an engine needs of compiled kernels; `compiled` implements it."""

from __future__ import annotations

from typing import Any, Protocol

from .arrays import Array, Indices
from .dynamics.nonsmooth_rows import NonsmoothRows
from .dynamics.quantities import Quantity
from .model.mechanism import Friction
from .states import StateSpace


class Kernel(Protocol):
    """Compiled code of one quantity."""

    def answer(self, a: Any, b: Any, c: Any, load: Any, out: Any, threads: Any, /) -> Array | None:
        """The result for unchecked arguments, for control loops.

        `a` is q, and `b` and `c` are the other arguments of the quantity, such as va and aa, or
        None. `load` is the moment on the platform, or None. The result is None if the arguments
        need a check or a sample fails one.
        """

    def derivatives(self, kind: Any, a: Any, b: Any, c: Any, threads: Any, /) -> Any:
        """Derivatives by a, b and c as an object of the class `kind`, for a kernel of derivatives.

        It is None in the same cases as the result of `answer`.
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
        """The closed configuration near q with the coordinates fixed; None if kernels find none.

        Then the reference path has to be asked.
        """

    def state_space(self, friction: Friction) -> StateSpace:
        """The state space with this friction instead of the mechanism's."""

    def nonsmooth(self, rows: NonsmoothRows, loaded: bool, many: bool) -> Any:
        """Kernel of steps with stops, friction and contacts; None if it cannot be compiled.

        `loaded` is whether there are external wrenches, and `many` whether several motions are
        computed at once.
        """
