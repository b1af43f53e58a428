# SPDX-License-Identifier: BSD-2-Clause
"""The rows of one closure: its error f, its Jacobian Phi and the rate of Phi, by vector formulas.

A row of Phi is a wrench W_B on frame B and the opposite of a wrench W_A on frame A, [force; moment]
at the world's origin: Phi = W_B J_B - W_A J_A, with Pinocchio's frame Jacobians J in world axes.
There are two sorts of rows:

- a unit force along u at a point p of each frame: [u; p x u]; the row is the velocity along u of
  the point of B relative to that of A;
- a unit moment about n, the same on both frames: [0; n]; the row is the rate at which B turns about
  n relative to A.

The rate is Phi_dot = W_dot J + W J_dot.
"""

from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from ..arrays import Array
from ..errors import DescriptionError
from ..model.closures import Brake, Closure, Constraint, Coupling, Distance, Rolling, frames_of
from ..model.joint_space import JointSpace
from ..model.normal_tree import NormalTree
from ..model.tree import frame_id, joint_id

#: Row i of the cross-product matrix of a vector a is the sum of a_k _SKEW[i, k].
_SKEW = np.stack([pin.skew(axis) for axis in np.eye(3)], axis=1)


class Frame(NamedTuple):
    """A frame in the world, or the rates of its numbers; leading axes are those of a batch."""

    #: The origin, shape (..., 3).
    p: Array
    #: The axes in rows, shape (..., 3, 3).
    axes: Array

    @classmethod
    def of(cls, matrix: Array) -> "Frame":
        """The frame of a homogeneous matrix, or of its rate, shape (..., 4, 4)."""
        return cls(matrix[..., :3, 3], matrix[..., :3, :3].swapaxes(-1, -2))


class Formulas(Protocol):
    """f and W of the rows of one closure, and the rate of W. `b_t` and `a_t` are rates of frames.

    W are the wrenches [W_B, -W_A], shape (..., rows, 12).
    """

    def error(self, b: Frame, a: Frame) -> Array:
        """f, shape (rows,), zero where the closure is closed; 0 for rows that hold rates only."""

    def W(self, b: Frame, a: Frame) -> Array:
        """The wrenches."""

    def W_dot(self, b: Frame, a: Frame, b_t: Frame, a_t: Frame) -> Array:
        """Their rates."""


class _WorldForces:
    """Forces along axes of the world, shape (rows, 3), at the origins of B and A."""

    def __init__(self, axes: Array) -> None:
        self._u = axes

    def error(self, b: Frame, a: Frame) -> Array:
        return self._u @ (b.p - a.p)

    def W(self, b: Frame, a: Frame) -> Array:
        return _opposed(_forces(b.p, self._u), _forces(a.p, self._u))

    def W_dot(self, b: Frame, a: Frame, b_t: Frame, a_t: Frame) -> Array:
        on_b, on_a = -self._u @ skew(b_t.p), -self._u @ skew(a_t.p)
        return _opposed(_moments(on_b), _moments(on_a))


class _AxisForces:
    """Forces along axes of A, numbered from 0, at the origin of B."""

    def __init__(self, axes: list[int]) -> None:
        self._numbers = axes

    def error(self, b: Frame, a: Frame) -> Array:
        return self._along(a) @ (b.p - a.p)

    def W(self, b: Frame, a: Frame) -> Array:
        forces = _forces(b.p, self._along(a))
        return _opposed(forces, forces)

    def W_dot(self, b: Frame, a: Frame, b_t: Frame, a_t: Frame) -> Array:
        rates = _force_rates(b.p, self._along(a), b_t.p, self._along(a_t))
        return _opposed(rates, rates)

    def _along(self, a: Frame) -> Array:
        return a.axes[..., self._numbers, :]


class _RodForce:
    """A force along the unit vector from A to B at both origins."""

    def __init__(self, length: float) -> None:
        self._length = length

    def error(self, b: Frame, a: Frame) -> Array:
        return np.array([np.linalg.norm(b.p - a.p) - self._length])

    def W(self, b: Frame, a: Frame) -> Array:
        u = _one_row(_unit(b.p - a.p))
        return _opposed(_forces(b.p, u), _forces(a.p, u))

    def W_dot(self, b: Frame, a: Frame, b_t: Frame, a_t: Frame) -> Array:
        u, u_t = _one_row(_unit(b.p - a.p)), _one_row(_unit_rate(b.p - a.p, b_t.p - a_t.p))
        on_b, on_a = _force_rates(b.p, u, b_t.p, u_t), _force_rates(a.p, u, a_t.p, u_t)
        return _opposed(on_b, on_a)


class _HeldLength(_RodForce):
    """The force of a rod that has the length which it is found with."""

    def __init__(self) -> None:
        super().__init__(0.0)

    def error(self, b: Frame, a: Frame) -> Array:
        return np.zeros(1)


class _WheelForces:
    """Forces along the axes of the plane A at the contact of a wheel or ball B."""

    def __init__(self, closure: Rolling) -> None:
        self._radius, self._ball = closure.radius, closure.ball

    def error(self, b: Frame, a: Frame) -> Array:
        height = a.axes[2] @ (self._contact(b, a) - a.p)
        return np.array([0.0, 0.0, height])

    def W(self, b: Frame, a: Frame) -> Array:
        forces = _forces(self._contact(b, a), a.axes)
        return _opposed(forces, forces)

    def W_dot(self, b: Frame, a: Frame, b_t: Frame, a_t: Frame) -> Array:
        up, up_t = self._up(b, a), self._up_rate(b, a, b_t, a_t)
        contact_t = b_t.p - self._radius * _unit_rate(up, up_t)
        rates = _force_rates(self._contact(b, a), a.axes, contact_t, a_t.axes)
        return _opposed(rates, rates)

    def _contact(self, b: Frame, a: Frame) -> Array:
        """The point of contact."""
        return np.asarray(b.p - self._radius * _unit(self._up(b, a)))

    def _up(self, b: Frame, a: Frame) -> Array:
        """The normal n of the plane; for a disc, its part normal to the axle z."""
        z, n = b.axes[..., 2, :], a.axes[..., 2, :]
        if self._ball:
            return n
        return np.asarray(n - _dot(n, z) * z)

    def _up_rate(self, b: Frame, a: Frame, b_t: Frame, a_t: Frame) -> Array:
        z, n = b.axes[..., 2, :], a.axes[..., 2, :]
        z_t, n_t = b_t.axes[..., 2, :], a_t.axes[..., 2, :]
        if self._ball:
            return n_t
        return np.asarray(n_t - (_dot(n_t, z) + _dot(n, z_t)) * z - _dot(n, z) * z_t)


class _WorldMoments:
    """Moments about all axes of the world."""

    def error(self, b: Frame, a: Frame) -> Array:
        return pin.log3(b.axes.T @ a.axes)

    def W(self, b: Frame, a: Frame) -> Array:
        moments = _moments(np.broadcast_to(np.eye(3), b.axes.shape))
        return _opposed(moments, moments)

    def W_dot(self, b: Frame, a: Frame, b_t: Frame, a_t: Frame) -> Array:
        return np.zeros((*b.axes.shape[:-2], 3, 12), dtype=b.axes.dtype)


class _RightAngles:
    """One or two moments about x x y: axis x of A stays at a right angle to axis y of B."""

    def __init__(self, turns: list[int]) -> None:
        #: The axis that stays parallel, if two are at right angles.
        self._parallel = 3 - sum(turns) if len(turns) == 2 else None
        #: For each row the number of axis y, the number of axis x, and the sign of x.
        self._y, self._x = list[int](), list[int]()
        signs = list[float]()
        for turn in turns:
            y = (turn + 2) % 3 if self._parallel is None else self._parallel
            x = 3 - turn - y
            self._y.append(y)
            self._x.append(x)
            signs.append(1.0 if x == (turn + 1) % 3 else -1.0)
        self._signs = np.array(signs)[:, None]

    def error(self, b: Frame, a: Frame) -> Array:
        f: Array = -_dot(self._of_a(a), self._of_b(b))[:, 0]
        k = self._parallel
        if k is not None and a.axes[k] @ b.axes[k] < 0:
            # Their angle exceeds a right angle: continue f so that Newton's steps still reduce it.
            size = np.linalg.norm(f)
            f -= 2 * (f / size if size else np.array([1.0, 0.0]))
        return f

    def W(self, b: Frame, a: Frame) -> Array:
        moments = _moments(cross(self._of_a(a), self._of_b(b)))
        return _opposed(moments, moments)

    def W_dot(self, b: Frame, a: Frame, b_t: Frame, a_t: Frame) -> Array:
        x, y, x_t, y_t = self._of_a(a), self._of_b(b), self._of_a(a_t), self._of_b(b_t)
        rates = _moments(cross(x_t, y) + cross(x, y_t))
        return _opposed(rates, rates)

    def _of_a(self, a: Frame) -> Array:
        """Axis x of each row."""
        return np.asarray(self._signs * a.axes[..., self._x, :])

    def _of_b(self, b: Frame) -> Array:
        """Axis y of each row."""
        return b.axes[..., self._y, :]


class _Stacked:
    """Forces, then moments."""

    def __init__(self, *parts: Formulas) -> None:
        self._parts = parts

    def error(self, b: Frame, a: Frame) -> Array:
        return np.concatenate([part.error(b, a) for part in self._parts])

    def W(self, b: Frame, a: Frame) -> Array:
        return np.concatenate([part.W(b, a) for part in self._parts], axis=-2)

    def W_dot(self, b: Frame, a: Frame, b_t: Frame, a_t: Frame) -> Array:
        return np.concatenate([part.W_dot(b, a, b_t, a_t) for part in self._parts], axis=-2)


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
        self._between = np.flatnonzero(moves_b != moves_a)
        self._moves_b = moves_b[self._between].astype(float)
        self._moves_a = moves_a[self._between].astype(float)
        self._S = tree.S[self._between]
        self.touched = self.curved = np.tile(self._S.any(axis=0), (len(closure.rows), 1))

    def evaluate(self, q: Array, data: pin.Data, J: Array) -> None:
        """f, W and Phi, from placements in `data`; J are the twists of the joints, (6, rates)."""
        self._matrices = [data.oMf[frame].homogeneous for frame in self.frames]
        self._b, self._a = map(Frame.of, self._matrices)
        self.f = self.formulas.error(self._b, self._a)
        self.W = self.formulas.W(self._b, self._a)
        self._J = self._of_frames(J)
        self.Phi = self.W.dot(self._J).dot(self._S)  # Eqs. (3), (4)

    @property
    def largest_coordinate(self) -> float:
        """Largest absolute coordinate of both origins in the world, [m]."""
        return float(max(np.abs(self._b.p).max(), np.abs(self._a.p).max()))

    def Phi_dot(self, v: Array, data: pin.Data, J_dot: Array) -> Array:
        """Rate of Phi, shape (rows, nv); velocities in `data` and the rates of J are at v."""
        W_dot = self._W_dot(self._twists(data))
        return (W_dot.dot(self._J) + self.W.dot(self._of_frames(J_dot))).dot(self._S)

    def drift(self, v: Array, data: pin.Data) -> Array:
        """Phi_dot v, shape (rows,); `data` has velocities, and accelerations with v_dot = 0."""
        twists = self._twists(data)
        rates = [
            pin.getFrameAcceleration(self._model, data, frame, pin.WORLD).vector
            for frame in self.frames
        ]
        t, t_dot = np.concatenate([twist.vector for twist in twists]), np.concatenate(rates)
        return self._W_dot(twists).dot(t) + self.W.dot(t_dot)

    def _twists(self, data: pin.Data) -> list[pin.Motion]:
        """Twists of B and A, world axes at the world's origin."""
        return [pin.getFrameVelocity(self._model, data, k, pin.WORLD) for k in self.frames]

    def _W_dot(self, twists: list[pin.Motion]) -> Array:
        b_t, a_t = (
            Frame.of(twist.homogeneous.dot(matrix))
            for twist, matrix in zip(twists, self._matrices, strict=True)
        )
        return self.formulas.W_dot(self._b, self._a, b_t, a_t)

    def _of_frames(self, J: Array) -> Array:
        """Jacobians of B and A to the joints between them, shape (12, joints)."""
        between = J.take(self._between, axis=1)
        return np.concatenate([between * self._moves_b, between * self._moves_a])


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
    parts = list[Formulas]()
    slides, turns = (
        [k for k in range(3) if held[k]] for held in (closure.held[:3], closure.held[3:])
    )
    if slides and closure.kind in ("6d", "3d"):
        parts.append(_WorldForces(np.eye(3)))
    elif slides:
        parts.append(_AxisForces(slides))
    if len(turns) == 3:
        parts.append(_WorldMoments())
    elif turns:
        parts.append(_RightAngles(turns))
    if len(parts) == 1:
        return parts[0]
    return _Stacked(*parts)


def _forces(p: Array, u: Array) -> Array:
    """Unit forces along u, shape (..., rows, 3), at a point p, (..., 3): [u; p x u]."""
    return _wrenches(u, -u @ skew(p))


def _force_rates(p: Array, u: Array, p_t: Array, u_t: Array) -> Array:
    """Rates of `_forces` where p and u have the rates p_t and u_t."""
    return _wrenches(u_t, -u_t @ skew(p) - u @ skew(p_t))


def _moments(n: Array) -> Array:
    """Moments n, shape (..., rows, 3): [0; n]."""
    return _wrenches(0.0, n)


def _wrenches(force: Array | float, moment: Array) -> Array:
    """[force; moment], shape (..., rows, 6)."""
    wrenches = np.empty((*moment.shape[:-1], 6), dtype=moment.dtype)
    wrenches[..., :3] = force
    wrenches[..., 3:] = moment
    return wrenches


def _opposed(on_b: Array, on_a: Array) -> Array:
    """[W_B, -W_A], shape (..., rows, 12)."""
    return np.concatenate([on_b, -on_a], axis=-1)


def _one_row(vector: Array) -> Array:
    """Vectors with an axis for rows, shape (..., 1, 3)."""
    return vector[..., None, :]


def skew(a: Array) -> Array:
    """Cross-product matrices, shape (..., 3, 3), of vectors, shape (..., 3)."""
    return a.dot(_SKEW)


def cross(a: Array, b: Array) -> Array:
    """Cross products, shape (..., 3); `np.cross` takes several times as long."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape), dtype=np.result_type(a, b))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


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
