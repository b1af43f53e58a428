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
from .vectors import cross_products

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: In complex numbers x + i _STEP x_q the imaginary part of f is _STEP f_q, exact to rounding.
_STEP = 1e-50


def _maps() -> tuple[Array, Array]:
    """Products of (p, 1) and u times these: [u; p x u], and [0; u]."""
    slides, turns = np.zeros((2, 4, 3, 6))
    slides[3, :, :3] = turns[3, :, 3:] = np.eye(3)
    slides[:3, :, 3:] = cross_products(np.eye(3)[:, None], np.eye(3))
    return slides.reshape(12, 6), turns.reshape(12, 6)


_SLIDES, _TURNS = _maps()


class PairRows:
    """The rows of all closures of two frames.

    Frames are numbers x, shape (..., frames, 4, 4): origin and axes x, y, z in homogeneous
    coordinates, the last number of an origin is 1, that of an axis 0. Frame 0 is the world. Rates
    x_t of these numbers have the same shape, as have points and directions made of them: W is
    bilinear in direction and point.

    `closures` come with their first row and the numbers of their frames A and B. Rows of couplings
    are counted in `rows`, and have wrenches of zero.

    Attributes:
        frames: Numbers of the frames B and A of each row, shape (2, rows).
    """

    def __init__(
        self,
        closures: Sequence[tuple[Closure | Distance | Rolling, int, int, int]],
        frames: int,
        rows: int,
    ) -> None:
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
        # Vectors are origin and axes of each frame, then contacts, rods, normals of angles.
        first_contact = 4 * frames
        first_rod = first_contact + sum(isinstance(closure, Rolling) for closure, *_ in closures)
        first_angle = first_rod + sum(isinstance(closure, Distance) for closure, *_ in closures)
        for closure, first, a, b in closures:
            row, at_a, at_b = first, 4 * a, 4 * b
            self.frames[:, row : row + len(closure.rows)] = [[b], [a]]
            if isinstance(closure, Distance):
                table[:, row] = first_rod + len(rods), at_b, at_a, at_b, at_a
                slide[row], self._lengths[row] = 1.0, closure.distance
                rods.append((b, a))
                continue
            if isinstance(closure, Rolling):
                contact = first_contact + len(wheels)
                wheels.append((b, a, closure.radius, closure.ball))
                for k in range(3):  # only the height has a residual
                    start = at_a if k == 2 else contact
                    table[:, row + k] = at_a + 1 + k, contact, contact, contact, start
                    slide[row + k] = 1.0
                continue
            in_world = closure.kind in ("6d", "3d")
            for k in range(3):
                if closure.held[k]:
                    u, at = (1 + k, at_a) if in_world else (at_a + 1 + k, at_b)
                    table[:, row] = u, at_b, at, at_b, at_a
                    slide[row] = 1.0
                    row += 1
            held = [k for k in range(3) if closure.held[3 + k]]
            turn[row : row + len(held)] = 1.0
            if len(held) == 3:
                self._oriented.append((slice(row, row + 3), a, b))
                table[0, row : row + 3] = range(1, 4)
                continue
            if len(held) == 2:
                self._aligned.append((row, at_a + 4 - sum(held), at_b + 4 - sum(held)))
            for i, j, sign in _right_angles(held):
                table[0, row] = first_angle + len(angles)
                angles.append((row, at_a + 1 + i, at_b + 1 + j, sign))
                row += 1
        self._table = table
        slides, turns = (sort[:, None, None] for sort in (slide, turn))
        maps = slides * _SLIDES + turns * _TURNS
        self._maps = np.stack((maps, -maps))  # what B does, less what A does
        self._keep(rods, wheels, angles)

    def _keep(
        self,
        rods: list[tuple[int, int]],
        wheels: list[tuple[int, int, float, bool]],
        angles: list[tuple[int, int, int, float]],
    ) -> None:
        """Take in what vectors are made from."""
        angle, wheel = np.array(angles).reshape(-1, 4), np.array(wheels).reshape(-1, 4)
        self._rods = _columns(np.array(rods).reshape(-1, 2))
        self._angle, *self._axes = _columns(angle[:, :3])
        self._signs = angle[:, 3:]
        self._wheels = _columns(wheel[:, :2])
        self._radii, self._discs = wheel[:, 2:3], 1.0 - wheel[:, 3:]

    def vectors(self, x: Array) -> Array:
        """Direction, points b and a, and ends of the gap of each row, shape (..., 5, rows, 4)."""
        return self._all(x).take(self._table, axis=-2)

    def vector_rates(self, x: Array, x_t: Array) -> Array:
        """Rates of `vectors`."""
        return self._all_rates(x, x_t).take(self._table, axis=-2)

    def residual(self, x: Array, vectors: Array) -> Array:
        """f(q), shape (rows,), zero where the closures are closed; rows of rates have zero."""
        f: Array = np.einsum("ri,ri->r", vectors[0], vectors[3] - vectors[4]) - self._lengths
        for rows, a, b in self._oriented:
            f[rows] = pin.log3(x[b, 1:, :3].T.dot(x[a, 1:, :3]))
        if len(self._angle):
            axes = x.reshape(-1, 4)
            of_a, of_b = self._axes
            f[self._angle] = self._signs[:, 0] * (axes[of_a] * axes[of_b]).sum(axis=1)
            for row, axis_of_a, axis_of_b in self._aligned:
                if axes[axis_of_a].dot(axes[axis_of_b]) < 0:
                    # The axes are opposed: lead on in the same direction, over the right angle.
                    two = f[row : row + 2]
                    size = np.sqrt(two.dot(two))
                    f[row : row + 2] -= 2 * (two / size if size else np.array([1.0, 0.0]))
        return f

    def wrenches(self, vectors: Array) -> Array:
        """W at B, and minus W at A, shape (..., 2, rows, 6)."""
        return self._mapped(_products(vectors, vectors))

    def wrench_rates(self, vectors: Array, rates: Array) -> Array:
        """Rates of `wrenches`, from `vectors` and `vector_rates`."""
        return self._mapped(_products(rates, vectors) + _products(vectors, rates))

    def _mapped(self, products: Array) -> Array:
        flat = products.reshape(*products.shape[:-2], 1, 12)
        return np.asarray((flat @ self._maps)[..., 0, :])

    def derivatives(self, x: Array, x_t: Array, x_q: Array, x_tq: Array) -> tuple[Array, Array]:
        """Derivatives of `wrenches` and of `wrench_rates`, shapes (k, 2, rows, 6).

        They are taken along directions x_q of x and x_tq of x_t, shapes (k, frames, 4, 4).
        """
        moved, moved_t = x + 1j * _STEP * x_q, x_t + 1j * _STEP * x_tq
        vectors = self.vectors(moved)
        W_t = self.wrench_rates(vectors, self.vector_rates(moved, moved_t))
        return self.wrenches(vectors).imag / _STEP, W_t.imag / _STEP

    def _all(self, x: Array) -> Array:
        """Origin and axes of each frame, contacts, rods, normals, shape (..., vectors, 4)."""
        all_vectors = x.reshape(*x.shape[:-3], -1, 4)
        parts = [all_vectors]
        if len(self._radii):
            up = _unit(self._across(x))[0]
            parts.append(x[..., self._wheels[0], 0, :] - self._radii * up)
        if len(self._rods[0]):
            b, a = self._rods
            parts.append(_unit(x[..., b, 0, :] - x[..., a, 0, :])[0])
        if len(self._angle):
            of_a, of_b = (all_vectors[..., axes, :] for axes in self._axes)
            parts.append(self._signs * _normals(of_b, of_a))
        return np.concatenate(parts, axis=-2) if len(parts) > 1 else all_vectors

    def _all_rates(self, x: Array, x_t: Array) -> Array:
        both = tuple(y.reshape(*y.shape[:-3], -1, 4) for y in (x, x_t))
        parts = [both[1]]
        if len(self._radii):
            wheel, plane = self._wheels
            (z, n), (z_t, n_t) = ((y[..., wheel, 3, :], y[..., plane, 3, :]) for y in (x, x_t))
            along, along_t = _dot(n, z), _dot(n_t, z) + _dot(n, z_t)
            up_t = _unit_rate(self._across(x), n_t - self._discs * (along_t * z + along * z_t))
            parts.append(x_t[..., wheel, 0, :] - self._radii * up_t)
        if len(self._rods[0]):
            b, a = self._rods
            parts.append(_unit_rate(*(y[..., b, 0, :] - y[..., a, 0, :] for y in (x, x_t))))
        if len(self._angle):
            (of_a, a_t), (of_b, b_t) = ([y[..., axes, :] for y in both] for axes in self._axes)
            parts.append(self._signs * (_normals(b_t, of_a) + _normals(of_b, a_t)))
        return np.concatenate(parts, axis=-2) if len(parts) > 1 else both[1]

    def _across(self, x: Array) -> Array:
        """The plane's normal; of a disc, what of it is across the axle."""
        wheel, plane = self._wheels
        z, n = x[..., wheel, 3, :], x[..., plane, 3, :]
        return n - self._discs * _dot(n, z) * z


def _products(points: Array, directions: Array) -> Array:
    """Products of points b and a with the direction of their row, shape (..., 2, rows, 4, 3)."""
    return points[..., 1:3, :, :, None] * directions[..., :1, :, None, :3]


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
    """Unit vectors and lengths; zero stays zero and has length one."""
    length = np.sqrt(_dot(d, d))
    length = length + (length == 0)
    return d / length, length


def _unit_rate(d: Array, d_t: Array) -> Array:
    u, length = _unit(d)
    return (d_t - _dot(u, d_t) * u) / length
