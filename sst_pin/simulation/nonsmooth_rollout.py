# SPDX-License-Identifier: BSD-2-Clause
"""Rollouts with stops, dry friction that sticks, ropes, cables and contacts."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import (
    Array,
    Indices,
    as_array,
    finite_array,
    flattened,
    name_samples,
    positive_number,
    require_policy,
    single_array,
    whole_number,
)
from ..dynamics.impulses import SOLVED
from ..dynamics.nonsmooth_rows import LARGEST_BEND, MotorGains, NonsmoothRows
from ..dynamics.nonsmooth_step import Forces, NonsmoothArrays, NonsmoothStep, Step
from ..dynamics.reference import Reference
from ..engine import Engine
from ..errors import InputError, SimulationError, SSTError
from ..model.thresholds import CLOSURE_TOLERANCE, MAX_CONDITION_NUMBER
from ..progress import counted
from ..states import States

#: Condition number of the dependent joints above which better coordinates are searched.
_POOR = 10.0
#: Codes of steps in `NonsmoothRollout.status`.
SOLVED_STEP, NOT_SOLVED, NOT_REACHED = 0, 1, 2


class NonsmoothRollout(NamedTuple):
    """Motions with stops, dry friction, ropes and contacts, with steps of one length.

    Forces are means over each of the N steps. Add those of contacts and ropes to what the motors
    give for the balance of a body.

    Attributes:
        q: Configurations, shape (..., N + 1, nq).
        va: Rates of the coordinates, shape (..., N + 1, n).
        contact_forces: Forces on the bodies of the contacts' frames, in axes of their grounds,
            shape (..., N, contacts, 3), [N].
        tensions: Tensions of the ropes, then of lines with `pulls_only`, shape (..., N, ropes +
            cables), [N].
        joint_forces: Forces of stops and dry friction on the joints, shape (..., N, nv).
        residual: Error of complementarity of each step, relative to its impulses, shape (..., N).
        status: 0 where the residual is at most 1e-9, 1 where it is larger, 2 for steps after the
            end of a motion, shape (..., N).
        t: Times of the states, the same for all motions, shape (N + 1,), [s].

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

    def single(self, *index: int) -> NonsmoothRollout:
        """One motion of a batch, by its index or indices.

        Example:
            >>> batch = chain.rollout(np.zeros((4, 10, 1)), chain.home, [0], 1e-3, nonsmooth=True)
            >>> batch.single(3).q.shape
            (11, 3)
        """
        return NonsmoothRollout(
            self.q[index],
            self.va[index],
            self.contact_forces[index],
            self.tensions[index],
            self.joint_forces[index],
            self.residual[index],
            self.status[index],
            self.t,
        )


def nonsmooth_rollout(
    engine: Engine,
    tau: ArrayLike,
    q0: ArrayLike,
    va0: ArrayLike,
    dt: float,
    wrenches: Array | None,
    steps: int | None,
    gains: tuple[ArrayLike | None, ArrayLike | None, ArrayLike | None],
    threads: int,
    on_error: str,
) -> NonsmoothRollout:
    """The motions that `ClosedChain.rollout(..., nonsmooth=True)` returns."""
    require_policy(on_error)
    threads = whole_number("threads", threads, 1)
    h = positive_number("dt", float(single_array("dt", dt, ())))
    mechanism = engine.mechanism
    mechanism.require_freedom()
    mechanism.require_mass()
    nq, n, motors = mechanism.model.nq, len(mechanism.coordinates), len(mechanism.motor_names)
    torques = as_array("tau", tau, (motors,))
    if torques.ndim < 2 or (steps is not None and torques.shape[-2] != steps):
        expected = "N" if steps is None else steps
        raise InputError("tau", f"shape {torques.shape}, expected (..., {expected}, {motors})")
    count = torques.shape[-2]
    stiffness, damping, positions = gains
    held = MotorGains(
        _gains("motor_stiffness", stiffness, motors), _gains("motor_damping", damping, motors)
    )
    rows = NonsmoothRows(mechanism, held)
    start, rates = as_array("q0", q0, (nq,)), as_array("va0", va0, (n,))
    if positions is None:
        targets = _motor_positions(engine, rows, start)[..., None, :]
    else:
        targets = as_array("motor_positions", positions, (motors,))
        targets = targets if targets.ndim > 1 else targets[None]
    if targets.shape[-2] not in (1, count):
        expected = f"(..., {count}, {motors})"
        raise InputError("motor_positions", f"shape {targets.shape}, expected {expected}")
    targets = np.broadcast_to(targets, (*targets.shape[:-2], count, motors))
    batch, flat = flattened((start, rates, torques, targets, wrenches), (1, 1, 2, 2, 2))
    samples, size = math.prod(batch), len(rows.kinds)
    q_0, va_0, tau_0, held_positions = (np.require(x, float, "C") for x in flat[:4])
    arrays = NonsmoothArrays(
        h,
        tau_0,
        held_positions,
        load=None if flat[4] is None else np.require(flat[4], float, "C"),
        q=np.full((samples, count + 1, nq), np.nan),
        va=np.full((samples, count + 1, n), np.nan),
        forces=np.full((samples, count, size), np.nan),
        residual=np.full((samples, count), np.nan),
        impulses=np.zeros((samples, size)),
    )
    arrays.q[:, 0], arrays.va[:, 0] = q_0, va_0
    reached, stopped = _run(engine, rows, arrays, threads)
    if stopped and on_error == "raise":
        first = min(stopped)
        error = stopped[first]
        if not isinstance(error, InputError):
            finite_array("tau", torques, (motors,))
            problem = f"the motion reached a singularity, diverged, or opened the loops: {error}"
            error = SimulationError(problem, reached[first] * h)
        name_samples(error, sorted(stopped), batch)
        raise error
    return _results(rows, arrays, batch, reached)


def _gains(name: str, value: ArrayLike | None, motors: int) -> Array:
    gains = np.zeros(motors) if value is None else single_array(name, value, (motors,))
    if (gains < 0).any():
        raise InputError(name, f"{gains.min():g} is negative")
    return gains


def _motor_positions(engine: Engine, rows: NonsmoothRows, q: Array) -> Array:
    """Positions of the motors at configurations, shape (..., motors)."""
    flat = q.reshape(-1, q.shape[-1])
    lengths = map(engine.reference.context.lines.lengths, flat)
    positions = [rows.motor_positions(*pair) for pair in zip(flat, lengths, strict=True)]
    return np.reshape(positions, (*q.shape[:-1], -1))


def _run(
    engine: Engine, rows: NonsmoothRows, arrays: NonsmoothArrays, threads: int
) -> tuple[Indices, dict[int, SSTError]]:
    """Fill the results; numbers of steps made, and why motions ended early."""
    motions, steps = len(arrays.q), arrays.forces.shape[1]
    reached, stopped = np.zeros(motions, dtype=np.intp), dict[int, SSTError]()
    reference, kernels = _ReferenceMotion(engine, rows), engine.kernels
    code = None if kernels is None else kernels.nonsmooth(rows, arrays.load is not None)
    if code is not None:
        reached[:] = code.run(rows, arrays, threads)
    for i in map(int, np.flatnonzero(reached == 0)):
        try:
            reference.require_start(arrays.q[i, 0], arrays.va[i, 0])
        except SSTError as error:
            stopped[i] = error
    for i in counted(range(motions), "rollout", motions):
        while reached[i] < steps and i not in stopped:
            try:
                reached[i] = reference.run(arrays, i, int(reached[i]), 1 if code else steps)
            except SSTError as error:
                stopped[i] = error
                reached[i] = reference.done
            if code is not None and reached[i] < steps and i not in stopped:
                rest = arrays.part(slice(i, i + 1), int(reached[i]))
                reached[i] += int(code.run(rows, rest, 1)[0])
    for i in range(motions):
        arrays.q[i, reached[i] + 1 :], arrays.va[i, reached[i] + 1 :] = np.nan, np.nan
        arrays.forces[i, reached[i] :], arrays.residual[i, reached[i] :] = np.nan, np.nan
    return reached, stopped


class _ReferenceMotion:
    """Motions by the reference path, in coordinates that suit each state."""

    def __init__(self, engine: Engine, rows: NonsmoothRows) -> None:
        self._engine, self._rows, self._mechanism = engine, rows, engine.mechanism
        self._states = States(engine.reference, engine.mechanism.friction)
        self._steps: dict[bytes, NonsmoothStep] = {}

    def require_start(self, q: Array, va: Array) -> None:
        """Refuse open loops, and contacts, ropes and stops that are violated."""
        self._states.start_rates(q, va)
        gaps = self._step_of(self._states).gaps(q)
        mechanism, rows = self._mechanism, self._rows
        names = [f"contact {x}" for x in mechanism.contacts.points]
        names += [f"rope {x}" for x in mechanism.contacts.ropes]
        names += [f"the range of {mechanism.space.rate_names[x.rate]}" for x in rows.stops]
        over = gaps < rows.least_gaps
        if over.any():
            k = int(np.flatnonzero(over)[0])
            problem = f"{names[k]} is violated by {-gaps[k]:.3g} (m or rad); start on its free side"
            raise InputError("q0", problem)

    def _step_of(self, states: States) -> NonsmoothStep:
        key = states.coordinates.tobytes()
        if key not in self._steps:
            mechanism, reference = self._mechanism, self._engine.reference
            if states is not self._states:
                changed = replace(mechanism, coordinates=states.coordinates)
                reference = Reference(changed)
            self._steps[key] = NonsmoothStep(reference.context, self._rows)
        return self._steps[key]

    @np.errstate(over="ignore", invalid="ignore")  # a motion that diverges ends
    def run(self, arrays: NonsmoothArrays, i: int, first: int, most: int) -> int:
        """Fill at least `most` steps of motion i from step `first` on; the number of steps.

        It goes on until the robot's coordinates describe the motion well. `done` is the number of
        steps if it raises an error.
        """
        q, va, h = arrays.q[i], arrays.va[i], arrays.dt
        load = None if arrays.load is None else arrays.load[i]
        states, rates, x = self._states, va[first], arrays.impulses[i]
        v, self.done = states.start_rates(q[first], rates), first
        for s in range(first, len(q) - 1):
            suited, _ = self._states.suited(q[s], _POOR)
            if suited is not states:
                states, rates = suited, v[suited.coordinates]
            if s - first >= most and states is self._states:
                break
            forces = Forces(arrays.tau[i, s], arrays.positions[i, s], load)
            step = self._step_of(states).step(q[s], rates, forces, h, x)
            self._require_regular(states, q[s], step, h)
            v, rates, x = states.joint_rates(step.q, step.va), step.va, step.x
            q[s + 1], va[s + 1] = step.q, v[self._states.coordinates]
            arrays.forces[i, s], arrays.residual[i, s] = x / h, step.residual
            arrays.impulses[i], self.done = x, s + 1
        return self.done

    def _require_regular(self, states: States, q: Array, step: Step, h: float) -> None:
        """Refuse steps that diverge, change the assembly mode, or are too long for the loops."""
        if not np.isfinite(step.q).all() or not np.isfinite(step.x).all():
            raise SimulationError("a number is not finite", 0.0)
        model, units = self._mechanism.model, self._mechanism.rate_scale
        way = pin.difference(model, q, step.q)
        correction = float(np.abs((way - h * step.v) / units).max())
        length = float(np.abs(h * step.v / units).max())
        if correction > LARGEST_BEND * length + CLOSURE_TOLERANCE:
            raise SimulationError("the step is too long for the curvature of the motion", 0.0)

        def path(start: Array, low: float, high: float) -> Array:
            return step.q if high == 1 else states.closed(pin.integrate(model, q, high * way))

        if states.follow(q, path, MAX_CONDITION_NUMBER)[0] < 1:
            raise SimulationError("the loops are singular, or change their assembly mode", 0.0)


def _results(
    rows: NonsmoothRows, arrays: NonsmoothArrays, batch: tuple[int, ...], reached: Indices
) -> NonsmoothRollout:
    """The arrays in the shapes of the arguments; a warning if a step is not solved."""
    mechanism, count = rows.mechanism, arrays.forces.shape[1]
    points, ropes, cables, _, _ = rows.parts
    forces = arrays.forces.reshape(*batch, count, -1)
    on_contacts = forces[..., points].reshape(*batch, count, len(mechanism.contacts.points), 3)
    on_joints = forces @ rows.on_joints
    status = np.where(arrays.residual <= SOLVED, SOLVED_STEP, NOT_SOLVED)
    status[np.arange(count) >= reached[:, None]] = NOT_REACHED
    if (bad := status == NOT_SOLVED).any():
        worst = float(arrays.residual[bad].max())
        text = (
            f"{int(bad.sum())} of {bad.size} steps are not solved to {SOLVED:g} of their impulses"
        )
        warnings.warn(f"{text} (at worst {worst:.2g}); see status", RuntimeWarning, stacklevel=4)
    return NonsmoothRollout(
        arrays.q.reshape(*batch, count + 1, -1),
        arrays.va.reshape(*batch, count + 1, -1),
        on_contacts,
        forces[..., ropes.start : cables.stop],
        on_joints,
        arrays.residual.reshape(*batch, count),
        status.reshape(*batch, count),
        t=arrays.dt * np.arange(count + 1),
    )
