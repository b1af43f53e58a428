# SPDX-License-Identifier: BSD-2-Clause
"""States of a mechanism by compiled kernels: rates, closing of loops, rollouts.

The mass matrix of many coordinates is too large to be written out. Its column k is the generalized
forces that the accelerations e_k need at rest, without weights and springs; a kernel of inverse
dynamics computes all columns of a sample side by side.
"""

import sys
from collections.abc import Callable
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Flags, Indices
from ..dynamics.derivatives import AccelerationDerivatives
from ..dynamics.dynamics import solved
from ..dynamics.reference import Reference
from ..dynamics.rollout_arrays import RolloutArrays
from ..errors import SSTError
from ..kernel_protocols import Kernel
from ..model.mechanism import Friction, Mechanism
from ..states import States, WrenchesAt

if TYPE_CHECKING:
    from ._binding import Kernel as BoundKernel
    from ._binding import RolloutKernel

#: det Phi_u changes by no more than this factor in half a step that is sound.
CHANGE = 1.25
#: Longest step of Newton's method that closes the middle of a sound step, in parts of `TRAVEL`.
NEARBY = 0.02


class CompiledStates(States):
    """The state space of a mechanism by kernels; samples that fail go to the reference path.

    `rate` and `course` give kernels of rates and rollouts, with or without loads. For many
    coordinates there are none, and `by_columns` computes accelerations.
    """

    def __init__(
        self,
        reference: Reference,
        friction: Friction,
        closing: "BoundKernel | None",
        slopes: Callable[[], Kernel | None],
        rate: "Callable[[bool], BoundKernel | None]",
        course: "Callable[[bool], RolloutKernel | None]",
        by_columns: "ByColumns | None",
    ) -> None:
        super().__init__(reference, friction)
        self._closing, self._rate_of, self._course = closing, cache(rate), course
        self._slopes, self._by_columns = slopes, by_columns

    def closed(self, states: Array) -> Array:
        """q with closed loops, by kernels that make steps of Newton's method."""
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
        """Rates of states, by the kernel of a rollout."""
        kernel = self._rate_of(wrenches is not None)
        load = None if wrenches is None else wrenches.reshape(*wrenches.shape[:-2], -1)
        answer = None if kernel is None else kernel.answer(states, tau, load, None, None, 1)
        return super().rate(states, tau, wrenches) if answer is None else answer

    def _rate(
        self, q: Array, va: Array, tau: Array, wrenches: Array | None, tolerance: float
    ) -> Array:
        rates = None
        if self._by_columns is not None:
            rates = self._by_columns.state_rate(q, va, tau, wrenches)
        return super()._rate(q, va, tau, wrenches, tolerance) if rates is None else rates

    def _acceleration_derivatives(
        self, q: Array, va: Array, tau: Array, wrenches: Array | None
    ) -> Array:
        kernel, parts = self._slopes() if wrenches is None else None, None
        if kernel is not None and kernel.derivatives is not None:
            parts = kernel.derivatives(AccelerationDerivatives, q, va, tau, 1)
        if parts is None:
            return super()._acceleration_derivatives(q, va, tau, wrenches)
        return np.concatenate(parts, axis=1)

    def rollout(
        self, motions: RolloutArrays, threads: int, wrenches_at: WrenchesAt | None
    ) -> Indices:
        """Fill the states of motions; the reference path goes on where the kernels stop.

        Kernels take constant loads only.
        """
        course = self._course(motions.load is not None)
        if course is None or self._closing is None or wrenches_at is not None:
            return super().rollout(motions, threads, wrenches_at)
        reached = self._run(course, motions, threads)
        for i in map(int, np.flatnonzero(reached <= motions.steps)):
            reached[i] = self._complete(course, motions, i, int(reached[i]))
        return reached

    def _complete(self, course: "RolloutKernel", motions: RolloutArrays, i: int, count: int) -> int:
        """The number of valid states of motion i, of which `count` are filled by kernels.

        The reference path continues until the coordinates are good again, then the kernels do.
        """
        while count <= motions.steps:
            last = max(count - 1, 0)  # the last valid state is the next start
            end = self._fill(motions.rest(i, last), 0, until_suited=True)
            count = last + end.valid
            if count > motions.steps or end.error is not None:
                return count
            last = count - 1
            rest = motions.rest(i, last)
            by_kernels = int(self._run(course, rest, 1)[0])
            if not by_kernels:  # only the reference path can continue from there
                rest.q[0, 0] = rest.q0[0]
                rest.va[0, 0] = rest.va0[0]
                by_kernels = 1
            count = last + by_kernels
        return count

    def _run(self, course: "RolloutKernel", motions: RolloutArrays, threads: int) -> Indices:
        """Fill the states of motions as far as the kernels compute them well, and count them."""
        looks = np.empty((*motions.q.shape[:2], 2))
        reached = course.run(*motions, looks, min(threads, sys.maxsize))
        reached[~self._mechanism.space.on_manifold(motions.q0)] = 0  # kernels normalise q
        return self._continuous(motions, looks, reached)

    def _continuous(self, motions: RolloutArrays, looks: Array, reached: Indices) -> Indices:
        """Number of states of each motion before it leaves its assembly mode, shape (N,).

        Between two modes, and near a singularity, a block of Phi_u is almost singular. A short step
        is sound if det Phi_u changes little to the middle and to the end of the step. The others,
        and motions near a dead point of the coordinates, are left to the reference path.
        """
        q, until = motions.q, reached.copy()
        sound, falls = looks[:, :-1, 1] > 0, self._falls(looks[..., 0])[:, :-1]
        steps = np.arange(motions.steps)
        sound |= steps + 1 >= reached[:, None]
        asked = (falls | ~sound) & (steps < reached[:, None])
        for i, s in np.argwhere(asked):
            if s < until[i] and not (
                self._suits(q[i, s], motions.va[i, s], motions.dt)
                and (sound[i, s] or self._continues(q[i, s], q[i, s + 1]))
            ):
                until[i] = s + 1
        return until

    def _suits(self, q: Array, va: Array, h: float) -> bool:
        """Whether the coordinates describe the motion well for a step from a state."""
        try:
            return self._suited_for_step(q, h * self.joint_rates(q, va)) is self
        except SSTError:
            return False

    def _falls(self, ends: Array) -> Flags:
        """Where |det Phi_u| first falls below half its usual size over a power of `CHANGE`."""
        sizes = np.abs(ends)
        largest = np.fmax(sizes.max(axis=1, initial=0, where=sizes >= 0), self._usual_size)
        half = largest[:, None] / 2
        if not (sizes <= half).any():
            return np.zeros(ends.shape, dtype=bool)
        with np.errstate(divide="ignore", invalid="ignore"):
            levels = np.floor(np.log(half / sizes) / np.log(CHANGE))
        levels = np.where(levels >= 0, levels, -1)  # where there is no number too
        falls = np.diff(np.maximum.accumulate(levels, axis=1), axis=1, prepend=-1) > 0
        return np.asarray(falls)

    @cached_property
    def _usual_size(self) -> float:
        """|det Phi_u| at the example of the mechanism, 0 if it has none."""
        example = self._mechanism.example
        if example is None or self._closing is None:
            return 0.0
        result = np.empty((1, self._nq + 2))
        failed = self._closing.many((example[None],), result)
        return 0.0 if len(failed) else abs(float(result[0, -2]))


class ByColumns:
    """Accelerations from Eq. (92) with the mass matrix column by column.

    The kernels are those of forces, with or without loads, of forces of inertia alone, of L va.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        forces: Callable[[bool], "BoundKernel"],
        inertial: "BoundKernel",
        rates: "BoundKernel",
    ) -> None:
        self._mechanism, self._forces = mechanism, forces
        self._inertial, self._rates = inertial, rates
        self._unit = np.eye(len(mechanism.coordinates))

    #: It computes by `many` only.
    answer = None
    derivatives = None

    def many(self, arrays: tuple[Array, ...], out: Array, threads: int = 1) -> Indices:
        """Fill the accelerations; indices of samples that fail the checks of the kernels."""
        q, va, tau, *load = arrays
        f = np.empty(out.shape)
        left = np.zeros(len(out), dtype=bool)
        left[self._forces(bool(load)).many((q, va, None, *load), f, threads)] = True
        for i in np.flatnonzero(~left):
            inertia = np.empty(self._unit.shape)  # Eq. (93), symmetric
            failed = self._inertial.many((q[i], None, self._unit), inertia, threads)
            supplied = (
                tau[i] if self._mechanism.driven_one_to_one else self._motor_forces(q[i], tau[i])
            )
            aa = solved(inertia, supplied - f[i])
            left[i] = len(failed) or aa is None or not np.isfinite(aa).all()
            out[i] = np.nan if aa is None else aa
        return np.flatnonzero(left)

    def _motor_forces(self, q: Array, tau: Array) -> Array:
        """L^T B tau: forces of the motors along the coordinates; NaN at a singularity."""
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


class DerivativesByColumns:
    """Derivatives of accelerations from those of generalized forces at these accelerations.

    Motors act on coordinates only, so that their forces along the coordinates are constant.

    The kernels are those of accelerations, and of derivatives of forces, with or without loads.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        accelerations: ByColumns,
        forces: Callable[[bool], "BoundKernel"],
    ) -> None:
        self._accelerations, self._forces = accelerations, forces
        self._driven = mechanism.motors[mechanism.coordinates]  # L^T B

    #: It computes by `many` only.
    answer = None
    derivatives = None

    def many(self, arrays: tuple[Array, ...], out: Array, threads: int = 1) -> Indices:
        """Fill the derivatives; indices of samples that fail the checks of the kernels."""
        q, va, tau, *load = arrays
        samples, (n, _) = len(out), self._driven.shape
        aa, slopes = np.empty((samples, n)), np.empty((samples, 3 * n * n))
        left = np.zeros(samples, dtype=bool)
        left[self._accelerations.many((q, va, tau, *load), aa, threads)] = True
        left[self._forces(bool(load)).many((q, va, aa, *load), slopes, threads)] = True
        for i in np.flatnonzero(~left):
            by_motion, inertia = np.split(slopes[i].reshape(n, 3 * n), [2 * n], axis=1)
            aa_x = solved(inertia, np.hstack([-by_motion, self._driven]))
            left[i] = aa_x is None or not np.isfinite(aa_x).all()
            out[i] = np.nan if aa_x is None else aa_x.ravel()
        return np.flatnonzero(left)
