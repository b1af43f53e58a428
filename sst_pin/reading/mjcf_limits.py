# SPDX-License-Identifier: BSD-2-Clause
"""Largest forces of the motors of an MJCF, from ranges of controls, actuators and joints."""

import numpy as np

from ..arrays import Array
from .mjcf_actuators import actuators
from .mjcf_compiled import HINGE, SLIDE, Compiled
from .mjcf_tree import MjcfTree


def put_efforts(compiled: Compiled, tree: MjcfTree) -> dict[str, float]:
    """Write the largest forces of motors on joints into the model of the tree, as `effortLimit`.

    The ranges of several actuators on one joint add up. If a range is not symmetric, the larger
    side is used for both directions, and a note says so.

    Returns:
        The largest forces of motors on spatial tendons, by the names of the tendons.
    """
    efforts_of_lines = dict[str, float]()
    for (kind, target), force_range in _ranges(compiled).items():
        # Sites and bodies, the other kinds of targets, drive no single rate.
        if kind == "joint":
            _put_joint_effort(compiled, tree, target, force_range)
        elif kind == "tendon":
            name = compiled.name("tendon", target)
            if compiled.is_spatial(target):
                efforts_of_lines[name] = _effort(compiled, f"tendon {name}", force_range)
                continue
            largest = _larger_side(force_range)
            if np.isfinite(largest):
                text = f"the limit {largest:g} of its motor is not used: it acts on several joints"
                compiled.notes.append(f"tendon {name}: {text}")
    return efforts_of_lines


def _put_joint_effort(compiled: Compiled, tree: MjcfTree, joint: int, force_range: Array) -> None:
    """Write a range of forces into the tree, if the joint is a hinge or a slide that moves."""
    mj = compiled.mj
    rate = int(mj.jnt_dofadr[joint])
    if mj.jnt_type[joint] not in (HINGE, SLIDE) or rate not in tree.dofs:
        return
    effort = _effort(compiled, f"joint {compiled.joint_name(joint)}", force_range)
    if np.isfinite(effort):
        # `tree.dofs` has MuJoCo's index of each rate of the model. So the place in this list is the
        # index of the rate in the model.
        tree.model.effortLimit[tree.dofs.index(rate)] = effort


def _ranges(compiled: Compiled) -> dict[tuple[str, int], Array]:
    """The range of the force on each target of actuators, by its kind and index.

    A range has the shape (2,), [N] or [N m]; it is the sum over all actuators on the target. A
    joint or a tendon may limit this sum. A joint without actuators has the range of its limit.
    """
    mj = compiled.mj
    ranges = dict[tuple[str, int], Array]()
    for actuator in actuators(compiled):
        key = (actuator.kind, actuator.target)
        if actuator.gear:
            range_of_one = np.sort(actuator.gear * _range_of(compiled, actuator.index))
        else:  # zero times an infinite range would be NaN
            range_of_one = np.zeros(2)
        ranges[key] = ranges.get(key, 0.0) + range_of_one
    # Joints and tendons may limit the sum. Not every MuJoCo has the fields of these limits.
    prefixes = {"joint": "jnt", "tendon": "tendon"}
    for (kind, target), force_range in ranges.items():
        if kind not in prefixes:
            continue
        limited = getattr(mj, f"{prefixes[kind]}_actfrclimited", None)
        if limited is not None and limited[target]:
            lower, upper = getattr(mj, f"{prefixes[kind]}_actfrcrange")[target]
            force_range[:] = np.clip(force_range, lower, upper)
    limited_joints = getattr(mj, "jnt_actfrclimited", np.zeros(0))
    for joint in map(int, np.flatnonzero(limited_joints)):
        ranges.setdefault(("joint", joint), mj.jnt_actfrcrange[joint])
    return ranges


def _range_of(compiled: Compiled, i: int) -> Array:
    """The range of the force of one actuator, before its gear."""
    mj = compiled.mj
    mujoco = compiled.mujoco
    # If the control is a force, not a position or a rate, force = gain * control.
    is_force = (
        mj.actuator_gaintype[i] == int(mujoco.mjtGain.mjGAIN_FIXED)
        and mj.actuator_biastype[i] == int(mujoco.mjtBias.mjBIAS_NONE)
        and mj.actuator_dyntype[i] == int(mujoco.mjtDyn.mjDYN_NONE)
    )
    # Newer versions of MuJoCo can have several controls of one actuator: the index of the first.
    control = getattr(mj, "actuator_ctrladr", np.arange(mj.nu))[i]
    lower = -np.inf
    upper = np.inf
    if is_force and mj.actuator_ctrllimited[control]:
        lower, upper = np.sort(mj.actuator_gainprm[i, 0] * mj.actuator_ctrlrange[control])
    if mj.actuator_forcelimited[i]:
        lower, upper = np.clip((lower, upper), *mj.actuator_forcerange[i])
    return np.array([lower, upper])


def _effort(compiled: Compiled, where: str, force_range: Array) -> float:
    """The larger side of a range of forces; a note says if the sides differ."""
    low, high = force_range
    effort = _larger_side(force_range)
    if np.isfinite(effort) and low != -high:
        text = (
            f"its force is limited to {low:g} to {high:g}; {effort:g} is used for both directions"
        )
        compiled.notes.append(f"{where}: {text}")
    return effort


def _larger_side(force_range: Array) -> float:
    """The larger absolute value of the two ends of a range."""
    return float(np.abs(force_range).max())
