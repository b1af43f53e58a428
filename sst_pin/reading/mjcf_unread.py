# SPDX-License-Identifier: BSD-2-Clause
"""Content of an MJCF that the dynamics cannot account for; MuJoCo itself tells which forces act."""

from collections.abc import Iterator
from copy import copy
from typing import Any

import numpy as np

from ..arrays import Array
from ..summaries import listed
from .mjcf_compiled import BALL, FREE, Compiled
from .mjcf_loops import actuators
from .mjcf_tree import MjcfTree

#: Fields of MuJoCo's model that cause forces or inertias and are not read, in words. Not every
#: MuJoCo has every field.
_NOT_READ = {
    "jnt_stiffnesspoly": "the polynomial of a spring",
    "jnt_springyield": "the yield of a spring",
    "dof_dampingpoly": "the polynomial of a damper",
    "body_gravcomp": "compensation of gravity that differs between bodies",
    "tendon_stiffness": "the stiffness of a fixed tendon",
    "tendon_damping": "the damping of a fixed tendon",
    "tendon_frictionloss": "the friction of a tendon",
    "tendon_armature": "the armature of a fixed tendon",
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
#: Fields whose forces appear only in some states: they count wherever they are not zero.
_IN_SOME_STATES = ("jnt_springyield", "tendon_springyield", "tendon_frictionloss")
#: Forces and inertias of spatial tendons that are read as lines.
_OF_LINES = ("tendon_stiffness", "tendon_damping", "tendon_armature")
#: Fields that are read, by kind of element.
_NUMBERS = {
    "body": ("pos", "quat", "ipos", "iquat", "mass", "inertia"),
    "jnt": ("pos", "axis", "range", "stiffness"),
    "dof": ("armature", "damping", "frictionloss"),
    "site": ("pos", "quat"),
    "eq": ("data",),
    "key": ("qpos",),
}
#: Names of these elements in an MJCF.
_WORDS = {"eq": "equality", "jnt": "joint", "dof": "joint"}


def impossible(compiled: Compiled) -> Iterator[str]:
    """Impossible numbers that MuJoCo accepts."""
    mj = compiled.mj
    for kind, fields in _NUMBERS.items():
        for field in fields:
            array = getattr(mj, f"{kind}_{field}")
            odd = np.isnan(array) if field == "range" else ~np.isfinite(array)
            negative = (array < 0) & (kind == "dof")
            for i in map(int, np.unique(np.nonzero(odd | negative)[0])):
                wrong = f"{array[i]:g} is negative" if negative[i].any() else "is not finite"
                yield f"{_named(compiled, kind, i)}: {field} {wrong}"
    for what, array in (("gravity", mj.opt.gravity), ("a joint's ref", mj.qpos0)):
        if not np.isfinite(array).all():
            yield f"{what} is not finite"


def _named(compiled: Compiled, kind: str, i: int) -> str:
    """An element in words, such as "joint knee"."""
    what = _WORDS.get(kind, kind)
    if what == "joint":
        return f"joint {compiled.joint(compiled.mj.dof_jntid[i] if kind == 'dof' else i)}"
    return f"{what} {compiled.name(what, i)}"


def unread(compiled: Compiled, tree: MjcfTree) -> list[str]:
    """Forces and inertias that act on moving joints and are not supported."""
    mj, forces = compiled.mj, _Forces(compiled, tree)
    problems = list(_of_joints(compiled))
    for field, what in _NOT_READ.items():
        if forces.act(field):
            problems.append(f"{what} is not supported")
    if forces.of_medium():
        problems.append("a medium (density, viscosity, wind) is not supported")
    for body in map(int, np.flatnonzero(getattr(mj, "body_plugin", np.empty(0)) >= 0)):
        plugin = mj.plugin(mj.body_plugin[body]).name
        words = f"a plugin {plugin}" if plugin else "a plugin"
        name = compiled.name("body", body)
        problems.append(f"body {name}: {words} with forces is not supported")
    free = (actuator.name for actuator in actuators(compiled) if not actuator.controls)
    problems += [f"{name}: it acts without a control, which is not supported" for name in free]
    if not problems:
        for joint in forces.others():
            text = "a passive force of MuJoCo on it is not supported"
            problems.append(f"joint {compiled.joint(joint)}: {text}")
    return problems


def contact_note(compiled: Compiled, tree: MjcfTree) -> str:
    """A note on shapes that can touch something, as contacts are not computed; else empty."""
    mj = compiled.mj
    if compiled.disabled("contact"):
        return ""
    moving = np.array([tree.bodies[body][0] > 0 for body in mj.geom_bodyid], dtype=bool)
    touches = (mj.geom_contype | mj.geom_conaffinity)[moving].any()
    special = [
        word
        for word, fields in (
            ("adhesion", ("geom_adhesion", "pair_adhesion")),
            ("surfacevel", ("geom_surfacevel",)),
        )
        if any(np.any(getattr(mj, field, 0)) for field in fields)
    ]
    if not (touches or mj.npair or special):
        return ""
    return f"contacts are not computed{f', nor {listed(special)}' if special else ''}"


def _of_joints(compiled: Compiled) -> Iterator[str]:
    """Free joints and partly locked balls with forces or inertias that are not read."""
    mj = compiled.mj
    for joint in (joint for joint in range(mj.njnt) if not compiled.is_locked(joint)):
        kind, dof, stiffness = mj.jnt_type[joint], mj.jnt_dofadr[joint], mj.jnt_stiffness[joint]
        name = compiled.joint(joint)
        spring = stiffness and not compiled.disabled("spring")
        friction = mj.dof_frictionloss[dof] and not compiled.disabled("frictionloss")
        if kind == FREE:
            acting = {
                "armature": mj.dof_armature[dof],
                "frictionloss": friction,
                "a spring": spring,
            }
            for word in (word for word, value in acting.items() if value):
                yield f"joint {name}: a free joint with {word}; use <freejoint> instead"
        elif kind == BALL and 0 < len(compiled.locked_rates(joint)) < 3:
            if spring:
                yield f"joint {name}: a ball with a spring; it can only be locked as a whole"
            if friction or mj.dof_damping[dof]:
                text = "its friction acts about each axis that is not locked"
                compiled.notes.append(f"joint {name}: {text}")


class _Forces:
    """Forces of MuJoCo on the joints that move, at random states in which the others stand."""

    def __init__(self, compiled: Compiled, tree: MjcfTree) -> None:
        self._compiled, self._mujoco, self._mj = compiled, compiled.mujoco, compiled.mj
        self._moves = np.isin(np.arange(self._mj.nv), tree.dofs)
        self._states = np.random.default_rng(0).normal(size=(3, 3, self._mj.nv)) * self._moves
        self._whole: Array | None = None

    def act(self, field: str) -> bool:
        """Whether the numbers of a field change the forces."""
        values = self._unread_numbers(field)
        if not np.any(values):
            return False
        if field in _IN_SOME_STATES:
            return bool(self._on_moving(field, np.atleast_1d(values)))
        changed = copy(self._mj)
        array = getattr(changed, field)
        array[:] = array - values
        return not np.array_equal(self._of(changed), self._of_file())

    def of_medium(self) -> bool:
        """Whether a medium changes the forces."""
        changed = copy(self._mj)
        changed.opt.density = changed.opt.viscosity = 0
        return not np.array_equal(self._of(changed), self._of_file())

    def others(self) -> list[int]:
        """Joints on which passive forces act beside those that are read."""
        plain = copy(self._mj)
        plain.jnt_stiffness[:], plain.dof_damping[:] = 0, 0
        plain.tendon_stiffness[:], plain.tendon_damping[:] = 0, 0
        if self._compiled.gravcomp is not None:
            plain.body_gravcomp[:] = 0
        forces, _, _ = self._parts(plain)
        acting = self._moves & (forces != 0).any(axis=0)
        return list(dict.fromkeys(map(int, self._mj.dof_jntid[acting])))

    def _unread_numbers(self, field: str) -> Array:
        """The numbers of a field, zero where they are read."""
        values = np.array(getattr(self._mj, field, 0.0), dtype=float)
        if field in _OF_LINES:
            spatial = [self._compiled.is_spatial(i) for i in range(self._mj.ntendon)]
            values[np.array(spatial, dtype=bool)] = 0
        if field == "body_gravcomp" and self._compiled.gravcomp is not None:
            values[:] = 0
        return values

    def _on_moving(self, field: str, values: Array) -> bool:
        """Whether a joint or a tendon with such a number moves, and no flag switches it off."""
        flag = "frictionloss" if field.endswith("frictionloss") else "spring"
        if self._compiled.disabled(flag):
            return False
        for i in map(int, np.unique(np.nonzero(values)[0])):
            if field.startswith("jnt"):
                moves = bool(self._moves[self._mj.jnt_dofadr[i]])
            else:
                moves = self._compiled.is_spatial(i) or bool(self._compiled.shares(i))
            if moves:
                return True
        return False

    def _of_file(self) -> Array:
        if self._whole is None:
            self._whole = self._of(self._mj)
        return self._whole

    def _of(self, mj: Any) -> Array:
        """Passive forces, forces of actuators without control, and inertial forces."""
        return np.concatenate([part[:, self._moves] for part in self._parts(mj)])

    def _parts(self, mj: Any) -> tuple[Array, Array, Array]:
        mujoco = self._mujoco
        mj = copy(mj)
        mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        data, rows = mujoco.MjData(mj), []
        for step, rates, accelerations in self._states:
            data.qpos, data.qvel = mj.qpos0, rates
            mujoco.mj_integratePos(mj, data.qpos, 0.3 * step, 1)
            mujoco.mj_fwdPosition(mj, data)
            mujoco.mj_fwdVelocity(mj, data)
            mujoco.mj_fwdActuation(mj, data)
            inertial = np.zeros(mj.nv)
            mujoco.mj_mulM(mj, data, inertial, accelerations)
            rows.append((data.qfrc_passive.copy(), data.qfrc_actuator.copy(), inertial))
        passive, actuator, inertia = (np.array(part) for part in zip(*rows, strict=True))
        return passive, actuator, inertia
