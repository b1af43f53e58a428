# SPDX-License-Identifier: BSD-2-Clause
"""Closures of an MJCF.

Equalities become closures: points, welds, couplings of joints and fixed tendons, and rods, which
are spatial tendons of constant length. A fixed tendon is a sum of joint positions, a spatial tendon
a line; see `mjcf_compiled`.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.closures import Closure, Constraint, Coupling, Distance
from .mjcf_compiled import Compiled, pose_of
from .mjcf_lines import line_problem
from .mjcf_tree import MjcfTree
from .robot_file import naming

#: Number of coefficients of an equality's polynomial. They are the first entries of `eq_data`.
_COEFFICIENTS = 5
#: Index of a weld's torque scale in `eq_data`. If the scale is 0, the bodies can rotate.
_TORQUESCALE = 10


def tendon_couplings(compiled: Compiled, tree: MjcfTree) -> Iterator[Coupling]:
    """Couplings of the joints that the tree has for fixed tendons.

    The position of such a joint is the length of the tendon: the sum of coefficients times
    positions of joints. What locked joints add to this sum is constant: the offset.
    """
    mj = compiled.mj
    for tendon in tree.tendons:
        polynomials = dict[str, tuple[float, float]]()
        sum_of_moving = 0.0  # what the joints that are not locked add at `qpos0`
        for joint, coefficient in compiled.coefficients(tendon).items():
            polynomials[compiled.joint_name(joint)] = (0.0, coefficient)
            sum_of_moving += coefficient * mj.qpos0[mj.jnt_qposadr[joint]]
        offset = compiled.tendon_length(tendon, mj.qpos0) - sum_of_moving
        yield Coupling(compiled.name("tendon", tendon), polynomials, float(offset))


def add_closures(compiled: Compiled, tree: MjcfTree) -> list[Constraint]:
    """The closures of the active equalities; adds frames at their ends to the tree.

    An equality that cannot be a closure adds a problem to `compiled.problems`.
    """
    mj = compiled.mj
    kinds = compiled.mujoco.mjtEq
    closures = list[Constraint]()
    for i in map(int, np.flatnonzero(mj.eq_active0)):
        name = compiled.name("equality", i)
        kind = kinds(mj.eq_type[i])
        first = int(mj.eq_obj1id[i])
        second = int(mj.eq_obj2id[i])  # -1 for none
        data = mj.eq_data[i]
        if kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            closures.append(_add_closure(compiled, tree, i, name))
        elif kind == kinds.mjEQ_TENDON and second < 0 and compiled.is_spatial(first):
            # Without a second tendon, the equality keeps the length of the first one constant.
            closures += _rod(compiled, name, first, float(data[0]))
        elif kind == kinds.mjEQ_TENDON:
            left = _tendon_side(compiled, first)
            right = _tendon_side(compiled, second)
            closures += _coupling(compiled, name, left, right, data[:_COEFFICIENTS])
        elif kind == kinds.mjEQ_JOINT:
            left = _joint_side(compiled, first)
            right = _joint_side(compiled, second)
            closures += _coupling(compiled, name, left, right, data[:_COEFFICIENTS])
        else:
            what = kind.name.removeprefix("mjEQ_").lower()
            text = 'only connect, weld, joint and tendon are supported; active="false" disables it'
            compiled.problems.append(f"{name}: an equality of kind {what}; {text}")
    return closures


def _add_closure(compiled: Compiled, tree: MjcfTree, i: int, name: str) -> Closure:
    """The closure of equality `i`, which connects or welds two bodies or two sites.

    If it names bodies, it adds a frame on each of them to the tree.
    """
    mj = compiled.mj
    is_weld = compiled.mujoco.mjtEq(mj.eq_type[i]) == compiled.mujoco.mjtEq.mjEQ_WELD
    first = int(mj.eq_obj1id[i])
    second = int(mj.eq_obj2id[i])
    data = mj.eq_data[i]
    kind = "6d" if is_weld and data[_TORQUESCALE] else "3d"
    if mj.eq_objtype[i] == int(compiled.mujoco.mjtObj.mjOBJ_SITE):
        return Closure(compiled.name("site", first), compiled.name("site", second), kind)
    if is_weld:
        # MuJoCo stores the anchor's position in the second body, then the pose in the first body of
        # a frame at the anchor with the axes of the second body.
        on_first = pose_of(data[3:6], data[6:10])
        on_second = pin.SE3(np.eye(3), data[:3])
    else:  # the anchor's position in each body
        on_first = pin.SE3(np.eye(3), data[:3])
        on_second = pin.SE3(np.eye(3), data[3:6])
    tree.add_frame(f"{name}_A", first, on_first)
    tree.add_frame(f"{name}_B", second, on_second)
    return Closure(f"{name}_A", f"{name}_B", kind)


def _rod(compiled: Compiled, name: str, tendon: int, extension: float) -> Iterator[Distance]:
    """A spatial tendon of constant length: its length at `qpos0` plus an extension, [m]."""
    problem = line_problem(compiled, tendon)
    if problem:
        compiled.problems.append(f"{name}: {problem}")
        return
    site_a, site_b = compiled.mj.wrap_objid[compiled.wraps(tendon)]
    length = float(compiled.mj.tendon_length0[tendon]) + extension
    with naming(compiled.source):
        yield Distance(compiled.name("site", site_a), compiled.name("site", site_b), length)


class _Side(NamedTuple):
    """A side of an equality: the sum of coefficient times position over some joints."""

    #: Coefficients by the names of the joints; empty for a constant.
    coefficients: dict[str, float]
    #: The sum at MuJoCo's reference configuration `qpos0`.
    at_qpos0: float


def _tendon_side(compiled: Compiled, tendon: int) -> _Side:
    """The length of a fixed tendon; index -1 means that there is none."""
    if tendon < 0:
        return _side(compiled, {})
    if compiled.is_spatial(tendon):
        text = "a spatial tendon in an equality; only fixed tendons are supported there"
        compiled.problems.append(f"{compiled.name('tendon', tendon)}: {text}")
        return _side(compiled, {})
    return _side(compiled, compiled.coefficients(tendon))


def _joint_side(compiled: Compiled, joint: int) -> _Side:
    """The position of a joint; zero if it is locked. Index -1 means that there is none."""
    if joint < 0 or compiled.is_locked(joint):
        return _side(compiled, {})
    return _side(compiled, {joint: 1.0})


def _side(compiled: Compiled, coefficients: dict[int, float]) -> _Side:
    """A side of an equality, from coefficients by the indices of joints."""
    mj = compiled.mj
    at_qpos0 = 0.0
    by_name = dict[str, float]()
    for joint, coefficient in coefficients.items():
        at_qpos0 += coefficient * mj.qpos0[mj.jnt_qposadr[joint]]
        by_name[compiled.joint_name(joint)] = coefficient
    return _Side(by_name, float(at_qpos0))


class _Equation(NamedTuple):
    """An equation of joint positions x_j: 0 = constant + sum of p_j(x_j) over some joints."""

    constant: float
    #: Coefficients of the polynomial p_j, by joint: of 1, x_j, x_j^2 and so on. The first
    #: coefficient is 0, the last is not.
    polynomials: dict[str, Array]


def _equation(left: _Side, right: _Side, coefficients: Array) -> _Equation:
    """The equation 0 = -(left - left_0) + P(right - right_0).

    left_0 and right_0 are the sums at `qpos0`; P has these coefficients, the constant first.
    """
    P = np.polynomial.Polynomial(coefficients)
    polynomials = dict[str, Array]()
    for joint, coefficient in left.coefficients.items():
        polynomials[joint] = np.zeros(_COEFFICIENTS)
        polynomials[joint][1] = -coefficient
    for joint, coefficient in right.coefficients.items():
        # With this joint alone, right = coefficient x, and P(coefficient x - right_0) is a
        # polynomial in x. Polynomials of several joints add up only if P is linear; `_coupling`
        # refuses other sums.
        shifted = np.polynomial.Polynomial([-right.at_qpos0, coefficient])
        powers = np.asarray(P(shifted).coef, dtype=float)
        of_joint = polynomials.setdefault(joint, np.zeros(_COEFFICIENTS))
        of_joint[1 : len(powers)] += powers[1:]  # `constant` below has the constant terms
    without_zeros = dict[str, Array]()
    for joint, powers in polynomials.items():
        if powers.any():
            without_zeros[joint] = np.trim_zeros(powers, "b")
    constant = left.at_qpos0 + P(-right.at_qpos0)  # the equation's right side where all x_j = 0
    return _Equation(float(constant), without_zeros)


def _coupling(
    compiled: Compiled, name: str, left: _Side, right: _Side, coefficients: Array
) -> Iterator[Coupling]:
    """The coupling left - left_0 = P(right - right_0), if not all its joints are locked.

    Its equation is solved for the position of one joint, the follower, whose polynomial is linear.
    With p_follower(x) = slope x,

        x_follower = (constant + sum of the other p_j) / -slope.
    """
    equation = _equation(left, right, coefficients)
    if not equation.polynomials and not equation.constant:
        return

    # The follower is a joint of the left side if there is one. Of several joints, the one with the
    # largest slope follows, since this division has the smallest rounding.
    slopes = dict[str, float]()  # of the linear polynomials
    for joint, powers in equation.polynomials.items():
        if len(powers) == 2:
            slopes[joint] = float(powers[1])
    candidates = list(left.coefficients)
    if not candidates:
        candidates = list(slopes)
    follower = max(candidates, key=lambda joint: abs(slopes.get(joint, 0.0)), default="")
    is_curved_sum = coefficients[2:].any() and len(right.coefficients) > 1
    if follower not in slopes or is_curved_sum:
        text = f"{name}: this equality cannot be solved for a joint: "
        text += "lock both sides or none, and use polynomials of one joint only"
        compiled.problems.append(text)
        return
    slope = slopes[follower]
    polynomials = dict[str, tuple[float, ...]]()
    for joint, powers in equation.polynomials.items():
        if joint != follower:
            polynomials[joint] = tuple(powers / -slope)
    yield Coupling(follower, polynomials, equation.constant / -slope)
