# SPDX-License-Identifier: BSD-2-Clause
"""Forces along lines: springs, dampers, cylinders and ropes between two frames."""

from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from math import inf

import numpy as np

from ..arrays import Array, Flags, read_only, single_array
from ..errors import InputError
from .dry_friction import sign_of

#: Numbers of a line; a YAML has the same keys.
NUMBERS_OF_LINE = (
    "stiffness",
    "rest_length",
    "damping",
    "preload",
    "mass",
    "coulomb_friction",
    "lower",
    "upper",
    "effort",
    "velocity",
)
#: Numbers of a line that may be infinite.
_LIMITS = ("upper", "effort", "velocity")


@dataclass(frozen=True)
class LineForce:
    """A force along the line between the origins of two frames: a spring, a damper, a cylinder.

    The tension is preload + stiffness (length - rest_length) + damping times the rate of the
    length + coulomb_friction times the sign of this rate + mass times the second derivative of the
    length, [N]. A positive tension pulls the two frames together; a gas spring, which pushes, has a
    negative preload.

    If the name of the line is in `actuated`, the line is also a motor: a cylinder. Its
    "torque" is a force, [N], in addition to the tension. A positive one pushes the frames apart;
    force times rate of the length is the motor's power.

    Attributes:
        frame_a: Name of a frame of the tree; "universe" is the world.
        frame_b: Name of another frame.
        stiffness: Zero or positive, [N/m].
        rest_length: Length at which the spring has no force, zero or positive, [m].
        damping: Zero or positive, [N s/m].
        preload: Tension at the rest length, [N].
        mass: Inertia of what moves with the length, such as a piston with its oil, or a winch: the
            inertia of its drum divided by the square of the radius; zero or positive, [kg].
        coulomb_friction: Dry friction, such as that of a cylinder's seals, zero or positive, [N].
            It sticks in `rollout(..., nonsmooth=True)`.
        lower: Shortest length, such as that of a cylinder at its stop, [m]. This and the next three
            are for `check_limits` and files; dynamics does not enforce them.
        upper: Longest length, [m].
        effort: Largest force of the motor, pushing or pulling, [N].
        velocity: Largest rate of the length, [m/s].
        name: "a-b" from the names of the frames by default.
        pulls_only: Whether it is an elastic cable, which is slack where spring, damper and preload
            together would push. The motor may push, except in `rollout(..., nonsmooth=True)`.

    Raises:
        InputError: For a number that is not finite or, except the preload, negative; for a name
            that is not a string; or for a line from a frame to itself.

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
    mass: float = 0.0
    coulomb_friction: float = 0.0
    lower: float = 0.0
    upper: float = inf
    effort: float = inf
    velocity: float = inf
    name: str = ""
    pulls_only: bool = False

    def __post_init__(self) -> None:
        for word in (self.frame_a, self.frame_b, self.name):
            if not isinstance(word, str):
                raise InputError("lines", f"{word!r} is not a name")
        if not self.name:
            object.__setattr__(self, "name", f"{self.frame_a}-{self.frame_b}")
        if self.frame_a == self.frame_b:
            raise InputError("lines", f"{self}: a line needs two different frames")
        if not isinstance(self.pulls_only, bool):
            raise InputError(f"pulls_only of line {self}", f"{self.pulls_only!r} is not a boolean")
        for attribute in NUMBERS_OF_LINE:
            name = f"{attribute} of line {self}"
            value = getattr(self, attribute)
            if attribute in _LIMITS and isinstance(value, float) and value == inf:
                continue
            number = float(single_array(name, value, ()))
            if number < 0 and attribute != "preload":
                raise InputError(name, f"{number:g} is negative")
            object.__setattr__(self, attribute, number)
        if self.lower > self.upper:
            text = f"{self.lower:g} is above the upper limit {self.upper:g}"
            raise InputError(f"lower of line {self}", text)
        if self.pulls_only and self.mass:
            problem = "a slack cable moves no mass; give the mass to a body, or the drum a joint"
            raise InputError(f"mass of line {self}", problem)
        if self.pulls_only and self.coulomb_friction:
            problem = "a slack cable has no friction; give it to the joint of a drum or a pulley"
            raise InputError(f"coulomb_friction of line {self}", problem)

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Lines:
    """The forces along lines of one robot."""

    forces: tuple[LineForce, ...]
    #: Motor torques tau push the ends of the lines apart with the forces actuation tau, shape
    #: (lines, motors); read-only.
    actuation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "actuation", read_only(self.actuation))

    @cached_property
    def none(self) -> bool:
        """Whether there is no line."""
        return not self.forces

    @cached_property
    def stiffness(self) -> Array:
        """Stiffnesses of the lines, shape (lines,), [N/m]."""
        return np.array([line.stiffness for line in self.forces])

    @cached_property
    def rest_lengths(self) -> Array:
        """Lengths of the lines without a force of their springs, shape (lines,), [m]."""
        return np.array([line.rest_length for line in self.forces])

    @cached_property
    def damping(self) -> Array:
        """Dampings of the lines, shape (lines,), [N s/m]."""
        return np.array([line.damping for line in self.forces])

    @cached_property
    def preload(self) -> Array:
        """Constant tensions of the lines, shape (lines,), [N]."""
        return np.array([line.preload for line in self.forces])

    @cached_property
    def masses(self) -> Array:
        """Masses that move with the lengths of the lines, shape (lines,), [kg]."""
        return np.array([line.mass for line in self.forces])

    @cached_property
    def pull_only(self) -> Flags:
        """Which lines only pull, shape (lines,)."""
        return np.array([line.pulls_only for line in self.forces], dtype=bool)

    @cached_property
    def coulomb(self) -> Array:
        """Dry friction of the lines, shape (lines,), [N]."""
        return np.array([line.coulomb_friction for line in self.forces])

    def tensions(
        self, lengths: Array, rates: Array, sign_width: float, tau: Array | None = None
    ) -> Array:
        """Tensions of the lines with motors, without inertia forces, shape (..., lines), [N].

        `sign_width` is that of `Friction`.
        """
        tensions = self._unlimited_tensions(lengths, rates)
        if self.pull_only.any():
            tensions = np.where(self.pull_only, np.maximum(tensions, 0.0), tensions)
        if self.coulomb.any():
            tensions = tensions + self.coulomb * sign_of(rates, sign_width)
        if tau is not None:
            tensions = tensions - self.actuation.dot(tau)
        return np.asarray(tensions)

    def taut(self, lengths: Array, rates: Array) -> Array:
        """0 for slack cables, 1 for all other lines, shape (..., lines).

        A cable is slack where its spring, damper and preload together would push.
        """
        is_slack = self.pull_only & (self._unlimited_tensions(lengths, rates) <= 0)
        return np.where(is_slack, 0.0, 1.0)

    def _unlimited_tensions(self, lengths: Array, rates: Array) -> Array:
        """Tensions of springs, dampers and preloads; a negative one makes a cable slack."""
        springs = self.stiffness * (lengths - self.rest_lengths)
        return np.asarray(self.preload + springs + self.damping * rates)

    def energy(self, lengths: Array) -> float:
        """Potential energy, zero where all lines have their rest length, [J]."""
        stiffness = self.stiffness
        preload = self.preload
        stretch = lengths - self.rest_lengths
        is_slack = self.pull_only & (preload + stiffness * stretch < 0)
        # The energy of a slack cable does not change: it is the energy at the stretch where the
        # tension begins, preload + stiffness stretch = 0. Without stiffness it is 0.
        begin = np.divide(-preload, stiffness, out=np.zeros_like(stretch), where=stiffness > 0)
        stretch[is_slack] = begin[is_slack]
        return float((preload + stiffness * stretch / 2).dot(stretch))
