# SPDX-License-Identifier: BSD-2-Clause
"""Velocities of frames, [linear; angular], and their changes along motions, on CasADi's symbols.

A column of the Jacobian of a frame is a velocity too: that of the motion L e_k. So all rates and
derivatives are changes of a velocity along a motion, at constant rates of the coordinates:

    rate of the Jacobian, column k    that of L e_k, along v
    derivative by q, column k         that of v, along L e_k
    drift                             that of v, along v
"""

from typing import Any

import casadi as ca
from casadi import SX

from ..model.tree import frame_named
from .equations import Equations
from .kernel_checks import Checks
from .symbols import Sparse, sx


def velocity(e: Equations, frame: str, rates: Sparse) -> SX:
    """Velocity of a frame at rates of the tree."""
    point = e.kinematics.point(0, frame_named(e.mechanism.model, frame))
    twists = (point.columns[i] * x for i, x in rates.items() if i in point.columns)
    return sum(twists, SX(6, 1))


def rate_of_column(e: Equations, checks: Checks, frame: str, step: Sparse) -> tuple[SX, list[Any]]:
    """Change of the velocity at rates `step` along v, and a check of it."""
    change, right = e.held(step, e.Phi_dot)
    return _change(e, frame, step, e.v, change), checks.unsolved(change, right)


def derivative_along(
    e: Equations, checks: Checks, frame: str, step: Sparse
) -> tuple[SX, list[Any]]:
    """Change of the velocity at rates v along `step`, and a check of it."""
    change, right = e.held(e.v, e.Phi_change(step))
    return _change(e, frame, e.v, step, change), checks.unsolved(change, right)


def drift(e: Equations, frame: str) -> SX:
    """Change of the velocity at rates v along v."""
    return _change(e, frame, e.v, e.v, e.at_rest)


def _change(e: Equations, frame: str, of: Sparse, along: Sparse, change: Sparse) -> SX:
    """Change of the velocity at rates `of` along other rates; `change` is that of the rates."""
    kinematics = e.kinematics
    place = frame_named(e.mechanism.model, frame)
    link = kinematics.tree.link_of[place.parentJoint]
    R, _ = kinematics.pose(0, link)
    x = kinematics.motions(along, change, v_k=of)[link]
    linear = x.a + x.U @ sx(place.placement.translation)
    return ca.vertcat(R @ linear, R @ x.alpha)
