# SPDX-License-Identifier: BSD-2-Clause
"""Actuators of an MJCF, and the motors that they are."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..model.checks import Motor
from .mjcf_compiled import HINGE, SLIDE, Compiled
from .mjcf_lines import line_problem
from .mjcf_tree import MjcfTree


@dataclass(frozen=True)
class Actuator:
    """An actuator that is not switched off."""

    #: Its index in MuJoCo.
    index: int
    name: str
    #: The kind of element on which it acts, such as "joint" or "tendon".
    kind: str
    #: The index of this element in MuJoCo.
    target: int
    #: Number of the actuator's controls.
    controls: int
    #: The force on the target is gear times the force of the actuator.
    gear: float


def actuators(compiled: Compiled) -> Iterator[Actuator]:
    """Actuators that are not switched off and whose joint is not locked."""
    if compiled.disabled("actuation"):
        return
    mj = compiled.mj
    kinds = compiled.mujoco.mjtTrn
    # Since MuJoCo 4 an actuator can have several controls, and several outputs with a gear each.
    # The gear of the first output is read.
    first_outputs = getattr(mj, "actuator_outadr", np.arange(mj.nu))
    control_counts = getattr(mj, "actuator_ctrlnum", np.ones(mj.nu))
    for i, first_output in enumerate(first_outputs):
        # "jointinparent" means the same as "joint" for hinges and slides.
        kind = kinds(mj.actuator_trntype[i]).name.removeprefix("mjTRN_").lower()
        kind = kind.removesuffix("inparent")
        target = int(mj.actuator_trnid[i, 0])
        bit_of_group = 1 << int(mj.actuator_group[i])
        group_is_off = mj.opt.disableactuator & bit_of_group
        if group_is_off or (kind == "joint" and compiled.is_locked(target)):
            continue
        yield Actuator(
            index=i,
            name=compiled.name("actuator", i),
            kind=kind,
            target=target,
            controls=int(control_counts[i]),
            gear=mj.actuator_gear[first_output, 0],
        )


def motors_of(compiled: Compiled, tree: MjcfTree) -> Iterator[Motor]:
    """Joints and tendons that actuators with a control act on, each once.

    Actuators that cannot be motors add problems to `compiled.problems`. A spatial tendon on one
    body is left out: its length does not change.
    """
    targets = set[tuple[str, int]]()
    for actuator in actuators(compiled):
        target = (actuator.kind, actuator.target)
        if not actuator.controls or target in targets:
            continue
        targets.add(target)
        problem = _motor_problem(compiled, actuator)
        if problem:
            compiled.problems.append(f"{actuator.name}: {problem}; name the motors by actuated=")
        elif actuator.kind == "joint":
            yield compiled.joint_name(actuator.target)
        elif compiled.is_spatial(actuator.target):
            if not _is_within_one_body(compiled, tree, actuator.target):
                yield compiled.name("tendon", actuator.target)
        elif compiled.coefficients(actuator.target):  # not all its joints are locked
            yield _fixed_tendon(compiled, actuator.target)


def _motor_problem(compiled: Compiled, actuator: Actuator) -> str:
    """Why an actuator cannot be a motor; empty if it can."""
    mj = compiled.mj
    if actuator.kind not in ("joint", "tendon"):
        return f"an actuator on a {actuator.kind}, not on a joint or a tendon"
    if actuator.kind == "joint" and mj.jnt_type[actuator.target] not in (HINGE, SLIDE):
        return "an actuator on a ball or a free joint; use hinges in series"
    if not actuator.gear:
        return "its gear is 0, so it moves nothing"
    is_fixed_tendon = actuator.kind == "tendon" and not compiled.is_spatial(actuator.target)
    if is_fixed_tendon and not mj.wrap_prm[compiled.wraps(actuator.target)].any():
        return "the coefficients of its tendon are 0"
    return ""


def _is_within_one_body(compiled: Compiled, tree: MjcfTree, tendon: int) -> bool:
    """Whether the same joint moves all sites of a spatial tendon, so that its length is constant.

    False for a tendon that cannot be a line; `lines_of` reports why.
    """
    if line_problem(compiled, tendon):
        return False
    sites = compiled.mj.wrap_objid[compiled.wraps(tendon)]
    joints = {tree.bodies[compiled.mj.site_bodyid[site]].joint for site in sites}
    return len(joints) == 1


def named_motors(compiled: Compiled, motors: Sequence[Motor]) -> tuple[Motor, ...]:
    """Motors that a caller names, where the name of a fixed tendon means its joints.

    A name of both a joint and a tendon means the joint.
    """
    joints = {compiled.joint_name(joint) for joint in range(compiled.mj.njnt)}
    tendons = dict[str, Motor]()
    for i in range(compiled.mj.ntendon):
        name = compiled.name("tendon", i)
        if not compiled.is_spatial(i) and name not in joints:
            tendons[name] = _fixed_tendon(compiled, i)
    with_joints = list[Motor]()
    for motor in motors:
        if isinstance(motor, str):
            with_joints.append(tendons.get(motor, motor))
        else:
            with_joints.append(motor)
    return tuple(with_joints)


def _fixed_tendon(compiled: Compiled, tendon: int) -> Motor:
    """A fixed tendon as a motor: its name, with the coefficients of its joints."""
    by_name = dict[str, float]()
    for joint, coefficient in compiled.coefficients(tendon).items():
        by_name[compiled.joint_name(joint)] = coefficient
    return {compiled.name("tendon", tendon): by_name}
