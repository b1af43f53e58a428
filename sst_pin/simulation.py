# SPDX-License-Identifier: BSD-2-Clause
"""Direct dynamics in time: Eqs. (7) and (92) as a state space in q and q_dot^a (Sect. 6.2)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from . import dynamics
from .batches import single_array
from .errors import InputError, SimulationError, SingularityWarning, SSTError
from .trajectories import Trajectory, sample_times, spline

if TYPE_CHECKING:
    from .closed_chain import ClosedChain

Array = NDArray[np.float64]

#: Motor torques: a function of (t, q, va), a constant of shape (n,), samples of shape (N, n) at the
#: times of the simulation, or the torques of a motion.
Torque = Callable[[float, Array, Array], ArrayLike] | ArrayLike | Trajectory
#: Loads: a function of (t, q, va), a constant, or none.
Load = Callable[[float, Array, Array], ArrayLike] | ArrayLike | None


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
    n, m = len(chain.actuated), len(chain.joint_names)
    start = np.concatenate([single_array("q0", q0, (m,)), single_array("va0", va0, (n,))])
    apply = _torque_function(torque, n, times)
    load = _load_function(external_wrenches, (chain.model.njoints - 1, 6))
    chain.compute_torques(start[:m], start[m:], np.zeros(n))  # a bad start fails by its own name
    motion = _Motion(chain, replace(chain.friction, sign_width=sign_width), apply, load)

    def near_singularity(time: float, state: Array) -> float:
        if progress is not None:
            progress(time)
        return float(np.log(max_condition_number / motion.condition_number(state)))

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


class _Motion:
    """Eqs. (7) and (92) as y' = f(t, y) with y = (q, q_dot^a)."""

    def __init__(
        self,
        chain: ClosedChain,
        friction: dynamics.Friction,
        torque: Callable[[float, Array, Array], Array],
        load: Callable[[float, Array, Array], Array | None],
    ) -> None:
        self._chain, self._friction, self._torque, self._load = chain, friction, torque, load
        self._m = len(chain.joint_names)
        self.failure: SSTError | None = None
        self.time = float("nan")

    def _closed(self, state: Array) -> tuple[Array, Array]:
        q, va = state[: self._m], state[self._m :]
        return self._chain.assemble(q), va

    def rate(self, time: float, state: Array) -> Array:
        self.time = time
        if not np.isfinite(state).all():
            return np.full_like(state, np.nan)
        try:
            q, va = self._closed(state)
            aa, q_dot = self._accelerations(time, q, va)
        except InputError:
            raise  # the caller's torque is at fault
        except SSTError as error:
            # A trial step went too far; the integrator answers NaN with a shorter one.
            self.failure = error
            return np.full_like(state, np.nan)
        return np.concatenate([q_dot, aa])

    def _accelerations(self, time: float, q: Array, va: Array) -> tuple[Array, Array]:
        tau, load = self._torque(time, q, va), self._load(time, q, va)
        workspace = self._chain.workspace_at(q)
        return dynamics.direct_dynamics(*workspace, self._friction, q, va, tau, load)

    def condition_number(self, state: Array) -> float:
        return self._chain.condition_number(self._closed(state)[0])

    def sampled(self, times: Array, states: Array, stopped: str) -> Trajectory:
        q, va = (np.stack(column) for column in zip(*map(self._closed, states), strict=True))
        tau = np.stack([self._torque(*sample) for sample in zip(times, q, va, strict=True)])
        aa = np.stack(
            [self._accelerations(*sample)[0] for sample in zip(times, q, va, strict=True)]
        )
        chain = self._chain
        actuated = [chain.joint_names[i] for i in chain.actuated]
        return Trajectory(
            times, q, va, aa, tau, chain.joint_names, actuated, chain.joint_units, stopped
        )


def _torque_function(
    torque: Torque, n: int, times: Array
) -> Callable[[float, Array, Array], Array]:
    if isinstance(torque, Trajectory):
        if times[0] < torque.t[0] or times[-1] > torque.t[-1]:
            raise InputError(
                "torque",
                f"sampled from {torque.t[0]:g} to {torque.t[-1]:g} s, "
                f"wanted from {times[0]:g} to {times[-1]:g} s",
            )
        smooth = torque.torque()
        return lambda t, q, va: smooth(t)
    if callable(torque):
        return lambda t, q, va: single_array("torque(t, q, va)", torque(t, q, va), (n,))
    if np.ndim(torque) == 2:
        samples = spline(times, single_array("torque", torque, (len(times), n)))
        return lambda t, q, va: np.asarray(samples(t))
    constant = single_array("torque", torque, (n,))
    return lambda t, q, va: constant


def constant_or_called(load: Load) -> Callable[[float, Array, Array], ArrayLike | None]:
    """A load as a function of (t, q, va), whatever it is."""
    if callable(load):
        return load
    return lambda t, q, va: load


def _load_function(
    load: Load, shape: tuple[int, ...]
) -> Callable[[float, Array, Array], Array | None]:
    if load is None:
        return lambda t, q, va: None
    value = constant_or_called(load)
    return lambda t, q, va: single_array("external_wrenches", value(t, q, va), shape)
