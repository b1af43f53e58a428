# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of the SST: loads on its star, compiled kernels in front of the reference path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import (
    as_array,
    finite_array,
    for_each_sample,
    require_policy,
    single_array,
    whole_number,
)
from ..chain.closed_chain import ClosedChain
from ..chain.closures import Closure
from ..chain.dynamics import Friction, ReducedTerms
from ..motion.mechanics import FastMechanics, Mechanics
from ..motion.rollouts import Course, Rollout, reference_course, rollout
from ..motion.simulation import Load, Torque, constant_or_called
from ..motion.trajectories import Trajectory
from .fast import FastPath, Fill
from .kinematics import Geometry, legs_of_joints

Array = NDArray[np.float64]


class StarDynamics(ClosedChain):
    """A `ClosedChain` that is an SST's: three motors, a star that carries loads.

    Args:
        model: Tree of an SST.
        closures: Of the SST.
        actuated: gamma_1, gamma_2, gamma_3.
        geometry: Of the SST.
        kernels: Whether compiled kernels compute the dynamics where they are at hand.
    """

    def __init__(
        self,
        model: pin.Model,
        closures: Sequence[Closure],
        actuated: Sequence[str],
        geometry: Geometry,
        kernels: bool,
    ) -> None:
        super().__init__(model, closures, actuated)
        self.geometry = geometry
        self._fast = FastPath(self, "" if kernels else "switched off by kernels=False")

    @property
    def path(self) -> str:
        """What computes the dynamics, and why: compiled kernels or the reference path."""
        return str(self._fast)

    def refresh(self) -> None:
        """Take in changes made to `model` since dynamics was first asked for.

        The kernels of single calls and batches work on numbers that are read from the model once:
        to look at one field of it costs as much as all of a call. `simulate` and `rollout` read
        them each time; the reference path needs no telling.
        """
        self._fast.forget()

    def compute_torques(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        platform_moment: ArrayLike | None = None,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """Inverse dynamics: the motor torques of a motion, Eq. (92).

        Args:
            q: Joint coordinates on the closures, shape (..., 9), [rad].
            va: Motor rates, shape (..., 3), [rad/s].
            aa: Motor accelerations, shape (..., 3), [rad/s^2].
            platform_moment: Moment that the surroundings exert on the star, base axes, shape
                (..., 3), [N m].
            external_wrenches: [moment; force] that the surroundings exert on each of the nine
                bodies at its mass centre, base axes, shape (..., 9, 6); takes the reference path.
            out: Array for the result, shape (..., 3).
            threads: How many share a batch; the reference path takes one.
            on_error: "raise", or "nan" for NaN in the place of samples at fault.

        Returns:
            tau, shape (..., 3), [N m].

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `ClosedChain.compute_torques`.
        """
        if on_error is not _RAISE:
            require_policy(on_error)
        if external_wrenches is None and self._fast.on:
            answer = self._fast.inverse_dynamics(q, va, aa, platform_moment, out, threads)
            if answer is not None and answer[0] is None:
                return answer[1]
            arrays = _rows(q=q, va=va, aa=aa, platform_moment=platform_moment)
            fill = self._fast.torques(threads)
            return self._with_care(fill, self._torques, arrays, out, on_error)
        whole_number("threads", threads, 1)
        if platform_moment is not None:
            external_wrenches = self.star_load(platform_moment, external_wrenches)
        return super().compute_torques(
            q, va, aa, external_wrenches=external_wrenches, out=out, on_error=on_error
        )

    def compute_accelerations(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        platform_moment: ArrayLike | None = None,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """Direct dynamics: motor accelerations under given torques, Eq. (92).

        Args:
            q: Joint coordinates on the closures, shape (..., 9), [rad].
            va: Motor rates, shape (..., 3), [rad/s].
            tau: Motor torques, shape (..., 3), [N m].
            platform_moment: As in `compute_torques`.
            external_wrenches: As in `compute_torques`.
            out: As in `compute_torques`.
            threads: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Returns:
            aa, shape (..., 3), [rad/s^2].

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.
        """
        if on_error is not _RAISE:
            require_policy(on_error)
        if external_wrenches is None and self._fast.on:
            answer = self._fast.direct_dynamics(q, va, tau, platform_moment, out, threads)
            if answer is not None and answer[0] is None:
                return answer[1]
            arrays = _rows(q=q, va=va, tau=tau, platform_moment=platform_moment)
            fill = self._fast.accelerations(threads)
            return self._with_care(fill, self._accelerations, arrays, out, on_error)
        whole_number("threads", threads, 1)
        if platform_moment is not None:
            external_wrenches = self.star_load(platform_moment, external_wrenches)
        return super().compute_accelerations(
            q, va, tau, external_wrenches=external_wrenches, out=out, on_error=on_error
        )

    def reduced_terms(
        self, q: ArrayLike, va: ArrayLike, *, threads: int = 1, on_error: str = "raise"
    ) -> ReducedTerms:
        """The equations of motion in the motor angles, for batches, Eqs. (93)-(96).

        Args:
            q: Joint coordinates on the closures, shape (..., 9), [rad].
            va: Motor rates, shape (..., 3), [rad/s].
            threads: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.
        """
        rows = for_each_sample(
            self._reduced_terms,
            _rows(q=q, va=va),
            (1, 1),
            (24,),
            on_error=on_error,
            fast=self._fast.reduced_terms(threads),
        )
        return ReducedTerms.of_rows(rows, 3)

    def _with_care(
        self,
        fill: Fill | None,
        reference: Callable[[Array, Array, Array, Array | None], Array],
        arrays: list[Array | None],
        out: Array | None,
        on_error: str,
    ) -> Array:
        """Any batch by the kernels, what they leave by the reference, with its errors."""

        def under(q: Array, va: Array, x: Array, moment: Array | None) -> Array:
            return reference(q, va, x, None if moment is None else self.star_load(moment))

        return for_each_sample(
            under, arrays, (1, 1, 1, 1), (3,), on_error=on_error, out=out, fast=fill
        )

    def simulate(
        self,
        torque: Torque,
        q0: ArrayLike,
        va0: ArrayLike,
        t: ArrayLike,
        *,
        platform_moment: Load = None,
        external_wrenches: Load = None,
        **options: Any,
    ) -> Trajectory:
        """Integrate the motion under given torques; see `sst_pin.simulation.simulate`.

        Args:
            torque: Of the motors.
            q0: Joint coordinates at t[0], on the closures, shape (9,).
            va0: Motor rates at t[0], shape (3,).
            t: Times at which the motion is wanted, shape (N,), [s].
            platform_moment: Moment on the star, base axes: callable (t, q, va) -> (3,), or a
                constant, shape (3,), [N m].
            external_wrenches: On each of the nine bodies: callable (t, q, va) -> (9, 6), or a
                constant.
            options: As in `sst_pin.simulation.simulate`.
        """
        load = external_wrenches
        if platform_moment is not None:
            moment, others = map(constant_or_called, (platform_moment, external_wrenches))

            def load(time: float, q: Array, va: Array) -> ArrayLike:
                on_star = single_array("platform_moment", moment(time, q, va), (3,))
                return self.star_load(on_star, others(time, q, va))

        return super().simulate(torque, q0, va0, t, external_wrenches=load, **options)

    def rollout(
        self, tau: ArrayLike, q0: ArrayLike, va0: ArrayLike, dt: float, **options: Any
    ) -> Rollout:
        """Integrate many motions with a fixed step; see `sst_pin.rollouts.rollout`."""
        return rollout(self, tau, q0, va0, dt, **options)

    def mechanics(self, friction: Friction) -> Mechanics:
        """As `ClosedChain.mechanics`, by the kernels where they are."""
        kernels = self._fast.kernels_with(friction)
        if kernels is None:
            return super().mechanics(friction)
        return FastMechanics(self, friction, kernels)

    def course(self, friction: Friction) -> Course:
        """What `rollout` runs, with a friction in the place of the robot's own."""
        kernels = self._fast.kernels_with(friction)
        return reference_course(self, friction) if kernels is None else kernels.rollout

    def side(self, q: Array) -> float:
        """det A at one configuration: its sign changes where the motors lose hold of the star."""
        return float(np.linalg.det(legs_of_joints(self.geometry, q).y_2))

    @property
    def _star(self) -> int:
        return int(self.model.getJointId("beta_1")) - 1

    def star_load(self, moment: ArrayLike, wrenches: ArrayLike | None = None) -> Array:
        """External wrenches with the star's load put on star_1; the three arcs are one body."""
        loads = self._wrenches(wrenches)
        moment = finite_array("platform_moment", moment, (3,))
        on_star = np.zeros((*moment.shape[:-1], 9, 6))
        on_star[..., self._star, :3] = moment
        return on_star if loads is None else on_star + loads

    def moment_of(self, load: Array) -> Array | None:
        """The moment that `star_load` has made this load of; None when there is more in it."""
        moment = load[..., self._star, :3]
        return moment if np.array_equal(load, self.star_load(moment)) else None


_RAISE = "raise"  # to be compared by identity, which costs a single call nothing
_CORE = {"q": (9,)} | dict.fromkeys(("va", "aa", "tau", "platform_moment"), (3,))


def _rows(**arrays: ArrayLike | None) -> list[Array | None]:
    """Arguments as aligned arrays of rows, (..., 9) for q and (..., 3) for the others."""
    return [
        None
        if value is None and name == "platform_moment"
        else np.require(as_array(name, value, _CORE[name]), None, "A")
        for name, value in arrays.items()
    ]
