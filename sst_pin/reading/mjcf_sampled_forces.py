# SPDX-License-Identifier: BSD-2-Clause
"""Forces that MuJoCo computes at a few random states of a model.

They tell which numbers of a model act on the motion. The forces are computed with the numbers of
the file, and with zeros in their place. If both agree bit for bit, the numbers do not act on a
joint that moves.
"""

from collections.abc import Iterator
from copy import copy
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from .mjcf_compiled import Compiled
from .mjcf_tree import MjcfTree

#: Number of random states.
_STATES = 3
#: Standard deviation of the random displacements from `qpos0`, [rad] or [m]: large enough that
#: springs act, small enough that joints stay within a turn.
_DISPLACEMENT = 0.3


class _State(NamedTuple):
    """A state of the model; each vector has shape (nv,), with zeros for joints that do not move."""

    displacement: Array  #: From `qpos0`, along the rates.
    rates: Array
    accelerations: Array


class _Forces(NamedTuple):
    """The forces on all joints at one state, each of shape (nv,)."""

    passive: Array  #: Springs, dampers, the medium, compensation of weights.
    actuator: Array  #: Actuators whose controls are zero.
    inertial: Array  #: Inertia times accelerations.


class SampledForces:
    """The forces on the joints of a compiled model at a few random states."""

    def __init__(self, compiled: Compiled, tree: MjcfTree) -> None:
        self._mujoco = compiled.mujoco
        self._mj = compiled.mj
        nv = self._mj.nv
        #: Whether a rate of MuJoCo moves in the tree, shape (nv,).
        self._moves = np.isin(np.arange(nv), tree.dofs)
        random = np.random.default_rng(0)
        displacements = _DISPLACEMENT * random.normal(size=(_STATES, nv))
        rates = random.normal(size=(_STATES, nv))
        accelerations = random.normal(size=(_STATES, nv))
        self._states = list[_State]()
        for k in range(_STATES):
            state = _State(
                displacement=displacements[k] * self._moves,
                rates=rates[k] * self._moves,
                accelerations=accelerations[k] * self._moves,
            )
            self._states.append(state)

    def depend_on(self, field: str) -> bool:
        """Whether the forces change if all numbers of a field of MuJoCo's model become zero."""
        numbers = getattr(self._mj, field, None)  # not every MuJoCo has every field
        if numbers is None or not np.any(numbers):
            return False
        without = copy(self._mj)  # a copy of an MjModel has arrays of its own
        getattr(without, field)[:] = 0
        return self._differ_from_file(without)

    def depend_on_medium(self) -> bool:
        """Whether the forces depend on the density and the viscosity of a medium."""
        without = copy(self._mj)
        without.opt.density = 0
        without.opt.viscosity = 0
        return self._differ_from_file(without)

    def joints_with_other_forces(self) -> list[int]:
        """Joints with passive forces that are no springs, no dampers and no compensated weights."""
        without = copy(self._mj)
        without.jnt_stiffness[:] = 0
        without.dof_damping[:] = 0
        without.tendon_stiffness[:] = 0
        without.tendon_damping[:] = 0
        without.body_gravcomp[:] = 0
        has_force = np.zeros(self._mj.nv, dtype=bool)
        for forces in self._forces(without):
            has_force |= forces.passive != 0
        joints = self._mj.dof_jntid[has_force & self._moves]  # of each rate with a force
        return list(dict.fromkeys(map(int, joints)))

    def _differ_from_file(self, mj: Any) -> bool:
        """Whether a changed model has other forces than the model of the file."""
        return not np.array_equal(self._forces_on_moving_joints(mj), self._forces_of_file)

    @cached_property
    def _forces_of_file(self) -> Array:
        """The forces on the moving joints in the model as it is in the file."""
        return self._forces_on_moving_joints(self._mj)

    def _forces_on_moving_joints(self, mj: Any) -> Array:
        """All forces on the moving joints at all states, a row for each state and kind of force."""
        rows = list[Array]()
        for forces in self._forces(mj):
            for force in forces:
                rows.append(force[self._moves])
        return np.array(rows)

    def _forces(self, mj: Any) -> Iterator[_Forces]:
        """The forces at each state.

        Constraints are disabled: closures, limits and contacts are read elsewhere.
        """
        mujoco = self._mujoco
        mj = copy(mj)
        mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        data = mujoco.MjData(mj)
        for state in self._states:
            data.qpos = mj.qpos0
            data.qvel = state.rates
            mujoco.mj_integratePos(mj, data.qpos, state.displacement, 1)  # one second
            mujoco.mj_fwdPosition(mj, data)
            mujoco.mj_fwdVelocity(mj, data)
            mujoco.mj_fwdActuation(mj, data)
            inertial = np.zeros(mj.nv)
            mujoco.mj_mulM(mj, data, inertial, state.accelerations)
            yield _Forces(data.qfrc_passive.copy(), data.qfrc_actuator.copy(), inertial)
