# SPDX-License-Identifier: BSD-2-Clause
"""The compiled kernels of the SST as a backend of its chain.

A kernel vouches for the samples whose loops are clearly closed, which are clearly regular and
whose results are finite. The others go to the reference path, one by one: it raises its own error,
or finds the answer. The errors of both paths are the same by construction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..chain.backend import Backend, States
from ..chain.closures import Closure, Constraint
from ..chain.mechanism import Friction
from ..chain.reference import Reference, ReferenceBackend, ReferenceStates
from ..description import JOINT_NAMES
from . import kernels
from .kernels.packing import pack
from .kinematics import Geometry
from .topology import CUTS, geometry_of

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Index of the body that bears the loads on the star; the three arcs are one body.
STAR = JOINT_NAMES.index("beta_1")
#: |det A| = |det Phi^u|; the squares of the six singular values sum to 8, the largest is at most
#: 3. So the five largest have a product of at most (8/5)^(5/2), the smallest is at least
#: |det A| / 3.24, and the condition number at most 3.24 sqrt(3) / |det A|.
_CONDITION_TIMES_DET = 5.62


def backend(reference: Reference, model: pin.Model, off: str) -> Backend:
    """The kernels of one robot, or the reference path with the reason why it has none.

    Args:
        reference: Of its mechanism.
        model: The tree whose gravity the kernels watch.
        off: Why not to use kernels; empty to use them.
    """
    mechanism = reference.mechanism
    why = off or kernels.missing or misfit(mechanism.space.joint_names, mechanism.closures)
    if why or not mechanism.driven_one_to_one or not mechanism.springs.none:
        return ReferenceBackend(reference, why or "motors or springs are not those of an SST")
    geometry = geometry_of(mechanism.model, f"model {mechanism.model.name}")
    return StarKernels(reference, geometry, model)


def misfit(joint_names: tuple[str, ...], closures: tuple[Constraint, ...]) -> str:
    """What keeps a robot from the kernels, wherever they run; empty when nothing does."""
    if joint_names != JOINT_NAMES:
        return "the joints of the model stand in another order"
    cuts = [closure for closure in closures if isinstance(closure, Closure)]
    frames = {(closure.frame_a, closure.frame_b) for closure in cuts}
    kinds = {closure.kind for closure in cuts}
    if len(cuts) < len(closures) or frames != CUTS or not kinds <= {"6d", "orientation"}:
        return "the cuts are others than those of the shipped YAML"
    return ""


class StarKernels:
    """Dynamics of an SST by its kernels; their loads are moments on the star.

    Args:
        reference: Of its mechanism.
        geometry: Of its tree.
        model: The tree whose gravity they watch: when it changes they vouch for nothing.
    """

    def __init__(self, reference: Reference, geometry: Geometry, model: Any) -> None:
        self._reference, self._geometry = reference, geometry
        self._model = model
        own = self._with(reference.mechanism.friction)
        self._own = own
        self.torques_of = own.inverse_dynamics
        self.accelerations_of = own.direct_dynamics

    def __str__(self) -> str:
        assert kernels.binding is not None
        return f"compiled kernels: {kernels.binding.instructions}"

    def _with(self, friction: Friction) -> Any:
        assert kernels.binding is not None
        numbers = pack(self._reference.mechanism.model, self._geometry, friction)
        return kernels.binding.Kernels(numbers, self._model.gravity.linear, self._model)

    def torques(
        self, q: Array, va: Array, aa: Array, wrenches: Array | None, tau: Array, threads: int
    ) -> Indices:
        """Fill tau."""
        return self._fill(self._own.inverse_dynamics, (q, va, aa), wrenches, tau, threads)

    generalized_forces = torques

    def derivatives_of(self, name: str, sign_width: float) -> Any:
        """What leaves all to `ClosedChain`."""
        return lambda *arguments: None

    def derivatives(self, name: str, sign_width: float, q: Array, *arguments: Any) -> Indices:
        """All samples, for the reference path."""
        return np.arange(len(q))

    def displacement_rates(self, q: Array, va: Array, rows: Array, threads: int) -> Indices:
        """All samples, for the reference path."""
        return np.arange(len(q))

    def joint_rates(self, q: Array, va: Array, v: Array, threads: int) -> Indices:
        """All samples, for the reference path."""
        return np.arange(len(q))

    def frame_jacobian(self, frame: str, q: Array, J: Array, threads: int) -> Indices:
        """All samples, for the reference path."""
        return np.arange(len(q))

    def accelerations(
        self, q: Array, va: Array, tau: Array, wrenches: Array | None, aa: Array, threads: int
    ) -> Indices:
        """Fill aa."""
        return self._fill(self._own.direct_dynamics, (q, va, tau), wrenches, aa, threads)

    def reduced_terms(self, q: Array, va: Array, rows: Array, threads: int) -> Indices:
        """Fill rows of inertia, coriolis, gravity, friction."""
        return _left(self._own.reduced_terms(_rows(q), _rows(va), rows, threads), len(q))

    def states(self, friction: Friction) -> States:
        """The state space with a friction in the place of the mechanism's own."""
        return StarStates(self._reference, friction, self._with(friction))

    def _fill(
        self,
        kernel: Any,
        arrays: tuple[Array, ...],
        wrenches: Array | None,
        out: Array,
        threads: int,
    ) -> Indices:
        moment = None if wrenches is None else moment_of(wrenches)
        if wrenches is not None and moment is None:
            return np.arange(len(out))
        return _left(kernel(*map(_rows, arrays), moment, out, threads), len(out))


class StarStates(ReferenceStates):
    """The state space of an SST by its kernels; the reference path does what they leave.

    Args:
        reference: Of its mechanism.
        friction: In the place of the mechanism's own.
        kernels: Made with that friction.
    """

    def __init__(self, reference: Reference, friction: Friction, kernels: Any) -> None:
        super().__init__(reference, friction)
        self._kernels = kernels

    def closed(self, states: Array) -> Array:
        """As `ReferenceStates.closed`, by Newton's method."""
        q = states[..., :9]
        for _ in range(4):
            flags, q = self._kernels.close(q)
            if flags is None:  # it was closed to 1e-6 before this step: the next one is the last
                return self._kernels.close(q)[1]
        return super().closed(states)

    def rate(self, states: Array, tau: Array, wrenches: Array | None) -> Array:
        """As `ReferenceStates.rate`."""
        moment = None if wrenches is None else moment_of(wrenches)
        if wrenches is None or moment is not None:
            answer = self._kernels.rate(states, tau, moment)
            if answer is not None and answer[0] is None:
                return answer[1]
        return super().rate(states, tau, wrenches)

    def near_singularity(self, q: Array, limit: float) -> bool:
        """As `ReferenceStates.near_singularity`, from det A where that suffices."""
        det = abs(self._determinant(q))
        if det * limit > _CONDITION_TIMES_DET:
            return False
        return super().near_singularity(q, limit)

    def passes_singularity(self, before: Array, after: Array) -> bool:
        """Whether det A changes its sign."""
        return not self._determinant(before) * self._determinant(after) > 0

    def rollout(
        self,
        dt: float,
        q0: Array,
        va0: Array,
        tau: Array,
        wrenches: Array | None,
        q: Array,
        va: Array,
        threads: int,
    ) -> Indices:
        """As `ReferenceStates.rollout`, for loads on the star."""
        moment = None if wrenches is None else moment_of(wrenches)
        if wrenches is not None and moment is None:
            return super().rollout(dt, q0, va0, tau, wrenches, q, va, threads)
        reached = np.zeros(len(q), dtype=np.intp)
        self._kernels.rollout(dt, q0, va0, tau, moment, q, va, reached, threads)
        return reached

    def _determinant(self, q: Array) -> float:
        flags, det = self._kernels.determinant(q)
        return float(det[0]) if flags is None else float("nan")


def star_load(moment: Array) -> Array:
    """Wrenches on the nine bodies with a moment on the star, shape (..., 9, 6)."""
    wrenches = np.zeros((*moment.shape[:-1], 9, 6))
    wrenches[..., STAR, :3] = moment
    return wrenches


def moment_of(wrenches: Array) -> Array | None:
    """The moment that `star_load` has made these of; None when there is more in them."""
    moment = np.ascontiguousarray(wrenches[..., STAR, :3])
    others = np.count_nonzero(wrenches) - np.count_nonzero(moment)
    return None if others else moment


def _rows(array: Array) -> Array:
    return np.require(array, None, "A")


def _left(answer: Any, samples: int) -> Indices:
    if answer is None:
        return np.arange(samples)
    return np.flatnonzero(answer[0]) if answer[0] is not None else np.empty(0, dtype=np.intp)
