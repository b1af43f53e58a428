# SPDX-License-Identifier: BSD-2-Clause
# ruff: noqa: D102  (the text of the module describes the methods of all classes)
"""The equations of each kind of closure between two frames, A and B.

X is the placement of B in A, a homogeneous matrix [R p; 0 1]. If B has the twist t = [v; omega]
relative to A, in the axes of A at its origin, then dX/dt = hat(t) X. A closure has an error f(X)
for each motion that it holds, and

    df/dt = W(X) t.

Each row of W, shape (rows, 6), is the unit wrench [force; moment] that the closure can exert on B;
A gets the opposite. Axes and origin are those of A.

The classes below are the kinds, one after the other. Each computes

- `error`: f, shape (rows,): 0 where the closure is closed, and for rows that hold rates only;
- `W`: shape (..., rows, 6);
- `W_dot`: the rate of W where X has the rate X_dot.

`W` and `W_dot` take matrices with leading axes, and of complex numbers: `row_derivatives`
differentiates them so.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.closures import Brake, Closure, Distance, Rolling
from .vectors import hat, inner, skew, unit, unit_rate

#: A closure of two frames.
FrameClosure = Closure | Distance | Rolling | Brake

#: The matrices G_c = hat(e_c) of the unit twists e_c: dX/dt is the sum of t_c G_c X.
_GENERATORS = hat(np.eye(6))


class Formulas(Protocol):
    """The equations of a closure; the text of the module describes the methods."""

    def error(self, X: Array) -> Array:
        """f, shape (rows,)."""

    def W(self, X: Array) -> Array:
        """Wrenches, shape (..., rows, 6), for X of shape (..., 4, 4)."""

    def W_dot(self, X: Array, X_dot: Array) -> Array:
        """The rate of W, shape (..., rows, 6)."""


class HeldMotions:
    """A massless joint holds some of the motions x, y, z, turn x, turn y, turn z of B in A.

    Most rows are linear in the entries of X: f_r is the sum of F_rij X_ij. Then W_rc, the rate of
    f_r for the unit twist e_c, is the sum of F_rij (G_c X)_ij, where G_c are the generators. This
    is linear in X too: W = T X with constant T, and W_dot = T X_dot.

    - A slide along i is held: f = p_i.
    - One turn i is held: with the next two axes x = i + 1 and y = i + 2 (cyclic), axis x of A stays
      at a right angle to axis y of B: f = -R_xy.
    - Two turns i are held: B may turn about the third axis y, which stays parallel to y of A. So
      both other axes of A stay at right angles to axis y of B: f = -R_xy or R_xy, such that the row
      is the turn about the positive axis i.
    - All three turns are held: f = log R, and W = [0, identity]. This is exact where R is the
      identity. Elsewhere the rate of the logarithm differs from the angular velocity, and W gives a
      good direction for Newton's method.
    """

    def __init__(self, held: Sequence[bool]) -> None:
        slides = [i for i in range(3) if held[i]]
        turns = [i for i in range(3) if held[3 + i]]
        self._turns = len(turns)
        rows = len(slides) + len(turns)

        F = np.zeros((rows, 4, 4))
        for row, i in enumerate(slides):
            F[row, i, 3] = 1.0
        #: Number of the axis about which B may turn if two turns are held. 0 + 1 + 2 = 3.
        self._axis = 3 - sum(turns)
        if len(turns) in (1, 2):
            for row, i in enumerate(turns, len(slides)):
                y = self._axis if len(turns) == 2 else (i + 2) % 3
                x = 3 - i - y
                is_cyclic = x == (i + 1) % 3  # then e_x x e_y is e_i, else it is -e_i
                F[row, x, y] = -1.0 if is_cyclic else 1.0

        # T_rkjc is the sum over i of F_rij (G_c)_ik.
        T = np.einsum("rij,cik->rkjc", F, _GENERATORS)
        if len(turns) == 3:
            for i in range(3):
                T[len(slides) + i, 3, 3, 3 + i] = 1.0  # X_33 is 1, and its rate is 0
        #: F and T for the 16 entries of X in a row, shapes (rows, 16) and (rows, 16, 6).
        self._F = F.reshape(rows, 16)
        self._T = T.reshape(rows, 16, 6)

    def error(self, X: Array) -> Array:
        f: Array = self._F.dot(X.reshape(16))
        if self._turns == 3:
            f[-3:] = pin.log3(X[:3, :3])
        if self._turns == 2 and X[self._axis, self._axis] < 0:
            f[-2:] = _beyond_right_angle(f[-2:])
        return f

    def W(self, X: Array) -> Array:
        return X.reshape(*X.shape[:-2], 16).dot(self._T)

    def W_dot(self, X: Array, X_dot: Array) -> Array:
        return self.W(X_dot)


def _beyond_right_angle(f: Array) -> Array:
    """f of two held turns, shape (2,), where y of B is tilted by more than 90 degrees from y of A.

    At a tilt t the size of f is sin t, and its derivative cos t is negative beyond 90 degrees.
    f - 2 f / |f| has the same derivative and the opposite sign, so that Newton's method reduces
    the tilt there too. Its size is 2 - sin t, which is continuous at 90 degrees and grows to two at
    180 degrees.
    """
    size = np.linalg.norm(f)
    direction = f / size if size else np.array([1.0, 0.0])
    return np.asarray(f - 2 * direction)


class Rod:
    """The origins have a constant distance: f = |p| - distance.

    The force on B acts along the rod, u = p / |p|. Its line passes through the origin of A, about
    which it has no moment.
    """

    def __init__(self, distance: float) -> None:
        self._distance = distance

    def error(self, X: Array) -> Array:
        return np.array([np.linalg.norm(X[:3, 3]) - self._distance])

    def W(self, X: Array) -> Array:
        return _wrenches(forces=unit(X[..., None, :3, 3]))

    def W_dot(self, X: Array, X_dot: Array) -> Array:
        return _wrenches(forces=unit_rate(X[..., None, :3, 3], X_dot[..., None, :3, 3]))


class BrakedLine(Rod):
    """The line between the origins keeps its length, whatever it is: f = 0, W as that of a rod."""

    def __init__(self) -> None:
        super().__init__(distance=0.0)

    def error(self, X: Array) -> Array:
        return np.zeros(1)


class RollingContact:
    """A wheel or ball B rolls on the x-y plane of A: its point of contact rests on the plane.

    The point of contact is c = p - radius n, where the unit vector n points from it to the centre
    of B. The forces act along x, y and z through c: W = [identity, moments c x e_i]. Only the third
    row, the height of c over the plane, has an error. The first two hold the velocity of slip.
    """

    def __init__(self, radius: float, ball: bool) -> None:
        self._radius = radius
        self._ball = ball

    def error(self, X: Array) -> Array:
        height = X[2, 3] - self._radius * unit(self._up(X))[2]
        return np.array([0.0, 0.0, height])

    def W(self, X: Array) -> Array:
        c = X[..., :3, 3] - self._radius * unit(self._up(X))
        return _wrenches(forces=np.broadcast_to(np.eye(3), (*c.shape, 3)), moments=-skew(c))

    def W_dot(self, X: Array, X_dot: Array) -> Array:
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
        a = X[..., :3, 2]
        a_dot = X_dot[..., :3, 2]
        return np.asarray(-inner(z, a_dot) * a - inner(z, a) * a_dot)


def _wrenches(forces: Array, moments: Array | None = None) -> Array:
    """[forces, moments], shape (..., rows, 6), of arrays of shape (..., rows, 3); no moments: 0."""
    if moments is None:
        moments = np.zeros_like(forces)
    return np.concatenate([forces, moments], axis=-1)


def formulas_of(closure: FrameClosure) -> Formulas:
    """The equations of a closure."""
    if isinstance(closure, Distance):
        return Rod(closure.distance)
    if isinstance(closure, Brake):
        return BrakedLine()
    if isinstance(closure, Rolling):
        return RollingContact(closure.radius, closure.ball)
    return HeldMotions(closure.held)
