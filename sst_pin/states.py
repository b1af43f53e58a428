# SPDX-License-Identifier: BSD-2-Clause
"""The state space of a mechanism, for integrators: states (q, va) and their rates.

The rates va of the coordinates determine the rates v of all joints, unless the configuration is
singular for this choice of coordinates: a dead point. Near one, an integrator goes on in other
coordinates; `StateSpace.in_good_coordinates` finds them. `StateSpace.rollout` is an integrator with
a fixed step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import isfinite
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from .arrays import Array, Indices
from .dynamics import dynamics
from .dynamics.reference import Reference
from .dynamics.rollout_arrays import RolloutArrays
from .dynamics.runge_kutta import runge_kutta_step
from .errors import SingularConfigurationError, SSTError
from .loops.continuity import Continuity, Path
from .loops.ranks import condition_number, scaled_Phi
from .model.mechanism import Friction
from .model.thresholds import (
    BEND,
    CLOSURE_TOLERANCE,
    MARGIN,
    MAX_CONDITION_NUMBER,
    WELL_CONDITIONED,
)
from .progress import counted

#: Condition number above which steps of fixed length change their coordinates: they do not get
#: shorter near a dead point. A choice: at 20, errors of a five-bar that often passes dead points
#: are almost three times as large; at 1 they are hardly smaller.
LARGEST_AT_FIXED_STEP = 10.0
#: The coordinates are judged at the ends of parts of a step, in which no joint moves by more than
#: this, [rad] or robot lengths. A choice: at the distance d from a dead point the condition number
#: is c / d, and c is about 7 and 10 for two four-bars. Already with c = 1 it is above
#: `LARGEST_AT_FIXED_STEP`, which is 10, where d is below 0.1. This range of d is longer than a part
#: of 0.05, so the end of some part lies in it.
_PART_OF_STEP = 0.05
#: The most parts of a step; a choice, as each part costs an evaluation of Phi. In a step of more
#: than 4 * 0.05 = 0.2 the parts are longer, and a dead point between the ends of two parts may not
#: be noticed. Then `require_continuous` refuses the step, and the motion ends.
_MOST_PARTS = 4
#: The text of a `StepError` for a motion that diverges.
NOT_FINITE = "a number is not finite; a shorter step may help"

#: External wrenches on the bodies, shape (r, 6), as a function of the index of a motion and of q.
WrenchesAt = Callable[[int, Array], Array]
#: The same for one motion, as a function of q; its result is None without external wrenches.
WrenchesOfMotion = Callable[[Array], Array | None]


class StepError(SSTError):
    """A step of fixed length failed; the text says why."""


class RolloutEnd(NamedTuple):
    """Where a rollout ended.

    Attributes:
        valid: Number of valid states.
        error: Why the motion cannot continue from the last one; None if it can.
    """

    valid: int
    error: SSTError | None


class _PositionDerivatives(NamedTuple):
    """Derivatives of q and q_dot by displacements x of the coordinates, with closed loops.

    Attributes:
        q_by_x: dq/dx, shape (nq, n).
        x_by_q: dx/dq, shape (n, nq).
        q_dot_by_x: d(q_dot)/dx for constant rates va, shape (nq, n).
    """

    q_by_x: Array
    x_by_q: Array
    q_dot_by_x: Array


class StateSpace:
    """The state space of one mechanism in one choice of coordinates, by the reference path.

    States are y = (q, va), shape (nq + n,) or (N, nq + n). Integrators make them: so their loops
    are nearly closed, and their quaternions have almost length one.

    `compiled_states.CompiledStateSpace` derives from this class. Its kernels compute the same as
    `closed`, `rate`, `_rate_at_closed`, `_acceleration_derivatives` and `rollout`. It calls these
    methods where kernels fail, and `_fill` for steps that kernels do not make.

    Args:
        reference: The mechanism with its equations.
        friction: Friction of the joints, in place of that of the mechanism.

    Attributes:
        coordinates: Indices in v of the rates va.
    """

    def __init__(self, reference: Reference, friction: Friction) -> None:
        reference.mechanism.require_freedom()
        reference.mechanism.require_mass()
        self._reference = reference
        self._mechanism = reference.mechanism
        self._friction = friction
        self._nq = reference.mechanism.model.nq
        self.coordinates = reference.mechanism.coordinates
        #: State spaces in other coordinates that were needed before, by the bytes of their indices.
        self._others = dict[bytes, StateSpace]()

    # --- the equations of motion ------------------------------------------------------------

    def closed(self, states: Array) -> Array:
        """q of states with closed loops, shape (..., nq).

        Only dependent joints are moved. Wheels that are moved roll without slip.
        """
        if states.ndim == 2:
            return np.array([self.closed(state) for state in states])
        q = self._mechanism.space.normalised(states[: self._nq])
        assembly = self._reference.context.without_slip
        return assembly.assemble(q, self._mechanism.dependent)

    def rate(self, states: Array, tau: Array, wrenches: Array | None) -> Array:
        """Rates of states, Eqs. (7) and (92), after closing the loops, shape (..., nq + n)."""
        if states.ndim == 2:
            loads = [None] * len(states) if wrenches is None else wrenches
            samples = zip(states, tau, loads, strict=True)
            return np.array([self.rate(*sample) for sample in samples])
        q = self.closed(states)
        va = states[self._nq :]
        return self._rate_at_closed(q, va, tau, wrenches, CLOSURE_TOLERANCE)

    def _rate_at_closed(
        self, q: Array, va: Array, tau: Array, wrenches: Array | None, tolerance: float
    ) -> Array:
        """Rates of one state whose loops are closed up to a tolerance, shape (nq + n,)."""
        aa, v = dynamics.direct_dynamics(
            self._reference.context, self._friction, q, va, tau, wrenches, tolerance
        )
        return np.concatenate([self._mechanism.space.q_dot(q, v), aa])

    def derivatives(self, state: Array, tau: Array, wrenches: Array | None) -> tuple[Array, Array]:
        """Derivatives of `rate` by the state and by tau, shapes (nq + n, nq + n), (nq + n, motors).

        The rate is (q_dot, aa). Small displacements x of the coordinates, along motions that keep
        the loops closed, determine q. So the rate is differentiated by x first. Its derivative by q
        is d(rate)/dx dx/dq. The columns of dependent joints are zero. Where wheels roll, x does not
        determine q, and the result is not exact.
        """
        q = self.closed(state)
        va = state[self._nq :]
        n = len(va)
        aa_by = self._acceleration_derivatives(q, va, tau, wrenches)
        aa_by_x, aa_by_va, aa_by_tau = np.split(aa_by, [n, 2 * n], axis=1)
        positions = self._position_derivatives(q, va)

        by_state = np.zeros((self._nq + n, self._nq + n))
        by_state[: self._nq, : self._nq] = positions.q_dot_by_x.dot(positions.x_by_q)
        by_state[: self._nq, self._nq :] = positions.q_by_x  # as q_dot = (dq/dx) va
        by_state[self._nq :, : self._nq] = aa_by_x.dot(positions.x_by_q)
        by_state[self._nq :, self._nq :] = aa_by_va
        by_tau = np.zeros((self._nq + n, len(tau)))
        by_tau[self._nq :] = aa_by_tau
        return by_state, by_tau

    def _position_derivatives(self, q: Array, va: Array) -> _PositionDerivatives:
        """Derivatives of q and q_dot by displacements x of the coordinates, with constant va.

        With v = L va, Eq. (16), and q_dot = Q v, the derivative dq/dx is Q L. Q is the identity
        unless q has quaternions or cosines.
        """
        space = self._mechanism.space
        context = self._reference.context
        # This also evaluates `context.loops` and `context.complement` at q, for L_dot below.
        L = self._reference.L(q)
        v = L.dot(va)
        Q = np.transpose([space.q_dot(q, e) for e in np.eye(len(v))])  # columns Q e_k
        q_by_x = Q.dot(L)

        # d(Q v)/dx = Q dv/dx + dQ/dx v. Column k of dv/dx is the rate of v = L va in a motion of
        # coordinate k alone, v_k = L e_k: it is L_dot(v_k) va.
        v_by_x = np.zeros_like(L)
        for k, rates in enumerate(L.T):
            L_dot = context.complement.L_dot(context.loops.Phi_dot(rates))
            v_by_x[:, k] = L_dot.dot(va)
        q_dot_by_x = Q.dot(v_by_x)
        if not space.euclidean:
            # dQ/dx v. For constant v, Q v is a polynomial in q: linear in quaternions, and of
            # degree two where a quaternion turns a velocity. So central differences are exact, also
            # of long steps. `q_dot` takes quaternions as they are, so they need no unit length.
            for k, displacement in enumerate(q_by_x.T):
                ahead = space.q_dot(q + displacement, v)
                behind = space.q_dot(q - displacement, v)
                q_dot_by_x[:, k] += (ahead - behind) / 2

        x_by_q = np.linalg.pinv(Q)[self.coordinates]  # v = pinv(Q) q_dot
        return _PositionDerivatives(q_by_x, x_by_q, q_dot_by_x)

    def _acceleration_derivatives(
        self, q: Array, va: Array, tau: Array, wrenches: Array | None
    ) -> Array:
        """Derivatives of aa by x, va and tau side by side, shape (n, 2 n + motors)."""
        width = self._friction.sign_width
        return self._reference.acceleration_derivatives(q, va, tau, wrenches, width)

    def joint_rates(self, q: Array, va: Array) -> Array:
        """v of one state whose loops are closed, shape (nv,)."""
        return self._reference.rates(q, va)

    def joint_motion(self, q: Array, va: Array, aa: Array) -> tuple[Array, Array]:
        """v and v_dot of one state whose loops are closed, shapes (nv,)."""
        return self._reference.joint_motion(q, va, aa)

    # --- the coordinates ------------------------------------------------------------------------

    def Phi(self, q: Array) -> Array:
        """Jacobian of the closures, free of units, shape (rows, nv)."""
        return scaled_Phi(self._mechanism, self._reference.context.loops, q)

    def condition_number(self, q: Array) -> float:
        """Condition number of the dependent part of Phi, infinite if it is singular."""
        return self._continuity.condition_number(q)

    def in_good_coordinates(
        self, q: Array, largest: float = WELL_CONDITIONED
    ) -> tuple[StateSpace, float]:
        """The state space in good coordinates at q, and their condition number there.

        It is this state space if its condition number is at most `largest`. It is another one if
        that has a condition number smaller by the factor `MARGIN`.
        """
        condition = self.condition_number(q)
        if condition <= largest:
            return self, condition
        Phi = self.Phi(q)
        if not np.isfinite(Phi).all():
            return self, condition
        best = _best_coordinates(Phi, len(self.coordinates))
        # `condition` is that of the diagonal blocks of Phi for the present coordinates, see
        # `Continuity`. The diagonal blocks for the best coordinates are not known yet, and
        # condition numbers of different blocks cannot be compared. So both choices are compared by
        # larger blocks, `Loops.parts`. These are the parts of Phi that share no row and no
        # dependent rate, and are known for any coordinates.
        parts = self._reference.context.loops.parts
        best_condition = condition_number(self._mechanism, Phi, parts(best))
        present_condition = condition_number(self._mechanism, Phi, parts(self.coordinates))
        if best_condition * MARGIN >= present_condition:
            return self, condition
        other = self._in_coordinates(best)
        return other, other.condition_number(q)

    def _in_coordinates(self, coordinates: Indices) -> StateSpace:
        """The state space of the same mechanism in other coordinates."""
        key = coordinates.tobytes()
        if key not in self._others:
            mechanism = replace(self._mechanism, coordinates=coordinates)
            self._others[key] = StateSpace(Reference(mechanism), self._friction)
        return self._others[key]

    def follow(
        self, start: Array, path: Path, limit: float, first: float = 1.0
    ) -> tuple[float, Array]:
        """The fraction of a step that is continuous and regular, and the configuration at its end.

        Args:
            start: The configuration at the start of the step.
            path: The configuration at a fraction of the step; see `Path`.
            limit: Largest condition number of a regular configuration.
            first: The fraction of the step that is tried first, for instance where the motion
                reverses.
        """
        return self._continuity.follow(start, path, limit, first)

    @property
    def _continuity(self) -> Continuity:
        return self._reference.context.continuity

    # --- rollouts with a fixed step -------------------------------------------------------------

    def start_rates(self, q: Array, va: Array) -> Array:
        """v at the start of a motion, shape (nv,); at rest it is 0 in singular coordinates too.

        Raises:
            ClosureError: If the loops are open.
            SingularConfigurationError: If the coordinates do not determine v.
        """
        try:
            return self.joint_rates(q, va)
        except SingularConfigurationError:
            if va.any():
                raise
            return np.zeros(self._mechanism.model.nv)

    def rollout(
        self, motions: RolloutArrays, threads: int, wrenches_at: WrenchesAt | None
    ) -> Indices:
        """Fill q and va of N motions by the classical Runge-Kutta method.

        After each step the dependent joints are moved onto the closures. A motion ends where its
        loops open, at a singularity, or where a number is not finite.

        Args:
            motions: Starts, torques and loads of the motions, and the arrays to be filled.
            threads: Only kernels use it.
            wrenches_at: External wrenches that replace the constant loads of `motions`.

        Returns:
            For each motion, the number of its valid states, shape (N,).
        """
        valid = np.zeros(len(motions.q), dtype=np.intp)
        for i in counted(range(len(motions.q)), "rollout", len(motions.q)):
            wrenches = wrenches_of(motions, i, wrenches_at)
            valid[i] = self._fill(motions, i, wrenches).valid
        return valid

    @np.errstate(over="ignore", invalid="ignore")  # a motion that diverges ends
    def _fill(
        self,
        motions: RolloutArrays,
        i: int,
        wrenches: WrenchesOfMotion,
        *,
        until_good: bool = False,
    ) -> RolloutEnd:
        """Fill the states of motion i as far as it goes, and the rest with NaN.

        With `until_good` it makes at least one step, and returns as soon as the coordinates of this
        state space are good. Then kernels, which compute in these coordinates, continue the motion.
        """
        q = motions.q[i]
        va = motions.va[i]
        q[:] = np.nan
        va[:] = np.nan
        try:
            v = self.start_rates(motions.q0[i], motions.va0[i])
        except SSTError as error:
            return RolloutEnd(0, error)
        q[0] = motions.q0[i]
        va[0] = motions.va0[i]

        # `space` is a state space in good coordinates, and `rates` are the rates of these. `v` are
        # the rates of all joints, and `va` those of the coordinates of this state space.
        space = self
        rates = va[0]
        for s in range(motions.steps):
            try:
                good_space = self._space_for_step(q[s], motions.dt * v)
                if until_good and s > 0 and good_space is self:
                    return RolloutEnd(s + 1, None)
                if good_space is not space:
                    space = good_space
                    rates = v[space.coordinates]
                tau = motions.torques(i, s)  # at the start, middle and end, shape (3, motors)
                q[s + 1], rates = space._step(q[s], rates, tau, wrenches, motions.dt)
                v = space.joint_rates(q[s + 1], rates)
            except SSTError as error:
                q[s + 1] = np.nan
                return RolloutEnd(s + 1, error)
            va[s + 1] = rates if space is self else v[self.coordinates]
        return RolloutEnd(motions.steps + 1, None)

    def why_ended(
        self, motions: RolloutArrays, i: int, valid: int, wrenches_at: WrenchesAt | None
    ) -> SSTError:
        """Why motion i ended after some valid states: the error of one more try from the last one.

        `rollout` by kernels returns no error. The try is on the reference path.
        """
        last = max(valid - 1, 0)
        rest = motions.rest(i, last)  # motion i alone
        # The new try gets arrays of its own: the states of `motions` stay.
        rest = rest._replace(q=np.empty_like(rest.q), va=np.empty_like(rest.va))
        end = self._fill(rest, 0, wrenches_of(motions, i, wrenches_at))
        return end.error or StepError("the kernels and the reference path disagree")

    def _space_for_step(self, q: Array, step: Array) -> StateSpace:
        """This state space if its coordinates are good along a step from q; else a much better one.

        `step` are displacements of all joints, shape (nv,). The coordinates are judged at several
        configurations ahead of q, because the step gets no shorter near a dead point.

        Raises:
            StepError: If the step is not finite.
        """
        longest = float(np.abs(step / self._mechanism.rate_scale).max(initial=0))
        if not isfinite(longest):
            raise StepError(NOT_FINITE)
        count = min(_MOST_PARTS, 1 + int(longest / _PART_OF_STEP))  # of parts of the step
        for k in range(1, count + 1):
            ahead = pin.integrate(self._mechanism.model, q, k / count * step)
            good_space, _ = self.in_good_coordinates(ahead, LARGEST_AT_FIXED_STEP)
            if good_space is not self:
                return good_space
        return self

    def _step(
        self,
        q: Array,
        va: Array,
        tau: Array,
        wrenches: WrenchesOfMotion,
        h: float,
    ) -> tuple[Array, Array]:
        """q and va after a step h of the classical Runge-Kutta method.

        `tau` are the torques at its start, in its middle and at its end, shape (3, motors).

        Raises:
            StepError: If the step is too long, diverges, or leaves the assembly mode.
            ClosureError, SingularConfigurationError: At a stage, or at the end.
        """
        space = self._mechanism.space
        nq = self._nq

        def rate(when: int, stage: Array) -> Array:
            if not isfinite(stage.dot(stage)):
                raise StepError(NOT_FINITE)
            q = space.normalised(stage[:nq])
            # Loops at a stage are open by the error of the method. Only the end is closed, because
            # closing takes long. So the tolerance of the loops is infinite here.
            return self._rate_at_closed(q, stage[nq:], tau[when], wrenches(q), np.inf)

        end = runge_kutta_step(rate, np.concatenate([q, va]), h)
        if not isfinite(end.dot(end)):
            raise StepError(NOT_FINITE)
        closed = self.closed(end)
        self._require_short(q, space.normalised(end[:nq]), closed)
        self.require_continuous(q, closed)
        return closed, end[nq:]

    def _require_short(self, before: Array, predicted: Array, closed: Array) -> None:
        """Refuse a step that is too long for the curvature of the closures.

        A step h leads from the configuration `before` to `predicted`, whose loops are open by an
        error of order h^5. The configuration `closed` is the predicted one with closed loops.
        """
        # `BEND` is the largest correction, as a fraction of the length of the step.
        correction = self._largest_displacement(predicted, closed)
        length = self._largest_displacement(before, closed)
        if correction > BEND * length + CLOSURE_TOLERANCE:
            raise StepError(
                "the step is too long for the curvature of the motion: a joint moves by "
                f"{length:.2g} rad or robot lengths in it; shorten dt, or use simulate, which "
                "adapts its steps"
            )

    def _largest_displacement(self, before: Array, after: Array) -> float:
        """The largest displacement of a joint, [rad] or robot lengths."""
        displacement = pin.difference(self._mechanism.model, before, after)
        return float(np.abs(displacement / self._mechanism.rate_scale).max(initial=0))

    def require_continuous(self, before: Array, after: Array) -> None:
        """Refuse a step that passes a singular configuration or changes the assembly mode.

        Raises:
            StepError: If it does.
        """
        if not self._continues(before, after):
            raise StepError("the loops are singular, or change their assembly mode")

    def _continues(self, before: Array, after: Array) -> bool:
        """Whether a step between closed configurations stays regular and in its assembly mode.

        Its path is a straight line in all joints, moved onto the closures.
        """
        model = self._mechanism.model
        displacement = pin.difference(model, before, after)

        # `follow` calls it with the configuration at the fraction `low` of the step too, which this
        # path does not need.
        def path(_q_at_low: Array, _low: float, high: float) -> Array:
            """The configuration at the fraction `high` of the step."""
            if high == 1:
                return after
            return self.closed(pin.integrate(model, before, high * displacement))

        fraction, _ = self.follow(before, path, MAX_CONDITION_NUMBER)
        return fraction == 1


def wrenches_of(motions: RolloutArrays, i: int, wrenches_at: WrenchesAt | None) -> WrenchesOfMotion:
    """Wrenches on the bodies in motion i, as a function of q: `wrenches_at` or a constant load."""
    if wrenches_at is not None:
        return partial(wrenches_at, i)
    constant = None if motions.load is None else motions.load[i].reshape(-1, 6)
    return lambda q: constant


def _best_coordinates(Phi: Array, n: int) -> Indices:
    """Indices of the n rates that describe the motions with Phi v = 0 best.

    The motions are spanned by the right singular vectors of the n smallest singular values. (Close
    to a singularity more than n values are small, so that no threshold could find the n.) A QR
    decomposition with pivoting of these vectors finds the n rates that are most independent.
    """
    from scipy.linalg import qr

    _, _, Vt = np.linalg.svd(Phi)
    motions = Vt[Phi.shape[1] - n :]
    _, order = qr(motions, pivoting=True, mode="r")
    return np.sort(order[:n]).astype(np.intp)
