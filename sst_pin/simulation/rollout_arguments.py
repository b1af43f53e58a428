# SPDX-License-Identifier: BSD-2-Clause
"""Arguments of rollouts with a fixed step, smooth or nonsmooth: checks, loads, and errors.

`rollout_arguments` checks what a user gives, and `RolloutArguments.samples` spreads it over all
samples of the batch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import (
    Array,
    as_array,
    finite_array,
    flattened,
    name_samples,
    require_policy,
    single_array,
    whole_number,
)
from ..engine import Engine
from ..engine_arguments import Wrenches
from ..errors import InputError, SimulationError, SSTError
from ..states import WrenchesAt


@dataclass(frozen=True, eq=False)
class RolloutArguments:
    """Checked arguments of rollouts; leading axes (...) are those of a batch.

    Attributes:
        tau: Motor torques, shape (..., N, motors) if they are constant in each of the N steps, or
            (..., 2 N + 1, motors) with torques at the starts, the middles and the ends of the
            steps. They may contain numbers that are not finite.
        q0: Starts, shape (..., nq). They too may contain such numbers; a motion that starts at one
            is refused when it is computed.
        va0: Rates of the coordinates at the starts, shape (..., n), the same as q0.
        dt: Step, [s].
        steps: Number of steps N, if the user gives it.
        wrenches: Constant external wrenches on the bodies, shape (..., r, 6), or None.
        at_frames: Constant external wrenches at frames, by name, shapes (..., 6).
        threads: Number of threads.
        raises: Whether a motion that ends early is an error.
    """

    tau: Array
    q0: Array
    va0: Array
    dt: float
    steps: int | None
    wrenches: Array | None
    at_frames: Mapping[str, Array]
    threads: int
    raises: bool

    def samples(self, motor_positions: Array | None = None) -> RolloutSamples:
        """The arguments broadcast to all samples of the batch, with the samples in one axis.

        `motor_positions` are positions that motors hold in each step, shape (..., N, motors). They
        are None in a smooth rollout.
        """
        arrays = [self.q0, self.va0, self.tau, motor_positions, self.wrenches]
        core_axes = [1, 1, 2, 2, 2]  # behind the axes of the batch
        arrays += self.at_frames.values()
        core_axes += [1] * len(self.at_frames)
        batch, flat = flattened(arrays, core_axes)
        q0, va0, tau, positions, wrenches, *at_frames = flat

        # Kernels need aligned arrays ("A"); positions and wrenches also contiguous ones ("C").
        return RolloutSamples(
            batch=batch,
            q0=np.require(q0, float, "A"),
            va0=np.require(va0, float, "A"),
            tau=np.require(tau, float, "A"),
            motor_positions=None if positions is None else np.require(positions, float, "C"),
            wrenches=None if wrenches is None else np.require(wrenches, float, "C"),
            at_frames={
                frame: np.asarray(wrench)
                for frame, wrench in zip(self.at_frames, at_frames, strict=True)
            },
        )

    def wrenches_at(self, engine: Engine, samples: RolloutSamples) -> WrenchesAt | None:
        """A function (i, q) of all external wrenches on the bodies of sample i, shape (r, 6).

        It is None if the wrenches do not depend on q: only wrenches at frames do, because their
        moments about the mass centres change with q.
        """
        if not self.at_frames:
            return None

        def wrenches(i: int, q: Array) -> Array:
            at_frames = {name: wrench[i] for name, wrench in samples.at_frames.items()}
            no_moment = None  # on the platform
            on_bodies = engine.arguments.wrenches(no_moment, at_frames, on_error="raise", q=q)
            if samples.wrenches is not None:
                on_bodies = on_bodies + samples.wrenches[i]
            return np.asarray(on_bodies)

        return wrenches

    def error(
        self,
        batch: tuple[int, ...],
        stopped: list[int],
        time: float,
        cause: SSTError,
        *,
        at_start: bool,
    ) -> SSTError:
        """The error of motions that ended early, to be raised. It names their indices in the batch.

        A torque that is not finite is the only error that this method raises itself.

        Args:
            batch: Shape of the batch.
            stopped: Indices of these motions, with all samples of the batch counted in a row.
            time: When the first of these motions ended, [s].
            cause: Why the first one ended.
            at_start: Whether the first one could not start. Then `cause` is the error, because
                the arguments are at fault.

        Raises:
            InputError: If a torque is not finite.
        """
        error = cause
        if not at_start:
            # A torque that is not finite ends a motion too. Then this check raises its error, which
            # is better than the one that is returned. Its result is the same tau.
            finite_array("tau", self.tau, self.tau.shape[-1:])
            error = SimulationError(
                f"the motion reached a singularity, diverged, or opened the loops: {cause}",
                time,
            )
        name_samples(error, stopped, batch)
        return error


@dataclass(frozen=True, eq=False)
class RolloutSamples:
    """The arguments of all M samples of a batch, with the samples in the first axis.

    Attributes:
        batch: Shape of the batch; M is the product of its lengths.
        q0: Starts, shape (M, nq).
        va0: Rates of the coordinates at the starts, shape (M, n).
        tau: Motor torques, shape (M, N or 2 N + 1, motors).
        motor_positions: Positions that motors hold, shape (M, N, motors), or None.
        wrenches: Wrenches on the bodies, shape (M, r, 6), or None.
        at_frames: Wrenches at frames, by name, shapes (M, 6).
    """

    batch: tuple[int, ...]
    q0: Array
    va0: Array
    tau: Array
    motor_positions: Array | None
    wrenches: Array | None
    at_frames: Mapping[str, Array]


def rollout_arguments(
    engine: Engine,
    tau: ArrayLike,
    q0: ArrayLike,
    va0: ArrayLike,
    dt: float,
    *,
    platform_moment: ArrayLike | None,
    external_wrenches: Wrenches | None,
    steps: int | None,
    threads: int,
    on_error: str,
) -> RolloutArguments:
    """Check the arguments of `ClosedChain.rollout` that smooth and nonsmooth rollouts share."""
    require_policy(on_error)
    mechanism = engine.mechanism
    mechanism.require_freedom()
    mechanism.require_mass()
    motors = len(mechanism.motor_names)
    torques = as_array("tau", tau, (motors,))
    if torques.ndim < 2:
        raise InputError("tau", f"shape {torques.shape}, expected (..., N, {motors})")
    at_frames = dict[str, Array]()
    on_bodies = external_wrenches
    if isinstance(external_wrenches, Mapping):
        on_bodies = None
        for name, wrench in external_wrenches.items():
            # The first value is the index of the frame; wrenches are collected by name here.
            _, at_frames[name] = engine.arguments.at_frame(name, wrench, "raise")
    return RolloutArguments(
        tau=torques,
        q0=as_array("q0", q0, (mechanism.model.nq,)),
        va0=as_array("va0", va0, (len(mechanism.coordinates),)),
        dt=float(single_array("dt", dt, ())),
        steps=None if steps is None else whole_number("steps", steps, 0),
        wrenches=engine.arguments.wrenches(platform_moment, on_bodies, "raise"),
        at_frames=at_frames,
        threads=whole_number("threads", threads, 1),
        raises=on_error == "raise",
    )
