# SPDX-License-Identifier: BSD-2-Clause
"""The part of each motor limit that a motion along a path uses.

On the path x(s) of the coordinates, w and u are the first and second time derivatives of s. So the
rates are x' w and the accelerations x' u + x'' w^2. The motors use the parts

    a(s) u + b(s) w^2 + c(s) + d(s) w + dry(s)

of their limits, due to inertia, velocity, weights and springs, viscous and Coulomb friction. Parts
and sums of parts that do not depend on a preload are explained in `motor_limits`. The functions of
s follow from the inverse dynamics for some u and w.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..dynamics.torque_sharing import finite_limits
from ..errors import ActuationError, InputError
from ..simulation.samples import spline
from ..summaries import listed
from .motor_limits import combinations, motors_of, normalised, part_of, sums_of
from .smooth_path import SmoothPath

#: Part of each limit that is not used at grid points, because more may be used between them.
MARGIN = 1e-4
#: A rate w at which inertia forces are much larger than friction: w^2 is far above w. The forces
#: at w and -w then give b and d with eight digits.
_FAST = 1e4
#: A joint counts as resting if its rate is below this fraction of the largest joint rate. 1e-8 is
#: the square root of the rounding error: splines of the rates are not exactly zero.
_STILL = 1e-8


class MotorLimits:
    """Limits of the motors, and the parts of them that a motion takes, from -1 to 1.

    There are k parts: one for the torque of each motor if torques have limits, then one for the
    acceleration of each motor if accelerations have limits. With surplus motors, `factors` gives
    the sums of parts that do not depend on the preload.
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
        """Parts of the limits that Coulomb friction takes, shape (N, k, nv + lines)."""
        chain = self.chain
        mechanism = chain.mechanism
        coulomb = np.concatenate([mechanism.friction.coulomb, mechanism.lines.coulomb])
        motors = len(chain.motor_names)
        limits = [self.torques, self.accelerations]
        k = motors * sum(limit is not None for limit in limits)
        parts = np.zeros((len(q), k, len(coulomb)))
        if self.torques is not None and coulomb.any():
            # Rates along each coordinate are the rows of J^T and L^T, and those of the lines.
            unit_rates = np.eye(chain.degrees_of_freedom)
            J_T = chain.motor_rates(q[:, None], unit_rates)
            L_T = chain.joint_rates(q[:, None], unit_rates)
            of_lines = chain.engine.line_rates(q[:, None], L_T)
            rates = np.concatenate([L_T, of_lines], axis=-1)
            half_range = np.ptp(self.torques, axis=1)[:, None] / 2
            parts[:, :motors] = np.linalg.pinv(J_T) @ rates * coulomb / half_range
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
    """What a motion uses of its limits at N points of a path.

    Each sum of parts has two columns, together 2 sums: the sum itself and its opposite, so that
    both ends of its range are 1. The motion keeps its limits if no column exceeds 1.
    """

    #: Shapes (N, 2 sums); see the module.
    a: Array
    b: Array
    c: Array
    d: Array
    #: The largest Coulomb friction in each column, shape (N, 2 sums). Its sign is
    #: unknown where a joint is at rest, so the two directions differ.
    dry: Array
    #: The largest w by the limits of rates, shape (N,).
    most: Array


class PathForces:
    """All parts along a path, as splines through some of its points, the nodes.

    Attributes:
        unit: The unit of time in which w is about one, in 1/s.
        viscous: Whether viscous friction matters.
    """

    def __init__(self, limits: MotorLimits, path: SmoothPath, nodes: Array) -> None:
        q, first, second = path.at(nodes)
        limits.require_rest(q[[0, -1]])
        factors = limits.factors(q)

        def sums_at(w: float, u: float = 0.0) -> Array:
            """Sums of parts for w and u at the nodes, shape (nodes, sums)."""
            parts = limits.parts(q, w * first, w**2 * second + u * first)
            return np.einsum("irk,ik->ir", factors, parts)

        # Coulomb friction, by the rates of the joints and of the lengths of lines.
        mechanism = limits.chain.mechanism
        of_joints = limits.chain.joint_rates(q, first)
        of_lines = limits.chain.engine.line_rates(q, of_joints)
        rates = np.hstack([of_joints / mechanism.rate_scale, of_lines / mechanism.length])
        dry = factors @ limits.dry_friction(q)
        least, largest = _coulomb(rates, dry)

        # The sums at +w and -w: the even part is c + b w^2, the odd part is d w and the friction,
        # whose sign follows the rate.
        rest = sums_at(0.0)
        forward = sums_at(_FAST)
        backward = sums_at(-_FAST)
        a = sums_at(0.0, 1.0) - rest
        b_w2 = (forward + backward) / 2 - rest
        d_w = (forward - backward) / 2 - (least + largest) / 2
        speeds = limits.speeds(q, first)

        self._factors = spline(nodes, factors)
        self._rates = spline(nodes, rates)
        self._dry = spline(nodes, dry)
        self._abcd = spline(nodes, np.stack([a, b_w2 / _FAST**2, rest, d_w / _FAST], axis=1))
        self._speeds = spline(nodes, speeds)
        largest_a = np.abs(normalised(a, factors)).max()
        self.unit = max(float(np.sqrt(largest_a)), float(speeds.max()), 1e-100)
        self.viscous = float(np.abs(normalised(d_w, factors)).max()) > MARGIN * _FAST * self.unit

    def at(self, s: Array) -> Parts:
        """All parts at points of the path."""
        with np.errstate(divide="ignore"):
            most = 1 / np.maximum(self._speeds(s).max(axis=1), 0)
        factors = self._factors(s)
        least, largest = _coulomb(self._rates(s), self._dry(s))
        abcd = np.moveaxis(self._abcd(s), 1, 0)
        upper = normalised(np.stack([*abcd, largest]), factors)
        lower = normalised(np.stack([*-abcd, -least]), factors)
        a, b, c, d, dry = np.concatenate([upper, lower], axis=-1)
        return Parts(a, b, c, d, dry, most)


def _coulomb(rates: Array, dry: Array) -> tuple[Array, Array]:
    """Least and largest sums of Coulomb friction at N points of a path, shape (N, sums).

    The friction of a moving joint or line follows its rate; at rest it has either sign.

    Args:
        rates: Rates of the joints and lines by s, free of units, shape (N, nv + lines).
        dry: Sums by joint and line where it moves forward, shape (N, sums, nv + lines).
    """
    moves = np.abs(rates) > _STILL * np.abs(rates).max(axis=1, keepdims=True)
    moving = np.einsum("ikj,ij->ik", dry, np.sign(rates) * moves)
    resting = np.einsum("ikj,ij->ik", np.abs(dry), ~moves)
    return moving - resting, moving + resting
