# SPDX-License-Identifier: BSD-2-Clause
"""Forces and inertias in an MJCF that are not read: the dynamics would be wrong without them.

MuJoCo's model has many fields that can cause forces, such as `jnt_springyield`. Whether the numbers
of such a field matter is not derived from MuJoCo's rules; MuJoCo itself tells. It computes all
forces on the joints at a few random states, once with the numbers and once with zeros in their
place. If both results agree bit for bit, the numbers do not act on a joint that moves.
"""

from collections.abc import Iterator
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Array
from ..summaries import listed
from .mjcf_compiled import BALL, FREE, Compiled
from .mjcf_loops import actuators
from .mjcf_tree import MjcfTree

#: Fields of MuJoCo's model of which some numbers or all are not read, and what they are in words.
#: `_Forces.unread_numbers` says which numbers are read. Not every MuJoCo has every field.
_NOT_READ = {
    "jnt_stiffnesspoly": "the polynomial of a spring",
    "jnt_springyield": "the yield of a spring",
    "dof_dampingpoly": "the polynomial of a damper",
    "tendon_stiffnesspoly": "the polynomial of a tendon's spring",
    "tendon_dampingpoly": "the polynomial of a tendon's damper",
    "tendon_springyield": "the yield of a tendon's spring",
    "flex_edgestiffness": "the stiffness of a flex's edges",
    "flex_edgedamping": "the damping of a flex's edges",
    "flex_stiffness": "the elasticity of a flex",
    "flex_bending": "the bending stiffness of a flex",
    "actuator_dampingpoly": "the polynomial of an actuator's damper",
    "actuator_damping": "the damping of an actuator",
    "actuator_armature": "the armature of an actuator",
}


def unread(compiled: Compiled, tree: MjcfTree) -> list[str]:
    """Problems of forces and inertias that act on moving joints and are not supported."""
    mj = compiled.mj
    forces = _Forces(compiled, tree)
    problems = [*_joint_problems(compiled), *_tendon_problems(compiled, tree)]
    if forces.depend_on("body_gravcomp"):
        problems.append(_gravcomp_problem(compiled))
    for field, description in _NOT_READ.items():
        if forces.depend_on(field):
            problems.append(f"{description} is not supported")
    if forces.depend_on_medium():
        problems.append("a medium (density, viscosity, wind) is not supported")
    for body in map(int, np.flatnonzero(getattr(mj, "body_plugin", np.empty(0)) >= 0)):
        plugin = mj.plugin(mj.body_plugin[body]).name
        what = f"a plugin {plugin}" if plugin else "a plugin"
        name = compiled.name("body", body)
        problems.append(f"body {name}: {what} with forces is not supported")
    for actuator in actuators(compiled):
        if not actuator.controls:
            text = "it acts without a control, which is not supported"
            problems.append(f"{actuator.name}: {text}")
    if not problems:
        # Other passive forces, which no field above causes. If there is a problem already, these
        # forces may be the same.
        for joint in forces.joints_with_other_forces():
            text = "a passive force of MuJoCo on it is not supported"
            problems.append(f"joint {compiled.joint(joint)}: {text}")
    return problems


def _joint_problems(compiled: Compiled) -> Iterator[str]:
    """Problems of free joints and balls with forces or inertias of their own.

    A free joint with them is read as three slides and a ball, which `compiled.notes` says. That is
    not possible if some of its rates are locked. A ball locked in part keeps its friction, which is
    noted too, but it cannot have a spring.
    """
    mj = compiled.mj
    for joint in range(mj.njnt):
        if compiled.is_locked(joint):
            continue
        name = compiled.joint(joint)
        dof = mj.jnt_dofadr[joint]
        has_spring = mj.jnt_stiffness[joint] and not compiled.disabled("spring")
        has_friction = mj.dof_frictionloss[dof] and not compiled.disabled("frictionloss")
        is_ball = mj.jnt_type[joint] == BALL
        if mj.jnt_type[joint] == FREE:
            forces = compiled.forces_of_free_joint(joint)
            if not forces:
                continue
            what = f"joint {name}: a free joint with {listed(forces)}"
            if compiled.locked_rates(joint):
                yield f"{what}, locked in part; use <freejoint> without these"
            else:
                text = "is read as three slides and a ball; <freejoint> has none of these"
                compiled.notes.append(f"{what} {text}")
        elif is_ball and 0 < len(compiled.locked_rates(joint)) < 3:
            if has_spring:
                yield f"joint {name}: a ball with a spring; it can only be locked as a whole"
            if has_friction or mj.dof_damping[dof]:
                text = "its friction acts about each axis that is not locked"
                compiled.notes.append(f"joint {name}: {text}")


def _gravcomp_problem(compiled: Compiled) -> str:
    """What to do about a `gravcomp` that differs between bodies, ready to paste."""
    mj = compiled.mj
    if getattr(mj, "jnt_actgravcomp", np.zeros(0)).any():
        return (
            "actuatorgravcomp is not supported: remove gravcomp; the torques of the motors are "
            "then those with which they compensate weights"
        )
    sites = list[str]()
    wrenches = list[str]()
    for body in map(int, np.flatnonzero((mj.body_gravcomp != 0) & (mj.body_mass > 0))):
        name = compiled.name("body", body)
        center = " ".join(f"{x:.12g}" for x in mj.body_ipos[body])
        sites.append(f'in body {name} <site name="{name}_lift" pos="{center}"/>')
        force = -mj.body_gravcomp[body] * mj.body_mass[body] * mj.opt.gravity
        numbers = ", ".join(f"{x + 0.0:.12g}" for x in force)  # -0 + 0 is 0
        wrenches.append(f'"{name}_lift": [{numbers}, 0, 0, 0]')
    return (
        "gravcomp that differs between bodies is not supported: remove gravcomp, add sites at the "
        f"mass centres, {', '.join(sites)}, and pass external_wrenches={{{', '.join(wrenches)}}}"
    )


def _tendon_problems(compiled: Compiled, tree: MjcfTree) -> Iterator[str]:
    """Springs of fixed tendons without a force in a range of lengths."""
    if compiled.disabled("spring"):
        return
    for tendon in tree.tendons:
        shortest, longest = compiled.mj.tendon_lengthspring[tendon]
        if compiled.mj.tendon_stiffness[tendon] and shortest != longest:
            text = "a springlength with a dead band is not supported; give one number"
            yield f"tendon {compiled.name('tendon', tendon)}: {text}"


#: Fields whose forces appear in some states only, so that random states may miss them. They count
#: wherever they are not zero.
_IN_SOME_STATES = ("jnt_springyield", "tendon_springyield")
#: Number of random states.
_STATES = 3
#: Standard deviation of the random displacements from `qpos0`, [rad] or [m]: large enough that
#: springs act, small enough that joints stay within a turn.
_DISPLACEMENT = 0.3


class _Forces:
    """Forces that MuJoCo computes on the moving joints at a few random states.

    A state is a displacement from `qpos0` along the rates, rates, and accelerations. Joints that do
    not move in the tree have zeros in all three.
    """

    def __init__(self, compiled: Compiled, tree: MjcfTree) -> None:
        self._compiled = compiled
        self._mujoco = compiled.mujoco
        self._mj = compiled.mj
        self._moves = np.isin(np.arange(self._mj.nv), tree.dofs)
        random = np.random.default_rng(0)
        self._displacements = _DISPLACEMENT * self._random_rows(random)
        self._rates = self._random_rows(random)
        self._accelerations = self._random_rows(random)

    def _random_rows(self, random: np.random.Generator) -> Array:
        """Random numbers for the rates that move, shape (states, nv)."""
        return np.asarray(random.normal(size=(_STATES, self._mj.nv)) * self._moves)

    def depend_on(self, field: str) -> bool:
        """Whether the forces depend on the unread numbers of a field."""
        values = self.unread_numbers(field)
        if not np.any(values):
            return False
        if field in _IN_SOME_STATES:
            return self._has_moving_element(field, values)
        without = copy(self._mj)  # a copy of an MjModel has arrays of its own
        array = getattr(without, field)
        array[:] = array - values
        return not np.array_equal(self._all_forces(without), self._forces_of_file)

    def depend_on_medium(self) -> bool:
        """Whether the forces depend on the density and the viscosity of a medium."""
        without = copy(self._mj)
        without.opt.density = 0
        without.opt.viscosity = 0
        return not np.array_equal(self._all_forces(without), self._forces_of_file)

    def joints_with_other_forces(self) -> list[int]:
        """Joints on which passive forces act that are not read.

        This holds only if `depend_on` is false for all fields: then the springs, dampers and
        compensated weights that are set to zero here are those that are read.
        """
        without = copy(self._mj)
        without.jnt_stiffness[:] = 0
        without.dof_damping[:] = 0
        without.tendon_stiffness[:] = 0
        without.tendon_damping[:] = 0
        if self._compiled.gravcomp is not None:
            without.body_gravcomp[:] = 0
        passive, _, _ = self._force_parts(without)
        has_force = self._moves & (passive != 0).any(axis=0)
        return list(dict.fromkeys(map(int, self._mj.dof_jntid[has_force])))

    def unread_numbers(self, field: str) -> Array:
        """The numbers of a field, with zeros in place of those that are read."""
        values = np.array(getattr(self._mj, field, 0.0), dtype=float)
        if field == "body_gravcomp" and self._compiled.gravcomp is not None:
            values[:] = 0
        return values

    def _has_moving_element(self, field: str, values: Array) -> bool:
        """Whether a joint or tendon that moves has a value, and no flag disables its force."""
        if self._compiled.disabled("spring"):
            return False
        for i in map(int, np.unique(np.nonzero(values)[0])):
            if field.startswith("jnt"):
                moves = bool(self._moves[self._mj.jnt_dofadr[i]])
            else:
                moves = self._compiled.is_spatial(i) or bool(self._compiled.shares(i))
            if moves:
                return True
        return False

    @cached_property
    def _forces_of_file(self) -> Array:
        """`_all_forces` of the model as it is in the file."""
        return self._all_forces(self._mj)

    def _all_forces(self, mj: Any) -> Array:
        """All forces on the moving joints, one row for each state and part."""
        return np.concatenate([part[:, self._moves] for part in self._force_parts(mj)])

    def _force_parts(self, mj: Any) -> tuple[Array, Array, Array]:
        """Passive forces, forces of actuators without control, inertial forces, each (states, nv).

        Constraints are disabled: closures, limits and contacts are read elsewhere.
        """
        mujoco = self._mujoco
        mj = copy(mj)
        mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        data = mujoco.MjData(mj)
        passive = np.zeros((_STATES, mj.nv))
        actuator = np.zeros((_STATES, mj.nv))
        inertial = np.zeros((_STATES, mj.nv))
        for k in range(_STATES):
            data.qpos = mj.qpos0
            data.qvel = self._rates[k]
            mujoco.mj_integratePos(mj, data.qpos, self._displacements[k], 1)  # one second
            mujoco.mj_fwdPosition(mj, data)
            mujoco.mj_fwdVelocity(mj, data)
            mujoco.mj_fwdActuation(mj, data)
            passive[k] = data.qfrc_passive
            actuator[k] = data.qfrc_actuator
            mujoco.mj_mulM(mj, data, inertial[k], self._accelerations[k])
        return passive, actuator, inertial
