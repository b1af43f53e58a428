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

from ..arrays import Array, Flags, Indices
from ..loops.line_kinematics import line_loops
from ..loops.loops import Loops
from ..model.thresholds import HELD_BY_LOOPS, LEAST_LENGTH
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


class _Beginning(NamedTuple):
    """The robot at the beginning of a step.

    Attributes:
        q: Configuration, shape (nq,).
        va: Rates of the coordinates, shape (n,).
        v: Rates of all joints, shape (nv,).
        L: Joint orthogonal complement, v = L va, shape (nv, n).
        M: Mass matrix of the tree, shape (nv, nv).
        force: Forces of weights and rates on the tree, shape (nv,).
        gaps: Gaps of the contacts, shape (contacts,), [m].
        J_contacts: Rates of their points in the axes of their grounds, shape (3 contacts, nv).
        slack: What is left of the ropes' lengths, shape (ropes,), [m].
        J_ropes: Its rates, shape (ropes, nv).
        lengths: Lengths of the lines, shape (lines,), [m].
        J_lines: Their rates, shape (lines, nv).
    """

    q: Array
    va: Array
    v: Array
    L: Array
    M: Array
    force: Array
    gaps: Array
    J_contacts: Array
    slack: Array
    J_ropes: Array
    lengths: Array
    J_lines: Array


class _Cables(NamedTuple):
    """The lines that only pull, with the gains of motors on them.

    The tension of a cable is that at the beginning plus stiffness times the change of its length
    plus damping times its rate; it has a row, because it is never negative. A cable without
    stiffness and damping has a constant tension, and no impulse of a row.

    Attributes:
        tensions: Tensions at the beginning without dampers, shape (cables,), negative if the spring
            pushes.
        stiffness: Shape (cables,).
        damping: Shape (cables,).
        constant: Which of them have a constant tension, shape (cables,).
        constant_pulls: These tensions, and zero for other cables, shape (cables,).
    """

    tensions: Array
    stiffness: Array
    damping: Array
    constant: Flags
    constant_pulls: Array


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
        self._rope_lengths = np.array([rope.length for rope in self._mechanism.contacts.ropes])
        #: Indices of the lines that pull and push.
        lines = np.arange(len(self._mechanism.lines.forces))
        self._rods = np.setdiff1d(lines, rows.cables)

    @cached_property
    def _ropes(self) -> Loops:
        """The ropes as distances that nothing holds: f are the distances of their ends."""
        return line_loops(self._mechanism.model, self._mechanism.contacts.ropes)

    def gaps(self, q: Array) -> Array:
        """Gaps of contacts, ropes and stops at a closed configuration; negative if violated."""
        self._context.evaluate(q)
        gaps, _ = self._contacts()
        slack, _ = self._slack(q)
        return np.concatenate([gaps, slack, self._rows.stop_gaps(q)])

    def step(self, q: Array, va: Array, forces: Forces, h: float, start: Array) -> Step:
        """The end of a step of length h; `start` are impulses near the solution, shape (m,)."""
        mechanism = self._mechanism
        begin = self._beginning(q, va)
        positions = self._rows.motor_positions(q, begin.lengths)
        tau = forces.tau - self._rows.gains.stiffness * (positions - forces.positions)
        tensions = self._tensions(begin, tau)
        cables = self._cables(tensions)

        # The free rates solve left free = right.
        force = self._forces(begin, tau, tensions, cables, forces.wrenches)
        inertia = begin.L.T @ begin.M @ begin.L
        left = inertia + self._implicit(begin, h)
        right = inertia @ va + h * (begin.L.T @ force)
        free = np.linalg.solve(left, right)

        after, x, residual = impulses(left, free, self._impulse_rows(begin, cables, free, h), start)
        x[self._rows.parts.cables] += h * cables.constant_pulls
        v = begin.L @ after
        ahead = mechanism.space.normalised(q + h * mechanism.space.coordinate_rates(q, v))
        end = self._context.without_slip.assemble(ahead, mechanism.dependent)
        return Step(end, after, v, x, residual)

    def _beginning(self, q: Array, va: Array) -> _Beginning:
        """All that a step needs of the state (q, va)."""
        context = self._context
        v, bias = context.complement.motion(q, va, context.steady)
        M = context.tree_inertia()
        force = -context.tree_forces(v, bias)
        gaps, J_contacts = self._contacts()
        slack, J_ropes = self._slack(q)
        lengths, J_lines = context.lines.evaluate(q)
        return _Beginning(
            q=q,
            va=va,
            v=v,
            L=context.complement.L,
            M=M,
            force=force,
            gaps=gaps,
            J_contacts=J_contacts,
            slack=slack,
            J_ropes=J_ropes,
            lengths=lengths,
            J_lines=J_lines,
        )

    def _tensions(self, begin: _Beginning, tau: Array) -> Array:
        """Tensions of all lines with motors, without dampers, shape (lines,)."""
        lines = self._mechanism.lines
        springs = lines.stiffness * (begin.lengths - lines.rest_lengths)
        return np.asarray(lines.preload + springs - lines.actuation @ tau)

    def _cables(self, tensions: Array) -> _Cables:
        """The cables; `tensions` are those of all lines."""
        lines = self._mechanism.lines
        cables = self._rows.cables
        gains = self._rows.gains
        # A motor's position is its factor times the length, and so is its force.
        squared_factors = lines.actuation[cables] ** 2
        stiffness = lines.stiffness[cables] + squared_factors @ gains.stiffness
        damping = lines.damping[cables] + squared_factors @ gains.damping
        constant = stiffness + damping == 0
        pulls = np.where(constant, np.maximum(tensions[cables], 0.0), 0.0)
        return _Cables(tensions[cables], stiffness, damping, constant, pulls)

    def _forces(
        self,
        begin: _Beginning,
        tau: Array,
        tensions: Array,
        cables: _Cables,
        wrenches: Array | None,
    ) -> Array:
        """Forces on the tree at the beginning, without dampers and rows, shape (nv,)."""
        mechanism = self._mechanism
        rods = self._rods
        force = begin.force + mechanism.actuation @ tau - tensions[rods] @ begin.J_lines[rods]
        force = force + mechanism.springs.forces(mechanism.model, begin.q)
        if wrenches is not None:
            force = force + wrenches.ravel() @ body_jacobians(self._context.loops)
        return np.asarray(force - cables.constant_pulls @ begin.J_lines[self._rows.cables])

    def _implicit(self, begin: _Beginning, h: float) -> Array:
        """h D + h^2 K in the coordinates, shape (n, n): of joints, lines that push, and motors."""
        mechanism = self._mechanism
        lines = mechanism.lines
        gains = self._rows.gains
        rods = self._rods
        J_motors = mechanism.actuation.T + lines.actuation[rods].T @ begin.J_lines[rods]
        J = np.concatenate([np.eye(len(begin.v)), begin.J_lines[rods], J_motors])
        stiffness = np.concatenate(
            [mechanism.springs.stiffness, lines.stiffness[rods], gains.stiffness]
        )
        damping = np.concatenate([mechanism.friction.viscous, lines.damping[rods], gains.damping])
        J = J @ begin.L
        return np.asarray((J.T * (h * damping + h**2 * stiffness)) @ J)

    def _impulse_rows(self, begin: _Beginning, cables: _Cables, free: Array, h: float) -> Rows:
        """The rows on the coordinates, with their biases and compliances."""
        rows = self._rows
        parts = rows.parts
        axes = np.eye(len(begin.v))
        J_cables = -begin.J_lines[rows.cables]
        J_stops = [stop.side * axes[stop.rate] for stop in rows.stops]
        J_tree = np.concatenate(  # in the order of `Parts`
            [
                begin.J_contacts,
                begin.J_ropes,
                np.where(cables.constant, 0.0, 1.0)[:, None] * J_cables,
                np.reshape(J_stops, (-1, len(begin.v))),
                axes[rows.dry_rates],
                begin.J_lines[rows.dry_lines],
            ]
        )
        J = J_tree @ begin.L
        J[self._held_by_loops(J)] = 0.0

        # The rate w of a row is J va plus the bias. With the bias gap / h, the gap after the step
        # is h w, which is not negative. The slack of a rope is a gap.
        biases = np.zeros(rows.count)
        biases[rows.normals] = self._approach(begin.gaps, J[rows.normals], begin.va, free, h)
        biases[parts.ropes] = begin.slack / h
        biases[parts.stops] = rows.stop_gaps(begin.q) / h

        # With the rate l_dot of its length and soft = damping + h stiffness, a cable has the
        # tension x / h = tension + soft l_dot, or none if this is negative. So the rate of its row
        # is w = -l_dot - tension / soft + x / (h soft).
        compliance = np.zeros(rows.count)
        soft = np.where(cables.constant, 1.0, cables.damping + h * cables.stiffness)
        biases[parts.cables] = np.where(cables.constant, 0.0, -cables.tensions / soft)
        compliance[parts.cables] = np.where(cables.constant, 0.0, 1 / (h * soft))
        return Rows(J, biases, compliance, rows.kinds, rows.bounds(h))

    def _held_by_loops(self, J: Array) -> Indices:
        """Rows of gaps that cannot change: what they have on the coordinates is rounding."""
        rows = self._rows
        scale = self._mechanism.rate_scale[self._mechanism.coordinates]
        largest = np.abs(J[rows.of_gaps] * scale).max(axis=1, initial=0.0)
        return rows.of_gaps[largest <= HELD_BY_LOOPS * rows.gap_scale]

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
        if not len(self._rope_lengths):
            return np.zeros(0), np.zeros((0, self._mechanism.model.nv))
        self._ropes.evaluate(q)
        distances = self._ropes.f
        # The direction of a rope between coinciding frames is not determined; it is slack.
        apart = distances > LEAST_LENGTH * self._mechanism.length
        return self._rope_lengths - distances, np.where(apart[:, None], -self._ropes.Phi, 0.0)


def _at(J: Array, lever: Array) -> Array:
    """Linear rates of a point of a body from those of a frame, shape (3, nv)."""
    return J[:3] - np.cross(lever, J[3:], axisb=0, axisc=0)
