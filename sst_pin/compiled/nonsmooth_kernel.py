# SPDX-License-Identifier: BSD-2-Clause
"""The terms of a nonsmooth step on CasADi's symbols: inertia, forces, gaps and rows.

A step computes impulses (of contacts, ropes, cables, stops, dry friction). Each acts along a *row*:
a linear function of the rates va of the coordinates, such as the velocity of a contact along an
axis, or the rate of a joint. Dampers, springs and motors act along rows too. These forces are
*implicit*: a step computes them from the rates at its end.

`NonsmoothTerms` makes the kernel. The rows are sparse: only entries that can differ from zero are
results of the kernel. `Layout` says where they are; `c/nonsmooth_step.h` makes a step of them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np
import pinocchio as pin
from casadi import SX

from ..dynamics.nonsmooth_rows import NonsmoothRows
from ..model.tree import frame_named
from .closure_rows import length_and_row
from .elimination import total
from .equations import Equations
from .kernel_checks import Checks
from .kernels import WRENCHES, SymbolicKernel
from .link_kinematics import MovingFrame
from .nonsmooth_motions import implicit_rates, other_lines
from .symbols import Sparse, add, is_zero


@dataclass
class Layout:
    """Where the results of the kernel are, for the C of a step.

    Rows have numbers in the order in which they are added; several impulses and implicit forces may
    act along one row. Rows are stored as a sparse matrix, row by row: row i has the entries
    row_start[i] to row_start[i + 1] - 1.
    """

    #: Number of coordinates.
    n: int
    #: Index of the first entry of each row, then the number of all entries.
    row_start: list[int] = field(default_factory=lambda: [0])
    #: The column of each entry.
    row_column: list[int] = field(default_factory=list)
    #: Index of the first result of each part: inertia (upper triangle), forces, gaps, lengths of
    #: cables, positions of motors, entries of rows.
    places: dict[str, int] = field(default_factory=dict)
    #: Number of the row of each impulse, in the order of `NonsmoothRows`.
    impulse_row: list[int] = field(default_factory=list)
    #: 1 if a positive impulse acts along its row, -1 if it acts against it.
    impulse_sign: list[int] = field(default_factory=list)
    #: Number of the row of each implicit force: joints, lines that also push, motors.
    implicit_row: list[int] = field(default_factory=list)


class NonsmoothTerms:
    """The terms of a step of one mechanism.

    Numbers such as friction of contacts, lengths of ropes and gains are no part of the terms: the C
    of a step takes them as arguments (`nonsmooth_motions.parameter_values`).

    Attributes:
        layout: Where the results of the kernel are.
    """

    def __init__(self, equations: Equations, rows: NonsmoothRows) -> None:
        self._e = equations
        self._rows = rows
        self._mechanism = equations.mechanism
        self.layout = Layout(len(self._mechanism.coordinates))
        #: Entries of the rows that were added.
        self._entries: list[SX] = []
        #: Heights of contacts, then lengths of ropes with the opposite sign.
        self._gaps: list[SX] = []
        #: Number of the row of a rate of the tree: stops, dry joints and motors share it.
        self._joints: dict[int, int] = {}
        #: Number of the row of a line that also pushes: its dry friction and its damper share it.
        self._lines: dict[int, int] = {}
        #: Twists and origins of bodies, by Pinocchio's joint; several contacts ask for the same.
        self._twists_of_joints: dict[int, tuple[SX, SX]] = {}
        self._add_rows()
        #: The results by the names of their parts, in their order.
        self._parts = self._parts_of_results()
        place = 0
        for name, part in self._parts.items():
            self.layout.places[name] = place
            place += part.numel()

    def kernel(self, checks: Checks) -> SymbolicKernel:
        """The kernel that computes the terms, with the results of `layout`."""
        e = self._e
        inputs = {"q": e.q, "va": e.va}
        if e.loads.numel():
            inputs[WRENCHES] = e.loads
        return SymbolicKernel(
            name="nonsmooth_terms",
            inputs=inputs,
            parameters=e.p,
            output=ca.densify(ca.vertcat(*self._parts.values())),
            checks=ca.vertcat(
                *(SX(check) for check in [*checks.of_state, *checks.of_accelerations])
            ),
        )

    def _parts_of_results(self) -> dict[str, SX]:
        """The parts of the results, whose places `layout.places` has; each is a column."""
        e = self._e
        n = self.layout.n
        inertia = [e.inertia[i, j] for i in range(n) for j in range(i, n)]
        lengths = [e.tree.lines[k].length for k in self._rows.cables]
        return {
            "inertia": ca.vertcat(*inertia),
            "forces": self._forces,
            "gaps": ca.vertcat(SX(0, 1), *self._gaps),
            "lengths": ca.vertcat(SX(0, 1), *lengths),
            "positions": self._motor_positions,
            "entries": ca.vertcat(SX(0, 1), *self._entries),
        }

    @property
    def _forces(self) -> SX:
        """Forces along the coordinates, shape (n,): minus L^T times the forces needed for aa = 0.

        They include inertia, weights, external wrenches, springs, and lines that also push. They do
        not include friction, dampers, motors and cables.
        """
        e = self._e
        cables = set(self._rows.cables.tolist())
        tensions = []
        for k, x in enumerate(e.tree.lines):
            spring = x.preload + x.stiffness * (x.length - x.rest)
            tensions.append(SX(0) if k in cables else spring)
        stiffness = e.parameters.of_joints("stiffness", e.p)
        references = e.parameters.of_joints("spring_reference", e.p)
        displacements = e.kinematics.difference(references)
        springs: Sparse = {k: c * displacements[k] for k, c in stiffness.items()}
        needed = add(
            e.tree.forces(e.v, e.dv_without_aa), add(springs, e.tree.along_lines(tensions))
        )
        return -e.projected_by_L(needed)

    # --- rows -------------------------------------------------------------------------------

    # Methods `_row_of_...` return the number of a row, and add the row if it is new.

    def _add_rows(self) -> None:
        """Add the rows of all impulses and implicit forces to the layout, and the gaps.

        `NonsmoothRows`, `parameter_values` and `c/nonsmooth_step.h` rely on this order of impulses:
        contacts (three each), ropes, cables, stops, dry joints, dry lines; and on this order of
        implicit forces: joints, lines that also push, motors.
        """
        self._add_contacts()
        self._add_ropes()
        self._add_cables()
        self._add_stops()
        self._add_dry_joints()
        self._add_dry_lines()
        self._add_implicit_rows()

    def _add_impulse(self, row: int, sign: int = 1) -> None:
        """Let an impulse act along a row, or against it."""
        self.layout.impulse_row.append(row)
        self.layout.impulse_sign.append(sign)

    def _add_contacts(self) -> None:
        for height, rows in self._contacts():
            self._gaps.append(height)
            for axis in range(3):  # of the ground
                self._add_impulse(self._add(rows[axis, :]))

    def _add_ropes(self) -> None:
        for rope in self._mechanism.contacts.ropes:
            ends = rope.frame_a, rope.frame_b
            distance, row = length_and_row(self._e.kinematics, self._mechanism.model, *ends)
            self._gaps.append(-distance)
            shortening = {i: -x for i, x in row.Phi.items()}  # a rope pulls its ends together
            self._add_impulse(self._add(self._reduced(shortening)))

    def _add_cables(self) -> None:
        for k in self._rows.cables:
            shortening = {i: -x for i, x in self._e.tree.lines[k].row.items()}
            self._add_impulse(self._add(self._reduced(shortening)))

    def _add_stops(self) -> None:
        for stop in self._rows.stops:
            self._add_impulse(self._row_of_joint(stop.rate), stop.side)

    def _add_dry_joints(self) -> None:
        for rate in self._rows.dry_rates:
            self._add_impulse(self._row_of_joint(int(rate)))

    def _add_dry_lines(self) -> None:
        for k in self._rows.dry_lines:
            self._add_impulse(self._row_of_line(int(k)))

    def _add_implicit_rows(self) -> None:
        rows: list[int] = []
        for rate in implicit_rates(self._e.parameters):
            rows.append(self._row_of_joint(rate))
        for k in other_lines(self._rows):
            rows.append(self._row_of_line(k))
        for motor in range(self._mechanism.motor_count):
            rows.append(self._row_of_motor(motor))
        self.layout.implicit_row = rows

    def _add(self, row: SX) -> int:
        """Add a row on the coordinates, shape (1, n), and return its number."""
        number = len(self.layout.row_start) - 1  # of rows so far
        for j in range(self.layout.n):
            if not is_zero(row[j]):
                self.layout.row_column.append(j)
                self._entries.append(row[j])
        self.layout.row_start.append(len(self._entries))
        return number

    def _row_of_joint(self, rate: int) -> int:
        """The number of the row of a rate of the tree."""
        if rate not in self._joints:
            self._joints[rate] = self._add(self._reduced({rate: SX(1)}))
        return self._joints[rate]

    def _row_of_line(self, k: int) -> int:
        """The number of the row of a line's length."""
        if k not in self._lines:
            self._lines[k] = self._add(self._reduced(self._e.tree.lines[k].row))
        return self._lines[k]

    def _row_of_motor(self, k: int) -> int:
        """The number of the row of a motor's rate.

        If the motor drives one joint alone, it is the row of the joint. Cables are left out: a
        motor pulls them by their impulses.
        """
        on_rates = self._mechanism.actuation[:, k]  # effort along each rate of the tree
        on_lines = self._mechanism.lines.actuation[:, k].copy()
        on_lines[self._rows.cables] = 0
        (driven,) = np.nonzero(on_rates)
        if len(driven) == 1 and on_rates[driven[0]] == 1 and not on_lines.any():
            return self._row_of_joint(int(driven[0]))
        row: Sparse = {int(i): SX(float(on_rates[i])) for i in driven}
        return self._add(self._reduced(add(row, self._e.tree.along_lines(on_lines.tolist()))))

    def _reduced(self, row: Sparse) -> SX:
        """A row on the rates of the tree as a row on the coordinates: row times L, shape (1, n)."""
        entries = []
        for L in self._e.L:
            entries.append(SX(total([x * L[i] for i, x in row.items() if i in L])))
        return ca.horzcat(*entries)

    @property
    def _motor_positions(self) -> SX:
        """Position of each motor: displacements of its rates and lengths of its lines, weighted.

        The weights are the efforts of the motor along them. Displacements are from the neutral
        configuration. Rates without a position, such as those of a free-flyer, do not contribute.
        """
        mechanism = self._mechanism
        with_positions = set(mechanism.possible_springs.tolist())
        neutral = pin.neutral(mechanism.model)
        displacements = self._e.kinematics.difference(
            {i: SX(float(neutral[i])) for i in sorted(self._positioned)}
        )
        positions = []
        for motor in range(mechanism.motor_count):
            terms: list[SX] = []
            of_rates = mechanism.actuation[:, motor]
            for k in map(int, np.flatnonzero(of_rates)):
                if k in with_positions:
                    terms.append(float(of_rates[k]) * displacements[k])
            of_lines = mechanism.lines.actuation[:, motor]
            for k in map(int, np.flatnonzero(of_lines)):
                terms.append(float(of_lines[k]) * self._e.tree.lines[k].length)
            positions.append(SX(total(terms)))
        return ca.vertcat(SX(0, 1), *positions)

    @cached_property
    def _positioned(self) -> set[int]:
        """Entries of q of the joints that motors drive and that have positions."""
        driven = set(self._mechanism.driven.tolist()) & set(
            self._mechanism.possible_springs.tolist()
        )
        entries: set[int] = set()
        for joint in list(self._mechanism.model.joints)[1:]:
            if driven.intersection(range(joint.idx_v, joint.idx_v + joint.nv)):
                entries.update(range(joint.idx_q, joint.idx_q + joint.nq))
        return entries

    def _contacts(self) -> Iterator[tuple[SX, SX]]:
        """Height of each contact's frame above its ground, and the rows of its velocity.

        The rows, shape (3, n), map va to the velocity of the contact relative to the ground, in
        axes of the ground. The ground is the plane z = 0 of its frame.
        """
        model = self._mechanism.model
        for contact in self._mechanism.contacts.points:
            frame = frame_named(model, contact.frame)
            ground = frame_named(model, contact.ground)
            place = self._e.kinematics.moving_frame(0, frame)
            plane = self._e.kinematics.moving_frame(0, ground)
            normal = plane.R[:, 2]
            height = ca.dot(normal, place.p - plane.p)
            # The lowest point of the sphere around the frame, and the point of the ground below it.
            lowest = place.p - contact.radius * normal
            below = place.p - height * normal
            relative = self._velocities(frame.parentJoint, lowest)
            if ground.parentJoint:
                relative = relative - self._velocities(ground.parentJoint, below)
            yield height, plane.R.T @ relative

    def _velocities(self, joint: int, at: SX) -> SX:
        """Velocity of a point of a body for a unit rate of each coordinate, base axes, (3, n)."""
        twists, origin = self._twists(joint)
        columns = [
            twists[:3, k] + ca.cross(twists[3:, k], at - origin) for k in range(self.layout.n)
        ]
        return ca.horzcat(*columns)

    def _twists(self, joint: int) -> tuple[SX, SX]:
        """Twists of a body for unit rates of the coordinates, shape (6, n), and its origin."""
        if joint not in self._twists_of_joints:
            frame = pin.Frame("", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
            body: MovingFrame = self._e.kinematics.moving_frame(0, frame)
            columns = []
            for L in self._e.L:
                terms = [body.columns[i] * x for i, x in L.items() if i in body.columns]
                columns.append(sum(terms, SX(6, 1)))
            self._twists_of_joints[joint] = ca.horzcat(*columns), body.p
        return self._twists_of_joints[joint]


def advance(e: Equations) -> SymbolicKernel:
    """The kernel that computes the rates of q from those of the coordinates, for Warp and C."""
    return SymbolicKernel(
        name="advance",
        inputs={"q": e.q, "va": e.va},
        parameters=e.p,
        output=ca.densify(e.kinematics.q_rates(e.v)),
        checks=SX(0, 1),
    )
