# SPDX-License-Identifier: BSD-2-Clause
"""The kernel of `chain.reactions`: wrenches in joints and closures, on CasADi's symbols.

The method is that of `dynamics.reactions`:

1. A row of Phi with the multiplier 1 gives to each link the wrench that is the gradient of Phi v by
   the twist of the link, because Phi v is its power. `wrenches_of_rows` has these.
2. The multipliers Lambda follow from the balance along the dependent rates, Phi_u^T Lambda = b_u,
   where b is what the motion needs less what the motors give.
3. A joint gives to all that it carries what this needs for the motion, less what the rows give.
4. The multipliers of redundant rows are free: each redundant row, together with the multipliers
   that balance it, is a state of inner stress. A component that an inner stress changes is not
   unique.

A force along a line (spring, damper, cylinder) acts as the row of a closure whose multiplier is
known. The rows of lines have the numbers after those of closures.
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
    """Wrenches in a robot, [force; moment] in a column."""

    #: Those of joints, then of closures, in the axes of `Reactions`.
    values: SX
    #: The wrench of the ground on the robot at the world's origin.
    ground: SX


def on_links(rows: Sequence[Row], v: Sparse) -> list[dict[int, SX]]:
    """For each row with the multiplier 1 its wrenches on links, by the index of the link.

    They are [force; moment] about the origin of the link, in its axes.
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

    The results are a column as that of `dynamics.reactions.reactions`: wrenches of joints and
    closures, that of the ground, motor torques, and a code for each joint and closure.
    """
    mechanism = e.mechanism
    inputs = {"q": e.q, "va": e.va, "aa": e.aa}

    # Balance along the dependent rates: Phi_u^T Lambda = needed_u.
    needed = e.tree_forces
    checks_of_balance = list[Any]()
    if mechanism.driven_one_to_one:
        # The motors act on coordinates only. They are not in the balance, and tau follows from the
        # motion. `checks.of_forces` has the check of the balance.
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

    # An inner stress gives wrenches although the links need none.
    nothing_needed = [SX(6, 1) for _ in needed_by_links]
    stresses = []
    for multipliers in _inner_stresses(e):
        stress = _wrenches(e, wrenches_of_rows, multipliers, nothing_needed)
        stresses.append(stress.values)
    codes = _codes(stresses, wrenches.values.numel(), mechanism.length)

    results = ca.vertcat(wrenches.values, wrenches.ground, tau, *codes)
    return inputs, results, checks.of_forces + checks_of_balance


def _codes(stresses: Sequence[SX], size: int, length: float) -> list[SX]:
    """For each joint and closure the sum of `BITS` of its components that are not unique.

    A component is unique if the sum of squares of its values in all inner stresses is small.

    Args:
        stresses: Wrenches of joints and closures in each state of inner stress, shape (size,).
        size: Number of components.
        length: Length of the robot. In a stress of unit size, moments are of the order 1, and
            forces of the order 1 / length.
    """
    codes = [SX(0)] * (size // 6)
    for k in range(size):
        joint = k // 6
        component = k % 6
        squares = [stress[k] ** 2 for stress in stresses if not stress[k].is_zero()]
        if squares:
            is_force = component < 3
            usual = 1 / length if is_force else 1.0
            is_unique = total(squares) <= float((UNIQUE * usual) ** 2)
            codes[joint] += float(BITS[component]) * (1 - is_unique)
    return codes


# --- lines --------------------------------------------------------------------------------------


def _rows_of_lines(e: Equations) -> list[Row]:
    """A row for each line, with Phi v = d . d_dot = length times rate, which needs no root.

    So the multiplier of such a row is a force divided by the length.
    """
    rows = list[Row]()
    for x in e.mechanism.lines.forces:
        rows += closure_rows(
            e.kinematics, e.mechanism.model, Distance(x.frame_a, x.frame_b, distance=1.0)
        )
    return rows


def _multipliers_of_lines(e: Equations, tau: SX) -> Sparse:
    """Multipliers of the rows of lines: forces that push the ends apart, divided by lengths."""
    multipliers = {}
    first = len(e.rows)
    pulls_of_springs = e.tree.pulls(e.v)  # of dampers too
    pulls_of_masses = e.tree.inertial_pulls(e.v, e.dv)
    for k, factors in enumerate(e.mechanism.lines.actuation):
        pushes = [-(pulls_of_springs[k] + pulls_of_masses[k])]
        for motor, factor in enumerate(factors):
            if factor:
                pushes.append(float(factor) * tau[motor])
        multipliers[first + k] = total(pushes) / e.tree.lines[k].length
    return multipliers


# --- inner stresses -----------------------------------------------------------------------------


def _inner_stresses(e: Equations) -> list[Sparse]:
    """States of inner stress: multipliers, free of units, of rows that in all give no force.

    There is one for each row that has no pivot; its balance is by rows with pivots. Rows of an
    `Orthogonal` part are all without pivots. Each of them is balanced by the shortest multipliers
    of the part.
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
        # A unit of row i is a force or a moment; times its scale it has the size of unit stress.
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

    # Joints give to links what rows do not give.
    by_rows = [SX(6, 1) for _ in tree.links]
    for i, x in Lambda.items():
        for link, wrench in wrenches_of_rows[i].items():
            by_rows[link] += x * wrench
    by_joints = [x - y for x, y in zip(needed, by_rows, strict=True)]
    carried = e.kinematics.joint_wrenches(by_joints)  # sums over each link and all links behind it
    wrenches = [carried[tree.link_of[j]] for j in range(1, mechanism.model.njoints)]

    first_row = 0
    for closure in mechanism.closures:
        rows = range(first_row, first_row + len(closure.rows))
        first_row = rows.stop
        if isinstance(closure, (Coupling, Brake)):
            force = Lambda.get(rows[0], SX(1, 1))
            wrenches.append(column({acts_along(mechanism, closure): force}, range(6)))
        else:
            wrenches.append(_on_frame_b(e, closure, rows, wrenches_of_rows, Lambda))
    return _Wrenches(values=ca.vertcat(*wrenches), ground=carried[0])


def _on_frame_b(
    e: Equations,
    closure: Closure | Distance | Rolling,
    rows: Sequence[int],
    wrenches_of_rows: Sequence[Mapping[int, SX]],
    Lambda: Sparse,
) -> SX:
    """What a closure gives to the link of its frame B, at the origin and in the axes of B."""
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
