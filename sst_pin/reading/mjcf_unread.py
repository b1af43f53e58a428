# SPDX-License-Identifier: BSD-2-Clause
"""Forces and inertias in an MJCF that are not read: the dynamics would be wrong without them.

MuJoCo's model has many fields that can cause forces, such as `actuator_damping`. MuJoCo's rules
for them are not repeated here. Instead `SampledForces` computes MuJoCo's forces at random states,
with the numbers of a field and with zeros: if the forces differ, the numbers act.
"""

from collections.abc import Iterator

import numpy as np

from ..summaries import listed
from .mjcf_actuators import actuators
from .mjcf_compiled import BALL, FREE, Compiled
from .mjcf_sampled_forces import SampledForces
from .mjcf_tree import MjcfTree

#: Fields of MuJoCo's model that are not read, and what they are in words. Not every MuJoCo has
#: every field.
_NOT_READ = {
    "jnt_stiffnesspoly": "the polynomial of a spring",
    "dof_dampingpoly": "the polynomial of a damper",
    "tendon_stiffnesspoly": "the polynomial of a tendon's spring",
    "tendon_dampingpoly": "the polynomial of a tendon's damper",
    "flex_edgestiffness": "the stiffness of a flex's edges",
    "flex_edgedamping": "the damping of a flex's edges",
    "flex_stiffness": "the elasticity of a flex",
    "flex_bending": "the bending stiffness of a flex",
    "actuator_dampingpoly": "the polynomial of an actuator's damper",
    "actuator_damping": "the damping of an actuator",
    "actuator_armature": "the armature of an actuator",
}


def unread_forces(compiled: Compiled, tree: MjcfTree) -> list[str]:
    """Problems of forces and inertias that act on moving joints and are not supported."""
    problems = [
        *_problems_of_partly_locked(compiled),
        *_dead_band_problems(compiled, tree),
        *_yield_problems(compiled, tree),
        *_plugin_problems(compiled),
    ]
    for actuator in actuators(compiled):
        if not actuator.controls:
            text = "it acts without a control, which is not supported"
            problems.append(f"{actuator.name}: {text}")

    # Fields of which MuJoCo tells whether they act.
    forces = SampledForces(compiled, tree)
    # `body_gravcomp`, shares of weights that are compensated, is read. Only if motors compensate
    # them, which `actuatorgravcomp` of a joint says, it is not supported.
    if compiled.motors_carry_weights and forces.depend_on("body_gravcomp"):
        problems.append(
            "actuatorgravcomp is not supported: remove gravcomp; the torques of the motors are "
            "then those with which they compensate weights"
        )
    for field, description in _NOT_READ.items():
        if forces.depend_on(field):
            problems.append(f"{description} is not supported")
    if forces.depend_on_medium():
        problems.append("a medium (density, viscosity, wind) is not supported")

    # Forces that none of these fields causes. They can be told only if there is no problem so far,
    # because the force of a problem would be among them.
    if not problems:
        for joint in forces.joints_with_other_forces():
            text = "a passive force of MuJoCo on it is not supported"
            problems.append(f"joint {compiled.joint_name(joint)}: {text}")
    return problems


def _problems_of_partly_locked(compiled: Compiled) -> Iterator[str]:
    """Problems of balls and free joints that are locked in part and have forces, such as a spring.

    The caller of the reader names joints or single rates to lock. Without some of its rates, a
    joint would have other forces than MuJoCo's joint.
    """
    mj = compiled.mj
    for joint in range(mj.njnt):
        if compiled.is_locked(joint) or not compiled.locked_rates(joint):
            continue
        name = compiled.joint_name(joint)
        has_spring = mj.jnt_stiffness[joint] and not compiled.disabled("spring")
        if mj.jnt_type[joint] == FREE:
            # It becomes slides and hinges. Their axes are not those of MuJoCo's rates, so that the
            # forces would differ.
            forces = compiled.forces_of_free_joint(joint)
            if forces:
                what = f"a free joint with {listed(forces)}"
                yield f"joint {name}: {what}, locked in part; use <freejoint> without these"
        elif _is_ball_locked_in_part(compiled, joint) and has_spring:
            yield f"joint {name}: a ball with a spring; it can only be locked as a whole"


def joint_notes(compiled: Compiled) -> Iterator[str]:
    """Notes on joints whose forces are read in other axes than MuJoCo's."""
    mj = compiled.mj
    for joint in range(mj.njnt):
        if compiled.is_locked(joint):
            continue
        name = compiled.joint_name(joint)
        dof = mj.jnt_dofadr[joint]
        if mj.jnt_type[joint] == FREE and not compiled.locked_rates(joint):
            forces = compiled.forces_of_free_joint(joint)
            if forces:
                text = "is read as three slides and a ball; <freejoint> has none of these"
                yield f"joint {name}: a free joint with {listed(forces)} {text}"
        elif _is_ball_locked_in_part(compiled, joint):
            has_friction = mj.dof_frictionloss[dof] and not compiled.disabled("frictionloss")
            has_damping = mj.dof_damping[dof] and not compiled.disabled("damper")
            if has_friction or has_damping:
                text = "its friction acts about each axis that is not locked"
                yield f"joint {name}: {text}"


def _is_ball_locked_in_part(compiled: Compiled, joint: int) -> bool:
    """Whether a joint is a ball of whose three rates one or two are locked."""
    is_ball = compiled.mj.jnt_type[joint] == BALL
    return bool(is_ball) and 0 < len(compiled.locked_rates(joint)) < 3


def _dead_band_problems(compiled: Compiled, tree: MjcfTree) -> Iterator[str]:
    """Springs of fixed tendons without a force in a range of lengths.

    For spatial tendons `mjcf_lines` says which of these springs are supported.
    """
    if compiled.disabled("spring"):
        return
    for tendon in tree.tendons:
        shortest, longest = compiled.mj.tendon_lengthspring[tendon]
        if compiled.mj.tendon_stiffness[tendon] and shortest != longest:
            text = "a springlength with a dead band is not supported; give one number"
            yield f"tendon {compiled.name('tendon', tendon)}: {text}"


#: Fields of MuJoCo's model with yields of springs, and what they are in words. Beyond its yield the
#: force of a spring is constant. Random states may not reach the yield; so these fields are not
#: judged by `SampledForces`, and each yield that is not zero is a problem.
_YIELDS = {
    "jnt_springyield": "the yield of a spring",
    "tendon_springyield": "the yield of a tendon's spring",
}


def _yield_problems(compiled: Compiled, tree: MjcfTree) -> Iterator[str]:
    """Springs of joints and tendons that move and have a yield."""
    if compiled.disabled("spring"):
        return
    mj = compiled.mj
    for field, description in _YIELDS.items():
        numbers = getattr(mj, field, np.zeros(0))  # not every MuJoCo has it
        with_yield = np.unique(np.nonzero(numbers)[0])  # joints or tendons, in the rows
        for i in map(int, with_yield):
            if field == "jnt_springyield":
                moves = mj.jnt_dofadr[i] in tree.dofs
            else:
                # A fixed tendon moves if one of its joints is not locked: only then does it have
                # coefficients.
                moves = compiled.is_spatial(i) or bool(compiled.coefficients(i))
            if moves:
                yield f"{description} is not supported"
                break


def _plugin_problems(compiled: Compiled) -> Iterator[str]:
    """Plugins that exert forces on bodies."""
    mj = compiled.mj
    plugins = getattr(mj, "body_plugin", np.empty(0))  # by body; -1: none
    for body in map(int, np.flatnonzero(plugins >= 0)):
        plugin = mj.plugin(mj.body_plugin[body]).name
        what = f"a plugin {plugin}" if plugin else "a plugin"
        name = compiled.name("body", body)
        yield f"body {name}: {what} with forces is not supported"
