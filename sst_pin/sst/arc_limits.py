# SPDX-License-Identifier: BSD-2-Clause
"""Poses that the equations allow but the machine cannot reach.

The passive slider of leg k runs on a quarter circle of the star, 0 <= beta_k <= 90 deg, the arc of
Eq. (54). The point R_k of leg k stays on the side P_k P_{k+1} of the base triangle:
0 <= gamma_k <= angle(v_k, v_{k+1}), where v_k is the direction from O to P_k. Every joint also has
the limits of the URDF. Close to a singularity torques or motions grow without bound.
"""

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from ..arrays import Array, in_one_turn
from ..simulation.check import Finding, outside, singular
from . import kinematics

#: A pose is close to a singularity below this |sin(mu_k)|, or above this condition number of A.
SMALLEST_SINE = 0.05
LARGEST_CONDITION = 50.0
#: Tolerance of the ends of the arcs for rounding, [rad].
_END = 1e-9


def arc_ends(geometry: kinematics.Geometry) -> Array:
    """Limits of each joint from the length of its arc, shape (2, 9), [rad]; mu_k has none."""
    v = geometry.R_0[:, :, 0]  # row k is v_k: the x axis of {0k} points from O to P_k
    low = np.full((3, 3), -np.inf)  # leg, joint
    high = np.full((3, 3), np.inf)
    low[:, 0] = 0.0  # gamma_k
    high[:, 0] = np.arccos(np.clip((v * np.roll(v, -1, axis=0)).sum(axis=1), -1, 1))
    low[:, 2] = 0.0  # beta_k
    high[:, 2] = np.pi / 2
    return np.stack([low.ravel(), high.ravel()])


def findings(
    model: pin.Model, geometry: kinematics.Geometry, t: Array, q: Array
) -> Iterator[Finding]:
    """Findings about arcs, joint limits and singularities along a motion.

    Args:
        model: The tree of the SST.
        geometry: Its geometry.
        t: Times, shape (N,), [s].
        q: Closed configurations, shape (N, 9).
    """
    # Ends of arcs.
    names = tuple(model.names)[1:]
    low, high = arc_ends(geometry)
    units = ["deg"] * len(names)  # for the texts; all values are in [rad]
    # A whole turn leads to the same place: angles are compared within half a turn of the middle of
    # the arc, which begins at 0. mu_k has no arc; any middle would do.
    middle = np.where(np.isfinite(low), high / 2, 0)
    turned = middle + in_one_turn(q - middle)
    is_outside = np.maximum(low - turned, turned - high) > _END
    yield from outside("arc", names, units, t, turned, is_outside, (low, high))

    # Limits of joints in the URDF.
    low = model.lowerPositionLimit
    high = model.upperPositionLimit
    yield from outside("limits", names, units, t, q, (q < low) | (q > high), (low, high))

    # Singularities: of the first kind leg by leg, then of the second kind.
    legs = kinematics.legs_of_joints(geometry, q)
    for k, sine in enumerate(np.abs(legs.sin_mu).T, 1):
        problem = f"leg {k} is close to the plane of its arc, |sin mu_{k}| < {SMALLEST_SINE}"
        is_close = sine < SMALLEST_SINE
        limits = (SMALLEST_SINE, np.inf)
        yield from singular(problem, (f"mu_{k}",), t, sine, is_close, limits)
    condition = np.linalg.cond(legs.y_2)  # the rows of A are those of y_2
    problem = f"close to a singularity (second kind), condition number > {LARGEST_CONDITION:g}"
    is_close = condition > LARGEST_CONDITION
    limits = (-np.inf, LARGEST_CONDITION)
    motors = names[::3]  # gamma_k
    yield from singular(problem, motors, t, condition, is_close, limits)
