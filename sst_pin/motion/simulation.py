# SPDX-License-Identifier: BSD-2-Clause
"""Direct dynamics in time: Eqs. (7) and (92) as a state space in q and q_dot^a (Sect. 6.2)."""

from __future__ import annotations

import warnings
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import replace
from math import factorial, isfinite
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline

from ..arrays import as_array, positive_number, single_array
from ..errors import InputError, SimulationError, SingularityWarning, SSTError
from .trajectories import Trajectory, sample_times, spline

if TYPE_CHECKING:
    from ..chain.closed_chain import ClosedChain
    from .mechanics import Mechanics

Array = NDArray[np.float64]

#: Motor torques: a function of (t, q, va), a constant of shape (n,), samples of shape (N, n) at the
#: times of the simulation, or the torques of a motion.
Torque = Callable[[float, Array, Array], ArrayLike] | ArrayLike | Trajectory
#: Loads: a function of (t, q, va), a constant, or none.
Load = Callable[[float, Array, Array], ArrayLike] | ArrayLike | None

_METHODS = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")


def simulate(
    chain: ClosedChain,
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
    """Integrate the motion of a closed chain under given torques.

    The right-hand side sees the closed configuration with the actuated coordinates of the state:
    the passive ones are projected onto the closures, so that they cannot drift and the dynamics
    stays what it is.

    Args:
        chain: The robot.
        torque: Callable (t, q, va) -> (n,); a constant, shape (n,); samples at t, shape (N, n); or
            a `Trajectory` with samples of its own. Samples are joined by a smooth spline: for
            torques that jump, pass a callable.
        q0: Joint coordinates at t[0], on the closures, shape (m,).
        va0: Actuated rates at t[0], shape (n,).
        t: Times at which the motion is wanted, increasing, shape (N,), N >= 2, [s].
        external_wrenches: Callable (t, q, va) -> (r, 6), or a constant; see `compute_torques`.
        method: Of `scipy.integrate.solve_ivp`.
        rtol: Relative tolerance of the integrator.
        atol: Absolute tolerance of the integrator, [rad], [rad/s].
        max_condition_number: Of Phi^u, where the motion is stopped before a singularity.
        sign_width: [rad/s]; in Coulomb friction sign(x) is taken as tanh(x / sign_width), since
            no integrator can stand on a jump: what should stick creeps below this rate.
        progress: Called with the time reached.

    Returns:
        The motion at the times reached; `stopped` says why when they are not all of t.

    Warns:
        SingularityWarning: When the motion was stopped before a singularity.

    Raises:
        InputError: For a wrong shape, a number that is not finite, a torque that ends too early.
        ClosureError: When q0 is open.
        SingularConfigurationError: When q0 is singular.
        SimulationError: When the integrator gives up.
    """
    times = sample_times(t, 2)
    _require_options(method, rtol, atol, max_condition_number, sign_width)
    n, m = len(chain.actuated), len(chain.joint_names)
    start = np.concatenate([single_array("q0", q0, (m,)), single_array("va0", va0, (n,))])
    mechanics = chain.mechanics(replace(chain.friction, sign_width=sign_width))
    apply = _torque_of(torque, times, mechanics, n)
    load = _load_of(external_wrenches, mechanics, chain.model.njoints - 1)
    chain.compute_torques(start[:m], start[m:], np.zeros(n))  # a bad start fails by its own name
    motion = _Motion(chain, mechanics, apply, load)

    def near_singularity(time: float, state: Array) -> float:
        if progress is not None:
            progress(time)
        return mechanics.margin(state, max_condition_number)

    near_singularity.terminal = True  # type: ignore[attr-defined]
    if near_singularity(times[0], start) <= 0:
        raise InputError("q0", f"nearer to a singularity than {max_condition_number=:g}")
    solution = solve_ivp(
        motion.rate,
        times[[0, -1]],
        start,
        method=method,
        t_eval=times,
        events=near_singularity,
        rtol=rtol,
        atol=atol,
    )
    if solution.status == -1:
        raise SimulationError(
            f"the integrator gave up ({motion.failure or solution.message})", motion.time
        )
    stopped = ""
    if solution.status == 1:
        stopped = (
            f"stopped at t = {solution.t_events[0][0]:.9g} s before a singularity: "
            f"condition number {max_condition_number:g}"
        )
        warnings.warn(stopped, SingularityWarning, stacklevel=3)
    return motion.sampled(solution.t, solution.y.T, stopped)


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
        along: Its values at times (N,) and states (N, m + n).
    """

    at: Callable[[float, Array], Array]
    along: Callable[[Array, Array], Array]


class _Motion:
    """Eqs. (7) and (92) as y' = f(t, y) with y = (q, q_dot^a)."""

    def __init__(
        self, chain: ClosedChain, mechanics: Mechanics, torque: _Input, load: _Input | None
    ) -> None:
        self._chain, self._mechanics, self._torque, self._load = chain, mechanics, torque, load
        self.failure: SSTError | None = None
        self.time = float("nan")

    def rate(self, time: float, state: Array) -> Array:
        self.time = time
        if not isfinite(state.dot(state)):
            return np.full_like(state, np.nan)
        try:
            load = None if self._load is None else self._load.at(time, state)
            return self._mechanics.rate(state, self._torque.at(time, state), load)
        except InputError:
            raise  # the caller's torque is at fault
        except SSTError as error:
            # A trial step went too far; the integrator answers NaN with a shorter one.
            self.failure = error
            return np.full_like(state, np.nan)

    def sampled(self, times: Array, states: Array, stopped: str) -> Trajectory:
        chain, m = self._chain, len(self._chain.joint_names)
        tau = self._torque.along(times, states)
        load = None if self._load is None else self._load.along(times, states)
        aa = self._mechanics.rate(states, tau, load)[:, m:]
        return Trajectory(
            times,
            self._mechanics.closed(states),
            states[:, m:],
            aa,
            tau,
            chain.joint_names,
            [chain.joint_names[i] for i in chain.actuated],
            chain.joint_units,
            stopped,
        )


def _torque_of(torque: Torque, times: Array, mechanics: Mechanics, n: int) -> _Input:
    if isinstance(torque, Trajectory):
        if times[0] < torque.t[0] or times[-1] > torque.t[-1]:
            raise InputError(
                "torque",
                f"sampled from {torque.t[0]:g} to {torque.t[-1]:g} s, "
                f"wanted from {times[0]:g} to {times[-1]:g} s",
            )
        return _sampled(spline(torque.t, torque.tau))
    if not callable(torque) and as_array("torque", torque, ()).ndim == 2:
        return _sampled(spline(times, single_array("torque", torque, (len(times), n))))
    return _called_or_constant("torque", torque, (n,), mechanics)


def _load_of(load: Load, mechanics: Mechanics, bodies: int) -> _Input | None:
    if load is None:
        return None
    return _called_or_constant("external_wrenches", load, (bodies, 6), mechanics)


def _called_or_constant(
    name: str,
    value: Callable[[float, Array, Array], ArrayLike] | ArrayLike,
    shape: tuple[int, ...],
    mechanics: Mechanics,
) -> _Input:
    if callable(value):

        def at(t: float, state: Array) -> Array:
            q = mechanics.closed(state)
            return single_array(f"{name}(t, q, va)", value(t, q, state[len(q) :]), shape)

        return _Input(at, lambda t, states: np.array([at(*x) for x in zip(t, states, strict=True)]))
    constant = single_array(name, value, shape)
    return _Input(
        lambda t, state: constant, lambda t, states: np.broadcast_to(constant, (len(t), *shape))
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

    return _Input(at, lambda t, states: np.asarray(smooth(t)))


def constant_or_called(load: Load) -> Callable[[float, Array, Array], ArrayLike | None]:
    """A load as a function of (t, q, va), whatever it is."""
    return load if callable(load) else lambda t, q, va: load
