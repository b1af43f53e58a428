# SPDX-License-Identifier: BSD-2-Clause
"""Torques and loads of a simulation, in all forms that a user can give.

Each form is an `Input`: its value at one time, and its values along samples of a motion.
`torque_input` and `load_input` make inputs from the arguments of `simulate`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable, Mapping
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, single_array
from ..engine import Engine
from ..engine_arguments import Wrenches
from ..errors import InputError
from ..model.mechanism import Mechanism
from .sampled_torques import (
    SampledTorque,
    Sampling,
    TorqueSource,
    require_distinct,
    torque_function,
)
from .samples import spline
from .trajectories import Trajectory, require_motion

#: Motor torques: a function of (t, q, va), a constant of shape (motors,), samples of shape
#: (N, motors) at the times of the simulation, a motion with its torques, a `SampledTorque`, or a
#: controller.
Torque = (
    Callable[[float, Array, Array], ArrayLike]
    | ArrayLike
    | Trajectory
    | SampledTorque
    | TorqueSource
)
#: A moment on the platform: a function of (t, q, va), a constant, or none.
ExternalLoad = Callable[[float, Array, Array], ArrayLike] | ArrayLike | None
#: Wrenches on bodies or at frames: a function of (t, q, va), a constant, or none.
WrenchLoad = Callable[[float, Array, Array], Wrenches] | Wrenches | None
#: Computes q and the rates va of the robot's coordinates at a state of the integrator. This closes
#: the loops, which takes long, so that an input calls it only if it needs the state.
RobotState = Callable[[], tuple[Array, Array]]

#: A subset of samples is enough if its spline differs from the other samples by at most this part
#: of the largest torque.
_SMOOTH = 1e-3
#: A set of so many samples, or fewer, is not thinned out any more.
_FEW_SAMPLES = 12


class Input(ABC):
    """A torque or load that acts on a robot in motion.

    Attributes:
        sampling: Calls the function of a `SampledTorque` when a period begins, and has the torques
            that act; None for other inputs. The integration stops at its changes.
        times: Times, shape (N,), [s], or None. A step of the integrator that passes two of them may
            miss a change of the input.
        is_function: Whether it is a function of the user, which can change at any time.
    """

    sampling: Sampling | None = None
    times: Array | None = None
    is_function: bool = False

    @abstractmethod
    def at(self, t: float, state: RobotState) -> Array:
        """Its value at one time: torques, shape (motors,), or wrenches on the bodies, (r, 6)."""

    @abstractmethod
    def along(self, t: Array, q: Array, va: Array) -> Array:
        """Its values at N times, shape (N, ...), for q (N, nq) and va (N, n)."""


class ConstantInput(Input):
    """A torque or load that does not change."""

    def __init__(self, value: Array) -> None:
        self._value = value

    def at(self, t: float, state: RobotState) -> Array:
        """The constant."""
        return self._value

    def along(self, t: Array, q: Array, va: Array) -> Array:
        """The constant at all times."""
        return np.broadcast_to(self._value, (len(t), *self._value.shape))


class FunctionInput(Input):
    """A function (t, q, va) of the user; errors call it by its argument's name."""

    is_function = True

    def __init__(
        self,
        name: str,
        function: Callable[[float, Array, Array], ArrayLike],
        shape: tuple[int, ...],
        times: Array | None,
    ) -> None:
        self._name = f"{name}(t, q, va)"
        self._function = function
        self._shape = shape
        self.times = times

    def _call(self, t: float, q: Array, va: Array) -> Array:
        result = self._function(t, q.copy(), va.copy())  # the function may change its arguments
        return single_array(self._name, result, self._shape)

    def at(self, t: float, state: RobotState) -> Array:
        """The result of one call."""
        q, va = state()
        return self._call(t, q, va)

    def along(self, t: Array, q: Array, va: Array) -> Array:
        """The results of a call for each sample."""
        return np.array([self._call(*sample) for sample in zip(t, q, va, strict=True)])


def _times_of_changes(times: Array, torques: Array) -> Array:
    """Times of the coarsest regular subset of samples whose spline reproduces all of them.

    A step that passes fewer than two of these times misses no change of the torques.
    """
    largest_error = _SMOOTH * np.abs(torques).max(initial=0.0)
    chosen = times
    while len(chosen) > _FEW_SAMPLES:
        fewer = np.append(chosen[:-1:2], chosen[-1])  # every second time, and the last one
        curve = spline(fewer, torques[np.searchsorted(times, fewer)])
        if np.abs(curve(times) - torques).max() > largest_error:
            break
        chosen = fewer
    return chosen


class SplineInput(Input):
    """Torques between samples at times (N,), shape (N, motors), by a spline of degree five."""

    def __init__(self, times: Array, torques: Array) -> None:
        self._spline = spline(times, torques)
        # Between two knots the spline is a polynomial. For one time, the polynomial is evaluated in
        # a sixth of the time that a call of SciPy's spline takes. Piece k begins at the knot
        # starts[k]. By Taylor's formula, the coefficient of (t - starts[k])^j is the derivative j
        # at the knot over j!; pieces[k] has these coefficients, shape (degree + 1, motors).
        starts = np.unique(self._spline.t)[:-1]
        degree = self._spline.k
        coefficients = [self._spline(starts, j) / factorial(j) for j in range(degree + 1)]
        self._starts = starts.tolist()
        self._pieces = list(np.stack(coefficients, axis=1))
        self._powers = np.arange(degree + 1.0)
        self.times = _times_of_changes(times, torques)

    def at(self, t: float, state: RobotState) -> Array:
        """The torques at one time, by the polynomial between two knots."""
        # An integrator may ask for a time before the first knot, by rounding: piece 0 is taken.
        k = max(bisect_right(self._starts, t) - 1, 0)
        return np.asarray(((t - self._starts[k]) ** self._powers).dot(self._pieces[k]))

    def along(self, t: Array, q: Array, va: Array) -> Array:
        """The torques at all times, by the spline."""
        return np.asarray(self._spline(t))


class SampledInput(Input):
    """The torques of a `SampledTorque`, which the integration calls when it is due."""

    def __init__(self, sampling: Sampling) -> None:
        self._sampling = sampling
        self.sampling = sampling

    def at(self, t: float, state: RobotState) -> Array:
        """The torques that act now."""
        return self._sampling.now

    def along(self, t: Array, q: Array, va: Array) -> Array:
        """The torques that act now. They are constant within a step, and so at all times `t`."""
        now = self._sampling.now
        return np.broadcast_to(now, (len(t), *now.shape))


def torque_input(mechanism: Mechanism, torque: Torque, times: Array, *, by_spacing: bool) -> Input:
    """The motor torques of a simulation with these output times.

    Args:
        mechanism: The mechanism.
        torque: The torques, in one of the forms of `Torque`.
        times: The output times, shape (N,), [s].
        by_spacing: Whether a torque that is a function limits the steps of the integrator to the
            spacing of `times`. It has no effect on torques of other forms.
    """
    motors = len(mechanism.motor_names)
    if isinstance(torque, Trajectory):
        return _torques_of_motion(mechanism, torque, times)
    if isinstance(torque, SampledTorque):
        require_distinct(torque.period, times)
        return SampledInput(Sampling(torque, float(times[0]), motors))
    # In place of a controller, its method `torque`; any other torque as it is.
    function_or_values: Any = torque_function(torque)
    # A user can also give the method, `controller.torque`. In Python, `__self__` of a method is its
    # object; functions and arrays have none.
    controller = getattr(function_or_values, "__self__", None)
    if getattr(controller, "sampled_only", False):
        problem = f"{type(controller).__name__} depends on the calls before, so it is sampled only"
        raise InputError("torque", f"{problem}; pass SampledTorque(controller, period)")
    if callable(function_or_values):
        step_times = times if by_spacing else None
        return FunctionInput("torque", function_or_values, (motors,), step_times)
    if as_array("torque", function_or_values, ()).ndim == 2:
        samples = single_array("torque", function_or_values, (len(times), motors))
        return SplineInput(times, samples)
    return ConstantInput(single_array("torque", function_or_values, (motors,)))


def _torques_of_motion(mechanism: Mechanism, motion: Trajectory, times: Array) -> Input:
    """The torques of a motion, which must contain all times of the simulation."""
    require_motion(motion, mechanism, "torque")
    if times[0] < motion.t[0] or times[-1] > motion.t[-1]:
        raise InputError(
            "torque",
            f"has samples from {motion.t[0]:g} to {motion.t[-1]:g} s, "
            f"but the simulation is from {times[0]:g} to {times[-1]:g} s",
        )
    return SplineInput(motion.t, motion.tau)


def load_input(
    engine: Engine,
    platform_moment: ExternalLoad,
    external_wrenches: WrenchLoad,
    times: Array,
    *,
    by_spacing: bool,
) -> Input | None:
    """Both loads as wrenches on all bodies, shape (r, 6); None without a load.

    `by_spacing` is the same as in `torque_input`.
    """
    shape = engine.mechanism.model.njoints - 1, 6
    # Wrenches at frames are a mapping. Their moments about the mass centres change with q.
    depends_on_q = isinstance(external_wrenches, Mapping)
    if callable(platform_moment) or callable(external_wrenches) or depends_on_q:
        load = _load_function(engine, platform_moment, external_wrenches)
        step_times = times if by_spacing else None
        return FunctionInput("external_wrenches", load, shape, step_times)
    constant = engine.arguments.wrenches(platform_moment, external_wrenches, "raise")
    if constant is None:
        return None
    return ConstantInput(single_array("external_wrenches", constant, shape))


def _load_function(
    engine: Engine, platform_moment: ExternalLoad, external_wrenches: WrenchLoad
) -> Callable[[float, Array, Array], Any]:
    """Both loads as one function of (t, q, va) with values of shape (r, 6)."""

    def load(t: float, q: Array, va: Array) -> Any:
        moment: ArrayLike | None
        if callable(platform_moment):
            moment = platform_moment(t, q, va)
            if moment is None:
                raise InputError("platform_moment(t, q, va)", "None: three numbers are needed")
        else:
            moment = platform_moment
        wrenches: Wrenches | None
        if callable(external_wrenches):
            wrenches = external_wrenches(t, q, va)
            if wrenches is None:
                raise InputError("external_wrenches(t, q, va)", "None: wrenches are needed")
        else:
            wrenches = external_wrenches
        if moment is None and not isinstance(wrenches, Mapping):
            return wrenches  # `FunctionInput` checks it as one sample
        return engine.arguments.wrenches(moment, wrenches, "raise", q)

    return load
