# SPDX-License-Identifier: BSD-2-Clause
"""Limits of the torques, rates and accelerations of the motors, for motions along a path.

A part of a limit runs from -1 at the least value to 1 at the largest. Parts, and sums of parts that
do not depend on a preload, are explained in `motor_limits`.
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
        """Refuse limits one of whose ends is so small that the margin at grid points passes it."""
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
        """Factors of the parts in each sum, continuous along a path, shape (N, sums, k)."""
        torques = np.zeros((len(q), 0, 0))
        if self.torques is not None:
            torques = factors_of_sums(self.chain.preload_directions(q), self.torques)
        accelerations = 0
        if self.accelerations is not None:
            accelerations = len(self.chain.motor_names)
        # Factors of torques depend on the units. If those of accelerations were 1, the rows of
        # one kind could count as zero beside the other.
        size = np.abs(torques).sum(axis=-1).max(initial=0.0) or 1.0
        # Block diagonal: sums of torques first, then each acceleration by itself.
        _, sums, columns = torques.shape
        factors = np.zeros((len(q), sums + accelerations, columns + accelerations))
        factors[:, :sums, :columns] = torques
        factors[:, sums:, columns:] = size * np.eye(accelerations)
        return factors

    def speeds(self, q: Array, va: Array) -> Array:
        """Parts of the limits of rates, shape (N, 2 motors); without limits zeros, shape (N, 1).

        Each motor has its rate divided by its least rate, then by its largest one: at most 1.
        """
        if self.rates is None:
            return np.zeros((len(q), 1))
        parts = self.chain.motor_rates(q, va)[:, :, None] / self.rates
        return parts.reshape(len(q), -1)

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
            # Friction f of a joint or line with the rate r = R va is the force R^T f along the
            # coordinates. The smallest torques for it are (J^T)^+ R^T f. Unit rates of the
            # coordinates give J^T and R^T in rows.
            unit_rates = np.eye(chain.degrees_of_freedom)
            J_T = chain.motor_rates(q[:, None], unit_rates)
            rates_of_joints = chain.joint_rates(q[:, None], unit_rates)
            rates_of_lines = chain.engine.line_rates(q[:, None], rates_of_joints)
            R_T = np.concatenate([rates_of_joints, rates_of_lines], axis=-1)
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
