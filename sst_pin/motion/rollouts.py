# SPDX-License-Identifier: BSD-2-Clause
"""Batches of simulations with a fixed step, by the classical Runge-Kutta method."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import (
    Array,
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
from ..chain.backend import Motions
from ..errors import InputError, SimulationError

if TYPE_CHECKING:
    from ..chain.closed_chain import ClosedChain


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
    chain: ClosedChain,
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
    """Simulate many motions with a fixed step; the error is of fourth order in dt.

    After each step the dependent joints are corrected, so that the loops stay closed. Motions go
    through dead points of the coordinates: near these, the rates of other joints are integrated.
    They end before singular configurations of the mechanism and never change their assembly mode.

    Args:
        chain: The robot.
        tau: Motor torques, shape (..., N, motors), constant in each step. For torques that change
            with time, give `steps` = N and shape (..., 2 N + 1, motors): torques at the ends and in
            the middle of each step.
        q0: Initial configurations, on the closures, shape (..., nq).
        va0: Initial rates of the coordinates, shape (..., n).
        dt: Step, [s]; a negative step goes back in time.
        external_wrenches: Constant for each motion, shape (..., r, 6); see `ClosedChain`.
        steps: Number of steps N; by default the number of torques.
        sign_width: As in `simulate`, [rad/s].
        threads: Number of threads in compiled kernels.
        on_error: "raise", or "nan" to set the states to NaN from the first bad state on.

    Returns:
        All states; the leading axes are those of the arguments, broadcast.

    Raises:
        InputError: For a wrong shape or a number that is not finite.
        ClosureError, SingularConfigurationError: For a bad initial state; lists the samples.
        SimulationError: If the loops open (dt is too long), or a motion reaches a singularity of
            the mechanism or diverges; it lists the samples and gives the time of the first.
    """
    require_policy(on_error)
    threads = whole_number("threads", threads, 1)
    positive_number("sign_width", sign_width, or_zero=True)
    step = float(single_array("dt", dt, ()))
    nq, motors = len(chain.position_names), len(chain.motor_names)
    steps = None if steps is None else whole_number("steps", steps, 0)
    torques = _torques(tau, steps, motors)
    start = as_array("q0", q0, (nq,))
    states = chain._states(sign_width)
    n = chain.degrees_of_freedom
    rates = as_array("va0", va0, (n,))
    wrenches = None
    if external_wrenches is not None:
        shape = (len(chain.joint_names), 6)
        wrenches = finite_array("external_wrenches", external_wrenches, shape)
    batch, flat = flattened((start, rates, torques, wrenches), (1, 1, 2, 2))
    q_0, va_0, tau_0 = (np.require(a, None, "A") for a in flat[:3])
    count = torques.shape[-2] if steps is None else steps
    samples = math.prod(batch)
    load = None if flat[3] is None else flat[3].reshape(samples, 6 * len(chain.joint_names))
    q, va = empty((samples, count + 1, nq)), empty((samples, count + 1, n))
    reached = states.rollout(Motions(step, q_0, va_0, tau_0, load, q, va), threads)
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
