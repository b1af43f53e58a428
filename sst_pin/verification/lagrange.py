# SPDX-License-Identifier: BSD-2-Clause
"""Lagrange multipliers: the tree's equations of motion with the closures' forces as unknowns.

Everything is solved by least squares on all rows of the closures, redundant ones too.
"""

from typing import ClassVar

import numpy as np

from ..arrays import Array
from ..closed_chain import ClosedChain
from .tree_motion import MovingRobot, PinocchioTree, Tree, free_motions, solution_of


class LagrangeMultipliers:
    """Dynamics of any closed chain, for configurations with closed loops."""

    name = "Lagrange multipliers"
    _engine: ClassVar[type[Tree]] = PinocchioTree

    def __init__(self, chain: ClosedChain) -> None:
        self._mechanism = chain.mechanism
        self._tree = self._engine(chain.mechanism)

    def generalized_forces(self, q: Array, va: Array, aa: Array) -> Array:
        """The forces along the coordinates that a motion needs, shape (n,)."""
        robot = self._moving(q, va)
        system = np.vstack([robot.Phi, self._mechanism.selection])
        return solution_of(system.T, self._needed(robot, aa))[len(robot.Phi) :]

    def torques(self, q: Array, va: Array, aa: Array, loads: Array | None = None) -> Array:
        """The smallest motor torques of a motion, shape (motors,).

        `loads` are further forces on the rates of the tree, shape (nv,). Where the motors cannot
        produce the motion, the torques are the nearest ones.
        """
        robot = self._moving(q, va)
        needed = self._needed(robot, aa) - (0 if loads is None else loads)
        # needed = B tau + Phi^T multipliers. Motions N that keep the loops closed have N Phi^T = 0.
        N = free_motions(robot.Phi)
        return solution_of(N @ robot.B, N @ needed)

    def accelerations(self, q: Array, va: Array, tau: Array) -> Array:
        """Direct dynamics: accelerations of the coordinates, shape (n,)."""
        robot = self._moving(q, va)
        tree = self._tree
        nv = self._mechanism.model.nv
        # M dv = force + Phi^T multipliers and Phi dv = -drift. The tree's forces without
        # accelerations are Coriolis forces and weights; with unit accelerations at rest, columns of
        # M and weights.
        zero = np.zeros(nv)
        force = robot.B @ tau + robot.applied - tree.forces(zero)
        tree.move(q, zero)
        weight = tree.forces(zero)
        # Column by column: `pin.crba` is wrong for trees whose joints are not added depth-first.
        M = np.stack([tree.forces(e) - weight for e in np.eye(nv)], axis=1) + robot.line_inertia
        # A unit for the multipliers, so that M is not lost in rounding.
        rows = len(robot.Phi)
        unit = np.abs(M).max()
        system = np.block([[M / unit, robot.Phi.T], [robot.Phi, np.zeros((rows, rows))]])
        dv = solution_of(system, np.concatenate([force / unit, -robot.drift]))[:nv]
        return self._mechanism.selection @ dv

    def _moving(self, q: Array, va: Array) -> MovingRobot:
        """The robot in a state; the tree is put there too."""
        return MovingRobot(self._mechanism, self._tree, q, va)

    def _needed(self, robot: MovingRobot, aa: Array) -> Array:
        """The forces of motors and closures on the joints, shape (nv,)."""
        dv = robot.joint_rates(aa, -robot.drift)
        return self._tree.forces(dv) + robot.line_inertia @ dv - robot.applied
