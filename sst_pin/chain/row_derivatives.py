# SPDX-License-Identifier: BSD-2-Clause
"""Partial derivatives on the tree of the closures' rows: of Phi v and of its rate.

Each kind of closure writes its wrenches W, Phi = W J, once, for `Jet`s. Derivatives by q are taken
along each rate of the tree, as Pinocchio's are. Twists and wrenches run [linear; angular], in world
axes, reduced at the world's origin.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from . import closure_kinds as kinds
from .closures import Coupling, frames_of
from .couplings import Coupled
from .jets import Jet
from .mechanism import Mechanism
from .tree import frame_id, of_rates, support
from .vectors import brackets, skew

Array = NDArray[np.float64]


class Frame:
    """A frame, its twist and the derivatives of its motion.

    Attributes:
        joint: The joint that moves it.
        J: Its twist per rate of the tree, shape (6, nv).
        twist, acceleration: Spatial, shape (6,).
        twist_q, acceleration_q, acceleration_v: Their derivatives, shape (6, nv).
        p: Its origin.
    """

    def __init__(self, tree: Tree, joint: int, placement: pin.SE3) -> None:
        support = tree.support(joint)
        J, J_dot = tree.J * support, tree.J_dot * support
        self.joint = joint
        self.J, self.twist = J, J.dot(tree.v)
        self.acceleration = J.dot(tree.v_dot) + J_dot.dot(tree.v)
        # A rate turns all that moves between its joint and the frame.
        at, at_2 = _bracket_matrix(self.twist), _bracket_matrix(self.acceleration)
        borne = tree.borne * support
        self.twist_q = -at.dot(J) - borne
        self.acceleration_q = at.dot(borne) - at_2.dot(J) - tree.borne_on * support
        self.acceleration_v = self.twist_q + J_dot
        p, omega = placement.translation, self.twist[3:]
        p_q = J[:3] + cross(J[3:], p)
        p_tq = self.twist_q[:3] + cross(self.twist_q[3:], p) + cross(omega, p_q)
        self.p = Jet.of(p, self.twist[:3] + cross(omega, p), p_q, p_tq)
        self._R = placement.rotation

    def axis(self, k: int) -> Jet:
        """Its axis number k."""
        n, omega = self._R[:, k], self.twist[3:]
        n_q = cross(self.J[3:], n)
        n_tq = cross(self.twist_q[3:], n) + cross(omega, n_q)
        return Jet.of(n, cross(omega, n), n_q, n_tq)


class Branches:
    """Which rates of a tree move what.

    Args:
        model: The tree.

    Attributes:
        supports: For each joint 1 for the rates that move its body, shape (joints, nv).
        before: Column k: those that move what bears the joint of rate k, shape (nv, nv).
    """

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self.supports = np.array([support(model, j) for j in range(model.njoints)])
        joints = list(zip(model.parents, model.joints, strict=True))[1:]
        bearers = [parent for parent, joint in joints for _ in range(joint.nv)]
        self.before = self.supports[bearers].T


class Tree:
    """The motion of a tree, its joints added depth-first with axes that keep their place.

    Args:
        branches: Of the tree.
        data: With the frames at q; joint Jacobians and their rates go there.
        q, v, v_dot: The motion.
    """

    def __init__(
        self, branches: Branches, data: pin.Data, q: Array, v: Array, v_dot: Array
    ) -> None:
        self._branches, self._data, self.model = branches, data, branches.model
        self.q, self.v, self.v_dot = q, v, v_dot
        pin.computeJointJacobiansTimeVariation(self.model, data, q, v)
        self.J, self.J_dot = of_rates(np.array(data.J)), of_rates(np.array(data.dJ))
        moved = branches.before * v[:, None]
        twist, acceleration = self.J.dot(moved), self.J_dot.dot(moved)
        acceleration += self.J.dot(branches.before * v_dot[:, None])
        # With J_k, t, a of rate k, of what bears its joint: J_k x t, and J_k x a - (J_k x t) x t.
        self.borne = brackets(self.J, twist)
        self.borne_on = brackets(self.J, acceleration) - brackets(self.borne, twist)

    def support(self, joint: int) -> Array:
        """1 for the rates that move a joint's body, shape (nv,)."""
        return self._branches.supports[joint]

    def frame(self, index: int) -> Frame:
        """A frame of the model."""
        joint = self.model.frames[index].parentJoint
        return Frame(self, joint, self._data.oMf[index])


def cross(a: Array, b: Array) -> Array:
    """Products of a vector with a vector or with columns, in either order."""
    return skew(a).dot(b) if a.ndim == 1 else -skew(b).dot(a)


def _bracket_matrix(twist: Array) -> Array:
    """The matrix that takes another twist to the bracket of this one with it, shape (6, 6)."""
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = skew(twist[3:])
    matrix[:3, 3:] = skew(twist[:3])
    return matrix


@singledispatch
def wrenches(kind: Any, A: Frame, B: Frame) -> tuple[list[Jet], list[Jet]]:
    """Rows W of a closure, on B and on A."""
    raise NotImplementedError(type(kind))


@wrenches.register
def _(kind: kinds.Welds, A: Frame, B: Frame) -> tuple[list[Jet], list[Jet]]:
    nv = A.J.shape[1]
    rows = [Jet.constant(row, nv) for row in kind.held]
    return rows, rows


@wrenches.register
def _(kind: kinds.Points, A: Frame, B: Frame) -> tuple[list[Jet], list[Jet]]:
    nv = A.J.shape[1]
    axes = [Jet.constant(axis, nv) for axis in np.eye(3)]
    return [axis.at(B.p) for axis in axes], [axis.at(A.p) for axis in axes]


@wrenches.register
def _(kind: kinds.Masked, A: Frame, B: Frame) -> tuple[list[Jet], list[Jet]]:
    nv = A.J.shape[1]
    rows = [A.axis(k).at(B.p) for k in kind.slides]
    if kind.orientation:
        rows += [Jet.constant(row, nv) for row in np.eye(6)[3:]]
    rows += [sign * B.axis(j).cross(A.axis(i)).alone() for i, j, sign in kind.angles]
    return rows, rows


@wrenches.register
def _(kind: kinds.Rods, A: Frame, B: Frame) -> tuple[list[Jet], list[Jet]]:
    u = (B.p - A.p).unit()
    return [u.at(B.p)], [u.at(A.p)]


@wrenches.register
def _(kind: kinds.Wheels, A: Frame, B: Frame) -> tuple[list[Jet], list[Jet]]:
    up, z = A.axis(2), B.axis(2)
    if not kind.balls:
        up = (up - z.along(up.dot(z))).unit()
    contact = B.p - float(kind.radii[0]) * up
    rows = [A.axis(k).at(contact) for k in range(3)]
    return rows, rows


class Rows:
    """The closures of one mechanism.

    Args:
        mechanism: On its plain tree.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        model = mechanism.model
        self._couplings: list[tuple[slice, Coupled]] = []
        self._pairs: list[tuple[slice, Any, int, int]] = []
        start = 0
        for closure in mechanism.closures:
            rows = slice(start, start + len(closure.rows))
            start = rows.stop
            if isinstance(closure, Coupling):
                self._couplings.append((rows, Coupled(model, closure)))
            else:
                a, b = (frame_id(model, name) for name in frames_of(closure))
                self._pairs.append((rows, kinds.kind_of([closure]), a, b))
        self._shape = start, model.nv

    def partials(self, tree: Tree) -> Partials:
        """Of the rows' velocities and accelerations at a motion of the tree."""
        zeros = np.zeros((3, *self._shape))
        partials = Partials(zeros[0], zeros[1], zeros[2], [], [])
        for rows, kind, a, b in self._pairs:
            A, B = tree.frame(a), tree.frame(b)
            of_a, of_b = wrenches(kind, A, B)
            partials.add(rows, -1, A, of_a)
            partials.add(rows, 1, B, of_b)
        for rows, coupled in self._couplings:
            partials.add_coupling(rows.start, coupled, tree)
        return partials


class Partials(NamedTuple):
    """Derivatives of the velocity Phi v and the acceleration Phi v_dot + Phi_dot v of the rows.

    Attributes:
        velocity_q: Of the velocity by q, v held, shape (rows, nv).
        acceleration_q: Of the acceleration by q, v and v_dot held, shape (rows, nv).
        acceleration_v: Of the acceleration by v, shape (rows, nv).
        held: Rows, frame and its wrenches W on it, shape (rows, 6), with W_q, shape (rows, 6, nv).
        coupled: Row, index of a rate, and the second derivative of the coupling's polynomial.
    """

    velocity_q: Array
    acceleration_q: Array
    acceleration_v: Array
    held: list[tuple[slice, Frame, Array, Array]]
    coupled: list[tuple[int, int, float]]

    def add(self, rows: slice, sign: float, frame: Frame, jets: list[Jet]) -> None:
        """The share of one frame of a closure."""
        parts = sign * np.array([jet.parts for jet in jets])
        W, W_t, W_q, W_tq = parts[:, :6, 0], parts[:, 6:, 0], parts[:, :6, 1:], parts[:, 6:, 1:]
        self.held.append((rows, frame, W, W_q))
        turned = frame.twist.dot(W_q)
        self.velocity_q[rows] += W.dot(frame.twist_q) + turned
        self.acceleration_q[rows] += W.dot(frame.acceleration_q) + frame.acceleration.dot(W_q)
        self.acceleration_q[rows] += W_t.dot(frame.twist_q) + frame.twist.dot(W_tq)
        self.acceleration_v[rows] += W.dot(frame.acceleration_v) + W_t.dot(frame.J) + turned

    def add_coupling(self, row: int, coupled: Coupled, tree: Tree) -> None:
        """The row of a coupling: the sum of P(q) has the rates P' v and P' v_dot + P'' v^2."""
        for i, k, _, _, P_2 in coupled.terms:
            q, v, v_dot = tree.q[i], tree.v[k], tree.v_dot[k]
            second = float(P_2(q))
            self.velocity_q[row, k] = second * v
            self.acceleration_q[row, k] = second * v_dot + P_2.deriv()(q) * v**2
            self.acceleration_v[row, k] = 2 * second * v
            self.coupled.append((row, k, second))
