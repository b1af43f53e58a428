# SPDX-License-Identifier: BSD-2-Clause
"""Reactions in joints and closures, as those of `chain.reactions`, on CasADi's symbols.

Each row without a pivot gives a state of self-stress: a unit of this row is balanced along the
dependent rates by the rows with pivots, or by the shortest multipliers of an `Orthogonal` part.
"""

import operator
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
    """Wrenches on links of a unit of each row: [force; moment] about their origins, their axes."""
    velocities, twists = by_twists(rows, v)
    wrenches = ({i: ca.gradient(u, x) for i, x in twists.items()} for u in velocities)
    return [{i: x for i, x in each.items() if not x.is_zero()} for each in wrenches]


def reactions(e: Equations, checks: Checks) -> tuple[dict[str, SX], SX, list[Any]]:
    """Wrenches of joints and closures, the ground's, torques and codes, in a column."""
    mechanism = e.mechanism
    needed = e.tree_forces
    inputs = {"q": e.q, "va": e.va, "aa": e.aa}
    tau = e.generalized_forces
    if not mechanism.driven_one_to_one:
        inputs["tau"] = tau = e.tau
        needed = add(needed, e.motor_forces(-tau))
    units = on_links([*e.rows, *_rows_of_lines(e)], e.v)
    Lambda = e.multipliers(needed) | _pushes(e, tau)
    values, ground = _wrenches(e, units, Lambda, e.tree.wrenches(e.v, e.dv))
    stresses = [_wrenches(e, units, stress)[0] for stress in _stresses(e)]
    size = np.repeat([mechanism.length, 1.0], 3)
    codes = [SX(0)] * (values.numel() // 6)
    for k in range(values.numel()):
        squares = [stress[k] ** 2 for stress in stresses if not stress[k].is_zero()]
        if squares:
            unique = total(squares) <= float((UNIQUE / size[k % 6]) ** 2)
            codes[k // 6] += float(BITS[k % 6]) * (1 - unique)
    result = ca.vertcat(values, ground, tau, *codes)
    inputs["external_wrenches"] = e.loads
    return inputs, result, checks.of_forces + checks.unbalanced(needed)


def _rows_of_lines(e: Equations) -> Iterator[Row]:
    """A row for each force along a line: the length of the line times its rate."""
    for x in e.mechanism.lines.forces:
        rod = Distance(x.frame_a, x.frame_b, 1.0)
        yield from closure_rows(e.kinematics, e.mechanism.model, rod)


def _pushes(e: Equations, tau: SX) -> Sparse:
    """Multipliers of the rows of lines, which follow those of closures."""
    pushes = {}
    inertial = e.tree.inertial_pulls(e.v, e.dv)
    for k, pull in enumerate(map(operator.add, e.tree.pulls(e.v), inertial)):
        shares = enumerate(e.mechanism.lines.actuation[k])
        push = total([-pull, *(float(share) * tau[m] for m, share in shares if share)])
        pushes[len(e.rows) + k] = push / e.tree.lines[k].length
    return pushes


def _stresses(e: Equations) -> Iterator[Sparse]:
    """Multipliers of all rows that act on no rate, one state for each row without a pivot."""
    pivots = {i for part in e.factors.parts if isinstance(part, Factors) for i in part.rows}
    for i in sorted(set(range(len(e.rows))) - pivots):
        balance = e.multipliers({j: -x for j, x in e.rows[i].Phi.items()})
        scale = float(e.mechanism.row_scale[i])
        yield {k: scale * x for k, x in add(balance, {i: SX(1)}).items()}


def _wrenches(
    e: Equations, units: list[dict[int, SX]], Lambda: Sparse, needed: Sequence[SX] | None = None
) -> tuple[SX, SX]:
    """[force; moment] of joints, then closures, and of the ground, from multipliers of the rows."""
    mechanism, model, tree = e.mechanism, e.mechanism.model, e.kinematics.tree
    supplied = [SX(6, 1) for _ in tree.links]
    for i, x in Lambda.items():
        for link, unit in units[i].items():
            supplied[link] += x * unit
    pairs = zip(needed or [SX(6, 1)] * len(supplied), supplied, strict=True)
    carried = e.kinematics.carried([x - y for x, y in pairs])
    wrenches = [carried[tree.link_of[j]] for j in range(1, model.njoints)]
    starts = 0
    for closure in mechanism.closures:
        rows = range(starts, starts + len(closure.rows))
        starts = rows.stop
        if isinstance(closure, (Coupling, Brake)):
            force = Lambda.get(rows[0], SX(1, 1))
            wrenches.append(column({acts_along(mechanism, closure): force}, range(6)))
            continue
        frame = frame_named(model, frames_of(closure)[1])
        on_b = SX(6, 1)
        link = tree.link_of[frame.parentJoint]
        for i in rows:
            if i in Lambda and link in units[i]:
                on_b += Lambda[i] * units[i][link]
        R = sx(frame.placement.rotation)
        p = sx(frame.placement.translation)
        F, N = on_b[:3], on_b[3:]
        wrenches.append(ca.vertcat(R.T @ F, R.T @ (N - ca.cross(p, F))))
    return ca.vertcat(*wrenches), carried[0]
