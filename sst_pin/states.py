# SPDX-License-Identifier: BSD-2-Clause
"""The state space (q, va) of a mechanism, for integrators."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from .arrays import Array, Indices
from .dynamics import dynamics
from .dynamics.reference import Reference
from .dynamics.runge_kutta import runge_kutta_step
from .errors import SSTError
from .loops.continuity import Continuity, Path
from .loops.mobility import condition_number, scaled_Phi
from .model.mechanism import Friction
from .model.thresholds import (
    BEND,
    CLOSURE_TOLERANCE,
    MARGIN,
    MAX_CONDITION_NUMBER,
    WELL_CONDITIONED,
)
from .progress import counted

#: Displacement of a joint after which coordinates are judged again, [rad] or robot lengths.
_LOOK = 0.05

#: Condition number above which a rollout changes its coordinates: its steps do not get shorter near
#: a dead point. At 20, errors of a five-bar that often passes dead points are almost three times as
#: large; at 1 they are hardly smaller.
_FIXED_STEP = 10.0


class RolloutArrays(NamedTuple):
    """Arrays of N rollouts with a fixed step.

    Attributes:
        dt: Step, [s].
        q0: Starts, shape (N, nq).
        va0: Rates at the starts, shape (N, n).
        tau: Torques, shape (N, steps, motors), or at ends and middles, (N, 2 steps + 1, motors).
        load: Constant external wrenches, shape (N, 6 r), or None.
        q: Configurations to fill, shape (N, steps + 1, nq); NaN after the end.
        va: Rates to fill, shape (N, steps + 1, n).
    """

    dt: float
    q0: Array
    va0: Array
    tau: Array
    load: Array | None
    q: Array
    va: Array

    @property
    def steps(self) -> int:
        """Number of steps."""
        return self.q.shape[1] - 1

    @property
    def constant(self) -> bool:
        """Whether torques are constant in each step."""
        return self.tau.shape[1] == self.steps

    def torques(self, i: int, s: int) -> Array:
        """Torques at the start, in the middle and at the end of step s of rollout i."""
        return self.tau[i, [s] * 3 if self.constant else slice(2 * s, 2 * s + 3)]

    def rest(self, i: int, done: int) -> RolloutArrays:
        """Rollout i alone, from its state `done` on."""
        one = slice(i, i + 1)
        q0, va0 = (self.q[one, done], self.va[one, done]) if done else (self.q0[one], self.va0[one])
        tau = self.tau[one, (1 if self.constant else 2) * done :]
        load = None if self.load is None else self.load[one]
        q = self.q[one, done:]
        va = self.va[one, done:]
        return RolloutArrays(self.dt, q0.copy(), va0.copy(), tau, load, q, va)


class States:
    """The state space (q, va) of one mechanism, by the reference path.

    States are y = (q, va), shape (nq + n,) or (N, nq + n). Their dependent joints are near the
    closures, and their quaternions near length one. `friction` replaces that of the mechanism.

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
        self._others = dict[bytes, States]()

    def closed(self, states: Array) -> Array:
        """q with the dependent joints moved onto the closures, wheels rolling, shape (..., nq)."""
        if states.ndim == 1:
            q = self._mechanism.space.normalised(states[: self._nq])
            assembly = self._reference.context.without_slip
            return assembly.assemble(q, self._mechanism.dependent)
        return np.array([self.closed(state) for state in states])

    def rate(self, states: Array, tau: Array, wrenches: Array | None) -> Array:
        """Rates of states, Eqs. (7) and (92), after closing the loops, shape (..., nq + n)."""
        if states.ndim == 2:
            loads = [None] * len(states) if wrenches is None else wrenches
            samples = zip(states, tau, loads, strict=True)
            return np.array([self.rate(*sample) for sample in samples])
        q = self.closed(states)
        va = states[self._nq :]
        return self._rate(q, va, tau, wrenches, CLOSURE_TOLERANCE)

    def _rate(
        self, q: Array, va: Array, tau: Array, wrenches: Array | None, tolerance: float
    ) -> Array:
        context = self._reference.context
        arguments = (context, self._friction, q, va, tau, wrenches, tolerance)
        aa, v = dynamics.direct_dynamics(*arguments)
        return np.concatenate([self._mechanism.space.coordinate_rates(q, v), aa])

    def derivatives(self, state: Array, tau: Array, wrenches: Array | None) -> tuple[Array, Array]:
        """Derivatives of `rate` by the state and by tau, shapes (nq + n, nq + n), (nq + n, motors).

        The coordinates and their rates determine the state, so columns of other joints are zero.
        Where wheels roll, the state has more degrees of freedom, and this does not hold.
        """
        reference = self._reference
        space = self._mechanism.space
        nq = self._nq
        q = self.closed(state)
        va = state[nq:]
        n = len(va)
        loops = reference.context.loops
        aa_by = self._acceleration_derivatives(q, va, tau, wrenches)
        L = reference.L(q)
        v = L.dot(va)
        turns = np.array([space.coordinate_rates(q, e) for e in np.eye(len(L))]).T
        L_dot = reference.context.complement.L_dot
        v_q = np.transpose([L_dot(loops.Phi_dot(e)).dot(va) for e in L.T])
        rates_q, q_dot_va = turns.dot(v_q), turns.dot(L)
        if not space.euclidean:
            # Rates of positions are quadratic in q, so central differences are exact.
            ends = [[space.coordinate_rates(q + s * d, v) for s in (1, -1)] for d in q_dot_va.T]
            rates_q += np.transpose([(ahead - behind) / 2 for ahead, behind in ends])
        by_state = np.zeros((nq + n, nq + n))
        by_tau = np.zeros((nq + n, len(tau)))
        by_q = np.linalg.pinv(turns)[self._mechanism.coordinates]
        by_state[:, :nq] = np.vstack((rates_q, aa_by[:, :n])).dot(by_q)
        by_state[:, nq:] = np.vstack((q_dot_va, aa_by[:, n : 2 * n]))
        by_tau[nq:] = aa_by[:, 2 * n :]
        return by_state, by_tau

    def _acceleration_derivatives(
        self, q: Array, va: Array, tau: Array, wrenches: Array | None
    ) -> Array:
        """Derivatives of aa by q, va and tau side by side, shape (n, 2 n + motors)."""
        width = self._friction.sign_width
        return self._reference.acceleration_derivatives(q, va, tau, wrenches, width)

    def joint_rates(self, q: Array, va: Array) -> Array:
        """v of one state whose loops are closed, shape (nv,)."""
        return self._reference.rates(q, va)

    def joint_motion(self, q: Array, va: Array, aa: Array) -> tuple[Array, Array]:
        """v and v_dot of one state whose loops are closed, shapes (nv,)."""
        return self._reference.joint_motion(q, va, aa)

    def Phi(self, q: Array) -> Array:
        """Jacobian of the closures, free of units, shape (rows, nv)."""
        return scaled_Phi(self._mechanism, self._reference.context.loops, q)

    def condition_number(self, q: Array) -> float:
        """Condition number of the dependent part of Phi, infinite if it is singular."""
        return self._continuity.condition_number(q)

    def suited(self, q: Array, sound: float = WELL_CONDITIONED) -> tuple[States, float]:
        """States with good coordinates at q, and the condition number of these there.

        They are these states if their condition number is at most `sound` or no other rates are
        better by `MARGIN`; else states of the rates that describe motions at q best.
        """
        from scipy.linalg import qr

        condition = self.condition_number(q)
        if not condition > sound:
            return self, condition
        Phi = self.Phi(q)
        n = len(self.coordinates)
        if not np.isfinite(Phi).all():
            return self, condition
        # Motions of the smallest singular values: near a singularity more than n are free.
        motions = np.linalg.svd(Phi)[2][len(Phi.T) - n :]
        _, order = qr(motions, pivoting=True, mode="r")
        chosen = np.sort(order[:n]).astype(np.intp)
        parts = self._reference.context.loops.parts
        best, now = (
            condition_number(self._mechanism, Phi, parts(each))
            for each in (chosen, self.coordinates)
        )
        if not best * MARGIN < now:
            return self, condition
        key = chosen.tobytes()
        if key not in self._others:
            mechanism = replace(self._mechanism, coordinates=chosen)
            self._others[key] = States(Reference(mechanism), self._friction)
        return self._others[key], self._others[key].condition_number(q)

    def follow(
        self, start: Array, path: Path, limit: float, first: float = 1.0
    ) -> tuple[float, Array]:
        """The continuous and regular fraction of a step, and its end; as `Continuity.follow`."""
        return self._continuity.follow(start, path, limit, first)

    @property
    def _continuity(self) -> Continuity:
        return self._reference.context.continuity

    def _continues(self, before: Array, after: Array) -> bool:
        """Whether a step stays regular and in its assembly mode."""
        model = self._mechanism.model
        ahead = pin.difference(model, before, after)

        def path(q: Array, low: float, high: float) -> Array:
            return after if high == 1 else self.closed(pin.integrate(model, before, high * ahead))

        return self.follow(before, path, MAX_CONDITION_NUMBER)[0] == 1

    def rollout(self, motions: RolloutArrays, threads: int) -> Indices:
        """Fill q and va by the classical Runge-Kutta method; numbers of valid states, shape (N,).

        After each step the dependent joints are moved onto the closures. A motion ends where its
        loops open, at a singularity, or where a number is not finite.
        """
        indices = counted(range(len(motions.q)), "rollout", len(motions.q))
        return np.array([self._roll(motions, i)[0] for i in indices], dtype=np.intp)

    @np.errstate(over="ignore", invalid="ignore")  # a motion that diverges ends
    def _roll(self, motions: RolloutArrays, i: int, *, back: bool = False) -> tuple[int, bool]:
        """The number of valid states of motion i, and whether the motion can continue.

        Where rates of other joints describe the motion better, they are integrated. With `back` it
        returns where the coordinates describe it well again.
        """
        states = self
        q = motions.q[i]
        va = motions.va[i]
        q[:], va[:] = np.nan, np.nan
        load = None if motions.load is None else motions.load[i].reshape(-1, 6)
        state = np.concatenate([motions.q0[i], motions.va0[i]])
        before = motions.q0[i]
        done = 0
        for s in range(motions.steps + 1):
            q_s, rates = np.split(state, [self._nq])
            try:
                self._reference.context.evaluate(q_s)
                if not (np.isfinite(state).all() and (s == 0 or states._continues(before, q_s))):
                    break
                v = states.joint_rates(q_s, rates)
                q[s], va[s] = q_s, rates if states is self else v[self.coordinates]
                before = q_s
                done = s + 1
                suited = self._suited_ahead(q_s, motions.dt * v)
                if s == motions.steps or (back and s and suited is self):
                    return done, True
                if suited is not states:
                    states = suited
                    state = np.concatenate([q_s, v[suited.coordinates]])
                state, short = states._step(state, motions.torques(i, s), load, motions.dt)
                if not short:
                    break
            except SSTError:
                break
        return done, False

    def _suited_ahead(self, q: Array, step: Array) -> States:
        """These states, or much better ones for a fixed step from q by `step`, shape (nv,)."""
        longest = float(np.abs(step / self._mechanism.rate_scale).max(initial=0))
        parts = min(4, 1 + int(longest / _LOOK))
        for fraction in np.arange(1, parts + 1) / parts:
            ahead = pin.integrate(self._mechanism.model, q, fraction * step)
            suited, _ = self.suited(ahead, _FIXED_STEP)
            if suited is not self:
                return suited
        return self

    def _step(
        self, state: Array, tau: Array, wrenches: Array | None, h: float
    ) -> tuple[Array, bool]:
        """The state after one step, and whether the step is short enough for its curvature.

        Before its correction the end of the step is off the closures by an error of order h^5.
        """
        nq = self._nq
        model = self._mechanism.model
        space = self._mechanism.space

        def rate(when: int, stage: Array) -> Array:
            q = space.normalised(stage[:nq])
            return self._rate(q, stage[nq:], tau[when], wrenches, np.inf)

        end = runge_kutta_step(rate, state, h)
        q = self.closed(end)
        ways = [pin.difference(model, space.normalised(x[:nq]), q) for x in (end, state)]
        correction, length = np.abs(ways / self._mechanism.rate_scale).max(axis=1, initial=0)
        short = bool(correction <= BEND * length + CLOSURE_TOLERANCE)
        return np.concatenate([q, end[nq:]]), short
