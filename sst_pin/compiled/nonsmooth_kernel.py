# SPDX-License-Identifier: BSD-2-Clause
"""The terms of a nonsmooth step on CasADi's symbols: inertia, forces, gaps and rows.

The rows are sparse: only entries that can differ from zero are results. `c/nonsmooth.h` makes a
step of them.
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
from .closure_rows import line
from .elimination import total
from .equations import Equations
from .kernel_checks import Checks
from .kernels import SymbolicKernel
from .link_kinematics import Point
from .nonsmooth_motions import implicit_rates, other_lines
from .symbols import Sparse, add, is_zero


@dataclass
class Layout:
    """Where the results of the kernel are, for the C of a step; rows are numbered as they come."""

    n: int
    #: First entries and columns of the rows, as of a sparse matrix.
    row_start: list[int] = field(default_factory=lambda: [0])
    row_column: list[int] = field(default_factory=list)
    #: Places of parts of the results: inertia (upper triangle), forces, gaps, lengths, positions.
    places: dict[str, int] = field(default_factory=dict)
    #: Row of each impulse of `NonsmoothRows`, and its sign.
    impulse_row: list[int] = field(default_factory=list)
    impulse_sign: list[int] = field(default_factory=list)
    #: Rows with damping and stiffness that are taken at the end of the step; motors come last.
    implicit_row: list[int] = field(default_factory=list)


class NonsmoothTerms:
    """The kernel of one mechanism. Numbers of contacts, ropes and gains stay open."""

    def __init__(self, equations: Equations, rows: NonsmoothRows) -> None:
        self._e = equations
        self._rows = rows
        self._mechanism = equations.mechanism
        self.layout = Layout(len(self._mechanism.coordinates))
        self._entries: list[SX] = []
        self._joints: dict[int, int] = {}

    def kernel(self, checks: Checks) -> SymbolicKernel:
        """Inertia, forces, gaps, lengths of cables, motor positions, entries of rows."""
        e, layout, n = self._e, self.layout, self.layout.n
        self._add_rows()
        inertia = [e.inertia[i, j] for i in range(n) for j in range(i, n)]
        parts = {
            "inertia": ca.vertcat(*inertia),
            "forces": self._forces,
            "gaps": ca.vertcat(SX(0, 1), *self._gaps),
            "lengths": ca.vertcat(SX(0, 1), *(e.tree.lines[k].length for k in self._rows.cables)),
            "positions": self._motor_positions,
            "entries": ca.vertcat(SX(0, 1), *self._entries),
        }
        at = 0
        for name, part in parts.items():
            layout.places[name] = at
            at += part.numel()
        inputs = {"q": e.q, "va": e.va}
        if e.loads.numel():
            inputs["external_wrenches"] = e.loads
        more = checks.of_accelerations
        return SymbolicKernel(
            "nonsmooth_terms",
            inputs,
            e.p,
            ca.densify(ca.vertcat(*parts.values())),
            ca.vertcat(*(SX(check) for check in [*checks.of_state, *more])),
        )

    @property
    def _forces(self) -> SX:
        """What acts on the coordinates but friction, dampers, motors and cables, shape (n,)."""
        e = self._e
        pulls_only = set(self._rows.cables.tolist())
        tensions = [
            SX(0) if k in pulls_only else x.preload + x.stiffness * (x.length - x.rest)
            for k, x in enumerate(e.tree.lines)
        ]
        stiffness = e.parameters.of_joints("stiffness", e.p)
        moves = e.kinematics.difference(e.parameters.of_joints("spring_reference", e.p))
        springs: Sparse = {k: c * moves[k] for k, c in stiffness.items()}
        needed = add(e.tree.forces(e.v, e.at_rest), add(springs, e.tree.along_lines(tensions)))
        return -e.project(needed)

    # --- rows -------------------------------------------------------------------------------

    def _add_rows(self) -> None:
        rows = self._rows
        layout = self.layout
        mechanism = self._mechanism
        self._gaps: list[SX] = []
        for gap, of_contact in self._contacts():
            self._gaps.append(gap)
            layout.impulse_row += [self._add(of_contact[i, :]) for i in range(3)]
        for rope in mechanism.contacts.ropes:
            ends = rope.frame_a, rope.frame_b
            distance, row = line(self._e.kinematics, mechanism.model, *ends)
            self._gaps.append(-distance)
            shortening = {i: -x for i, x in row.Phi.items()}
            layout.impulse_row.append(self._add(self._reduced(shortening)))
        for k in rows.cables:
            row = self._e.tree.lines[k].row
            layout.impulse_row.append(self._add(self._reduced({i: -x for i, x in row.items()})))
        layout.impulse_sign += [1] * len(layout.impulse_row)
        for stop in rows.stops:
            layout.impulse_row.append(self._of_joint(stop.rate))
            layout.impulse_sign.append(stop.side)
        for rate in rows.dry:
            layout.impulse_row.append(self._of_joint(int(rate)))
            layout.impulse_sign.append(1)
        layout.implicit_row += [self._of_joint(rate) for rate in implicit_rates(self._e.parameters)]
        for k in other_lines(rows):
            layout.implicit_row.append(self._add(self._reduced(self._e.tree.lines[k].row)))
        layout.implicit_row += [self._of_motor(k) for k in range(mechanism.motor_count)]

    def _add(self, row: SX) -> int:
        """Add a row on the coordinates; its number."""
        for j in range(self.layout.n):
            if not is_zero(row[j]):
                self.layout.row_column.append(j)
                self._entries.append(row[j])
        self.layout.row_start.append(len(self._entries))
        return len(self.layout.row_start) - 2

    def _of_joint(self, rate: int) -> int:
        """The row of a rate of the tree."""
        if rate not in self._joints:
            self._joints[rate] = self._add(self._reduced({rate: SX(1)}))
        return self._joints[rate]

    def _of_motor(self, k: int) -> int:
        """The row of the rate of a motor; cables are left out."""
        on_rates = self._mechanism.actuation[:, k]
        on_lines = self._mechanism.lines.actuation[:, k].copy()
        on_lines[self._rows.cables] = 0
        (driven,) = np.nonzero(on_rates)
        if len(driven) == 1 and on_rates[driven[0]] == 1 and not on_lines.any():
            return self._of_joint(int(driven[0]))
        row: Sparse = {int(i): SX(float(on_rates[i])) for i in driven}
        return self._add(self._reduced(add(row, self._e.tree.along_lines(on_lines.tolist()))))

    def _reduced(self, row: Sparse) -> SX:
        """A row on the rates of the tree as a row on the coordinates, row L."""
        entries = []
        for L in self._e.L:
            entries.append(SX(total([x * L[i] for i, x in row.items() if i in L])))
        return ca.horzcat(*entries)

    @property
    def _motor_positions(self) -> SX:
        """Position of each motor; of rates without a position, zero."""
        model = self._mechanism.model
        sprung = set(self._mechanism.possible_springs.tolist())
        neutral = {i: SX(float(x)) for i, x in enumerate(pin.neutral(model))}
        moves = self._e.kinematics.difference(
            {i: x for i, x in neutral.items() if i in self._positioned}
        )
        positions = []
        for of_rates, of_lines in zip(
            self._mechanism.actuation.T, self._mechanism.lines.actuation.T, strict=True
        ):
            terms = [
                float(of_rates[k]) * moves[int(k)]
                for k in np.flatnonzero(of_rates)
                if int(k) in sprung
            ]
            terms += [
                float(of_lines[k]) * self._e.tree.lines[k].length for k in np.flatnonzero(of_lines)
            ]
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
        """Height of each contact's frame, and its rows, shape (3, n), in axes of its ground."""
        for contact in self._mechanism.contacts.points:
            frame, ground = (
                frame_named(self._mechanism.model, name) for name in (contact.frame, contact.ground)
            )
            place = self._e.kinematics.point(0, frame)
            plane = self._e.kinematics.point(0, ground)
            normal = plane.R[:, 2]
            height = ca.dot(normal, place.p - plane.p)
            touching = place.p - contact.radius * normal
            below = place.p - height * normal
            relative = self._velocities(frame.parentJoint, touching)
            if ground.parentJoint:
                relative = relative - self._velocities(ground.parentJoint, below)
            yield height, plane.R.T @ relative

    def _velocities(self, joint: int, at: SX) -> SX:
        """Velocity of a point of a body for the rate of each coordinate, world axes, (3, n)."""
        twists, origin = self._twists(joint)
        columns = [
            twists[:3, k] + ca.cross(twists[3:, k], at - origin) for k in range(self.layout.n)
        ]
        return ca.horzcat(*columns)

    def _twists(self, joint: int) -> tuple[SX, SX]:
        """Twists of a body for the rates of the coordinates, shape (6, n), and its origin."""
        if joint not in self._known:
            frame = pin.Frame("", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
            body: Point = self._e.kinematics.point(0, frame)
            columns = []
            for L in self._e.L:
                terms = [body.columns[i] * x for i, x in L.items() if i in body.columns]
                columns.append(sum(terms, SX(6, 1)))
            self._known[joint] = ca.horzcat(*columns), body.p
        return self._known[joint]

    @cached_property
    def _known(self) -> dict[int, tuple[SX, SX]]:
        return {}


def advance(e: Equations) -> SymbolicKernel:
    """Rates of q for rates of the coordinates."""
    rates = ca.densify(e.kinematics.q_rates(e.v))
    return SymbolicKernel("advance", {"q": e.q, "va": e.va}, e.p, rates, SX(0, 1))
