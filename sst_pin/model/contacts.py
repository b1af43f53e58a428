# SPDX-License-Identifier: BSD-2-Clause
"""Contacts of points and spheres with planes, and ropes: what acts only from one side."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import pinocchio as pin

from ..arrays import in_order, single_array
from ..errors import InputError
from ..summaries import listed
from .tree import frame_named


@dataclass(frozen=True)
class Contact:
    """A point or sphere of a body that can touch a plane.

    The plane is z = 0 of the frame `ground`, of the world or of another body; the free side is
    z > 0. Coulomb friction acts in the plane. Contacts act in `rollout(..., nonsmooth=True)`.

    Attributes:
        frame: Name of the frame at the point, or at the centre of the sphere.
        radius: Radius of the sphere, zero for a point, [m].
        friction: Coefficient of friction, zero or positive.
        restitution: Part of the normal velocity that an impact gives back, from 0 to 1.
        ground: Name of the frame of the plane; "universe" is the world.
        name: By default the name of `frame`, with "on GROUND" for another ground than the world.

    Raises:
        InputError: For a number outside its range, or a name that is not a string.

    Example:
        >>> sst_pin.Contact("sole_1", friction=0.8).name
        'sole_1'
    """

    frame: str
    _: KW_ONLY
    radius: float = 0.0
    friction: float = 0.0
    restitution: float = 0.0
    ground: str = "universe"
    name: str = ""

    def __post_init__(self) -> None:
        _require_names(self.frame, self.ground, self.name)
        if not self.name:
            on = "" if self.ground == "universe" else f" on {self.ground}"
            object.__setattr__(self, "name", f"{self.frame}{on}")
        if self.frame == self.ground:
            raise InputError("contacts", f"{self}: a contact needs two different frames")
        for name in ("radius", "friction", "restitution"):
            number = _positive(f"{name} of {self}", getattr(self, name))
            object.__setattr__(self, name, number)
        if self.restitution > 1:
            raise InputError(f"restitution of {self}", f"{self.restitution:g} is larger than 1")

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Rope:
    """A rope between the origins of two frames: it does not stretch, and it does not push.

    Ropes act in `rollout(..., nonsmooth=True)`. An elastic cable is a `LineForce` with
    `pulls_only=True`.

    Attributes:
        frame_a: Name of a frame of the tree; "universe" is the world.
        frame_b: Name of another frame.
        length: Largest distance of the two origins, positive, [m].
        name: "a-b" from the names of the frames by default.

    Raises:
        InputError: For a length that is not positive, or a name that is not a string.

    Example:
        >>> sst_pin.Rope("ceiling", "lamp", 1.2).name
        'ceiling-lamp'
    """

    frame_a: str
    frame_b: str
    length: float
    _: KW_ONLY
    name: str = ""

    def __post_init__(self) -> None:
        _require_names(self.frame_a, self.frame_b, self.name)
        if not self.name:
            object.__setattr__(self, "name", f"{self.frame_a}-{self.frame_b}")
        if self.frame_a == self.frame_b:
            raise InputError("contacts", f"{self}: a rope needs two different frames")
        length = _positive(f"length of {self}", self.length)
        if not length:
            raise InputError(f"length of {self}", "zero; a positive length is needed")
        object.__setattr__(self, "length", length)

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Contacts:
    """The contacts and ropes of one robot, each in their order."""

    points: tuple[Contact, ...] = ()
    ropes: tuple[Rope, ...] = ()

    @cached_property
    def none(self) -> bool:
        """Whether there are neither contacts nor ropes."""
        return not (self.points or self.ropes)

    def require_none(self, method: str) -> None:
        """Refuse contacts and ropes, which only the nonsmooth form of a method knows."""
        if not self.none:
            names = listed([str(element) for element in self.points + self.ropes])
            raise InputError(
                "contacts", f"{names} act in {method}(..., nonsmooth=True) only; call it"
            )

    def check(self, model: pin.Model) -> None:
        """Refuse frames that the tree does not have, and contacts within one body."""
        for rope in self.ropes:
            frame_named(model, rope.frame_a)  # raises an error for an unknown frame
            frame_named(model, rope.frame_b)
        for contact in self.points:
            frame = frame_named(model, contact.frame)
            ground = frame_named(model, contact.ground)
            if frame.parentJoint == ground.parentJoint:
                problem = f"{contact}: {contact.frame} and {contact.ground} are on the same body"
                raise InputError("contacts", problem)


def contacts_of(contacts: Sequence[Contact | Rope]) -> Contacts:
    """The contacts and ropes of a list; raises an error if two have the same name."""
    elements = in_order("contacts", contacts, "Contact or Rope")
    for element in elements:
        if not isinstance(element, (Contact, Rope)):
            raise InputError("contacts", f"{element!r} is neither a Contact nor a Rope")
    twice = [name for name, k in Counter(map(str, elements)).items() if k > 1]
    if twice:
        problem = f"several contacts have the name {', '.join(twice)}; give name="
        raise InputError("contacts", problem)
    points = tuple(x for x in elements if isinstance(x, Contact))
    ropes = tuple(x for x in elements if isinstance(x, Rope))
    return Contacts(points, ropes)


def _require_names(*words: object) -> None:
    for word in words:
        if not isinstance(word, str):
            raise InputError("contacts", f"{word!r} is not a name")


def _positive(name: str, value: float) -> float:
    number = float(single_array(name, value, ()))
    if number < 0:
        raise InputError(name, f"{number:g} is negative")
    return number
