# SPDX-License-Identifier: BSD-2-Clause
"""Forces along lines: springs, dampers and cylinders without mass between two frames.

A line is a `Distance` that nothing holds: its row of Phi gives the rate of its length.
"""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, fields
from functools import cached_property

import numpy as np
import pinocchio as pin

from ..arrays import Array, single_array
from ..errors import InputError, SingularConfigurationError
from ..loops.loops import Loops
from .closures import Distance

#: A line that is shorter has no direction, relative to the length of the robot.
LEAST_LENGTH = 1e-9


@dataclass(frozen=True)
class LineForce:
    """A force along the line between the origins of two frames: a spring, a damper, a cylinder.

    The tension is preload + stiffness (length - rest_length) + damping times the rate of the
    length, [N]. A positive tension pulls the two frames together; a gas spring, which pushes, has a
    negative preload.

    If the name of the line is in `actuated`, the line is a motor too, a cylinder without mass. Its
    torque is a force, [N], beside the tension. A positive one pushes the frames apart, so that it
    times the rate of the length is the motor's power.

    Attributes:
        frame_a: Name of a frame of the tree; "universe" is the world.
        frame_b: Name of another frame.
        stiffness: Zero or positive, [N/m].
        rest_length: Length at which the spring has no force, zero or positive, [m].
        damping: Zero or positive, [N s/m].
        preload: Tension at the rest length, [N].
        name: "a-b" from the names of the frames by default.

    Raises:
        InputError: For a negative number, one that is not finite, a name that is none, or a line
            from a frame to itself.

    Example:
        >>> gas = sst_pin.LineForce("body", "door", stiffness=200, rest_length=0.5, preload=-400)
        >>> gas.name
        'body-door'
    """

    frame_a: str
    frame_b: str
    _: KW_ONLY
    stiffness: float = 0.0
    rest_length: float = 0.0
    damping: float = 0.0
    preload: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        for word in (self.frame_a, self.frame_b, self.name):
            if not isinstance(word, str):
                raise InputError("forces", f"{word!r} is not a name")
        if not self.name:
            object.__setattr__(self, "name", f"{self.frame_a}-{self.frame_b}")
        if self.frame_a == self.frame_b:
            raise InputError("forces", f"{self}: a line needs two different frames")
        for field in fields(self)[2:-1]:
            name = f"{field.name} of line {self}"
            number = float(single_array(name, getattr(self, field.name), ()))
            if number < 0 and field.name != "preload":
                raise InputError(name, f"{number:g} is negative")
            object.__setattr__(self, field.name, number)

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Lines:
    """The forces along lines of one robot."""

    #: One for each line.
    forces: tuple[LineForce, ...]
    #: Forces that push the ends of the lines apart are this times the motors' torques, shape
    #: (lines, motors).
    motors: Array

    @cached_property
    def none(self) -> bool:
        """Whether there is no line."""
        return not self.forces

    @cached_property
    def numbers(self) -> Array:
        """Stiffness, rest length, damping and preload of the lines, shape (4, lines)."""
        rows = [(x.stiffness, x.rest_length, x.damping, x.preload) for x in self.forces]
        return np.array(rows).reshape(-1, 4).T

    def tensions(self, lengths: Array, rates: Array, tau: Array | None = None) -> Array:
        """What pulls the ends together, motors included, shape (..., lines), [N]."""
        stiffness, rest, damping, preload = self.numbers
        passive = preload + stiffness * (lengths - rest) + damping * rates
        return np.asarray(passive if tau is None else passive - self.motors.dot(tau))

    def energy(self, lengths: Array) -> float:
        """Potential energy, zero where all lines have their rest length, [J]."""
        stiffness, rest, _, preload = self.numbers
        return float((preload + stiffness * (lengths - rest) / 2).dot(lengths - rest))


class LineKinematics:
    """Lengths of lines on a tree of this length, and their rates; one object per thread."""

    def __init__(self, model: pin.Model, forces: Sequence[LineForce], length: float) -> None:
        self._model, self._forces, self._least = model, forces, LEAST_LENGTH * length

    @cached_property
    def loops(self) -> Loops:
        """The lines as distances of 1 m that nothing holds."""
        lines = self._forces
        return Loops(self._model, [Distance(line.frame_a, line.frame_b, 1.0) for line in lines])

    def lengths(self, q: Array) -> Array:
        """Lengths of the lines, shape (lines,), [m]."""
        if not self._forces:
            return np.zeros(0)
        self.loops.evaluate(q)
        return self.loops.residual() + 1.0

    def evaluate(self, q: Array) -> tuple[Array, Array]:
        """Lengths, shape (lines,), and J, shape (lines, nv): the rates of the lengths are J v."""
        lengths = self.lengths(q)
        if short := [
            x for x, size in zip(self._forces, lengths, strict=True) if size <= self._least
        ]:
            raise SingularConfigurationError(
                f"the direction of the force on line {short[0]} is not determined: its ends "
                f"{short[0].frame_a} and {short[0].frame_b} coincide; move away, or choose other "
                "frames",
                float("inf"),
            )
        return lengths, self.loops.Phi() if self._forces else np.zeros((0, self._model.nv))
