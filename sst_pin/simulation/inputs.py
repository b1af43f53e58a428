# SPDX-License-Identifier: BSD-2-Clause
"""Arguments of a simulation: settings, and torques and loads in all their forms."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import factorial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, positive_number, single_array
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
#: Wrenches on bodies or at frames: likewise.
WrenchLoad = Callable[[float, Array, Array], Wrenches] | Wrenches | None

#: Integrators of SciPy.
IMPLICIT = ("Radau", "BDF")
_METHODS = ("RK23", "RK45", "DOP853", *IMPLICIT)
#: A spline through fewer samples suffices if its error is at most this part of the largest torque.
_SMOOTH = 1e-3


@dataclass(frozen=True)
class Settings:
    """How a motion is integrated; `ClosedChain.simulate` describes the fields."""

    method: str
    rtol: float
    atol: float
    max_condition_number: float
    through_singularities: bool
    progress: Callable[[float], None] | None
    max_step: float | None

    def __post_init__(self) -> None:
        if self.method not in _METHODS:
            problem = f"{self.method!r} unknown; known: {', '.join(_METHODS)}"
            raise InputError("method", problem)
        positive_number("rtol", self.rtol)
        positive_number("atol", self.atol)
        positive_number("max_condition_number", self.max_condition_number)
        step = self.max_step
        if not (step is None or (isinstance(step, float) and step == np.inf)):
            positive_number("max_step", step)
        if self.progress is not None and not callable(self.progress):
            raise InputError("progress", f"{self.progress!r} cannot be called")


class Input(NamedTuple):
    """A torque or load that acts on a robot in motion."""

    #: Its value at a time; the second argument computes q and va.
    at: Callable[[float, Callable[[], tuple[Array, Array]]], Array]
    #: Its values at times (N,), for q (N, nq) and va (N, n).
    along: Callable[[Array, Array, Array], Array]
    #: The state of a `SampledTorque`; None for other inputs.
    sampling: Sampling | None = None
    #: Times, shape (N,); a step that passes two of them may miss a change.
    times: Array | None = None
    #: Whether it is a function.
    callable: bool = False


def torque_input(mechanism: Mechanism, torque: Torque, times: Array, *, watch: bool) -> Input:
    """The motor torques; with `watch`, for a function, no integrator step passes two of `times`."""
    motors = len(mechanism.motor_names)
    if isinstance(torque, Trajectory):
        require_motion(torque, mechanism, "torque")
        if times[0] < torque.t[0] or times[-1] > torque.t[-1]:
            raise InputError(
                "torque",
                f"has samples from {torque.t[0]:g} to {torque.t[-1]:g} s, "
                f"but the simulation is from {times[0]:g} to {times[-1]:g} s",
            )
        return _samples(torque.t, torque.tau)
    if isinstance(torque, SampledTorque):
        require_distinct(torque.period, times)
        sampling = Sampling(torque, float(times[0]), motors)
        return Input(
            lambda t, state: sampling.now,
            lambda t, q, va: np.broadcast_to(sampling.now, (len(t), motors)),
            sampling,
        )
    values: Any = torque_function(torque)
    source = getattr(values, "__self__", None)
    if getattr(source, "sampled_only", False):
        name = type(source).__name__
        problem = f"{name} depends on the calls before, so it is sampled only"
        raise InputError("torque", f"{problem}; pass SampledTorque(controller, period)")
    if not callable(values) and as_array("torque", values, ()).ndim == 2:
        return _samples(times, single_array("torque", values, (len(times), motors)))
    return _function_or_constant("torque", values, (motors,), times if watch else None)


def load_input(
    engine: Engine,
    platform_moment: ExternalLoad,
    external_wrenches: WrenchLoad,
    times: Array,
    *,
    watch: bool,
) -> Input | None:
    """Both loads as wrenches on all bodies; None without a load."""
    wrenches = _wrenches(engine, platform_moment, external_wrenches)
    if wrenches is None:
        return None
    shape = engine.mechanism.model.njoints - 1, 6
    return _function_or_constant("external_wrenches", wrenches, shape, times if watch else None)


def _wrenches(
    engine: Engine, platform_moment: ExternalLoad, external_wrenches: WrenchLoad
) -> ExternalLoad:
    at_frames = isinstance(external_wrenches, Mapping)
    if not (callable(platform_moment) or callable(external_wrenches) or at_frames):
        return engine.arguments.wrenches(platform_moment, external_wrenches, "raise")

    def wrenches(t: float, q: Array, va: Array) -> Any:
        moment = platform_moment(t, q, va) if callable(platform_moment) else platform_moment
        others = external_wrenches
        if callable(others):
            others = others(t, q, va)
        if moment is None and platform_moment is not None:
            raise InputError("platform_moment(t, q, va)", "None: three numbers are needed")
        if moment is None and not isinstance(others, Mapping):
            return others  # checked as one sample
        return engine.arguments.wrenches(moment, others, "raise", q)

    return wrenches


def _function_or_constant(
    name: str,
    value: Callable[[float, Array, Array], ArrayLike] | ArrayLike,
    shape: tuple[int, ...],
    times: Array | None,
) -> Input:
    if callable(value):

        def one(t: float, q: Array, va: Array) -> Array:
            result = value(t, q.copy(), va.copy())  # the function may change its arguments
            return single_array(f"{name}(t, q, va)", result, shape)

        return Input(
            lambda t, state: one(t, *state()),
            lambda t, q, va: np.array(list(map(one, t, q, va))),
            times=times,
            callable=True,
        )
    constant = single_array(name, value, shape)
    return Input(
        lambda t, state: constant, lambda t, q, va: np.broadcast_to(constant, (len(t), *shape))
    )


def _samples(times: Array, torques: Array) -> Input:
    """A spline; single times use its polynomials, at a sixth of the cost of calling it."""
    smooth = spline(times, torques)
    starts = np.unique(smooth.t)[:-1]
    taylor = [smooth(starts, j) / factorial(j) for j in range(smooth.k + 1)]
    pieces = list(zip(starts.tolist(), np.stack(taylor, axis=1), strict=True))
    inner, powers = starts[1:].tolist(), np.arange(smooth.k + 1.0)

    def at(t: float, state: Callable[[], tuple[Array, Array]]) -> Array:
        start, coefficients = pieces[bisect_right(inner, t)]
        return ((t - start) ** powers).dot(coefficients)

    changes = _changes(times, torques)
    return Input(at, lambda t, q, va: np.asarray(smooth(t)), times=changes)


def _changes(times: Array, torques: Array) -> Array:
    """Times of few evenly chosen samples through which a spline reproduces all samples.

    A step that passes fewer than two of these times misses no change of the torques.
    """
    scale, chosen = _SMOOTH * np.abs(torques).max(initial=0.0), times
    while len(chosen) > 12:
        fewer = np.append(chosen[:-1:2], chosen[-1])
        curve = spline(fewer, torques[np.searchsorted(times, fewer)])
        if np.abs(curve(times) - torques).max() > scale:
            break
        chosen = fewer
    return chosen
