# SPDX-License-Identifier: BSD-2-Clause
"""One step of motion with stops, dry friction, ropes and contacts, by the reference path.

The free rates are those without the impulses of the rows. Viscous friction, springs, lines and
gains of motors are taken at the end of the step:

    (M + h D + h^2 K) va = M va_0 + h f(q, v_0),   D, K: their matrices in the coordinates

`impulses` changes these rates, and Newton's method closes the loops at their end.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..loops.loops import Loops
from ..model.closures import Distance
from ..model.thresholds import LEAST_LENGTH
from ..model.tree import frame_id
from .dynamics import Context
from .impulses import Rows, impulses
from .noc import body_jacobians
from .nonsmooth_rows import NonsmoothRows


class Forces(NamedTuple):
    """What acts in a step.

    Attributes:
        tau: Torques of the motors besides those of their gains, shape (motors,).
        positions: Positions that the gains hold, shape (motors,).
        wrenches: External wrenches, shape (r, 6), or None.
    """

    tau: Array
    positions: Array
    wrenches: Array | None


class Step(NamedTuple):
    """The end of a step.

    Attributes:
        q: Configuration, shape (nq,).
        va: Rates of the coordinates, shape (n,).
        v: Rates of all joints with which q was reached, shape (nv,).
        x: Impulses of the rows, shape (m,).
        residual: As of `Impulses`.
    """

    q: Array
    va: Array
    v: Array
    x: Array
    residual: float


class NonsmoothArrays(NamedTuple):
    """Arguments and results of N motions side by side.

    Attributes:
        dt: Step, [s].
        tau: Torques, shape (N, steps, motors).
        positions: Positions that the gains hold, shape (N, steps, motors).
        load: Constant external wrenches, shape (N, r, 6), or None.
        q: Configurations, shape (N, steps + 1, nq); the first are the starts, the others results.
        va: Rates of the coordinates, shape (N, steps + 1, n), likewise.
        forces: Forces of the rows to fill, shape (N, steps, m).
        residual: To fill, shape (N, steps).
        impulses: Impulses of the step before, shape (N, m); of the last step afterwards.
    """

    dt: float
    tau: Array
    positions: Array
    load: Array | None
    q: Array
    va: Array
    forces: Array
    residual: Array
    impulses: Array

    def part(self, motions: slice, first: int = 0) -> NonsmoothArrays:
        """Some of the motions, from step `first` on."""
        return NonsmoothArrays(
            self.dt,
            self.tau[motions, first:],
            self.positions[motions, first:],
            None if self.load is None else self.load[motions],
            self.q[motions, first:],
            self.va[motions, first:],
            self.forces[motions, first:],
            self.residual[motions, first:],
            self.impulses[motions],
        )


class NonsmoothStep:
    """Steps of one mechanism; one object per thread."""

    def __init__(self, context: Context, rows: NonsmoothRows) -> None:
        self._context = context
        self._rows = rows
        self._mechanism = context.mechanism
        model = self._mechanism.model
        self._frames = [
            (frame_id(model, x.frame), frame_id(model, x.ground), x.radius)
            for x in self._mechanism.contacts.points
        ]
        self._lengths = np.array([rope.length for rope in self._mechanism.contacts.ropes])

    @cached_property
    def _ropes(self) -> Loops:
        """The ropes as distances of 1 m that nothing holds."""
        ropes = self._mechanism.contacts.ropes
        distances = [Distance(rope.frame_a, rope.frame_b, 1.0) for rope in ropes]
        return Loops(self._mechanism.model, distances)

    def gaps(self, q: Array) -> Array:
        """Gaps of contacts, ropes and stops at a closed configuration; negative if violated."""
        self._context.evaluate(q)
        return np.concatenate([self._contacts()[0], self._slack(q)[0], self._rows.stop_gaps(q)])

    def step(self, q: Array, va: Array, forces: Forces, h: float, start: Array) -> Step:
        """The end of a step of length h; `start` are impulses near the solution, shape (m,)."""
        context = self._context
        mechanism = self._mechanism
        rows = self._rows
        v, bias = context.complement.motion(q, va, context.steady)
        L = context.complement.L
        M = context.tree_inertia()
        force = -context.tree_forces(v, bias)
        gaps, of_points = self._contacts()
        slack, of_ropes = self._slack(q)
        lengths, of_lines = context.lines.evaluate(q)

        # Linear elements: rows on the rates of the tree, their stiffness and damping.
        stiffness = mechanism.lines.stiffness
        damping = mechanism.lines.damping
        cables = rows.cables
        positions = rows.motor_positions(q, lengths)
        tau = forces.tau - rows.gains.stiffness * (positions - forces.positions)
        on_lines = mechanism.lines.actuation
        springs = stiffness * (lengths - mechanism.lines.rest_lengths)
        tensions = mechanism.lines.preload + springs - on_lines @ tau
        squares = on_lines[cables] ** 2
        cable_stiffness = stiffness[cables] + squares @ rows.gains.stiffness
        cable_damping = damping[cables] + squares @ rows.gains.damping
        others = np.setdiff1d(np.arange(len(lengths)), cables)
        of_motors = mechanism.actuation.T + on_lines[others].T @ of_lines[others]
        linear = np.concatenate([np.eye(len(v)), of_lines[others], of_motors])
        stiffnesses = mechanism.springs.stiffness, stiffness[others], rows.gains.stiffness
        dampings = mechanism.friction.viscous, damping[others], rows.gains.damping
        factors = h * np.concatenate(dampings) + h**2 * np.concatenate(stiffnesses)

        force = force + mechanism.actuation @ tau - tensions[others] @ of_lines[others]
        force = force + mechanism.springs.forces(mechanism.model, q)
        if forces.wrenches is not None:
            force = force + forces.wrenches.ravel() @ body_jacobians(context.loops)
        # A cable of constant tension has no row.
        constant = cable_stiffness + cable_damping == 0
        pulls = np.where(constant, np.maximum(tensions[cables], 0.0), 0.0)
        force = force - pulls @ of_lines[cables]

        implicit = linear @ L
        inertia = L.T @ M @ L
        left = inertia + (implicit.T * factors) @ implicit
        free = np.linalg.solve(left, inertia @ va + h * (L.T @ force))

        of_stops = [stop.side * np.eye(len(v))[stop.rate] for stop in rows.stops]
        J = np.concatenate(
            [
                of_points,
                of_ropes,
                np.where(constant, 0.0, 1.0)[:, None] * -of_lines[cables],
                np.reshape(of_stops, (-1, len(v))),
                np.eye(len(v))[rows.dry_rates],
                of_lines[rows.dry_lines],
            ]
        )
        on_coordinates = J @ L
        soft = np.where(constant, 1.0, cable_damping + h * cable_stiffness)
        compliance, biases = np.zeros(len(J)), np.zeros(len(J))
        points, ropes, of_cables, stops, _ = rows.parts
        compliance[of_cables] = np.where(constant, 0.0, 1 / (h * soft))
        biases[points.start + 2 : points.stop : 3] = self._approach(
            gaps, on_coordinates[2 : points.stop : 3], va, free, h
        )
        biases[ropes], biases[stops] = slack / h, rows.stop_gaps(q) / h
        biases[of_cables] = np.where(constant, 0.0, -tensions[cables] / soft)
        problem = Rows(on_coordinates, biases, compliance, rows.kinds, rows.bounds(h))
        after, x, residual = impulses(left, free, problem, start)
        x[of_cables] += h * pulls

        v = L @ after
        ahead = mechanism.space.normalised(q + h * mechanism.space.coordinate_rates(q, v))
        end = context.without_slip.assemble(ahead, mechanism.dependent)
        return Step(end, after, v, x, residual)

    def _approach(self, gaps: Array, J: Array, va: Array, free: Array, h: float) -> Array:
        """Biases of the normal rows: gap / h, or after an impact restitution times the rate."""
        before = J @ va
        ahead = np.minimum(before, J @ free)
        hits = (self._rows.restitution > 0) & (before < 0) & (gaps + h * ahead <= 0)
        return np.where(hits, self._rows.restitution * before, gaps / h)

    def _contacts(self) -> tuple[Array, Array]:
        """Gaps of the contacts, and relative rates of their points in axes of their grounds.

        Shapes (contacts,) and (3 contacts, nv), at the configuration of the loops.
        """
        loops = self._context.loops
        gaps = np.zeros(len(self._frames))
        rows = np.zeros((3 * len(self._frames), loops.model.nv))
        for k, (frame, ground, radius) in enumerate(self._frames):
            plane = loops.data.oMf[ground]
            p = loops.data.oMf[frame].translation
            normal = plane.rotation[:, 2]
            height = normal @ (p - plane.translation)
            gaps[k] = height - radius
            lowest = -radius * normal  # from the frame to the point that touches
            below = p - plane.translation - height * normal
            relative = _at(loops.frame_jacobian(frame), lowest)
            relative = relative - _at(loops.frame_jacobian(ground), below)
            rows[3 * k : 3 * k + 3] = plane.rotation.T @ relative
        return gaps, rows

    def _slack(self, q: Array) -> tuple[Array, Array]:
        """What is left of the ropes' lengths, and its rates, shapes (ropes,) and (ropes, nv)."""
        if not len(self._lengths):
            return np.zeros(0), np.zeros((0, self._mechanism.model.nv))
        self._ropes.evaluate(q)
        distances = self._ropes.f + 1.0
        # The direction of a rope between coinciding frames is not determined; it is slack.
        apart = distances > LEAST_LENGTH * self._mechanism.length
        return self._lengths - distances, np.where(apart[:, None], -self._ropes.Phi, 0.0)


def _at(J: Array, lever: Array) -> Array:
    """Linear rates of a point of a body from those of a frame, shape (3, nv)."""
    return J[:3] - np.cross(lever, J[3:], axisb=0, axisc=0)
