# SPDX-License-Identifier: BSD-2-Clause
"""Content of an MJCF that the dynamics cannot account for."""

from collections.abc import Iterator
from copy import copy

import numpy as np

from .mjcf_compiled import BALL, FREE, Compiled
from .mjcf_loops import actuators
from .mjcf_tree import MjcfTree

#: Fields of a compiled model, the forces that they cause, and the flag that disables them.
_FORCES = {
    "jnt_stiffnesspoly": ("the polynomial of a spring", "spring"),
    "jnt_springyield": ("the yield of a spring", "spring"),
    "tendon_springyield": ("the yield of a tendon's spring", "spring"),
    "dof_dampingpoly": ("the polynomial of a damper", "damper"),
    "body_gravcomp": ("compensation of gravity", "gravity"),
    "tendon_stiffness": ("the stiffness of a fixed tendon", "spring"),
    "tendon_damping": ("the damping of a fixed tendon", "damper"),
    "tendon_frictionloss": ("the friction of a tendon", "frictionloss"),
    "tendon_armature": ("the armature of a tendon", ""),
    "tendon_stiffnesspoly": ("the polynomial of a tendon's spring", "spring"),
    "tendon_dampingpoly": ("the polynomial of a tendon's damper", "damper"),
    "flex_edgestiffness": ("the stiffness of a flex's edges", "spring"),
    "flex_edgedamping": ("the damping of a flex's edges", "damper"),
    "flex_stiffness": ("the elasticity of a flex", "spring"),
    "flex_bending": ("the bending stiffness of a flex", "spring"),
    "geom_adhesion": ("the adhesion of a geom", "contact"),
    "pair_adhesion": ("the adhesion of a pair of geoms", "contact"),
    "actuator_dampingpoly": ("the polynomial of an actuator's damper", ""),
    "actuator_damping": ("the damping of an actuator", ""),
    "actuator_armature": ("the armature of an actuator", ""),
}
#: Forces that spatial tendons may have.
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


def impossible(compiled: Compiled) -> Iterator[str]:
    """Impossible numbers that MuJoCo accepts."""
    mj = compiled.mj
    for kind, field in ((kind, field) for kind, fields in _NUMBERS.items() for field in fields):
        array = getattr(mj, f"{kind}_{field}")
        odd = np.isnan(array) if field == "range" else ~np.isfinite(array)
        negative = (array < 0) & (kind == "dof")
        for i in map(int, np.unique(np.nonzero(odd | negative)[0])):
            what = {"eq": "equality", "jnt": "joint", "dof": "joint"}.get(kind, kind)
            joint = mj.dof_jntid[i] if kind == "dof" else i
            name = compiled.joint(joint) if what == "joint" else compiled.name(what, i)
            wrong = f"{array[i]:g} is negative" if negative[i].any() else "is not finite"
            yield f"{what} {name}: {field} {wrong}"
    for what, array in (("gravity", mj.opt.gravity), ("a joint's ref", mj.qpos0)):
        if not np.isfinite(array).all():
            yield f"{what} is not finite"


def unread(compiled: Compiled, tree: MjcfTree) -> list[str]:
    """Forces and inertias that act on moving joints and are not supported."""
    mj, problems = compiled.mj, [*_of_joints(compiled), *_of_fields(compiled, tree)]
    if mj.opt.density or mj.opt.viscosity:
        problems.append("a medium (density, viscosity, wind) is not supported")
    for body in map(int, np.flatnonzero(getattr(mj, "body_plugin", np.empty(0)) >= 0)):
        name, plugin = compiled.name("body", body), mj.plugin(mj.body_plugin[body]).name
        text = f"a plugin{f' {plugin}' * bool(plugin)} with forces is not supported"
        problems.append(f"body {name}: {text}")
    free = (actuator.name for actuator in actuators(compiled) if not actuator.controls)
    problems += [f"{name}: it acts without a control, which is not supported" for name in free]
    return problems or list(_of_mujoco(compiled, tree))


def _of_joints(compiled: Compiled) -> Iterator[str]:
    """Free joints and partly locked balls with forces or inertias that are not read."""
    mj = compiled.mj
    for joint in (joint for joint in range(mj.njnt) if not compiled.is_locked(joint)):
        kind, dof, stiffness = mj.jnt_type[joint], mj.jnt_dofadr[joint], mj.jnt_stiffness[joint]
        spring = stiffness and not compiled.disabled("spring")
        friction = mj.dof_frictionloss[dof] and not compiled.disabled("frictionloss")
        acting, what, cure = {}, "", ""
        if kind == FREE:
            what, cure = "a free joint", "use <freejoint> instead"
            acting = {"armature": mj.dof_armature[dof], "frictionloss": friction}
        elif kind == BALL and 0 < len(compiled.locked_rates(joint)) < 3:
            what, cure = "a ball", "it can only be locked as a whole"
            acting = {"a spring": spring, "frictionloss": friction}
        for each in (each for each, value in acting.items() if value):
            yield f"joint {compiled.joint(joint)}: {what} with {each}; {cure}"


def _of_fields(compiled: Compiled, tree: MjcfTree) -> Iterator[str]:
    """Fields of the compiled model whose forces or inertias act on a part that moves."""
    mj, kinds = compiled.mj, compiled.mujoco.mjtTrn
    on_joints = [int(kind) for kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT)]
    weighs = tree.model.gravity.linear.any()

    def moves(field: str, i: int) -> bool:
        kind = field.partition("_")[0]
        if kind in ("jnt", "dof"):
            return (mj.jnt_dofadr[i] if kind == "jnt" else i) in tree.dofs
        if kind == "body":
            return bool(tree.bodies[i][0] and weighs)
        if kind == "tendon" and compiled.is_spatial(i):
            return field not in _OF_LINES
        if kind == "actuator" and mj.actuator_trntype[i] in on_joints:
            return not compiled.is_locked(mj.actuator_trnid[i, 0])
        return kind != "tendon" or bool(compiled.shares(i))

    for field, (what, flag) in _FORCES.items():
        values = np.atleast_1d(getattr(mj, field, 0))  # not every MuJoCo has every field
        acting = map(int, np.unique(np.nonzero(values)[0]))
        if not compiled.disabled(flag) and any(moves(field, i) for i in acting):
            yield f"{what} is not supported"


def _of_mujoco(compiled: Compiled, tree: MjcfTree) -> Iterator[str]:
    """Joints on which MuJoCo's passive forces are not those of their springs and dampers."""
    mj, mujoco = copy(compiled.mj), compiled.mujoco
    mj.jnt_stiffness[:], mj.dof_damping[:] = 0, 0
    mj.tendon_stiffness[:], mj.tendon_damping[:] = 0, 0
    mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data, random = mujoco.MjData(mj), np.random.default_rng(0)
    moving, acting = np.isin(np.arange(mj.nv), tree.dofs), np.zeros(mj.nv, dtype=bool)
    for step, rates in random.normal(size=(3, 2, mj.nv)):
        data.qpos, data.qvel = mj.qpos0, rates * moving
        mujoco.mj_integratePos(mj, data.qpos, 0.3 * step * moving, 1)
        mujoco.mj_fwdPosition(mj, data)
        mujoco.mj_fwdVelocity(mj, data)
        acting |= moving & (data.qfrc_passive != 0)
    for joint in dict.fromkeys(map(int, mj.dof_jntid[acting])):
        yield f"joint {compiled.joint(joint)}: a passive force of MuJoCo on it is not supported"
