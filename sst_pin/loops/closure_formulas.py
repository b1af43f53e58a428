# SPDX-License-Identifier: BSD-2-Clause
# ruff: noqa: D102  (the text of the module describes the methods of all classes)
"""The equations of each kind of closure between two frames, A and B.

A closure has an error f for each motion of B relative to A that it holds. The rate of f is linear
in the twists t_B and t_A of the frames:

    df/dt = W_B t_B - W_A t_A = W [t_B; t_A],    W = [W_B, -W_A].

Row r of W_B, shape (rows, 6), is a wrench: what the closure exerts on B if its multiplier r is one.
Row r of -W_A is the reaction on A. Twists t = [v; omega] and wrenches [force; moment] have the axes
and the origin of the world: v is the velocity of the point of the body that is at the world's
origin.

The classes below are the kinds, one after the other; `formulas_of` at the end chooses from them.
Each class computes

- `error`: f, shape (rows,): 0 where the closure is closed, and for rows that hold rates only;
- `W`: shape (..., rows, 12);
- `W_dot`: the rate of W, shape (..., rows, 12), where the frames have the twists t_B and t_A.

`W` and `W_dot` take placements with leading axes and with complex entries, from which
`row_derivatives` computes derivatives.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.closures import Brake, Closure, Distance, Rolling
from .vectors import (
    action,
    bracket_matrix,
    hat,
    inner,
    inverse,
    skew,
    unit,
    unit_rate,
)

#: A closure of two frames. An `ExtendedDistance` is a `Distance` too.
FrameClosure = Closure | Distance | Rolling | Brake

#: The matrices G_c = hat(e_c) of the unit twists e_c, shape (6, 4, 4): a placement X of a body with
#: this twist has the rate G_c X.
_GENERATORS = hat(np.eye(6))


class FramePair(NamedTuple):
    """The placements of two frames B and A, homogeneous matrices [R p; 0 1].

    Attributes:
        B, A: Their placements in the world, shape (..., 4, 4).
        X: The placement of B in A, shape (..., 4, 4).
        Ad: The matrix that takes twists in the world to twists in A, shape (..., 6, 6).
    """

    B: Array
    A: Array
    X: Array
    Ad: Array

    @classmethod
    def of_placements(cls, B: pin.SE3, A: pin.SE3) -> "FramePair":
        """The pair of two placements in the world."""
        X = A.actInv(B)
        return cls(B=B.homogeneous, A=A.homogeneous, X=X.homogeneous, Ad=A.actionInverse)

    @classmethod
    def of_matrices(cls, B: Array, A: Array) -> "FramePair":
        """The pairs of placements in the world with leading axes, perhaps of complex numbers."""
        A_inverse = inverse(A)
        return cls(B=B, A=A, X=A_inverse @ B, Ad=action(A_inverse))


class Formulas(Protocol):
    """The equations of a closure; the text of the module describes the methods."""

    #: Number of rows.
    rows: int

    def error(self, pair: FramePair) -> Array:
        """f, shape (rows,)."""

    def W(self, pair: FramePair) -> Array:
        """[W_B, -W_A], shape (..., rows, 12)."""

    def W_dot(self, pair: FramePair, W: Array, t_B: Array, t_A: Array) -> Array:
        """The rate of W, shape (..., rows, 12), at twists of shape (..., 6); W is `W(pair)`."""


# --- in the axes of the world -------------------------------------------------------------------


class SamePlacement:
    """B and A have the same origin, the same orientation, or both.

    These are the kinds "3d", "orientation" and "6d":

        f = [p_B - p_A; log(R_B R_A^T)],

    in the axes of the world. Its rate is the twist of B at p_B minus the twist of A at p_A. For a
    twist t at the world's origin, the twist at p is [I, -[p x]; 0, I] t. So

        W = [I, -[p_B x], -I, [p_A x];
             0,  I,        0, -I     ].

    The first three rows are exact. The other three are exact where the orientations are equal.
    Elsewhere the rate of the logarithm differs from the relative angular velocity, and W gives a
    good direction for Newton's method.

    Compiled kernels write the first three rows in the axes of the last body that carries both A and
    B. The rates in Phi do not turn this body, so that Newton's step, Phi dq = -f, is the same in
    both axes. In the axes of A it would differ while the loop is open: there the rate of f has the
    further term -omega_A x f.
    """

    def __init__(self, origin: bool, orientation: bool) -> None:
        self._origin = origin
        self._orientation = orientation
        if origin and orientation:
            held = slice(0, 6)
        elif origin:
            held = slice(0, 3)
        else:
            held = slice(3, 6)
        self.rows = held.stop - held.start

        # W is a constant plus a part that is linear in p = [p_B; p_A]: the sum over k of p_k times
        # the derivative of W by p_k.
        identity = np.eye(6)
        #: W for p = 0, shape (rows, 12).
        self._W_0 = np.hstack([identity, -identity])[held]
        W_of_p = np.zeros((6, 6, 12))
        for k in range(3):
            e_k_x = skew(np.eye(3)[k])
            W_of_p[:3, k, 3:6] = -e_k_x  # by p_B
            W_of_p[:3, 3 + k, 9:] = e_k_x  # by p_A
        #: The derivative of W by p_k is in [:, k], shape (rows, 6, 12). `p.dot` sums over k.
        self._W_of_p = W_of_p[held]

    def error(self, pair: FramePair) -> Array:
        offset = pair.B[:3, 3] - pair.A[:3, 3]
        if not self._orientation:
            return offset
        turn = pin.log3(pair.B[:3, :3] @ pair.A[:3, :3].T)
        if not self._origin:
            return np.asarray(turn)
        return np.concatenate([offset, turn])

    def W(self, pair: FramePair) -> Array:
        p = np.concatenate([pair.B[..., :3, 3], pair.A[..., :3, 3]], axis=-1)
        return self._W_0 + p.dot(self._W_of_p)

    def W_dot(self, pair: FramePair, W: Array, t_B: Array, t_A: Array) -> Array:
        if not self._origin:
            return np.zeros_like(W)  # the wrenches are moments about the axes of the world
        # The first three rows of W_B t_B are the velocity of p_B. Those of W_A t_A are the velocity
        # of p_A; W has -W_A.
        p_B_dot = (W[..., :3, :6] @ t_B[..., None])[..., 0]
        p_A_dot = -(W[..., :3, 6:] @ t_A[..., None])[..., 0]
        return np.concatenate([p_B_dot, p_A_dot], axis=-1).dot(self._W_of_p)


# --- in the axes of frame A ---------------------------------------------------------------------


class RelativeFormulas(ABC):
    """A closure whose error is a function f(X) of the placement X of B in A.

    In the axes of A, at its origin, B has the twist t = Ad (t_B - t_A) relative to A. So X has the
    rate hat(t) X, and f has the rate w(X) t, where w are the wrenches on B in the axes of A. In the
    world they are W_B = W_A = w Ad.
    """

    rows: int

    @abstractmethod
    def f(self, X: Array) -> Array:
        """The errors, shape (rows,)."""

    @abstractmethod
    def w(self, X: Array) -> Array:
        """The wrenches in the axes of A, shape (..., rows, 6)."""

    @abstractmethod
    def w_dot(self, X: Array, X_dot: Array) -> Array:
        """The rate of w where X has the rate X_dot, shape (..., rows, 6)."""

    def error(self, pair: FramePair) -> Array:
        return self.f(pair.X)

    def W(self, pair: FramePair) -> Array:
        W_B = self.w(pair.X) @ pair.Ad
        return np.concatenate([W_B, -W_B], axis=-1)

    def W_dot(self, pair: FramePair, W: Array, t_B: Array, t_A: Array) -> Array:
        t = (pair.Ad @ (t_B - t_A)[..., None])[..., 0]
        w_dot = self.w_dot(pair.X, hat(t) @ pair.X)
        W_B = W[..., :6]
        # W_B = w Ad. As A moves with the twist t_A, Ad has the rate -Ad [t_A x].
        W_B_dot = w_dot @ pair.Ad - W_B @ bracket_matrix(t_A)
        return np.concatenate([W_B_dot, -W_B_dot], axis=-1)


class HeldMotions(RelativeFormulas):
    """A massless joint holds some of the motions x, y, z, turn x, turn y, turn z of B in A.

    At most two turns are held; `SamePlacement` holds three. The error of each row is an entry of
    X = [R p; 0 1], with a sign:

    - A slide along axis i is held: f = p_i, entry (i, 3) of X.
    - One turn is held, about axis i: let x = i + 1 and y = i + 2 be the next two axes (cyclic).
      Axis x of A stays at a right angle to axis y of B: f = -R_xy.
    - Two turns are held: B may turn about the third axis, y, which stays parallel to axis y of A.
      So the other axes of A stay at right angles to axis y of B. The row of turn i, with x the axis
      that is neither i nor y, has f = -R_xy or R_xy.

    The sign is such that f has the rate omega_i where B has the axes of A. With the angular
    velocity omega of B, the entry R_xy = e_x . y_B has the rate e_x . (omega x y_B), which is
    omega . (e_y x e_x) where y_B = e_y. This is -omega_i if e_x x e_y = e_i, else omega_i.

    Component c of the wrench of a row is the rate of f for the unit twist e_c. As X has the rate
    hat(e_c) X = G_c X, entry (r, s) of X has the rate (row r of G_c) times (column s of X).
    """

    def __init__(self, slides: Sequence[int], turns: Sequence[int]) -> None:
        # The axes have the numbers 0, 1, 2, whose sum is 3: two numbers give the third.
        #: The axis about which B may turn if two turns are held.
        self._free_axis: int | None = None
        if len(turns) == 2:
            self._free_axis = 3 - sum(turns)

        # Rows of the entries in X, their columns, and their signs.
        X_rows: list[int] = []
        X_columns: list[int] = []
        signs: list[float] = []
        for i in slides:
            X_rows.append(i)
            X_columns.append(3)
            signs.append(1.0)
        for i in turns:
            y = (i + 2) % 3 if self._free_axis is None else self._free_axis
            x = 3 - i - y
            X_rows.append(x)
            X_columns.append(y)
            is_cyclic = x == (i + 1) % 3  # then e_x x e_y is e_i, else it is -e_i
            signs.append(-1.0 if is_cyclic else 1.0)  # see the text of the class
        self._X_rows = np.array(X_rows)
        self._X_columns = np.array(X_columns)
        self._signs = np.array(signs)
        self.rows = len(signs)
        G_rows = [sign * _GENERATORS[:, r] for r, sign in zip(X_rows, signs, strict=True)]
        #: For a row with the entry (r, s) of X: row r of each G_c, times the sign; (rows, 6, 4).
        self._G = np.array(G_rows)

    def f(self, X: Array) -> Array:
        f: Array = self._signs * X[self._X_rows, self._X_columns]
        y = self._free_axis
        if y is not None and X[y, y] < 0:  # the two axes y are more than 90 degrees apart
            f[-2:] = _beyond_right_angle(f[-2:])  # the rows of turns are last
        return f

    def w(self, X: Array) -> Array:
        columns = X.take(self._X_columns, axis=-1).swapaxes(-1, -2)  # shape (..., rows, 4)
        return (self._G @ columns[..., None])[..., 0]

    def w_dot(self, X: Array, X_dot: Array) -> Array:
        return self.w(X_dot)  # w is linear in X


def _beyond_right_angle(f: Array) -> Array:
    """f of two held turns, shape (2,), where y of B is tilted by more than 90 degrees from y of A.

    At a tilt t, f is (sin t) u with a unit vector u, and its derivative by t is (cos t) u. Beyond
    90 degrees cos t is negative, so that Newton's method would increase the tilt. The result is
    f - 2 u = -(2 - sin t) u. Its derivative by t is the same, but its sign is opposite: Newton's
    method reduces the tilt. Its size 2 - sin t is 1 at 90 degrees, as that of f, and 2 at 180
    degrees. W neglects that u also turns with B; this does no harm, because the step goes along u.
    """
    size = np.linalg.norm(f)
    direction = f / size if size else np.array([1.0, 0.0])
    return np.asarray(f - 2 * direction)


class Rod(RelativeFormulas):
    """The origins have a constant distance: f = |p| - distance.

    The force on B acts along the rod, u = p / |p|. Its line passes through the origin of A, about
    which it has no moment.
    """

    rows = 1

    def __init__(self, distance: float) -> None:
        self._distance = distance

    def f(self, X: Array) -> Array:
        return np.array([np.linalg.norm(X[:3, 3]) - self._distance])

    def w(self, X: Array) -> Array:
        u = unit(X[..., :3, 3])
        return _wrenches(forces=u[..., None, :])

    def w_dot(self, X: Array, X_dot: Array) -> Array:
        u_dot = unit_rate(X[..., :3, 3], X_dot[..., :3, 3])
        return _wrenches(forces=u_dot[..., None, :])


class BrakedLine(Rod):
    """The line between the origins keeps its length, whatever it is: f = 0, w as that of a rod."""

    def __init__(self) -> None:
        super().__init__(distance=0.0)

    def f(self, X: Array) -> Array:
        return np.zeros(1)


class RollingContact(RelativeFormulas):
    """A wheel or ball B rolls on the x-y plane of A: its point of contact rests on the plane.

    The point of contact is c = p - radius n, where the unit vector n points from it to the centre
    of B. The forces act along x, y and z through c: w = [identity, moments c x e_i]. So W t is the
    velocity of the point of B that is at c. The first two rows hold its velocity along the plane,
    the slip; they have no error. The error of the third row is the height of c over the plane. The
    height of c has the same rate as that of the point of B at c, as c is the lowest point of B.
    """

    rows = 3

    def __init__(self, radius: float, ball: bool) -> None:
        self._radius = radius
        self._ball = ball

    def f(self, X: Array) -> Array:
        height = X[2, 3] - self._radius * unit(self._up(X))[2]
        return np.array([0.0, 0.0, height])

    def w(self, X: Array) -> Array:
        c = X[..., :3, 3] - self._radius * unit(self._up(X))
        forces = np.broadcast_to(np.eye(3), (*c.shape, 3))
        return _wrenches(forces, moments=-skew(c))  # row i is c x e_i

    def w_dot(self, X: Array, X_dot: Array) -> Array:
        c_dot = X_dot[..., :3, 3] - self._radius * unit_rate(self._up(X), self._up_rate(X, X_dot))
        return _wrenches(forces=np.zeros((*c_dot.shape, 3)), moments=-skew(c_dot))

    def _up(self, X: Array) -> Array:
        """A vector along n, shape (..., 3).

        For a ball it is z, the normal of the plane. A thin disc touches the plane at its lowest
        point: n is along the part of z that is normal to the axle a, z - (z . a) a.
        """
        z = np.broadcast_to([0.0, 0.0, 1.0], (*X.shape[:-2], 3))
        if self._ball:
            return z
        a = X[..., :3, 2]
        return np.asarray(z - inner(z, a) * a)

    def _up_rate(self, X: Array, X_dot: Array) -> Array:
        """The rate of `_up`."""
        z = np.broadcast_to([0.0, 0.0, 1.0], (*X.shape[:-2], 3))
        if self._ball:
            return np.zeros_like(z)
        # d/dt (z - (z . a) a), with constant z
        a = X[..., :3, 2]
        a_dot = X_dot[..., :3, 2]
        return np.asarray(-inner(z, a_dot) * a - inner(z, a) * a_dot)


def _wrenches(forces: Array, moments: Array | None = None) -> Array:
    """[forces, moments], shape (..., rows, 6), of arrays of shape (..., rows, 3); no moments: 0."""
    if moments is None:
        moments = np.zeros_like(forces)
    return np.concatenate([forces, moments], axis=-1)


# --- the formulas of a closure ------------------------------------------------------------------


def formulas_of(closure: FrameClosure) -> list[Formulas]:
    """The equations of a closure, one or two sets, in the order of its rows."""
    if isinstance(closure, Distance):
        return [Rod(closure.distance)]
    if isinstance(closure, Brake):
        return [BrakedLine()]
    if isinstance(closure, Rolling):
        return [RollingContact(closure.radius, closure.ball)]
    if closure.kind == "6d":
        return [SamePlacement(origin=True, orientation=True)]
    if closure.kind == "3d":
        return [SamePlacement(origin=True, orientation=False)]
    return _of_held_motions(closure.held)


def _of_held_motions(held: Sequence[bool]) -> list[Formulas]:
    """The equations if x, y, z, turn x, turn y, turn z are held or not."""
    slides = [i for i in range(3) if held[i]]
    turns = [i for i in range(3) if held[3 + i]]
    if len(turns) < 3:
        return [HeldMotions(slides, turns)]
    same_orientation = SamePlacement(origin=False, orientation=True)
    if not slides:
        return [same_orientation]
    return [HeldMotions(slides, []), same_orientation]
