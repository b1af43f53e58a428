# SPDX-License-Identifier: BSD-2-Clause
"""The part of each motor limit that a motion along a path uses.

On the path x(s) of the coordinates, w and u are the first and second time derivatives of s. The
motors use the parts a(s) u + b(s) w^2 + c(s) + d(s) w + dry(s) of their limits, due to inertia,
velocity, gravity, viscous and Coulomb friction. The inverse dynamics gives these functions.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, finite_array
from ..closed_chain import ClosedChain
from ..dynamics.torque_sharing import finite_limits
from ..errors import ActuationError, InputError
from ..model.named_positions import positions_of, with_positions
from ..simulation.coordinate_motions import coordinate_positions
from ..simulation.samples import spline
from ..summaries import listed
from .motor_limits import combinations, motors_of, of_sizes, part_of, sums_of

#: Part of each limit that is not used at grid points, because more may be used between them.
MARGIN = 1e-4
#: A rate w at which inertia forces are much larger than friction: w^2 is far above w. The forces
#: at w and -w then give b and d with eight digits.
_FAST = 1e4
#: A joint counts as resting if its rate is below this fraction of the largest joint rate. 1e-8 is
#: the square root of the rounding error: splines of the rates are not exactly zero.
_STILL = 1e-8
#: A sample counts as moving if its step is longer than this fraction of the path.
_SHORTEST_STEP = 1e-9
#: Largest change of q when the loops are closed between samples, [rad] or robot lengths. A larger
#: one means that the spline through the samples leaves the assembly mode or that samples jump.
_OPEN = 0.02


class SmoothPath:
    """A curve q(s), 0 <= s <= 1, with s about proportional to the length of the path."""

    def __init__(self, chain: ClosedChain, path: ArrayLike) -> None:
        self._chain = chain
        self._space = chain.mechanism.space
        q = finite_array("path", path, (chain.mechanism.model.nq,))
        if q.ndim != 2 or len(q) < 3:
            raise InputError("path", f"shape {q.shape}, expected (N, {q.shape[-1]}) with N >= 3")
        x = coordinate_positions(chain.mechanism, q)
        self._require_small_turns(q, x)

        # Repeated samples are left out: they have no direction.
        scale = chain.mechanism.rate_scale[chain.mechanism.coordinates]
        steps = np.linalg.norm(np.diff(x, axis=0) / scale, axis=1)
        moving = np.append(True, steps > _SHORTEST_STEP * steps.sum())
        if moving.sum() < 3:
            raise InputError("path", "the coordinates do not move along it")
        _require_no_return(x[moving] / scale, np.flatnonzero(moving))

        s = np.cumsum(np.append(0, steps)[moving])
        s /= s[-1]
        self._joints = spline(s, self._space.without_jumps(q[moving]))
        self._curve = spline(s, x[moving])
        self._first = self._curve.derivative(1)
        self._second = self._curve.derivative(2)

    def _require_small_turns(self, q: Array, x: Array) -> None:
        """Refuse samples between which the direction of a turn is not known.

        `x` are continuous positions of the coordinates, those in q lie within one turn. They differ
        by another number of turns where a joint passes the end of its turn.
        """
        turns = x - positions_of(self._space, q, self._chain.coordinates)
        passes_end = np.abs(np.diff(turns, axis=0)) > 1
        is_large = np.abs(np.diff(x, axis=0)) > np.pi / 2
        passes_twice = passes_end[1:] & passes_end[:-1]
        if (passes_end & is_large).any() or passes_twice.any():
            raise InputError("path", "a joint turns by half a turn between samples: use more")

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """Configurations, and derivatives of the coordinates by s, shapes (N, nq), (N, n)."""
        chain = self._chain
        x = self._curve(s)
        guess = with_positions(
            self._space, self._joints(s), dict(zip(chain.coordinates, x.T, strict=True))
        )
        q = guess
        if chain.closures:
            resting_states = np.hstack([guess, np.zeros_like(x)])
            q = chain.engine.state_space(0.0).closed(resting_states)
        lengths = np.array(self._space.position_units) == "m"
        gaps = np.abs(q - guess) / np.where(lengths, chain.mechanism.length, 1.0)
        if gaps.max() > _OPEN:
            place = s[gaps.max(axis=1).argmax()]
            raise InputError("path", f"it jumps, or has too few samples, at {place:.1%} of it")
        return q, self._first(s), self._second(s)


def _require_no_return(x: Array, samples: Indices) -> None:
    """Refuse a path that turns back; x has no units, `samples` are the numbers of its rows."""
    steps = np.diff(x, axis=0)
    returns = np.flatnonzero((steps[1:] * steps[:-1]).sum(axis=1) < 0)
    if len(returns):
        sample = samples[returns[0] + 1]
        raise InputError("path", f"it turns back at sample {sample}: divide it there")


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
        if self.torques is None and self.accelerations is None:
            raise InputError("torques, accelerations", "give limits of torques or accelerations")
        if accelerations is not None and chain.mechanism.lines.actuation.any():
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
        chain = self.chain
        parts: list[Array] = []
        if self.torques is not None:
            parts.append(part_of(chain.compute_torques(q, va, aa), self.torques))
        if self.accelerations is not None:
            motor_accelerations = chain.joint_accelerations(q, va, aa) @ chain.mechanism.actuation
            parts.append(part_of(motor_accelerations, self.accelerations))
        return np.hstack(parts)

    def factors(self, q: Array) -> Array:
        """Factors of the parts in each sum, continuous along a path, shape (N, sums, k)."""
        torques = np.zeros((len(q), 0, 0))
        if self.torques is not None:
            torques = combinations(self.chain.preload_directions(q), self.torques)
        accelerations = 0
        if self.accelerations is not None:
            accelerations = len(self.chain.motor_names)
        # Block diagonal: sums of torques first, then each acceleration by itself.
        _, sums, columns = torques.shape
        factors = np.zeros((len(q), sums + accelerations, columns + accelerations))
        factors[:, :sums, :columns] = torques
        factors[:, sums:, columns:] = np.eye(accelerations)
        return factors

    def speeds(self, q: Array, va: Array) -> Array:
        """Parts of the limits of rates, shape (N, k)."""
        if self.rates is None:
            return np.zeros((len(q), 1))
        parts = self.chain.motor_rates(q, va)[:, :, None] / self.rates
        return parts.reshape(len(q), -1)

    def used(self, q: Array, va: Array, aa: Array) -> Array:
        """The largest part of a limit, shape (N,)."""
        sums = sums_of(self.factors(q), self.parts(q, va, aa))
        return np.maximum(np.abs(sums).max(axis=1), self.speeds(q, va).max(axis=1))

    def dry_friction(self, q: Array) -> Array:
        """Parts of the limits that Coulomb friction of each joint takes, shape (N, k, nv)."""
        chain = self.chain
        coulomb = chain.mechanism.friction.coulomb
        motors = len(chain.motor_names)
        limits = [self.torques, self.accelerations]
        k = motors * sum(limit is not None for limit in limits)
        parts = np.zeros((len(q), k, len(coulomb)))
        if self.torques is not None and coulomb.any():
            # Rates along each coordinate are the rows of J^T and L^T.
            unit_rates = np.eye(chain.degrees_of_freedom)
            J_T = chain.motor_rates(q[:, None], unit_rates)
            L_T = chain.joint_rates(q[:, None], unit_rates)
            half_range = np.ptp(self.torques, axis=1)[:, None] / 2
            parts[:, :motors] = np.linalg.pinv(J_T) @ L_T * coulomb / half_range
        return parts

    def require_rest(self, q: Array) -> None:
        """Refuse ends of a path, shape (2, nq), where the motors cannot hold the robot."""
        factors = self.factors(q)
        rest = np.zeros((2, self.chain.degrees_of_freedom))
        sums = sums_of(factors, self.parts(q, rest, rest))
        over = np.argwhere(np.abs(sums) > 1 - MARGIN)
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

        def sums_at(w: float, u: float = 0.0) -> Array:
            parts = limits.parts(q, w * first, w**2 * second + u * first)
            return np.einsum("irk,ik->ir", factors, parts)

        rates = limits.chain.joint_rates(q, first) / limits.chain.mechanism.rate_scale
        self._factors = spline(nodes, factors)
        self._rates = spline(nodes, rates)
        self._dry = spline(nodes, factors @ limits.dry_friction(q))

        # The sums are a u + b w^2 + c + d w + dry friction. At +w and -w the even part is c + b w^2
        # and the odd part is d w and the friction, whose sign follows the rate.
        rest = sums_at(0.0)
        forward = sums_at(_FAST)
        backward = sums_at(-_FAST)
        low, high = self._coulomb(nodes)
        a = sums_at(0.0, 1.0) - rest
        b_w2 = (forward + backward) / 2 - rest
        d_w = (forward - backward) / 2 - (low + high) / 2
        speeds = limits.speeds(q, first)
        smooth = np.stack([a, b_w2 / _FAST**2, rest, d_w / _FAST], axis=1)
        self._smooth = spline(nodes, smooth)
        self._speeds = spline(nodes, speeds)
        # The unit of time in which w is about one.
        largest = np.abs(of_sizes(a, factors)).max()
        self.unit = max(float(np.sqrt(largest)), float(speeds.max()), 1e-100)
        self.viscous = float(np.abs(of_sizes(d_w, factors)).max()) > MARGIN * _FAST * self.unit

    def _coulomb(self, s: Array) -> tuple[Array, Array]:
        """Least and largest Coulomb friction, shape (N, k)."""
        rates = self._rates(s)
        dry = self._dry(s)
        moves = np.abs(rates) > _STILL * np.abs(rates).max(axis=1, keepdims=True)
        # The friction of a moving joint follows its rate; of a resting joint it has either sign.
        moving = np.einsum("ikj,ij->ik", dry, np.sign(rates) * moves)
        resting = np.einsum("ikj,ij->ik", np.abs(dry), ~moves)
        return moving - resting, moving + resting

    def at(self, s: Array) -> Parts:
        """All parts at points of the path."""
        with np.errstate(divide="ignore"):
            most = 1 / np.maximum(self._speeds(s).max(axis=1), 0)
        factors = self._factors(s)
        low, high = self._coulomb(s)
        smooth = np.moveaxis(self._smooth(s), 1, 0)
        # a to d and the friction in one direction, then in the other.
        upper = np.stack([*smooth, high])
        lower = np.stack([*-smooth, -low])
        rows = [of_sizes(parts, factors) for parts in (upper, lower)]
        a, b, c, d, dry = np.concatenate(rows, axis=-1)
        return Parts(a, b, c, d, dry, most)
