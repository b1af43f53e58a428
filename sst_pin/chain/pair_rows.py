# SPDX-License-Identifier: BSD-2-Clause
"""Rows of the closures of two frames by vector formulas, all closures at once.

A row of Phi is a wrench W at frame B and another one at frame A, [force; moment] in world axes at
the world's origin: Phi v = W_B . twist of B - W_A . twist of A. There are two sorts of rows:

- velocity: along a direction u, of a point b of B less that of a point a of A:
  W_B = [u; b x u], W_A = [u; a x u];
- turn: about a direction u, of B less that of A: W_B = W_A = [0; u].

The kinds of closures differ in their directions and points only:

- "6d" and "3d": u are the axes of the world, b and a the two origins; a "6d" turns about the axes
  of the world, too;
- other kinds: u are the axes of A, b and a both the origin of B; they turn about the axes of the
  world if no turn is free, else about the normals of two axes that stay at a right angle;
- a distance: u is the unit vector from A to B, b and a the origins;
- a rolling wheel: u are the axes of the plane A, b and a both the point of contact.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from .closures import Closure, Distance, Rolling
from .vectors import cross_products, dots

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: In complex numbers x + i _STEP x_q the imaginary part of f is _STEP f_q, exact to rounding.
_STEP = 1e-50


def _wrenches() -> Array:
    """Products of a point (p, 1) and of u = [s; t], times this: the wrench [s; p x s + t]."""
    products = np.zeros((4, 6, 6))
    products[3] = np.eye(6)
    products[:3, :3, 3:] = cross_products(np.eye(3)[:, None], np.eye(3))
    return products.reshape(24, 6)


_WRENCHES = _wrenches()


class PairRows:
    """The rows of all closures of two frames.

    Frames are numbers x, shape (..., frames, 4, 4): origin and axes x, y, z in homogeneous
    coordinates, the last number of an origin is 1, that of an axis 0. Frame 0 is the world. Rates
    x_t of these numbers have the same shape, as have points and directions made of them: W is
    bilinear in direction and point.

    Args:
        closures: Each with its first row and the numbers of its frames A and B.
        frames: How many frames there are.
        rows: How many rows there are, those of couplings included: their wrenches are zero.

    Attributes:
        frames: Of each row the numbers of B and A, shape (2, rows).
    """

    def __init__(
        self,
        closures: Sequence[tuple[Closure | Distance | Rolling, int, int, int]],
        frames: int,
        rows: int,
    ) -> None:
        self._count = rows
        self.frames = np.zeros((2, rows), dtype=np.intp)
        #: Of each row its direction, its points on B and on A, the ends of its gap.
        table = np.zeros((5, rows), dtype=np.intp)
        slide, turn = np.zeros((2, rows))
        self._lengths = np.zeros(rows)
        rods: list[tuple[int, int]] = []
        wheels: list[tuple[int, int, float, bool]] = []
        angles: list[tuple[int, int, int, float]] = []
        self._oriented: list[tuple[slice, int, int]] = []
        self._aligned: list[tuple[int, int, int]] = []
        # Directions are the axes of the frames, the rods, the normals of angles.
        first_rod = 3 * frames
        first_angle = first_rod + sum(isinstance(closure, Distance) for closure, *_ in closures)
        for closure, first, a, b in closures:
            row = first
            self.frames[:, row : row + len(closure.rows)] = [[b], [a]]
            if isinstance(closure, Distance):
                table[:, row] = first_rod + len(rods), b, a, b, a
                slide[row], self._lengths[row] = 1.0, closure.distance
                rods.append((b, a))
                continue
            if isinstance(closure, Rolling):
                contact = frames + len(wheels)  # points are the frames' origins, then contacts
                wheels.append((b, a, closure.radius, closure.ball))
                for k in range(3):  # only the height has a residual
                    table[:, row + k] = 3 * a + k, contact, contact, contact, (contact, a)[k == 2]
                    slide[row + k] = 1.0
                continue
            in_world = closure.kind in ("6d", "3d")
            for k in range(3):
                if closure.held[k]:
                    table[:, row] = (k, b, a, b, a) if in_world else (3 * a + k, b, b, b, a)
                    slide[row] = 1.0
                    row += 1
            held = [k for k in range(3) if closure.held[3 + k]]
            turn[row : row + len(held)] = 1.0
            if len(held) == 3:
                self._oriented.append((slice(row, row + 3), a, b))
                table[0, row : row + 3] = range(3)
                continue
            if len(held) == 2:
                self._aligned.append((row, 3 * a + 3 - sum(held), 3 * b + 3 - sum(held)))
            for i, j, sign in _right_angles(held):
                table[0, row] = first_angle + len(angles)
                angles.append((row, 3 * a + i, 3 * b + j, sign))
                row += 1
        self._u, self._arms, self._ends = table[0], table[1:3], table[3:]
        sorts = np.stack((slide, turn), axis=1)[..., None]
        self._sorts = np.stack((sorts, -sorts))  # what B does, less what A does
        angle, wheel = np.array(angles).reshape(-1, 4), np.array(wheels).reshape(-1, 4)
        self._rods = _columns(np.array(rods).reshape(-1, 2))
        self._angle, *self._axes = _columns(angle[:, :3])
        self._signs = angle[:, 3:]
        self._wheels = _columns(wheel[:, :2])
        self._radii, self._discs = wheel[:, 2:3], 1.0 - wheel[:, 3:]

    def vectors(self, x: Array) -> tuple[Array, Array]:
        """Directions [u; 0] or [0; u], minus these at A, and points b and a of all rows.

        Returns:
            Shapes (..., 2, rows, 6) and (..., 2, rows, 4).
        """
        return self._at_rows(self._directions(x), self._points(x))

    def vector_rates(self, x: Array, x_t: Array) -> tuple[Array, Array]:
        """Rates of `vectors`."""
        return self._at_rows(self._directions_t(x, x_t), self._points_t(x, x_t))

    def _at_rows(self, directions: Array, points: Array) -> tuple[Array, Array]:
        u = self._sorts * directions.take(self._u, axis=-2)[..., None, :, None, :3]
        return u.reshape(*u.shape[:-2], 6), points.take(self._arms, axis=-2)

    def residual(self, x: Array, u: Array) -> Array:
        """f(q), shape (rows,), zero where the closures are closed; rows of rates have zero.

        Args:
            x: The frames.
            u: Directions of the rows, as `vectors` has them.
        """
        to, start = self._points(x).take(self._ends, axis=-2)
        f = dots(u[0, :, :3], (to - start)[:, :3]) - self._lengths
        for rows, a, b in self._oriented:
            f[rows] = pin.log3(x[b, 1:, :3].T.dot(x[a, 1:, :3]))
        if len(self._angle):
            axes = x[:, 1:].reshape(-1, 4)
            of_a, of_b = self._axes
            f[self._angle] = self._signs[:, 0] * (axes[of_a] * axes[of_b]).sum(axis=1)
            for row, axis_of_a, axis_of_b in self._aligned:
                if axes[axis_of_a].dot(axes[axis_of_b]) < 0:
                    # The axes are opposed: lead on in the same direction, over the right angle.
                    two = f[row : row + 2]
                    size = np.sqrt(two.dot(two))
                    f[row : row + 2] -= 2 * (two / size if size else np.array([1.0, 0.0]))
        return f

    def wrenches(self, u: Array, points: Array) -> Array:
        """W at B, and minus W at A, shape (..., 2, rows, 6), from `vectors`."""
        products = points[..., :, None] * u[..., None, :]
        return np.asarray(products.reshape(*products.shape[:-2], 24).dot(_WRENCHES))

    def wrench_rates(self, u: Array, points: Array, u_t: Array, points_t: Array) -> Array:
        """Rates of `wrenches`, from `vectors` and `vector_rates`."""
        return self.wrenches(u_t, points) + self.wrenches(u, points_t)

    def derivatives(self, x: Array, x_t: Array, x_q: Array, x_tq: Array) -> tuple[Array, Array]:
        """Derivatives of `wrenches` and of `wrench_rates` along directions of x and x_t.

        Args:
            x: The frames.
            x_t: Their rates.
            x_q: Directions of x, shape (k, frames, 4, 4).
            x_tq: Directions of x_t, shape (k, frames, 4, 4).

        Returns:
            Shapes (k, 2, rows, 6).
        """
        moved, moved_t = x + 1j * _STEP * x_q, x_t + 1j * _STEP * x_tq
        vectors = self.vectors(moved)
        W_t = self.wrench_rates(*vectors, *self.vector_rates(moved, moved_t))
        return self.wrenches(*vectors).imag / _STEP, W_t.imag / _STEP

    def _points(self, x: Array) -> Array:
        """Origins of the frames, then points of contact, shape (..., points, 4)."""
        if not len(self._radii):
            return x[..., 0, :]
        contacts = x[..., self._wheels[0], 0, :] - self._radii * _unit(self._across(x))[0]
        return np.concatenate((x[..., 0, :], contacts), axis=-2)

    def _points_t(self, x: Array, x_t: Array) -> Array:
        if not len(self._radii):
            return x_t[..., 0, :]
        wheel, plane = self._wheels
        (z, n), (z_t, n_t) = ((y[..., wheel, 3, :], y[..., plane, 3, :]) for y in (x, x_t))
        along, along_t = _dot(n, z), _dot(n_t, z) + _dot(n, z_t)
        up_t = _unit_rate(self._across(x), n_t - self._discs * (along_t * z + along * z_t))
        contacts = x_t[..., wheel, 0, :] - self._radii * up_t
        return np.concatenate((x_t[..., 0, :], contacts), axis=-2)

    def _across(self, x: Array) -> Array:
        """The plane's normal; of a disc, what of it is across the axle."""
        wheel, plane = self._wheels
        z, n = x[..., wheel, 3, :], x[..., plane, 3, :]
        return n - self._discs * _dot(n, z) * z

    def _directions(self, x: Array) -> Array:
        """Axes of the frames, rods, normals of angles, shape (..., directions, 4)."""
        axes = x[..., 1:, :].reshape(*x.shape[:-3], -1, 4)
        parts = [axes]
        if len(self._rods[0]):
            b, a = self._rods
            parts.append(_unit(x[..., b, 0, :] - x[..., a, 0, :])[0])
        if len(self._angle):
            of_a, of_b = self._axes
            normals = _normals(axes[..., of_b, :], axes[..., of_a, :])
            parts.append(self._signs * normals)
        return np.concatenate(parts, axis=-2) if len(parts) > 1 else axes

    def _directions_t(self, x: Array, x_t: Array) -> Array:
        axes, axes_t = (y[..., 1:, :].reshape(*y.shape[:-3], -1, 4) for y in (x, x_t))
        parts = [axes_t]
        if len(self._rods[0]):
            b, a = self._rods
            d, d_t = (y[..., b, 0, :] - y[..., a, 0, :] for y in (x, x_t))
            parts.append(_unit_rate(d, d_t))
        if len(self._angle):
            of_a, of_b = self._axes
            normals = _normals(axes_t[..., of_b, :], axes[..., of_a, :])
            normals += _normals(axes[..., of_b, :], axes_t[..., of_a, :])
            parts.append(self._signs * normals)
        return np.concatenate(parts, axis=-2) if len(parts) > 1 else axes_t


def _columns(table: NDArray[np.generic]) -> list[Indices]:
    return list(table.T.astype(np.intp))


def _right_angles(held: list[int]) -> list[tuple[int, int, float]]:
    """Axes i of A and j of B that stay at a right angle, so that one or two turns are held.

    The sign makes the row the turn about the axis that is held.
    """
    if len(held) == 1:
        return [((held[0] + 1) % 3, (held[0] + 2) % 3, -1.0)]
    # The turn about i moves axis k of B against axis j of A, by minus its rate; about j against i.
    k = 3 - sum(held)
    i, j = (k + 1) % 3, (k + 2) % 3
    angles = {i: (j, k, -1.0), j: (i, k, 1.0)}
    return [angles[turn] for turn in held]


def _normals(a: Array, b: Array) -> Array:
    normals = np.zeros_like(a)
    normals[..., :3] = cross_products(a[..., :3], b[..., :3])
    return normals


def _dot(a: Array, b: Array) -> Array:
    return (a * b).sum(axis=-1, keepdims=True)


def _unit(d: Array) -> tuple[Array, Array]:
    """Unit vectors and lengths; zero stays zero."""
    length = np.sqrt(_dot(d, d))
    return d / (length + (length == 0)), length


def _unit_rate(d: Array, d_t: Array) -> Array:
    u, length = _unit(d)
    return (d_t - _dot(u, d_t) * u) / (length + (length == 0))
