# SPDX-License-Identifier: BSD-2-Clause
"""The rows of the closures: error f, Jacobian Phi and the rate of Phi, by vector formulas.

A closure connects a frame B to a frame A. Each row of Phi is a wrench W_B on B and the opposite of
a wrench W_A on A, [force; moment] at the world's origin: Phi = W_B J_B - W_A J_A, with the
Jacobians J of frames that Pinocchio calls `WORLD`: they give the velocity of the point at the
world's origin. There are two sorts of rows:

- a unit force along u at a point p of each frame: [u; p x u]; the row is the velocity along u of
  the point of B relative to that of A;
- a unit moment about n, the same on both frames: [0; n]; the row is the rate at which B turns about
  n relative to A.

The rate is Phi_dot = W_dot J + W J_dot.

Closures of one kind differ in their frames and in some lengths only. They are computed together: k
is the number of closures in all shapes here, and axes before it are those of a batch.
"""

from collections.abc import Hashable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from ..arrays import Array, Indices
from ..errors import DescriptionError
from ..model.closures import (
    Brake,
    Closure,
    Constraint,
    Coupling,
    Distance,
    ExtendedDistance,
    Rolling,
    frames_of,
)
from ..model.joint_space import JointSpace
from ..model.normal_tree import NormalTree
from ..model.tree import frame_id, joint_id

#: A closure of two frames.
FrameClosure = Closure | Distance | Rolling | Brake

#: Row i of the cross-product matrix of a vector a is the sum of a_k _SKEW[i, k].
_SKEW = np.stack([pin.skew(axis) for axis in np.eye(3)], axis=1)
_IDENTITY, _ZERO = np.eye(3), np.zeros((3, 3))


class Frames(NamedTuple):
    """One frame of each closure in the world, or the rates of their numbers."""

    #: The origins, shape (..., k, 3).
    p: Array
    #: The axes in rows, shape (..., k, 3, 3).
    axes: Array

    @classmethod
    def of(cls, matrices: Array) -> "Frames":
        """The frames of homogeneous matrices, or of their rates, shape (..., k, 4, 4)."""
        return cls(matrices[..., :3, 3], matrices[..., :3, :3].swapaxes(-1, -2))


class ForceRows(NamedTuple):
    """Unit forces and their moments about the world's origin, or the rates of these."""

    #: Forces u, shape (..., k, rows, 3).
    u: Array
    #: Moments p x u of the forces on B, shape (..., k, rows, 3).
    on_b: Array
    #: Moments p x u of the forces on A, shape (..., k, rows, 3).
    on_a: Array


# --- forces -------------------------------------------------------------------------------------


class Forces(Protocol):
    """The rows of a kind of closures that are forces. `b_t` and `a_t` are rates of frames."""

    #: Number of rows of each closure.
    rows: int

    def error(self, b: Frames, a: Frames) -> Array:
        """f, shape (k, rows), zero where a closure is closed; 0 for rows that hold rates only."""

    def forces(self, b: Frames, a: Frames) -> ForceRows:
        """The forces and their moments."""

    def rates(self, b: Frames, a: Frames, b_t: Frames, a_t: Frames) -> ForceRows:
        """Their rates."""


class _WorldForces:
    """Forces along all axes of the world, at the origins of B and A."""

    rows = 3

    def error(self, b: Frames, a: Frames) -> Array:
        return b.p - a.p

    def forces(self, b: Frames, a: Frames) -> ForceRows:
        return ForceRows(_IDENTITY, -skew(b.p), -skew(a.p))  # p x u is a row of -skew(p)

    def rates(self, b: Frames, a: Frames, b_t: Frames, a_t: Frames) -> ForceRows:
        return ForceRows(_ZERO, -skew(b_t.p), -skew(a_t.p))


class _AxisForces:
    """Forces along some axes of A, numbered from 0, at the origin of B."""

    def __init__(self, axes: list[int]) -> None:
        self.rows = len(axes)
        self._numbers = slice(None) if self.rows == 3 else axes  # a slice takes less time

    def error(self, b: Frames, a: Frames) -> Array:
        return np.vecdot(self._along(a), _one_row(b.p - a.p))

    def forces(self, b: Frames, a: Frames) -> ForceRows:
        return _at_one_point(b.p, self._along(a))

    def rates(self, b: Frames, a: Frames, b_t: Frames, a_t: Frames) -> ForceRows:
        return _rates_at_one_point(b.p, self._along(a), b_t.p, self._along(a_t))

    def _along(self, a: Frames) -> Array:
        return a.axes[..., self._numbers, :]


class _RodForces:
    """A force along the unit vector u from A to B. It has the same moment at both origins."""

    rows = 1

    def __init__(self, lengths: Array) -> None:
        self._lengths = lengths

    def error(self, b: Frames, a: Frames) -> Array:
        return (np.linalg.norm(b.p - a.p, axis=-1) - self._lengths)[:, None]

    def forces(self, b: Frames, a: Frames) -> ForceRows:
        return _at_one_point(b.p, _one_row(_unit(b.p - a.p)))

    def rates(self, b: Frames, a: Frames, b_t: Frames, a_t: Frames) -> ForceRows:
        u, u_t = _unit(b.p - a.p), _unit_rate(b.p - a.p, b_t.p - a_t.p)
        return _rates_at_one_point(b.p, _one_row(u), b_t.p, _one_row(u_t))


class _HeldLengths(_RodForces):
    """The forces of rods whose lengths brakes hold, whatever they are."""

    def __init__(self) -> None:
        super().__init__(np.zeros(0))

    def error(self, b: Frames, a: Frames) -> Array:
        return np.zeros((len(b.p), 1))


class _WheelForces:
    """Forces along the axes of the plane A at the contact of a wheel or ball B."""

    rows = 3

    def __init__(self, radii: Array, ball: bool) -> None:
        self._radii, self._ball = radii[:, None], ball

    def error(self, b: Frames, a: Frames) -> Array:
        f = np.zeros((len(b.p), 3))
        f[:, 2] = np.vecdot(a.axes[:, 2], self._contact(b, a) - a.p)  # the height
        return f

    def forces(self, b: Frames, a: Frames) -> ForceRows:
        return _at_one_point(self._contact(b, a), a.axes)

    def rates(self, b: Frames, a: Frames, b_t: Frames, a_t: Frames) -> ForceRows:
        up, up_t = self._up(b, a), self._up_rate(b, a, b_t, a_t)
        contact_t = b_t.p - self._radii * _unit_rate(up, up_t)
        return _rates_at_one_point(self._contact(b, a), a.axes, contact_t, a_t.axes)

    def _contact(self, b: Frames, a: Frames) -> Array:
        """The point of contact."""
        return np.asarray(b.p - self._radii * _unit(self._up(b, a)))

    def _up(self, b: Frames, a: Frames) -> Array:
        """The normal n of the plane; for a disc, its part normal to the axle z."""
        z, n = b.axes[..., 2, :], a.axes[..., 2, :]
        if self._ball:
            return n
        return np.asarray(n - _dot(n, z) * z)

    def _up_rate(self, b: Frames, a: Frames, b_t: Frames, a_t: Frames) -> Array:
        z, n = b.axes[..., 2, :], a.axes[..., 2, :]
        z_t, n_t = b_t.axes[..., 2, :], a_t.axes[..., 2, :]
        if self._ball:
            return n_t
        return np.asarray(n_t - (_dot(n_t, z) + _dot(n, z_t)) * z - _dot(n, z) * z_t)


# --- moments ------------------------------------------------------------------------------------


class Moments(Protocol):
    """The rows of a kind of closures that are moments."""

    #: Number of rows of each closure.
    rows: int

    def error(self, b: Frames, a: Frames) -> Array:
        """f, shape (k, rows), zero where a closure is closed."""

    def axes(self, b: Frames, a: Frames) -> Array:
        """n, about which the moments act, shape (..., k, rows, 3)."""

    def axis_rates(self, b: Frames, a: Frames, b_t: Frames, a_t: Frames) -> Array:
        """The rates of n."""


class _WorldMoments:
    """Moments about all axes of the world, for three turns that are held.

    f is the logarithm of R_B R_A^T. Phi is its Jacobian where f = 0; elsewhere the rate of a
    logarithm differs from the angular velocity, and Phi gives a good direction for Newton's method.
    """

    rows = 3

    def error(self, b: Frames, a: Frames) -> Array:
        R = b.axes.swapaxes(-1, -2) @ a.axes  # R_B R_A^T: axes are in rows
        return np.array([pin.log3(each) for each in R])

    def axes(self, b: Frames, a: Frames) -> Array:
        return _IDENTITY

    def axis_rates(self, b: Frames, a: Frames, b_t: Frames, a_t: Frames) -> Array:
        return _ZERO


class _RightAngles:
    """An axis x of A stays at a right angle to an axis y of B: f = -x . y, and n = cross(x, y).

    x and y are any axes of their frames. One row holds one turn. Two rows, with two axes x of A and
    the same y, hold two turns: then y of B stays parallel to the third axis of A. The signs of x
    are such that each row is the turn of B about the positive axis of A.

    Axes have the numbers 0, 1, 2. As 0 + 1 + 2 = 3, three minus two numbers is the third axis.
    """

    def __init__(self, turns: list[int]) -> None:
        self.rows = len(turns)
        self._two = self.rows == 2
        #: The number of y. If two turns are held, B may turn about y only.
        self._y = 3 - sum(turns) if self._two else (turns[0] + 2) % 3
        #: This matrix times the axes of A gives x of each row. x, y and the axis of the turn are
        #: the three axes.
        self._signed = np.zeros((self.rows, 3))
        for row, turn in enumerate(turns):
            x = 3 - turn - self._y
            self._signed[row, x] = 1.0 if x == (turn + 1) % 3 else -1.0

    def error(self, b: Frames, a: Frames) -> Array:
        cosines = np.vecdot(a.axes, _one_row(self._of_b(b)))
        f: Array = -cosines.dot(self._signed.T)
        if self._two:
            # Where y of B is tilted from y of A by more than 90 degrees:
            for closure in np.flatnonzero(cosines[:, self._y] < 0):
                f[closure] = _continued(f[closure])
        return f

    def axes(self, b: Frames, a: Frames) -> Array:
        return _turned(self._of_a(a), self._of_b(b))

    def axis_rates(self, b: Frames, a: Frames, b_t: Frames, a_t: Frames) -> Array:
        return _turned(self._of_a(a_t), self._of_b(b)) + _turned(self._of_a(a), self._of_b(b_t))

    def _of_a(self, a: Frames) -> Array:
        """Axis x of each row."""
        return self._signed @ a.axes

    def _of_b(self, b: Frames) -> Array:
        """Axis y."""
        return b.axes[..., self._y, :]


def _continued(f: Array) -> Array:
    """f of two right angles, shape (2,), continued beyond a tilt of 90 degrees.

    At a tilt t the size of f is sin t and Phi is as cos t, which is negative beyond 90 degrees.
    f - 2 f / |f| has the same derivative and the opposite sign, so that Newton's step -f / Phi
    reduces the tilt there too. Its size is 2 - sin t, which is continuous at 90 degrees and grows
    to two at 180 degrees.
    """
    size = np.linalg.norm(f)
    direction = f / size if size else np.array([1.0, 0.0])
    return np.asarray(f - 2 * direction)


# --- all rows of a kind -------------------------------------------------------------------------


class Formulas:
    """f, the wrenches W = [W_B, -W_A] and their rates of closures of one kind; forces come first.

    Attributes:
        rows: Number of rows of each closure.
    """

    def __init__(self, forces: Forces | None, moments: Moments | None) -> None:
        self._forces, self._moments = forces, moments
        count = forces.rows if forces else 0
        self.rows = count + (moments.rows if moments else 0)
        self._of_forces, self._of_moments = slice(0, count), slice(count, self.rows)

    def error(self, b: Frames, a: Frames) -> Array:
        """f, shape (k, rows)."""
        f = np.empty((len(b.p), self.rows))
        if self._forces:
            f[:, self._of_forces] = self._forces.error(b, a)
        if self._moments:
            f[:, self._of_moments] = self._moments.error(b, a)
        return f

    def W(self, b: Frames, a: Frames) -> Array:
        """The wrenches, shape (..., k, rows, 12)."""
        forces = self._forces.forces(b, a) if self._forces else None
        n = self._moments.axes(b, a) if self._moments else None
        return self._wrenches(b, forces, n)

    def W_dot(self, b: Frames, a: Frames, b_t: Frames, a_t: Frames) -> Array:
        """Their rates, shape (..., k, rows, 12)."""
        forces = self._forces.rates(b, a, b_t, a_t) if self._forces else None
        n = self._moments.axis_rates(b, a, b_t, a_t) if self._moments else None
        return self._wrenches(b, forces, n)

    def _wrenches(self, b: Frames, forces: ForceRows | None, n: Array | None) -> Array:
        """[force on B; moment on B; -force on A; -moment on A], shape (..., k, rows, 12)."""
        W = np.zeros((*b.p.shape[:-1], self.rows, 12), dtype=b.p.dtype)
        if forces is not None:
            W[..., self._of_forces, 0:3] = forces.u
            W[..., self._of_forces, 3:6] = forces.on_b
            W[..., self._of_forces, 6:9] = -forces.u
            W[..., self._of_forces, 9:12] = -forces.on_a
        if n is not None:
            W[..., self._of_moments, 3:6] = n
            W[..., self._of_moments, 9:12] = -n
        return W


def _at_one_point(p: Array, u: Array) -> ForceRows:
    """Forces u, shape (..., k, rows, 3), at one point p of B and A, shape (..., k, 3)."""
    moments = -(u @ skew(p))  # p x u
    return ForceRows(u, moments, moments)


def _rates_at_one_point(p: Array, u: Array, p_t: Array, u_t: Array) -> ForceRows:
    """The rates of `_at_one_point` where p and u have the rates p_t and u_t."""
    moments = -(u @ skew(p_t) + u_t @ skew(p))
    return ForceRows(u_t, moments, moments)


def _turned(x: Array, y: Array) -> Array:
    """x x y in each row, for x of shape (..., k, rows, 3) and one y, shape (..., k, 3)."""
    return np.asarray(x @ skew(y))


def _kind_of(closure: FrameClosure) -> Hashable:
    """Closures of the same kind have the same formulas."""
    if isinstance(closure, Closure):
        return closure.kind in ("6d", "3d"), closure.held
    if isinstance(closure, Rolling):
        return "rolling", closure.ball
    return type(closure).__name__


def _formulas(closures: Sequence[FrameClosure]) -> Formulas:
    """The formulas of closures of one kind."""
    first = closures[0]
    if isinstance(first, Distance):
        lengths = [closure.distance for closure in closures if isinstance(closure, Distance)]
        return Formulas(_RodForces(np.array(lengths)), None)
    if isinstance(first, Brake):
        return Formulas(_HeldLengths(), None)
    if isinstance(first, Rolling):
        radii = [closure.radius for closure in closures if isinstance(closure, Rolling)]
        return Formulas(_WheelForces(np.array(radii), first.ball), None)
    slides = [axis for axis in range(3) if first.held[axis]]
    turns = [axis for axis in range(3) if first.held[3 + axis]]
    forces: Forces | None = None
    if first.kind in ("6d", "3d"):
        forces = _WorldForces()
    elif slides:
        forces = _AxisForces(slides)
    moments: Moments | None = None
    if len(turns) == 3:
        moments = _WorldMoments()
    elif turns:
        moments = _RightAngles(turns)
    return Formulas(forces, moments)


# --- rows at a configuration --------------------------------------------------------------------


class JointMotion(NamedTuple):
    """The motion of the joints of the normal tree at rates v, with v_dot = 0, in world axes."""

    #: Rates of the model, shape (nv,).
    v: Array
    #: The part of each joint rate in the twists of the bodies that it moves, shape (rates, 6).
    twists: Array
    #: The part of each joint rate in their spatial accelerations, shape (rates, 6).
    accelerations: Array
    #: Twists of the joints at unit rates, shape (6, rates).
    J: Array
    #: The rates of J, shape (6, rates).
    J_dot: Array


class FrameRows:
    """The rows of k closures of one kind at the configuration of the last `evaluate`.

    The normal tree is the model's tree with ordinary joints in place of those that Pinocchio treats
    specially, such as mimic joints. Its `rates` are S v for the rates v of the model.

    Attributes:
        at: Where the rows are in Phi, shape (k, rows).
        formulas: f, W and its rate for any two frames.
        frames: Indices of frame B and frame A, shape (k, 2).
        bodies: Their parent joints in the normal tree, shape (k, 2).
        f: Errors of the closures, Eq. (2), shape (k, rows), [m] and [rad].
        touched: Where entries of Phi may differ from zero, shape (k, rows, nv).
        curved: Rates whose joints change entries of a row, shape (k, rows, nv).
    """

    def __init__(self, tree: NormalTree, closures: Sequence[FrameClosure], at: Indices) -> None:
        self.at, self.formulas = at, _formulas(closures)
        model = tree.model
        names = [frames_of(closure)[::-1] for closure in closures]
        self.frames = np.array([[frame_id(model, name) for name in pair] for pair in names])
        self._indices: list[int] = self.frames.ravel().tolist()  # Pinocchio takes Python's integers
        self.bodies = np.array([frame.parentJoint for frame in model.frames])[self.frames]
        # W_dot needs the whole twist of each frame, by all rates that carry it. Phi needs only the
        # rates that move one of the frames: others move both in the same way, which changes
        # nothing. Closures have different numbers of these, so that lists of them are filled up to
        # the largest number; what fills up is multiplied by zero.
        carries = tree.supports[self.bodies]
        moves = carries & ~carries[:, ::-1]
        self._carries = carries.reshape(len(names) * 2, -1).astype(float)
        moving = moves.any(axis=1)
        most = int(moving.sum(axis=1).max())
        #: The rates that move one frame of each closure, filled up with others, shape (k, most).
        self._between = np.argsort(~moving, axis=1, kind="stable")[:, :most]
        #: Which of the two frames they move, none if they fill up, shape (k, 2, 1, most).
        moves_between = np.take_along_axis(moves, self._between[:, None], axis=2)
        self._moves = moves_between[:, :, None].astype(float)
        self._S = tree.S[self._between]
        touched = moving @ (tree.S != 0)
        self.touched = self.curved = np.repeat(touched[:, None], self.formulas.rows, axis=1)

    def evaluate(self, q: Array, data: pin.Data) -> None:
        """Compute f from placements in `data`."""
        matrices = [data.oMf[frame].homogeneous for frame in self._indices]
        self._matrices = np.array(matrices).reshape(-1, 2, 4, 4)
        self._b, self._a = Frames.of(self._matrices[:, 0]), Frames.of(self._matrices[:, 1])
        self.f = self.formulas.error(self._b, self._a)
        self._W: Array | None = None

    @property
    def W(self) -> Array:
        """[W_B, -W_A], shape (k, rows, 12)."""
        if self._W is None:
            self._W = self.formulas.W(self._b, self._a)
        return self._W

    def Phi(self, J: Array) -> Array:
        """Jacobians of f, Eqs. (3), (4), shape (k, rows, nv); J as in `JointMotion`."""
        return self.W @ self._of_frames(J) @ self._S

    @property
    def largest_coordinates(self) -> Array:
        """Largest absolute coordinates of both origins in the world, shape (k,), [m]."""
        return np.asarray(np.abs(self._matrices[:, :, :3, 3]).max(axis=(1, 2)))

    def Phi_dot(self, motion: JointMotion) -> Array:
        """Rate of Phi, shape (k, rows, nv)."""
        W_dot = self._W_dot(self._carries.dot(motion.twists))
        J, J_dot = self._of_frames(motion.J), self._of_frames(motion.J_dot)
        return np.asarray((W_dot @ J + self.W @ J_dot) @ self._S)

    def drift(self, motion: JointMotion) -> Array:
        """Phi_dot v, shape (k, rows)."""
        t, t_dot = self._carries.dot(motion.twists), self._carries.dot(motion.accelerations)
        W_dot = self._W_dot(t)
        column = (len(self.at), 12, 1)
        return np.asarray(W_dot @ t.reshape(column) + self.W @ t_dot.reshape(column))[..., 0]

    def _W_dot(self, twists: Array) -> Array:
        """The rate of W at twists of B and A of each closure, in turn, shape (2 k, 6)."""
        rates = hat(twists.reshape(-1, 2, 6)) @ self._matrices
        b_t, a_t = Frames.of(rates[:, 0]), Frames.of(rates[:, 1])
        return self.formulas.W_dot(self._b, self._a, b_t, a_t)

    def _of_frames(self, J: Array) -> Array:
        """Jacobians of B and A to the rates between them, shape (k, 12, most)."""
        of_each = J.take(self._between, axis=1).swapaxes(0, 1)
        return (self._moves * of_each[:, None]).reshape(len(self.at), 12, -1)


class ExtendedRodRows(FrameRows):
    """The rows of rods that joints extend, f = |AB| - length - sum of q_j; see `FrameRows`.

    The joints add constant entries -1 to Phi. So the rates of Phi are those of other rods.
    """

    def __init__(
        self, model: pin.Model, tree: NormalTree, rods: Sequence[ExtendedDistance], at: Indices
    ) -> None:
        super().__init__(tree, rods, at)
        #: 1 for the positions and for the rates of the joints of each rod, else 0.
        self._of_q = np.zeros((len(rods), model.nq))
        self._of_v = np.zeros((len(rods), model.nv))
        for k, rod in enumerate(rods):
            for name in rod.joints:
                joint = model.joints[joint_id(model, name)]
                self._of_q[k, joint.idx_q] = 1.0
                self._of_v[k, joint.idx_v] = 1.0
        self.touched = self.touched | (self._of_v != 0)[:, None]

    def evaluate(self, q: Array, data: pin.Data) -> None:
        """Compute f from placements in `data`, and from the positions of the joints."""
        super().evaluate(q, data)
        self.f = self.f - (self._of_q @ q)[:, None]

    def Phi(self, J: Array) -> Array:
        """Jacobians of f, shape (k, 1, nv)."""
        return super().Phi(J) - self._of_v[:, None]


class CouplingRow:
    """The row of a coupling of joints that have one coordinate each; see `FrameRows`."""

    def __init__(self, model: pin.Model, coupling: Coupling, at: Indices) -> None:
        self.at = at
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

    def evaluate(self, q: Array, data: pin.Data) -> None:
        """Compute f."""
        self._q = q
        self.f = np.array([sum(float(P(q[i])) for i, _, P, *_ in self.terms) - self._offset])

    def Phi(self, J: Array) -> Array:
        """Jacobian of f, shape (1, nv)."""
        Phi = np.zeros(self.touched.shape)
        for i, k, _, P_1, _ in self.terms:
            Phi[0, k] = P_1(self._q[i])
        return Phi

    def Phi_dot(self, motion: JointMotion) -> Array:
        """Rate of Phi, shape (1, nv)."""
        Phi_dot = np.zeros(self.touched.shape)
        for i, k, _, _, P_2 in self.terms:
            Phi_dot[0, k] = P_2(self._q[i]) * motion.v[k]
        return Phi_dot

    def drift(self, motion: JointMotion) -> Array:
        """Phi_dot v, shape (1,)."""
        return self.Phi_dot(motion).dot(motion.v)


class BrakeRow(CouplingRow):
    """The row of a joint's rate that is held, at any position.

    It is a coupling without terms, whose `Phi_dot` and `drift` are therefore zero.
    """

    def __init__(self, model: pin.Model, brake: Brake, at: Indices) -> None:
        self.at, self.terms = at, []
        (self.rate,) = JointSpace(model).rates_of([brake.name])
        self.touched, self.curved = np.zeros((2, 1, model.nv), dtype=bool)
        self.touched[0, self.rate] = True
        self.f = np.zeros(1)

    def evaluate(self, q: Array, data: pin.Data) -> None:
        """Nothing: f is zero at any q."""

    def Phi(self, J: Array) -> Array:
        """The row of the rate, shape (1, nv)."""
        return self.touched.astype(float)


def rows_of(
    model: pin.Model, tree: NormalTree, closures: Sequence[Constraint]
) -> list[FrameRows | CouplingRow]:
    """All rows of the closures of a model with this normal tree."""
    ends = np.cumsum([len(closure.rows) for closure in closures])
    all_rows: list[FrameRows | CouplingRow] = []
    alike: dict[Hashable, list[tuple[FrameClosure, Indices]]] = {}
    for closure, end in zip(closures, ends, strict=True):
        at = np.arange(end - len(closure.rows), end)
        if isinstance(closure, Coupling):
            all_rows.append(CouplingRow(model, closure, at))
        elif isinstance(closure, Brake) and closure.frames is None:
            all_rows.append(BrakeRow(model, closure, at))
        else:
            alike.setdefault(_kind_of(closure), []).append((closure, at))
    for pairs in alike.values():
        of_kind = [closure for closure, _ in pairs]
        at_of_kind = np.array([at for _, at in pairs])
        extended = [closure for closure in of_kind if isinstance(closure, ExtendedDistance)]
        if extended:
            all_rows.append(ExtendedRodRows(model, tree, extended, at_of_kind))
        else:
            all_rows.append(FrameRows(tree, of_kind, at_of_kind))
    return all_rows


# --- vectors ------------------------------------------------------------------------------------


def skew(a: Array) -> Array:
    """Cross-product matrices, shape (..., 3, 3), of vectors, shape (..., 3)."""
    return a.dot(_SKEW)


def hat(twists: Array) -> Array:
    """Matrices, shape (..., 4, 4), that take homogeneous coordinates to their rates."""
    matrix = np.zeros((*twists.shape[:-1], 4, 4))
    matrix[..., :3, :3] = skew(twists[..., 3:])
    matrix[..., :3, 3] = twists[..., :3]
    return matrix


def cross(a: Array, b: Array) -> Array:
    """Cross products, shape (..., 3); `np.cross` takes several times as long."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape), dtype=np.result_type(a, b))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def _one_row(vectors: Array) -> Array:
    """Vectors with an axis for rows or points, shape (..., 1, 3)."""
    return vectors[..., None, :]


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
