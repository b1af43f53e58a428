# SPDX-License-Identifier: BSD-2-Clause
"""Torques of a digital controller: sampled, delayed and constant between samples.

`SampledTorque` is what a user makes; `Sampling` calls its function along one motion.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import floor
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, positive_number, single_array
from ..errors import InputError

#: Times count as equal if they differ by less than this part of a period, as by rounding.
_SAME = 1e-3


class TorqueSource(Protocol):
    """A controller: an object with a torque function."""

    def torque(self, t: float, q: Array, va: Array) -> ArrayLike:
        """Torques of the motors, shape (motors,)."""


def torque_function(source: Any) -> Any:
    """The method `torque` of a controller; any other value is returned as it is."""
    method = getattr(source, "torque", None)
    return method if callable(method) else source


class SampledTorque:
    """A torque function that is called once in each period, with a delay until its torques act.

    The torques of a call act until those of the next call act; before the first ones, the torques
    are zero. `simulate` starts a new integration where the torques change. It calls the function in
    the order of time, so that the function may have a state, as a controller that learns.

    Args:
        function: (t, q, va) -> torques, shape (motors,), or a controller.
        period: Time between two calls, [s].
        delay: Time from a call until its torques act, [s]; it may be longer than a period.

    Raises:
        InputError: For a period that is not positive, or a negative delay.

    Example:
        >>> torque = sst_pin.SampledTorque(lambda t, q, va: [0.2 - va[0]], 0.01, delay=0.004)
        >>> motion = chain.simulate(torque, chain.home, [0.5], [0, 0.002, 0.005, 0.02])
        >>> motion.tau[:, 0].round(3)
        array([ 0.   ,  0.   , -0.3  ,  0.386])
    """

    #: `torque` depends on the calls before, so an integrator cannot call it at will.
    sampled_only = True

    def __init__(
        self,
        function: Callable[[float, Array, Array], ArrayLike] | TorqueSource,
        period: float,
        *,
        delay: float = 0.0,
    ) -> None:
        calls = torque_function(function)
        if not callable(calls):
            raise InputError("function", f"{function!r} cannot be called")
        self.function = calls
        self.period = positive_number("period", period)
        self.delay = positive_number("delay", delay, or_zero=True)
        #: Calls the function for the method `torque`, from the first call of this method on.
        self._sampling: Sampling | None = None
        #: Time of the last call of the method `torque`, [s].
        self._last = -np.inf

    def torque(self, t: float, q: Array, va: Array) -> Array:
        """Torques that act at a time, shape (motors,), for control loops of your own.

        Args:
            t: Time, [s], not less than in the last call; the first call begins the first period.
            q: Configuration, shape (nq,).
            va: Rates of the coordinates, shape (n,).

        Raises:
            InputError: If time decreases, or the function returns numbers that are not finite.
        """
        t = float(single_array("t", t, ()))
        if self._sampling is None:
            self._sampling = Sampling(self, t)
        if t < self._last:
            problem = f"{t:g} s after {self._last:g} s; make a new SampledTorque for a new motion"
            raise InputError("t", problem)
        self._last = t
        self._sampling.go_on(t, lambda: (q, va))
        return self._sampling.now.copy()  # the caller may change it


def require_distinct(period: float, times: Array) -> None:
    """Refuse a period in which times that should be equal can differ by more than `_SAME` periods.

    Equal times may differ by a few roundings: four are allowed for.
    """
    least = 4 / _SAME * float(np.spacing(np.abs(times).max()))
    if not period > least:
        raise InputError("period", f"{period:g} s; at these times at least {least:.2g} s")


class Sampling:
    """The torques of a `SampledTorque` along one motion.

    The function is called at start + k period, k = 0, 1, ... The torques of a call act after the
    delay, until those of the next call act.

    Attributes:
        now: The torques that act, shape (motors,).
    """

    def __init__(self, torque: SampledTorque, start: float, motors: int | None = None) -> None:
        self._torque = torque
        self._start = start
        #: The number k of the next call.
        self._next_period = 0
        #: Torques that do not act yet: pairs of the time from which they act and the torques.
        self._waiting = deque[tuple[float, Array]]()
        #: Number of motors; None until the first call has shown it.
        self._motors = motors
        self.now = np.zeros(motors or 0)

    def next_change(self, times: Array) -> float:
        """When the function is called next, or the torques change, [s]; the earlier of both.

        If an output time, one of `times`, differs from this time by rounding only, the output time
        is returned, so that the simulation does not make a tiny step between them.

        The result is later than the time of the last call of `go_on`. This call has done all that
        is due up to `_SAME` periods later, and the output time is at most half of that earlier than
        the next change.
        """
        period = self._torque.period
        change = self._start + self._next_period * period
        if self._waiting:
            first_to_act, _ = self._waiting[0]
            change = min(change, first_to_act)
        nearest = float(times[np.abs(times - change).argmin()])
        is_same = abs(nearest - change) < _SAME / 2 * period
        return nearest if is_same else change

    def go_on(self, t: float, state: Callable[[], tuple[Array, Array]]) -> None:
        """Go on to a time: call the function if a period has begun, and change the torques.

        `state` computes q and va.
        """
        period = self._torque.period
        present_period = floor((t - self._start) / period + _SAME)
        if present_period >= self._next_period:
            q, va = state()
            act_from = self._start + present_period * period + self._torque.delay
            self._waiting.append((act_from, self._call(t, q, va)))
            self._next_period = present_period + 1  # a control loop that is late skips periods
        while self._waiting and self._waiting[0][0] <= t + _SAME * period:
            _, self.now = self._waiting.popleft()

    def _call(self, t: float, q: Array, va: Array) -> Array:
        """Torques of one call, shape (motors,).

        If the number of motors is not known, the first call shows it.
        """
        name = "torque(t, q, va)"
        tau = finite_array(name, self._torque.function(t, q.copy(), va.copy()), ())  # any shape
        if self._motors is None:
            if tau.ndim != 1:
                raise InputError(name, f"shape {tau.shape}, expected (motors,)")
            self._motors = len(tau)
            self.now = np.zeros(len(tau))
        return single_array(name, tau, (self._motors,)).copy()
