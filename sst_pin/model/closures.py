# SPDX-License-Identifier: BSD-2-Clause
"""The closures of a tree: connected frames, rods, couplings of joints, rolling contacts, brakes.

Each class describes its closure constraints; `loops` computes f(q) and the rows of Phi.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from numbers import Real
from types import MappingProxyType
from typing import ClassVar, Union

import numpy as np

from ..errors import DescriptionError, InputError

#: The six motions of frame B relative to frame A, along and about x, y, z. A row of Phi that fixes
#: one of them has its name.
_MOTIONS = ("x", "y", "z", "turn x", "turn y", "turn z")


@dataclass(frozen=True)
class Closure:
    """Two frames of the tree that a massless joint connects.

    Attributes:
        frame_a: Name of the first frame.
        frame_b: Name of the second frame.
        kind: "6d": the frames coincide. "3d": their origins coincide. "orientation": their axes
            are parallel. The other kinds allow these motions of B relative to A, in the axes of A:
            "hinge": B turns about z; "universal": B turns about x of A and about y of B;
            "cylindrical": B slides along z and turns about z; "prismatic": B slides along z;
            "planar": B slides along x and y and turns about z. Or six booleans: whether x, y, z,
            turn x, turn y, turn z are fixed.

    Raises:
        DescriptionError: For an unknown kind.

    Example:
        `Closure("coupler_end", "rocker_end", "hinge")`.
    """

    frame_a: str
    frame_b: str
    kind: str | tuple[bool, ...] = "6d"

    KINDS: ClassVar[Mapping[str, tuple[bool, ...]]] = MappingProxyType(
        {
            "6d": (True,) * 6,
            "3d": (True,) * 3 + (False,) * 3,
            "orientation": (False,) * 3 + (True,) * 3,
            "hinge": (True, True, True, True, True, False),
            "universal": (True, True, True, False, False, True),
            "cylindrical": (True, True, False, True, True, False),
            "prismatic": (True, True, False, True, True, True),
            "planar": (False, False, True, True, True, False),
        }
    )

    def __post_init__(self) -> None:
        kind = self.kind
        problem = ""
        _require_two(self.frame_a, self.frame_b)
        if isinstance(kind, str):
            if kind not in self.KINDS:
                problem = f"kind {kind!r} unknown; known: {', '.join(self.KINDS)}"
        elif not isinstance(kind, tuple) or len(kind) != 6 or not any(kind):
            problem = f"kind {kind!r}: six booleans are needed, at least one of them true"
        if problem:
            raise DescriptionError(f"closure of {self.frame_a} and {self.frame_b}", [problem])

    @property
    def held(self) -> tuple[bool, ...]:
        """Whether x, y, z, turn x, turn y, turn z are fixed."""
        return self.KINDS[self.kind] if isinstance(self.kind, str) else tuple(map(bool, self.kind))

    @property
    def rows(self) -> list[str]:
        """Name of each row of Phi."""
        return [name for name, fixed in zip(_MOTIONS, self.held, strict=True) if fixed]

    def __str__(self) -> str:
        return f"{self.frame_a} - {self.frame_b}"


@dataclass(frozen=True)
class Distance:
    """Two points at a constant distance: a massless rod between two ball joints.

    Attributes:
        frame_a: Name of the frame whose origin is the first point.
        frame_b: Name of the frame whose origin is the second point.
        distance: Length of the rod, positive, [m].

    Example:
        >>> sst_pin.Distance("rod_a", "rod_b", 0.4).rows
        ['distance']
    """

    frame_a: str
    frame_b: str
    distance: float

    def __post_init__(self) -> None:
        _require_two(self.frame_a, self.frame_b)
        if not (_is_finite(self.distance) and self.distance > 0):
            problem = f"distance {self.distance}: a positive number is needed"
            raise DescriptionError(str(self), [problem])

    @property
    def rows(self) -> list[str]:
        """Name of the only row of Phi."""
        return ["distance"]

    def __str__(self) -> str:
        return f"{self.frame_a} - {self.frame_b}"


@dataclass(frozen=True)
class ExtendedDistance(Distance):
    """A rod whose length is `distance` plus the positions of joints.

    It serves to differentiate by the length of the rod: the derivative equals that by the position
    of such a joint. The joints always stay at zero. Only `enlarged_tree.with_extended_rods` makes
    such rods; kernels do not know them.

    Attributes:
        joints: Names of the joints, which slide.
    """

    joints: tuple[str, ...] = ()


@dataclass(frozen=True)
class Coupling:
    """A joint position as a sum of polynomials of other joint positions.

    Examples are gears, mimic joints, MuJoCo's `joint` equality, and fixed tendons.

    Attributes:
        joint: Name of the dependent joint, which must have one coordinate.
        polynomials: For each other joint, by name, the coefficients c_0, c_1, ... of its
            polynomial; {} fixes the joint at `offset`.
        offset: Constant that is added to the sum, [rad] or [m].

    Example:
        `Coupling("finger_2", {"finger_1": (0.1, -2)})`: q_2 = 0.1 - 2 q_1.
    """

    joint: str
    polynomials: Mapping[str, Sequence[float]] = field(default_factory=dict)
    offset: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.polynomials, Mapping):
            raise InputError("polynomials", f"{self.polynomials!r} is not a dict of coefficients")
        _require_words(self.joint, *self.polynomials)
        problems = [
            f"the polynomial of {name} is {p!r}: its coefficients (c_0, c_1, ...) are needed"
            for name, p in self.polynomials.items()
            if not _are_coefficients(p)
        ]
        if not _is_finite(self.offset):
            problems.append(f"offset {self.offset!r}: a finite number is needed")
        if self.joint in self.polynomials:
            problems.append(f"{self.joint} is coupled to itself")
        if problems:
            raise DescriptionError(str(self), problems)
        frozen = {name: tuple(map(float, p)) for name, p in self.polynomials.items()}
        object.__setattr__(self, "polynomials", frozen)

    def __hash__(self) -> int:
        return hash((self.joint, tuple(sorted(self.polynomials.items())), self.offset))

    @property
    def rows(self) -> list[str]:
        """Name of the only row of Phi."""
        return ["coupling"]

    def __str__(self) -> str:
        return f"{self.joint} after {', '.join(self.polynomials) or 'nothing'}"


@dataclass(frozen=True)
class Rolling:
    """A wheel or a ball that rolls on a plane without slip, see the paper's reference [4].

    The plane is the x-y plane of the frame `plane`; the wheel is a thin disc about z of the frame
    `wheel`. Only the row "height" constrains q. The two rows of slip constrain rates only
    (non-holonomic), so that any q fulfils them.

    Attributes:
        plane: Name of the frame with the plane; "universe" is the base.
        wheel: Name of the frame in the centre of the wheel, z along the axle.
        radius: Radius of the wheel, [m].
        ball: Whether it is a ball instead of a disc.

    Example:
        >>> sst_pin.Rolling("universe", "wheel", radius=0.1).rows
        ['slip x', 'slip y', 'height']
    """

    plane: str
    wheel: str
    radius: float
    ball: bool = False

    def __post_init__(self) -> None:
        _require_words(self.plane, self.wheel)
        if not (_is_finite(self.radius) and self.radius > 0):
            raise DescriptionError(str(self), [f"radius {self.radius}: positive is needed"])

    @property
    def rows(self) -> list[str]:
        """Name of each row of Phi."""
        return ["slip x", "slip y", "height"]

    def __str__(self) -> str:
        return f"{self.wheel} on {self.plane}"


@dataclass(frozen=True)
class Brake:
    """A joint or a line that is held where it is.

    Its row of Phi constrains the rate only. It holds at any position, so that it opens no loop.
    `ClosedChain(..., brakes=[...])` and `with_brakes` make brakes from names.

    Attributes:
        name: Name of a rate of a joint, or of a line.
        frames: The two frames of the line; None for a joint.

    Example:
        >>> sst_pin.Brake("crank").rows
        ['brake']
    """

    name: str
    frames: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        _require_words(self.name, *(self.frames or ()))

    @property
    def rows(self) -> list[str]:
        """Name of the only row of Phi."""
        return ["brake"]

    def __str__(self) -> str:
        return f"brake of {self.name}"


def _are_coefficients(polynomial: object) -> bool:
    listed = polynomial.tolist() if isinstance(polynomial, np.ndarray) else polynomial
    return isinstance(listed, Sequence) and len(listed) > 0 and all(map(_is_finite, listed))


def _is_finite(number: object) -> bool:
    return isinstance(number, Real) and isfinite(number)


def _require_two(frame_a: str, frame_b: str) -> None:
    _require_words(frame_a, frame_b)
    if frame_a == frame_b:
        raise DescriptionError(
            f"closure of {frame_a} and {frame_b}", ["a frame cannot close a loop with itself"]
        )


def _require_words(*words: str) -> None:
    for word in words:
        if not isinstance(word, str):
            raise InputError("closures", f"{word!r} is not a name of a frame or joint")


Constraint = Union[Closure, Distance, Coupling, Rolling, Brake]  # noqa: UP007  (Python 3.10 pickles it)


def frames_of(closure: Constraint) -> tuple[str, ...]:
    """Names of the frames that a closure connects; couplings and brakes of joints have none."""
    if isinstance(closure, Coupling):
        return ()
    if isinstance(closure, Brake):
        return closure.frames or ()
    if isinstance(closure, Rolling):
        return closure.plane, closure.wheel
    return closure.frame_a, closure.frame_b


def holds_points(closure: Constraint) -> bool:
    """Whether the closure fixes the distance between the origins of its frames."""
    return isinstance(closure, Distance) or (isinstance(closure, Closure) and all(closure.held[:3]))
