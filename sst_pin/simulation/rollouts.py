# SPDX-License-Identifier: BSD-2-Clause
"""Batches of simulations with a fixed step, by the classical Runge-Kutta method."""

from __future__ import annotations

import math
from contextlib import nullcontext
from typing import NamedTuple

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
from ..dynamics.rollout_arrays import RolloutArrays
from ..engine import Engine
from ..errors import InputError, SimulationError
from ..model.mechanism import Mechanism
from ..progress import announced
from ..summaries import listed

#: Steps of all motions together from which a rollout may take seconds.
_MANY = 10_000


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


def require_smooth(mechanism: Mechanism) -> None:
    """Refuse contacts and ropes, which only nonsmooth steps know."""
    if not mechanism.contacts.none:
        elements = mechanism.contacts.points + mechanism.contacts.ropes
        names = listed([str(element) for element in elements])
        raise InputError("contacts", f"{names} act in rollout(..., nonsmooth=True) only; call it")


def rollout(
    engine: Engine,
    tau: ArrayLike,
    q0: ArrayLike,
    va0: ArrayLike,
    dt: float,
    *,
    wrenches: Array | None,
    steps: int | None,
    sign_width: float,
    threads: int,
    on_error: str,
) -> Rollout:
    """The states that `ClosedChain.rollout` returns, for the same arguments."""
    require_policy(on_error)
    threads = whole_number("threads", threads, 1)
    positive_number("sign_width", sign_width, or_zero=True)
    step = float(single_array("dt", dt, ()))
    mechanism = engine.mechanism
    nq, motors = mechanism.model.nq, len(mechanism.motor_names)
    steps = None if steps is None else whole_number("steps", steps, 0)
    torques = _torques(tau, steps, motors)
    start = as_array("q0", q0, (nq,))
    states, n = engine.states(sign_width), len(mechanism.coordinates)
    rates = as_array("va0", va0, (n,))
    batch, flat = flattened((start, rates, torques, wrenches), (1, 1, 2, 2))
    q_0, va_0, tau_0 = (np.require(a, None, "A") for a in flat[:3])
    count = torques.shape[-2] if steps is None else steps
    samples = math.prod(batch)
    load = None if flat[3] is None else flat[3].reshape(samples, 6 * (mechanism.model.njoints - 1))
    q, va = empty((samples, count + 1, nq)), empty((samples, count + 1, n))
    motions = RolloutArrays(step, q_0, va_0, tau_0, load, q, va)
    with nullcontext() if samples * count < _MANY else announced(f"rollout of {samples} motions"):
        valid = states.rollout(motions, threads)
    stopped = np.flatnonzero(valid <= count)
    if len(stopped) and on_error == "raise":
        finite_array("tau", torques, (motors,))
        first = int(stopped[0])
        error = states.why_ended(motions, first, int(valid[first]))
        if valid[first] > 0:
            error = SimulationError(
                f"the motion reached a singularity, diverged, or opened the loops: {error}",
                valid[first] * step,
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
