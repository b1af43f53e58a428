# SPDX-License-Identifier: BSD-2-Clause
"""Closures, motors and lines of an MJCF.

Equalities are points, welds, couplings of joints and fixed tendons, and rods, which are spatial
tendons of constant length; actuators are motors; spatial tendons are forces along lines.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.checks import Motor, tendon_of
from ..model.closures import Closure, Constraint, Coupling, Distance
from ..model.lines import LineForce
from .mjcf_compiled import HINGE, SLIDE, Compiled, pose_of
from .mjcf_tree import MjcfTree
from .robot_file import naming

#: Larger limits are none, [m].
_FAR = 1e9
#: Index of a weld's torque scale in `eq_data`; with 0 the bodies can turn.
_TORQUESCALE = 10


def closures_of(compiled: Compiled, tree: MjcfTree) -> Iterator[Constraint]:
    """Closures of the active equalities; frames of their ends are added to the tree."""
    mj, kinds = compiled.mj, compiled.mujoco.mjtEq
    for i in map(int, np.flatnonzero(mj.eq_active0)):
        name, kind = compiled.name("equality", i), kinds(mj.eq_type[i])
        ends, data = (int(mj.eq_obj1id[i]), int(mj.eq_obj2id[i])), mj.eq_data[i]
        if kind == kinds.mjEQ_TENDON and ends[1] < 0 and compiled.is_spatial(ends[0]):
            yield from _rod(compiled, name, ends[0], float(data[0]))
        elif kind in (kinds.mjEQ_JOINT, kinds.mjEQ_TENDON):
            first, second = (_length(compiled, kind == kinds.mjEQ_TENDON, end) for end in ends)
            yield from _coupling(compiled, name, first, second, data[:5])
        elif kind not in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            what = kind.name.removeprefix("mjEQ_").lower()
            text = 'only connect, weld, joint and tendon are supported; active="false" disables it'
            compiled.problems.append(f"{name}: an equality of kind {what}; {text}")
        else:
            turns = kind == kinds.mjEQ_CONNECT or not data[_TORQUESCALE]  # freely
            names = f"{name}_A", f"{name}_B"
            if mj.eq_objtype[i] == int(compiled.mujoco.mjtObj.mjOBJ_SITE):
                names = compiled.name("site", ends[0]), compiled.name("site", ends[1])
            else:
                places = [pin.SE3(np.eye(3), data[:3]), pin.SE3(np.eye(3), data[3:6])]
                if kind == kinds.mjEQ_WELD:  # pose of the second body in the first, then anchor
                    places = [pose_of(data[3:6], data[6:10]), pin.SE3(np.eye(3), data[:3])]
                for frame, body, place in zip(names, ends, places, strict=True):
                    tree.add_frame(frame, body, place)
            yield Closure(*names, "3d" if turns else "6d")


def _rod(compiled: Compiled, name: str, tendon: int, longer: float) -> Iterator[Distance]:
    """A spatial tendon whose length stays that at the reference plus the constant `longer`."""
    if problem := _no_line(compiled, tendon):
        compiled.problems.append(f"{name}: {problem}")
        return
    a, b = (compiled.name("site", k) for k in compiled.mj.wrap_objid[compiled.wraps(tendon)])
    with naming(compiled.source):
        yield Distance(a, b, float(compiled.mj.tendon_length0[tendon]) + longer)


#: A sum of joints by name, and its value with all joints at their reference.
_Length = tuple[dict[str, float], float]


def _length(compiled: Compiled, of_tendon: bool, index: int) -> _Length:
    """A fixed tendon, or a joint as a tendon of one joint; index -1 means none."""
    mj, shares = compiled.mj, dict[int, float]()
    if of_tendon and index >= 0 and compiled.is_spatial(index):
        text = "a spatial tendon in an equality; only fixed tendons are supported there"
        compiled.problems.append(f"{compiled.name('tendon', index)}: {text}")
    elif of_tendon and index >= 0:
        shares = compiled.shares(index)
    elif index >= 0 and not compiled.is_locked(index):
        shares = {index: 1.0}
    start = sum(share * mj.qpos0[mj.jnt_qposadr[j]] for j, share in shares.items())
    return {compiled.joint(j): share for j, share in shares.items()}, float(start)


def _coupling(
    compiled: Compiled, name: str, first: _Length, second: _Length, coefficients: Array
) -> Iterator[Coupling]:
    """The coupling that makes first - start a polynomial of second - start."""
    (shares, offset), (others, start) = first, second
    polynomial = np.polynomial.Polynomial(coefficients)
    row = {joint: np.array([0.0, -share, 0.0, 0.0, 0.0]) for joint, share in shares.items()}
    for joint, share in others.items():
        powers = polynomial(np.polynomial.Polynomial([-start, share])).coef
        row.setdefault(joint, np.zeros(5))[1 : len(powers)] += powers[1:]
    offset += polynomial(-start)
    row = {joint: np.trim_zeros(powers, "b") for joint, powers in row.items() if powers.any()}
    if not row and not offset:
        return  # all joints that it couples are locked
    slopes = {joint: abs(powers[1]) for joint, powers in row.items() if len(powers) == 2}
    joint = max(shares or slopes, key=lambda joint: slopes.get(joint, 0.0), default="")
    if joint not in slopes or (coefficients[2:].any() and len(others) > 1):
        text = f"{name}: this equality cannot be solved for a joint: "
        text += "lock both sides or none, and use polynomials of one joint only"
        compiled.problems.append(text)
        return
    slope = row.pop(joint)[1]
    polynomials = {joint: tuple(powers / -slope) for joint, powers in row.items()}
    yield Coupling(joint, polynomials, float(offset / -slope))


class Actuator(NamedTuple):
    """An actuator, and the kind and index of its target, such as a joint or a tendon."""

    number: int
    name: str
    kind: str
    target: int
    controls: int
    gear: float


def actuators(compiled: Compiled) -> Iterator[Actuator]:
    """Actuators that are not switched off and whose joint is not locked.

    Since MuJoCo 4 an actuator can have several controls and outputs.
    """
    mj, kinds = compiled.mj, compiled.mujoco.mjtTrn
    outputs = getattr(mj, "actuator_outadr", range(mj.nu))
    controls = getattr(mj, "actuator_ctrlnum", [1] * mj.nu)
    for i in range(len(outputs)):
        kind = kinds(mj.actuator_trntype[i]).name.removeprefix("mjTRN_").lower()
        kind, target = kind.removesuffix("inparent"), int(mj.actuator_trnid[i, 0])
        off = mj.opt.disableactuator >> mj.actuator_group[i] & 1 or compiled.disabled("actuation")
        if not off and not (kind == "joint" and compiled.is_locked(target)):
            gear = mj.actuator_gear[outputs[i], 0]
            yield Actuator(i, compiled.name("actuator", i), kind, target, int(controls[i]), gear)


def _fixed_tendon(compiled: Compiled, tendon: int) -> Motor:
    shares = compiled.shares(tendon)
    return {compiled.name("tendon", tendon): {compiled.joint(j): x for j, x in shares.items()}}


def named_motors(compiled: Compiled, motors: Sequence[Motor]) -> tuple[Motor, ...]:
    """Motors that a caller names, with fixed tendons in the place of their names."""
    joints = {compiled.joint(joint) for joint in range(compiled.mj.njnt)}
    fixed = (i for i in range(compiled.mj.ntendon) if not compiled.is_spatial(i))
    tendons = {compiled.name("tendon", i): _fixed_tendon(compiled, i) for i in fixed}
    alone = tendons.keys() - joints
    return tuple(tendons[m] if isinstance(m, str) and m in alone else m for m in motors)


def motors_of(compiled: Compiled, tree: MjcfTree) -> Iterator[Motor]:
    """Joints and tendons that actuators with a control act on, each once."""
    mj, seen = compiled.mj, set[tuple[str, int]]()
    for _, name, kind, target, controls, gear in actuators(compiled):
        problem, tendon = "", kind == "tendon"
        if not controls or (kind, target) in seen:
            continue
        if kind not in ("joint", "tendon"):
            problem = f"an actuator on a {kind}, not on a joint or a tendon"
        elif not tendon and mj.jnt_type[target] not in (HINGE, SLIDE):
            problem = "an actuator on a ball or a free joint; use hinges in series"
        elif not gear:
            problem = "its gear is 0, so it moves nothing"
        elif not tendon:
            yield compiled.joint(target)
        elif compiled.is_spatial(target):
            ends = () if _no_line(compiled, target) else mj.wrap_objid[compiled.wraps(target)]
            bearers = {tree.bodies[mj.site_bodyid[site]][0] for site in ends}
            if len(bearers) != 1:  # `lines_of` says why there is no line
                yield compiled.name("tendon", target)
        elif compiled.shares(target):
            yield _fixed_tendon(compiled, target)
        elif not mj.wrap_prm[compiled.wraps(target)].any():
            problem = "the coefficients of its tendon are 0"
        if problem:
            compiled.problems.append(f"{name}: {problem}; name the motors by actuated=")
        seen.add((kind, target))


def lines_of(
    compiled: Compiled, motors: Sequence[Motor], efforts: Mapping[str, float]
) -> Iterator[LineForce]:
    """Spatial tendons with a spring, a damper or inertia, and those that are motors.

    `efforts` are the largest forces of motors on tendons, by name.
    """
    mj = compiled.mj
    driven = {name for motor in motors for name in tendon_of(motor)[1]}
    for tendon in range(mj.ntendon):
        name = compiled.name("tendon", tendon)
        limited = mj.tendon_limited[tendon] and not compiled.disabled("limit")
        stiffness = mj.tendon_stiffness[tendon] * (not compiled.disabled("spring"))
        damping = mj.tendon_damping[tendon] * (not compiled.disabled("damper"))
        mass = getattr(mj, "tendon_armature", np.zeros(mj.ntendon))[tendon]
        acts = stiffness or damping or mass or name in driven
        if not compiled.is_spatial(tendon) or not acts:
            if limited:
                compiled.notes.append(f"tendon {name}: its limits are ignored")
            continue
        shortest, longest = mj.tendon_lengthspring[tendon]
        problem = _no_line(compiled, tendon)
        if stiffness and shortest != longest:
            problem = problem or "a springlength with a dead band is not supported; give one number"
        if problem:
            compiled.problems.append(f"tendon {name}: {problem}")
            continue
        ends = (compiled.name("site", mj.wrap_objid[k]) for k in compiled.wraps(tendon))
        values = {"stiffness": stiffness, "rest_length": shortest if stiffness else 0.0}
        low, high = mj.tendon_range[tendon] if limited else (0.0, np.inf)
        upper = high if high < _FAR else np.inf
        values |= {"lower": max(low, 0.0), "upper": upper, "effort": efforts.get(name, np.inf)}
        with naming(compiled.source):
            yield LineForce(*ends, **values, damping=damping, mass=mass, name=name)


def _no_line(compiled: Compiled, tendon: int) -> str:
    """Why a spatial tendon cannot be a line between two sites; empty if it can."""
    mj = compiled.mj
    kinds = mj.wrap_type[compiled.wraps(tendon)]
    if (kinds != int(compiled.mujoco.mjtWrap.mjWRAP_SITE)).any():
        return "a tendon with pulleys or around geoms is not supported"
    if len(kinds) != 2:
        return f"a tendon through {len(kinds)} sites is not supported; two are"
    joints = map(compiled.joint, range(mj.njnt))
    return "a joint has this name too; rename one" * (compiled.name("tendon", tendon) in joints)
