# SPDX-License-Identifier: BSD-2-Clause
"""The part of each motor limit that a motion along a path uses.

On the path x(s) of the coordinates, w and u are the first and second time derivatives of s. So the
rates are x' w and the accelerations x' u + x'' w^2. The motors use the parts

    a(s) u + b(s) w^2 + c(s) + d(s) w + dry(s)

of their limits, due to inertia (a), velocity (b), weights and springs (c), viscous (d) and Coulomb
friction (dry). The inverse dynamics for some u and w gives these functions of s (J. E. Bobrow, S.
Dubowsky, J. S. Gibson, Time-optimal control of robotic manipulators along specified paths, Int. J.
Robotics Research 4(3), 1985).

The part of a limit is -1 at the least value and 1 at the largest. With surplus motors, a preload
changes the parts. Then the functions are not those of single motors, but of sums of parts that no
preload changes. Such a sum is c^T p, with the parts p of all motors and factors c; see
`motor_limits`.

`PathForces` has these functions as splines. It computes them at some points of the path, its nodes:
`_coefficients` has a to d, and `_dry_friction` has the Coulomb friction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..simulation.samples import spline
from .motor_limits import normalised
from .path_limits import MARGIN, MotorLimits
from .smooth_path import SmoothPath

#: A rate w at which inertia forces are much larger than friction, as w^2 is far above w. The forces
#: at w and -w then give b and d with at least eight of 16 digits, since w^2 = 1e8.
_FAST = 1e4
#: The rate w for robots with dampers of cables, in the unit of time in which w is about one. It is
#: slow, so that taut cables stay taut at w and -w. With 16 digits, b w^2 has ten of them.
_SLOW = 1e-3
#: A joint counts as resting if its rate is below this fraction of the largest joint rate. 1e-8 is
#: the square root of the rounding error: splines of the rates are not exactly zero.
_STILL = 1e-8


class Parts(NamedTuple):
    """What a motion uses of its limits at N points of a path.

    A sum of parts must be between -1 and 1: neither the sum nor its opposite may exceed 1. So the
    arrays have a column for each sum, then a column for the opposite of each sum. The motion keeps
    its limits if a u + b w^2 + c + d w + dry <= 1 in all columns.
    """

    #: The functions of the module, normalised by the factors, shapes (N, 2 sums).
    a: Array
    b: Array
    c: Array
    d: Array
    #: The largest Coulomb friction in each column, shape (N, 2 sums). Its sign is unknown where a
    #: joint is at rest, so it may be positive for a sum and for its opposite.
    dry: Array
    #: The largest w that the limits of rates allow, shape (N,).
    largest_w: Array


class PathForces:
    """All parts along a path, as splines through some of its points, the nodes.

    Args:
        limits: Limits of the motors.
        path: The curve x(s).
        nodes: Values of s, increasing, shape (N,).

    Attributes:
        unit: The unit of time in which w is about one, [s].
        viscous: Whether viscous friction matters: d w is more than `MARGIN` at w = 1 / unit.
    """

    def __init__(self, limits: MotorLimits, path: SmoothPath, nodes: Array) -> None:
        q, first, second = path.at(nodes)  # x' and x''
        limits.require_rest(q[[0, -1]])
        factors = limits.factors(q)
        rates = _rates_by_s(limits, q, first)
        forward_friction = factors @ limits.dry_friction(q)
        dry = _dry_friction(rates, forward_friction)
        coefficients = _coefficients(limits, q, first, second, factors, dry)
        speeds = limits.speeds(q, first)

        # The sums and their factors are smooth along the path. Normalised sums, which are divided
        # by the sizes of the factors, are not smooth where all factors of a sum pass zero. So the
        # sums are interpolated here, and normalised in `at`.
        self._factors = spline(nodes, factors)
        self._rates = spline(nodes, rates)
        self._forward_friction = spline(nodes, forward_friction)
        self._a = spline(nodes, coefficients.a)
        self._b = spline(nodes, coefficients.b)
        self._c = spline(nodes, coefficients.c)
        self._d = spline(nodes, coefficients.d)
        self._speeds = spline(nodes, speeds)
        # Somewhere on the path, inertia forces for u = 1 / unit^2 or rates for w = 1 / unit use
        # their whole limits.
        largest_a = np.abs(normalised(coefficients.a, factors)).max()
        self.unit = max(float(np.sqrt(largest_a)), float(speeds.max()), 1e-100)
        largest_d = float(np.abs(normalised(coefficients.d, factors)).max())
        self.viscous = largest_d > MARGIN * self.unit

    def at(self, s: Array) -> Parts:
        """All parts at points of the path."""
        factors = self._factors(s)
        dry = _dry_friction(self._rates(s), self._forward_friction(s))

        def columns(sums: Array, opposites: Array) -> Array:
            """Normalised sums, then their normalised opposites, shape (N, 2 sums)."""
            return np.hstack([normalised(sums, factors), normalised(opposites, factors)])

        a = self._a(s)
        b = self._b(s)
        c = self._c(s)
        d = self._d(s)
        # With w = 1 the rates use `speeds` of their limits, so that w may be 1 / speeds.
        with np.errstate(divide="ignore"):
            largest_w = 1 / np.maximum(self._speeds(s).max(axis=1), 0)
        return Parts(
            a=columns(a, -a),
            b=columns(b, -b),
            c=columns(c, -c),
            d=columns(d, -d),
            dry=columns(dry.largest, -dry.least),
            largest_w=largest_w,
        )


def _rates_by_s(limits: MotorLimits, q: Array, first: Array) -> Array:
    """Rates of all joints and of the lengths of all lines for w = 1, free of units.

    Shape (N, nv + lines); `first` are the derivatives x' of the coordinates, shape (N, n).
    """
    mechanism = limits.chain.mechanism
    rates_of_joints = limits.chain.joint_rates(q, first)
    rates_of_lines = limits.chain.engine.line_rates(q, rates_of_joints)
    return np.hstack([rates_of_joints / mechanism.rate_scale, rates_of_lines / mechanism.length])


class _DryFriction(NamedTuple):
    """Least and largest sums of parts due to Coulomb friction, shape (N, sums)."""

    least: Array
    largest: Array


def _dry_friction(rates: Array, forward_friction: Array) -> _DryFriction:
    """Coulomb friction at N points of a path.

    The friction of a moving joint or line follows its rate; at rest it has either sign.

    Args:
        rates: Rates of the joints and lines by s, free of units, shape (N, nv + lines).
        forward_friction: The sums due to the friction of each joint and line alone, while it moves
            forward, shape (N, sums, nv + lines).
    """
    is_moving = np.abs(rates) > _STILL * np.abs(rates).max(axis=1, keepdims=True)
    # Matrix times vector at each point.
    of_moving = np.einsum("ikj,ij->ik", forward_friction, np.sign(rates) * is_moving)
    of_resting = np.einsum("ikj,ij->ik", np.abs(forward_friction), ~is_moving)
    return _DryFriction(least=of_moving - of_resting, largest=of_moving + of_resting)


class _Coefficients(NamedTuple):
    """The functions a to d of the module at N points, as sums of parts, each of shape (N, sums)."""

    a: Array
    b: Array
    c: Array
    d: Array


def _coefficients(
    limits: MotorLimits,
    q: Array,
    first: Array,
    second: Array,
    factors: Array,
    dry: _DryFriction,
) -> _Coefficients:
    """The coefficients at points of a path, by the inverse dynamics at four pairs of u and w.

    Args:
        limits: The limits of the motors.
        q: Configurations, shape (N, nq).
        first: x', shape (N, n).
        second: x'', shape (N, n).
        factors: Factors of the sums, shape (N, sums, k).
        dry: Coulomb friction, which is a part of the sums if w is not zero.
    """

    def sums_at(w: float, u: float = 0.0) -> Array:
        """Sums of parts for the rates x' w and the accelerations x' u + x'' w^2."""
        parts = limits.parts(q, w * first, w**2 * second + u * first)
        return np.einsum("irk,ik->ir", factors, parts)  # matrix times vector at each point

    c = sums_at(0.0)
    a = sums_at(0.0, 1.0) - c
    w = _FAST
    lines = limits.chain.mechanism.lines
    if (lines.pull_only & (lines.damping > 0)).any():
        largest_a = np.abs(normalised(a, factors)).max()
        w = _SLOW / max(float(np.sqrt(largest_a)), 1e-100)
    # The sums at w and -w (u = 0) have the mean c + b w^2. Half their difference is d w plus the
    # Coulomb friction of the moving joints, as inverse dynamics has no friction of joints at rest.
    # The friction of the moving joints is the mean of the least and the largest friction.
    at_w = sums_at(w)
    at_minus_w = sums_at(-w)
    b_w2 = (at_w + at_minus_w) / 2 - c
    d_w = (at_w - at_minus_w) / 2 - (dry.least + dry.largest) / 2
    return _Coefficients(a=a, b=b_w2 / w**2, c=c, d=d_w / w)
