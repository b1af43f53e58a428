# SPDX-License-Identifier: BSD-2-Clause
"""Direct dynamics in time: Eqs. (7) and (92) as a state space in q and va (Sect. 6.2).

The rates va are those of independent joints, which are chosen again where they get bad.
"""

from __future__ import annotations

import warnings
from bisect import bisect_right
from collections.abc import Callable
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, positive_number, single_array
from ..dynamics.quantities import Quantity
from ..engine import Engine
from ..errors import InputError, SingularityWarning
from ..model.closures import Rolling
from .integration import Input, Motion, Run
from .moving_robot import require_motion
from .sampled_torques import SampledTorque, Sampling, require_distinct
from .samples import sample_times, spline
from .trajectories import Trajectory, trajectory_of

#: Motor torques: a function of (t, q, va), a constant of shape (motors,), samples of shape
#: (N, motors) at the times of the simulation, the torques of a motion, or sampled ones.
Torque = Callable[[float, Array, Array], ArrayLike] | ArrayLike | Trajectory | SampledTorque
#: Loads: a function of (t, q, va), a constant, or none.
Load = Callable[[float, Array, Array], ArrayLike] | ArrayLike | None

#: Torques are smooth between samples if a curve through these misses the others by this part.
_SMOOTH = 1e-3
_IMPLICIT = ("Radau", "BDF")
_METHODS = ("RK23", "RK45", "DOP853", *_IMPLICIT)


def simulate(
    engine: Engine,
    torque: Torque,
    q0: ArrayLike,
    va0: ArrayLike,
    t: ArrayLike,
    *,
    platform_moment: Load,
    external_wrenches: Load,
    method: str,
    rtol: float,
    atol: float,
    max_condition_number: float,
    through_singularities: bool,
    sign_width: float,
    progress: Callable[[float], None] | None,
    max_step: float | None,
) -> Trajectory:
    """The motion that `ClosedChain.simulate` returns, for the same arguments."""
    if method not in _METHODS:
        raise InputError("method", f"{method!r} unknown; known: {', '.join(_METHODS)}")
    positive_number("rtol", rtol)
    positive_number("atol", atol)
    positive_number("max_condition_number", max_condition_number)
    positive_number("sign_width", sign_width, or_zero=True)  # 0 is the sign itself
    if not (max_step is None or (isinstance(max_step, float) and max_step == np.inf)):
        positive_number("max_step", max_step)
    if progress is not None and not callable(progress):
        raise InputError("progress", f"{progress!r} cannot be called")
    times, mechanism = sample_times(t, 2), engine.mechanism
    if isinstance(torque, Trajectory):
        require_motion(torque, mechanism, "torque")
    if isinstance(torque, SampledTorque) and through_singularities:
        raise InputError("through_singularities", "not with sampled torques, which are not smooth")
    # A bad start fails by its own name.
    n, motors = len(mechanism.coordinates), len(mechanism.motor_names)
    q0 = single_array("q0", q0, (mechanism.model.nq,))
    states = engine.states(sign_width)
    engine.compute(Quantity("rates"), q0, va=np.zeros(n))
    va0 = single_array("va0", va0, (n,))
    if not states.condition_number(q0) < max_condition_number:
        raise InputError("q0", f"closer to a singularity than {max_condition_number=:g}")
    wrenches = _wrenches(engine, platform_moment, external_wrenches)
    load, changes = None, times if max_step is None else None
    if wrenches is not None:
        shape = mechanism.model.njoints - 1, 6
        load = _called_or_constant("external_wrenches", wrenches, shape, changes)
    motion = Motion(states, _torque_of(torque, times, motors, changes), load)
    # A load that is a function, and wheels that roll, have more derivatives than the robot's.
    exact = (
        sign_width > 0
        and not callable(wrenches)
        and not any(isinstance(closure, Rolling) for closure in mechanism.closures)
    )
    options: dict[str, Any] = {"rtol": rtol, "atol": atol}
    if exact and method in _IMPLICIT:
        options["jac"] = motion.jacobian
    how = method, options, max_condition_number, progress, through_singularities
    run = Run(motion, mechanism, *how, max_step or np.inf)
    q, va, aa, tau = run.integrate(times, np.concatenate([q0, va0]))
    if run.stopped:
        warnings.warn(run.stopped, SingularityWarning, stacklevel=3)
    if run.missed:
        warnings.warn(run.missed, RuntimeWarning, stacklevel=3)
    return trajectory_of(mechanism, times[: len(q)], q, va, aa, tau, run.stopped, run.crossings)


def _wrenches(engine: Engine, platform_moment: Load, external_wrenches: Load) -> Load:
    """Both loads as wrenches on all bodies, a constant or a function of (t, q, va)."""
    if not (callable(platform_moment) or callable(external_wrenches)):
        return engine.wrenches(platform_moment, external_wrenches, "raise")
    if platform_moment is None:
        return external_wrenches

    def wrenches(t: float, q: Array, va: Array) -> Array:
        loads = (platform_moment, external_wrenches)
        moment, others = (x(t, q, va) if callable(x) else x for x in loads)
        if moment is None:
            raise InputError("platform_moment(t, q, va)", "None: three numbers are needed")
        return np.asarray(engine.wrenches(moment, others, "raise"))

    return wrenches


def _torque_of(torque: Torque, times: Array, motors: int, changes: Array | None) -> Input:
    if isinstance(torque, Trajectory):
        if times[0] < torque.t[0] or times[-1] > torque.t[-1]:
            raise InputError(
                "torque",
                f"has samples from {torque.t[0]:g} to {torque.t[-1]:g} s, "
                f"but the simulation is from {times[0]:g} to {times[-1]:g} s",
            )
        return _sampled(torque.t, torque.tau)
    if isinstance(torque, SampledTorque):
        require_distinct(torque.period, times)
        held = Sampling(torque, float(times[0]), motors)
        return Input(
            lambda t, where: held.now,
            lambda t, q, va: np.broadcast_to(held.now, (len(t), motors)),
            held,
        )
    if not callable(torque) and as_array("torque", torque, ()).ndim == 2:
        return _sampled(times, single_array("torque", torque, (len(times), motors)))
    return _called_or_constant("torque", torque, (motors,), changes)


def _called_or_constant(
    name: str,
    value: Callable[[float, Array, Array], ArrayLike] | ArrayLike,
    shape: tuple[int, ...],
    changes: Array | None,
) -> Input:
    """A constant, or a function of (t, q, va) whose changes are looked for at these times."""
    if callable(value):

        def one(t: float, q: Array, va: Array) -> Array:
            given = value(t, q.copy(), va.copy())  # which a function may change
            return single_array(f"{name}(t, q, va)", given, shape)

        return Input(
            lambda t, where: one(t, *where()),
            lambda t, q, va: np.array(list(map(one, t, q, va))),
            times=changes,
            varies=True,
        )
    constant = single_array(name, value, shape)
    return Input(
        lambda t, where: constant, lambda t, q, va: np.broadcast_to(constant, (len(t), *shape))
    )


def _sampled(times: Array, torques: Array) -> Input:
    """A spline; for single times as pieces of polynomials, at a sixth of the cost of calling it."""
    smooth = spline(times, torques)
    starts = np.unique(smooth.t)[:-1]
    taylor = [smooth(starts, j) / factorial(j) for j in range(smooth.k + 1)]
    pieces = list(zip(starts.tolist(), np.stack(taylor, axis=1), strict=True))
    inner, powers = starts[1:].tolist(), np.arange(smooth.k + 1.0)

    def at(t: float, where: Callable[[], tuple[Array, Array]]) -> Array:
        start, coefficients = pieces[bisect_right(inner, t)]
        return ((t - start) ** powers).dot(coefficients)

    return Input(
        at, lambda t, q, va: np.asarray(smooth(t)), times=_changes(times, torques), varies=True
    )


def _changes(times: Array, torques: Array) -> Array:
    """The fewest samples, evenly chosen, through which a curve reproduces all of them.

    A step that passes no two of them misses no push. Smooth torques need few.
    """
    scale, chosen = _SMOOTH * np.abs(torques).max(initial=0.0), times
    while len(chosen) > 12:
        fewer = np.append(chosen[:-1:2], chosen[-1])
        curve = spline(fewer, torques[np.searchsorted(times, fewer)])
        if np.abs(curve(times) - torques).max() > scale:
            break
        chosen = fewer
    return chosen
