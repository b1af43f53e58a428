# SPDX-License-Identifier: BSD-2-Clause
"""The rows of one closure: its error f, its Jacobian Phi and the rate of Phi, by vector formulas.

A row of Phi is a wrench W on frame B and the opposite one on frame A, [force; moment] at the
world's origin: Phi = W_B J_B - W_A J_A, with Pinocchio's frame Jacobians J in world axes. There are
two sorts of rows:

- a unit force along u at a point p of each frame: W = [u; p x u]; the row is the velocity along u
  of the point of B relative to that of A;
- a unit moment about n: W = [0; n]; the row is the rate at which B turns about n relative to A.

The rate is Phi_dot = W_dot J + W J_dot. M are the homogeneous matrices of B and A, shape
(..., 2, 4, 4), and M_t their rates. W is [W_B, -W_A], shape (..., rows, 12).
"""

from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from ..arrays import Array
from ..errors import DescriptionError
from ..model.closures import Brake, Closure, Constraint, Coupling, Distance, Rolling, frames_of
from ..model.joint_space import JointSpace
from ..model.normal_tree import NormalTree
from ..model.tree import frame_id, joint_id

#: e_i x e_j.
_CROSS = np.cross(np.eye(3)[:, None], np.eye(3))
#: A point [p; 1] times this: wrenches of unit forces along x, y, z there.
_FORCES = np.zeros((4, 3, 6))
_FORCES[:3, :, 3:], _FORCES[3, :, :3] = _CROSS, np.eye(3)
#: The same on B, and with the opposite sign on A: at one point, and at a point of each.
_AT_ONE = np.concatenate((_FORCES, -_FORCES), axis=2).reshape(4, 36)
_AT_TWO = np.zeros((8, 3, 12))
_AT_TWO[:4, :, :6], _AT_TWO[4:, :, 6:] = _FORCES, -_FORCES
_FLAT_AT_TWO = _AT_TWO.reshape(8, -1)
#: Unit moments about x, y, z on B, and with the opposite sign on A.
_MOMENTS = np.kron([0.0, 1.0, 0.0, -1.0], np.eye(3))


class Formulas(Protocol):
    """f and W of rows, and the rate of W."""

    def error(self, M: Array) -> Array:
        """f, shape (rows,), zero where the closure is closed; 0 for rows that hold rates only."""

    def W(self, M: Array) -> Array:
        """The wrenches."""

    def W_dot(self, M: Array, M_t: Array) -> Array:
        """Their rates."""


class _WorldForces:
    """Forces along axes of the world at the origins of B and A."""

    def __init__(self, axes: Array) -> None:
        self._axes, self._forces = axes, (axes @ _AT_TWO).reshape(8, -1)

    def error(self, M: Array) -> Array:
        return self._axes.dot(M[0, :3, 3] - M[1, :3, 3])

    def W(self, M: Array) -> Array:
        return _at_two_points(M, self._forces)

    def W_dot(self, M: Array, M_t: Array) -> Array:
        return _at_two_points(M_t, self._forces)


class _AxisForces:
    """Forces along axes of A at the origin of B."""

    def __init__(self, axes: Array) -> None:
        self._axes = axes

    def error(self, M: Array) -> Array:
        return self._along(M).dot(M[0, :3, 3] - M[1, :3, 3])

    def W(self, M: Array) -> Array:
        return self._along(M) @ _at_one_point(M[..., 0, :, 3])

    def W_dot(self, M: Array, M_t: Array) -> Array:
        p, p_t = M[..., 0, :, 3], M_t[..., 0, :, 3]
        return self._along(M_t) @ _at_one_point(p) + self._along(M) @ _at_one_point(p_t)

    def _along(self, M: Array) -> Array:
        return self._axes @ _axes(M[..., 1, :, :])


class _RodForce:
    """A force along the unit vector from A to B at both origins."""

    def __init__(self, length: float) -> None:
        self._length = length

    def error(self, M: Array) -> Array:
        d = _rod(M)
        return np.sqrt(np.vecdot(d, d)) - self._length

    def W(self, M: Array) -> Array:
        return _unit(_rod(M)) @ _at_two_points(M)

    def W_dot(self, M: Array, M_t: Array) -> Array:
        d, d_t = _rod(M), _rod(M_t)
        return _unit_rate(d, d_t) @ _at_two_points(M) + _unit(d) @ _at_two_points(M_t)


class _HeldLength(_RodForce):
    """The force of a rod that has the length which it is found with."""

    def __init__(self) -> None:
        super().__init__(0.0)

    def error(self, M: Array) -> Array:
        return np.zeros(1)


class _WheelForces:
    """Forces along the axes of the plane A at the contact of a wheel or ball B."""

    def __init__(self, closure: Rolling) -> None:
        self._radius, self._ball = closure.radius, closure.ball

    def error(self, M: Array) -> Array:
        height = M[1, :, 2].dot(self._contact(M) - M[1, :, 3])
        return np.array([0.0, 0.0, height])

    def W(self, M: Array) -> Array:
        return _axes(M[..., 1, :, :]) @ _at_one_point(self._contact(M))

    def W_dot(self, M: Array, M_t: Array) -> Array:
        z, n, z_t, n_t = M[..., 0, :, 2], M[..., 1, :, 2], M_t[..., 0, :, 2], M_t[..., 1, :, 2]
        across_t = n_t
        if not self._ball:
            across_t = n_t - (_dot(n_t, z) + _dot(n, z_t)) * z - _dot(n, z) * z_t
        contact_t = M_t[..., 0, :, 3] - self._radius * _unit_rate(self._across(M), across_t)
        u, u_t = _axes(M[..., 1, :, :]), _axes(M_t[..., 1, :, :])
        return u_t @ _at_one_point(self._contact(M)) + u @ _at_one_point(contact_t)

    def _contact(self, M: Array) -> Array:
        """[p; 1]."""
        return np.asarray(M[..., 0, :, 3] - self._radius * _unit(self._across(M)))

    def _across(self, M: Array) -> Array:
        """[n; 0] with the normal n of the plane; for a disc, its part normal to the axle z."""
        z, n = M[..., 0, :, 2], M[..., 1, :, 2]
        return n if self._ball else n - _dot(n, z) * z


class _WorldMoments:
    """Moments about all axes of the world."""

    def error(self, M: Array) -> Array:
        return pin.log3(M[0, :3, :3].dot(M[1, :3, :3].T))

    def W(self, M: Array) -> Array:
        return M[..., 0, 3:, 3:] * _MOMENTS

    def W_dot(self, M: Array, M_t: Array) -> Array:
        return M_t[..., 0, 3:, 3:] * _MOMENTS  # zero: the last entry of M is 1


class _RightAngles:
    """One or two moments about cross(x, y): axis x of A stays at a right angle to axis y of B."""

    def __init__(self, turns: list[int]) -> None:
        self._x, self._y = np.zeros((2, len(turns), 3))
        #: The axis that stays parallel, if two are at right angles.
        self._parallel = 3 - sum(turns) if len(turns) == 2 else None
        for row, turn in enumerate(turns):
            y = (turn + 2) % 3 if self._parallel is None else self._parallel
            x = 3 - turn - y
            self._x[row, x] = 1.0 if x == (turn + 1) % 3 else -1.0
            self._y[row, y] = 1.0

    def error(self, M: Array) -> Array:
        f: Array = -np.vecdot(*self._xy(M))
        k = self._parallel
        if k is not None and M[1, :3, k].dot(M[0, :3, k]) < 0:
            # Their angle exceeds a right angle: continue f so that Newton's steps still reduce it.
            size = np.linalg.norm(f)
            f -= 2 * (f / size if size else np.array([1.0, 0.0]))
        return f

    def W(self, M: Array) -> Array:
        x, y = self._xy(M)
        return cross(x, y) @ _MOMENTS

    def W_dot(self, M: Array, M_t: Array) -> Array:
        (x, y), (x_t, y_t) = self._xy(M), self._xy(M_t)
        return (cross(x_t, y) + cross(x, y_t)) @ _MOMENTS

    def _xy(self, M: Array) -> tuple[Array, Array]:
        return self._x @ _axes(M[..., 1, :, :]), self._y @ _axes(M[..., 0, :, :])


class _Stacked:
    """Forces, then moments."""

    def __init__(self, *parts: Formulas) -> None:
        self._parts = parts

    def error(self, M: Array) -> Array:
        return np.concatenate([part.error(M) for part in self._parts])

    def W(self, M: Array) -> Array:
        return np.concatenate([part.W(M) for part in self._parts], axis=-2)

    def W_dot(self, M: Array, M_t: Array) -> Array:
        return np.concatenate([part.W_dot(M, M_t) for part in self._parts], axis=-2)


class FrameRows:
    """The rows of a closure of two frames; `evaluate` computes what depends on q.

    Attributes:
        formulas: f, W and its rate for any two frames.
        frames: Indices of frame B and frame A.
        bodies: Their parent joints in the normal tree.
        f: Error of the closure, Eq. (2), shape (rows,), [m] and [rad].
        W: [W_B, -W_A], shape (rows, 12).
        Phi: Jacobian of f, Eq. (3), shape (rows, nv).
        touched, curved: Rates that a row depends on, and rates that change the row, (rows, nv).
    """

    def __init__(self, tree: NormalTree, closure: Closure | Distance | Rolling | Brake) -> None:
        frame_b, frame_a = (frame_id(tree.model, name) for name in frames_of(closure)[::-1])
        self._model, self.frames, self.formulas = tree.model, (frame_b, frame_a), _formulas(closure)
        self.bodies = [tree.model.frames[frame].parentJoint for frame in self.frames]
        moves_b, moves_a = (tree.supports[body] for body in self.bodies)
        # Joints that move both frames in the same way do not change the closure.
        self._moving = np.flatnonzero(moves_b != moves_a)
        self._moves = np.repeat([moves_b, moves_a], 6, axis=0)[:, self._moving].astype(float)
        self._S = tree.S[self._moving]
        self.touched = self.curved = np.tile(self._S.any(axis=0), (len(closure.rows), 1))

    def evaluate(self, q: Array, data: pin.Data, J: Array) -> None:
        """f, W and Phi, from placements in `data`; J has the joints' twists twice, for B and A."""
        places = data.oMf
        self._M = np.array([places[frame].homogeneous for frame in self.frames])
        self.f, self.W = self.formulas.error(self._M), self.formulas.W(self._M)
        self._J = self._of_frames(J)
        self.Phi = self.W.dot(self._J).dot(self._S)  # Eqs. (3), (4)

    @property
    def largest_coordinate(self) -> float:
        """Largest absolute coordinate of both origins in the world, [m]."""
        return float(np.abs(self._M[:, :3, 3]).max())

    def Phi_dot(self, v: Array, data: pin.Data, J_dot: Array) -> Array:
        """Rate of Phi, shape (rows, nv); velocities in `data` and the rates of J are at v."""
        twists = self._twists(data)
        return (self._W_dot(twists).dot(self._J) + self.W.dot(self._of_frames(J_dot))).dot(self._S)

    def drift(self, v: Array, data: pin.Data) -> Array:
        """Phi_dot v, shape (rows,); `data` has velocities, and accelerations with v_dot = 0."""
        model, where, twists = self._model, pin.WORLD, self._twists(data)
        rates = [pin.getFrameAcceleration(model, data, k, where).vector for k in self.frames]
        t, t_dot = np.concatenate([twist.vector for twist in twists]), np.concatenate(rates)
        return self._W_dot(twists).dot(t) + self.W.dot(t_dot)

    def _twists(self, data: pin.Data) -> list[pin.Motion]:
        return [pin.getFrameVelocity(self._model, data, k, pin.WORLD) for k in self.frames]

    def _W_dot(self, twists: list[pin.Motion]) -> Array:
        M_t = np.array([twist.homogeneous for twist in twists]) @ self._M
        return self.formulas.W_dot(self._M, M_t)

    def _of_frames(self, J: Array) -> Array:
        """Jacobians of B and A to the joints between them, shape (12, joints)."""
        return J.take(self._moving, axis=1) * self._moves


class CouplingRow:
    """The row of a coupling of joints that have one coordinate each."""

    def __init__(self, model: pin.Model, coupling: Coupling) -> None:
        terms = [(coupling.joint, Polynomial([0.0, 1.0]), 1.0)]
        terms += [(name, Polynomial(p), -1.0) for name, p in coupling.polynomials.items()]
        self._offset = coupling.offset
        #: For each joint its index in q and in v, the polynomial P of its coordinate with
        #: sum P = offset, and the first and second derivative of P.
        self.terms: list[tuple[int, int, Polynomial, Polynomial, Polynomial]] = []
        self.touched, self.curved = np.zeros((2, 1, model.nv), dtype=bool)
        for name, polynomial, sign in terms:
            joint = model.joints[joint_id(model, name)]
            if (joint.nq, joint.nv) != (1, 1):
                problem = f"joint {name} has {joint.nq} coordinates; couplings take one"
                raise DescriptionError(str(coupling), [problem])
            P = sign * polynomial
            self.terms.append((joint.idx_q, joint.idx_v, P, P.deriv(), P.deriv(2)))
            self.touched[0, joint.idx_v] = True
            self.curved[0, joint.idx_v] = P.deriv(2).coef.any()
        #: Index in v of the dependent joint.
        self.rate = self.terms[0][1]

    def evaluate(self, q: Array, data: pin.Data, J: Array) -> None:
        """f and Phi at q."""
        self._q, self.Phi = q, np.zeros(self.touched.shape)
        self.f = np.array([sum(float(P(q[i])) for i, _, P, *_ in self.terms) - self._offset])
        for i, k, _, P_1, _ in self.terms:
            self.Phi[0, k] = P_1(q[i])

    def Phi_dot(self, v: Array, data: pin.Data, J_dot: Array) -> Array:
        """Rate of Phi, shape (1, nv)."""
        Phi_dot = np.zeros(self.touched.shape)
        for i, k, _, _, P_2 in self.terms:
            Phi_dot[0, k] = P_2(self._q[i]) * v[k]
        return Phi_dot

    def drift(self, v: Array, data: pin.Data) -> Array:
        """Phi_dot v, shape (1,)."""
        return np.array([sum(float(P_2(self._q[i])) * v[k] ** 2 for i, k, _, _, P_2 in self.terms)])


class BrakeRow(CouplingRow):
    """The row of a joint's rate that is held, at any position."""

    def __init__(self, model: pin.Model, brake: Brake) -> None:
        self.terms = []
        (self.rate,) = JointSpace(model).rates_of([brake.name])
        self.touched, self.curved = np.zeros((2, 1, model.nv), dtype=bool)
        self.touched[0, self.rate] = True
        self.f, self.Phi = np.zeros(1), self.touched.astype(float)

    def evaluate(self, q: Array, data: pin.Data, J: Array) -> None:
        """Nothing: f and Phi are constant."""

    def drift(self, v: Array, data: pin.Data) -> Array:
        """Phi_dot v, shape (1,)."""
        return np.zeros(1)


def rows_of(model: pin.Model, tree: NormalTree, closure: Constraint) -> FrameRows | CouplingRow:
    """The rows of a closure of a model with this normal tree."""
    if isinstance(closure, Coupling):
        return CouplingRow(model, closure)
    if isinstance(closure, Brake) and closure.frames is None:
        return BrakeRow(model, closure)
    return FrameRows(tree, closure)


def _formulas(closure: Closure | Distance | Rolling | Brake) -> Formulas:
    if isinstance(closure, Distance):
        return _RodForce(closure.distance)
    if isinstance(closure, Brake):
        return _HeldLength()
    if isinstance(closure, Rolling):
        return _WheelForces(closure)
    axes = np.eye(3)[np.array(closure.held[:3])]
    turns = [k for k in range(3) if closure.held[3 + k]]
    forces = (_WorldForces if closure.kind in ("6d", "3d") else _AxisForces)(axes)
    if not turns:
        return forces
    moments = _WorldMoments() if len(turns) == 3 else _RightAngles(turns)
    return _Stacked(forces, moments) if len(axes) else moments


def _at_one_point(point: Array) -> Array:
    """Unit forces at a point [p; 1] of B and A, or their rates, shape (..., 3, 12)."""
    return np.asarray(point.dot(_AT_ONE).reshape(*point.shape[:-1], 3, 12))


def _at_two_points(M: Array, forces: Array = _FLAT_AT_TWO) -> Array:
    """Unit forces at the origins of B and A, or their rates, shape (..., forces, 12)."""
    origins = M[..., 3].reshape(*M.shape[:-3], 8)
    return np.asarray(origins.dot(forces).reshape(*M.shape[:-3], -1, 12))


def _axes(frame: Array) -> Array:
    """Axes of frames in rows, shape (..., 3, 3)."""
    return frame[..., :3, :3].swapaxes(-1, -2)


def _rod(M: Array) -> Array:
    """The vector from A to B, shape (..., 1, 3)."""
    return M[..., :1, :3, 3] - M[..., 1:, :3, 3]


def skew(a: Array) -> Array:
    """Cross-product matrices, shape (..., 3, 3), of vectors, shape (..., 3)."""
    return a.dot(_CROSS.swapaxes(1, 2).reshape(3, 9)).reshape(*a.shape, 3)


def cross(a: Array, b: Array) -> Array:
    """Cross products, shape (..., 3); `np.cross` takes ten times as long."""
    products = a[..., :, None] * b[..., None, :]
    return np.asarray(products.reshape(*products.shape[:-2], 9).dot(_CROSS.reshape(9, 3)))


def _dot(a: Array, b: Array) -> Array:
    return (a * b).sum(axis=-1, keepdims=True)


def _unit(d: Array) -> Array:
    """Unit vectors; zero stays zero."""
    return d / _length(d)


def _unit_rate(d: Array, d_t: Array) -> Array:
    u = _unit(d)
    return (d_t - _dot(u, d_t) * u) / _length(d)


def _length(d: Array) -> Array:
    """Lengths, shape (..., 1), also of complex vectors; 1 for zero."""
    length = np.sqrt(_dot(d, d))
    return length + (length == 0)
