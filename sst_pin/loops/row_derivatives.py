# SPDX-License-Identifier: BSD-2-Clause
"""Partial derivatives of the closures' rows on the tree: of Phi v and of its rate.

Derivatives by q are taken along each rate of the tree, as Pinocchio's are. Twists [v; omega] and
wrenches [force; moment] have the axes and the origin of the world. The acceleration a = t_dot is
the rate of a twist t in time. The symbol x is the Lie bracket of twists.

J_i is the twist that rate i of the tree gives, at unit speed, to all bodies after joint i, the
joint of this rate. The carrier is the body before joint i. It has the twist t_i and the
acceleration a_i. A frame after joint i has the twist t and the acceleration a. Its twist relative
to the carrier is u = t - t_i. Seen from the carrier, u has the rate b = a - a_i - t_i x u.

A change of q_i, with all v and v_dot held, moves everything after joint i as one body, with the
twist J_i. So it turns and shifts u and b, but changes neither t_i nor a_i:

    du/dq_i = J_i x u,    db/dq_i = J_i x b.

With t = t_i + u and a = a_i + b + t_i x u, and with Jacobi's identity
t_i x (J_i x u) - J_i x (t_i x u) = -(J_i x t_i) x u, the derivatives are

    dt/dq_i = J_i x (t - t_i),
    da/dq_i = J_i x (a - a_i) - (J_i x t_i) x (t - t_i).

The parts of these derivatives that are the same for all frames are c_i and d_i:

    c_i = J_i x t_i,                dt/dq_i = -t x J_i - c_i,
    d_i = J_i x a_i - c_i x t_i,    da/dq_i = -a x J_i + t x c_i - d_i.

The acceleration is a = J v_dot + J_dot v, and J_dot is the sum of v_i dJ/dq_i. So a depends on v_i
in two ways: by the factor v_i of dJ/dq_i in J_dot, and by entry i of v. The derivative is

    da/dv_i = (dJ/dq_i) v + J_dot e_i = dt/dq_i + column i of J_dot.

`partials` is the main function. `TreeMotion` has c_i and d_i, `FrameMotions` the derivatives of
twists and accelerations of frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.normal_tree import NormalTree
from .closure_formulas import FramePair
from .loops import Loops
from .rows import FrameRows
from .vectors import bracket_matrix, brackets, hat

#: The complex step h of `_wrench_derivatives`. Its square is below the rounding of any number.
_STEP = 1e-50


class TreeMotion:
    """The motion of a tree at the configuration of its loops, with rates v and v_dot.

    Attributes:
        v, v_dot: The rates and accelerations, shape (nv,).
        J, J_dot: J_i and its rate in columns, for the rates of the normal tree, shape (6, rates).
        c, d: c_i and d_i in columns, as in the text of the module, shape (6, rates).
    """

    def __init__(self, loops: Loops, v: Array, v_dot: Array) -> None:
        self._loops = loops
        self.v = v
        self.v_dot = v_dot
        tree = loops.tree
        data = loops.data
        rates = tree.S.dot(v)
        accelerations = tree.S.dot(v_dot)
        pin.computeJointJacobiansTimeVariation(tree.model, data, loops.q, rates)
        self.J = np.array(data.J).reshape(6, -1)
        self.J_dot = np.array(data.dJ).reshape(6, -1)

        # Column i of `rates_before` has only the rates that move the carrier of joint i; the other
        # entries are 0. So J times this column is t_i: column i of t. Column i of a is a_i.
        rates_before = tree.before * rates[:, None]
        accelerations_before = tree.before * accelerations[:, None]
        t = self.J.dot(rates_before)
        a = self.J_dot.dot(rates_before) + self.J.dot(accelerations_before)
        self.c = brackets(self.J, t)
        self.d = brackets(self.J, a) - brackets(self.c, t)

    def frames(self, joints: Sequence[int], places: Sequence[Array]) -> FrameMotions:
        """Motions of frames with placements, shapes (4, 4), on bodies of the normal tree."""
        return FrameMotions(self, self._loops.tree, joints, np.array(places))

    def frames_of(self, indices: Sequence[int]) -> FrameMotions:
        """Motions of frames of the model, by their indices."""
        frames = [self._loops.tree.model.frames[index] for index in indices]
        places = [self._loops.data.oMf[index].homogeneous for index in indices]
        return self.frames([frame.parentJoint for frame in frames], places)


class FrameMotions:
    """Twists of k frames, and the derivatives of their motions by the rates of the tree.

    Attributes:
        J: Jacobians: twists by each rate, shape (k, 6, nv).
        twist: The twist t of each frame, shape (k, 6).
        acceleration: The acceleration a of each frame, shape (k, 6).
        twist_q: dt/dq, shape (k, 6, nv).
        acceleration_q: da/dq, shape (k, 6, nv).
        acceleration_v: da/dv, shape (k, 6, nv).
        M: Placements of the frames, homogeneous matrices, shape (k, 4, 4).
        M_q: Derivatives of M by q, shape (nv, k, 4, 4): those by q_i are in M_q[i].
        M_dot_q: Derivatives of the rate of M by q, shape (nv, k, 4, 4).
    """

    def __init__(
        self, motion: TreeMotion, tree: NormalTree, joints: Sequence[int], places: Array
    ) -> None:
        # Which rates of the normal tree move each frame, shape (k, 1, rates). The columns of the
        # other rates become 0. The rates of the normal tree are S v: so the product with S gives
        # the columns for the rates v of the model.
        moves = tree.supports[list(joints)][:, None]
        J = (motion.J * moves).dot(tree.S)
        J_dot = (motion.J_dot * moves).dot(tree.S)
        c = (motion.c * moves).dot(tree.S)
        d = (motion.d * moves).dot(tree.S)

        self.J = J
        self.twist = J.dot(motion.v)
        self.acceleration = J.dot(motion.v_dot) + J_dot.dot(motion.v)
        # The formulas with c_i and d_i in the text of the module, for all i at once.
        t_x = bracket_matrix(self.twist)
        a_x = bracket_matrix(self.acceleration)
        self.twist_q = -t_x @ J - c
        self.acceleration_q = -a_x @ J + t_x @ c - d
        self.acceleration_v = self.twist_q + J_dot

        # M has the rate hat(t) M, and the derivative hat(J_i) M by q_i. The axis of i comes first.
        twist_by_rate = np.moveaxis(J, -1, 0)  # J_i of each frame, shape (nv, k, 6)
        twist_q_by_rate = np.moveaxis(self.twist_q, -1, 0)  # dt/dq_i, shape (nv, k, 6)
        self.M = places
        self.M_q = hat(twist_by_rate) @ places
        self.M_dot_q = hat(twist_q_by_rate) @ places + hat(self.twist) @ self.M_q


class ClosurePartials(NamedTuple):
    """The wrenches of a closure of two frames, and their derivatives.

    Attributes:
        rows: The rows.
        frames: Motions of frames B and A.
        W: The wrenches [W_B, -W_A], shape (rows, 12).
        W_q: Derivative of W by q, shape (rows, 12, nv).
    """

    rows: FrameRows
    frames: FrameMotions
    W: Array
    W_q: Array


class CouplingPartials(NamedTuple):
    """A joint of a coupling.

    Attributes:
        row: The row of the coupling in Phi.
        rate: Index of the joint's rate in v.
        second: The second derivative P'' of the joint's polynomial.
    """

    row: int
    rate: int
    second: float


class Partials(NamedTuple):
    """Derivatives of the velocity Phi v and the acceleration Phi v_dot + Phi_dot v of the rows.

    Attributes:
        velocity_q: Derivative of the velocity by q, v held, shape (rows, nv).
        acceleration_q: Derivative of the acceleration by q, v and v_dot held, shape (rows, nv).
        acceleration_v: Derivative of the acceleration by v, shape (rows, nv).
        closures: The rows of closures of two frames.
        couplings: All joints of all couplings.
    """

    velocity_q: Array
    acceleration_q: Array
    acceleration_v: Array
    closures: list[ClosurePartials]
    couplings: list[CouplingPartials]


def partials(loops: Loops, q: Array, motion: TreeMotion) -> Partials:
    """Derivatives of the rows' velocities and accelerations at q, where `loops` is evaluated."""
    velocity_q = np.zeros(loops.touched.shape)
    acceleration_q = np.zeros(loops.touched.shape)
    acceleration_v = np.zeros(loops.touched.shape)

    # The velocity of the rows of a closure is W t, with t = [t_B; t_A]. Its rate, the acceleration,
    # is W t_dot + W_dot t.
    closures: list[ClosurePartials] = []
    for rows in loops.of_frames:
        frames = motion.frames_of(rows.frames)
        t = frames.twist.reshape(12)
        t_dot = frames.acceleration.reshape(12)
        J = frames.J.reshape(12, -1)
        t_q = frames.twist_q.reshape(12, -1)
        t_dot_q = frames.acceleration_q.reshape(12, -1)
        t_dot_v = frames.acceleration_v.reshape(12, -1)
        W, W_dot = _wrenches(rows, frames.M, frames.twist)
        W_q, W_dot_q = _wrench_derivatives(rows, frames)
        at = rows.at
        velocity_q[at] = W @ t_q + _along(W_q, t)
        acceleration_q[at] = W @ t_dot_q + _along(W_q, t_dot) + W_dot @ t_q + _along(W_dot_q, t)
        # By v: W_dot = W_q v has the derivative W_q, and t = J v has the derivative J.
        acceleration_v[at] = W @ t_dot_v + W_dot @ J + _along(W_q, t)
        closures.append(ClosurePartials(rows, frames, W, W_q))

    # The sum of P(q) has the velocity P' v and the acceleration P' v_dot + P'' v^2.
    couplings: list[CouplingPartials] = []
    for coupling in loops.couplings:
        row = coupling.at.start
        for joint in coupling.joints:
            k = joint.rate
            v = motion.v[k]
            v_dot = motion.v_dot[k]
            second = float(joint.P_2(q[joint.entry]))
            third = joint.P_2.deriv()(q[joint.entry])
            velocity_q[row, k] = second * v
            acceleration_q[row, k] = second * v_dot + third * v**2
            acceleration_v[row, k] = 2 * second * v
            couplings.append(CouplingPartials(row, k, second))
    return Partials(velocity_q, acceleration_q, acceleration_v, closures, couplings)


def _wrenches(rows: FrameRows, M: Array, twists: Array) -> tuple[Array, Array]:
    """W = [W_B, -W_A] and its rate, shapes (..., rows, 12).

    M and twists are those of B and A, shapes (..., 2, 4, 4) and (..., 2, 6).
    """
    pair = FramePair.of_matrices(B=M[..., 0, :, :], A=M[..., 1, :, :])
    W = rows.formulas.W(pair)
    return W, rows.formulas.W_dot(pair, W, t_B=twists[..., 0, :], t_A=twists[..., 1, :])


def _wrench_derivatives(rows: FrameRows, frames: FrameMotions) -> tuple[Array, Array]:
    """Derivatives of W and of its rate by q, shapes (rows, 12, nv), by complex steps.

    At M + i h M_q the imaginary part of W is h W_q, up to terms of h^3. It is exact to rounding for
    a tiny h, as no difference of two numbers is taken.
    """
    # All directions of q at once: the first axis is that of the rates.
    M = frames.M + 1j * _STEP * frames.M_q
    twists = frames.twist + 1j * _STEP * np.moveaxis(frames.twist_q, -1, 0)
    W, W_dot = _wrenches(rows, M, twists)
    return np.moveaxis(W.imag, 0, -1) / _STEP, np.moveaxis(W_dot.imag, 0, -1) / _STEP


def _along(W_q: Array, t: Array) -> Array:
    """Derivatives of W t by q, t held, shape (rows, nv): sums over i of W_q[r, i, :] t_i."""
    return np.einsum("riq,i->rq", W_q, t)
