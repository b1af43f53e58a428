# SPDX-License-Identifier: BSD-2-Clause
"""Closures, motors and lines of an MJCF.

Equalities become closures: points, welds, couplings of joints and fixed tendons, and rods, which
are spatial tendons of constant length. Actuators become motors. Spatial tendons become forces along
lines.

`Compiled` is the file as MuJoCo compiles it; a function here that cannot read an element adds a
text to `compiled.problems`.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
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

#: Longer limits of tendons are ignored, [m].
_FAR = 1e9
#: MuJoCo's polynomials of equalities have five coefficients, the first in `eq_data`.
_COEFFICIENTS = 5
#: Index of a weld's torque scale in `eq_data`. If the scale is 0, the bodies can rotate.
_TORQUESCALE = 10


def closures_of(compiled: Compiled, tree: MjcfTree) -> Iterator[Constraint]:
    """Closures of the active equalities; frames of their ends are added to the tree.

    Couplings of the joints of fixed tendons come first: position = sum of coefficient * position.
    """
    mj = compiled.mj
    for tendon in tree.tendons:
        shares = compiled.coefficients(tendon)
        polynomials = {compiled.joint_name(joint): (0.0, share) for joint, share in shares.items()}
        moving = sum(share * mj.qpos0[mj.jnt_qposadr[joint]] for joint, share in shares.items())
        offset = compiled.tendon_length(tendon, mj.qpos0) - moving  # of joints that are locked
        yield Coupling(compiled.name("tendon", tendon), polynomials, float(offset))
    kinds = compiled.mujoco.mjtEq
    for i in map(int, np.flatnonzero(mj.eq_active0)):
        name = compiled.name("equality", i)
        kind = kinds(mj.eq_type[i])
        first = int(mj.eq_obj1id[i])
        second = int(mj.eq_obj2id[i])
        data = mj.eq_data[i]
        if kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            yield _closure(compiled, tree, i, name)
        elif kind == kinds.mjEQ_TENDON and second < 0 and compiled.is_spatial(first):
            # Without a second tendon, the equality keeps the length of the first one constant.
            yield from _rod(compiled, name, first, float(data[0]))
        elif kind == kinds.mjEQ_TENDON:
            first_length = _tendon_length(compiled, first)
            second_length = _tendon_length(compiled, second)
            coefficients = data[:_COEFFICIENTS]
            yield from _coupling(compiled, name, first_length, second_length, coefficients)
        elif kind == kinds.mjEQ_JOINT:
            first_length = _joint_length(compiled, first)
            second_length = _joint_length(compiled, second)
            coefficients = data[:_COEFFICIENTS]
            yield from _coupling(compiled, name, first_length, second_length, coefficients)
        else:
            what = kind.name.removeprefix("mjEQ_").lower()
            text = 'only connect, weld, joint and tendon are supported; active="false" disables it'
            compiled.problems.append(f"{name}: an equality of kind {what}; {text}")


def _closure(compiled: Compiled, tree: MjcfTree, i: int, name: str) -> Closure:
    """The closure of equality `i`, which connects or welds two bodies or two sites."""
    mj = compiled.mj
    is_weld = compiled.mujoco.mjtEq(mj.eq_type[i]) == compiled.mujoco.mjtEq.mjEQ_WELD
    ends = int(mj.eq_obj1id[i]), int(mj.eq_obj2id[i])
    data = mj.eq_data[i]
    kind = "6d" if is_weld and data[_TORQUESCALE] else "3d"
    if mj.eq_objtype[i] == int(compiled.mujoco.mjtObj.mjOBJ_SITE):
        return Closure(compiled.name("site", ends[0]), compiled.name("site", ends[1]), kind)
    if is_weld:
        # MuJoCo stores the anchor in the second body, then the pose that the anchor, with the
        # axes of the second body, has in the first body.
        places = [pose_of(data[3:6], data[6:10]), pin.SE3(np.eye(3), data[:3])]
    else:
        places = [pin.SE3(np.eye(3), data[:3]), pin.SE3(np.eye(3), data[3:6])]
    tree.add_frame(f"{name}_A", ends[0], places[0])
    tree.add_frame(f"{name}_B", ends[1], places[1])
    return Closure(f"{name}_A", f"{name}_B", kind)


def _rod(compiled: Compiled, name: str, tendon: int, extension: float) -> Iterator[Distance]:
    """A spatial tendon of constant length: its length at `qpos0` plus an extension."""
    problem = _line_problem(compiled, tendon)
    if problem:
        compiled.problems.append(f"{name}: {problem}")
        return
    site_a, site_b = compiled.mj.wrap_objid[compiled.wraps(tendon)]
    length = float(compiled.mj.tendon_length0[tendon]) + extension
    with naming(compiled.source):
        yield Distance(compiled.name("site", site_a), compiled.name("site", site_b), length)


class _Length(NamedTuple):
    """A side of an equality: the sum of factor times position over some joints."""

    #: Factors by the names of the joints; empty for a constant.
    factors: dict[str, float]
    #: The sum at MuJoCo's reference configuration `qpos0`.
    reference: float


def _tendon_length(compiled: Compiled, tendon: int) -> _Length:
    """The length of a fixed tendon; index -1 means that there is none."""
    if tendon < 0:
        return _length(compiled, {})
    if compiled.is_spatial(tendon):
        text = "a spatial tendon in an equality; only fixed tendons are supported there"
        compiled.problems.append(f"{compiled.name('tendon', tendon)}: {text}")
        return _length(compiled, {})
    return _length(compiled, compiled.coefficients(tendon))


def _joint_length(compiled: Compiled, joint: int) -> _Length:
    """The position of a joint; zero if it is locked. Index -1 means that there is none."""
    if joint < 0 or compiled.is_locked(joint):
        return _length(compiled, {})
    return _length(compiled, {joint: 1.0})


def _length(compiled: Compiled, factors: dict[int, float]) -> _Length:
    """A side of an equality, from factors by the indices of joints."""
    mj = compiled.mj
    reference = 0.0
    factors_by_name = dict[str, float]()
    for joint, factor in factors.items():
        reference += factor * mj.qpos0[mj.jnt_qposadr[joint]]
        factors_by_name[compiled.joint_name(joint)] = factor
    return _Length(factors_by_name, float(reference))


def _coupling(
    compiled: Compiled, name: str, first: _Length, second: _Length, coefficients: Array
) -> Iterator[Coupling]:
    """The coupling first - first.reference = P(second - second.reference), with a polynomial P.

    As one equation: offset + sum over the joints of p_j(position of joint j) = 0, with polynomials
    p_j without a constant. It is solved for a joint whose polynomial is linear, the follower:

        follower = (offset + sum of the other p_j) / -slope, with p_follower(x) = slope x.

    Args:
        compiled: The model.
        name: Name of the equality.
        first: The side without a polynomial.
        second: The side of which the polynomial is.
        coefficients: Of P, the constant first.
    """
    polynomial = np.polynomial.Polynomial(coefficients)
    # p_j by joint, as coefficients; the constant term of each is 0.
    row = dict[str, Array]()
    for joint, factor in first.factors.items():
        row[joint] = np.zeros(_COEFFICIENTS)
        row[joint][1] = -factor
    for joint, factor in second.factors.items():
        # P(factor x - reference) in powers of the position x of this joint alone. The parts of
        # several joints add up only if P is linear; other sums are refused below.
        in_powers_of_x = polynomial(np.polynomial.Polynomial([-second.reference, factor])).coef
        powers = np.asarray(in_powers_of_x, dtype=float)
        row.setdefault(joint, np.zeros(_COEFFICIENTS))[1 : len(powers)] += powers[1:]
    offset = first.reference + polynomial(-second.reference)
    row = {joint: np.trim_zeros(powers, "b") for joint, powers in row.items() if powers.any()}
    if not row and not offset:
        return  # all joints that it couples are locked

    # The follower: a joint of the first side if there is one. Among several, the largest slope
    # divides with the smallest rounding.
    slopes = {joint: abs(powers[1]) for joint, powers in row.items() if len(powers) == 2}
    candidates = first.factors or slopes
    follower = max(candidates, key=lambda joint: slopes.get(joint, 0.0), default="")
    is_curved_sum = coefficients[2:].any() and len(second.factors) > 1
    if follower not in slopes or is_curved_sum:
        text = f"{name}: this equality cannot be solved for a joint: "
        text += "lock both sides or none, and use polynomials of one joint only"
        compiled.problems.append(text)
        return
    slope = row.pop(follower)[1]
    polynomials = {joint: tuple(powers / -slope) for joint, powers in row.items()}
    yield Coupling(follower, polynomials, float(offset / -slope))


class Actuator(NamedTuple):
    """An actuator that is not switched off."""

    #: Its index in MuJoCo, and its name.
    number: int
    name: str
    #: What it acts on: the kind, such as "joint" or "tendon", and the index of this element.
    kind: str
    target: int
    #: Number of its controls.
    controls: int
    #: The force on the target is gear times the force of the actuator.
    gear: float


def actuators(compiled: Compiled) -> Iterator[Actuator]:
    """Actuators that are not switched off and whose joint is not locked.

    Since MuJoCo 4 an actuator can have several controls and outputs.
    """
    mj = compiled.mj
    kinds = compiled.mujoco.mjtTrn
    outputs = getattr(mj, "actuator_outadr", range(mj.nu))
    control_counts = getattr(mj, "actuator_ctrlnum", [1] * mj.nu)
    for i in range(len(outputs)):
        # "jointinparent" means the same as "joint" for hinges and slides.
        kind = kinds(mj.actuator_trntype[i]).name.removeprefix("mjTRN_").lower()
        kind = kind.removesuffix("inparent")
        target = int(mj.actuator_trnid[i, 0])
        group_is_off = mj.opt.disableactuator >> mj.actuator_group[i] & 1
        if group_is_off or compiled.disabled("actuation"):
            continue
        if kind == "joint" and compiled.is_locked(target):
            continue
        name = compiled.name("actuator", i)
        gear = mj.actuator_gear[outputs[i], 0]
        yield Actuator(
            number=i,
            name=name,
            kind=kind,
            target=target,
            controls=int(control_counts[i]),
            gear=gear,
        )


def _fixed_tendon(compiled: Compiled, tendon: int) -> Motor:
    """A fixed tendon as a motor: its name with the factors of its joints."""
    shares = compiled.coefficients(tendon)
    factors = {compiled.joint_name(joint): share for joint, share in shares.items()}
    return {compiled.name("tendon", tendon): factors}


def named_motors(compiled: Compiled, motors: Sequence[Motor]) -> tuple[Motor, ...]:
    """Motors that a caller names, each name of a fixed tendon replaced by its joints.

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


def motors_of(compiled: Compiled, tree: MjcfTree) -> Iterator[Motor]:
    """Joints and tendons that actuators with a control act on, each once."""
    targets = set[tuple[str, int]]()
    for actuator in actuators(compiled):
        target = (actuator.kind, actuator.target)
        if not actuator.controls or target in targets:
            continue
        targets.add(target)
        problem = _motor_problem(compiled, actuator)
        if problem:
            text = f"{actuator.name}: {problem}; name the motors by actuated="
            compiled.problems.append(text)
        elif actuator.kind == "joint":
            yield compiled.joint_name(actuator.target)
        elif compiled.is_spatial(actuator.target):
            if not _is_within_one_body(compiled, tree, actuator.target):
                yield compiled.name("tendon", actuator.target)
        elif compiled.coefficients(actuator.target):  # else all its joints are locked
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
    if _line_problem(compiled, tendon):
        return False
    sites = compiled.mj.wrap_objid[compiled.wraps(tendon)]
    joints = {tree.bodies[compiled.mj.site_bodyid[site]][0] for site in sites}
    return len(joints) == 1


def lines_of(
    compiled: Compiled,
    motors: Sequence[Motor],
    efforts: Mapping[str, float],
    ropes: Collection[str],
) -> Iterator[LineForce]:
    """Spatial tendons with a spring, a damper, friction or inertia, and those that are motors.

    Args:
        compiled: The model. It gets a note for each tendon whose limits are ignored.
        motors: Motors of the robot.
        efforts: The largest forces of motors on tendons, by name.
        ropes: Names of the tendons that are read as ropes, so that their limits are not ignored.
    """
    mj = compiled.mj
    driven = set[str]()  # names of joints and lines that motors act on
    for motor in motors:
        _, shares = tendon_of(motor)
        driven.update(shares)
    for tendon in range(mj.ntendon):
        name = compiled.name("tendon", tendon)
        # The forces of the tendon.
        has_limits = mj.tendon_limited[tendon] and not compiled.disabled("limit")
        stiffness = 0.0
        damping = 0.0
        dry_friction = 0.0
        if not compiled.disabled("spring"):
            stiffness = mj.tendon_stiffness[tendon]
        if not compiled.disabled("damper"):
            damping = mj.tendon_damping[tendon]
        if not compiled.disabled("frictionloss"):
            dry_friction = mj.tendon_frictionloss[tendon]
        mass = compiled.tendon_armature[tendon]
        exerts_force = stiffness or damping or dry_friction or mass or name in driven
        if not compiled.is_spatial(tendon) or not exerts_force:
            if has_limits and name not in ropes:
                compiled.notes.append(f"tendon {name}: its limits are ignored")
            continue

        # What a line cannot have.
        shortest, longest = mj.tendon_lengthspring[tendon]
        problem = _line_problem(compiled, tendon)
        if not problem and stiffness and shortest != longest:
            problem = "a springlength with a dead band is not supported; give one number"
        if problem:
            compiled.problems.append(f"tendon {name}: {problem}")
            continue

        # The line.
        lower = 0.0
        upper = np.inf
        if has_limits:
            lower, upper = mj.tendon_range[tendon]
        site_a, site_b = mj.wrap_objid[compiled.wraps(tendon)]
        with naming(compiled.source):
            yield LineForce(
                compiled.name("site", site_a),
                compiled.name("site", site_b),
                name=name,
                stiffness=stiffness,
                rest_length=shortest if stiffness else 0.0,
                damping=damping,
                coulomb_friction=dry_friction,
                mass=mass,
                lower=max(lower, 0.0),
                upper=upper if upper < _FAR else np.inf,
                effort=efforts.get(name, np.inf),
            )


def _line_problem(compiled: Compiled, tendon: int) -> str:
    """Why a spatial tendon cannot be a line between two sites; empty if it can."""
    mj = compiled.mj
    kinds = mj.wrap_type[compiled.wraps(tendon)]
    if (kinds != int(compiled.mujoco.mjtWrap.mjWRAP_SITE)).any():
        return "a tendon with pulleys or around geoms is not supported"
    if len(kinds) != 2:
        return f"a tendon through {len(kinds)} sites is not supported; two are"
    if compiled.name("tendon", tendon) in map(compiled.joint_name, range(mj.njnt)):
        return "a joint has this name too; rename one"
    return ""
