# SPDX-License-Identifier: BSD-2-Clause
"""Numbers that stay open in kernels: gravity, masses, inertias, friction, springs, rotors, lines.

A kernel has fixed which bodies have mass and which joints have friction, springs or rotors, but not
their numbers: a payload, an identified friction or another gravity needs no compiler.
"""

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..model.mechanism import Friction, Mechanism

if TYPE_CHECKING:
    from casadi import SX


#: Numbers of a body: mass, first moment (3), second moments xx, xy, xz, yy, yz, zz about its frame.
BODY = 10
#: Numbers of a line: stiffness, rest length, damping, preload.
LINE = 4
#: Indices of gravity, base axes.
GRAVITY = slice(3)
#: Index of the rate within which friction is tanh instead of sign.
SIGN_WIDTH = 3
#: Index of the first number of the first body.
_FIRST_BODY = 4
#: Numbers of joints, in their order.
_JOINT = ("armature", "viscous", "coulomb", "stiffness", "spring_reference")
#: The matrix that makes second moments S, ordered xx, xy, xz, yy, yz, zz, from an inertia I about
#: the same point, in Pinocchio's order xx, xy, yy, xz, yz, zz: S = trace(I) / 2 E - I.
_xx, _xy, _yy, _xz, _yz, _zz = np.eye(6)
_HALF_TRACE = (_xx + _yy + _zz) / 2
_SECOND = np.array([_HALF_TRACE - _xx, -_xy, -_xz, _HALF_TRACE - _yy, -_yz, _HALF_TRACE - _zz])


class SymbolicParameters:
    """Order of the symbolic parameters of a mechanism; `size` is their count.

    Gravity and the width of the sign come first. Then come the numbers of bodies, body by body, of
    joints, quantity by quantity, of lines, line by line, and last masses and dry friction of lines.

    If `complete`, all bodies have mass, all joints friction and a rotor, and all lines a mass and
    dry friction, which may be zero.
    """

    def __init__(self, mechanism: Mechanism, *, complete: bool = False) -> None:
        model = mechanism.model
        massive = [complete or np.any(x.toDynamicParameters()) for x in model.inertias]
        #: Indices of Pinocchio's joints whose bodies have mass.
        self.bodies = tuple(i for i in range(1, model.njoints) if massive[i])
        values = _of_joints(mechanism)
        #: Indices of the rates that have each quantity of a joint. References of springs are
        #: positions: for them, the indices are those of entries of q.
        self.joints = {name: tuple(map(int, np.flatnonzero(x))) for name, x in values.items()}
        self.joints["spring_reference"] = _entries_with_springs(mechanism)
        if complete:
            self.joints |= dict.fromkeys(("armature", "viscous", "coulomb"), tuple(range(model.nv)))
        #: Index of the first number of each quantity of joints.
        self._starts = {}
        start = _FIRST_BODY + BODY * len(self.bodies)
        for name in _JOINT:
            self._starts[name] = start
            start += len(self.joints[name])
        lines = len(mechanism.lines.forces)
        self._line_count = lines
        self._first_line = start
        #: Indices of the lines that have a mass.
        self.massive_lines = tuple(k for k in range(lines) if complete or mechanism.lines.masses[k])
        #: Indices of the lines that have dry friction.
        self.dry_lines = tuple(k for k in range(lines) if complete or mechanism.lines.coulomb[k])
        self._first_line_mass = self._first_line + LINE * lines
        self._first_line_coulomb = self._first_line_mass + len(self.massive_lines)
        self.size = self._first_line_coulomb + len(self.dry_lines)

    def pack(self, mechanism: Mechanism, friction: Friction) -> Array:
        """The numbers of a mechanism with the same structure, with this friction, shape (size,)."""
        model = mechanism.model
        values = _of_joints(mechanism)
        values |= {"viscous": friction.viscous, "coulomb": friction.coulomb}
        parts = [model.gravity.linear, [friction.sign_width]]
        for i in self.bodies:
            about_origin = model.inertias[i].toDynamicParameters()
            parts += [about_origin[:4], _SECOND.dot(about_origin[4:])]
        parts += [values[name][list(self.joints[name])] for name in _JOINT]
        lines = mechanism.lines
        of_lines = [lines.stiffness, lines.rest_lengths, lines.damping, lines.preload]
        parts.append(np.transpose(of_lines).ravel())  # line by line
        parts.append(mechanism.lines.masses[list(self.massive_lines)])
        parts.append(mechanism.lines.coulomb[list(self.dry_lines)])
        return np.concatenate(parts)

    def names(self, mechanism: Mechanism) -> tuple[str, ...]:
        """Names of the numbers; a body has the name of its joint."""
        space = mechanism.space
        moments = ("mass", *"xyz", "xx", "xy", "xz", "yy", "yz", "zz")
        names = [f"gravity.{axis}" for axis in "xyz"] + ["sign_width"]
        names += [f"{mechanism.model.names[i]}.{x}" for i in self.bodies for x in moments]
        for quantity in _JOINT:
            of = space.position_names if quantity == "spring_reference" else space.rate_names
            names += [f"{of[k]}.{quantity}" for k in self.joints[quantity]]
        of_lines = ("stiffness", "rest_length", "damping", "preload")
        names += [f"{force}.{x}" for force in mechanism.lines.forces for x in of_lines]
        names += [f"{mechanism.lines.forces[k]}.mass" for k in self.massive_lines]
        names += [f"{mechanism.lines.forces[k]}.coulomb" for k in self.dry_lines]
        return tuple(names)

    def by_parameters(self) -> list[Array]:
        """Derivatives of all numbers by the parameters of `dynamics.regressor`, without offsets.

        The blocks have shape (size, columns) and stand in the order of the regressor: bodies, four
        quantities of rates, lines. The numbers must be `complete`, and the springs of the mechanism
        those of `regressor.with_springs`.
        """
        units = np.eye(self.size)
        end = _FIRST_BODY + BODY * len(self.bodies)
        bodies = units[:, _FIRST_BODY:end].reshape(self.size, -1, BODY).copy()
        bodies[..., 4:] = bodies[..., 4:] @ _SECOND  # by inertias instead of second moments
        blocks = [bodies.reshape(self.size, end - _FIRST_BODY)]
        for name in ("viscous", "coulomb", "armature", "stiffness"):
            start = self._starts[name]
            blocks.append(units[:, start : start + len(self.joints[name])])
        of_lines = units[:, self._first_line : self._first_line_mass].reshape(self.size, -1, LINE)
        masses = units[:, self._first_line_mass : self._first_line_coulomb]
        masses = masses.reshape(self.size, -1, 1)
        coulomb = units[:, self._first_line_coulomb :].reshape(self.size, -1, 1)
        # Rest lengths are constant, as in dynamics.regressor: f is linear in the other numbers.
        stiffness = of_lines[..., 0:1]
        damping_and_preload = of_lines[..., 2:4]
        of_lines = np.concatenate([stiffness, damping_and_preload, masses, coulomb], axis=-1)
        blocks.append(of_lines.reshape(self.size, -1))
        return blocks

    def body(self, p: "SX", body: int) -> "tuple[SX, SX, SX] | None":
        """Mass, first moment and second moments of a body; None without mass."""
        if body not in self.bodies:
            return None
        start = _FIRST_BODY + BODY * self.bodies.index(body)
        xx, xy, xz, yy, yz, zz = range(start + 4, start + BODY)
        J = p[[xx, xy, xz, xy, yy, yz, xz, yz, zz]].reshape((3, 3))
        return p[start], p[start + 1 : start + 4], J

    def of_lines(self, p: "SX") -> "list[list[SX]]":
        """Stiffness, rest length, damping and preload of each line."""
        numbers = []
        for i in range(self._line_count):
            start = self._first_line + LINE * i
            numbers.append([p[start + k] for k in range(LINE)])
        return numbers

    def line_masses(self, p: "SX") -> "dict[int, SX]":
        """Masses of the lines that have one, by their indices."""
        return {k: p[self._first_line_mass + i] for i, k in enumerate(self.massive_lines)}

    def line_coulomb(self, p: "SX") -> "dict[int, SX]":
        """Dry friction of the lines that have it, by their indices."""
        return {k: p[self._first_line_coulomb + i] for i, k in enumerate(self.dry_lines)}

    def of_joints(self, name: str, p: "SX") -> "dict[int, SX]":
        """A quantity of the joints that have it, by indices as those of `joints`."""
        start = self._starts[name]
        return {i: p[start + k] for k, i in enumerate(self.joints[name])}


def _of_joints(mechanism: Mechanism) -> dict[str, Array]:
    """The quantities `_JOINT` of all joints."""
    friction = mechanism.friction
    springs = mechanism.springs
    return {
        "armature": mechanism.model.armature,
        "viscous": friction.viscous,
        "coulomb": friction.coulomb,
        "stiffness": springs.stiffness,
        "spring_reference": springs.reference,
    }


def _entries_with_springs(mechanism: Mechanism) -> tuple[int, ...]:
    """Entries of q of joints with springs: all entries of a ball or an unbounded joint."""
    entries = list[int]()
    for joint in list(mechanism.model.joints)[1:]:
        stiffness = mechanism.springs.stiffness[joint.idx_v : joint.idx_v + joint.nv]
        if joint.nq == joint.nv:  # each rate is that of one entry
            entries += [joint.idx_q + int(k) for k in np.flatnonzero(stiffness)]
        elif stiffness.any():
            entries += range(joint.idx_q, joint.idx_q + joint.nq)
    return tuple(entries)
