# SPDX-License-Identifier: BSD-2-Clause
"""Plain solids and their surfaces.

Meshes and collision geometry both come from these solids, so they agree. The surface of a solid
(`lofted`) goes through its *loops*, which are the outlines of cross-sections from one end of the
solid to the other. Loops have the shape (loops, points, 3), [m]. Each loop is a convex polygon with
the same number of points. These are counterclockwise for a viewer who looks from beyond the last
loop back to the first one.

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
#: Largest angle of an arc between two of its cross-sections, [rad].
_STEP = np.radians(4.5)
#: Width of the bevel on an edge, as a share of the smallest size of the solid.
_BEVEL = 0.12
#: Largest angle of one straight piece of an arc's collision geometry, [rad]. A piece is up to 1.3
#: mm larger than an arc with the paper's radius.
_PIECE = np.radians(9)


class Box(NamedTuple):
    """A box."""

    center: Array  #: Shape (3,), [m].
    axes: Array  #: Directions of the edges, columns of a (3, 3) array.
    size: Array  #: Lengths of the edges, shape (3,), [m].

    def loops(self) -> Array:
        """Four rectangles along the first axis; the first and the last are smaller by the bevel."""
        length, width, depth = self.size
        bevel = _BEVEL * self.size.min()
        heights = np.array((-length / 2, bevel - length / 2, length / 2 - bevel, length / 2))
        wide = _rectangle(width, depth, bevel)
        narrow = _rectangle(width - 2 * bevel, depth - 2 * bevel, bevel)
        loops = _loops_along(heights, [narrow, wide, wide, narrow], axes=self.axes)
        return self.center + loops


class Cylinder(NamedTuple):
    """A round solid between two points; a cone if its radii at the ends differ."""

    start: Array  #: Shape (3,), [m].
    end: Array  #: Shape (3,), [m].
    radius: float  #: At the start, [m].
    end_radius: float  #: At the end, [m].

    def loops(self) -> Array:
        """Four circles along the axis; the first and the last are smaller by the bevel."""
        axis = self.end - self.start
        r_0 = self.radius
        r_1 = self.end_radius
        length = float(np.linalg.norm(axis))
        x, y, z = axes_along(axis).T  # z is along the axis
        bevel = _BEVEL * min(r_0, r_1, length)
        heights = np.array((0, bevel, length - bevel, length))
        radii = np.array((r_0 - bevel, r_0, r_1, r_1 - bevel))
        # All loops need the same number of points: the largest circle needs the most.
        unit_circle = _circle(radii.max()) / radii.max()
        circles = [r * unit_circle for r in radii]
        # `_loops_along` expects the axis of the cylinder first.
        return self.start + _loops_along(heights, circles, axes=np.stack([z, x, y], axis=-1))


class Ball(NamedTuple):
    """A sphere, by its centre of shape (3,) and its radius [m]."""

    center: Array
    radius: float

    def loops(self) -> Array:
        """Circles of latitude, from south to north."""
        circle = _circle(self.radius)
        # Latitudes in radians, a little less than pi / 2, so that no circle is a point.
        latitudes = np.linspace(-1.5, 1.5, len(circle) // 2 + 1)
        circles = [np.cos(latitude) * circle for latitude in latitudes]
        heights = self.radius * np.sin(latitudes)
        return self.center + _loops_along(heights, circles, axes=np.eye(3))


class Arc(NamedTuple):
    """A bar that is bent to an arc of a circle about O."""

    #: Columns of a (3, 3) array: the direction of the first end, the direction of the arc there,
    #: and the axis of the arc.
    axes: Array
    radius: float  #: Radius of the middle line, [m].
    angle: float  #: Angle from one end to the other, [rad].
    section: tuple[float, float]  #: Radial and axial size of the section, [m].
    round: bool = False  #: Whether the section is a circle, with two equal sizes.

    def loops(self) -> Array:
        """The sections, from one end to the other."""
        depth, width = self.section
        if self.round:
            section = _circle(depth / 2)
        else:
            section = _rectangle(depth, width, _BEVEL * min(self.section))  # points (radial, axial)
        angles = np.linspace(0, self.angle, _parts(self.angle, _STEP) + 1)
        # Cylindrical coordinates of the points of each section, in the axes of the arc.
        r = self.radius + section[:, 0]
        x = np.outer(np.cos(angles), r)
        y = np.outer(np.sin(angles), r)
        z = np.broadcast_to(section[:, 1], x.shape)
        loops = np.stack([x, y, z], axis=-1)
        # Sections are counterclockwise if r points to the right and z up. A viewer who looks back
        # along the arc, from beyond its last section, sees r to the left when z is up: r x z points
        # against the direction of the arc. So sections are clockwise there, and are reversed.
        return loops[:, ::-1] @ self.axes.T

    def pieces(self) -> Iterator[Primitive]:
        """Straight bars that enclose the arc, each for an equal part of its angle."""
        count = _parts(self.angle, _PIECE)
        half = self.angle / count / 2
        depth, width = self.section
        # Distances from O to the inner and the outer side of a bar. Along the bar's radial
        # direction the arc is nearest to O at the ends of the bar, and farthest in its middle. The
        # outer edges of neighbouring bars meet.
        inner = (self.radius - depth / 2) * np.cos(half)
        outer = self.radius + depth / 2
        middle = (inner + outer) / 2
        length = 2 * outer * np.tan(half)
        x, y, z = self.axes.T
        middle_angles = half * (2 * np.arange(count) + 1)
        for angle in middle_angles:
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
    """A box along a line, with its width along `across`, a unit vector normal to the line."""
    along = (end - start) / np.linalg.norm(end - start)
    axes = np.stack([along, across, np.cross(along, across)], axis=-1)
    return Box((start + end) / 2, axes, np.array((np.linalg.norm(end - start), width, thick)))


def lofted(loops: Array) -> tuple[Array, Indices]:
    """A closed surface through loops, shape (loops, points, 3).

    The vertices are the points of the loops, and the middles of the first and the last loop.
    Between two loops there are two triangles for each point, one of each kind. All triangles of the
    first kind come first, then all of the second kind. A fan of triangles about its middle closes
    each end; these faces come last.

    Returns:
        Vertices, shape (n, 3), [m], and faces as indices of vertices, shape (m, 3).
    """
    count, points, _ = loops.shape
    middles = loops[[0, -1]].mean(axis=1)
    # Indices of vertices: each point of each loop, the next point on its loop, and both middles.
    here = np.arange(count * points).reshape(count, points)
    beside = np.roll(here, -1, axis=1)
    first_middle = np.full(points, count * points)
    last_middle = np.full(points, count * points + 1)
    # The three corners of the faces of each kind. The surface goes from a loop, here[:-1], to the
    # next one, here[1:].
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
    """Right-handed axes with z along a direction, columns of a (3, 3) array."""
    z = direction / np.linalg.norm(direction)
    # x is normal to z and to the axis of the frame that is farthest from z. Entries are rounded, so
    # that the last bit does not choose between equal ones.
    x = np.cross(np.eye(3)[np.argmin(np.abs(z).round(6))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _parts(angle: float, largest: float) -> int:
    """The least number of equal parts of an angle such that no part exceeds `largest`."""
    # 1e-9: a whole number with a rounding error must not be rounded up.
    return int(np.ceil(angle / largest - 1e-9))


def _loops_along(heights: Array, sections: Sequence[Array], axes: Array) -> Array:
    """Loops: sections at heights along the first of three axes.

    A section has the shape (points, 2), in the second and third axes. The axes are the columns of a
    (3, 3) array.
    """
    loops = []
    for height, section in zip(heights, sections, strict=True):
        loops.append(np.insert(section, 0, height, axis=1))
    return np.stack(loops) @ axes.T


def _circle(radius: float) -> Array:
    """Points of a circle, counterclockwise, shape (points, 2).

    Their number is a multiple of four, so that the circle has its full size along both axes.
    """
    # A chord over the angle 2 a is r (1 - cos(a)) away from the circle. The limit of cos(a) gives
    # at least eight points.
    cosine = max(1 - _CHORD / radius, 0.9)
    points_of_quarter = np.ceil(np.pi / 4 / np.arccos(cosine))
    angles = np.pi / 2 / points_of_quarter * np.arange(4 * points_of_quarter)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _rectangle(first: float, second: float, bevel: float) -> Array:
    """Points of a rectangle with its corners cut off, counterclockwise, shape (8, 2).

    `first` and `second` are its sizes along the first and the second axis.
    """
    a = first / 2
    b = second / 2
    # Two points on the right side and two on the upper side; the others are opposite to these.
    half = np.array(((a, bevel - b), (a, b - bevel), (a - bevel, b), (bevel - a, b)))
    return np.concatenate([half, -half])
