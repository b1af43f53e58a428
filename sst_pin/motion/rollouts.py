# SPDX-License-Identifier: BSD-2-Clause
"""Many simulations at once with a fixed step: the classical Runge-Kutta method on the closures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import (
    as_array,
    empty,
    finite_array,
    flattened,
    name_samples,
    positive_number,
    require_policy,
    single_array,
    whole_number,
)
from ..errors import InputError, SimulationError

if TYPE_CHECKING:
    from .moving_robot import Robot

Array = NDArray[np.float64]


class Rollout(NamedTuple):
    """States of many simulations at the times 0, dt, 2 dt, ..., N dt.

    Attributes:
        q: Configurations, shape (..., N + 1, nq).
        va: Rates of the coordinates, shape (..., N + 1, n).

    Example:
        >>> q, va = chain.rollout(np.zeros((100, 1)), chain.home, [0], dt=0.001)
        >>> q.shape, va.shape
        ((101, 3), (101, 1))
    """

    q: Array
    va: Array


def rollout(
    chain: Robot,
    tau: ArrayLike,
    q0: ArrayLike,
    va0: ArrayLike,
    dt: float,
    *,
    external_wrenches: ArrayLike | None = None,
    steps: int | None = None,
    sign_width: float = 1e-3,
    threads: int = 1,
    on_error: str = "raise",
) -> Rollout:
    """Integrate many motions with a fixed step, fourth order in dt.

    After each step the dependent joints are moved onto the closures, so that these do not drift.

    Args:
        chain: The robot.
        tau: Motor torques, shape (..., N, motors), each held over a step. For torques that change
            with time, shape (..., 2 N + 1, motors): at the ends and in the middles of N steps,
            with `steps` = N.
        q0: Configurations at the start, on the closures, shape (..., nq).
        va0: Rates of the coordinates at the start, shape (..., n).
        dt: Step, [s]; a negative one goes back in time.
        external_wrenches: Constant over a motion, shape (..., r, 6); see `compute_torques`.
        steps: Number of steps N; as many as torques by default.
        sign_width: As in `simulate`, [rad/s].
        threads: How many share the batch in compiled kernels.
        on_error: "raise", or "nan" for NaN from the first state on that does not hold.

    Returns:
        All states; leading axes are those of the arguments, broadcast.

    Raises:
        InputError: For a wrong shape or a number that is not finite.
        ClosureError, SingularConfigurationError: For a bad start, naming the samples.
        SimulationError: When the loops open (dt is too long), when a motion comes to a singularity
            or when it runs away; it names the samples and gives the time of the first.
    """
    require_policy(on_error)
    threads = whole_number("threads", threads, 1)
    positive_number("sign_width", sign_width, or_zero=True)
    step = float(single_array("dt", dt, ()))
    nq, motors = len(chain.position_names), len(chain.motor_names)
    steps = None if steps is None else whole_number("steps", steps, 0)
    torques = _torques(tau, steps, motors)
    start = as_array("q0", q0, (nq,))
    states = chain.states(sign_width, start)
    n = chain.degrees_of_freedom
    rates = as_array("va0", va0, (n,))
    wrenches = None
    if external_wrenches is not None:
        shape = (len(chain.joint_names), 6)
        wrenches = finite_array("external_wrenches", external_wrenches, shape)
    batch, flat = flattened((start, rates, torques, wrenches), (1, 1, 2, 2))
    q_0, va_0, tau_0 = (np.require(a, None, "A") for a in flat[:3])
    load = flat[3]
    count = torques.shape[-2] if steps is None else steps
    samples = math.prod(batch)
    q, va = empty((samples, count + 1, nq)), empty((samples, count + 1, n))
    reached = states.rollout(step, q_0, va_0, tau_0, load, q, va, threads)
    stopped = np.flatnonzero(reached <= count)
    if len(stopped) and on_error == "raise":
        first = int(stopped[0])
        finite_array("tau", torques, (motors,))
        if reached[first] == 0:  # the start fails by its own name
            chain.joint_rates(start, rates)
        error = SimulationError(
            "the motion reached a singularity, diverged, or opened the loops (step too long)",
            reached[first] * step,
        )
        name_samples(error, stopped.tolist(), batch)
        raise error
    return Rollout(q.reshape(*batch, count + 1, nq), va.reshape(*batch, count + 1, n))


def _torques(tau: ArrayLike, steps: int | None, motors: int) -> Array:
    torques = as_array("tau", tau, (motors,))
    if torques.ndim < 2:
        raise InputError("tau", f"shape {torques.shape}, expected (..., N, {motors})")
    rows = torques.shape[-2]
    if steps is not None and rows not in (steps, 2 * steps + 1):
        raise InputError("tau", f"{rows} torques for {steps} steps: N or 2 N + 1 are needed")
    return torques
