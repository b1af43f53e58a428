# SPDX-License-Identifier: BSD-2-Clause
"""Rollouts with stops, dry friction that sticks, ropes, cables and contacts.

`nonsmooth_rollout` makes the arrays of a batch, `_Motions` fills them step by step, and `_results`
makes a `NonsmoothRollout` of them. `NonsmoothRows` has one row for each impulse of a step: three
rows for a contact, and one row for a rope, a cable, a stop, or a joint or line with dry friction.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, as_array, finite_array, positive_number, whole_number
from ..dynamics.impulses import SOLVED
from ..dynamics.nonsmooth_rows import NonsmoothRows, motor_gains
from ..dynamics.nonsmooth_step import NonsmoothArrays
from ..engine import Engine
from ..errors import InputError, SSTError, warn_caller
from ..progress import counted
from ..states import WrenchesAt
from .nonsmooth_reference import NonsmoothReference
from .rollout_arguments import RolloutArguments

# Codes of steps in `NonsmoothRollout.status`.
SOLVED_STEP = 0
NOT_SOLVED = 1
NOT_REACHED = 2


class NonsmoothRollout(NamedTuple):
    """Motions with stops, dry friction, ropes and contacts, with steps of one length.

    Forces are means over each of the N steps. They act besides the motor torques: the balance of a
    body needs both.

    Attributes:
        q: Configurations, shape (..., N + 1, nq).
        va: Rates of the coordinates, shape (..., N + 1, n).
        contact_forces: Forces on the bodies of the contacts' frames, in axes of their grounds,
            shape (..., N, contacts, 3), [N].
        tensions: Tensions of the ropes, then of the cables, which are the lines with `pulls_only`,
            shape (..., N, ropes + cables), [N].
        joint_forces: Forces of stops and dry friction on the joints, shape (..., N, nv).
        residual: Error of complementarity of each step, relative to its impulses, shape (..., N).
        status: 0 where the residual is at most 1e-9, 1 where it is larger, 2 for steps after the
            end of a motion, shape (..., N).
        t: Times of the states, the same for all motions, shape (N + 1,), [s].
        line_friction: Dry friction of the lines that have it; positive where it pushes the ends
            apart, shape (..., N, lines with friction), [N].

    Example:
        >>> motion = chain.rollout(np.zeros((10, 1)), chain.home, [0], 1e-3, nonsmooth=True)
        >>> motion.q.shape, motion.contact_forces.shape, int(motion.status.max())
        ((11, 3), (10, 0, 3), 0)
    """

    q: Array
    va: Array
    contact_forces: Array
    tensions: Array
    joint_forces: Array
    residual: Array
    status: Indices
    t: Array
    line_friction: Array

    def single(self, *index: int) -> NonsmoothRollout:
        """One motion of a batch, by an index for each leading axis.

        Raises:
            InputError: If there is no such motion.

        Example:
            >>> batch = chain.rollout(np.zeros((4, 10, 1)), chain.home, [0], 1e-3, nonsmooth=True)
            >>> batch.single(3).q.shape
            (11, 3)
        """
        batch = self.q.shape[:-2]
        places = [whole_number("index", place, 0) for place in index]
        if len(places) != len(batch) or any(np.greater_equal(places, batch)):
            raise InputError("index", f"{index}, and the leading axes are {batch}")
        return NonsmoothRollout(
            q=self.q[index],
            va=self.va[index],
            contact_forces=self.contact_forces[index],
            tensions=self.tensions[index],
            joint_forces=self.joint_forces[index],
            residual=self.residual[index],
            status=self.status[index],
            t=self.t,
            line_friction=self.line_friction[index],
        )


def nonsmooth_rollout(
    engine: Engine,
    arguments: RolloutArguments,
    *,
    motor_stiffness: ArrayLike | None,
    motor_damping: ArrayLike | None,
    motor_positions: ArrayLike | None,
) -> NonsmoothRollout:
    """The motions that `ClosedChain.rollout(..., nonsmooth=True)` returns."""
    positive_number("dt", arguments.dt)
    mechanism = engine.mechanism
    motors = len(mechanism.motor_names)
    steps = arguments.tau.shape[-2]
    if arguments.steps not in (None, steps):
        expected = f"(..., {arguments.steps}, {motors})"
        raise InputError("tau", f"shape {arguments.tau.shape}, expected {expected}")
    rows = NonsmoothRows(mechanism, motor_gains(motor_stiffness, motor_damping, motors))
    if motor_positions is None:
        positions_at_start = _motor_positions(engine, rows, arguments.q0)
        positions = positions_at_start[..., None, :]  # the same in all steps
    elif arguments.raises:
        positions = finite_array("motor_positions", motor_positions, (motors,))
    else:  # the motions with numbers that are not finite end at once
        positions = as_array("motor_positions", motor_positions, (motors,))
    samples = arguments.samples(_in_each_step(positions, steps))
    assert samples.motor_positions is not None

    count = math.prod(samples.batch)
    arrays = NonsmoothArrays(
        dt=arguments.dt,
        tau=np.require(samples.tau, float, "C"),
        positions=samples.motor_positions,
        load=samples.wrenches,
        q=np.empty((count, steps + 1, mechanism.model.nq)),
        va=np.empty((count, steps + 1, len(mechanism.coordinates))),
        forces=np.empty((count, steps, rows.count)),
        residual=np.empty((count, steps)),
        # The solver starts from the impulses of the step before; there is none before the first.
        impulses=np.zeros((count, rows.count)),
    )
    arrays.q[:, 0] = samples.q0
    arrays.va[:, 0] = samples.va0
    wrenches_at = arguments.wrenches_at(engine, samples)
    motions = _Motions(engine, rows, arrays, wrenches_at)
    motions.run(arguments.threads)
    if motions.errors and arguments.raises:
        first = min(motions.errors)
        raise arguments.error(
            samples.batch,
            sorted(motions.errors),
            float(motions.steps_made[first] * arguments.dt),
            motions.errors[first],
            at_start=first in motions.cannot_start,
        )
    return _results(rows, arrays, samples.batch, motions.steps_made)


def _in_each_step(positions: Array, steps: int) -> Array:
    """Positions that the motors hold in each step, shape (..., steps, motors).

    The argument has this shape, or shape (..., 1, motors) or (motors,) if the positions are the
    same in all steps.
    """
    if positions.ndim == 1:
        positions = positions[None]
    motors = positions.shape[-1]
    if positions.shape[-2] not in (1, steps):
        expected = f"(..., {steps}, {motors})"
        raise InputError("motor_positions", f"shape {positions.shape}, expected {expected}")
    return np.broadcast_to(positions, (*positions.shape[:-2], steps, motors))


def _motor_positions(engine: Engine, rows: NonsmoothRows, q: Array) -> Array:
    """Positions of the motors at configurations, shape (..., motors)."""
    line_lengths = engine.reference.context.lines.lengths
    batch = q.shape[:-1]
    configurations = q.reshape(math.prod(batch), q.shape[-1])
    positions = [rows.motor_positions(each, line_lengths(each)) for each in configurations]
    return np.reshape(positions, (*batch, len(rows.mechanism.motor_names)))


class _Motions:
    """Makes the steps of the motions of a batch.

    Compiled code, if there is any, makes the steps of a motion until it cannot vouch for one. The
    reference path makes this step, and further ones until the robot's coordinates are good. Then
    compiled code goes on.

    Attributes:
        steps_made: Number of steps of each motion, shape (M,) for the M motions of the batch.
        errors: Why motions ended early, by the index of the motion.
        cannot_start: Indices of the motions whose start is refused.
    """

    def __init__(
        self,
        engine: Engine,
        rows: NonsmoothRows,
        arrays: NonsmoothArrays,
        wrenches_at: WrenchesAt | None,
    ) -> None:
        self._rows = rows
        self._arrays = arrays
        self._wrenches_at = wrenches_at
        self._reference = NonsmoothReference(engine, rows)
        self._code = None
        if engine.kernels is not None and wrenches_at is None:  # kernels take constant loads only
            self._code = engine.kernels.nonsmooth(
                rows, arrays.load is not None, many=len(arrays.q) > 1
            )
        self.steps_made = np.zeros(len(arrays.q), dtype=np.intp)
        self.errors = dict[int, SSTError]()
        self.cannot_start = set[int]()

    def run(self, threads: int) -> None:
        """Make the steps, and fill results after the end of a motion with NaN.

        All results of a motion that cannot start are NaN.
        """
        arrays = self._arrays
        if self._code is not None:
            self.steps_made[:] = self._code.run(self._rows, arrays, threads)
        for i in counted(range(len(arrays.q)), "rollout", len(arrays.q)):
            if self.steps_made[i] > 0 or self._can_start(i):
                self._complete(i)
            steps_made = int(self.steps_made[i])
            valid_states = 0 if i in self.cannot_start else steps_made + 1
            arrays.q[i, valid_states:] = np.nan
            arrays.va[i, valid_states:] = np.nan
            arrays.forces[i, steps_made:] = np.nan
            arrays.residual[i, steps_made:] = np.nan

    def _can_start(self, i: int) -> bool:
        """Whether motion i can start; if not, its error is added to `errors`."""
        try:
            self._reference.require_start(self._arrays.q[i, 0], self._arrays.va[i, 0])
        except SSTError as error:
            self.errors[i] = error
            self.cannot_start.add(i)
            return False
        return True

    def _complete(self, i: int) -> None:
        """Make the steps of motion i that compiled code has not made."""
        arrays = self._arrays
        steps = arrays.residual.shape[1]
        steps_made = int(self.steps_made[i])
        while steps_made < steps and i not in self.errors:
            end = self._reference.fill(
                arrays, i, steps_made, partial(self._wrenches, i), until_good=self._code is not None
            )
            steps_made = end.valid - 1  # the first state is the start
            if end.error is not None:
                self.errors[i] = end.error
            elif self._code is not None and steps_made < steps:
                # The code fills views of the arrays: motion i from its state `steps_made` on.
                rest = arrays.part(slice(i, i + 1), steps_made)
                steps_made += int(self._code.run(self._rows, rest, 1)[0])
        self.steps_made[i] = steps_made

    def _wrenches(self, i: int, q: Array) -> Array | None:
        """External wrenches on the r bodies of the robot in motion i at q, shape (r, 6)."""
        if self._wrenches_at is not None:
            return self._wrenches_at(i, q)
        return None if self._arrays.load is None else self._arrays.load[i]


def _results(
    rows: NonsmoothRows, arrays: NonsmoothArrays, batch: tuple[int, ...], steps_made: Indices
) -> NonsmoothRollout:
    """The arrays in the shapes of the arguments; a warning if a step is not solved."""
    steps = arrays.residual.shape[1]

    # The status of each step, shape (M, steps) for the M motions of the batch.
    status = np.where(arrays.residual <= SOLVED, SOLVED_STEP, NOT_SOLVED)
    is_after_end = np.arange(steps) >= steps_made[:, None]
    status[is_after_end] = NOT_REACHED
    unsolved = status == NOT_SOLVED
    if unsolved.any():
        worst = float(arrays.residual[unsolved].max())
        warn_caller(
            f"{int(unsolved.sum())} of {unsolved.size} steps are not solved to {SOLVED:g} of their "
            f"impulses (at worst {worst:.2g}); see status",
            RuntimeWarning,
        )

    # The results in the shape of the batch.
    def of_batch(array: Array) -> Array:
        return array.reshape(*batch, *array.shape[1:])

    parts = rows.parts
    forces = of_batch(arrays.forces)  # one for each row, shape (..., steps, rows)
    contacts = len(rows.mechanism.contacts.points)
    return NonsmoothRollout(
        q=of_batch(arrays.q),
        va=of_batch(arrays.va),
        contact_forces=forces[..., parts.contacts].reshape(*batch, steps, contacts, 3),
        tensions=forces[..., parts.ropes.start : parts.cables.stop],  # cables follow ropes
        joint_forces=forces @ rows.on_joints,  # on_joints has shape (rows, nv)
        line_friction=forces[..., parts.dry_lines],
        residual=of_batch(arrays.residual),
        status=status.reshape(*batch, steps),
        t=arrays.dt * np.arange(steps + 1),
    )
