# SPDX-License-Identifier: BSD-2-Clause
"""Velocities of frames, [linear; angular], and their changes along motions, on CasADi's symbols.

The velocity of a frame is J_tree(q) x for rates x of the tree, where J_tree is the Jacobian in all
joints. The functions give such a velocity, or its change along a motion of the tree, at constant
rates of the coordinates. Column k of the Jacobian J in the coordinates is the velocity for
x = L e_k.

    function            result                               rates x     motion
    rate_of_column      column k of the rate of J            L e_k       v
    derivative_along    column k of the derivative by q      v           L e_k
    drift               J_dot va                             v           v

The rates x keep the loops closed, Phi x = 0. So they change along the motion:
Phi x_dot = -Phi_dot x.
"""

from typing import Any

import casadi as ca
from casadi import SX

from ..model.tree import frame_named
from .equations import Equations
from .kernel_checks import Checks
from .symbols import Sparse, sx


def velocity(e: Equations, frame: str, x: Sparse) -> SX:
    """Velocity of a frame for rates x of the tree."""
    point = e.kinematics.moving_frame(0, frame_named(e.mechanism.model, frame))
    twists = (point.columns[i] * rate for i, rate in x.items() if i in point.columns)
    return sum(twists, SX(6, 1))


def rate_of_column(e: Equations, checks: Checks, frame: str, x: Sparse) -> tuple[SX, list[Any]]:
    """Change of the velocity for rates x along v, and checks of the linear solution in it."""
    x_dot, right = e.rates_of_change(x, e.Phi_dot)
    return _change(e, frame, x=x, along=e.v, x_dot=x_dot), checks.unsolved(x_dot, right)


def derivative_along(
    e: Equations, checks: Checks, frame: str, step: Sparse
) -> tuple[SX, list[Any]]:
    """Change of the velocity for rates v along `step`, and checks of the linear solution in it."""
    v_dot, right = e.rates_of_change(e.v, e.Phi_dot_along(step))
    return _change(e, frame, x=e.v, along=step, x_dot=v_dot), checks.unsolved(v_dot, right)


def drift(e: Equations, frame: str) -> SX:
    """Change of the velocity for rates v along v."""
    return _change(e, frame, x=e.v, along=e.v, x_dot=e.dv_without_aa)


def _change(e: Equations, frame_name: str, x: Sparse, along: Sparse, x_dot: Sparse) -> SX:
    """Change of the velocity for rates x, along a motion of the tree.

    Args:
        e: The equations.
        frame_name: The frame.
        x: Rates of the tree.
        along: Rates of the motion.
        x_dot: Rate of x along the motion.
    """
    kinematics = e.kinematics
    frame = frame_named(e.mechanism.model, frame_name)
    link = kinematics.tree.link_of[frame.parentJoint]
    R, _ = kinematics.pose(0, link)
    motion = kinematics.motions(along, x_dot, v_k=x)[link]
    linear = motion.a + motion.U @ sx(frame.placement.translation)
    return ca.vertcat(R @ linear, R @ motion.alpha)
