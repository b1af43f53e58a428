# SPDX-License-Identifier: BSD-2-Clause
"""Plain solids, and the primitives that enclose them.

Meshes and collision primitives are both made of these, so one cannot drift from the other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays import Array


@dataclass(frozen=True)
class Box:
    """A box.

    Attributes:
        center: Shape (3,), [m].
        axes: Directions of its edges, columns of a (3, 3) array.
        size: Lengths of its edges, shape (3,), [m].
    """

    center: Array
    axes: Array
    size: Array


@dataclass(frozen=True)
class Cylinder:
    """A round solid between two points; a cone when its radii differ.

    Attributes:
        start: Shape (3,), [m].
        end: Shape (3,), [m].
        radius: At the start, [m].
        end_radius: At the end, [m].
    """

    start: Array
    end: Array
    radius: float
    end_radius: float


@dataclass(frozen=True)
class Ball:
    """A sphere, by its centre of shape (3,) and its radius [m]."""

    center: Array
    radius: float


@dataclass(frozen=True)
class Arc:
    """A bar bent about O.

    Attributes:
        axes: The bar runs from the first column of this (3, 3) array towards the second.
        radius: Radius of its middle line, [m].
        angle: From one end to the other, [rad].
        section: Radial and axial size of its section, [m].
        round: Whether the section is a circle instead of a rectangle, its sizes then equal.
    """

    axes: Array
    radius: float
    angle: float
    section: tuple[float, float]
    round: bool = False


Solid = Box | Cylinder | Ball | Arc

#: Angle of one straight piece of an arc's collision geometry; it stands off by 1.3 mm at most.
_PIECE = np.radians(9)


def rod(start: Array, end: Array, radius: float) -> Cylinder:
    """A cylinder of one radius."""
    return Cylinder(start, end, radius, radius)


def bar(start: Array, end: Array, across: Array, width: float, thick: float) -> Box:
    """A box along a line."""
    along = (end - start) / np.linalg.norm(end - start)
    axes = np.stack([along, across, np.cross(along, across)], axis=-1)
    return Box((start + end) / 2, axes, np.array((np.linalg.norm(end - start), width, thick)))


def primitives(solid: Solid) -> Iterator[Box | Cylinder | Ball]:
    """Boxes, cylinders and spheres that enclose a solid."""
    if isinstance(solid, Cylinder):
        radius = max(solid.radius, solid.end_radius)
        yield Cylinder(solid.start, solid.end, radius, radius)
    elif isinstance(solid, Arc):
        yield from _pieces(solid)
    else:
        yield solid


def axes_along(direction: Array) -> Array:
    """Right-handed axes whose z has a direction, columns of a (3, 3) array."""
    z = direction / np.linalg.norm(direction)
    # Rounded, the last bit does not choose between equal entries.
    x = np.cross(np.eye(3)[np.argmin(np.abs(z).round(6))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _pieces(arc: Arc) -> Iterator[Box | Cylinder]:
    count = int(np.ceil(arc.angle / _PIECE - 1e-9))
    half = arc.angle / count / 2
    depth, width = arc.section
    inner, outer = (arc.radius - depth / 2) * np.cos(half), arc.radius + depth / 2
    middle, length = (inner + outer) / 2, 2 * outer * np.tan(half)
    x, y, z = arc.axes.T
    for angle in half * (2 * np.arange(count) + 1):
        radial, along = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
        if arc.round:
            center, reach = middle * radial, length / 2 * along
            yield rod(center - reach, center + reach, (outer - inner) / 2)
        else:
            axes = np.stack([radial, along, z], axis=-1)
            yield Box(middle * radial, axes, np.array((outer - inner, length, width)))
