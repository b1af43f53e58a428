# SPDX-License-Identifier: BSD-2-Clause
"""Largest forces of the motors of an MJCF, from ranges of controls, actuators and joints."""

import numpy as np

from ..arrays import Array
from .mjcf_compiled import HINGE, SLIDE, Compiled
from .mjcf_loops import actuators
from .mjcf_tree import MjcfTree

#: A range of forces without limits, [N] or [N m].
_ANY = np.array([-np.inf, np.inf])


def put_efforts(compiled: Compiled, tree: MjcfTree) -> dict[str, float]:
    """Write the limits of motors into the tree, `effortLimit`; returns those of spatial tendons.

    Several actuators on one joint add up. Where a range is not symmetric, the larger side counts,
    with a note.
    """
    mj = compiled.mj
    model = tree.model
    of_lines = dict[str, float]()
    limited = getattr(mj, "jnt_actfrclimited", np.zeros(0))
    for target in map(int, np.flatnonzero(limited)):
        dof = int(mj.jnt_dofadr[target])
        if mj.jnt_type[target] in (HINGE, SLIDE) and dof in tree.dofs:
            force = mj.jnt_actfrcrange[target]
            effort = _effort(compiled, f"joint {compiled.joint(target)}", force)
            model.effortLimit[tree.dofs.index(dof)] = effort
    for (kind, target), force in _ranges(compiled).items():
        if kind == "joint" and mj.jnt_type[target] in (HINGE, SLIDE):
            effort = _effort(compiled, f"joint {compiled.joint(target)}", force)
            if np.isfinite(effort):
                model.effortLimit[tree.dofs.index(mj.jnt_dofadr[target])] = effort
        elif kind == "tendon":
            name = compiled.name("tendon", target)
            effort = _effort(compiled, f"tendon {name}", force)
            if compiled.is_spatial(target):
                of_lines[name] = effort
            elif np.isfinite(effort):
                text = f"the limit {effort:g} of its motor is not kept: it acts on several joints"
                compiled.notes.append(f"tendon {name}: {text}")
    return of_lines


def _ranges(compiled: Compiled) -> dict[tuple[str, int], Array]:
    """The range of the force of all actuators on a target, by its kind and index."""
    mj = compiled.mj
    ranges = dict[tuple[str, int], Array]()
    for actuator in actuators(compiled):
        key = actuator.kind, actuator.target
        of_one = np.zeros(2)
        if actuator.gear:  # the range may be infinite
            of_one = np.sort(actuator.gear * _range_of(compiled, actuator.number))
        ranges[key] = ranges.get(key, 0.0) + of_one
    for (kind, target), force in ranges.items():
        prefix = {"joint": "jnt", "tendon": "tendon"}.get(kind, "")
        limited = getattr(mj, f"{prefix}_actfrclimited", None)
        if limited is not None and limited[target]:
            force[:] = np.clip(force, *getattr(mj, f"{prefix}_actfrcrange")[target])
    return ranges


def _range_of(compiled: Compiled, i: int) -> Array:
    """The range of the force of one actuator, before its gear."""
    mj = compiled.mj
    mujoco = compiled.mujoco
    force = _ANY.copy()
    first = getattr(mj, "actuator_ctrladr", np.arange(mj.nu))[i]
    is_force = mj.actuator_gaintype[i] == int(mujoco.mjtGain.mjGAIN_FIXED)
    is_force = is_force and mj.actuator_biastype[i] == int(mujoco.mjtBias.mjBIAS_NONE)
    is_force = is_force and mj.actuator_dyntype[i] == int(mujoco.mjtDyn.mjDYN_NONE)
    if is_force and mj.actuator_ctrllimited[first]:  # else the control is a position or a rate
        force = np.sort(mj.actuator_gainprm[i, 0] * mj.actuator_ctrlrange[first])
    if mj.actuator_forcelimited[i]:
        force = np.clip(force, *mj.actuator_forcerange[i])
    return np.asarray(force)


def _effort(compiled: Compiled, where: str, force: Array) -> float:
    """The larger side of a range of forces."""
    low, high = force
    effort = float(max(abs(low), abs(high)))
    if np.isfinite(effort) and low != -high:
        text = f"its motor gives {low:g} to {high:g}; {effort:g} is kept for both directions"
        compiled.notes.append(f"{where}: {text}")
    return effort
