# SPDX-License-Identifier: BSD-2-Clause
"""Direct dynamics in time: Eqs. (7) and (92) as a state space in q and va (Sect. 6.2)."""

from __future__ import annotations

import warnings
from bisect import bisect_right
from collections.abc import Callable
from functools import cache
from math import factorial, isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import as_array, positive_number, single_array
from ..chain.closures import Rolling
from ..errors import InputError, SimulationError, SingularityWarning, SSTError
from .moving_robot import require_motion
from .samples import sample_times, spline
from .trajectories import Trajectory

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver
    from scipy.interpolate import BSpline

    from ..chain.backend import States
    from .moving_robot import Robot

Array = NDArray[np.float64]

#: Motor torques: a function of (t, q, va), a constant of shape (motors,), samples of shape
#: (N, motors) at the times of the simulation, or the torques of a motion.
Torque = Callable[[float, Array, Array], ArrayLike] | ArrayLike | Trajectory
#: Loads: a function of (t, q, va), a constant, or none.
Load = Callable[[float, Array, Array], ArrayLike] | ArrayLike | None

#: Steps of differences, relative or [rad], [m] and per second.
_DIFFERENCE = 1e-8
_IMPLICIT = ("Radau", "BDF", "LSODA")
_METHODS = ("RK23", "RK45", "DOP853", *_IMPLICIT)


def simulate(
    chain: Robot,
    torque: Torque,
    q0: ArrayLike,
    va0: ArrayLike,
    t: ArrayLike,
    *,
    external_wrenches: Load = None,
    method: str = "DOP853",
    rtol: float = 1e-12,
    atol: float = 1e-12,
    max_condition_number: float = 1e4,
    sign_width: float = 1e-3,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Simulate the motion of a closed chain for given torques.

    In each evaluation the dependent joints are computed from the coordinates by the closure
    constraints, so the loops stay closed.

    Args:
        chain: The robot.
        torque: A function (t, q, va) -> (motors,); a constant, shape (motors,); samples at t, shape
            (N, motors); or a `Trajectory` with its own times. Samples are interpolated by a smooth
            spline. For torques with jumps, pass a function.
        q0: Configuration at t[0], on the closures, shape (nq,).
        va0: Rates of the coordinates at t[0], shape (n,).
        t: Times of the output, increasing, shape (N,), N >= 2, [s].
        external_wrenches: A function (t, q, va) -> (r, 6), or a constant; see `ClosedChain`.
        method: Integrator of SciPy: RK23, RK45, DOP853, Radau, BDF or LSODA. The last three are for
            stiff motions and take the exact derivatives of the dynamics, unless sign_width is 0,
            external_wrenches is a function, or wheels roll.
        rtol: Relative tolerance of the integrator.
        atol: Absolute tolerance of the integrator, [rad], [rad/s].
        max_condition_number: The motion stops before a singularity, where the condition number of
            the dependent columns of Phi reaches this value.
        sign_width: Coulomb friction uses tanh(x / sign_width) instead of sign(x), [rad/s], because
            an integrator needs smooth forces. A joint that should stick moves slowly.
        progress: Function that is called with the time reached.

    Returns:
        The motion at the times reached. If these are not all times of t, `stopped` says why.

    Warns:
        SingularityWarning: If the motion stopped before a singularity.

    Raises:
        InputError: For a wrong shape, a number that is not finite, or torques that end too early.
        ClosureError: If q0 is open.
        SingularConfigurationError: If q0 is singular.
        SimulationError: If the integrator fails.
    """
    _require_options(method, rtol, atol, max_condition_number, sign_width)
    if progress is not None and not callable(progress):
        raise InputError("progress", f"{progress!r} cannot be called")
    times = sample_times(t, 2)
    if isinstance(torque, Trajectory):
        require_motion(torque, chain, "torque")
    # A bad start fails by its own name.
    q0 = single_array("q0", q0, (len(chain.position_names),))
    states = chain._states(sign_width)
    chain.joint_rates(q0, np.zeros(chain.degrees_of_freedom))
    va0 = single_array("va0", va0, (chain.degrees_of_freedom,))
    if not states.regular(q0, max_condition_number):
        raise InputError("q0", f"closer to a singularity than {max_condition_number=:g}")
    motion = _Motion(
        states,
        _torque_of(torque, times, states, len(chain.motor_names)),
        _load_of(external_wrenches, states, len(chain.joint_names)),
    )
    # A load that is a function, and wheels that roll, have more derivatives than the robot's.
    exact = (
        sign_width > 0
        and not callable(external_wrenches)
        and not any(isinstance(closure, Rolling) for closure in chain.mechanism.closures)
    )
    jacobian = {"jac": motion.jacobian} if exact and method in _IMPLICIT else {}
    run = _Run(motion, states, max_condition_number, progress)
    reached, samples, stopped = run.integrate(
        method, times, np.concatenate([q0, va0]), rtol=rtol, atol=atol, **jacobian
    )
    if stopped:
        warnings.warn(stopped, SingularityWarning, stacklevel=3)
    tau = motion.torque.along(reached, samples)
    load = None if motion.load is None else motion.load.along(reached, samples)
    return chain.trajectory(
        reached,
        states.closed(samples),
        samples[:, len(q0) :],
        states.rate(samples, tau, load)[:, len(q0) :],
        tau,
        stopped=stopped,
    )


def _require_options(
    method: str, rtol: float, atol: float, max_condition_number: float, sign_width: float
) -> None:
    if method not in _METHODS:
        raise InputError("method", f"{method!r} unknown; known: {', '.join(_METHODS)}")
    positive_number("rtol", rtol)
    positive_number("atol", atol)
    positive_number("max_condition_number", max_condition_number)
    positive_number("sign_width", sign_width, or_zero=True)  # 0 is the sign itself


class _Input(NamedTuple):
    """What acts on a robot in motion.

    Attributes:
        at: Its value at a time and a state.
        along: Its values at times (N,) and states (N, nq + n).
    """

    at: Callable[[float, Array], Array]
    along: Callable[[Array, Array], Array]


class _Motion:
    """Eqs. (7) and (92) as y' = f(t, y) with y = (q, va)."""

    def __init__(self, states: States, torque: _Input, load: _Input | None) -> None:
        self._states, self.torque, self.load = states, torque, load
        self.failure: SSTError | None = None
        self._last = np.zeros(())

    def rate(self, time: float, state: Array) -> Array:
        if not isfinite(state.dot(state)):
            return np.full_like(state, np.nan)
        try:
            load = None if self.load is None else self.load.at(time, state)
            return self._states.rate(state, self.torque.at(time, state), load)
        except InputError:
            raise  # the caller's torque is at fault
        except SSTError as error:
            # A trial step went too far; the integrator answers NaN with a shorter one.
            self.failure = error
            return np.full_like(state, np.nan)

    def jacobian(self, time: float, state: Array) -> Array:
        """Derivatives of the rate by the state; a callable torque's own ones by differences."""
        if not isfinite(state.dot(state)):
            return self._last
        try:
            tau = self.torque.at(time, state)
            load = None if self.load is None else self.load.at(time, state)
            by_state, by_tau = self._states.derivatives(state, tau, load)
            steps = _DIFFERENCE * np.maximum(1, np.abs(state))
            ahead = [self.torque.at(time, moved) for moved in state + np.diag(steps)]
            self._last = by_state + by_tau.dot(((ahead - tau) / steps[:, None]).T)
        except InputError:
            raise
        except SSTError as error:  # a trial state went too far: the last Jacobian serves there
            self.failure = error
        return self._last


class _Run:
    """One integration, step by step; it ends before a singularity."""

    def __init__(
        self,
        motion: _Motion,
        states: States,
        limit: float,
        progress: Callable[[float], None] | None,
    ) -> None:
        self._motion, self._states, self._limit = motion, states, limit
        self._progress = progress

    def integrate(
        self, method: str, times: Array, start: Array, **options: Any
    ) -> tuple[Array, Array, str]:
        """The times reached, the states at them, and why the motion stopped before the last."""
        from scipy import integrate

        if not np.isfinite(self._motion.rate(float(times[0]), start)).all():
            why = self._motion.failure or "its rates are not finite"
            raise SimulationError(f"the motion cannot start ({why})", float(times[0]))
        kind = getattr(integrate, method)
        solver = kind(self._motion.rate, times[0], start, times[-1], **options)
        samples, stopped = [start], ""
        if self._progress is not None:
            self._progress(float(times[0]))
        before = self._states.closed(start)
        while solver.status == "running" and not stopped:
            message = solver.step()
            if solver.status == "failed":
                why = self._motion.failure or message
                raise SimulationError(f"the integrator stopped ({why})", float(solver.t))
            if self._progress is not None:
                self._progress(float(solver.t))
            fraction, before = self._follow(solver, before)
            end = float(solver.t)
            if fraction < 1:
                end = float(solver.t_old + fraction * (solver.t - solver.t_old))
                stopped = (
                    f"stopped at t = {end:.9g} s before a singularity: "
                    f"condition number {self._limit:g}"
                )
            new = times[len(samples) :]
            new = new[new <= end]
            if len(new):
                samples.extend(solver.dense_output()(new).T)
        return times[: len(samples)], np.array(samples), stopped

    def _follow(self, solver: OdeSolver, before: Array) -> tuple[float, Array]:
        """How much of the last step is regular, and the configuration there."""
        start, length = solver.t_old, solver.t - solver.t_old
        course = cache(solver.dense_output)

        def way(q: Array, low: float, high: float) -> Array | None:
            try:
                state = solver.y if high == 1 else course()(start + high * length)
                return self._states.closed(state)
            except SSTError:
                return None

        return self._states.follow(before, way, self._limit)


def _torque_of(torque: Torque, times: Array, states: States, motors: int) -> _Input:
    if isinstance(torque, Trajectory):
        if times[0] < torque.t[0] or times[-1] > torque.t[-1]:
            raise InputError(
                "torque",
                f"has samples from {torque.t[0]:g} to {torque.t[-1]:g} s, "
                f"but the simulation is from {times[0]:g} to {times[-1]:g} s",
            )
        return _sampled(spline(torque.t, torque.tau))
    if not callable(torque) and as_array("torque", torque, ()).ndim == 2:
        return _sampled(spline(times, single_array("torque", torque, (len(times), motors))))
    return _called_or_constant("torque", torque, (motors,), states)


def _load_of(load: Load, states: States, bodies: int) -> _Input | None:
    if load is None:
        return None
    return _called_or_constant("external_wrenches", load, (bodies, 6), states)


def _called_or_constant(
    name: str,
    value: Callable[[float, Array, Array], ArrayLike] | ArrayLike,
    shape: tuple[int, ...],
    states: States,
) -> _Input:
    if callable(value):

        def at(t: float, state: Array) -> Array:
            q = states.closed(state)
            return single_array(f"{name}(t, q, va)", value(t, q, state[len(q) :]), shape)

        return _Input(at, lambda t, y: np.array([at(*x) for x in zip(t, y, strict=True)]))
    constant = single_array(name, value, shape)
    return _Input(
        lambda t, state: constant, lambda t, y: np.broadcast_to(constant, (len(t), *shape))
    )


def _sampled(smooth: BSpline) -> _Input:
    """A spline; for single times as pieces of polynomials, at a sixth of the cost of calling it."""
    starts = np.unique(smooth.t)[:-1]
    taylor = [smooth(starts, j) / factorial(j) for j in range(smooth.k + 1)]
    pieces = list(zip(starts.tolist(), np.stack(taylor, axis=1), strict=True))
    inner, powers = starts[1:].tolist(), np.arange(smooth.k + 1.0)

    def at(t: float, state: Array) -> Array:
        start, coefficients = pieces[bisect_right(inner, t)]
        return ((t - start) ** powers).dot(coefficients)

    return _Input(at, lambda t, y: np.asarray(smooth(t)))
