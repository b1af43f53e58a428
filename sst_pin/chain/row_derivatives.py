# SPDX-License-Identifier: BSD-2-Clause
"""Partial derivatives on the tree of the closures' rows: of Phi v and of its rate.

Derivatives by q are taken along each rate of the tree, as Pinocchio's are. Twists and the wrenches
W of `closure_kinds` run [linear; angular], in world axes, reduced at the world's origin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from .closure_kinds import Pair
from .couplings import Coupled
from .loops import Loops
from .tree import of_rates, support
from .vectors import brackets, skew

Array = NDArray[np.float64]


class Frame:
    """A frame, its twist and the derivatives of its motion.

    Attributes:
        joint: The joint that moves it.
        J: Its twist per rate of the tree, shape (6, nv).
        twist, acceleration: Spatial, shape (6,).
        twist_q, acceleration_q, acceleration_v: Their derivatives, shape (6, nv).
        vectors: Its origin and its axes x, y, z, shape (4, 3).
        vectors_q, vectors_tq: Their derivatives, and those of their rates, shape (4, 3, nv).
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
        self.vectors = np.array([placement.translation, *placement.rotation.T])
        turned = -skew(self.vectors)  # times omega: omega x vector
        self.vectors_q = turned @ J[3:]
        self.vectors_q[0] += J[:3]
        self.vectors_tq = turned @ self.twist_q[3:] + skew(self.twist[3:]) @ self.vectors_q
        self.vectors_tq[0] += self.twist_q[:3]

    @property
    def numbers_q(self) -> Array:
        """Derivatives of its vectors and of their rates, as `Pair` has them."""
        return np.stack((self.vectors_q, self.vectors_tq), axis=-1).transpose(2, 0, 1, 3)


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


def _bracket_matrix(twist: Array) -> Array:
    """The matrix that takes another twist to the bracket of this one with it, shape (6, 6)."""
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = skew(twist[3:])
    matrix[:3, 3:] = skew(twist[:3])
    return matrix


def partials(loops: Loops, tree: Tree) -> Partials:
    """Of the rows' velocities and accelerations at a motion of the tree, which the loops know."""
    zeros = np.zeros((3, loops.rows, len(tree.v)))
    found = Partials(zeros[0], zeros[1], zeros[2], [], [])
    for pair in loops.pairs:
        found.add_pair(pair, tree)
    for rows, coupled in loops.couplings:
        found.add_coupling(rows.start, coupled, tree)
    return found


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

    def add_pair(self, pair: Pair, tree: Tree) -> None:
        """A closure of two frames, which stand and move as the tree."""
        B, A = tree.frame(pair.B.index), tree.frame(pair.A.index)
        numbers, numbers_q = pair.derivatives(B.numbers_q, A.numbers_q)
        for side, sign, frame in ((0, 1.0, B), (1, -1.0, A)):
            (W, W_t), (W_q, W_tq) = sign * numbers[:, side], sign * numbers_q[:, side]
            turned = frame.twist.dot(W_q)
            self.held.append((pair.at, frame, W, W_q))
            self.velocity_q[pair.at] += W.dot(frame.twist_q) + turned
            by_q = W.dot(frame.acceleration_q) + frame.acceleration.dot(W_q)
            by_q += W_t.dot(frame.twist_q) + frame.twist.dot(W_tq)
            self.acceleration_q[pair.at] += by_q
            by_v = W.dot(frame.acceleration_v) + W_t.dot(frame.J) + turned
            self.acceleration_v[pair.at] += by_v

    def add_coupling(self, row: int, coupled: Coupled, tree: Tree) -> None:
        """The row of a coupling: the sum of P(q) has the rates P' v and P' v_dot + P'' v^2."""
        for i, k, _, _, P_2 in coupled.terms:
            q, v, v_dot = tree.q[i], tree.v[k], tree.v_dot[k]
            second = float(P_2(q))
            self.velocity_q[row, k] = second * v
            self.acceleration_q[row, k] = second * v_dot + P_2.deriv()(q) * v**2
            self.acceleration_v[row, k] = 2 * second * v
            self.coupled.append((row, k, second))
