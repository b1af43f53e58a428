# SPDX-License-Identifier: BSD-2-Clause
# cython: annotation_typing=False, boundscheck=False, cdivision=True, cpow=True
# cython: initializedcheck=False, wraparound=False
"""The kinds of closures: residuals and rows, one closure after the other.

Each row of a closure is a wrench-like vector W at frame B and one at frame A, in world axes, with
W . twist of B - W . twist of A = 0, twists [linear; angular] reduced at the world's origin.

A number stands with its rate, and with the derivatives of both by one rate of the tree, v held. So
what is written once for W gives its rate and its derivatives, too.

Cython compiles this module, with the types in `closure_kinds.pxd`. Where it is not compiled, it
computes the same in more time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from .closures import Closure, Distance, Rolling
from .tree import memory_of

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
#: x, its rate, its derivative by a rate of the tree, and that of its rate.
Number = tuple[float, float, float, float]
Vector = tuple[Number, Number, Number]


def times(a: Number, b: Number) -> Number:
    """The product, by Leibniz' rule."""
    return (
        a[0] * b[0],
        a[0] * b[1] + a[1] * b[0],
        a[0] * b[2] + a[2] * b[0],
        a[0] * b[3] + a[1] * b[2] + a[2] * b[1] + a[3] * b[0],
    )


def minus(a: Number, b: Number) -> Number:
    """The difference."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]


def difference(a: Vector, b: Vector) -> Vector:
    """Of two vectors."""
    return minus(a[0], b[0]), minus(a[1], b[1]), minus(a[2], b[2])


def along(a: Vector, s: Number) -> Vector:
    """The vector times a number."""
    return times(a[0], s), times(a[1], s), times(a[2], s)


def dot(a: Vector, b: Vector) -> Number:
    """The scalar product."""
    x, y, z = times(a[0], b[0]), times(a[1], b[1]), times(a[2], b[2])
    return x[0] + y[0] + z[0], x[1] + y[1] + z[1], x[2] + y[2] + z[2], x[3] + y[3] + z[3]


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return (
        minus(times(a[1], b[2]), times(a[2], b[1])),
        minus(times(a[2], b[0]), times(a[0], b[2])),
        minus(times(a[0], b[1]), times(a[1], b[0])),
    )


def unit(a: Vector) -> Vector:
    """The vector over its length; zero stays zero."""
    square = dot(a, a)
    s = max(square[0], 1e-100)
    f = s**-0.5  # 1 / length, as a function of the square, with its derivatives
    f_1, f_2 = -f / (2 * s), 3 * f / (4 * s * s)
    mixed = f_1 * square[3] + f_2 * square[1] * square[2]
    return along(a, (f, f_1 * square[1], f_1 * square[2], mixed))


def world_axis(k: int) -> Vector:
    """Axis number k of the world."""
    x, y, z = float(k == 0), float(k == 1), float(k == 2)
    return (x, 0.0, 0.0, 0.0), (y, 0.0, 0.0, 0.0), (z, 0.0, 0.0, 0.0)


def vector_at(x: Array, k: int) -> Vector:
    """From its numbers x[k], shape (3, 4)."""
    return (
        (x[k, 0, 0], x[k, 0, 1], x[k, 0, 2], x[k, 0, 3]),
        (x[k, 1, 0], x[k, 1, 1], x[k, 1, 2], x[k, 1, 3]),
        (x[k, 2, 0], x[k, 2, 1], x[k, 2, 2], x[k, 2, 3]),
    )


def put_vector(W: Array, side: int, row: int, i: int, u: Vector) -> None:
    """Into wrenches, shape (4, 2, rows, 6), from i on."""
    put_number(W, side, row, i, u[0])
    put_number(W, side, row, i + 1, u[1])
    put_number(W, side, row, i + 2, u[2])


def put_number(W: Array, side: int, row: int, i: int, x: Number) -> None:
    """Likewise, as number i."""
    W[0, side, row, i] = x[0]
    W[1, side, row, i] = x[1]
    W[2, side, row, i] = x[2]
    W[3, side, row, i] = x[3]


class Frame:
    """A frame that closures connect, where Pinocchio puts it.

    Args:
        data: Pinocchio's; its memory is read at each use.
        index: Of the frame.
        joint: Index of the joint that bears it.
        columns: Indices of the columns of J that move it.
        rates: Indices of the rates v that these belong to.

    Attributes:
        index: As given.
        placement: In the world.
        parts: The numbers of its origin and of its axes x, y, z, shape (4, 3, 4).
        twist, acceleration: Of what bears it, shape (6,).
    """

    def __init__(
        self, data: pin.Data, index: int, joint: int, columns: Indices, rates: Indices
    ) -> None:
        self._data, self.index = data, index  # whoever has a frame has its data
        self.columns, self.rates = columns, rates
        self.placement = data.oMf[index]
        self.parts = np.zeros((4, 3, 4))
        self._parts = self.parts
        self.twist, self.acceleration = np.zeros(6), np.zeros(6)
        self._p = memory_of(self.placement, "translation")
        self._R = memory_of(self.placement, "rotation")
        self._joint_p = memory_of(data.oMi[joint], "translation")
        self._joint_R = memory_of(data.oMi[joint], "rotation")
        self._v = memory_of(data.v[joint], "vector")
        self._a = memory_of(data.a[joint], "vector")

    def place(self) -> None:
        """Take over where it is."""
        for i in range(3):
            self._parts[0, i, 0] = self._p[i]
            for k in range(3):
                self._parts[1 + k, i, 0] = self._R[i, k]

    def move(self) -> None:
        """Take over how it moves."""
        self._to_world(self._v, self.twist)
        self._to_world(self._a, self.acceleration)
        x, t = self._parts, self.twist
        for k in range(4):
            for i in range(3):
                j, m = (i + 1) % 3, (i + 2) % 3
                x[k, i, 1] = t[3 + j] * x[k, m, 0] - t[3 + m] * x[k, j, 0]  # omega x x
                if k == 0:
                    x[k, i, 1] += t[i]

    def _to_world(self, of_joint: Array, x: Array) -> None:
        """A twist from the joint's axes and origin to those of the world."""
        p, R = self._joint_p, self._joint_R
        for i in range(3):
            x[i] = R[i, 0] * of_joint[0] + R[i, 1] * of_joint[1] + R[i, 2] * of_joint[2]
            x[3 + i] = R[i, 0] * of_joint[3] + R[i, 1] * of_joint[4] + R[i, 2] * of_joint[5]
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            x[i] += p[j] * x[3 + m] - p[m] * x[3 + j]

    def origin(self) -> Vector:
        """Its origin."""
        return vector_at(self._parts, 0)

    def axis(self, k: int) -> Vector:
        """Its axis number k."""
        return vector_at(self._parts, 1 + k)


class Moved:
    """What moves a frame and not the other one.

    Attributes:
        columns: Indices of the columns of J.
        rates: Indices of the rates v that these belong to.
    """

    def __init__(self, frame: Frame, other: Frame) -> None:
        alone = ~np.isin(frame.columns, other.columns)
        self.columns = np.asarray(frame.columns)[alone]
        self.rates = np.asarray(frame.rates)[alone]


class Rows:
    """Memory for the rows of closures.

    Args:
        count: How many there are.

    Attributes:
        W: The numbers of the wrenches at B and at A, shape (4, 2, rows, 6), zero at first.
        f: Residuals, shape (rows,), likewise.
        drift: Accelerations with v_dot = 0, shape (rows,), likewise.
    """

    def __init__(self, count: int) -> None:
        self.W = np.zeros((4, 2, count, 6))
        self.f, self.drift = np.zeros((2, count))


class Pair:
    """The rows of a closure of two frames.

    Args:
        closure: What it holds.
        B, A: The frames.
        rows: Of all closures.
        at: Its own ones.

    Attributes:
        B, A, at: As given.
        rates: Indices of the rates that move one of the frames only.
    """

    def __init__(self, closure: Any, B: Frame, A: Frame, rows: Rows, at: slice) -> None:
        self.B, self.A, self.at, self._first = B, A, at, at.start
        self._of_B, self._of_A = Moved(B, A), Moved(A, B)
        self.rates = np.union1d(self._of_B.rates, self._of_A.rates)
        self._rates = self.rates
        self._numbers = rows.W[:, :, at]
        self._W, self._f, self._drift = self._numbers, rows.f[at], rows.drift[at]

    def residual(self) -> None:
        """Compute f."""
        raise NotImplementedError

    def wrenches(self) -> None:
        """Compute what of W changes."""

    def product(self, part: int, J: Array, Phi: Array) -> None:
        """Put W J, or W_dot J, at B for what moves B only, less that at A for what moves A only.

        What moves both frames leaves the closure as it is.

        Args:
            part: 0 for W, 1 for W_dot.
            J: By columns, shape (nvExtended, 6).
            Phi: All rows, shape (rows, nv).
        """
        for k in range(len(self._f)):
            for n in range(len(self._rates)):
                Phi[self._first + k, self._rates[n]] = 0.0
        for side in range(2):
            moved, sign = (self._of_A, -1.0) if side else (self._of_B, 1.0)
            for k in range(len(self._f)):
                for n in range(len(moved.columns)):
                    column, x = moved.columns[n], 0.0
                    for i in range(6):
                        x += self._W[part, side, k, i] * J[column, i]
                    Phi[self._first + k, moved.rates[n]] += sign * x

    def drift(self) -> None:
        """Compute the accelerations with v_dot = 0, by W and its rate."""
        W, drift, B, A = self._W, self._drift, self.B, self.A
        for k in range(len(drift)):
            drift[k] = 0.0
            for i in range(6):
                drift[k] += W[1, 0, k, i] * B.twist[i] + W[0, 0, k, i] * B.acceleration[i]
                drift[k] -= W[1, 1, k, i] * A.twist[i] + W[0, 1, k, i] * A.acceleration[i]

    def derivatives(self, B_q: Array, A_q: Array) -> tuple[Array, Array]:
        """W with its rate, and their derivatives along the rates of the tree, v held.

        Args:
            B_q: Derivatives of B's origin and axes and of their rates, shape (nv, 4, 3, 2).
            A_q: Those of A.

        Returns:
            Shapes (2, 2, rows, 6) and (2, 2, rows, 6, nv).
        """
        W = self._numbers
        W_q = np.empty((*W[2:].shape, len(B_q)))
        for k in range(len(B_q)):
            self.B.parts[..., 2:], self.A.parts[..., 2:] = B_q[k], A_q[k]
            self.wrenches()
            W_q[..., k] = W[2:]
        return W[:2].copy(), W_q

    def _hold_velocity(self, row: int, u: Vector, of_b: Vector, of_a: Vector) -> None:
        """Along u, of a point of B less that of a point of A."""
        put_vector(self._W, 0, row, 0, u)
        put_vector(self._W, 0, row, 3, cross(of_b, u))
        put_vector(self._W, 1, row, 0, u)
        put_vector(self._W, 1, row, 3, cross(of_a, u))

    def _hold_turn(self, row: int, u: Vector) -> None:
        """About u, of B less that of A."""
        put_vector(self._W, 0, row, 3, u)
        put_vector(self._W, 1, row, 3, u)


class Weld(Pair):
    """6d: the displacement from A to B as a screw in world axes; its rate is the relative twist."""

    def __init__(self, closure: Closure, B: Frame, A: Frame, rows: Rows, at: slice) -> None:
        super().__init__(closure, B, A, rows, at)
        rows.W[0, :, at] = np.eye(6)

    def residual(self) -> None:
        """As `Pair.residual`."""
        screw = pin.log6(self.B.placement * self.A.placement.inverse()).vector
        self._f[:] = screw


class Point(Pair):
    """3d: the origins coincide; rows in world axes at each origin."""

    def residual(self) -> None:
        """As `Pair.residual`."""
        d, f = difference(self.B.origin(), self.A.origin()), self._f
        f[0], f[1], f[2] = d[0][0], d[1][0], d[2][0]

    def wrenches(self) -> None:
        """As `Pair.wrenches`."""
        for k in range(3):
            self._hold_velocity(k, world_axis(k), self.B.origin(), self.A.origin())


class Mask(Pair):
    """Any choice of held motions of B in the axes of A.

    Attributes:
        slides: Axes of A along which B does not slide.
        orientation: Whether no turn is free.
        angles: (i, j, sign) of axes i of A and j of B that stay at a right angle.
    """

    def __init__(self, closure: Closure, B: Frame, A: Frame, rows: Rows, at: slice) -> None:
        super().__init__(closure, B, A, rows, at)
        held = closure.held
        self.slides = [k for k in range(3) if held[k]]
        turns = [k for k in range(3) if held[3 + k]]
        self.orientation = len(turns) == 3
        # An axis a of A and an axis b of B that stay at a right angle: with one free turn about k,
        # the two others of A against k of B; with one held turn k, the two others of A and B.
        self.angles: list[tuple[int, int, float]] = []
        self._along = -1
        if self.orientation:
            rows.W[0, :, at][:, len(self.slides) :, 3:] = np.eye(3)
        elif len(turns) == 2:
            (k,) = set(range(3)) - set(turns)
            i, j = (k + 1) % 3, (k + 2) % 3
            # The turn about i moves b = k against a = j, by minus its rate; about j against i.
            of_turn = {i: (j, k, -1.0), j: (i, k, 1.0)}
            self.angles, self._along = [of_turn[turn] for turn in turns], k
        elif len(turns) == 1:
            (k,) = turns
            self.angles = [((k + 1) % 3, (k + 2) % 3, -1.0)]

    def residual(self) -> None:
        """As `Pair.residual`."""
        A, B, f, row = self.A, self.B, self._f, 0
        d = difference(B.origin(), A.origin())
        for k in self.slides:
            f[row] = dot(A.axis(k), d)[0]
            row += 1
        if self.orientation:
            turn = pin.log3(B.placement.rotation @ A.placement.rotation.T)
            f[row:] = turn
            return
        first = row
        for i, j, sign in self.angles:
            f[row] = sign * dot(A.axis(i), B.axis(j))[0]
            row += 1
        k = self._along
        if k >= 0 and dot(A.axis(k), B.axis(k))[0] < 0:
            # The axes are opposed: lead on in the same direction, over the right angle.
            size = (f[first] ** 2 + f[first + 1] ** 2) ** 0.5
            f[first] -= 2 * (f[first] / size if size else 1.0)
            f[first + 1] -= 2 * (f[first + 1] / size if size else 0.0)

    def wrenches(self) -> None:
        """As `Pair.wrenches`."""
        A, B, row = self.A, self.B, 0
        for k in self.slides:
            self._hold_velocity(row, A.axis(k), B.origin(), B.origin())
            row += 1
        for i, j, sign in self.angles:
            self._hold_turn(row, along(cross(B.axis(j), A.axis(i)), (sign, 0.0, 0.0, 0.0)))
            row += 1


class Rod(Pair):
    """The distance of the origins."""

    def __init__(self, closure: Distance, B: Frame, A: Frame, rows: Rows, at: slice) -> None:
        super().__init__(closure, B, A, rows, at)
        self._length = closure.distance

    def residual(self) -> None:
        """As `Pair.residual`."""
        d = difference(self.B.origin(), self.A.origin())
        self._f[0] = dot(d, d)[0] ** 0.5 - self._length

    def wrenches(self) -> None:
        """As `Pair.wrenches`."""
        B, A = self.B.origin(), self.A.origin()
        self._hold_velocity(0, unit(difference(B, A)), B, A)


class Wheel(Pair):
    """Velocity of the wheel B at the contact, along x, y and z of the plane A."""

    def __init__(self, closure: Rolling, B: Frame, A: Frame, rows: Rows, at: slice) -> None:
        super().__init__(closure, B, A, rows, at)
        self._radius, self._ball = closure.radius, closure.ball

    def residual(self) -> None:
        """As `Pair.residual`."""
        height = dot(self.A.axis(2), difference(self._contact(), self.A.origin()))
        self._f[2] = height[0]

    def wrenches(self) -> None:
        """As `Pair.wrenches`."""
        contact = self._contact()
        for k in range(3):
            self._hold_velocity(k, self.A.axis(k), contact, contact)

    def _contact(self) -> Vector:
        up, z = self.A.axis(2), self.B.axis(2)
        if not self._ball:
            up = unit(difference(up, along(z, dot(up, z))))
        return difference(self.B.origin(), along(up, (self._radius, 0.0, 0.0, 0.0)))


def pair_of(closure: Any, B: Frame, A: Frame, rows: Rows, at: slice) -> Pair:
    """The rows of a closure of two frames, as its kind has them; arguments as `Pair`."""
    if isinstance(closure, Distance):
        return Rod(closure, B, A, rows, at)
    if isinstance(closure, Rolling):
        return Wheel(closure, B, A, rows, at)
    named = closure.kind if isinstance(closure.kind, str) else ""
    return {"6d": Weld, "3d": Point}.get(named, Mask)(closure, B, A, rows, at)


def place(frames: list[Frame], pairs: list[Pair]) -> None:
    """Compute f where Pinocchio put the frames."""
    for frame in frames:
        frame.place()
    for pair in pairs:
        pair.residual()


def length(f: Array, scale: Array) -> float:
    """Of the scaled residuals, one number after the other."""
    square = 0.0
    for i in range(len(f)):
        square += f[i] * scale[i] * f[i] * scale[i]
    return square**0.5


def products(pairs: list[Pair], part: int, J: Array, Phi: Array) -> None:
    """Compute W, and with it `Pair.product`."""
    for pair in pairs:
        pair.wrenches()
        pair.product(part, J, Phi)


def move(frames: list[Frame], pairs: list[Pair]) -> None:
    """Compute the rate of W and the drift, as Pinocchio moves the frames with v_dot = 0."""
    for frame in frames:
        frame.move()
    for pair in pairs:
        pair.wrenches()
        pair.drift()
