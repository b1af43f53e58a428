# SPDX-License-Identifier: BSD-2-Clause
"""Limits of joints in Newton's method on the closures."""

import numpy as np

from ..arrays import Array, Flags, Indices
from ..errors import ClosureError
from ..model.mechanism import Mechanism

#: Joints at a smaller distance from a limit are at the limit, [rad] or lengths of the loop: a joint
#: that is set to its limit differs from it by some roundings.
_AT_LIMIT = 1e-12


class JointLimits:
    """Limits of all joints of one coordinate, of which only the rates `free` may move.

    `clipped` moves only the joints of free rates. The other methods are about all joints, or about
    the rates that they get.

    Steps are those of Newton's method: shape (rates,), free of units, for some rates of v.
    """

    def __init__(self, mechanism: Mechanism, free: Indices) -> None:
        model = mechanism.model
        self._mechanism = mechanism
        joints = [j for j in list(model.joints)[1:] if (j.nq, j.nv) == (1, 1)]
        #: Indices of these joints in q, and in v.
        self._entries = np.array([joint.idx_q for joint in joints], dtype=np.intp)
        self._rates = np.array([joint.idx_v for joint in joints], dtype=np.intp)
        #: Indices in q of those that may move.
        self._free_entries = self._entries[np.isin(self._rates, free)]
        self._lower = model.lowerPositionLimit
        self._upper = model.upperPositionLimit

    def clipped(self, q: Array) -> Array:
        """The nearest configuration in which the free joints are within their limits."""
        q = q.copy()
        k = self._free_entries
        q[k] = np.clip(q[k], self._lower[k], self._upper[k])
        return q

    def can_step(self, q: Array, rates: Indices, step: Array) -> Flags:
        """Which rates can step: their joints are not at the limit that the step leads to."""
        return self._distances_ahead(q, rates, step) > _AT_LIMIT

    def fraction_to_limit(self, q: Array, rates: Indices, step: Array) -> float:
        """The fraction of a step at which the first joint reaches its limit, at most 1."""
        moving = step != 0
        distances = self._distances_ahead(q, rates, step)[moving]
        return float((distances / np.abs(step[moving])).min(initial=1.0))

    def require_within(self, q: Array) -> None:
        """Raise an error if joints are outside their limits, or if their ranges are empty.

        q is a result of `clipped`: only fixed joints, or those with empty ranges, can be outside.
        """
        nearest = self._distances(q).min(axis=0)
        outside = nearest < 0
        if outside.any():
            raise ClosureError(
                f"fixed outside their limits, or with empty ranges: {self._names(outside)}; fix "
                "fewer joints, start within the limits, or correct the limits",
                float(-(nearest * self._mechanism.rate_scale).min()),
            )

    def reached(self, q: Array) -> str:
        """Which joints are at their limits, in words."""
        at_limit = self._distances(q).min(axis=0) <= _AT_LIMIT
        return f" within the joint limits ({self._names(at_limit) or 'none'} at a limit)"

    def _distances_ahead(self, q: Array, rates: Indices, step: Array) -> Array:
        """Distances to the limits that a step of these rates leads to, shape (rates,).

        For a rate with a step of zero, it is the distance to the upper limit: a choice, because the
        step leads to neither.
        """
        to_lower, to_upper = self._distances(q)[:, rates]
        return np.where(step < 0, to_lower, to_upper)

    def _distances(self, q: Array) -> Array:
        """Distances to the lower and the upper limits, [rad] or lengths of the loop, shape (2, nv).

        They are negative outside the limits, and infinite for joints of several coordinates.
        """
        distances = np.full((2, self._mechanism.model.nv), np.inf)
        k = self._entries
        distances[0, self._rates] = q[k] - self._lower[k]
        distances[1, self._rates] = self._upper[k] - q[k]
        return distances / self._mechanism.rate_scale

    def _names(self, chosen: Flags) -> str:
        """Names of the rates that are chosen, in words."""
        return ", ".join(np.array(self._mechanism.space.rate_names)[chosen])
