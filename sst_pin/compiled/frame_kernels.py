# SPDX-License-Identifier: BSD-2-Clause
"""Velocities of frames and how they change, on CasADi's symbols.

Columns of Jacobians are velocities too: those of the motions L e_k. So all rates and derivatives
are of one kind, the change of a velocity along a motion, at constant rates of the coordinates:

    rate of the Jacobian, column k    that of L e_k, along v
    derivative by q, column k         that of v, along L e_k
    drift                             that of v, along v
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
from casadi import SX

from ..chain.tree import frame_named
from .equations import Equations
from .kernel_checks import Checks
from .symbols import Sparse, sx

_Made = tuple[list[SX], SX, list[Any]]


def _jacobian(e: Equations, checks: Checks, frame: str) -> _Made:
    return [e.q], _rows(_columns(e, frame)), checks.of_complement


def _jacobian_rate(e: Equations, checks: Checks, frame: str) -> _Made:
    Phi_dot = e.Phi_change(e.v)
    columns, own = _changes(e, checks, frame, [(L, e.v, *e.held(L, Phi_dot)) for L in e.L])
    return [e.q, e.va], _rows(columns), checks.of_rates + checks.of_complement + own


def _velocity_derivatives(e: Equations, checks: Checks, frame: str) -> _Made:
    """By q and va side by side."""
    motions = [(e.v, L, *e.held(e.v, e.Phi_change(L))) for L in e.L]
    columns, own = _changes(e, checks, frame, motions)
    columns += _columns(e, frame)
    return [e.q, e.va], _rows(columns), checks.of_rates + checks.of_complement + own


def _drift(e: Equations, checks: Checks, frame: str) -> _Made:
    (drift,), own = _changes(e, checks, frame, [(e.v, e.v, e.at_rest, e.drift)])
    return [e.q, e.va], drift, checks.of_rates + own


#: Quantities of a frame, by the names of `ClosedChain`'s methods.
OF_FRAMES: dict[str, Callable[[Equations, Checks, str], _Made]] = {
    "frame_jacobian": _jacobian,
    "frame_jacobian_rate": _jacobian_rate,
    "frame_velocity_derivatives": _velocity_derivatives,
    "frame_drift": _drift,
}


def _columns(e: Equations, frame: str) -> list[SX]:
    """Columns of the Jacobian."""
    point = e.kinematics.point(0, frame_named(e.mechanism.model, frame))
    columns = []
    for L in e.L:
        twists = [ca.vertcat(*point.columns[i]) * x for i, x in L.items() if i in point.columns]
        columns.append(_in_base(e, sum(twists, SX(6, 1))))
    return columns


def _changes(
    e: Equations, checks: Checks, frame: str, motions: list[tuple[Sparse, Sparse, Sparse, Sparse]]
) -> tuple[list[SX], list[Any]]:
    """Changes of velocities of a frame, and checks that the changes of rates are solutions.

    A motion is: rates of the tree that give the velocity; rates along which it changes; how the
    first then change; Phi times that.
    """
    kinematics, place = e.kinematics, frame_named(e.mechanism.model, frame)
    link = kinematics.tree.link_of[place.parentJoint]
    R, _ = kinematics.pose(0, link)
    columns, own = [], []
    for of, along, change, right in motions:
        x = kinematics.motions(along, change, v_k=of)[link]
        linear = x.a + x.U @ sx(place.placement.translation)
        columns.append(_in_base(e, ca.vertcat(R @ linear, R @ x.alpha)))
        own += checks.unsolved(change, right)
    return columns, own


def _in_base(e: Equations, twist: SX) -> SX:
    """A twist in axes of link 0, in those of the base."""
    return ca.vertcat(e.kinematics.base @ twist[:3], e.kinematics.base @ twist[3:])


def _rows(columns: list[SX]) -> SX:
    """Columns side by side, row by row."""
    return ca.vec(ca.horzcat(*columns).T)
