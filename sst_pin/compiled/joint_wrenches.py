# SPDX-License-Identifier: BSD-2-Clause
"""The kernel of `chain.reactions`: wrenches in joints and closures, on CasADi's symbols.

The method is that of `dynamics.reactions`, and `reactions` follows its steps:

1. The multipliers Lambda of the closures follow from the balance along the dependent rates,
   Phi_u^T Lambda = b_u, where b are the forces that the motion needs less those of the motors.
2. A row of Phi with the multiplier 1 exerts a wrench on each link. This wrench is the gradient of
   Phi v by the twist of the link, because Phi v is the power of the row (`on_links`).
3. A link needs a wrench for its motion. What the rows do not exert of it is left to the joints.
   The sum of this over all links that a joint carries is the wrench of the joint.
4. The multipliers of redundant rows are not unique. Each redundant row, together with the
   multipliers that balance it, is a state of inner stress. A component of a wrench that an inner
   stress changes is not unique.

A force along a line (spring, damper, cylinder) acts like the row of a closure whose multiplier is
known. The rows of lines are counted after the rows of closures.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
from casadi import SX

from ..dynamics.reactions import BITS, acts_along
from ..model.closures import Brake, Closure, Coupling, Distance, Rolling, frames_of
from ..model.thresholds import UNIQUE
from ..model.tree import frame_named
from .closure_rows import Row, closure_rows, velocities_by_twists
from .elimination import Factors, total
from .equations import Equations
from .kernel_checks import Checks
from .symbols import Sparse, add, column, sx


class _Wrenches(NamedTuple):
    """Wrenches in a robot, each [force; moment]."""

    #: The wrenches of joints, then those of closures, in one column. `Reactions` says on which body
    #: and in which axes each acts.
    values: SX
    #: The wrench of the ground on the robot, about the world's origin.
    ground: SX


def on_links(rows: Sequence[Row], v: Sparse) -> list[dict[int, SX]]:
    """For each row with the multiplier 1: its wrenches on links, by the index of the link.

    A wrench is [force; moment] about the origin of the link, in its axes.
    """
    velocities, twists = velocities_by_twists(rows, v)
    wrenches_of_rows = []
    for velocity in velocities:
        wrenches = dict[int, SX]()
        for link, twist in twists.items():
            wrench = ca.gradient(velocity, twist)
            if not wrench.is_zero():
                wrenches[link] = wrench
        wrenches_of_rows.append(wrenches)
    return wrenches_of_rows


def reactions(e: Equations, checks: Checks) -> tuple[dict[str, SX], SX, list[Any]]:
    """Inputs, results and checks of the kernel.

    The results are in a column, in the order of `dynamics.reactions.reactions`: wrenches of joints
    and of closures, the wrench of the ground, motor torques, and a code for each joint and closure:
    a bit mask of its components that are not unique.
    """
    mechanism = e.mechanism
    inputs = {"q": e.q, "va": e.va, "aa": e.aa}

    # Balance along the dependent rates: Phi_u^T Lambda = needed_u.
    needed = e.tree_forces
    checks_of_balance = list[Any]()
    if mechanism.driven_one_to_one:
        # The motors act on coordinates only, so they are not in the balance. tau follows from the
        # motion. `checks.of_forces` contains the check of the balance.
        tau = e.generalized_forces
    else:
        tau = e.tau
        inputs["tau"] = tau
        needed = add(needed, e.motor_forces(-tau))
        checks_of_balance = checks.unbalanced(needed)
    inputs["external_wrenches"] = e.loads

    # Rows of lines have the numbers after those of closures.
    Lambda = e.multipliers(needed) | _multipliers_of_lines(e, tau)
    wrenches_of_rows = on_links([*e.rows, *_rows_of_lines(e)], e.v)
    needed_by_links = e.tree.wrenches(e.v, e.dv)
    wrenches = _wrenches(e, wrenches_of_rows, Lambda, needed_by_links)

    # An inner stress has wrenches although the links need none.
    nothing_needed = [SX(6, 1) for _ in needed_by_links]
    stresses = []
    for multipliers in _inner_stresses(e):
        stress = _wrenches(e, wrenches_of_rows, multipliers, nothing_needed)
        stresses.append(stress.values)
    codes = _codes(stresses, wrenches.values.numel(), mechanism.length)

    results = ca.vertcat(wrenches.values, wrenches.ground, tau, *codes)
    return inputs, results, checks.of_forces + checks_of_balance


def _codes(stresses: Sequence[SX], size: int, length: float) -> list[SX]:
    """A code for each joint and closure: the sum of `BITS` of its components that are not unique.

    A component is unique if the sum of squares of its values in all inner stresses is small.

    Args:
        stresses: Wrenches of joints and closures in each state of inner stress, shape (size,).
        size: Number of components.
        length: Length of the robot. In a stress of unit size, moments are of the order 1, and
            forces of the order 1 / length.
    """
    codes = [SX(0)] * (size // 6)
    for k in range(size):
        wrench = k // 6
        component = k % 6
        squares = [stress[k] ** 2 for stress in stresses if not stress[k].is_zero()]
        if squares:
            is_force = component < 3
            unit = 1 / length if is_force else 1.0
            is_unique = total(squares) <= float((UNIQUE * unit) ** 2)  # 1 or 0
            codes[wrench] += float(BITS[component]) * (1 - is_unique)
    return codes


# --- lines --------------------------------------------------------------------------------------


def _rows_of_lines(e: Equations) -> list[Row]:
    """A row for each line between two frames.

    With the vector d between the frames, Phi v = d . d_dot. This is the length times its rate and
    needs no root. So the multiplier of such a row is a force divided by the length.
    """
    rows = list[Row]()
    for x in e.mechanism.lines.forces:
        rows += closure_rows(
            e.kinematics, e.mechanism.model, Distance(x.frame_a, x.frame_b, distance=1.0)
        )
    return rows


def _multipliers_of_lines(e: Equations, tau: SX) -> Sparse:
    """Multipliers of the rows of lines: forces that push the ends apart, divided by lengths.

    Springs, dampers, dry friction and masses pull the ends together. The motors push them apart.
    """
    multipliers = {}
    first = len(e.rows)
    pulls = e.tree.pulls(e.v)
    inertial_pulls = e.tree.inertial_pulls(e.v, e.dv)
    for k, factors in enumerate(e.mechanism.lines.actuation):
        pushes = [-(pulls[k] + inertial_pulls[k])]
        for motor, factor in enumerate(factors):
            if factor:
                pushes.append(float(factor) * tau[motor])
        multipliers[first + k] = total(pushes) / e.tree.lines[k].length
    return multipliers


# --- inner stresses -----------------------------------------------------------------------------


def _inner_stresses(e: Equations) -> list[Sparse]:
    """States of inner stress: multipliers of rows that together exert no force along the rates.

    There is one state for each row without a pivot. Rows with pivots balance it. In an `Orthogonal`
    no row has a pivot. There, each row is balanced by the shortest vector of multipliers of all
    rows.
    """
    with_pivots = set[int]()
    for part in e.factors.parts:
        if isinstance(part, Factors):
            with_pivots.update(part.rows)
    stresses = []
    for i, row in enumerate(e.rows):
        if i in with_pivots:
            continue
        balance = e.multipliers({j: -x for j, x in row.Phi.items()})
        # A unit multiplier of row i is a unit force or moment. Times the scale of the row it is a
        # stress of unit size, free of units.
        scale = float(e.mechanism.row_scale[i])
        stresses.append({k: scale * x for k, x in add(balance, {i: SX(1)}).items()})
    return stresses


# --- wrenches of joints and closures ------------------------------------------------------------


def _wrenches(
    e: Equations,
    wrenches_of_rows: Sequence[Mapping[int, SX]],
    Lambda: Sparse,
    needed: Sequence[SX],
) -> _Wrenches:
    """Wrenches of joints, closures and the ground, from multipliers of the rows.

    Args:
        e: The equations.
        wrenches_of_rows: Wrenches on links of each row, from `on_links`.
        Lambda: Multipliers, by row.
        needed: The wrench that each link needs for its motion.
    """
    mechanism = e.mechanism
    tree = e.kinematics.tree

    # Joints exert what rows do not exert.
    by_rows = [SX(6, 1) for _ in tree.links]
    for i, x in Lambda.items():
        for link, wrench in wrenches_of_rows[i].items():
            by_rows[link] += x * wrench
    by_joints = [x - y for x, y in zip(needed, by_rows, strict=True)]
    of_joints = e.kinematics.joint_wrenches(by_joints)
    wrenches = [of_joints[tree.link_of[j]] for j in range(1, mechanism.model.njoints)]

    first_row = 0
    for closure in mechanism.closures:
        rows = range(first_row, first_row + len(closure.rows))
        first_row = rows.stop
        if isinstance(closure, (Coupling, Brake)):
            force = Lambda.get(rows[0], SX(1, 1))
            wrenches.append(column({acts_along(mechanism, closure): force}, range(6)))
        else:
            wrenches.append(_on_frame_b(e, closure, rows, wrenches_of_rows, Lambda))
    return _Wrenches(values=ca.vertcat(*wrenches), ground=of_joints[0])


def _on_frame_b(
    e: Equations,
    closure: Closure | Distance | Rolling,
    rows: Sequence[int],
    wrenches_of_rows: Sequence[Mapping[int, SX]],
    Lambda: Sparse,
) -> SX:
    """The wrench of a closure on the link of its frame B, about the origin and in the axes of B."""
    _, name = frames_of(closure)
    frame = frame_named(e.mechanism.model, name)
    link = e.kinematics.tree.link_of[frame.parentJoint]
    on_link = SX(6, 1)  # about the origin and in the axes of the link
    for i in rows:
        if i in Lambda and link in wrenches_of_rows[i]:
            on_link += Lambda[i] * wrenches_of_rows[i][link]
    R = sx(frame.placement.rotation)
    p = sx(frame.placement.translation)
    force = on_link[:3]
    moment = on_link[3:] - ca.cross(p, force)
    return ca.vertcat(R.T @ force, R.T @ moment)
