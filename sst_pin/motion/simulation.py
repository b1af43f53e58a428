# SPDX-License-Identifier: BSD-2-Clause
"""Direct dynamics in time: Eqs. (7) and (92) as a state space in q and va (Sect. 6.2).

The rates va are those of independent joints, which are chosen again where they get bad.
"""

from __future__ import annotations

import warnings
from bisect import bisect_right
from collections.abc import Callable
from functools import cache, partial
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
#: Condition number of the dependent joints, below which coordinates are kept or taken up again,
#: and above which others are looked for, as long as these are better by some margin.
_WELL_CONDITIONED, _POOR, _MARGIN = 20.0, 50.0, 4.0
#: A step that is not regular is tried again with its regular part, or this part of it at least;
#: a motion ends where this leads to such a part of its time.
_SHORTER, _STUCK = 0.25, 1e-12
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

    In each evaluation the dependent joints are computed from independent ones by the closure
    constraints, so the loops stay closed. The independent joints are the coordinates of the robot;
    where these do not determine the motion well, others are chosen for a while.

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
        max_condition_number: The motion stops before a singularity of the mechanism, where the
            condition number of the dependent columns of Phi reaches this value, whichever joints
            are independent. Dead points of the coordinates do not end a motion.
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
    if not states.condition_number(q0) < max_condition_number:
        raise InputError("q0", f"closer to a singularity than {max_condition_number=:g}")
    motion = _Motion(
        states,
        _torque_of(torque, times, len(chain.motor_names)),
        _load_of(external_wrenches, len(chain.joint_names)),
    )
    # A load that is a function, and wheels that roll, have more derivatives than the robot's.
    exact = (
        sign_width > 0
        and not callable(external_wrenches)
        and not any(isinstance(closure, Rolling) for closure in chain.mechanism.closures)
    )
    options: dict[str, Any] = {"rtol": rtol, "atol": atol}
    if exact and method in _IMPLICIT:
        options["jac"] = motion.jacobian
    run = _Run(motion, method, options, max_condition_number, progress)
    q, va, aa, tau = run.integrate(times, np.concatenate([q0, va0]))
    if run.stopped:
        warnings.warn(run.stopped, SingularityWarning, stacklevel=3)
    return chain.trajectory(times[: len(q)], q, va, aa, tau, stopped=run.stopped)


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
        at: Its value at a time, where the last argument gives q and va.
        along: Its values at times (N,), for q (N, nq) and va (N, n).
    """

    at: Callable[[float, Callable[[], tuple[Array, Array]]], Array]
    along: Callable[[Array, Array, Array], Array]


class _Motion:
    """Eqs. (7) and (92) as y' = f(t, y), y = (q, rates of the coordinates of `states`).

    `own` are the states in the robot's coordinates, which torques and loads are functions of.
    """

    def __init__(self, own: States, torque: _Input, load: _Input | None) -> None:
        self.own = self.states = own
        self.torque, self.load = torque, load
        self.failure: SSTError | None = None
        self._last = np.zeros(())

    def seen(self, state: Array) -> tuple[Array, Array]:
        """q with closed loops, and the rates of the robot's coordinates."""
        q = self.states.closed(state)
        va = state[len(q) :]
        if self.states is not self.own:
            va = self.states.joint_rates(q, va)[self.own.coordinates]
        return q, va

    def _inputs(self, time: float, state: Array) -> tuple[Array, Array | None]:
        where = partial(self.seen, state)
        load = None if self.load is None else self.load.at(time, where)
        return self.torque.at(time, where), load

    def rate(self, time: float, state: Array) -> Array:
        if not isfinite(state.dot(state)):
            return np.full_like(state, np.nan)
        try:
            return self.states.rate(state, *self._inputs(time, state))
        except InputError:
            raise  # the caller's torque is at fault
        except SSTError as error:
            # A trial step went too far; the integrator answers NaN with a shorter one.
            self.failure = error
            return np.full_like(state, np.nan)

    def along(self, times: Array, states: Array) -> tuple[Array, Array, Array, Array]:
        """q, va, aa of the robot's coordinates, and torques, at times and states of the motion."""
        q = self.states.closed(states)
        rates = va = states[:, q.shape[1] :]
        if self.states is not self.own:
            coordinates = self.own.coordinates
            v = [self.states.joint_rates(*x) for x in zip(q, rates, strict=True)]
            va = np.array(v)[:, coordinates]
        tau = self.torque.along(times, q, va)
        load = None if self.load is None else self.load.along(times, q, va)
        aa = self.states.rate(states, tau, load)[:, q.shape[1] :]
        if self.states is not self.own:
            v_dot = map(self.states.joint_accelerations, q, rates, aa)
            aa = np.array(list(v_dot))[:, coordinates]
        return q, va, aa, tau

    def jacobian(self, time: float, state: Array) -> Array:
        """Derivatives of the rate by the state; a callable torque's own ones by differences."""
        if not isfinite(state.dot(state)):
            return self._last
        try:
            tau, load = self._inputs(time, state)
            by_state, by_tau = self.states.derivatives(state, tau, load)
            steps = _DIFFERENCE * np.maximum(1, np.abs(state))
            moved = state + np.diag(steps)
            ahead = [self.torque.at(time, partial(self.seen, y)) for y in moved]
            self._last = by_state + by_tau.dot(((ahead - tau) / steps[:, None]).T)
        except InputError:
            raise
        except SSTError as error:  # a trial state went too far: the last Jacobian serves there
            self.failure = error
        return self._last


class _Run:
    """One integration, step by step, in coordinates that are chosen again where they get bad.

    It ends before a singularity; `stopped` says why it ended before the last time.
    """

    def __init__(
        self,
        motion: _Motion,
        method: str,
        options: dict[str, Any],
        limit: float,
        progress: Callable[[float], None] | None,
    ) -> None:
        from scipy import integrate

        self._motion, self._solver, self._options = motion, getattr(integrate, method), options
        self._most, self._progress = limit, progress or (lambda time: None)
        self.stopped = ""

    def integrate(self, times: Array, start: Array) -> list[Array]:
        """q, va, aa of the robot's coordinates and torques, at the times reached."""
        motion, t, end = self._motion, float(times[0]), float(times[-1])
        if not np.isfinite(motion.rate(t, start)).all():
            why = motion.failure or "its rates are not finite"
            raise SimulationError(f"the motion cannot start ({why})", t)
        q = motion.own.closed(start)
        state, limit = self._settle(q, start)
        parts = [motion.along(times[:1], state[None])]
        done, stride = 1, np.inf
        self._progress(t)
        while t < end and not self.stopped:
            first = min(stride, end - t) if stride < np.inf else None
            solver = self._solver(motion.rate, t, state, end, first_step=first, **self._options)
            regular = True
            samples = list[Array]()
            while solver.status == "running" and regular:
                last, message = solver.y, solver.step()
                if solver.status == "failed":
                    why = motion.failure or message
                    raise SimulationError(f"the integrator stopped ({why})", float(solver.t))
                stride = solver.step_size
                self._progress(float(solver.t))
                fraction, q = self._follow(solver, q, limit)
                t, state = float(solver.t), solver.y
                if fraction < 1:
                    t = float(solver.t_old + fraction * (solver.t - solver.t_old))
                    state = solver.dense_output()(t) if fraction else last
                    stride *= max(fraction, _SHORTER)
                new = times[done + len(samples) :]
                new = new[new <= t]
                if len(new):
                    samples.extend(solver.dense_output()(new).T)
                back = motion.states is not motion.own
                regular = fraction == 1 and not (
                    back and motion.own.condition_number(q) < _WELL_CONDITIONED
                )
            if samples:
                reached = times[done : done + len(samples)]
                parts.append(motion.along(reached, np.array(samples)))
                done += len(samples)
            if not regular:
                state, next_limit = self._settle(q, state)
                at_limit = limit == next_limit == self._most
                if fraction < 1 and (at_limit or stride < _STUCK * (end - times[0])):
                    self.stopped = (
                        f"stopped at t = {t:.9g} s before a singularity: condition number {limit:g}"
                    )
                limit = next_limit
        return [np.concatenate(part) for part in zip(*parts, strict=True)]

    def _settle(self, q: Array, state: Array) -> tuple[Array, float]:
        """The state in the coordinates that suit it, and the limit of their condition number."""
        motion, own = self._motion, self._motion.own
        before, condition, states = motion.states, own.condition_number(q), own
        if condition > _WELL_CONDITIONED:
            other = own.elsewhere(q)
            best = other.condition_number(q)
            if best < condition / 2:
                states, condition = other, best
        rates = state[len(q) :]
        if states is not before:
            rates = before.joint_rates(q, rates)[states.coordinates]
            motion.states = states
        state = np.concatenate([q, rates])
        return state, min(self._most, max(_POOR, _MARGIN * condition))

    def _follow(self, solver: OdeSolver, before: Array, limit: float) -> tuple[float, Array]:
        """How much of the last step is regular, and the configuration there."""
        states, start, length = self._motion.states, solver.t_old, solver.t - solver.t_old
        course = cache(solver.dense_output)

        def way(q: Array, low: float, high: float) -> Array | None:
            try:
                state = solver.y if high == 1 else course()(start + high * length)
                return states.closed(state)
            except SSTError:
                return None

        return states.follow(before, way, limit)


def _torque_of(torque: Torque, times: Array, motors: int) -> _Input:
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
    return _called_or_constant("torque", torque, (motors,))


def _load_of(load: Load, bodies: int) -> _Input | None:
    if load is None:
        return None
    return _called_or_constant("external_wrenches", load, (bodies, 6))


def _called_or_constant(
    name: str,
    value: Callable[[float, Array, Array], ArrayLike] | ArrayLike,
    shape: tuple[int, ...],
) -> _Input:
    if callable(value):

        def one(t: float, q: Array, va: Array) -> Array:
            return single_array(f"{name}(t, q, va)", value(t, q, va), shape)

        return _Input(
            lambda t, where: one(t, *where()),
            lambda t, q, va: np.array(list(map(one, t, q, va))),
        )
    constant = single_array(name, value, shape)
    return _Input(
        lambda t, where: constant, lambda t, q, va: np.broadcast_to(constant, (len(t), *shape))
    )


def _sampled(smooth: BSpline) -> _Input:
    """A spline; for single times as pieces of polynomials, at a sixth of the cost of calling it."""
    starts = np.unique(smooth.t)[:-1]
    taylor = [smooth(starts, j) / factorial(j) for j in range(smooth.k + 1)]
    pieces = list(zip(starts.tolist(), np.stack(taylor, axis=1), strict=True))
    inner, powers = starts[1:].tolist(), np.arange(smooth.k + 1.0)

    def at(t: float, where: Callable[[], tuple[Array, Array]]) -> Array:
        start, coefficients = pieces[bisect_right(inner, t)]
        return ((t - start) ** powers).dot(coefficients)

    return _Input(at, lambda t, q, va: np.asarray(smooth(t)))
