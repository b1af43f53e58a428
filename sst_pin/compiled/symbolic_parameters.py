# SPDX-License-Identifier: BSD-2-Clause
"""Symbolic parameters: the numbers of a robot that kernels get as an input p.

They are gravity, masses, inertias, and the numbers of friction, springs, rotors and lines. A kernel
is generated for a structure: which bodies have mass, and which joints have friction, springs or
rotors. Their numbers are symbols. So a payload, an identified friction or another gravity needs no
new kernel.
"""

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..model.mechanism import Friction, Mechanism

if TYPE_CHECKING:
    from casadi import SX


#: Numbers of a body: mass, first moment (3), second moments xx, xy, xz, yy, yz, zz. Both moments
#: are about the origin of its joint's frame.
BODY = 10
#: Numbers of a line: stiffness, rest length, damping, preload.
LINE = 4
#: Indices of gravity in p, base axes.
GRAVITY = slice(3)
#: Index in p of the width of the sign: the rate within which friction is tanh instead of sign.
SIGN_WIDTH = 3
#: Index in p of the first number of the first body.
_FIRST_BODY = 4
#: Quantities of joints, in the order of p.
_JOINT = ("armature", "viscous", "coulomb", "stiffness", "spring_reference")
#: Second moments J of a body from its inertia I about the same point: J = trace(I) / 2 E - I. Rows
#: are in the order xx, xy, xz, yy, yz, zz. Columns are in Pinocchio's order xx, xy, yy, xz, yz, zz.
_SECOND_MOMENTS = np.array(
    [
        [-0.5, 0, 0.5, 0, 0, 0.5],
        [0, -1, 0, 0, 0, 0],
        [0, 0, 0, -1, 0, 0],
        [0.5, 0, -0.5, 0, 0, 0.5],
        [0, 0, 0, 0, -1, 0],
        [0.5, 0, 0.5, 0, 0, -0.5],
    ]
)


class SymbolicParameters:
    """Which symbolic parameters a mechanism has, and their places in p.

    The order of p is: gravity; the width of the sign; the numbers of each body; each quantity of
    joints; the numbers of each line; masses of lines; dry friction of lines.

    Args:
        mechanism: The mechanism.
        complete: Whether all bodies have a mass, all joints friction and a rotor, and all lines a
            mass and dry friction, even if their numbers are zero.

    Attributes:
        size: Number of the parameters.
        bodies: Indices of Pinocchio's joints whose bodies have mass.
        joints: For each quantity of joints, the indices of the rates that have it. References of
            springs are positions: for "spring_reference", the indices are those of entries of q.
        massive_lines: Indices of the lines that have a mass.
        dry_lines: Indices of the lines that have dry friction.
    """

    def __init__(self, mechanism: Mechanism, *, complete: bool = False) -> None:
        model = mechanism.model
        massive = [complete or np.any(x.toDynamicParameters()) for x in model.inertias]
        self.bodies = tuple(i for i in range(1, model.njoints) if massive[i])
        values = _of_joints(mechanism)
        self.joints = {name: tuple(map(int, np.flatnonzero(x))) for name, x in values.items()}
        # A reference of zero is a position like any other. So the entries of q with springs replace
        # those whose reference is not zero.
        self.joints["spring_reference"] = _entries_with_springs(mechanism)
        if complete:
            self.joints |= dict.fromkeys(("armature", "viscous", "coulomb"), tuple(range(model.nv)))
        lines = range(len(mechanism.lines.forces))
        self.massive_lines = tuple(k for k in lines if complete or mechanism.lines.masses[k])
        self.dry_lines = tuple(k for k in lines if complete or mechanism.lines.coulomb[k])

        # Places in p, one group of numbers after the other.
        self._body_numbers = _next(_FIRST_BODY, BODY * len(self.bodies))
        end = self._body_numbers.stop
        self._joint_numbers: dict[str, slice] = {}
        for name in _JOINT:
            self._joint_numbers[name] = _next(end, len(self.joints[name]))
            end = self._joint_numbers[name].stop
        self._line_numbers = _next(end, LINE * len(lines))
        self._line_masses = _next(self._line_numbers.stop, len(self.massive_lines))
        self._line_coulomb = _next(self._line_masses.stop, len(self.dry_lines))
        self.size: int = self._line_coulomb.stop

    # --- numbers ----------------------------------------------------------------------------------

    def pack(self, mechanism: Mechanism, friction: Friction) -> Array:
        """The vector p of a mechanism with the same structure, shape (size,).

        Args:
            mechanism: The mechanism.
            friction: The friction of joints, in place of the mechanism's.
        """
        model = mechanism.model
        lines = mechanism.lines
        values = _of_joints(mechanism)
        values |= {"viscous": friction.viscous, "coulomb": friction.coulomb}
        parts = [model.gravity.linear, [friction.sign_width]]
        for i in self.bodies:
            mass_moments_inertia = model.inertias[i].toDynamicParameters()
            parts.append(mass_moments_inertia[:4])
            parts.append(_SECOND_MOMENTS.dot(mass_moments_inertia[4:]))
        for name in _JOINT:
            parts.append(values[name][list(self.joints[name])])
        of_lines = [lines.stiffness, lines.rest_lengths, lines.damping, lines.preload]
        parts.append(np.transpose(of_lines).ravel())  # line by line
        parts.append(lines.masses[list(self.massive_lines)])
        parts.append(lines.coulomb[list(self.dry_lines)])
        return np.concatenate(parts)

    def names(self, mechanism: Mechanism) -> tuple[str, ...]:
        """Names of the parameters, in the order of p; a body has the name of its joint."""
        space = mechanism.space
        moments = ("mass", *"xyz", "xx", "xy", "xz", "yy", "yz", "zz")
        names = [f"gravity.{axis}" for axis in "xyz"] + ["sign_width"]
        names += [f"{mechanism.model.names[i]}.{x}" for i in self.bodies for x in moments]
        for quantity in _JOINT:
            # References of springs are positions.
            is_position = quantity == "spring_reference"
            places = space.position_names if is_position else space.rate_names
            names += [f"{places[k]}.{quantity}" for k in self.joints[quantity]]
        of_lines = ("stiffness", "rest_length", "damping", "preload")
        names += [f"{force}.{x}" for force in mechanism.lines.forces for x in of_lines]
        names += [f"{mechanism.lines.forces[k]}.mass" for k in self.massive_lines]
        names += [f"{mechanism.lines.forces[k]}.coulomb" for k in self.dry_lines]
        return tuple(names)

    # --- derivatives ------------------------------------------------------------------------------

    def by_parameters(self) -> list[Array]:
        """Derivatives of p by the dynamic parameters, which multiply the regressor Y.

        The offsets of joint forces and of motors are left out, because they are not in p. The list
        has one matrix for each group of parameters, in the order of `dynamics.regressor`: bodies;
        viscous friction, dry friction, armature and stiffness of the rates; lines. A matrix has the
        shape (size, parameters of the group). `SymbolicParameters` must be `complete`, and the
        springs of the mechanism those of `regressor.with_springs`.
        """
        identity = np.eye(self.size)  # the derivatives of p by p

        # The regressor has inertias I in place of the second moments J: dp/dI = dp/dJ dJ/dI. The
        # shape is (size, bodies, numbers of a body).
        bodies = identity[:, self._body_numbers].reshape(self.size, -1, BODY).copy()
        bodies[..., 4:] = bodies[..., 4:] @ _SECOND_MOMENTS
        matrices = [bodies.reshape(self.size, -1)]

        for name in ("viscous", "coulomb", "armature", "stiffness"):
            matrices.append(identity[:, self._joint_numbers[name]])

        # The regressor holds rest lengths constant, so that f is linear in its parameters. The
        # shape is (size, lines, numbers of a line).
        lines = identity[:, self._line_numbers].reshape(self.size, -1, LINE)
        stiffness = lines[..., 0:1]
        damping_and_preload = lines[..., 2:4]
        masses = identity[:, self._line_masses].reshape(self.size, -1, 1)
        coulomb = identity[:, self._line_coulomb].reshape(self.size, -1, 1)
        of_lines = np.concatenate([stiffness, damping_and_preload, masses, coulomb], axis=-1)
        matrices.append(of_lines.reshape(self.size, -1))
        return matrices

    # --- symbols ----------------------------------------------------------------------------------

    def body(self, p: "SX", body: int) -> "tuple[SX, SX, SX] | None":
        """Mass, first moment (3,) and second moments (3, 3) of a body; None without mass."""
        if body not in self.bodies:
            return None
        start = _FIRST_BODY + BODY * self.bodies.index(body)
        xx, xy, xz, yy, yz, zz = range(start + 4, start + BODY)
        J = p[[xx, xy, xz, xy, yy, yz, xz, yz, zz]].reshape((3, 3))
        return p[start], p[start + 1 : start + 4], J

    def of_lines(self, p: "SX") -> "list[list[SX]]":
        """Stiffness, rest length, damping and preload of each line."""
        numbers = []
        for start in range(self._line_numbers.start, self._line_numbers.stop, LINE):
            numbers.append([p[start + k] for k in range(LINE)])
        return numbers

    def line_masses(self, p: "SX") -> "dict[int, SX]":
        """Masses of the lines that have one, by the index of the line."""
        return {k: p[self._line_masses.start + i] for i, k in enumerate(self.massive_lines)}

    def line_coulomb(self, p: "SX") -> "dict[int, SX]":
        """Dry friction of the lines that have it, by the index of the line."""
        return {k: p[self._line_coulomb.start + i] for i, k in enumerate(self.dry_lines)}

    def of_joints(self, name: str, p: "SX") -> "dict[int, SX]":
        """A quantity of the joints that have it, by the indices in `joints`."""
        start = self._joint_numbers[name].start
        return {index: p[start + k] for k, index in enumerate(self.joints[name])}


def _next(start: int, count: int) -> slice:
    """The places in p of `count` numbers from index `start` on."""
    return slice(start, start + count)


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
