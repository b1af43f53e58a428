# SPDX-License-Identifier: BSD-2-Clause
"""Lagrange multipliers: the tree's equations of motion with the closures' forces as unknowns.

Everything is solved by least squares on all rows of the closures, redundant ones too.
"""

from typing import ClassVar

import numpy as np

from ..arrays import Array
from ..closed_chain import ClosedChain
from .tree_motion import MovingRobot, PinocchioTree, Tree, closed_motions, solution_of


class LagrangeMultipliers:
    """Dynamics of any closed chain, for configurations with closed loops.

    The equations of motion of the tree, with motor torques tau and the multipliers lambda of the
    closures, are

        F(dv) = applied + B tau + Phi^T lambda,    Phi dv = -drift.

    F(dv) are the joint forces of the tree and of the masses of lines; the other letters are those
    of `MovingRobot`.
    """

    name = "Lagrange multipliers"
    _tree_kind: ClassVar[type[Tree]] = PinocchioTree

    def __init__(self, chain: ClosedChain) -> None:
        self._mechanism = chain.mechanism
        self._tree = self._tree_kind(chain.mechanism)

    def generalized_forces(self, q: Array, va: Array, aa: Array) -> Array:
        """The forces along the coordinates that a motion needs, shape (n,)."""
        robot = MovingRobot(self._mechanism, self._tree, q, va)
        # F(dv) - applied = Phi^T lambda + S^T f, where S selects the coordinates: va = S v.
        system = np.vstack([robot.Phi, self._mechanism.selection])
        solution = solution_of(system.T, _needed_forces(robot, aa))
        return solution[len(robot.Phi) :]

    def torques(self, q: Array, va: Array, aa: Array, loads: Array | None = None) -> Array:
        """The smallest motor torques of a motion, shape (motors,).

        `loads` are further forces on the rates of the tree, shape (nv,). Where the motors cannot
        produce the motion, the torques are the nearest ones.
        """
        robot = MovingRobot(self._mechanism, self._tree, q, va)
        needed = _needed_forces(robot, aa)
        if loads is not None:
            needed = needed - loads
        # needed = B tau + Phi^T lambda. Motions N that keep the loops closed have N Phi^T = 0.
        N = closed_motions(robot.Phi)
        return solution_of(N @ robot.B, N @ needed)

    def accelerations(self, q: Array, va: Array, tau: Array) -> Array:
        """Direct dynamics: accelerations of the coordinates, shape (n,)."""
        robot = MovingRobot(self._mechanism, self._tree, q, va)
        nv = self._mechanism.model.nv
        # F(dv) = M dv + F(0), with F(0) from Coriolis forces and weights.
        zero = np.zeros(nv)
        force = robot.B @ tau + robot.applied - robot.motion.forces(zero)
        # A column of M is the force for an acceleration of 1, at rest and without the weight.
        # `pin.crba` is wrong for trees whose joints are not added depth-first.
        at_rest = self._tree.move(q, zero)
        weight = at_rest.forces(zero)
        columns = [at_rest.forces(e) - weight for e in np.eye(nv)]
        M = np.stack(columns, axis=1) + robot.line_inertia
        # M dv - Phi^T lambda = force, and Phi dv = -drift. M is divided by a unit, so that it is
        # not lost in rounding beside Phi; the sign and the unit of lambda do not matter.
        rows = len(robot.Phi)
        unit = np.abs(M).max()
        system = np.block([[M / unit, robot.Phi.T], [robot.Phi, np.zeros((rows, rows))]])
        dv = solution_of(system, np.concatenate([force / unit, -robot.drift]))[:nv]
        return self._mechanism.selection @ dv


def _needed_forces(robot: MovingRobot, aa: Array) -> Array:
    """The forces of motors and closures on the joints for a motion, F(dv) - applied, (nv,)."""
    dv = robot.joint_rates(aa, -robot.drift)
    return robot.motion.forces(dv) + robot.line_inertia @ dv - robot.applied
