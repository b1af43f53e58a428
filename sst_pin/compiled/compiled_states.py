# SPDX-License-Identifier: BSD-2-Clause
"""States of a mechanism by compiled kernels: rates, closing of loops, rollouts."""

import sys
from collections.abc import Callable
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Flags, Indices
from ..dynamics.derivatives import AccelerationDerivatives
from ..dynamics.reference import Reference
from ..dynamics.rollout_arrays import RolloutArrays
from ..errors import SSTError
from ..kernel_protocols import Kernel
from ..model.mechanism import Friction
from ..states import StateSpace, WrenchesAt, wrenches_of

if TYPE_CHECKING:
    from ._binding import Kernel as BoundKernel
    from ._binding import RolloutKernel

# A step of a rollout is *sound* if the kernels can tell that it stays in its assembly mode. Phi_u
# are the columns of Phi for the dependent rates.
#: det Phi_u changes by less than this factor from the start of a sound step to its middle, and from
#: there to its end.
CHANGE = 1.25
#: In the middle of a sound step, a Newton step closes the loops. It is at most this part of the
#: largest motion of a joint in a sound step, `continuity.TRAVEL`.
NEARBY = 0.02

# Newton's method onto the closures leads to the nearest closed configuration if its steps start
# short and shrink fast. Lengths of steps are in [rad] or robot lengths.
#: Longest first step.
LONGEST_FIRST_STEP = 0.1
#: Largest ratio of the length of a step to that of the step before. After a first step of 0.1 all
#: further steps together are at most 0.1 (0.1 + 0.1^2 + ...) = 0.011.
LARGEST_RATIO = 0.1
#: The most steps of Newton's method before the reference path closes the loops of a batch.
_MOST_CLOSING_STEPS = 4


class CompiledStateSpace(StateSpace):
    """The state space of a mechanism by kernels; samples that fail go to the reference path.

    Args:
        reference: The reference path.
        friction: Friction in place of the mechanism's.
        closing: The kernel that makes a step of Newton's method on the closures.
        derivatives: Returns the kernel of derivatives of accelerations.
        rate: Returns the kernel of rates of states, with or without loads.
        rollout: Returns the kernel of rollouts, with or without loads.
    """

    def __init__(
        self,
        reference: Reference,
        friction: Friction,
        *,
        closing: "BoundKernel | None",
        derivatives: Callable[[], Kernel | None],
        rate: "Callable[[bool], BoundKernel | None]",
        rollout: "Callable[[bool], RolloutKernel | None]",
    ) -> None:
        super().__init__(reference, friction)
        self._closing = closing
        self._derivative_kernel = derivatives
        self._rate_kernel = cache(rate)
        self._rollout_kernel = rollout

    def closed(self, states: Array) -> Array:
        """q with closed loops, by kernels that make steps of Newton's method."""
        if self._closing is None:
            return super().closed(states)
        q = states[..., : self._nq]
        # The kernel answers if the loops were closed to about 1e-6 before the step. A second step
        # then suffices, because each step squares the error.
        after_first = _closing_step(self._closing, q)
        if after_first is not None:
            after_second = _closing_step(self._closing, after_first)
            # If the kernel refuses the second step (near a singularity), the first one is enough.
            return after_first if after_second is None else after_second
        # Some loops were open: more steps for all samples.
        rows = np.ascontiguousarray(q.reshape(-1, self._nq))
        for _ in range(_MOST_CLOSING_STEPS):
            rows, were_closed = _closing_steps(self._closing, rows)
            if were_closed:
                # As above, a second step after loops that were closed suffices.
                rows, _ = _closing_steps(self._closing, rows)
                return rows.reshape(q.shape)
        return super().closed(states)

    def rate(self, states: Array, tau: Array, wrenches: Array | None) -> Array:
        """Rates of states, by the kernel of a rollout."""
        rates = None
        kernel = self._rate_kernel(wrenches is not None)
        if kernel is not None:
            # This kernel has three inputs: states, torques, and wrenches as one vector.
            load = None if wrenches is None else wrenches.reshape(*wrenches.shape[:-2], -1)
            rates = kernel.answer(states, tau, load, load=None, out=None, threads=1)
        return super().rate(states, tau, wrenches) if rates is None else rates

    def _acceleration_derivatives(
        self, q: Array, va: Array, tau: Array, wrenches: Array | None
    ) -> Array:
        kernel = None
        if wrenches is None:
            kernel = self._derivative_kernel()
        if kernel is not None:
            parts = kernel.derivatives(AccelerationDerivatives, q, va, tau, 1)
            if parts is not None:
                return np.concatenate(parts, axis=1)
        return super()._acceleration_derivatives(q, va, tau, wrenches)

    def rollout(
        self, motions: RolloutArrays, threads: int, wrenches_at: WrenchesAt | None
    ) -> Indices:
        """Fill the states of motions; numbers of valid states, shape (N,).

        The reference path continues motions where the kernels stop. It also computes all motions
        with wrenches that are functions, because kernels take constant loads only.
        """
        kernel = self._rollout_kernel(motions.load is not None)
        if kernel is None or self._closing is None or wrenches_at is not None:
            return super().rollout(motions, threads, wrenches_at)
        reached = self._by_kernel(kernel, motions, threads)
        for i in map(int, np.flatnonzero(reached <= motions.steps)):
            reached[i] = self._complete(kernel, motions, i, int(reached[i]))
        return reached

    def _complete(self, kernel: "RolloutKernel", motions: RolloutArrays, i: int, count: int) -> int:
        """Fill the rest of motion i, of which the kernel has filled `count` valid states.

        The reference path continues from the last valid state until the coordinates are good again,
        then the kernel continues, and so on. The result is the number of valid states.
        """
        wrenches = wrenches_of(motions, i, None)
        while count <= motions.steps:  # a whole motion has steps + 1 states
            # `rest` is the motion from state `last` on, which is the last valid one, or the start.
            last = max(count - 1, 0)
            rest = motions.rest(i, last)
            end = self._fill(rest, 0, wrenches, until_good=True)
            count = last + end.valid
            if count > motions.steps or end.error is not None:
                return count

            last = count - 1
            rest = motions.rest(i, last)
            by_kernel = int(self._by_kernel(kernel, rest, threads=1)[0])
            if by_kernel == 0:
                # The kernel refuses the last state, which the reference path found valid. It has
                # overwritten this state. The reference path takes the next step.
                rest.q[0, 0] = rest.q0[0]
                rest.va[0, 0] = rest.va0[0]
                by_kernel = 1
            count = last + by_kernel
        return count

    def _by_kernel(self, kernel: "RolloutKernel", motions: RolloutArrays, threads: int) -> Indices:
        """Fill states of motions by the kernel; numbers of valid states, shape (N,)."""
        # For each state: det Phi_u, and 1 if the step from this state is sound, else 0.
        states = motions.steps + 1
        verdicts = np.empty((len(motions.q), states, 2))
        reached = kernel.run(
            motions.dt,
            motions.q0,
            motions.va0,
            motions.tau,
            motions.load,
            motions.q,
            motions.va,
            verdicts,
            min(threads, sys.maxsize),
        )
        # The kernel normalises quaternions and cosine-sine pairs. Starts that need it are invalid.
        reached[~self._mechanism.space.on_manifold(motions.q0)] = 0
        determinants = verdicts[..., 0]
        sound = verdicts[:, :-1, 1] > 0
        return self._continuous(motions, determinants, sound, reached)

    def _continuous(
        self, motions: RolloutArrays, determinants: Array, sound: Flags, reached: Indices
    ) -> Indices:
        """Number of states of each motion up to the first bad step, shape (N,).

        A step is bad if it leaves the assembly mode, or if it should be made in other coordinates.
        The reference path can tell, but it is slow. So it judges only two sorts of steps:

        - Steps that are not sound. Between two assembly modes, and near a singularity, a block of
          Phi_u is almost singular, so that det Phi_u changes much in a step.
        - Steps from states where |det Phi_u| falls. It is small near a dead point of the
          coordinates, where other coordinates are better.

        Args:
            motions: The motions.
            determinants: det Phi_u of each state, shape (N, steps + 1).
            sound: Whether the kernel finds a step sound, shape (N, steps).
            reached: Number of states that the kernel has computed, shape (N,).
        """
        q = motions.q
        count = reached.copy()
        # Step s leads from state s to state s + 1. Shape (N, steps): whether the kernel made it.
        made = np.arange(1, motions.steps + 1) < reached[:, None]
        falls = self._falls(determinants)[:, :-1]  # without the last state, which has no step
        for i, s in np.argwhere(made & (falls | ~sound)):
            if s >= count[i]:  # after the first bad step of this motion
                continue
            is_good = self._coordinates_suit(q[i, s], motions.va[i, s], motions.dt)
            if is_good and not sound[i, s]:
                is_good = self._continues(q[i, s], q[i, s + 1])
            if not is_good:
                count[i] = s + 1
        return count

    def _coordinates_suit(self, q: Array, va: Array, h: float) -> bool:
        """Whether the coordinates describe the motion well for a step h from a state."""
        try:
            return self._space_for_step(q, h * self.joint_rates(q, va)) is self
        except SSTError:
            return False

    def _falls(self, determinants: Array) -> Flags:
        """States where |det Phi_u| is smaller than before by a level or more, shape (N, steps + 1).

        The usual size of |det Phi_u| is the largest one of the motion and of the robot's example.
        |det Phi_u| is at level k if it is between half of the usual size divided by `CHANGE`^k and
        divided by `CHANGE`^(k + 1). Only states count whose level is higher than the level of every
        state before, so that a motion along a dead point costs few tests.
        """
        sizes = np.abs(determinants)  # NaN for states that the kernel has not computed
        largest = np.fmax(sizes.max(axis=1, initial=0, where=sizes >= 0), self._usual_size)
        half = largest[:, None] / 2
        if not (sizes <= half).any():
            return np.zeros(determinants.shape, dtype=bool)
        with np.errstate(divide="ignore", invalid="ignore"):
            levels = np.floor(np.log(half / sizes) / np.log(CHANGE))
        levels = np.where(levels >= 0, levels, -1)  # -1: above half of the usual size, or NaN
        highest_so_far = np.maximum.accumulate(levels, axis=1)
        return np.asarray(np.diff(highest_so_far, axis=1, prepend=-1) > 0)

    @cached_property
    def _usual_size(self) -> float:
        """|det Phi_u| at the example of the mechanism, 0 if it has none."""
        example = self._mechanism.example
        if example is None or self._closing is None:
            return 0.0
        result = np.empty((1, self._nq + 2))  # as in `_closing_steps`
        failed = self._closing.many((example[None],), result)
        determinant = float(result[0, self._nq])
        return 0.0 if len(failed) else abs(determinant)


def _closing_step(closing: "BoundKernel", q: Array) -> Array | None:
    """q after one step of Newton's method; None if loops of a sample were open before it.

    q has the shape (nq,) or (N, nq); for other shapes the result is None.
    """
    after_step = closing.answer(q, None, None, load=None, out=None, threads=1)
    return None if after_step is None else after_step[..., : q.shape[-1]]


def _closing_steps(closing: "BoundKernel", q: Array) -> tuple[Array, bool]:
    """q after one step of Newton's method, shape (N, nq), and whether all were closed before it."""
    nq = q.shape[1]
    result = np.empty((len(q), nq + 2))  # q, the determinant of Phi_u, a sum of squares
    failures = closing.many((q,), result)
    return result[:, :nq], len(failures) == 0
