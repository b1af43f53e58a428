# SPDX-License-Identifier: BSD-2-Clause
"""Limits of joints in Newton's method on the closures."""

import numpy as np

from ..arrays import Array, Flags, Indices
from ..errors import ClosureError
from ..model.mechanism import Mechanism

#: Joints at a smaller distance from a limit are at the limit, [rad] or lengths of the loop.
_AT_LIMIT = 1e-12


class JointLimits:
    """Limits of all joints of one coordinate, of which only the rates `free` may move."""

    def __init__(self, mechanism: Mechanism, free: Indices) -> None:
        model = mechanism.model
        self._mechanism = mechanism
        single = [(j.idx_q, j.idx_v) for j in list(model.joints)[1:] if (j.nq, j.nv) == (1, 1)]
        #: Indices of these joints in q and in v.
        self._q = np.array([k for k, _ in single], dtype=np.intp)
        self._v = np.array([k for _, k in single], dtype=np.intp)
        self._free = self._q[np.isin(self._v, free)]
        self._lower, self._upper = model.lowerPositionLimit, model.upperPositionLimit

    def clipped(self, q: Array) -> Array:
        """The nearest configuration within the limits."""
        q, k = q.copy(), self._free
        q[k] = np.clip(q[k], self._lower[k], self._upper[k])
        return q

    def allowed(self, q: Array, rates: Indices, step: Array) -> Flags:
        """Which of the rates do not step beyond a limit that their joint is at."""
        return self._room_ahead(q, rates, step) > _AT_LIMIT

    def reach(self, q: Array, rates: Indices, step: Array) -> float:
        """The part of a step of these rates that reaches the first limit, at most 1."""
        moving = step != 0
        room = self._room_ahead(q, rates, step)[moving]
        return float((room / np.abs(step[moving])).min(initial=1.0))

    def require_within(self, q: Array) -> None:
        """Raise an error for joints outside their limits, and for empty ranges.

        `clipped` has moved the joints that are free, so only fixed joints can be outside.
        """
        room = self._room(q).min(axis=0)
        if (room < 0).any():
            raise ClosureError(
                f"fixed outside their limits, or with empty ranges: {self._names(room < 0)}; fix "
                "fewer joints, start within the limits, or correct the limits",
                float(-(room * self._mechanism.rate_scale).min()),
            )

    def reached(self, q: Array) -> str:
        """Which joints are at their limits, in words."""
        at_limit = self._room(q).min(axis=0) <= _AT_LIMIT
        return f" within the joint limits ({self._names(at_limit) or 'none'} at a limit)"

    def _room_ahead(self, q: Array, rates: Indices, step: Array) -> Array:
        """Distances to the limits that a step of these rates leads to; zero counts as upwards."""
        down, up = self._room(q)[:, rates]
        return np.where(step < 0, down, up)

    def _room(self, q: Array) -> Array:
        """Distances to the lower and to the upper limits, [rad] or lengths, shape (2, nv)."""
        room = np.full((2, self._mechanism.model.nv), np.inf)
        k = self._q
        room[0, self._v] = q[k] - self._lower[k]
        room[1, self._v] = self._upper[k] - q[k]
        return room / self._mechanism.rate_scale

    def _names(self, chosen: Flags) -> str:
        return ", ".join(np.array(self._mechanism.space.rate_names)[chosen])
