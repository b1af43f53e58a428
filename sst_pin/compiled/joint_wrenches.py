# SPDX-License-Identifier: BSD-2-Clause
"""Reactions in joints and closures, as those of `chain.reactions`, on CasADi's symbols.

`dynamics/reactions.py` explains the method and its symbols. Each row without a pivot gives a state
of inner stress: a unit of this row is balanced along the dependent rates by the rows with pivots,
or by the shortest multipliers of an `Orthogonal` part.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np
from casadi import SX

from ..dynamics.reactions import BITS, acts_along
from ..model.closures import Brake, Coupling, Distance, frames_of
from ..model.thresholds import UNIQUE
from ..model.tree import frame_named
from .closure_rows import Row, by_twists, closure_rows
from .elimination import Factors, total
from .equations import Equations
from .kernel_checks import Checks
from .symbols import Sparse, add, column, sx


def on_links(rows: Sequence[Row], v: Sparse) -> list[dict[int, SX]]:
    """Wrenches on links, by their indices, of a unit of each row.

    They are [force; moment] about the origin of the link, in its axes. The power of a row with the
    multiplier 1 is Phi v, so that its wrench on a link is the gradient of Phi v by the twist.
    """
    velocities, twists = by_twists(rows, v)
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
    """Inputs, results and checks of the kernel of reactions.

    The results are the wrenches of joints and closures, that of the ground, torques and codes, in a
    column, as in `dynamics.reactions.reactions`.
    """
    mechanism = e.mechanism
    inputs = {"q": e.q, "va": e.va, "aa": e.aa}

    # The forces that closures must give to the tree along the dependent rates:
    # Phi_u^T lambda = needed.
    needed = e.tree_forces
    more_checks = list[Any]()
    if mechanism.driven_one_to_one:
        tau = e.generalized_forces  # these motors act on coordinates only
    else:
        tau = e.tau
        inputs["tau"] = tau
        needed = add(needed, e.motor_forces(-tau))
        more_checks = checks.unbalanced(needed)  # `of_forces` balances the tree without motors

    # Rows of lines follow those of closures; their multipliers are known.
    wrenches_of_rows = on_links([*e.rows, *_rows_of_lines(e)], e.v)
    Lambda = e.multipliers(needed) | _pushes(e, tau)
    values, ground = _wrenches(e, wrenches_of_rows, Lambda, e.tree.wrenches(e.v, e.dv))

    # A component is not unique if an inner stress changes it. In a stress of unit size, moments are
    # of the order 1, and forces of the order 1 / length.
    stresses = [_wrenches(e, wrenches_of_rows, stress)[0] for stress in _stresses(e)]
    sizes = np.repeat([mechanism.length, 1.0], 3)
    codes = [SX(0)] * (values.numel() // 6)
    for k in range(values.numel()):
        squares = [stress[k] ** 2 for stress in stresses if not stress[k].is_zero()]
        if squares:
            unique = total(squares) <= float((UNIQUE / sizes[k % 6]) ** 2)
            codes[k // 6] += float(BITS[k % 6]) * (1 - unique)
    result = ca.vertcat(values, ground, tau, *codes)
    inputs["external_wrenches"] = e.loads
    return inputs, result, checks.of_forces + more_checks


def _rows_of_lines(e: Equations) -> Iterator[Row]:
    """A row for each force along a line: d . d_dot = length * rate, which needs no root.

    So the multiplier of such a row is a force divided by the length.
    """
    for x in e.mechanism.lines.forces:
        rod = Distance(x.frame_a, x.frame_b, 1.0)
        yield from closure_rows(e.kinematics, e.mechanism.model, rod)


def _pushes(e: Equations, tau: SX) -> Sparse:
    """Multipliers of the rows of lines: forces that push the ends apart, divided by the lengths."""
    pushes = {}
    of_springs = e.tree.pulls(e.v)
    of_masses = e.tree.inertial_pulls(e.v, e.dv)
    for k, shares in enumerate(e.mechanism.lines.actuation):
        parts = [-(of_springs[k] + of_masses[k])]
        for motor, share in enumerate(shares):
            if share:
                parts.append(float(share) * tau[motor])
        pushes[len(e.rows) + k] = total(parts) / e.tree.lines[k].length
    return pushes


def _stresses(e: Equations) -> Iterator[Sparse]:
    """States of inner stress, free of units: multipliers of rows that give no force in all.

    There is one for each row without a pivot; all rows of an `Orthogonal` part are among them.
    """
    pivots = {i for part in e.factors.parts if isinstance(part, Factors) for i in part.rows}
    for i in sorted(set(range(len(e.rows))) - pivots):
        balance = e.multipliers({j: -x for j, x in e.rows[i].Phi.items()})
        scale = float(e.mechanism.row_scale[i])
        # A unit of row i is a force or a moment; times its scale it has the size of unit stress.
        yield {k: scale * x for k, x in add(balance, {i: SX(1)}).items()}


def _wrenches(
    e: Equations,
    wrenches_of_rows: list[dict[int, SX]],
    Lambda: Sparse,
    needed: Sequence[SX] | None = None,
) -> tuple[SX, SX]:
    """[force; moment] of joints, then closures, and of the ground, from multipliers of the rows.

    `needed` are the wrenches that links need for their motion, by default none.
    """
    mechanism = e.mechanism
    model = mechanism.model
    tree = e.kinematics.tree

    # Joints give to a link and all links behind it what rows do not give.
    supplied = [SX(6, 1) for _ in tree.links]
    for i, x in Lambda.items():
        for link, wrench in wrenches_of_rows[i].items():
            supplied[link] += x * wrench
    remaining = [-wrench for wrench in supplied]
    if needed is not None:
        remaining = [x + y for x, y in zip(needed, remaining, strict=True)]
    carried = e.kinematics.carried(remaining)  # sums over each link and all links behind it
    wrenches = [carried[tree.link_of[j]] for j in range(1, model.njoints)]

    # A closure gives to the link of its frame B the sum of its rows, here about that frame.
    first_row = 0
    for closure in mechanism.closures:
        rows = range(first_row, first_row + len(closure.rows))
        first_row = rows.stop
        if isinstance(closure, (Coupling, Brake)):
            force = Lambda.get(rows[0], SX(1, 1))
            wrenches.append(column({acts_along(mechanism, closure): force}, range(6)))
            continue
        frame = frame_named(model, frames_of(closure)[1])
        on_b = SX(6, 1)
        link = tree.link_of[frame.parentJoint]
        for i in rows:
            if i in Lambda and link in wrenches_of_rows[i]:
                on_b += Lambda[i] * wrenches_of_rows[i][link]
        R = sx(frame.placement.rotation)
        p = sx(frame.placement.translation)
        force = on_b[:3]
        moment = on_b[3:] - ca.cross(p, force)
        wrenches.append(ca.vertcat(R.T @ force, R.T @ moment))
    return ca.vertcat(*wrenches), carried[0]
