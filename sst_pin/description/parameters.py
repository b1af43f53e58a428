# SPDX-License-Identifier: BSD-2-Clause
"""`Parameters`: geometry, masses and friction of an SST; the defaults are the robot of the paper.

`RigidBody` has the mass properties of one of its bodies. Both check their values.

The frames are from Sect. 4: {0k} fixed, {1k} on the actuator link, {2k} on the passive link of
leg k, {E} on the star, all with their origin in the centre O of the sphere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, as_array
from ..errors import InputError, ParametersError
from ..summaries import Summary

#: Relative tolerance of the sum of the arc angles, of symmetry, and of triangle inequalities.
_SLACK = 1e-9
#: Radii for which meshes can be written, [m].
_SMALLEST_RADIUS = 1e-6
_LARGEST_RADIUS = 1e6
#: Three unit directions count as lying in one plane if their triple product is smaller. Directions
#: in a plane that are written with six digits have a triple product of this size.
_SMALLEST_TRIPLE = 1e-6
#: Rows and columns of the entries xx, yy, zz, xy, xz, yz of an inertia.
ENTRIES = ((0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2))


def _frozen(value: ArrayLike, name: str) -> Array:
    """A read-only copy as float64; a ParametersError if it is not an array of numbers."""
    try:
        array = np.array(as_array(name, value, ()))
    except InputError as error:
        raise ParametersError([str(error)]) from None
    array += 0.0  # a negative zero would be written as -0.0
    array.setflags(write=False)
    return array


def _number(value: float, name: str) -> float:
    """A number; an array is refused."""
    array = _frozen(value, name)
    if array.shape:
        raise ParametersError([f"{name}: {value!r} is not a number"])
    return float(array)


class _Values(Summary):
    """Base class: equality, hash and text of a dataclass whose fields may be arrays."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and self._values() == other._values()

    def __hash__(self) -> int:
        return hash(self._values())

    def _values(self) -> tuple[Any, ...]:
        """The fields, with arrays as their shapes and bytes."""
        values = []
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value = (value.shape, value.tobytes())
            values.append(value)
        return tuple(values)


def _shape_problems(name: str, array: Array, shape: tuple[int, ...]) -> list[str]:
    """Why an array does not have finite numbers in this shape."""
    if array.shape != shape:
        return [f"{name}: shape {array.shape}, expected {shape}"]
    if not np.isfinite(array).all():
        return [f"{name}: not finite"]
    return []


@dataclass(frozen=True, eq=False, init=False, repr=False)
class RigidBody(_Values):
    """Mass properties of one body, in a frame fixed to it.

    Attributes:
        mass: Mass, [kg].
        center_of_mass: In the body's frame, shape (3,), [m].
        inertia: About the mass centre, in the axes of the body's frame, shape (3, 3), [kg m^2].

    Example:
        >>> sst_pin.sst.RigidBody(2.0, (0.1, 0, 0), np.diag([0.01, 0.02, 0.02])).mass
        2.0
    """

    mass: float
    center_of_mass: Array
    inertia: Array

    def __init__(self, mass: float, center_of_mass: ArrayLike, inertia: ArrayLike) -> None:
        values = vars(self)  # a frozen dataclass is set by its `__dict__`
        values["mass"] = _number(mass, "mass")
        values["center_of_mass"] = _frozen(center_of_mass, "center_of_mass")
        values["inertia"] = _frozen(inertia, "inertia")

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        inertia = ", ".join(_numbers(row) for row in self.inertia)
        return "RigidBody", [
            ("mass", f"{self.mass:g} kg"),
            ("center_of_mass", f"{_numbers(self.center_of_mass)} m"),
            ("inertia", f"[{inertia}] kg m^2"),
        ]

    def with_point_mass(self, mass: float, at: ArrayLike = (0, 0, 0)) -> RigidBody:
        """The body with a point mass fixed to it.

        Args:
            mass: Mass, zero or more, [kg].
            at: Its position in the body's frame, shape (3,), [m].

        Raises:
            ParametersError: For a negative mass, or numbers that are not finite.
        """
        point_mass = _number(mass, "mass")
        position = _frozen(at, "at")
        problems = _shape_problems("at", position, (3,))
        if not (np.isfinite(point_mass) and point_mass >= 0):
            problems.append(f"mass: {point_mass:g} kg is negative or not finite")
        if problems:
            raise ParametersError(problems)
        total = self.mass + point_mass
        center = (self.mass * self.center_of_mass + point_mass * position) / total
        # Steiner's theorem for both masses, at their distances from the common mass centre. With
        # the vector d between them, the sum is the term of the reduced mass m_1 m_2 / (m_1 + m_2)
        # at the distance d.
        d = position - self.center_of_mass
        steiner = self.mass * point_mass / total * (d @ d * np.eye(3) - np.outer(d, d))
        return RigidBody(total, center, self.inertia + steiner)

    def problems(self, name: str) -> list[str]:
        """Why no body has these properties, one text for each problem; `name` begins each text."""
        problems = _shape_problems(f"{name}.center_of_mass", self.center_of_mass, (3,))
        if not (np.isfinite(self.mass) and self.mass > 0):
            problems.append(f"{name}.mass: {self.mass:g} kg is not positive")
        shape_problems = _shape_problems(f"{name}.inertia", self.inertia, (3, 3))
        if shape_problems:
            return problems + shape_problems
        return [*problems, *_inertia_problems(f"{name}.inertia", self.inertia)]


def _inertia_problems(name: str, inertia: Array) -> Iterator[str]:
    """Why no body has this inertia, shape (3, 3)."""
    size = np.abs(inertia).max()
    if np.abs(inertia - inertia.T).max() > _SLACK * size:
        yield f"{name}: not symmetric"
        return
    a, b, c = np.linalg.eigvalsh(inertia)
    moments = f"{a:.6g}, {b:.6g}, {c:.6g} kg m^2"
    if a <= 0:
        yield f"{name}: principal moments {moments} are not all positive"
    elif a + b < c * (1 - _SLACK):
        cure = "the sum of the two smaller ones must be at least the largest"
        yield f"{name}: principal moments {moments} violate the triangle inequality ({cure})"


#: Sect. 7.1 (d), mass centre by Eqs. (45)-(47).
PAPER_LINK = RigidBody(
    0.3, (0.175, 0, 0), ((0.0001, 0, -0.0001), (0, 0.008, 0), (-0.0001, 0, 0.008))
)
#: Sect. 7.1 (e), mass centre by Eqs. (48)-(50).
PAPER_PASSIVE_LINK = RigidBody(0.06, (0.35, 0, 0), np.diag((0.00001, 0.005, 0.005)))
#: Sect. 7.1 (c), mass centre by Eq. (54).
PAPER_STAR = RigidBody(2.6, (0.8 / np.pi, 0, 0), np.diag((0.224, 0.224, 0.150)))


#: Shapes of the parameters that are arrays.
_SHAPES = {
    "base_directions": (3, 3),
    "arc_angles": (3,),
    "viscous_friction": (9,),
    "coulomb_friction": (9,),
    "gravity": (3,),
}


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Parameters(_Values):
    """An SST: base triangle, arcs of the star, bodies, friction and gravity.

    Attributes:
        base_directions: v_k, unit vectors along OP_k, rows of a (3, 3) array. Arguments of other
            lengths are normalised.
        arc_angles: alpha_k, from arc k-1 to arc k of the star (alpha_1: from arc 3), shape (3,),
            [rad]; the sum is 2 pi.
        link: Actuator link, in {1k}: one body for all legs, or one for each.
        passive_link: Intermediate passive link, in {2k}: one body for all legs, or one for each.
        star: The moving star, in {E}.
        viscous_friction: D of each joint in the order gamma_1, mu_1, beta_1, gamma_2, ..., shape
            (9,), [N m s/rad]; a scalar is used for all nine.
        coulomb_friction: F_c of each joint, shape (9,), [N m]; a scalar is used for all nine.
        gravity: Acceleration of gravity in base axes, shape (3,), [m/s^2].
        base_radius: Radius of the base sphere, [m]; for drawings only, it does not change masses.
        star_radius: Radius of the star's arcs, [m]; for drawings only, it does not change masses.

    Raises:
        ParametersError: If the parameters are impossible; the message lists all problems.

    Example:
        >>> parameters = sst_pin.Parameters(arc_angles=np.radians([110, 120, 130]))
        >>> sst_pin.SST(parameters).motor_names
        ('gamma_1', 'gamma_2', 'gamma_3')
    """

    base_directions: Array
    arc_angles: Array
    link: RigidBody | tuple[RigidBody, ...]
    passive_link: RigidBody | tuple[RigidBody, ...]
    star: RigidBody
    viscous_friction: Array
    coulomb_friction: Array
    gravity: Array
    base_radius: float
    star_radius: float

    def __init__(
        self,
        *,
        base_directions: ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        arc_angles: ArrayLike = (2 * np.pi / 3,) * 3,
        link: RigidBody | Sequence[RigidBody] = PAPER_LINK,
        passive_link: RigidBody | Sequence[RigidBody] = PAPER_PASSIVE_LINK,
        star: RigidBody = PAPER_STAR,
        viscous_friction: ArrayLike = 0.0,
        coulomb_friction: ArrayLike = 0.0,
        gravity: ArrayLike = (0, 0, -9.81),
        base_radius: float = 0.35,
        star_radius: float = 0.40,
    ) -> None:
        values = vars(self)  # a frozen dataclass is set by its `__dict__`
        values["base_directions"] = _frozen(base_directions, "base_directions")
        values["arc_angles"] = _frozen(arc_angles, "arc_angles")
        values["link"] = tuple(link) if isinstance(link, Iterable) else link
        values["passive_link"] = (
            tuple(passive_link) if isinstance(passive_link, Iterable) else passive_link
        )
        values["star"] = star
        values["viscous_friction"] = _of_all_joints(viscous_friction, "viscous_friction")
        values["coulomb_friction"] = _of_all_joints(coulomb_friction, "coulomb_friction")
        values["gravity"] = _frozen(gravity, "gravity")
        values["base_radius"] = _number(base_radius, "base_radius")
        values["star_radius"] = _number(star_radius, "star_radius")
        problems = list(self._problems())
        if problems:
            raise ParametersError(problems)
        v = self.base_directions
        unit_vectors = v / np.linalg.norm(v, axis=1, keepdims=True)
        values["base_directions"] = _frozen(unit_vectors, "base_directions")

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        angles = _numbers(np.degrees(self.arc_angles))
        directions = ", ".join(_numbers(v) for v in self.base_directions)
        links = _masses(self.links)
        passive = _masses(self.passive_links)
        star = _masses([self.star])
        viscous = _range(self.viscous_friction)
        coulomb = _range(self.coulomb_friction)
        return "Parameters of an SST", [
            ("base", f"radius {self.base_radius:g} m, directions {directions}"),
            ("star", f"radius {self.star_radius:g} m, arc angles {angles} deg"),
            ("masses", f"actuator links {links}, passive links {passive}, star {star}"),
            ("friction", f"viscous {viscous} N m s/rad, Coulomb {coulomb} N m"),
            ("gravity", f"{_numbers(self.gravity)} m/s^2"),
        ]

    def with_payload(self, mass: float, at: ArrayLike = (0, 0, 0)) -> Parameters:
        """The robot with a point mass fixed to the star, as a part of it.

        Args:
            mass: Mass of the payload, [kg].
            at: Position of its mass centre in {E}, shape (3,), [m]. The origin of {E} is the centre
                O of the sphere; the point E is at `(star_radius, 0, 0)`.

        Raises:
            ParametersError: For a negative mass, or numbers that are not finite.

        Example:
            >>> p = sst_pin.Parameters()
            >>> p.with_payload(0.5, at=(p.star_radius, 0, 0)).star.mass
            3.1
        """
        return replace(self, star=self.star.with_point_mass(mass, at))

    @property
    def links(self) -> tuple[RigidBody, ...]:
        """The actuator links of legs 1 to 3."""
        return self.link if isinstance(self.link, tuple) else (self.link,) * 3

    @property
    def passive_links(self) -> tuple[RigidBody, ...]:
        """The passive links of legs 1 to 3."""
        links = self.passive_link
        return links if isinstance(links, tuple) else (links,) * 3

    @property
    def actuated_axes(self) -> Array:
        """e_k = v_k x v_{k+1}, normalised, rows of a (3, 3) array (Sect. 2)."""
        e = np.cross(self.base_directions, np.roll(self.base_directions, -1, axis=0))
        return np.asarray(e / np.linalg.norm(e, axis=1, keepdims=True))

    def _problems(self) -> Iterator[str]:
        """Why no SST has these parameters."""
        well_shaped = set[str]()
        for name, shape in _SHAPES.items():
            problems = _shape_problems(name, getattr(self, name), shape)
            yield from problems
            if not problems:
                well_shaped.add(name)
        if "base_directions" in well_shaped:
            v = self.base_directions
            lengths = np.linalg.norm(v, axis=1, keepdims=True)
            if not lengths.all():
                yield f"base_directions: v_{int(np.argmin(lengths)) + 1} is zero"
            elif abs(np.linalg.det(v / lengths)) < _SMALLEST_TRIPLE:
                yield "base_directions: v_1, v_2, v_3 lie in one plane"
        if "arc_angles" in well_shaped:
            yield from _angle_problems(self.arc_angles)
        for name in ("viscous_friction", "coulomb_friction"):
            value = getattr(self, name)
            if name in well_shaped and (value < 0).any():
                yield f"{name}: negative for joint number {int(np.argmin(value)) + 1} of 9"
        yield from self._body_problems()
        for name in ("base_radius", "star_radius"):
            radius = getattr(self, name)
            if not (np.isfinite(radius) and radius > 0):
                yield f"{name}: {radius} m is not positive"
            elif not _SMALLEST_RADIUS <= radius <= _LARGEST_RADIUS:
                limits = f"{_SMALLEST_RADIUS:g} to {_LARGEST_RADIUS:g} m"
                yield f"{name}: {radius:g} m is outside {limits}"

    def _body_problems(self) -> Iterator[str]:
        """Why these bodies are impossible."""
        bodies = dict[str, object]()
        for name in ("link", "passive_link"):
            value = getattr(self, name)
            if isinstance(value, tuple):
                if len(value) != 3:
                    yield f"{name}: {len(value)} bodies, expected one or three"
                for k, body in enumerate(value):
                    bodies[f"{name}[{k}]"] = body
            else:
                bodies[name] = value
        bodies["star"] = self.star
        for name, body in bodies.items():
            if isinstance(body, RigidBody):
                yield from body.problems(name)
            else:
                yield f"{name}: a RigidBody is needed, not {type(body).__name__}"


def _of_all_joints(value: ArrayLike, name: str) -> Array:
    """Numbers of the nine joints, shape (9,); a scalar is used for all nine."""
    array = _frozen(value, name)
    if array.ndim == 0:
        return _frozen(np.full(9, array), name)
    return array


def _masses(bodies: Iterable[RigidBody]) -> str:
    """The masses of bodies as text; equal masses are written once."""
    masses = dict.fromkeys(f"{body.mass:g}" for body in bodies)
    return f"{', '.join(masses)} kg"


def _numbers(values: Array) -> str:
    """Numbers as text, with four digits, in brackets."""
    return f"({', '.join(f'{value:.4g}' for value in values)})"


def _range(values: Array) -> str:
    """The smallest and the largest number as text; one number if all are the same."""
    low = values.min()
    high = values.max()
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _angle_problems(alpha: Array) -> Iterator[str]:
    """Why no star has these angles between its arcs."""
    if not ((alpha > 0) & (alpha < 2 * np.pi)).all():
        yield f"arc_angles: {alpha} rad, each must lie in (0, 2 pi)"
    total = float(alpha.sum())
    if abs(total - 2 * np.pi) > _SLACK:
        text = "the star does not close (are these degrees?)"
        yield f"arc_angles: they add up to {total:.12g} rad, not to 2 pi: {text}"
