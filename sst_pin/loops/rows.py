# SPDX-License-Identifier: BSD-2-Clause
"""The rows of the closures in f and Phi: where they are, and which rates they depend on.

An object of this module stands for the rows of one closure, or of a part of one:

- `FrameRows`: rows of a closure of two frames, with their formulas; `ExtendedRodRow` is a special
  case;
- `CouplingRow`: the row of coupled joints;
- `BrakeRow`: the row of a joint that a brake holds.

`rows_of` makes them. They store what does not depend on the configuration; `Loops` evaluates them.

Phi is computed on the normal tree: the model with its joints in an order and of types for which
all functions of Pinocchio are right, see `NormalTree`. Its rates are S v for the rates v of the
model. Column k of J, shape (6, rates of the normal tree), is the twist [v; omega], at the world's
origin, of all bodies that rate k of the normal tree moves, at unit speed.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from ..arrays import Array, Flags
from ..errors import DescriptionError
from ..model.closures import Brake, Constraint, Coupling, ExtendedDistance, frames_of
from ..model.joint_space import JointSpace
from ..model.normal_tree import NormalTree
from ..model.tree import frame_id, joint_id
from .closure_formulas import Formulas, FrameClosure, FramePair, formulas_of


class FrameRows:
    """Rows of a closure of two frames, B and A.

    Attributes:
        at: Where the rows are in Phi.
        formulas: Their equations.
        frames: Indices of the frames B and A.
        bodies: The joints of the normal tree that carry B and A.
        touched: Which rates of the model change f, shape (nv,).
        curved: Which rates of the model change the rows of Phi, shape (nv,): all that change f.
    """

    def __init__(
        self, tree: NormalTree, closure: FrameClosure, formulas: Formulas, at: slice
    ) -> None:
        self.at = at
        self.formulas = formulas
        name_a, name_b = frames_of(closure)
        self.frames = [frame_id(tree.model, name_b), frame_id(tree.model, name_a)]
        self.bodies = [tree.model.frames[frame].parentJoint for frame in self.frames]
        # Which rates of the normal tree move B, and which move A, shapes (rates,). Row i of
        # `supports` says which rates move the body of joint i.
        moves_b, moves_a = tree.supports[self.bodies]
        #: The same as numbers 1 and 0, for B and A, shape (2, rates).
        self._moves = np.array([moves_b, moves_a], dtype=float)

        # The path between the frames: indices of the rates of the normal tree that move only one of
        # them. Others move both as one body, and do not change f.
        self._path = np.flatnonzero(moves_b != moves_a)
        S_of_path = tree.S[self._path]
        #: The rows of S for the path, for B and A; 0 for rates that do not move B, or A. Shape
        #: (2, rates of the path, nv).
        self._S_of_frames = self._moves[:, self._path, None] * S_of_path
        self.touched: Flags = np.asarray(S_of_path.any(axis=0))
        self.curved = self.touched

    def error(self, pair: FramePair, q: Array) -> Array:
        """f at q, where the frames have these placements, shape (rows,)."""
        return self.formulas.error(pair)

    def Phi(self, W: Array, J: Array) -> Array:
        """Jacobian of f, shape (rows, nv): W [J_B; J_A].

        The formulas give W = [W_B, -W_A], shape (rows, 12), for the twists t_B and t_A of the
        frames: df/dt = W_B t_B - W_A t_A.
        """
        return W.dot(self.jacobians(J))

    def twists(self, twists_of_rates: Array) -> Array:
        """Twists of B and A, shape (2, 6), from the twists of all rates, shape (rates, 6).

        The twist of a frame is the sum of the twists of all rates that move it. Rates that move
        both frames count too: they turn the wrenches W. `Loops` computes the rate of W, and so that
        of Phi, from these twists.
        """
        return self._moves.dot(twists_of_rates)

    def jacobians(self, J: Array) -> Array:
        """[J_B; J_A], shape (12, nv): twists of B and A by rates of the model.

        Only the rates of the path between the frames count, others are left out: they move both
        frames as one body, so that their terms in W [J_B; J_A] cancel.
        """
        J_of_path = J.take(self._path, axis=1)
        # The product of shape (2, 6, nv) has J_B and J_A one after the other.
        return (J_of_path @ self._S_of_frames).reshape(12, -1)


class ExtendedRodRow(FrameRows):
    """The row of a rod that joints extend: f = |AB| - length - sum of q_j; see `FrameRows`.

    The joints q_j add constant entries -1 to Phi. So `curved` and the rate of Phi are those of a
    rod of constant length.
    """

    def __init__(
        self,
        model: pin.Model,
        tree: NormalTree,
        rod: ExtendedDistance,
        formulas: Formulas,
        at: slice,
    ) -> None:
        super().__init__(tree, rod, formulas, at)
        joints = [model.joints[joint_id(model, name)] for name in rod.joints]
        self._entries = [joint.idx_q for joint in joints]
        self._rates = [joint.idx_v for joint in joints]
        self.touched = self.touched.copy()  # `curved` is the same array, and stays as it is
        self.touched[self._rates] = True

    def error(self, pair: FramePair, q: Array) -> Array:
        """f at q, shape (1,)."""
        return super().error(pair, q) - q[self._entries].sum()

    def Phi(self, W: Array, J: Array) -> Array:
        """Jacobian of f, shape (1, nv)."""
        Phi = super().Phi(W, J)
        Phi[0, self._rates] -= 1.0
        return Phi


@dataclass(frozen=True)
class CoupledJoint:
    """A joint of a coupling, and the polynomial P of its coordinate, a term of f.

    Attributes:
        entry: Index of its coordinate in q.
        rate: Index of its rate in v.
        P: The polynomial.
        P_1: Its first derivative, P'.
        P_2: Its second derivative, P''.
    """

    entry: int
    rate: int
    P: Polynomial
    P_1: Polynomial
    P_2: Polynomial


class JointRow(ABC):
    """The row of a coupling or of a brake, which depends on joints only, and not on frames.

    Attributes:
        at: Where the row is in Phi.
        joints: The joints whose positions change f: those of a coupling; none for a brake.
        touched: Which rates the row depends on, shape (nv,).
        curved: Which rates change the row of Phi, shape (nv,).
    """

    def __init__(self, model: pin.Model, at: slice) -> None:
        self.at = at
        self.joints: list[CoupledJoint] = []
        self.touched: Flags = np.zeros(model.nv, dtype=bool)
        self.curved: Flags = np.zeros(model.nv, dtype=bool)

    @abstractmethod
    def error(self, q: Array) -> float:
        """f."""

    @abstractmethod
    def Phi(self, q: Array) -> Array:
        """Jacobian of f, shape (nv,)."""

    @abstractmethod
    def Phi_dot(self, q: Array, v: Array) -> Array:
        """Rate of Phi, shape (nv,)."""


class CouplingRow(JointRow):
    """The row of a coupling of joints with one coordinate each: f = sum P_k(q_k) - offset."""

    def __init__(self, model: pin.Model, coupling: Coupling, at: slice) -> None:
        super().__init__(model, at)
        self._offset = coupling.offset
        # The coupling is: joint = offset + sum of the polynomials of the other joints. So
        # f = joint - offset - sum: P is q for the joint, and minus the polynomial for each other.
        polynomials = {coupling.joint: Polynomial([0.0, 1.0])}
        for name, coefficients in coupling.polynomials.items():
            polynomials[name] = -Polynomial(coefficients)

        for name, P in polynomials.items():
            joint = model.joints[joint_id(model, name)]
            if (joint.nq, joint.nv) != (1, 1):
                problem = f"joint {name} has {joint.nq} coordinates; couplings take one"
                raise DescriptionError(str(coupling), [problem])
            rate = joint.idx_v
            self.joints.append(CoupledJoint(joint.idx_q, rate, P, P.deriv(), P.deriv(2)))
            self.touched[rate] = True
            self.curved[rate] = P.deriv(2).coef.any()  # False if P is linear

    def error(self, q: Array) -> float:
        """f."""
        return sum(float(joint.P(q[joint.entry])) for joint in self.joints) - self._offset

    def Phi(self, q: Array) -> Array:
        """Jacobian of f, shape (nv,): P'(q) of each joint."""
        Phi = np.zeros(len(self.touched))
        for joint in self.joints:
            Phi[joint.rate] = joint.P_1(q[joint.entry])
        return Phi

    def Phi_dot(self, q: Array, v: Array) -> Array:
        """Rate of Phi, shape (nv,): P''(q) v of each joint."""
        Phi_dot = np.zeros(len(self.touched))
        for joint in self.joints:
            Phi_dot[joint.rate] = joint.P_2(q[joint.entry]) * v[joint.rate]
        return Phi_dot


class BrakeRow(JointRow):
    """The row of a rate that a brake holds, at any position: f = 0, and Phi selects the rate."""

    def __init__(self, model: pin.Model, brake: Brake, at: slice) -> None:
        super().__init__(model, at)
        (rate,) = JointSpace(model).rates_of([brake.name])
        self.touched[rate] = True

    def error(self, q: Array) -> float:
        """f = 0."""
        return 0.0

    def Phi(self, q: Array) -> Array:
        """1 for the rate that is held, shape (nv,)."""
        return self.touched.astype(float)

    def Phi_dot(self, q: Array, v: Array) -> Array:
        """Zero, shape (nv,)."""
        return np.zeros(len(self.touched))


def rows_of(
    model: pin.Model, tree: NormalTree, closures: Sequence[Constraint]
) -> list[FrameRows | JointRow]:
    """The rows of all closures of a model with this normal tree, in the order of the closures.

    A closure of two frames has one or two `FrameRows`: as many as sets of formulas.
    """
    all_rows: list[FrameRows | JointRow] = []
    first = 0  # the first row in Phi of the next closure
    for closure in closures:
        if isinstance(closure, Coupling):
            all_rows.append(CouplingRow(model, closure, slice(first, first + 1)))
            first += 1
        elif isinstance(closure, Brake) and closure.frames is None:  # the brake of a joint
            all_rows.append(BrakeRow(model, closure, slice(first, first + 1)))
            first += 1
        else:  # a closure of two frames, such as the brake of a line
            for formulas in formulas_of(closure):
                at = slice(first, first + formulas.rows)
                if isinstance(closure, ExtendedDistance):
                    all_rows.append(ExtendedRodRow(model, tree, closure, formulas, at))
                else:
                    all_rows.append(FrameRows(tree, closure, formulas, at))
                first = at.stop
    return all_rows
