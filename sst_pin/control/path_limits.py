# SPDX-License-Identifier: BSD-2-Clause
"""Limits of the torques, rates and accelerations of the motors, for motions along a path.

The part of a limit that a torque or an acceleration takes is -1 at the least value and 1 at the
largest. With surplus motors, a preload changes the parts of torques. The motors keep their limits
for some preload if certain sums of parts, which no preload changes, are between -1 and 1.
`motor_limits` derives these sums: each is a row of factors times the parts, divided by the sum of
the sizes of the factors.
"""

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..dynamics.torque_sharing import finite_limits
from ..errors import ActuationError, InputError
from ..summaries import listed
from .motor_limits import factors_of_sums, motors_of, part_of, sums_of

#: Part of each limit that is not used at grid points, because more may be used between them.
MARGIN = 1e-4


class MotorLimits:
    """Limits of the motors, and the parts of them that a motion takes.

    There are k parts: one for the torque of each motor if torques have limits, then one for the
    acceleration of each motor if accelerations have limits. `factors` has the factors of the sums
    of parts. Without surplus motors, each sum is a single part. Rates have no parts: `speeds`
    compares them with their limits.

    Args:
        chain: The robot.
        torques: Largest ones, shape () or (motors,), or least and largest ones, (motors, 2); None
            for no limit.
        rates: Limits of the motors' rates in the same shapes; zero must be within them.
        accelerations: Limits of the motors' accelerations, like those of rates.

    Attributes:
        torques, rates, accelerations: Least and largest values, shape (motors, 2), or None.
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
        if self.accelerations is not None:
            self._require_rest_inside(self.accelerations)
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

    def _require_rest_inside(self, accelerations: Array) -> None:
        """Refuse limits so close to zero that a motor at rest is within `MARGIN` of the limit."""
        too_near = np.abs(part_of(np.zeros(len(accelerations)), accelerations)) > 1 - MARGIN
        if too_near.any():
            motors = listed([self.chain.motor_names[k] for k in np.flatnonzero(too_near)])
            text = f"{motors}: one limit is less than {MARGIN / 2:.3%} of the range; enlarge it"
            raise InputError("accelerations", text)

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
        """Factors of the parts in each sum, continuous along a path, shape (N, sums, k).

        The sums of parts of torques come first. Then each acceleration is a sum by itself, because
        preloads do not change it.
        """
        of_torques = np.zeros((len(q), 0, 0))
        if self.torques is not None:
            of_torques = factors_of_sums(self.chain.preload_directions(q), self.torques)
        accelerations = 0 if self.accelerations is None else len(self.chain.motor_names)
        # The factor of a single acceleration may have any size, but `normalised` takes rows of
        # factors that are much smaller than others for zero. The size of the factors of torques
        # depends on the units. So the factor of an acceleration has the size of their largest row.
        size = np.abs(of_torques).sum(axis=-1).max(initial=0.0) or 1.0
        # A block diagonal matrix: the block of the torques, then the block of the accelerations.
        _, sums, torques = of_torques.shape
        factors = np.zeros((len(q), sums + accelerations, torques + accelerations))
        factors[:, :sums, :torques] = of_torques
        factors[:, sums:, torques:] = size * np.eye(accelerations)
        return factors

    def speeds(self, q: Array, va: Array) -> Array:
        """Rates of the motors by their limits, shape (N, 2 motors); zeros, (N, 1), without limits.

        Each motor has two entries: its rate divided by its least rate, which is negative, and by
        its largest rate. The motion keeps the limits if no entry exceeds 1.
        """
        if self.rates is None:
            return np.zeros((len(q), 1))
        rates_by_limits = self.chain.motor_rates(q, va)[:, :, None] / self.rates
        return rates_by_limits.reshape(len(q), -1)

    def used(self, q: Array, va: Array, aa: Array) -> Array:
        """The largest part of a limit that is used, shape (N,)."""
        sums = sums_of(self.factors(q), self.parts(q, va, aa))
        return np.maximum(np.abs(sums).max(axis=1), self.speeds(q, va).max(axis=1))

    def dry_friction(self, q: Array) -> Array:
        """Parts of the limits that Coulomb friction takes, shape (N, k, nv + lines).

        The columns are the joints and lines, each while it moves forward. Limits of accelerations
        are not affected: their rows are zero.
        """
        chain = self.chain
        mechanism = chain.mechanism
        coulomb = np.concatenate([mechanism.friction.coulomb, mechanism.lines.coulomb])
        motors = len(chain.motor_names)
        number_of_parts = 0
        if self.torques is not None:
            number_of_parts += motors
        if self.accelerations is not None:
            number_of_parts += motors
        parts = np.zeros((len(q), number_of_parts, len(coulomb)))
        if self.torques is not None and coulomb.any():
            # Let r = R va be the rates of joints and lines, and J va those of the motors. Friction
            # f of joints and lines is the force R^T f along the coordinates, and the smallest
            # torques for it are (J^T)^+ R^T f. The rates of motors, joints and lines for the unit
            # rates of coordinate i are row i of J^T and R^T.
            unit_rates = np.eye(chain.degrees_of_freedom)
            J_T = chain.motor_rates(q[:, None], unit_rates)  # shape (N, n, motors)
            rates_of_joints = chain.joint_rates(q[:, None], unit_rates)
            rates_of_lines = chain.engine.line_rates(q[:, None], rates_of_joints)
            R_T = np.concatenate([rates_of_joints, rates_of_lines], axis=-1)  # (N, n, nv + lines)
            half_range = np.ptp(self.torques, axis=1)[:, None] / 2
            parts[:, :motors] = np.linalg.pinv(J_T) @ R_T * coulomb / half_range
        return parts

    def require_rest(self, q: Array) -> None:
        """Refuse ends of a path, shape (2, nq), where the motors cannot hold the robot."""
        if self.torques is None:
            return
        rest = np.zeros((2, self.chain.degrees_of_freedom))
        torques = self.chain.compute_torques(q, rest, rest)
        factors = factors_of_sums(self.chain.preload_directions(q), self.torques)
        sums = sums_of(factors, part_of(torques, self.torques))
        for end, name in enumerate(("start", "end")):
            over = np.flatnonzero(np.abs(sums[end]) > 1 - MARGIN)
            if len(over):
                motors = listed(motors_of(self.chain, factors[end, over[0]]))
                problem = f"{motors} cannot hold the robot at the {name} of the path"
                raise ActuationError(f"{problem} within the limits")

    def torques_of(self, q: Array, va: Array, aa: Array) -> Array:
        """The smallest torques within the limits, shape (N, motors)."""
        return self.chain.compute_torques(q, va, aa, limits=self.torques)
