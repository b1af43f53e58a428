# SPDX-License-Identifier: BSD-2-Clause
"""Rows of the closures of two frames by vector formulas, all closures at once.

A row of Phi is a wrench W at frame B and another one at frame A, [force; moment] in world axes at
the world's origin: Phi v = W_B . twist of B - W_A . twist of A. With homogeneous coordinates, an
origin [p; 1] and an axis [p; 0], each W is made of a direction u and a vector [p; s], and is
[s u; p x u]. There are two sorts of rows:

- velocity: along a direction u, of a point of B less that of a point of A;
- turn: about the product p x u of two directions, of B less that of A.

The kinds of closures differ in their directions and points only:

- "6d" and "3d": u are the axes of the world, the points both origins; a "6d" turns about the axes
  of the world, too;
- other kinds: u are the axes of A, the points both the origin of B; they turn about the axes of the
  world if no turn is free, else about the normals of two axes that stay at a right angle;
- a distance: u is the unit vector from A to B, the points are the origins;
- a rolling wheel: u are the axes of the plane A, the points both the point of contact.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..model.closures import Closure, Distance, Rolling
from ..model.vectors import cross_products

#: In complex numbers x + i _STEP x_q the imaginary part of f is _STEP f_q, exact to rounding.
_STEP = 1e-50


def _map() -> Array:
    """Products of (p, s) and u, one after the other, times this: [s u; p x u]."""
    wrenches = np.zeros((4, 3, 6))
    wrenches[3, :, :3] = np.eye(3)
    wrenches[:3, :, 3:] = cross_products(np.eye(3)[:, None], np.eye(3))
    return wrenches.reshape(12, 6)


#: What B does, less what A does.
_WRENCHES = np.stack((_map(), -_map()))


class PairRows:
    """The rows of all closures of two frames.

    Frames are numbers x, shape (..., frames, 4, 4): origin and axes x, y, z in homogeneous
    coordinates, the last number of an origin is 1, that of an axis 0. Frame 0 is the world. Rates
    x_t of these numbers have the same shape, as have points and directions made of them: W is
    bilinear in direction and point.

    `closures` come with their first row and the numbers of their frames A and B. Rows of couplings
    are counted in `rows`, and have wrenches of zero.
    """

    def __init__(
        self,
        closures: Sequence[tuple[Closure | Distance | Rolling, int, int, int]],
        frames: int,
        rows: int,
    ) -> None:
        #: Numbers of the frames B and A of each row.
        self.frames = np.zeros((2, rows), dtype=np.intp)
        #: For each row its direction, its points on B and on A, the ends of its gap.
        self._table = np.zeros((5, rows), dtype=np.intp)
        self._lengths = np.zeros(rows)
        self._oriented: list[tuple[slice, int, int]] = []
        self._aligned: list[tuple[int, int, int]] = []
        # Vectors are origin and axes of each frame, then contacts, then rods.
        wheels = [(b, a, c.radius, c.ball) for c, _, a, b in closures if isinstance(c, Rolling)]
        rods = [(b, a) for c, _, a, b in closures if isinstance(c, Distance)]
        contact, rod = 4 * frames, 4 * frames + len(wheels)
        for closure, first, a, b in closures:
            at_a, at_b = 4 * a, 4 * b
            rows_of = slice(first, first + len(closure.rows))
            self.frames[:, rows_of] = [[b], [a]]
            if isinstance(closure, Distance):
                self._table[:, first] = rod, at_b, at_a, at_b, at_a
                self._lengths[first] = closure.distance
                rod += 1
            elif isinstance(closure, Rolling):
                for k in range(3):  # only the height has a residual
                    start = at_a if k == 2 else contact
                    self._table[:, first + k] = at_a + 1 + k, contact, contact, contact, start
                contact += 1
            else:
                self._table[:, rows_of] = np.transpose(self._joint(closure, first, a, b))
        self._rods = _columns(np.array(rods).reshape(-1, 2))
        wheel = np.array(wheels).reshape(-1, 4)
        self._wheels = _columns(wheel[:, :2])
        self._radii, self._discs = wheel[:, 2:3], 1.0 - wheel[:, 3:]

    def _joint(self, closure: Closure, first: int, a: int, b: int) -> list[list[int]]:
        """Rows of the table for a massless joint."""
        at_a, at_b, world = 4 * a, 4 * b, closure.kind in ("6d", "3d")
        u, point = (0, at_a) if world else (at_a, at_b)
        held = closure.held
        rows = [[u + 1 + k, at_b, point, at_b, at_a] for k in range(3) if held[k]]
        turns = [k for k in range(3) if held[3 + k]]
        next_row = first + len(rows)
        if len(turns) == 3:
            self._oriented.append((slice(next_row, next_row + 3), a, b))
            # An axis of the world is the product of the two others.
            return rows + [[1 + (k + 2) % 3, *[1 + (k + 1) % 3] * 2, 0, 0] for k in range(3)]
        if len(turns) == 2:
            self._aligned.append((next_row, at_a + 4 - sum(turns), at_b + 4 - sum(turns)))
        for i, j, about_a in _right_angles(turns):
            of_a, of_b = at_a + 1 + i, at_b + 1 + j
            # The gap is plus or minus the product of both axes; their products with 0 are zero.
            rows.append([of_b, of_a, of_a, 0, of_a] if about_a else [of_a, of_b, of_b, of_b, 0])
        return rows

    def vectors(self, x: Array) -> Array:
        """Direction, points b and a, and ends of the gap of each row, shape (..., 5, rows, 4)."""
        return self._all(x).take(self._table, axis=-2)

    def vector_rates(self, x: Array, x_t: Array) -> Array:
        """Rates of `vectors`."""
        return self._all_rates(x, x_t).take(self._table, axis=-2)

    def residual(self, x: Array, vectors: Array) -> Array:
        """f(q), shape (rows,), zero where the closures are closed; rows of rates have zero."""
        f: Array = np.vecdot(vectors[0], vectors[3] - vectors[4]) - self._lengths
        for rows, a, b in self._oriented:
            f[rows] = pin.log3(x[b, 1:, :3].T.dot(x[a, 1:, :3]))
        for row, axis_of_a, axis_of_b in self._aligned:
            axes = x.reshape(-1, 4)
            if axes[axis_of_a].dot(axes[axis_of_b]) < 0:
                # The axes are opposed: lead on in the same direction, over the right angle.
                two = f[row : row + 2]
                size = np.sqrt(two.dot(two))
                f[row : row + 2] -= 2 * (two / size if size else np.array([1.0, 0.0]))
        return f

    def wrenches(self, vectors: Array) -> Array:
        """W at B, and minus W at A, shape (..., 2, rows, 6)."""
        return _products(vectors, vectors) @ _WRENCHES

    def wrench_rates(self, vectors: Array, rates: Array) -> Array:
        """Rates of `wrenches`, from `vectors` and `vector_rates`."""
        return (_products(rates, vectors) + _products(vectors, rates)) @ _WRENCHES

    def derivatives(self, x: Array, x_t: Array, x_q: Array, x_tq: Array) -> tuple[Array, Array]:
        """Derivatives of `wrenches` and of `wrench_rates`, shapes (k, 2, rows, 6).

        They are taken along directions x_q of x and x_tq of x_t, shapes (k, frames, 4, 4).
        """
        moved, moved_t = x + 1j * _STEP * x_q, x_t + 1j * _STEP * x_tq
        vectors = self.vectors(moved)
        W_t = self.wrench_rates(vectors, self.vector_rates(moved, moved_t))
        return self.wrenches(vectors).imag / _STEP, W_t.imag / _STEP

    def _all(self, x: Array) -> Array:
        """Origin and axes of each frame, contacts, rods, shape (..., vectors, 4)."""
        parts = [x.reshape(*x.shape[:-3], -1, 4)]
        if len(self._radii):
            up = _unit(self._across(x))[0]
            parts.append(x[..., self._wheels[0], 0, :] - self._radii * up)
        if len(self._rods[0]):
            b, a = self._rods
            parts.append(_unit(x[..., b, 0, :] - x[..., a, 0, :])[0])
        return np.concatenate(parts, axis=-2) if len(parts) > 1 else parts[0]

    def _all_rates(self, x: Array, x_t: Array) -> Array:
        parts = [x_t.reshape(*x_t.shape[:-3], -1, 4)]
        if len(self._radii):
            wheel, plane = self._wheels
            (z, n), (z_t, n_t) = ((y[..., wheel, 3, :], y[..., plane, 3, :]) for y in (x, x_t))
            along, along_t = _dot(n, z), _dot(n_t, z) + _dot(n, z_t)
            up_t = _unit_rate(self._across(x), n_t - self._discs * (along_t * z + along * z_t))
            parts.append(x_t[..., wheel, 0, :] - self._radii * up_t)
        if len(self._rods[0]):
            b, a = self._rods
            parts.append(_unit_rate(*(y[..., b, 0, :] - y[..., a, 0, :] for y in (x, x_t))))
        return np.concatenate(parts, axis=-2) if len(parts) > 1 else parts[0]

    def _across(self, x: Array) -> Array:
        """The plane's normal; of a disc, what of it is across the axle."""
        wheel, plane = self._wheels
        z, n = x[..., wheel, 3, :], x[..., plane, 3, :]
        return n - self._discs * _dot(n, z) * z


def _products(points: Array, directions: Array) -> Array:
    """Products of points b and a with the direction of their row, shape (..., 2, rows, 12)."""
    products = points[..., 1:3, :, :, None] @ directions[..., :1, :, None, :3]
    return np.asarray(products.reshape(*products.shape[:-2], 12))


def _columns(table: NDArray[np.generic]) -> list[Indices]:
    return list(table.T.astype(np.intp))


def _right_angles(held: list[int]) -> list[tuple[int, int, bool]]:
    """Axes i of A and j of B that stay at a right angle, so that one or two turns are held.

    The row is the turn about A_i x B_j, or else about B_j x A_i: about the axis that is held.
    """
    if len(held) == 1:
        return [((held[0] + 1) % 3, (held[0] + 2) % 3, True)]
    # The turn about i moves axis k of B against axis j of A, by minus its rate; about j against i.
    k = 3 - sum(held)
    i, j = (k + 1) % 3, (k + 2) % 3
    angles = {i: (j, k, True), j: (i, k, False)}
    return [angles[turn] for turn in held]


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
