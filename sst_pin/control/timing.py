# SPDX-License-Identifier: BSD-2-Clause
"""The fastest motion along a path within limits of the motors.

Along the path x(s) of the coordinates, with w and u the first and second derivative of s by time, a
motor gives a(s) u + b(s) w^2 + c(s) + d(s) w + e(s): the parts of inertia, of rates, of weight, of
viscous and of Coulomb friction. They are found from the inverse dynamics. H. Pham and Q.-C. Pham, A
new approach to time-optimal path parameterization based on reachability analysis, IEEE Trans.
Robotics 34(3), 2018, solve for w^2; d(s) w is linearized about the solution before.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, finite_array, positive_number
from ..chain.closed_chain import ClosedChain
from ..chain.named_positions import put, taken
from ..chain.redundancy import limits_of_each
from ..errors import ActuationError, InputError, MissingExtraError
from ..motion.coordinate_motions import coordinate_positions
from ..motion.samples import spline
from ..motion.trajectories import Trajectory

#: Intervals at whose ends the dynamics is computed, and how often they are halved where the forces
#: between are others than expected.
_INTERVALS, _HALVINGS = 500, 4
#: Passes on finer grids, and how many intervals become of one in a pass.
_PASSES, _PIECES = 20, 20
#: The part of a limit that stays free at the grid's points, for what happens between them.
_MARGIN = 1e-4
#: Where limits are tested in each interval. Where this part of a limit is used, the second grid is
#: so fine that in an interval only a small part lies idle.
_TESTED, _BUSY, _IDLE = np.linspace(0, 1, 6), 0.99, 8e-4
#: Viscous friction is found when w^2 changes by less than this part; at first it may use at least
#: this part of a limit.
_SETTLED, _CREEP = 1e-3, 1e-3
#: A rate w at which friction is small beside inertia; the part of rates that joints at rest have.
_FAST, _STILL = 1e4, 1e-8
#: Between samples of a path loops may be open by this, [rad] or of the robot's length.
_OPEN = 0.02


def time_optimal(
    chain: ClosedChain,
    path: ArrayLike,
    *,
    torques: ArrayLike | None = None,
    rates: ArrayLike | None = None,
    accelerations: ArrayLike | None = None,
    dt: float = 1e-3,
) -> Trajectory:
    """The fastest motion along a path, from rest to rest, within limits of the motors.

    The path is the smooth curve through configurations, whatever the times at which they were
    taken. All of the dynamics counts, friction too. Limits also hold between the points of the
    grid, which is refined until they do. With more motors than freedoms the torques are the
    smallest ones. Method: H. Pham and Q.-C. Pham, IEEE Trans. Robotics 34(3), 2018.

    Args:
        chain: A robot whose motors hold all coordinates, each of which turns or slides.
        path: Configurations with closed loops, shape (N, nq), N >= 3.
        torques: Largest torque of each motor, shape () or (motors,), or least and largest ones,
            shape (motors, 2), [N m] or [N]; None for no limit, as below.
        rates: Largest rates of the motors, in the same shapes, [rad/s] or [m/s].
        accelerations: Largest accelerations of the motors, [rad/s^2] or [m/s^2].
        dt: Longest step between samples of the motion, [s].

    Raises:
        InputError: For a path that does not move or jumps, or limits that are none.
        ActuationError: If the motors cannot hold the robot at the ends of the path, or cannot
            follow the path within the limits.
        ClosureError, SingularConfigurationError: Where the loops open, or are singular.
        UnknownNameError: For a coordinate that is a ball joint or a free body.
        MissingExtraError: Without toppra, `sst-pin[timing]`.

    Example:
        >>> path = robot.inverse_kinematics(sst_pin.paper_circle(np.linspace(0, 0.5, 201)).R)
        >>> motion = sst_pin.time_optimal(robot, path, torques=30.0)
        >>> print(f"{motion.t[-1]:.2f} s, {np.abs(motion.tau).max():.2f} N m")
        0.49 s, 30.00 N m
    """
    limits = _Limits(chain, torques, rates, accelerations)
    way, step = _Path(chain, path), positive_number("dt", dt)
    for halvings in range(_HALVINGS + 1):
        nodes = np.linspace(0, 1, _INTERVALS * 2**halvings + 1)
        loads = _Loads(limits, way, nodes)
        profile = _fastest(loads)
        t = np.linspace(0, profile.times[-1], int(np.ceil(profile.times[-1] / step)) + 1)
        q, va, aa = profile.states(way, profile.places(t))
        middles = (nodes[1:] + nodes[:-1]) / 2
        between = limits.used(*profile.states(way, middles))
        if max(limits.used(q, va, aa).max(), between.max()) <= 1:
            return chain.trajectory(t, q, va, aa)
    raise ActuationError(
        f"the forces along the path jump, and pass limits by {between.max() - 1:.1%} at "
        f"{middles[between.argmax()]:.1%} of it: its samples lie on no smooth curve"
    )


class _Path:
    """A curve of configurations over s from 0 to 1, about as long in each part of s."""

    def __init__(self, chain: ClosedChain, path: ArrayLike) -> None:
        self._chain, self._space = chain, chain.mechanism.space
        q = finite_array("path", path, (chain.mechanism.model.nq,))
        if q.ndim != 2 or len(q) < 3:
            raise InputError("path", f"shape {q.shape}, expected (N, {q.shape[-1]}) with N >= 3")
        x = coordinate_positions(chain, q)
        less = np.abs(np.diff(x - taken(self._space, q, chain.coordinates), axis=0)) > 1
        if (less & (np.abs(np.diff(x, axis=0)) > np.pi / 2)).any() or (less[1:] & less[:-1]).any():
            raise InputError("path", "a joint turns by half a turn between samples: use more")
        scale = chain.mechanism.rate_scale[chain.mechanism.coordinates]
        steps = np.linalg.norm(np.diff(x, axis=0) / scale, axis=1)
        kept = np.append(True, steps > 1e-9 * steps.sum())
        if kept.sum() < 3:
            raise InputError("path", "the coordinates do not move along it")
        ways = np.diff(x[kept], axis=0) / scale
        back = np.flatnonzero((ways[1:] * ways[:-1]).sum(axis=1) < 0)
        if len(back):
            sample = np.flatnonzero(kept)[back[0] + 1]
            raise InputError("path", f"it turns back at sample {sample}: divide it there")
        s = np.cumsum(np.append(0, steps)[kept])
        s /= s[-1]
        self._joints = spline(s, self._space.without_jumps(q[kept]))
        self._curve = spline(s, x[kept])
        self._first, self._second = self._curve.derivative(1), self._curve.derivative(2)

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """Configurations, and derivatives of the coordinates by s, shapes (N, nq), (N, n)."""
        chain, x = self._chain, self._curve(s)
        wanted = dict(zip(chain.coordinates, x.T, strict=True))
        q = guess = put(self._space, self._joints(s), wanted)
        if chain.closures:
            q = chain._states(0.0).closed(np.hstack([guess, np.zeros_like(x)]))
        lengths = np.array(self._space.position_units) == "m"
        gaps = np.abs(q - guess) / np.where(lengths, chain.mechanism.length, 1.0)
        if gaps.max() > _OPEN:
            place = s[gaps.max(axis=1).argmax()]
            raise InputError("path", f"it jumps, or has too few samples, at {place:.1%} of it")
        return q, self._first(s), self._second(s)


class _Limits:
    """Limits of the motors, and the parts of them that are used, from -1 to 1."""

    def __init__(
        self,
        chain: ClosedChain,
        torques: ArrayLike | None,
        rates: ArrayLike | None,
        accelerations: ArrayLike | None,
    ) -> None:
        self.chain = chain
        self.torques = self._bounds("torques", torques)
        self.rates = self._bounds("rates", rates)
        self.accelerations = self._bounds("accelerations", accelerations)
        if self.torques is self.accelerations is None:
            raise InputError("torques, accelerations", "a limit of one of them is needed")
        if accelerations is not None and chain.mechanism.lines.motors.any():
            raise InputError("accelerations", "not for motors on lines")

    def _bounds(self, name: str, value: ArrayLike | None) -> Array | None:
        """Least and largest numbers, shape (motors, 2)."""
        if value is None:
            return None
        bounds = limits_of_each(name, value, len(self.chain.motor_names))
        if name != "torques" and not (bounds * (-1, 1) > 0).all():
            raise InputError(name, "motors at rest pass them")
        return bounds

    def forces(self, q: Array, va: Array, aa: Array) -> Array:
        """Parts of the limits of torques and of accelerations, shape (N, k)."""
        chain, found = self.chain, list[Array]()
        if self.torques is not None:
            found.append(_part(chain.compute_torques(q, va, aa), self.torques))
        if self.accelerations is not None:
            of_motors = chain.joint_accelerations(q, va, aa) @ chain.mechanism.motors
            found.append(_part(of_motors, self.accelerations))
        return np.hstack(found)

    def speeds(self, q: Array, va: Array) -> Array:
        """Parts of the limits of rates, shape (N, k)."""
        if self.rates is None:
            return np.zeros((len(q), 1))
        each = self.chain.motor_rates(q, va)[:, :, None] / self.rates
        return each.reshape(len(q), -1)

    def used(self, q: Array, va: Array, aa: Array) -> Array:
        """The largest part of a limit, shape (N,)."""
        forces, speeds = self.forces(q, va, aa), self.speeds(q, va)
        return np.maximum(np.abs(forces).max(axis=1), speeds.max(axis=1))


def _part(values: Array, bounds: Array) -> Array:
    """Where values, shape (N, motors), lie between bounds: from -1, the least, to 1."""
    return (2 * values - bounds.sum(axis=1)) / np.ptp(bounds, axis=1)


class _Parts(NamedTuple):
    """Parts of the limits at points of a path, shape (N, k), as the head of this file says.

    Coulomb friction lies between `low` and `high`, which differ where joints rest. `most` is the
    largest w, shape (N,).
    """

    a: Array
    b: Array
    c: Array
    d: Array
    low: Array
    high: Array
    most: Array


class _Loads:
    """All parts along a path, from inverse dynamics at some of its points."""

    def __init__(self, limits: _Limits, way: _Path, nodes: Array) -> None:
        q, first, second = way.at(nodes)

        def at(w: float, u: float = 0.0) -> Array:
            return limits.forces(q, w * first, w**2 * second + u * first)

        c, ahead, back = at(0.0), at(_FAST), at(-_FAST)
        _require_rest(limits, c[[0, -1]])
        self._rates, self._dry = (spline(nodes, x) for x in _dry_friction(limits, q, first))
        low, high = self._coulomb(nodes)
        a, b = at(0.0, 1.0) - c, (ahead + back) / 2 - c
        d = (ahead - back) / 2 - (low + high) / 2
        speeds = limits.speeds(q, first)
        self._smooth = spline(nodes, np.stack([a, b / _FAST**2, c, d / _FAST], axis=1))
        self._speeds = spline(nodes, speeds)
        # A time: in this unit w is about one.
        self.unit = max(float(np.sqrt(np.abs(a).max())), float(speeds.max()), 1e-100)
        self.viscous = float(np.abs(d).max()) > _MARGIN * _FAST * self.unit

    def _coulomb(self, s: Array) -> tuple[Array, Array]:
        """Least and largest Coulomb friction, shape (N, k)."""
        v, of_joints = self._rates(s), self._dry(s)
        moving = np.abs(v) > _STILL * np.abs(v).max(axis=1, keepdims=True)
        known = np.einsum("imj,ij->im", of_joints, np.sign(v) * moving)
        either = np.einsum("imj,ij->im", np.abs(of_joints), ~moving)
        return known - either, known + either

    def at(self, s: Array) -> _Parts:
        """All parts at points of the path."""
        with np.errstate(divide="ignore"):
            most = 1 / np.maximum(self._speeds(s).max(axis=1), 0)
        a, b, c, d = np.moveaxis(self._smooth(s), 1, 0)
        return _Parts(a, b, c, d, *self._coulomb(s), most)


def _require_rest(limits: _Limits, used: Array) -> None:
    """Check that the motors hold the robot at both ends, with parts of their limits."""
    over = np.argwhere(np.abs(used) > 1 - _MARGIN)
    if len(over):
        names = limits.chain.motor_names
        end, motor = over[0]
        raise ActuationError(
            f"motor {names[motor % len(names)]} cannot hold the robot at the "
            f"{('start', 'end')[end]} of the path within its limits"
        )


def _dry_friction(limits: _Limits, q: Array, first: Array) -> tuple[Array, Array]:
    """Rates of joints, (N, nv), and parts of limits for Coulomb friction of each, (N, k, nv)."""
    chain, sizes = limits.chain, limits.chain.mechanism.friction.coulomb
    kinds = (limits.torques is not None) + (limits.accelerations is not None)
    motors, n = len(chain.motor_names), chain.degrees_of_freedom
    parts = np.zeros((len(q), kinds * motors, len(sizes)))
    if limits.torques is not None and sizes.any():
        J_T, L_T = (
            rates(q[:, None], np.eye(n)) for rates in (chain.motor_rates, chain.joint_rates)
        )
        half = np.ptp(limits.torques, axis=1)[:, None] / 2
        parts[:, :motors] = np.linalg.pinv(J_T) @ L_T * sizes / half
    return chain.joint_rates(q, first) / chain.mechanism.rate_scale, parts


class _Profile(NamedTuple):
    """w^2 at the points s of a grid, shape (N + 1,); u is constant between them."""

    s: Array
    x: Array

    @property
    def u(self) -> Array:
        """Second derivatives of s by time, shape (N,)."""
        return np.diff(self.x) / np.diff(self.s) / 2

    @property
    def times(self) -> Array:
        """When the points of the grid are passed, shape (N + 1,)."""
        w = np.sqrt(self.x)
        return np.append(0, np.cumsum(2 * np.diff(self.s) / (w[1:] + w[:-1])))

    def places(self, t: Array) -> Array:
        """s at times, shape (N,)."""
        times = self.times
        i = np.clip(np.searchsorted(times, t, "right") - 1, 0, len(times) - 2)
        late = t - times[i]
        s = self.s[i] + np.sqrt(self.x[i]) * late + self.u[i] * late**2 / 2
        return np.clip(s, self.s[i], self.s[i + 1])

    def states(self, way: _Path, s: Array) -> tuple[Array, Array, Array]:
        """q, va, aa at points of the path."""
        i = np.clip(np.searchsorted(self.s, s, "right") - 1, 0, len(self.s) - 2)
        x, u = np.interp(s, self.s, self.x)[:, None], self.u[i, None]
        q, first, second = way.at(s)
        return q, np.sqrt(x) * first, x * second + u * first

    def used(self, loads: _Loads) -> Array:
        """The largest part of a limit at each point tested in each interval, shape (tested, N)."""
        s = self.s[:-1] + np.diff(self.s) * _TESTED[:, None]
        x = np.interp(s, self.s, self.x).ravel()
        a, b, c, d, low, high, most = loads.at(s.ravel())
        w = np.sqrt(x)[:, None]
        forces = a * np.tile(self.u, len(_TESTED))[:, None] + b * w**2 + c + d * w
        either = np.maximum(forces + np.where(w > 0, high, 0), -forces - np.where(w > 0, low, 0))
        return np.maximum(either.max(axis=1), w[:, 0] / most).reshape(s.shape)


def _fastest(loads: _Loads) -> _Profile:
    """The fastest profile, on a grid that is refined until it keeps the limits."""
    s = np.linspace(0, 1, _INTERVALS + 1)
    x = _start(s, loads) if loads.viscous else None
    for attempt in range(_PASSES):
        profile = _Profile(s, _solved(s, loads, x))
        used = profile.used(loads)
        worst = used.max(axis=0)
        if attempt and worst.max() <= 1 - _MARGIN / 4:
            break
        pieces = np.where(worst > 1 - _MARGIN / 4, 2 + (worst - 1) / _MARGIN, 1)
        if not attempt:
            idle = np.where(worst > _BUSY, np.ptp(used, axis=0) / _IDLE, 1)
            pieces = np.maximum(pieces, idle)
        finer = _divided(s, np.ceil(np.clip(pieces, 1, _PIECES)).astype(int))
        x = None if x is None else np.interp(finer, s, profile.x)
        s = finer
    return profile


def _divided(s: Array, pieces: Indices) -> Array:
    """A grid with each interval in a number of equal pieces."""
    first = np.repeat(np.cumsum(pieces) - pieces, pieces)
    part = (np.arange(pieces.sum()) - first) / np.repeat(pieces, pieces)
    return np.append(np.repeat(s[:-1], pieces) + part * np.repeat(np.diff(s), pieces), s[-1])


def _start(s: Array, loads: _Loads) -> Array:
    """w^2 where the linearization of viscous friction begins: below what friction allows."""
    parts = loads.at(s)
    x = _linear(s, loads.unit, parts)
    free = np.maximum(1 - np.abs(parts.c) - np.maximum(parts.high, -parts.low), _CREEP)
    with np.errstate(divide="ignore"):
        return np.minimum(x, (free / np.abs(parts.d)).min(axis=1) ** 2)


def _solved(s: Array, loads: _Loads, x: Array | None) -> Array:
    """The largest w^2 within the limits, shape (N + 1,), from that on another grid."""
    parts = loads.at(s)
    if x is None:
        return _linear(s, loads.unit, parts)
    for _ in range(_PASSES):
        w = np.sqrt(x)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(w > 0, parts.d / (2 * w), 0)
        linear = parts._replace(b=parts.b + slope, c=parts.c + parts.d * w / 2)
        last, x = x, _linear(s, loads.unit, linear)
        if (np.abs(x - last) <= _SETTLED * x).all():
            break
    return x


def _linear(s: Array, unit: float, parts: _Parts) -> Array:
    """The largest w^2 within the limits without d, at rest at the ends, by toppra."""
    try:
        from toppra import SplineInterpolator
        from toppra.algorithm import TOPPRA
        from toppra.constraint import LinearConstraint
    except ImportError:
        raise MissingExtraError("toppra", "timing") from None
    # Its tolerances are numbers: time is in a unit in which w is about one.
    a, b, c = parts.a / unit**2, parts.b / unit**2, parts.c
    # Limits hold at both ends of each interval, with Coulomb friction of both ends.
    rest = np.isin(np.arange(len(s)), (0, len(s) - 1))[:, None]
    high, low = np.where(rest, 0, parts.high), np.where(rest, 0, parts.low)
    high, low = np.maximum(high[:-1], high[1:]), np.minimum(low[:-1], low[1:])
    at_end = a[1:] + 2 * np.diff(s)[:, None] * b[1:]
    rows = (
        np.hstack([a[:-1], -a[:-1], at_end, -at_end]),
        np.hstack([b[:-1], -b[:-1], b[1:], -b[1:]]),
        np.hstack([c[:-1] + high, -c[:-1] - low, c[1:] + high, -c[1:] - low]),
    )
    k = rows[0].shape[1]
    squares = np.minimum(((1 - _MARGIN) * parts.most * unit) ** 2, 1e8)
    bounds = np.column_stack([np.zeros_like(s), squares])
    found = *(np.vstack([x, x[-1:]]) for x in rows), np.eye(k), np.full(k, 1 - _MARGIN)

    class Rows(LinearConstraint):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, path: object, grid: Array) -> Any:
            return (*found, None, bounds)

    way = SplineInterpolator([0.0, 1.0], [[0.0], [1.0]])
    solver = TOPPRA([Rows()], way, gridpoints=s, solver_wrapper="seidel")
    _, w, _, K = solver.compute_parameterization(0.0, 0.0, return_data=True)
    if w is None or not np.isfinite(w).all():
        lost = s[np.isnan(K).any(axis=1)]
        at = f" beyond {lost.max():.0%} of it" if lost.size else ""
        raise ActuationError(f"the limits allow no motion from rest to rest along the path{at}")
    return np.asarray((w / unit) ** 2)
