# SPDX-License-Identifier: BSD-2-Clause
"""Partial derivatives on the tree of the closures' rows: of Phi v and of its rate.

Derivatives by q are taken along each rate of the tree, as Pinocchio's are. Twists and the wrenches
W of `rows` run [linear; angular], in world axes, reduced at the world's origin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.tree import of_rates, support
from ..model.vectors import brackets, carrying, skew
from .loops import Loops


class FrameMotions:
    """Frames, their twists and the derivatives of their motions; the first index is the frame.

    `supports` are 1 for the rates that move a frame, shape (k, nv), `vectors` its origin and axes
    x, y, z in homogeneous coordinates, shape (k, 4, 4).

    Attributes:
        J: Twist per rate of the tree, shape (k, 6, nv).
        twist, acceleration: Spatial, shape (k, 6).
        twist_q, acceleration_q, acceleration_v: Their derivatives, shape (k, 6, nv).
        vectors_t: Rates of the vectors, shape (k, 4, 4).
        vectors_q, vectors_tq: Derivatives of both, shape (k, nv, 4, 4).
    """

    def __init__(self, tree: TreeMotion, supports: Array, vectors: Array) -> None:
        moved = supports[:, None]
        J, J_dot = tree.J * moved, tree.J_dot * moved
        self.J, self.twist = J, J.dot(tree.v)
        self.acceleration = J.dot(tree.v_dot) + J_dot.dot(tree.v)
        # A rate turns all that moves between its joint and the frame.
        at, at_2 = _bracket_matrix(self.twist), _bracket_matrix(self.acceleration)
        borne = tree.borne * moved
        self.twist_q = -at @ J - borne
        self.acceleration_q = at @ borne - at_2 @ J - tree.borne_on * moved
        self.acceleration_v = self.twist_q + J_dot
        # Moved by each rate: by its twist J_k, and with the twists' derivatives.
        k, nv = len(J), len(tree.v)
        by_rate = carrying(J.swapaxes(1, 2).reshape(-1, 6)).reshape(k, nv, 4, 4)
        by_twist_q = carrying(self.twist_q.swapaxes(1, 2).reshape(-1, 6)).reshape(k, nv, 4, 4)
        by_twist = carrying(self.twist)
        self.vectors, self.vectors_t = vectors, vectors @ by_twist
        self.vectors_q = vectors[:, None] @ by_rate
        self.vectors_tq = vectors[:, None] @ by_twist_q + self.vectors_q @ by_twist[:, None]


class Branches:
    """Which rates of a tree move what."""

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        #: For each joint 1 for the rates that move its body, shape (joints, nv).
        self.supports = np.array([support(model, j) for j in range(model.njoints)])
        joints = list(zip(model.parents, model.joints, strict=True))[1:]
        bearers = [parent for parent, joint in joints for _ in range(joint.nv)]
        #: Column k: those that move what bears the joint of rate k, shape (nv, nv).
        self.before = self.supports[bearers].T


class TreeMotion:
    """The motion of a tree, its joints added depth-first with axes that keep their place.

    `data` has the frames at q; joint Jacobians and their rates go there.
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

    def frames(self, joints: list[int], placements: list[pin.SE3]) -> FrameMotions:
        """FrameMotions on bodies, where they are now."""
        vectors = [M.homogeneous.T[[3, 0, 1, 2]] for M in placements]
        return FrameMotions(self, self._branches.supports[joints], np.array(vectors))

    def frames_of(self, indices: list[int]) -> FrameMotions:
        """FrameMotions of the model."""
        joints = [self.model.frames[index].parentJoint for index in indices]
        return self.frames(joints, [self._data.oMf[index] for index in indices])


def _bracket_matrix(twist: Array) -> Array:
    """The matrices that take another twist to the bracket of these with it, shape (k, 6, 6)."""
    matrix = np.zeros((len(twist), 6, 6))
    matrix[:, :3, :3] = matrix[:, 3:, 3:] = skew(twist[:, 3:])
    matrix[:, :3, 3:] = skew(twist[:, :3])
    return matrix


class Partials(NamedTuple):
    """Derivatives of the velocity Phi v and the acceleration Phi v_dot + Phi_dot v of the rows."""

    #: Derivative of the velocity by q, v held, shape (rows, nv).
    velocity_q: Array
    #: Derivative of the acceleration by q, v and v_dot held, shape (rows, nv).
    acceleration_q: Array
    #: Derivative of the acceleration by v, shape (rows, nv).
    acceleration_v: Array
    #: The frames that the closures connect.
    frames: FrameMotions
    #: Wrenches of the rows on them, shape (2, rows, 6).
    W: Array
    #: Their derivatives, shape (2, rows, 6, nv).
    W_q: Array
    #: Row, index of a rate, and the second derivative of the coupling's polynomial.
    coupled: list[tuple[int, int, float]]


def partials(loops: Loops, tree: TreeMotion) -> Partials:
    """Derivatives of the rows' velocities and accelerations, at a motion that the loops know."""
    pairs, frames = loops.pairs, tree.frames_of(loops.frames)
    x, x_t = frames.vectors, frames.vectors_t
    x_q, x_tq = (y.swapaxes(0, 1) for y in (frames.vectors_q, frames.vectors_tq))
    vectors = pairs.vectors(x)
    W, W_t = pairs.wrenches(vectors), pairs.wrench_rates(vectors, pairs.vector_rates(x, x_t))
    W_q, W_tq = (np.moveaxis(y, 0, -1) for y in pairs.derivatives(x, x_t, x_q, x_tq))

    def both(wrenches: Array, twists: Array) -> Array:
        """Sums over the two frames of wrenches times twists, one of them with derivatives."""
        short, long = sorted((wrenches, twists[pairs.frames]), key=np.ndim)
        return np.einsum("sri,srik->rk", short, long)

    turned = both(W_q, frames.twist)
    velocity_q = both(W, frames.twist_q) + turned
    acceleration_q = both(W, frames.acceleration_q) + both(W_q, frames.acceleration)
    acceleration_q += both(W_t, frames.twist_q) + both(W_tq, frames.twist)
    acceleration_v = both(W, frames.acceleration_v) + both(W_t, frames.J) + turned
    coupled: list[tuple[int, int, float]] = []
    for rows, coupling in loops.couplings:
        # The sum of P(q) has the rates P' v and P' v_dot + P'' v^2.
        for i, k, _, _, P_2 in coupling.terms:
            row, q, v, v_dot = rows.start, tree.q[i], tree.v[k], tree.v_dot[k]
            second = float(P_2(q))
            velocity_q[row, k] = second * v
            acceleration_q[row, k] = second * v_dot + P_2.deriv()(q) * v**2
            acceleration_v[row, k] = 2 * second * v
            coupled.append((row, k, second))
    return Partials(velocity_q, acceleration_q, acceleration_v, frames, W, W_q, coupled)
