# SPDX-License-Identifier: BSD-2-Clause
"""States of a mechanism by compiled kernels: rates, closing of loops, rollouts."""

from __future__ import annotations

import math
import sys
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from ..chain.backend import Motions
from ..chain.mechanism import Friction
from ..chain.reference import Reference, ReferenceStates

if TYPE_CHECKING:
    from ._binding import Course, Kernel

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class Kernels(Protocol):
    """What states ask of a backend; None where it has no such kernel."""

    def kernel(self, name: str) -> Kernel | None:
        """A kernel by its name."""

    def rate(self, loaded: bool, friction: Friction) -> Kernel | None:
        """Rates of states."""

    def course(self, loaded: bool, friction: Friction) -> Course | None:
        """The kernel of a rollout."""


class CompiledStates(ReferenceStates):
    """The state space of a mechanism by kernels; samples that fail go to the reference path.

    Args:
        reference: Of the mechanism.
        friction: Instead of the mechanism's.
        backend: With its kernels.
    """

    def __init__(self, reference: Reference, friction: Friction, backend: Kernels) -> None:
        super().__init__(reference, friction)
        self._backend = backend
        self._closing = backend.kernel("closing")
        self._dependent = len(self._mechanism.dependent)

    def closed(self, states: Array) -> Array:
        """As `ReferenceStates.closed`, by Newton's method."""
        if self._closing is None:
            return super().closed(states)
        answer = self._closing.answer(states[..., : self._nq], None, None, None, None, 1)
        if answer is not None:  # closed to 1e-6 before this step: the next one is the last
            q = answer[..., : self._nq]
            answer = self._closing.answer(q, None, None, None, None, 1)
            return q if answer is None else answer[..., : self._nq]
        q = np.ascontiguousarray(states[..., : self._nq].reshape(-1, self._nq))
        for _ in range(4):
            result = np.empty((len(q), self._nq + 2))
            left = self._closing.many((q,), result)
            q = result[:, :-2]
            if not len(left):  # closed to 1e-6 before this step: the next one is the last
                self._closing.many((q,), result)
                return result[:, :-2].reshape(*states.shape[:-1], self._nq)
        return super().closed(states)

    def rate(self, states: Array, tau: Array, wrenches: Array | None) -> Array:
        """As `ReferenceStates.rate`."""
        kernel = self._rate_alone if wrenches is None else self._loaded_rate
        if kernel is None:
            return super().rate(states, tau, wrenches)
        load = None if wrenches is None else wrenches.reshape(*wrenches.shape[:-2], -1)
        answer = kernel.answer(states, tau, load, None, None, 1)
        return super().rate(states, tau, wrenches) if answer is None else answer

    def near_singularity(self, q: Array, limit: float) -> bool:
        """As `ReferenceStates.near_singularity`, from det Phi_u where that suffices.

        Of n singular values whose squares sum to s, n - 1 have a product of at most
        (s / (n - 1))^((n - 1) / 2). So the smallest is at least |det| over this, the largest at
        most sqrt(s).
        """
        det, squares = self._determinant(q)
        others = self._dependent - 1
        most = math.sqrt(squares) * (squares / max(others, 1)) ** (others / 2)
        if most < limit * abs(det):
            return False
        return super().near_singularity(q, limit)

    def passes_singularity(self, before: Array, after: Array) -> bool:
        """Whether det Phi_u changes its sign."""
        product = self._determinant(before)[0] * self._determinant(after)[0]
        if math.isnan(product):
            return super().passes_singularity(before, after)
        return not product > 0

    def _determinant(self, q: Array) -> tuple[float, float]:
        """det Phi_u and the sum of the squares of its entries; NaN if q fails the checks."""
        closing = self._closing
        answer = None if closing is None else closing.answer(q, None, None, None, None, 1)
        if answer is None:
            return math.nan, math.nan
        return answer.item(-2), answer.item(-1)

    def rollout(self, motions: Motions, threads: int) -> Indices:
        """As `ReferenceStates.rollout`; it goes on where the kernels stop."""
        course = self._backend.course(motions.load is not None, self._friction)
        if course is None:
            return super().rollout(motions, threads)
        reached = course.run(*motions, min(threads, sys.maxsize))
        reached[~self._mechanism.space.on_manifold(motions.q0)] = 0  # kernels normalise on the way
        for i in map(int, np.flatnonzero(reached <= motions.steps)):
            done = max(int(reached[i]) - 1, 0)
            reached[i] = done + super().rollout(motions.rest(i, done), 1)[0]
        return reached

    @cached_property
    def _rate_alone(self) -> Kernel | None:
        return self._backend.rate(False, self._friction)

    @cached_property
    def _loaded_rate(self) -> Kernel | None:
        return self._backend.rate(True, self._friction)
