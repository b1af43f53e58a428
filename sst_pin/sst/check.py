# SPDX-License-Identifier: BSD-2-Clause
"""Poses that satisfy the equations but that the machine cannot reach.

The passive slider of leg k runs on a quarter circle of the star, 0 <= beta_k <= 90 deg, the arc
whose mass centre Eq. (54) gives, and R_k stays on the side P_k P_{k+1} of the base triangle,
0 <= gamma_k <= angle(v_k, v_{k+1}). Every joint has the limits of the URDF besides, and close to a
singularity torques or motions grow without bound.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from ..arrays import Array, in_one_turn
from ..motion.limits import Verdict
from . import kinematics

#: Where a pose counts as close to a singularity: |sin(mu_k)|, and the condition number of A.
SMALLEST_SINE, LARGEST_CONDITION = 0.05, 50.0
#: The ends of the arcs belong to them, rounding included; [rad].
_END = 1e-9


def arc_ends(geometry: kinematics.Geometry) -> Array:
    """Ends of the arc that each joint runs on, shape (2, 9), [rad]; mu_k has none."""
    v = geometry.R_0[:, :, 0]
    ends = np.repeat([[-np.inf], [np.inf]], 9, axis=1)
    ends[0, ::3], ends[0, 2::3] = 0, 0
    ends[1, ::3] = np.arccos(np.clip((v * np.roll(v, -1, axis=0)).sum(axis=1), -1, 1))
    ends[1, 2::3] = np.pi / 2
    return ends


def arc_margins(geometry: kinematics.Geometry, q: Array) -> Array:
    """How far inside its arc each joint is, negative outside; shape (..., 9), [rad]."""
    low, high = arc_ends(geometry)
    return np.asarray(np.minimum(q - low, high - q) + _END)


def verdicts(model: pin.Model, geometry: kinematics.Geometry, q: Array) -> Iterator[Verdict]:
    """Verdicts about arcs, joint limits and singularities at closed q of shape (n, 9)."""
    names = tuple(model.names)[1:]
    yield from _outside_arcs(geometry, names, q)
    yield from _outside_limits(model, names, q)
    yield from _near_singularities(geometry, names, q)


def _outside_arcs(
    geometry: kinematics.Geometry, names: tuple[str, ...], q: Array
) -> Iterator[Verdict]:
    low, high = arc_ends(geometry)
    bounded = np.isfinite(low)
    middle = np.where(bounded, high / 2, 0)
    q = middle + in_one_turn(q - middle)  # a whole turn leads to the same place
    out = arc_margins(geometry, q) < 0
    for i in np.flatnonzero(bounded):
        problem = f"{names[i]} leaves its arc of {_degrees(low[i], high[i])}"
        limits = (float(low[i]), float(high[i]))
        yield problem, (names[i],), q[:, i], out[:, i], limits, "deg", False


def _outside_limits(model: pin.Model, names: tuple[str, ...], q: Array) -> Iterator[Verdict]:
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    out = (q < low) | (q > high)
    for i, name in enumerate(names):
        problem = f"{name} leaves its limits of {_degrees(low[i], high[i])}"
        limits = (float(low[i]), float(high[i]))
        yield problem, (name,), q[:, i], out[:, i], limits, "deg", False


def _near_singularities(
    geometry: kinematics.Geometry, names: tuple[str, ...], q: Array
) -> Iterator[Verdict]:
    legs = kinematics.legs_of_joints(geometry, q)
    for k, sine in enumerate(np.abs(legs.sin_mu).T, 1):
        problem = f"leg {k} is close to the plane of its arc, |sin mu_{k}| < {SMALLEST_SINE}"
        limits = (SMALLEST_SINE, np.inf)
        yield problem, (names[3 * k - 2],), sine, sine < SMALLEST_SINE, limits, "", True
    condition = np.linalg.cond(legs.y_2)
    problem = f"close to a singularity (second kind), condition number > {LARGEST_CONDITION:g}"
    out = condition > LARGEST_CONDITION
    yield problem, names[::3], condition, out, (-np.inf, LARGEST_CONDITION), "", True


def _degrees(low: float, high: float) -> str:
    return f"{np.degrees(low):.4g} to {np.degrees(high):.4g} deg"
