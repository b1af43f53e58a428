# SPDX-License-Identifier: BSD-2-Clause
"""Torques of a digital controller: sampled, delayed and constant between samples."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import floor
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, positive_number, single_array
from ..errors import InputError

#: Times that differ by less than this part of a period are equal.
_SAME = 1e-3


class TorqueSource(Protocol):
    """A controller: an object with a torque function."""

    def torque(self, t: float, q: Array, va: Array) -> ArrayLike:
        """Torques of the motors, shape (motors,)."""


def torque_function(source: Any) -> Any:
    """The torque function of a controller; other values as they are."""
    method = getattr(source, "torque", None)
    return method if callable(method) else source


class SampledTorque:
    """A torque function that is called once in each period, with a delay until its torques act.

    The torques act until the next ones do; before the first ones they are zero. `simulate` starts a
    new integration where the torques change. It calls the function in the order of time, so that
    the function may have a state, as a controller that learns.

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
        # Of `torque`: its calls so far, and the time of the last one.
        self._sampling: Sampling | None = None
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
    """Refuse a period that is not larger than the rounding of times."""
    least = 4 / _SAME * float(np.spacing(np.abs(times).max()))
    if not period > least:
        raise InputError("period", f"{period:g} s; at these times at least {least:.2g} s")


class Sampling:
    """The torques of a `SampledTorque` from a start time.

    The function is called at start + k period, k = 0, 1, ...; the torques of a call act after the
    delay, until those of the next call do.

    Attributes:
        now: The torques that act, shape (motors,).
    """

    def __init__(self, torque: SampledTorque, start: float, motors: int | None = None) -> None:
        self._torque = torque
        self._start = start
        #: The next k.
        self._next_period = 0
        #: Torques that will act, with the times from which they do, in the order of these times.
        self._waiting = deque[tuple[float, Array]]()
        self._motors = motors
        self.now = np.zeros(motors or 0)

    def next_change(self, times: Array) -> float:
        """When the torques change or the function is called next, [s].

        It is one of the output `times` if one is so near that only rounding can be between them,
        because periods are much longer than the rounding of times (`require_distinct`). It is after
        the last call of `go_on`, which has done all that is due within `_SAME` periods.
        """
        period = self._torque.period
        due = self._start + self._next_period * period
        if self._waiting:
            due = min(due, self._waiting[0][0])
        nearest = float(times[np.abs(times - due).argmin()])
        return nearest if abs(nearest - due) < _SAME / 2 * period else due

    def go_on(self, t: float, state: Callable[[], tuple[Array, Array]]) -> None:
        """Call the function and change the torques if this is due; `state` computes q and va."""
        period = self._torque.period
        present_period = floor((t - self._start) / period + _SAME)
        if present_period >= self._next_period:
            q, va = state()
            act_from = self._start + present_period * period + self._torque.delay
            self._waiting.append((act_from, self._call(t, q, va)))
            self._next_period = present_period + 1  # a late loop skips periods
        while self._waiting and self._waiting[0][0] <= t + _SAME * period:
            _, self.now = self._waiting.popleft()

    def _call(self, t: float, q: Array, va: Array) -> Array:
        """Torques of one call; the first call says how many motors there are."""
        name = "torque(t, q, va)"
        # Any shape is finite here; the shape is checked below.
        tau = finite_array(name, self._torque.function(t, q.copy(), va.copy()), ())
        if self._motors is None:
            if tau.ndim != 1:
                raise InputError(name, f"shape {tau.shape}, expected (motors,)")
            self._motors = len(tau)
            self.now = np.zeros(len(tau))
        return single_array(name, tau, (self._motors,)).copy()
