# SPDX-License-Identifier: BSD-2-Clause
"""Partial derivatives of the closures' rows on the tree: of Phi v and of its rate.

Derivatives by q are taken along each rate of the tree, as Pinocchio's are. Twists and wrenches run
[linear; angular], in world axes, reduced at the world's origin; x is their Lie bracket.

A rate i moves all that stands after its joint. So it changes the twist t and the acceleration a of
a frame after it by

    dt/dq_i = J_i x (t - t_i),
    da/dq_i = J_i x (a - a_i) - (J_i x t_i) x (t - t_i),

where J_i is its own twist at unit rate, and t_i and a_i are the twist and the acceleration of the
body that carries its joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.normal_tree import NormalTree
from .loops import Loops
from .rows import FrameRows, Frames, cross, hat, skew

#: In complex numbers M + i _STEP M_q the imaginary part of W is _STEP W_q, exact to rounding.
_STEP = 1e-50


class TreeMotion:
    """The motion of a tree at the configuration of its loops, with rates v and v_dot.

    Attributes:
        v, v_dot: The rates and accelerations, shape (nv,).
        J, J_dot: J_i and its rate for each rate i of the normal tree, shape (6, rates).
        carried: J_i x t_i, shape (6, rates).
        carried_twice: J_i x a_i - (J_i x t_i) x t_i, shape (6, rates).
    """

    def __init__(self, loops: Loops, v: Array, v_dot: Array) -> None:
        self._loops, self.v, self.v_dot = loops, v, v_dot
        tree, data = loops.tree, loops.data
        rates, accelerations = tree.S.dot(v), tree.S.dot(v_dot)
        pin.computeJointJacobiansTimeVariation(tree.model, data, loops.q, rates)
        self.J = np.array(data.J).reshape(6, -1)
        self.J_dot = np.array(data.dJ).reshape(6, -1)
        # Column i has the rates before rate i, zero for the others.
        rates_before = tree.before * rates[:, None]
        accelerations_before = tree.before * accelerations[:, None]
        t = self.J.dot(rates_before)
        a = self.J_dot.dot(rates_before) + self.J.dot(accelerations_before)
        self.carried = brackets(self.J, t)
        self.carried_twice = brackets(self.J, a) - brackets(self.carried, t)

    def frames(self, joints: Sequence[int], places: Sequence[Array]) -> FrameMotions:
        """Motions of frames at places, shapes (4, 4), on bodies of the normal tree."""
        return FrameMotions(self, self._loops.tree, joints, np.array(places))

    def frames_of(self, indices: Sequence[int]) -> FrameMotions:
        """Motions of frames of the model."""
        frames = [self._loops.tree.model.frames[index] for index in indices]
        places = [self._loops.data.oMf[index].homogeneous for index in indices]
        return self.frames([frame.parentJoint for frame in frames], places)


class FrameMotions:
    """Twists of k frames and the derivatives of their motions by the rates of the tree.

    Attributes:
        J: Twist per rate, shape (k, 6, nv).
        twist, acceleration: Spatial, shape (k, 6).
        twist_q, acceleration_q, acceleration_v: Their derivatives, shape (k, 6, nv).
        M, M_t: Homogeneous matrices of the frames and their rates, shape (k, 4, 4).
        M_q, M_tq: Derivatives of both, shape (nv, k, 4, 4).
    """

    def __init__(
        self, motion: TreeMotion, tree: NormalTree, joints: Sequence[int], places: Array
    ) -> None:
        moves = tree.supports[list(joints), None]
        J = (motion.J * moves).dot(tree.S)
        J_dot = (motion.J_dot * moves).dot(tree.S)
        carried = (motion.carried * moves).dot(tree.S)
        carried_twice = (motion.carried_twice * moves).dot(tree.S)
        self.J, self.twist = J, J.dot(motion.v)
        self.acceleration = J.dot(motion.v_dot) + J_dot.dot(motion.v)
        t_x, a_x = _bracket_matrix(self.twist), _bracket_matrix(self.acceleration)
        self.twist_q = -t_x @ J - carried
        self.acceleration_q = -a_x @ J + t_x @ carried - carried_twice
        self.acceleration_v = self.twist_q + J_dot
        self.M, self.M_t = places, hat(self.twist) @ places
        self.M_q = hat(np.moveaxis(J, -1, 0)) @ places
        self.M_tq = hat(np.moveaxis(self.twist_q, -1, 0)) @ places + hat(self.twist) @ self.M_q


class ClosurePartials(NamedTuple):
    """The k closures of one kind and the motions of their frames, for loads on them."""

    #: Their rows.
    rows: FrameRows
    #: Motions of frames B and A of each closure, in turn.
    frames: FrameMotions
    #: Derivative of W, shape (k, rows, 12, nv).
    W_q: Array


class Partials(NamedTuple):
    """Derivatives of the velocity Phi v and the acceleration Phi v_dot + Phi_dot v of the rows."""

    #: Derivative of the velocity by q, v held, shape (rows, nv).
    velocity_q: Array
    #: Derivative of the acceleration by q, v and v_dot held, shape (rows, nv).
    acceleration_q: Array
    #: Derivative of the acceleration by v, shape (rows, nv).
    acceleration_v: Array
    #: The closures of two frames.
    closures: list[ClosurePartials]
    #: For each joint of a coupling: the row, the rate, and the polynomial's second derivative.
    coupled: list[tuple[int, int, float]]


def partials(loops: Loops, q: Array, tree: TreeMotion) -> Partials:
    """Derivatives of the rows' velocities and accelerations at q, where `loops` is evaluated."""
    velocity_q, acceleration_q, acceleration_v = np.zeros((3, *loops.touched.shape))
    closures: list[ClosurePartials] = []
    for rows in loops.of_frames:
        at, count = rows.at, len(rows.at)
        frames = tree.frames_of(rows.frames.ravel().tolist())
        twist = frames.twist.reshape(count, 12)
        acceleration = frames.acceleration.reshape(count, 12)
        J = frames.J.reshape(count, 12, -1)
        twist_q = frames.twist_q.reshape(J.shape)
        of_q = frames.acceleration_q.reshape(J.shape)
        of_v = frames.acceleration_v.reshape(J.shape)
        W, W_t = rows.W, rows.formulas.W_dot(*_ends(frames.M), *_ends(frames.M_t))
        W_q, W_tq = _wrench_derivatives(rows, frames)
        turning = _along(W_q, twist)
        velocity_q[at] = W @ twist_q + turning
        acceleration_q[at] = W @ of_q + _along(W_q, acceleration)
        acceleration_q[at] += W_t @ twist_q + _along(W_tq, twist)
        acceleration_v[at] = W @ of_v + W_t @ J + turning
        closures.append(ClosurePartials(rows, frames, W_q))
    coupled: list[tuple[int, int, float]] = []
    for coupling in loops.couplings:
        # The sum of P(q) has the rates P' v and P' v_dot + P'' v^2.
        for i, k, _, _, P_2 in coupling.terms:
            row, v, v_dot, second = coupling.at[0], tree.v[k], tree.v_dot[k], float(P_2(q[i]))
            velocity_q[row, k] = second * v
            acceleration_q[row, k] = second * v_dot + P_2.deriv()(q[i]) * v**2
            acceleration_v[row, k] = 2 * second * v
            coupled.append((row, k, second))
    return Partials(velocity_q, acceleration_q, acceleration_v, closures, coupled)


def _wrench_derivatives(rows: FrameRows, frames: FrameMotions) -> tuple[Array, Array]:
    """Derivatives of W and of its rate by q, shapes (k, rows, 12, nv)."""
    M, M_t = frames.M + 1j * _STEP * frames.M_q, frames.M_t + 1j * _STEP * frames.M_tq
    W, W_t = rows.formulas.W(*_ends(M)), rows.formulas.W_dot(*_ends(M), *_ends(M_t))
    return np.moveaxis(W.imag, 0, -1) / _STEP, np.moveaxis(W_t.imag, 0, -1) / _STEP


def _along(W_q: Array, twists: Array) -> Array:
    """Derivatives of W t, t held, shape (k, rows, nv), for twists of shape (k, 12)."""
    return np.einsum("kriq,ki->krq", W_q, twists)


def _ends(M: Array) -> tuple[Frames, Frames]:
    """Frames B and A from matrices or their rates, shape (..., 2 k, 4, 4), B and A in turn."""
    return Frames.of(M[..., ::2, :, :]), Frames.of(M[..., 1::2, :, :])


def brackets(a: Array, b: Array) -> Array:
    """Lie brackets of twists [linear; angular] in columns, shape (6, k)."""
    (v, w), (v_b, w_b) = (np.split(x.T, 2, axis=1) for x in (a, b))
    return np.concatenate((cross(w, v_b) + cross(v, w_b), cross(w, w_b)), axis=1).T


def _bracket_matrix(twist: Array) -> Array:
    """The matrices with which t x s = matrix s, for twists t, shape (k, 6, 6)."""
    matrix = np.zeros((len(twist), 6, 6))
    matrix[:, :3, :3] = matrix[:, 3:, 3:] = skew(twist[:, 3:])
    matrix[:, :3, 3:] = skew(twist[:, :3])
    return matrix
