# SPDX-License-Identifier: BSD-2-Clause
"""Many simulations at once with a fixed step: the classical Runge-Kutta method on the closures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import (
    as_array,
    finite_array,
    flattened,
    name_samples,
    positive_number,
    require_policy,
    single_array,
    whole_number,
)
from ..chain.dynamics import Friction, direct_dynamics
from ..errors import InputError, SimulationError, SSTError

if TYPE_CHECKING:
    from ..sst.star_dynamics import StarDynamics

Array = NDArray[np.float64]


class Rollout(NamedTuple):
    """States of many simulations at the times 0, dt, 2 dt, ..., N dt.

    Attributes:
        q: Joint coordinates, shape (..., N + 1, 9), [rad].
        va: Motor rates, shape (..., N + 1, 3), [rad/s].
    """

    q: Array
    va: Array


def rollout(
    robot: StarDynamics,
    tau: ArrayLike,
    q0: ArrayLike,
    va0: ArrayLike,
    dt: float,
    *,
    platform_moment: ArrayLike | None = None,
    steps: int | None = None,
    sign_width: float = 1e-3,
    threads: int = 1,
    on_error: str = "raise",
) -> Rollout:
    """Integrate many motions with a fixed step, fourth order in dt.

    After each step the passive joints are moved onto the closures, so that these do not drift.

    Args:
        robot: The SST.
        tau: Motor torques, shape (..., N, 3), [N m], each held over a step. For torques that
            change with time, shape (..., 2 N + 1, 3): at the ends and in the middles of N steps,
            with `steps` = N.
        q0: Joint coordinates at the start, on the closures, shape (..., 9), [rad].
        va0: Motor rates at the start, shape (..., 3), [rad/s].
        dt: Step, [s]; a negative one goes back in time.
        platform_moment: Moment on the star, base axes, constant, shape (..., 3), [N m].
        steps: Number of steps N; as many as torques by default.
        sign_width: As in `simulate`, [rad/s].
        threads: How many share the batch.
        on_error: "raise", or "nan" for NaN from the first state on that does not hold.

    Returns:
        All states; leading axes are those of the arguments, broadcast.

    Raises:
        InputError: For a wrong shape or a number that is not finite.
        ClosureError, SingularConfigurationError: For a bad start, naming the samples.
        SimulationError: When the loops open (dt is too long), when a motion comes to a singularity
            or when it runs away; it names the samples and tells the time of the first.
    """
    require_policy(on_error)
    threads = whole_number("threads", threads, 1)
    step = float(single_array("dt", dt, ()))
    positive_number("sign_width", sign_width, or_zero=True)
    steps = None if steps is None else whole_number("steps", steps, 0)
    torques = _torques(tau, steps)
    start, rates = as_array("q0", q0, (9,)), as_array("va0", va0, (3,))
    moment = None if platform_moment is None else as_array("platform_moment", platform_moment, (3,))
    batch, flat = flattened((start, rates, torques, moment), (1, 1, 2, 1))
    rows = [None if a is None else np.require(a, None, "A") for a in flat]
    n = math.prod(batch)
    count = torques.shape[-2] if steps is None else steps
    q, va = np.empty((n, count + 1, 9)), np.empty((n, count + 1, 3))
    reached = np.zeros(n, dtype=np.intp)
    run = robot.course(replace(robot.friction, sign_width=sign_width))
    run(step, *rows, q, va, reached, threads)
    stopped = np.flatnonzero(reached <= count)
    if len(stopped) and on_error == "raise":
        first = int(stopped[0])
        finite_array("tau", torques, (3,))
        if reached[first] == 0:  # the start fails by its own name
            robot.compute_torques(start, rates, np.zeros(3), platform_moment=moment)
        error = SimulationError(
            "the motion came to a singularity, ran away, or opened the loops by too long a step",
            reached[first] * step,
        )
        name_samples(error, stopped.tolist(), batch)
        raise error
    return Rollout(q.reshape(*batch, count + 1, 9), va.reshape(*batch, count + 1, 3))


def _torques(tau: ArrayLike, steps: int | None) -> Array:
    torques = as_array("tau", tau, (3,))
    if torques.ndim < 2:
        raise InputError("tau", f"shape {torques.shape}, expected (..., N, 3)")
    rows = torques.shape[-2]
    if steps is not None and rows not in (steps, 2 * steps + 1):
        raise InputError("tau", f"{rows} torques for {steps} steps: N or 2 N + 1 are needed")
    return torques


#: Fills q and va, counts the states that hold: (dt, q0, va0, tau, moment, q, va, reached, threads).
Course = Callable[..., object]


def reference_course(robot: StarDynamics, friction: Friction) -> Course:
    """The same method on the reference path, one motion after the other."""

    def accelerations(q: Array, va: Array, tau: Array, load: Array | None) -> tuple[Array, Array]:
        # Between the steps q is off the closures by the square of the step.
        return direct_dynamics(*robot.workspace_at(q, np.inf), friction, q, va, tau, load)

    def course(
        dt: float,
        q0: Array,
        va0: Array,
        tau: Array,
        moment: Array | None,
        q: Array,
        va: Array,
        reached: NDArray[np.intp],
        threads: int,
    ) -> None:
        steps = q.shape[1] - 1
        ends = tau.shape[1] == steps
        q[:], va[:] = np.nan, np.nan
        for i in range(len(q)):
            load = None if moment is None else robot.star_load(moment[i])
            state, side = (q0[i], va0[i]), 0.0
            for s in range(steps + 1):
                try:
                    robot.workspace_at(state[0])
                    sign = robot.side(state[0])
                    if not np.isfinite(np.concatenate(state)).all() or sign * (side or sign) <= 0:
                        break
                    side, reached[i] = sign, s + 1
                    q[i, s], va[i, s] = state
                    if s < steps:
                        three = tau[i, [s, s, s] if ends else [2 * s, 2 * s + 1, 2 * s + 2]]
                        q_end, va_end = _step(accelerations, *state, three, load, dt)
                        state = robot.assemble(q_end), va_end
                except SSTError:
                    break

    return course


def _step(
    accelerations: Callable[..., tuple[Array, Array]],
    q: Array,
    va: Array,
    tau: Array,
    load: Array | None,
    h: float,
) -> tuple[Array, Array]:
    """One step of the classical Runge-Kutta method."""
    q_s, va_s, q_end, va_end = q, va, q, va
    for when, weight, ahead in ((0, h / 6, h / 2), (1, h / 3, h / 2), (1, h / 3, h), (2, h / 6, 0)):
        aa, q_dot = accelerations(q_s, va_s, tau[when], load)
        q_end, va_end = q_end + weight * q_dot, va_end + weight * aa
        q_s, va_s = q + ahead * q_dot, va + ahead * aa
    return q_end, va_end
