# SPDX-License-Identifier: BSD-2-Clause
"""Residual f(q) of the constraints, their Jacobian Phi and its rate, at one configuration.

Pinocchio's joint Jacobian J in world axes, reduced at the world's origin, holds the unit twist of
every rate. The twist of a frame is J with the columns left out that do not move it. Each row of a
closure is a wrench-like vector W in world axes with W . (twist of B - twist of A) = 0, so that
Phi = (W J) S_B - (W J) S_A with the supports S of 0 and 1. A mimic joint has a column of its own in
J, scaled already; it is added to that of the joint that it follows at the end. Pinocchio's own
constraint functions are not used, they are wrong or NaN in silence on redundant loops.

Rows run [linear; angular], as Pinocchio's do; the paper's order comes in with the bodies' twists.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from ..errors import ClosureError, DescriptionError, InputError, UnknownNameError
from .closures import Closure, Constraint, Coupling, Distance, Rolling, frames_of

Array = NDArray[np.float64]

#: Loops further open than this are open, relative to the length of the robot or in [rad].
CLOSURE_TOLERANCE = 1e-6
_AXES = np.eye(3)


class Rates(NamedTuple):
    """Motion of the two frames of a closure, world axes.

    Attributes:
        p_a, p_b: Velocities of their origins, shape (3,).
        omega_a, omega_b: Angular velocities, shape (3,).
    """

    p_a: Array
    p_b: Array
    omega_a: Array
    omega_b: Array


class Loops:
    """Closures of one tree with memory of their own: one object per thread.

    `evaluate(q)` computes what depends on q; all other methods speak of that configuration.

    Args:
        model: The tree; it must not change afterwards.
        closures: What closes it.

    Raises:
        UnknownNameError: For a frame or joint that the model does not have.
        DescriptionError: For a coupling of joints that have several coordinates.
    """

    def __init__(self, model: pin.Model, closures: Sequence[Constraint]) -> None:
        self.model, self.data = model, model.createData()
        self._rates = rates_of_columns(model)
        starts = np.cumsum([0, *(len(c.rows) for c in closures)])
        slices = [slice(a, b) for a, b in pairwise(starts)]
        self.rows = int(starts[-1])
        #: Rows of each closure.
        self.slices = tuple(slices)
        #: Rows that have a residual; the others hold rates only.
        self.holonomic = np.array([not row.startswith("slip") for c in closures for row in c.rows])
        self._couplings: list[tuple[slice, _Coupled]] = []
        self._S_a, self._S_b = np.zeros((2, self.rows, model.nvExtended))
        self._W, self._W_dot = np.zeros((2, self.rows, 6))  # at B
        self._W_a, self._W_a_dot = np.zeros((2, self.rows, 6))
        self._pairs = []
        placements = self.data.oMf
        for rows, closure in zip(slices, closures, strict=True):
            if isinstance(closure, Coupling):
                self._couplings.append((rows, _Coupled(model, closure)))
                continue
            ids = [frame_id(model, name) for name in frames_of(closure)]
            supports = [support(model, model.frames[f].parentJoint) for f in ids]
            self._S_a[rows], self._S_b[rows] = supports
            kind = _kind_of(closure)
            kind.constant(self._W[rows], self._W_a[rows])
            self._pairs.append((rows, kind, placements[ids[0]], placements[ids[1]], *supports))
        #: Which rates a row depends on: those that move one of its two frames only.
        self.touched = summed(self.model, self._S_a != self._S_b).astype(bool)
        for rows, coupled in self._couplings:
            self.touched[rows] = coupled.touched
        self._moving = [pair for pair in self._pairs if not pair[1].fixed]
        # Rows that are the same at both frames see the relative twist alone.
        one_row = all(kind.same_row for _, kind, *_ in self._pairs)
        self._relative = self._S_b - self._S_a if one_row else None
        self._welds_only = not self._couplings and all(
            isinstance(kind, _Weld) and len(kind.held) == 6 for _, kind, *_ in self._pairs
        )
        self._at = [(kind, A, B, self._W[r], self._W_a[r]) for r, kind, A, B, *_ in self._moving]
        self._fresh = False
        self._J, self._J_dot = self.data.J, self.data.dJ
        several = ((j, _series(joint)) for j, joint in enumerate(model.joints) if j > 0)
        self._in_series = [_InSeries(model, j, s) for j, s in several if len(s) > 1]

    def evaluate(self, q: Array) -> None:
        """Compute what depends on q."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        self._q, self._fresh = q, False

    def _update_wrenches(self) -> None:
        """Compute W, once for each configuration."""
        if not self._fresh:
            for kind, A, B, W, W_a in self._at:
                kind.wrenches(A, B, W, W_a)
            self._fresh = True

    def residual(self) -> Array:
        """f(q) of Eq. (2), shape (rows,), [m] and [rad], zero when the loops are closed."""
        f = np.zeros(self.rows)
        for rows, kind, A, B, *_ in self._pairs:
            f[rows] = kind.residual(A, B)
        for rows, coupled in self._couplings:
            f[rows] = coupled.residual(self._q)
        return f

    def coincide(self, tolerance: float) -> bool:
        """Whether all frames are welded and coincide: at a third of the time of `residual`."""
        return self._welds_only and all(
            A.actInv(B).isIdentity(tolerance) for _, _, A, B, *_ in self._pairs
        )

    def require_closed(self, scale: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """Check that all loops are closed.

        Args:
            scale: Of each row, by which its residual is multiplied, shape (rows,).
            tolerance: Of the scaled residual.

        Raises:
            InputError: When q is not finite.
            ClosureError: When a loop is open.
        """
        f = self.residual()
        if not (np.abs(f) * scale).max(initial=0.0) <= tolerance:
            residual = float(np.abs(f).max())
            if np.isnan(residual):
                raise InputError("q", "not finite")
            raise ClosureError(
                f"the loops are open by {residual:.3g} (m or rad), more than {tolerance:g} of the "
                "robot's length or rad; assemble(q) closes them",
                residual,
            )

    def Phi(self) -> Array:
        """Jacobian of the closures, shape (rows, nv): Phi v = 0, Eqs. (3), (4)."""
        self._update_wrenches()
        Phi = self._at_both(self._W.dot(self._J), self._W_a, self._J)
        Phi = summed(self.model, Phi)
        for rows, coupled in self._couplings:
            Phi[rows] = coupled.row(self._q)
        return Phi

    def Phi_dot(self, v: Array) -> Array:
        """Rate of Phi at rates v of the tree, shape (rows, nv)."""
        pin.computeJointJacobiansTimeVariation(self.model, self.data, self._q, v)
        for joint in self._in_series:
            joint.correct(self.data, self._q, v)
        J, J_dot = self._J, self._J_dot
        self._update_wrenches()
        of_columns = v[self._rates]
        for rows, kind, A, B, S_a, S_b in self._moving:
            twist_a, twist_b = J.dot(S_a * of_columns), J.dot(S_b * of_columns)
            p_a = twist_a[:3] + _cross(twist_a[3:], A.translation)
            p_b = twist_b[:3] + _cross(twist_b[3:], B.translation)
            rates = Rates(p_a, p_b, twist_a[3:], twist_b[3:])
            kind.wrench_rates(A, B, rates, self._W_dot[rows], self._W_a_dot[rows])
        Phi_dot = self._at_both(self._W.dot(J_dot), self._W_a, J_dot)
        if self._moving:
            Phi_dot += self._at_both(self._W_dot.dot(J), self._W_a_dot, J)
        Phi_dot = summed(self.model, Phi_dot)
        for rows, coupled in self._couplings:
            Phi_dot[rows] = coupled.row_rate(self._q, v)
        return Phi_dot

    def _at_both(self, at_b: Array, W_a: Array, J: Array) -> Array:
        """Rows at frame B, for what moves it, less those at frame A, for what moves that."""
        if self._relative is not None:
            return at_b * self._relative
        return at_b * self._S_b - W_a.dot(J) * self._S_a


class _Coupled:
    """A coupling as a row on the rates of one-coordinate joints."""

    def __init__(self, model: pin.Model, coupling: Coupling) -> None:
        self._nv = model.nv
        terms = [(coupling.joint, Polynomial([0.0, 1.0]), 1.0)]
        terms += [(name, Polynomial(p or (0.0,)), -1.0) for name, p in coupling.polynomials.items()]
        self._terms, self._offset = [], coupling.offset
        for name, polynomial, sign in terms:
            joint = model.joints[joint_id(model, name)]
            if (joint.nq, joint.nv) != (1, 1):
                problem = f"joint {name} has {joint.nq} coordinates; couplings take one"
                raise DescriptionError(str(coupling), [problem])
            P = sign * polynomial
            self._terms.append((joint.idx_q, joint.idx_v, P, P.deriv(), P.deriv(2)))

    @property
    def touched(self) -> NDArray[np.bool_]:
        return np.isin(np.arange(self._nv), [k for _, k, *_ in self._terms])

    def residual(self, q: Array) -> float:
        return sum(float(P(q[i])) for i, _, P, *_ in self._terms) - self._offset

    def row(self, q: Array) -> Array:
        row = np.zeros(self._nv)
        for i, k, _, P_1, _ in self._terms:
            row[k] = P_1(q[i])
        return row

    def row_rate(self, q: Array, v: Array) -> Array:
        row = np.zeros(self._nv)
        for i, k, _, _, P_2 in self._terms:
            row[k] = P_2(q[i]) * v[k]
        return row


class _InSeries:
    """A joint that is several in series: its axes move, which Pinocchio leaves out of J_dot.

    Args:
        model: The tree.
        index: Of the joint.
        series: The joints that it consists of, each after its placement.
    """

    def __init__(self, model: pin.Model, index: int, series: Sequence[tuple[Any, pin.SE3]]) -> None:
        joint = model.joints[index]
        self._q = slice(joint.idx_q, joint.idx_q + joint.nq)
        self._v = slice(joint.idx_v, joint.idx_v + joint.nv)
        self._columns = columns(model, index)
        self._parent, self._placement = model.parents[index], model.jointPlacements[index]
        self._model = pin.Model()
        for number, (part, placement) in enumerate(series):
            self._model.addJoint(number, part, placement, str(number))
        self._data = self._model.createData()

    def correct(self, data: pin.Data, q: Array, v: Array) -> None:
        """Put the joint's columns of J_dot right; positions and velocities are up to date."""
        arguments = (self._model, self._data, q[self._q], v[self._v])
        inner = pin.computeJointJacobiansTimeVariation(*arguments)
        bearer = data.oMi[self._parent]
        carried = bearer.act(data.v[self._parent]).action @ data.J[:, self._columns]
        data.dJ[:, self._columns] = carried + (bearer * self._placement).action @ inner


def _series(joint: Any) -> list[tuple[Any, pin.SE3]]:
    """The joints of one axis, or of fixed axes, that a joint consists of, with placements."""
    short, here = joint.shortname(), pin.SE3.Identity()
    if short == "JointModelSphericalZYX":
        axes = (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)
        return [(axis(), here) for axis in axes]
    joint = joint.extract() if hasattr(joint, "extract") else joint
    if short == "JointModelUniversal":
        both = (joint.axis1, joint.axis2)
        return [(pin.JointModelRevoluteUnaligned(np.array(axis)), here) for axis in both]
    if short != "JointModelComposite":
        return [(joint, here)]
    found: list[tuple[Any, pin.SE3]] = []
    for part, placement in zip(joint.joints, joint.jointPlacements, strict=True):
        first, *rest = _series(part)
        found += [(first[0], placement * first[1]), *rest]
    return found


class _Weld:
    """6d: the displacement from A to B as a screw in world axes; its rate is the relative twist."""

    fixed = same_row = True
    held = np.eye(6)

    def __init__(self, closure: Closure) -> None:
        pass

    def constant(self, W: Array, W_a: Array) -> None:
        W[:] = W_a[:] = self.held

    def residual(self, A: pin.SE3, B: pin.SE3) -> Array:
        return pin.log6(B * A.inverse()).vector


class _Orientation(_Weld):
    held = np.eye(6)[3:]

    def residual(self, A: pin.SE3, B: pin.SE3) -> Array:
        return pin.log3(B.rotation @ A.rotation.T)


class _Moving:
    """A kind whose W moves with the frames."""

    fixed, same_row = False, True

    def constant(self, W: Array, W_a: Array) -> None:
        pass


class _Point(_Moving):
    """3d: the origins coincide; rows in world axes at each origin."""

    same_row = False

    def __init__(self, closure: Closure) -> None:
        pass

    def constant(self, W: Array, W_a: Array) -> None:
        W[:, :3] = W_a[:, :3] = _AXES

    def residual(self, A: pin.SE3, B: pin.SE3) -> Array:
        return B.translation - A.translation

    def wrenches(self, A: pin.SE3, B: pin.SE3, W: Array, W_a: Array) -> None:
        _put_moments(W, B.translation)
        _put_moments(W_a, A.translation)

    def wrench_rates(self, A: pin.SE3, B: pin.SE3, r: Rates, W: Array, W_a: Array) -> None:
        _put_moments(W, r.p_b)
        _put_moments(W_a, r.p_a)


class _Masked(_Moving):
    """Any choice of held motions of B in the axes of A."""

    def __init__(self, closure: Closure) -> None:
        held = closure.held
        self._slides = [k for k in range(3) if held[k]]
        turns = [k for k in range(3) if held[3 + k]]
        self._orientation = len(turns) == 3
        # An axis a of A and an axis b of B that stay at a right angle: with one free turn about k,
        # the two others of A against k of B; with one held turn k, the two others of A and B.
        self._angles: list[tuple[int, int, float]] = []
        self._along: int | None = None
        if len(turns) == 2:
            (self._along,) = set(range(3)) - set(turns)
            i, j = (self._along + 1) % 3, (self._along + 2) % 3
            # The turn about i moves b = k against a = j, by minus its rate; about j against i.
            of_turn = {i: (j, self._along, -1.0), j: (i, self._along, 1.0)}
            self._angles = [of_turn[k] for k in turns]
        elif len(turns) == 1:
            (k,) = turns
            self._angles = [((k + 1) % 3, (k + 2) % 3, -1.0)]

    def residual(self, A: pin.SE3, B: pin.SE3) -> Array:
        R_a, R_b = A.rotation, B.rotation
        slid = (B.translation - A.translation).dot(R_a)[self._slides]
        if self._orientation:
            return np.concatenate((slid, pin.log3(R_b @ R_a.T)))
        R = R_a.T @ R_b
        angles = np.array([sign * R[i, j] for i, j, sign in self._angles])
        if self._along is not None and R[self._along, self._along] < 0:
            # The axes are opposed: lead on in the same direction, over the right angle.
            size = float(np.linalg.norm(angles))
            angles = angles - 2 * (angles / size if size else np.eye(len(angles))[0])
        return np.concatenate((slid, angles))

    def wrenches(self, A: pin.SE3, B: pin.SE3, W: Array, W_a: Array) -> None:
        R_a, R_b = A.rotation, B.rotation
        for row, k in enumerate(self._slides):
            W[row, :3] = R_a[:, k]
            W[row, 3:] = _cross(B.translation, R_a[:, k])
        first = len(self._slides)
        if self._orientation:
            W[first:, 3:] = _AXES
        for row, (i, j, sign) in enumerate(self._angles, start=first):
            W[row, 3:] = sign * _cross(R_b[:, j], R_a[:, i])
        W_a[:] = W

    def wrench_rates(self, A: pin.SE3, B: pin.SE3, r: Rates, W: Array, W_a: Array) -> None:
        R_a, R_b = A.rotation, B.rotation
        for row, k in enumerate(self._slides):
            n, n_dot = R_a[:, k], _cross(r.omega_a, R_a[:, k])
            W[row, :3] = n_dot
            W[row, 3:] = _cross(r.p_b, n) + _cross(B.translation, n_dot)
        for row, (i, j, sign) in enumerate(self._angles, start=len(self._slides)):
            a, b = R_a[:, i], R_b[:, j]
            moved = _cross(_cross(r.omega_b, b), a) + _cross(b, _cross(r.omega_a, a))
            W[row, 3:] = sign * moved
        W_a[:] = W


class _Rod(_Moving):
    same_row = False

    def __init__(self, rod: Distance) -> None:
        self._length = rod.distance

    def residual(self, A: pin.SE3, B: pin.SE3) -> Array:
        return np.array([np.linalg.norm(B.translation - A.translation) - self._length])

    def wrenches(self, A: pin.SE3, B: pin.SE3, W: Array, W_a: Array) -> None:
        d = B.translation - A.translation
        u = d / max(float(np.linalg.norm(d)), 1e-300)
        W[0, :3] = W_a[0, :3] = u
        W[0, 3:], W_a[0, 3:] = _cross(B.translation, u), _cross(A.translation, u)

    def wrench_rates(self, A: pin.SE3, B: pin.SE3, r: Rates, W: Array, W_a: Array) -> None:
        d, d_dot = B.translation - A.translation, r.p_b - r.p_a
        length = max(float(np.linalg.norm(d)), 1e-300)
        u = d / length
        u_dot = (d_dot - u * u.dot(d_dot)) / length
        W[0, :3] = W_a[0, :3] = u_dot
        W[0, 3:] = _cross(r.p_b, u) + _cross(B.translation, u_dot)
        W_a[0, 3:] = _cross(r.p_a, u) + _cross(A.translation, u_dot)


class _Wheel(_Moving):
    """Rows x, y, z of the plane: velocity of the wheel at the contact, relative to the plane."""

    def __init__(self, rolling: Rolling) -> None:
        self._radius, self._ball = rolling.radius, rolling.ball

    def _up(self, A: pin.SE3, B: pin.SE3) -> tuple[Array, Array, float]:
        """From the contact to the centre as a unit vector, and what it is made of."""
        n, z = A.rotation[:, 2], B.rotation[:, 2]
        g = n if self._ball else n - n.dot(z) * z
        size = max(float(np.linalg.norm(g)), 1e-300)
        return g / size, z, size

    def residual(self, A: pin.SE3, B: pin.SE3) -> Array:
        up, _, _ = self._up(A, B)
        contact = B.translation - self._radius * up
        return np.array([0.0, 0.0, A.rotation[:, 2].dot(contact - A.translation)])

    def wrenches(self, A: pin.SE3, B: pin.SE3, W: Array, W_a: Array) -> None:
        contact = B.translation - self._radius * self._up(A, B)[0]
        for k in range(3):
            n = A.rotation[:, k]
            W[k, :3], W[k, 3:] = n, _cross(contact, n)
        W_a[:] = W

    def wrench_rates(self, A: pin.SE3, B: pin.SE3, r: Rates, W: Array, W_a: Array) -> None:
        up, z, size = self._up(A, B)
        n = A.rotation[:, 2]
        g_dot = n_dot = _cross(r.omega_a, n)
        if not self._ball:
            z_dot = _cross(r.omega_b, z)
            g_dot = n_dot - (n_dot.dot(z) + n.dot(z_dot)) * z - n.dot(z) * z_dot
        up_dot = (g_dot - up * up.dot(g_dot)) / size
        contact = B.translation - self._radius * up
        contact_dot = r.p_b - self._radius * up_dot
        for k in range(3):
            n = A.rotation[:, k]
            n_dot = _cross(r.omega_a, n)
            W[k, :3] = n_dot
            W[k, 3:] = _cross(contact_dot, n) + _cross(contact, n_dot)
        W_a[:] = W


def _kind_of(closure: Closure | Distance | Rolling) -> Any:
    if isinstance(closure, Distance):
        return _Rod(closure)
    if isinstance(closure, Rolling):
        return _Wheel(closure)
    kinds = {"6d": _Weld, "orientation": _Orientation, "3d": _Point}
    kind = kinds.get(closure.kind, _Masked) if isinstance(closure.kind, str) else _Masked
    return kind(closure)


def _cross(a: Array, b: Array) -> Array:
    """A tenth of the time of np.cross for one pair of vectors."""
    return np.array(
        (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    )


def _skew(a: Array) -> Array:
    x, y, z = a
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


def _put_moments(W: Array, p: Array) -> None:
    """Moments p x e_k of the three axes into the rows of W."""
    x, y, z = p.tolist()
    W[0, 4], W[0, 5] = z, -y
    W[1, 3], W[1, 5] = -z, x
    W[2, 3], W[2, 4] = y, -x


def frame_id(model: pin.Model, name: str) -> int:
    """Index of a frame; a joint and a link of one name are one frame where they coincide.

    Raises:
        UnknownNameError: When there is none of that name.
        DescriptionError: When several frames of that name lie at different places.
    """
    found = [i for i, frame in enumerate(model.frames) if frame.name == name]
    if not found:
        raise UnknownNameError("frame", name, [f.name for f in model.frames])
    first = model.frames[found[0]]
    for i in found[1:]:
        other = model.frames[i]
        if other.parentJoint != first.parentJoint or other.placement != first.placement:
            raise DescriptionError(
                f"frame {name}", ["several frames have this name, at different places; rename one"]
            )
    return found[0]


def joint_id(model: pin.Model, name: str) -> int:
    """Index of a joint of the tree.

    Raises:
        UnknownNameError: When there is none of that name.
    """
    names = list(model.names)[1:]
    if name not in names:
        raise UnknownNameError("joint", name, names)
    return names.index(name) + 1


def support(model: pin.Model, joint: int) -> Array:
    """1 for the columns of J that move a joint's body, 0 for the others, shape (nvExtended,)."""
    support = np.zeros(model.nvExtended)
    for j in model.supports[joint]:
        if j > 0:
            support[columns(model, j)] = 1
    return support


def columns(model: pin.Model, joint: int) -> slice:
    """Columns of a joint in J."""
    first = model.joints[joint].idx_vExtended
    return slice(first, first + model.joints[joint].nvExtended)


def rates_of_columns(model: pin.Model) -> NDArray[np.intp]:
    """For each column of J its rate in v: for a mimic joint that of the joint that it follows."""
    rates = np.empty(model.nvExtended, dtype=np.intp)
    for j in range(1, model.njoints):
        at = columns(model, j)
        rates[at] = np.arange(at.stop - at.start) + model.joints[j].idx_v
    return rates


def summed(model: pin.Model, X: Array) -> Array:
    """From columns of J, shape (..., nvExtended), to rates, shape (..., nv)."""
    if model.nvExtended == model.nv:
        return X
    return X.dot(np.eye(model.nv)[rates_of_columns(model)])
