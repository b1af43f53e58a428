# SPDX-License-Identifier: BSD-2-Clause
"""Batches of simulations with a fixed step, by the classical Runge-Kutta method."""

from __future__ import annotations

import math
from contextlib import nullcontext
from typing import NamedTuple

import numpy as np

from ..arrays import Array, empty, positive_number
from ..dynamics.rollout_arrays import RolloutArrays
from ..engine import Engine
from ..errors import InputError
from ..model.mechanism import Mechanism
from ..progress import announced
from .rollout_arguments import RolloutArguments

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
    mechanism.contacts.require_none("rollout")


def rollout(engine: Engine, arguments: RolloutArguments, sign_width: float) -> Rollout:
    """The states that `ClosedChain.rollout` returns, for the same arguments."""
    positive_number("sign_width", sign_width, or_zero=True)
    mechanism = engine.mechanism
    # Torques for each step, or at the starts, middles and ends of the steps.
    torque_count = arguments.tau.shape[-2]
    steps = torque_count if arguments.steps is None else arguments.steps
    if torque_count not in (steps, 2 * steps + 1):
        problem = f"{torque_count} torques for {steps} steps: N or 2 N + 1 are needed"
        raise InputError("tau", problem)
    samples = arguments.samples()
    count = math.prod(samples.batch)
    load = None
    if samples.wrenches is not None:
        load = samples.wrenches.reshape(count, 6 * (mechanism.model.njoints - 1))
    motions = RolloutArrays(
        dt=arguments.dt,
        q0=samples.q0,
        va0=samples.va0,
        tau=samples.tau,
        load=load,
        q=empty((count, steps + 1, mechanism.model.nq)),
        va=empty((count, steps + 1, len(mechanism.coordinates))),
    )
    space = engine.state_space(sign_width)
    wrenches_at = arguments.wrenches_at(engine, samples)
    takes_long = count * steps >= _MANY
    with announced(f"rollout of {count} motions") if takes_long else nullcontext():
        valid = space.rollout(motions, arguments.threads, wrenches_at)  # fills motions.q and .va
    stopped = np.flatnonzero(valid <= steps).tolist()
    if stopped and arguments.raises:
        first = stopped[0]
        count_valid = int(valid[first])
        cause = space.why_ended(motions, first, count_valid, wrenches_at)
        time = count_valid * arguments.dt
        raise arguments.error(samples.batch, stopped, time, cause, at_start=count_valid == 0)
    q = motions.q.reshape(*samples.batch, *motions.q.shape[1:])
    va = motions.va.reshape(*samples.batch, *motions.va.shape[1:])
    return Rollout(q, va)
