# SPDX-License-Identifier: BSD-2-Clause
"""Nonsmooth rollouts by the reference path, in coordinates that suit each state.

`NonsmoothStep` makes one step, with the impulses of contacts, ropes, cables, stops and dry
friction. `NonsmoothReference.fill` makes the steps of a motion, and `require_start` checks its
first state. The coordinates are joints whose rates determine those of all others. If the robot's
coordinates do not determine them well at the start of a step, the step is made in other ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..dynamics.nonsmooth_rows import LARGEST_BEND, NonsmoothRows
from ..dynamics.nonsmooth_step import Forces, NonsmoothArrays, NonsmoothStep, Step
from ..dynamics.reference import Reference
from ..engine import Engine
from ..errors import InputError, SSTError
from ..model.thresholds import CLOSURE_TOLERANCE
from ..states import LARGEST_AT_FIXED_STEP, NOT_FINITE, RolloutEnd, StateSpace, StepError


class NonsmoothReference:
    """Makes nonsmooth steps of one robot by the reference path; one object per thread.

    Args:
        engine: The robot.
        rows: The rows of its contacts, ropes, cables, stops and dry friction.
    """

    def __init__(self, engine: Engine, rows: NonsmoothRows) -> None:
        self._reference = engine.reference
        self._rows = rows
        self._mechanism = engine.mechanism
        self._space = StateSpace(engine.reference, engine.mechanism.friction)
        #: A `NonsmoothStep` for each choice of coordinates that was needed. A choice is an array of
        #: indices in v, and its bytes are the key.
        self._steps = dict[bytes, NonsmoothStep]()

    def require_start(self, q: Array, va: Array) -> None:
        """Refuse open loops, and contacts, ropes and stops that are violated."""
        self._space.start_rates(q, va)  # refuses open loops
        # The gaps of contacts, ropes and stops, in this order.
        gaps = self._step_in(self._space).gaps(q)
        mechanism = self._mechanism
        names = [f"contact {contact}" for contact in mechanism.contacts.points]
        names += [f"rope {rope}" for rope in mechanism.contacts.ropes]
        for stop in self._rows.stops:
            names.append(f"the range of {mechanism.space.rate_names[stop.rate]}")
        for name, gap, least in zip(names, gaps, self._rows.least_gaps, strict=True):
            if gap < least:
                problem = f"{name} is violated by {-gap:.3g} (m or rad); start on its free side"
                raise InputError("q0", problem)

    # Numbers overflow in a motion that diverges. The motion ends there, without NumPy's warnings.
    @np.errstate(over="ignore", invalid="ignore")
    def fill(
        self,
        arrays: NonsmoothArrays,
        i: int,
        first: int,
        wrenches: Callable[[Array], Array | None],
        *,
        until_good: bool,
    ) -> RolloutEnd:
        """Fill states, forces, residuals and impulses of motion i after its state `first`.

        Args:
            arrays: The arrays of the batch. The motion has valid states up to `first`.
            i: Index of the motion.
            first: Index of the state from which the steps are made.
            wrenches: Computes the external wrenches at a configuration.
            until_good: Whether to return, after one step or more, as soon as the robot's
                coordinates are good. Then compiled code can make the next steps.

        Returns:
            The number of valid states, counted from the start of the motion, and an error if the
            motion ended early.
        """
        q = arrays.q[i]
        va = arrays.va[i]  # rates of the robot's coordinates
        h = arrays.dt
        # The steps are made in the coordinates of `space`, which are good at each state. `rates`
        # are the rates of these coordinates, and v the rates of all joints.
        space = self._space
        rates = va[first]
        try:
            v = space.start_rates(q[first], rates)
        except SSTError as error:
            return RolloutEnd(first + 1, error)
        for s in range(first, len(q) - 1):
            try:
                good_space, _ = self._space.in_good_coordinates(q[s], LARGEST_AT_FIXED_STEP)
                if until_good and s > first and good_space is self._space:
                    return RolloutEnd(s + 1, None)
                if good_space is not space:
                    space = good_space
                    rates = v[space.coordinates]  # the coordinates are indices in v
                forces = Forces(
                    tau=arrays.tau[i, s],
                    positions=arrays.positions[i, s],
                    wrenches=wrenches(q[s]),
                )
                step = self._step_in(space).step(q[s], rates, forces, h, arrays.impulses[i])
                self._require_regular(space, q[s], step, h)
                v = space.joint_rates(step.q, step.va)
            except SSTError as error:
                return RolloutEnd(s + 1, error)
            rates = step.va
            q[s + 1] = step.q
            va[s + 1] = v[self._space.coordinates]
            arrays.forces[i, s] = step.x / h  # x are the impulses
            arrays.residual[i, s] = step.residual
            arrays.impulses[i] = step.x  # where the solver starts in the next step
        return RolloutEnd(len(q), None)

    def _step_in(self, space: StateSpace) -> NonsmoothStep:
        """The step in the coordinates of a state space."""
        key = space.coordinates.tobytes()
        if key not in self._steps:
            reference = self._reference
            if space is not self._space:
                reference = Reference(replace(self._mechanism, coordinates=space.coordinates))
            self._steps[key] = NonsmoothStep(reference.context, self._rows)
        return self._steps[key]

    def _require_regular(self, space: StateSpace, q: Array, step: Step, h: float) -> None:
        """Refuse steps that diverge, change the assembly mode, or are too long for the loops."""
        if not np.isfinite(step.q).all() or not np.isfinite(step.x).all():
            raise StepError(NOT_FINITE)
        scale = self._mechanism.rate_scale  # so that metres and radians can be compared
        displacement = pin.difference(self._mechanism.model, q, step.q)
        # A step along the rates opens the loops, by an error of order h^2. The correction has
        # closed them. It may be at most the part `LARGEST_BEND` of the step.
        correction = (displacement - h * step.v) / scale
        length = float(np.abs(h * step.v / scale).max())
        if np.abs(correction).max() > LARGEST_BEND * length + CLOSURE_TOLERANCE:
            raise StepError("the step is too long for the curvature of the motion; shorten dt")
        space.require_continuous(q, step.q)
