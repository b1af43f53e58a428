# SPDX-License-Identifier: BSD-2-Clause
"""The part of each motor limit that a motion along a path uses.

On the path x(s) of the coordinates, w and u are the first and second time derivatives of s. The
motors use the parts a(s) u + b(s) w^2 + c(s) + d(s) w + dry(s) of their limits, due to inertia,
velocity, gravity, viscous and Coulomb friction. The inverse dynamics gives these functions.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array
from ..closed_chain import ClosedChain
from ..dynamics.torque_sharing import finite_limits
from ..errors import ActuationError, InputError
from ..model.named_positions import put, taken
from ..simulation.coordinate_motions import coordinate_positions
from ..simulation.samples import spline
from ..summaries import listed
from .motor_limits import combinations, motors_of, of_sizes, part_of, sums_of

#: The part of each limit that is kept free at grid points, because more may be used between them.
MARGIN = 1e-4
#: A rate w at which inertia forces are much larger than friction. A joint is at rest if its rate is
#: below this part of the largest joint rate.
_FAST, _STILL = 1e4, 1e-8
#: Largest change of q when the loops are closed between samples, [rad] or robot lengths.
_OPEN = 0.02


class SmoothPath:
    """A curve q(s), 0 <= s <= 1, with s about proportional to the length of the path."""

    def __init__(self, chain: ClosedChain, path: ArrayLike) -> None:
        self._chain, self._space = chain, chain.mechanism.space
        q = finite_array("path", path, (chain.mechanism.model.nq,))
        if q.ndim != 2 or len(q) < 3:
            raise InputError("path", f"shape {q.shape}, expected (N, {q.shape[-1]}) with N >= 3")
        x = coordinate_positions(chain.mechanism, q)
        wrapped = np.abs(np.diff(x - taken(self._space, q, chain.coordinates), axis=0)) > 1
        if (wrapped & (np.abs(np.diff(x, axis=0)) > np.pi / 2)).any() or (
            wrapped[1:] & wrapped[:-1]
        ).any():
            raise InputError("path", "a joint turns by half a turn between samples: use more")
        scale = chain.mechanism.rate_scale[chain.mechanism.coordinates]
        steps = np.linalg.norm(np.diff(x, axis=0) / scale, axis=1)
        moving_samples = np.append(True, steps > 1e-9 * steps.sum())
        if moving_samples.sum() < 3:
            raise InputError("path", "the coordinates do not move along it")
        moves = np.diff(x[moving_samples], axis=0) / scale
        back = np.flatnonzero((moves[1:] * moves[:-1]).sum(axis=1) < 0)
        if len(back):
            sample = np.flatnonzero(moving_samples)[back[0] + 1]
            raise InputError("path", f"it turns back at sample {sample}: divide it there")
        s = np.cumsum(np.append(0, steps)[moving_samples])
        s /= s[-1]
        self._joints = spline(s, self._space.without_jumps(q[moving_samples]))
        self._curve = spline(s, x[moving_samples])
        self._first, self._second = self._curve.derivative(1), self._curve.derivative(2)

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """Configurations, and derivatives of the coordinates by s, shapes (N, nq), (N, n)."""
        chain, x = self._chain, self._curve(s)
        wanted = dict(zip(chain.coordinates, x.T, strict=True))
        q = guess = put(self._space, self._joints(s), wanted)
        if chain.closures:
            q = chain.engine.states(0.0).closed(np.hstack([guess, np.zeros_like(x)]))
        lengths = np.array(self._space.position_units) == "m"
        gaps = np.abs(q - guess) / np.where(lengths, chain.mechanism.length, 1.0)
        if gaps.max() > _OPEN:
            place = s[gaps.max(axis=1).argmax()]
            raise InputError("path", f"it jumps, or has too few samples, at {place:.1%} of it")
        return q, self._first(s), self._second(s)


class MotorLimits:
    """Limits of the motors, and the parts of them that a motion takes, from -1 to 1.

    With surplus motors, `factors` gives the sums of parts that do not depend on the preload.
    """

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
            raise InputError("torques, accelerations", "give limits of torques or accelerations")
        if accelerations is not None and chain.mechanism.lines.motors.any():
            raise InputError("accelerations", "not for motors on lines")

    def _bounds(self, name: str, value: ArrayLike | None) -> Array | None:
        """Least and largest numbers, shape (motors, 2)."""
        if value is None:
            return None
        bounds = finite_limits(value, len(self.chain.motor_names), name)
        if name != "torques" and not (bounds * (-1, 1) > 0).all():
            raise InputError(name, "zero must lie within the limits")
        return bounds

    def parts(self, q: Array, va: Array, aa: Array) -> Array:
        """Parts of the limits of torques, then of accelerations, shape (N, k)."""
        chain, parts = self.chain, list[Array]()
        if self.torques is not None:
            parts.append(part_of(chain.compute_torques(q, va, aa), self.torques))
        if self.accelerations is not None:
            of_motors = chain.joint_accelerations(q, va, aa) @ chain.mechanism.motors
            parts.append(part_of(of_motors, self.accelerations))
        return np.hstack(parts)

    def factors(self, q: Array) -> Array:
        """Factors of the parts in each sum, continuous along a path, shape (N, sums, k)."""
        torques = np.zeros((len(q), 0, 0))
        if self.torques is not None:
            torques = combinations(self.chain.preload_directions(q), self.torques)
        accelerated = 0 if self.accelerations is None else len(self.chain.motor_names)
        above = np.pad(torques, ((0, 0), (0, 0), (0, accelerated)))
        below = np.eye(accelerated, above.shape[2], torques.shape[2])
        return np.hstack([above, np.tile(below, (len(q), 1, 1))])

    def speeds(self, q: Array, va: Array) -> Array:
        """Parts of the limits of rates, shape (N, k)."""
        if self.rates is None:
            return np.zeros((len(q), 1))
        each = self.chain.motor_rates(q, va)[:, :, None] / self.rates
        return each.reshape(len(q), -1)

    def used(self, q: Array, va: Array, aa: Array) -> Array:
        """The largest part of a limit, shape (N,)."""
        sums = sums_of(self.factors(q), self.parts(q, va, aa))
        return np.maximum(np.abs(sums).max(axis=1), self.speeds(q, va).max(axis=1))

    def dry_friction(self, q: Array) -> Array:
        """Parts of the limits that Coulomb friction of each joint takes, shape (N, k, nv)."""
        chain, sizes = self.chain, self.chain.mechanism.friction.coulomb
        kinds = (self.torques is not None) + (self.accelerations is not None)
        motors, n = len(chain.motor_names), chain.degrees_of_freedom
        parts = np.zeros((len(q), kinds * motors, len(sizes)))
        if self.torques is not None and sizes.any():
            motions = q[:, None], np.eye(n)
            J_T, L_T = chain.motor_rates(*motions), chain.joint_rates(*motions)
            half = np.ptp(self.torques, axis=1)[:, None] / 2
            parts[:, :motors] = np.linalg.pinv(J_T) @ L_T * sizes / half
        return parts

    def require_rest(self, q: Array) -> None:
        """Refuse ends of a path, shape (2, nq), where the motors cannot hold the robot."""
        rest, factors = np.zeros((2, self.chain.degrees_of_freedom)), self.factors(q)
        over = np.argwhere(np.abs(sums_of(factors, self.parts(q, rest, rest))) > 1 - MARGIN)
        if len(over):
            end, row = over[0]
            raise ActuationError(
                f"{listed(motors_of(self.chain, factors[end, row]))} cannot hold the robot at the "
                f"{('start', 'end')[end]} of the path within the limits"
            )

    def torques_of(self, q: Array, va: Array, aa: Array) -> Array:
        """The smallest torques within the limits, shape (N, motors)."""
        return self.chain.compute_torques(q, va, aa, limits=self.torques)


class Parts(NamedTuple):
    """Parts of the limits in both directions at points of a path, shape (N, k); the limits are 1.

    The module docstring explains a to d. `dry` is the largest Coulomb friction in each direction:
    its sign is unknown where a joint is at rest, so the two directions differ. `most` is the
    largest w, shape (N,).
    """

    a: Array
    b: Array
    c: Array
    d: Array
    dry: Array
    most: Array


class PathForces:
    """All parts along a path, from inverse dynamics at some of its points."""

    def __init__(self, limits: MotorLimits, path: SmoothPath, nodes: Array) -> None:
        q, first, second = path.at(nodes)
        limits.require_rest(q[[0, -1]])
        factors = limits.factors(q)

        def at(w: float, u: float = 0.0) -> Array:
            parts = limits.parts(q, w * first, w**2 * second + u * first)
            return np.einsum("irk,ik->ir", factors, parts)

        c, ahead, back = at(0.0), at(_FAST), at(-_FAST)
        rates = limits.chain.joint_rates(q, first) / limits.chain.mechanism.rate_scale
        self._factors, self._rates = spline(nodes, factors), spline(nodes, rates)
        self._dry = spline(nodes, factors @ limits.dry_friction(q))
        low, high = self._coulomb(nodes)
        a, b = at(0.0, 1.0) - c, (ahead + back) / 2 - c
        d = (ahead - back) / 2 - (low + high) / 2
        speeds = limits.speeds(q, first)
        self._smooth = spline(nodes, np.stack([a, b / _FAST**2, c, d / _FAST], axis=1))
        self._speeds = spline(nodes, speeds)
        # The unit of time in which w is about one.
        largest = np.abs(of_sizes(a, factors)).max()
        self.unit = max(float(np.sqrt(largest)), float(speeds.max()), 1e-100)
        self.viscous = float(np.abs(of_sizes(d, factors)).max()) > MARGIN * _FAST * self.unit

    def _coulomb(self, s: Array) -> tuple[Array, Array]:
        """Least and largest Coulomb friction, shape (N, k)."""
        v, of_joints = self._rates(s), self._dry(s)
        moving = np.abs(v) > _STILL * np.abs(v).max(axis=1, keepdims=True)
        known = np.einsum("imj,ij->im", of_joints, np.sign(v) * moving)
        either = np.einsum("imj,ij->im", np.abs(of_joints), ~moving)
        return known - either, known + either

    def at(self, s: Array) -> Parts:
        """All parts at points of the path."""
        with np.errstate(divide="ignore"):
            most = 1 / np.maximum(self._speeds(s).max(axis=1), 0)
        factors, (low, high) = self._factors(s), self._coulomb(s)
        smooth = np.moveaxis(self._smooth(s), 1, 0)
        # a to d and the friction in one direction, then in the other.
        both = np.stack([*smooth, high]), np.stack([*-smooth, -low])
        a, b, c, d, dry = np.concatenate([of_sizes(x, factors) for x in both], axis=-1)
        return Parts(a, b, c, d, dry, most)
