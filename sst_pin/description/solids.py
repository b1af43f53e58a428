# SPDX-License-Identifier: BSD-2-Clause
"""Plain solids and their surfaces.

Meshes and collision geometry both come from these solids, so they agree. A surface connects the
loops of its solid: the outlines of cross-sections along the solid. Loops have the shape (loops,
points, 3), [m]. They are convex polygons, each counterclockwise when seen from the last one.

`trimesh.creation` has no bevels, leaves out triangles below 1e-8 m^2, so that robots of a
millimetre would have holes, and needs two more packages for the ends of an arc.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices

#: Largest distance between a circle and its chords, [m].
_CHORD = 2e-4
#: Largest angle of an arc between two of its cross-sections.
_STEP = np.radians(4.5)
#: Width of the bevel on an edge, as a share of the smallest size of the solid.
_BEVEL = 0.12
#: Angle of one straight piece of an arc's collision geometry. A piece is up to 1.3 mm larger than
#: an arc with the paper's radius.
_PIECE = np.radians(9)


class Box(NamedTuple):
    """A box by its centre, the directions of its edges as columns, and their lengths [m]."""

    center: Array
    axes: Array
    size: Array

    def loops(self) -> Array:
        """Four rectangles, bevelled."""
        length, width, depth = self.size
        bevel = _BEVEL * self.size.min()
        heights = np.array((-length / 2, bevel - length / 2, length / 2 - bevel, length / 2))
        wide = _rectangle(width, depth, bevel)
        narrow = _rectangle(width - 2 * bevel, depth - 2 * bevel, bevel)
        loops = _loops_along(heights, [narrow, wide, wide, narrow], axes=self.axes)
        return self.center + loops


class Cylinder(NamedTuple):
    """A round solid between two points; a cone when its radii at the ends differ, [m]."""

    start: Array
    end: Array
    radius: float
    end_radius: float

    def loops(self) -> Array:
        """Four circles, bevelled."""
        axis = self.end - self.start
        r_0 = self.radius
        r_1 = self.end_radius
        length = float(np.linalg.norm(axis))
        x, y, z = axes_along(axis).T
        bevel = _BEVEL * min(r_0, r_1, length)
        heights = np.array((0, bevel, length - bevel, length))
        radii = np.array((r_0 - bevel, r_0, r_1, r_1 - bevel))
        circle = _circle(radii.max()) / radii.max()
        circles = [r * circle for r in radii]
        return self.start + _loops_along(heights, circles, axes=np.stack([z, x, y], axis=-1))


class Ball(NamedTuple):
    """A sphere, by its centre of shape (3,) and its radius [m]."""

    center: Array
    radius: float

    def loops(self) -> Array:
        """Circles of latitude."""
        circle = _circle(self.radius)
        # Just short of the poles, so that no circle is a point.
        latitudes = np.linspace(-1.5, 1.5, len(circle) // 2 + 1)
        circles = [np.cos(latitude) * circle for latitude in latitudes]
        heights = self.radius * np.sin(latitudes)
        return self.center + _loops_along(heights, circles, axes=np.eye(3))


class Arc(NamedTuple):
    """A bar bent about O, from the first column of its axes towards the second."""

    axes: Array
    radius: float  #: Of its middle line, [m].
    angle: float  #: From one end to the other, [rad].
    section: tuple[float, float]  #: Its radial and axial size, [m]; a circle's are equal.
    round: bool = False

    def loops(self) -> Array:
        """Its sections, from one end to the other."""
        depth, width = self.section
        if self.round:
            section = _circle(depth / 2)
        else:
            section = _rectangle(depth, width, _BEVEL * min(self.section))
        angles = np.linspace(0, self.angle, _parts(self.angle, _STEP) + 1)
        # Cylindrical coordinates of the points of each section, in the axes of the arc.
        r = self.radius + section[:, 0]
        x = np.outer(np.cos(angles), r)
        y = np.outer(np.sin(angles), r)
        z = np.broadcast_to(section[:, 1], x.shape)
        loops = np.stack([x, y, z], axis=-1)
        # Counterclockwise in (r, z) is clockwise when seen from where the arc goes: reversed.
        return loops[:, ::-1] @ self.axes.T

    def pieces(self) -> Iterator[Primitive]:
        """Straight bars that enclose it."""
        count = _parts(self.angle, _PIECE)
        half = self.angle / count / 2
        depth, width = self.section
        inner = (self.radius - depth / 2) * np.cos(half)
        outer = self.radius + depth / 2
        middle = (inner + outer) / 2
        length = 2 * outer * np.tan(half)
        x, y, z = self.axes.T
        # Angles of the middles of the bars.
        for angle in half * (2 * np.arange(count) + 1):
            c = np.cos(angle)
            s = np.sin(angle)
            radial = c * x + s * y
            along = c * y - s * x
            if self.round:
                center = middle * radial
                half_bar = length / 2 * along
                yield rod(center - half_bar, center + half_bar, (outer - inner) / 2)
            else:
                axes = np.stack([radial, along, z], axis=-1)
                yield Box(middle * radial, axes, np.array((outer - inner, length, width)))


Primitive = Box | Cylinder | Ball
Solid = Primitive | Arc


def rod(start: Array, end: Array, radius: float) -> Cylinder:
    """A cylinder of one radius."""
    return Cylinder(start, end, radius, radius)


def bar(start: Array, end: Array, across: Array, width: float, thick: float) -> Box:
    """A box along a line, with its width along the direction `across`."""
    along = (end - start) / np.linalg.norm(end - start)
    axes = np.stack([along, across, np.cross(along, across)], axis=-1)
    return Box((start + end) / 2, axes, np.array((np.linalg.norm(end - start), width, thick)))


def lofted(loops: Array) -> tuple[Array, Indices]:
    """Vertices, shape (n, 3), and faces, shape (m, 3), of a closed surface through loops.

    Between two loops there are two triangles for each point. A fan of triangles about its middle
    closes each end; these faces come last.
    """
    count, points, _ = loops.shape
    middles = loops[[0, -1]].mean(axis=1)
    # Indices of the points of the loops, of their neighbours on the loop, and of both middles.
    here = np.arange(count * points).reshape(count, points)
    beside = np.roll(here, -1, axis=1)
    first_middle = np.full(points, count * points)
    last_middle = np.full(points, count * points + 1)
    corners_of_faces = [
        (here[:-1], beside[:-1], beside[1:]),
        (here[:-1], beside[1:], here[1:]),
        (first_middle, beside[0], here[0]),
        (last_middle, here[-1], beside[-1]),
    ]
    faces = []
    for corners in corners_of_faces:
        faces.append(np.stack([corner.ravel() for corner in corners], axis=-1))
    return np.concatenate([loops.reshape(-1, 3), middles]), np.concatenate(faces)


def axes_along(direction: Array) -> Array:
    """Right-handed axes whose z has a direction, columns of a (3, 3) array."""
    z = direction / np.linalg.norm(direction)
    # Rounding: the last bit must not choose between equal entries.
    x = np.cross(np.eye(3)[np.argmin(np.abs(z).round(6))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _parts(angle: float, largest: float) -> int:
    """The least number of equal parts of an angle that are not larger than the largest."""
    # A quotient that is a whole number but for rounding needs no part more.
    return int(np.ceil(angle / largest - 1e-9))


def _loops_along(heights: Array, sections: Sequence[Array], axes: Array) -> Array:
    """Loops by their heights along the first axis and their sections in the other two.

    A section has the shape (points, 2). The axes are the columns of a (3, 3) array.
    """
    loops = []
    for height, section in zip(heights, sections, strict=True):
        loops.append(np.insert(section, 0, height, axis=1))
    return np.stack(loops) @ axes.T


def _circle(radius: float) -> Array:
    """Points of a circle, counterclockwise, shape (points, 2).

    Their number is a multiple of four, so that the circle has its full size along both axes.
    """
    cosine = max(1 - _CHORD / radius, 0.9)  # eight points at least
    quarter = np.ceil(np.pi / 4 / np.arccos(cosine))
    angles = np.pi / 2 / quarter * np.arange(4 * quarter)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _rectangle(width: float, depth: float, bevel: float) -> Array:
    """Points of a rectangle, counterclockwise, the corners cut off, shape (8, 2)."""
    a = width / 2
    b = depth / 2
    half = np.array(((a, bevel - b), (a, b - bevel), (a - bevel, b), (bevel - a, b)))
    return np.concatenate([half, -half])
