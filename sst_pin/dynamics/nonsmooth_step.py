# SPDX-License-Identifier: BSD-2-Clause
"""One step of motion with stops, dry friction, ropes and contacts, by the reference path.

Each stop, each dry friction, each rope and cable has a row, and each contact has three; see
`nonsmooth_rows`. A row has an impulse in a step. A step of length h (`NonsmoothStep.step`) has
three parts:

1. The free rates va of the coordinates at its end, those without impulses, solve

       (M + h D + h^2 C) va = M va_0 + h f(q, v_0).

   M is the mass matrix in the coordinates. f are the forces at the beginning, without the forces
   of dampers and of rows. D and C are the damping and the stiffness of joints, of lines that also
   push, and of the gains of motors. With D and C in the equation, dampers and springs have their
   forces at the end of the step: the step is implicit in these forces.
2. `impulses` computes the impulses of the rows, which change the free rates.
3. The configuration is moved along these rates, and Newton's method closes the loops.

The choice of the coordinates changes a motion only by the error of its steps, which is of order h.
The reference path makes steps in other coordinates where the condition number of the dependent
joints is above 10 (`simulation.nonsmooth_reference`). Compiled steps keep the robot's coordinates
and leave steps near singular configurations to the reference path.
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
    """Torques, positions of motors and wrenches that act in a step.

    A motor gives tau + stiffness (position to hold - present position) - damping rate, with the
    rate of the motor and with stiffness and damping of `MotorGains`.

    Attributes:
        tau: Torques of the motors besides those of their gains, shape (motors,).
        positions: Positions that the gains hold, shape (motors,).
        wrenches: External [force; moment] on the bodies at their mass centres, shape (r, 6), or
            None.
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
        x: Impulses of the rows, shape (m,), [N s] or [N m s].
        residual: The residual of `Impulses`.
    """

    q: Array
    va: Array
    v: Array
    x: Array
    residual: float


class NonsmoothArrays(NamedTuple):
    """Arguments and results of N motions side by side.

    Results are filled in: the states after the first one, forces, residuals and impulses.

    Attributes:
        dt: Length of a step, [s].
        tau: Torques, shape (N, steps, motors).
        positions: Positions that the gains hold, shape (N, steps, motors).
        load: Constant external wrenches, shape (N, r, 6), or None.
        q: Configurations, shape (N, steps + 1, nq). The first ones are the starts.
        va: Rates of the coordinates, shape (N, steps + 1, n). The first ones are given.
        forces: Forces of the rows, shape (N, steps, m).
        residual: The residuals of `Impulses`, shape (N, steps).
        impulses: Impulses of the last step that was made, shape (N, m): where the solver starts.
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
        M_tree: Mass matrix of the tree, shape (nv, nv).
        force: Forces of weights and of the rates (Coriolis, centrifugal) on the tree, shape (nv,).
        gaps: Gaps of the contacts, shape (contacts,), [m].
        J_contacts: The relative velocities of the contacts' points in the axes of their grounds are
            J_contacts v, shape (3 contacts, nv).
        slack: Lengths of the ropes less the distances of their ends, shape (ropes,), [m].
        J_ropes: The rates of the slack are J_ropes v, shape (ropes, nv).
        lengths: Lengths of the lines, shape (lines,), [m].
        J_lines: The rates of the lengths are J_lines v, shape (lines, nv).
    """

    q: Array
    va: Array
    v: Array
    L: Array
    M_tree: Array
    force: Array
    gaps: Array
    J_contacts: Array
    slack: Array
    J_ropes: Array
    lengths: Array
    J_lines: Array


class _Cables(NamedTuple):
    """The cables, which are the lines that only pull, with the gains of motors on them.

    There are two kinds. An elastic cable has stiffness or damping. Its tension at the end of the
    step is that at the beginning, plus stiffness times the change of its length, plus damping times
    its rate, but never negative: therefore a row computes it. A cable without stiffness and damping
    has a constant tension in a step, which is a force; its row has no impulse.

    Attributes:
        tensions: Tensions at the beginning without dampers, shape (cables,), [N]. They are negative
            where a spring pushes.
        stiffness: Shape (cables,), [N/m].
        damping: Shape (cables,), [N s/m].
        constant: Which cables have a constant tension, shape (cables,).
        constant_pulls: These tensions, and zero for elastic cables, shape (cables,), [N].
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
        lines = np.arange(len(self._mechanism.lines.forces))
        #: Indices of the lines that pull and push. `rows.cables` are the indices of the other
        #: lines, which only pull. `rows.parts.cables` is the slice of the rows of these cables.
        self._rods = np.setdiff1d(lines, rows.cables)

    @cached_property
    def _rope_distances(self) -> Loops:
        """The ropes as lines: f are the distances of their ends."""
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

        # The free rates: (M + h D + h^2 C) free = M va + h f.
        force = self._forces(begin, tau, tensions, cables, forces.wrenches)
        M = begin.L.T @ begin.M_tree @ begin.L
        implicit_inertia = M + self._damping_and_stiffness(begin, h)
        free = np.linalg.solve(implicit_inertia, M @ va + h * (begin.L.T @ force))

        rows = self._impulse_rows(begin, cables, free, h)
        after, x, residual = impulses(implicit_inertia, free, rows, start)
        x[self._rows.parts.cables] += h * cables.constant_pulls  # their rows have no impulses
        v = begin.L @ after
        ahead = mechanism.space.normalised(q + h * mechanism.space.q_dot(q, v))
        # `without_slip` closes the loops with wheels that roll and with braked joints at rest.
        end = self._context.without_slip.assemble(ahead, mechanism.dependent)
        return Step(end, after, v, x, residual)

    def _beginning(self, q: Array, va: Array) -> _Beginning:
        """All that a step needs of the state (q, va)."""
        context = self._context
        v, v_dot = context.complement.motion(q, va, context.zero_aa)
        M_tree = context.tree_inertia()
        force = -context.tree_forces(v, v_dot)
        gaps, J_contacts = self._contacts()
        slack, J_ropes = self._slack(q)
        lengths, J_lines = context.lines.evaluate(q)
        return _Beginning(
            q=q,
            va=va,
            v=v,
            L=context.complement.L,
            M_tree=M_tree,
            force=force,
            gaps=gaps,
            J_contacts=J_contacts,
            slack=slack,
            J_ropes=J_ropes,
            lengths=lengths,
            J_lines=J_lines,
        )

    def _tensions(self, begin: _Beginning, tau: Array) -> Array:
        """Tensions of all lines with motor torques tau, without dampers, shape (lines,).

        A tension pulls the ends of a line together. A positive torque of a motor pushes them apart,
        so it reduces the tension: `actuation` is the push per unit of torque.
        """
        lines = self._mechanism.lines
        springs = lines.stiffness * (begin.lengths - lines.rest_lengths)
        return np.asarray(lines.preload + springs - lines.actuation @ tau)

    def _cables(self, tensions: Array) -> _Cables:
        """The cables; `tensions` are those of all lines."""
        lines = self._mechanism.lines
        cables = self._rows.cables
        gains = self._rows.gains
        # The position of a motor is a factor times the length, and its tension the same factor
        # times its force, so that gains count with the square of the factor.
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
        """Forces on the tree at the beginning, without dampers and impulses, shape (nv,).

        J_lines v are the rates at which lines become longer. A tension acts against them, so that
        its forces along v are -J_lines^T times the tension.
        """
        mechanism = self._mechanism
        rods = self._rods
        force = begin.force + mechanism.actuation @ tau - tensions[rods] @ begin.J_lines[rods]
        force = force + mechanism.springs.forces(mechanism.model, begin.q)
        if wrenches is not None:
            force = force + wrenches.ravel() @ body_jacobians(self._context.loops)
        return np.asarray(force - cables.constant_pulls @ begin.J_lines[self._rows.cables])

    def _damping_and_stiffness(self, begin: _Beginning, h: float) -> Array:
        """h D + h^2 C, shape (n, n), of joints, lines that push, and gains of motors.

        An element with the rate J va, damping d and stiffness c has the force d J va at the end,
        and c h J va more than at the beginning: it adds J^T (h d + h^2 c) J.
        """
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
                np.where(cables.constant[:, None], 0.0, J_cables),
                np.reshape(J_stops, (-1, len(begin.v))),
                axes[rows.dry_rates],
                begin.J_lines[rows.dry_lines],
            ]
        )
        J = J_tree @ begin.L
        J[self._held_by_loops(J)] = 0.0

        # The rate of a row is w = J va + bias + compliance x. With the bias gap / h, the gap after
        # the step is h w, and w >= 0 keeps it open. The slack of a rope is a gap.
        biases = np.zeros(rows.count)
        biases[rows.normals] = self._approach(begin.gaps, J[rows.normals], begin.va, free, h)
        biases[parts.ropes] = begin.slack / h
        biases[parts.stops] = rows.stop_gaps(begin.q) / h

        # An elastic cable has the rate l_dot of its length, which is -J va of its row. With
        # soft = damping + h stiffness, its tension at the end is tension + soft l_dot, or 0 if this
        # is negative. The impulse x is h times the tension at the end. So the row is
        # w = -l_dot - tension / soft + x / (h soft), with x >= 0, w >= 0 and x w = 0.
        # A cable with a constant tension has no such row: its soft = 1 only avoids a division by
        # zero.
        compliance = np.zeros(rows.count)
        soft = np.where(cables.constant, 1.0, cables.damping + h * cables.stiffness)
        biases[parts.cables] = np.where(cables.constant, 0.0, -cables.tensions / soft)
        compliance[parts.cables] = np.where(cables.constant, 0.0, 1 / (h * soft))
        return Rows(J, biases, compliance, rows.kinds, rows.bounds(h))

    def _held_by_loops(self, J: Array) -> Indices:
        """Indices of the rows of gaps that the loops hold constant: their J is rounding.

        J times the scales of the coordinates has the unit of the gap, metres or radians. Over
        `gap_scale`, which has the same order as `gap_rows`, it is free of units.
        """
        rows = self._rows
        scale = self._mechanism.rate_scale[self._mechanism.coordinates]
        largest = np.abs(J[rows.gap_rows] * scale).max(axis=1, initial=0.0)
        return rows.gap_rows[largest <= HELD_BY_LOOPS * rows.gap_scale]

    def _approach(self, gaps: Array, J: Array, va: Array, free: Array, h: float) -> Array:
        """Biases of the normal rows, shape (contacts,).

        A bias is gap / h. In an impact it is restitution times the normal rate before, which is
        negative: w = 0 then means that the rate after is -restitution times this rate.
        """
        before = J @ va
        closing_rates = np.minimum(before, J @ free)
        closes = gaps + h * closing_rates <= 0
        impacts = (self._rows.restitution > 0) & (before < 0) & closes
        return np.where(impacts, self._rows.restitution * before, gaps / h)

    def _contacts(self) -> tuple[Array, Array]:
        """Gaps and Jacobian of the contacts, as in `_Beginning`, at the configuration of the loops.

        Two points touch: the lowest point of the sphere, and the point of the ground's body below.
        """
        loops = self._context.loops
        gaps = np.zeros(len(self._frames))
        J_contacts = np.zeros((3 * len(self._frames), loops.model.nv))
        for k, (frame, ground, radius) in enumerate(self._frames):
            plane = loops.data.oMf[ground]
            p = loops.data.oMf[frame].translation
            normal = plane.rotation[:, 2]
            height = normal @ (p - plane.translation)
            gaps[k] = height - radius
            lowest = -radius * normal  # from the frame to the lowest point
            below = p - plane.translation - height * normal  # from the ground's frame
            J_lowest = _point_jacobian(loops.frame_jacobian(frame), lowest)
            J_below = _point_jacobian(loops.frame_jacobian(ground), below)
            J_contacts[3 * k : 3 * k + 3] = plane.rotation.T @ (J_lowest - J_below)
        return gaps, J_contacts

    def _slack(self, q: Array) -> tuple[Array, Array]:
        """Slack and Jacobian of the ropes, as in `_Beginning`."""
        if not len(self._rope_lengths):
            return np.zeros(0), np.zeros((0, self._mechanism.model.nv))
        self._rope_distances.evaluate(q)
        distances = self._rope_distances.f
        # Between coinciding frames a rope has no direction; it is slack, so its row is zero.
        apart = distances > LEAST_LENGTH * self._mechanism.length
        J_ropes = np.where(apart[:, None], -self._rope_distances.Phi, 0.0)
        return self._rope_lengths - distances, J_ropes


def _point_jacobian(J: Array, lever: Array) -> Array:
    """Linear Jacobian of a point of a body, shape (3, nv).

    J is the Jacobian of a frame of the body, [linear; angular], and `lever` the vector from the
    frame to the point, in base axes. If the frame has the twist [v; omega], the point has the
    velocity v - lever x omega.
    """
    # The cross product of `lever` with each column of the angular Jacobian.
    return J[:3] - np.cross(lever, J[3:], axisb=0, axisc=0)
