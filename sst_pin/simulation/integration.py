# SPDX-License-Identifier: BSD-2-Clause
"""The integration of a motion in coordinates that are chosen again where they get bad."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import cache, partial
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import ClosureError, InputError, SimulationError, SingularConfigurationError, SSTError
from ..model.mechanism import Mechanism
from ..model.thresholds import MARGIN, WELL_CONDITIONED
from ..states import States
from .crossings import Course, Crossing, crossing_of, gauss_step, mismatch
from .sampled_torques import Sampling

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver


#: Condition number above which other coordinates are looked for.
_POOR = 50.0
#: Steps of differences, relative or [rad], [m] and per second.
_DIFFERENCE = 1e-8
#: A step that is not regular is tried again with its regular part, or this part of it at least;
#: a motion ends where this leads to such a part of its time.
_SHORTER, _STUCK = 0.25, 1e-12
#: A step that is cut ends before the place by this part of it, ten times more at each new cut.
_SHY = 1e-10
#: How much the change of the rates in a step may differ from the integral of aa, relative.
_ALIKE = 1e-3
#: Tolerances are not made finer than this.
_FINEST = 1e-12
#: Nor finer than so many roundings of the largest position, after many turns.
_ROUNDINGS = 16
#: States by which a motion is continued over a singular configuration, apart by this factor of
#: their times left at least.
_NODES, _SPREAD = 6, 1.5
#: The step over a singular configuration begins when the time left is so many times that at which
#: the configuration is noticed: next to it, accelerations are noisy.
_EARLIER = 4.0
#: The middle of this step is so near to the configuration, relative to half the step, after so many
#: steps at most.
_CENTRED, _STEPS = 0.01, 3
#: How exactly the motion on the far side continues that before, relative to the way between them,
#: or in tolerances of the integrator.
_EXACT, _TOLERANCES = 1e-7, 100.0


class Input(NamedTuple):
    """What acts on a robot in motion."""

    #: Its value at a time, where the last argument gives q and va.
    at: Callable[[float, Callable[[], tuple[Array, Array]]], Array]
    #: Its values at times (N,), for q (N, nq) and va (N, n).
    along: Callable[[Array, Array, Array], Array]
    #: What it holds constant from one time to the next, if it does.
    sampling: Sampling | None = None
    #: Times that no step passes two of, as it may change there, shape (N,).
    times: Array | None = None
    #: Whether it is a function or samples, which a step may miss.
    varies: bool = False


class Motion:
    """Eqs. (7) and (92) as y' = f(t, y), y = (q, rates of the coordinates of `states`).

    `own` are the states in the robot's coordinates, which torques and loads are functions of.
    """

    def __init__(self, own: States, torque: Input, load: Input | None) -> None:
        self.own = self.states = own
        self.torque, self.load = torque, load
        self.failure: SSTError | None = None
        self.close_first = False
        self._last = np.zeros(())

    def seen(self, state: Array) -> tuple[Array, Array]:
        """q with closed loops, and the rates of the robot's coordinates."""
        q = self.states.closed(state)
        va = state[len(q) :]
        if self.states is not self.own:
            va = self.states.joint_rates(q, va)[self.own.coordinates]
        return q, va

    def _inputs(self, time: float, state: Array) -> tuple[Array, Array | None]:
        where = partial(self.seen, state)
        load = None if self.load is None else self.load.at(time, where)
        return self.torque.at(time, where), load

    def rate(self, time: float, state: Array) -> Array:
        """The rates of a state; NaN where the loops cannot be closed."""
        if not isfinite(state.dot(state)):
            return np.full_like(state, np.nan)
        try:
            if self.close_first:
                q = self.states.closed(state)
                state = np.concatenate([q, state[len(q) :]])
            return self.states.rate(state, *self._inputs(time, state))
        except InputError:
            raise  # the caller's torque is at fault
        except SSTError as error:
            # A trial step went too far; the integrator answers NaN with a shorter one.
            self.failure = error
            return np.full_like(state, np.nan)

    def whole(self, time: float, state: Array) -> tuple[Array, Array, Array]:
        """q with closed loops, v and v_dot of all joints."""
        q = self.states.closed(state)
        va, state = state[len(q) :], np.concatenate([q, state[len(q) :]])
        aa = self.states.rate(state, *self._inputs(time, state))[len(q) :]
        return q, *self.states.joint_motion(q, va, aa)

    def along(self, times: Array, states: Array) -> tuple[Array, Array, Array, Array]:
        """q, va, aa of the robot's coordinates, and torques, at times and states of the motion."""
        q = self.states.closed(states)
        rates = va = states[:, q.shape[1] :]
        if self.states is not self.own:
            coordinates = self.own.coordinates
            v = [self.states.joint_rates(*x) for x in zip(q, rates, strict=True)]
            va = np.array(v)[:, coordinates]
        tau = self.torque.along(times, q, va)
        load = None if self.load is None else self.load.along(times, q, va)
        aa = self.states.rate(states, tau, load)[:, q.shape[1] :]
        if self.states is not self.own:
            v_dot = [self.states.joint_motion(*x)[1] for x in zip(q, rates, aa, strict=True)]
            aa = np.array(v_dot)[:, coordinates]
        return q, va, aa, tau

    def jacobian(self, time: float, state: Array) -> Array:
        """Derivatives of the rate by the state; a callable torque's own ones by differences."""
        if not self._last.shape:
            self._last = np.zeros((len(state), len(state)))
        if not isfinite(state.dot(state)):
            return self._last
        try:
            tau, load = self._inputs(time, state)
            by_state, by_tau = self.states.derivatives(state, tau, load)
            steps = _DIFFERENCE * np.maximum(1, np.abs(state))
            moved = state + np.diag(steps)
            ahead = [self.torque.at(time, partial(self.seen, y)) for y in moved]
            self._last = by_state + by_tau.dot(((ahead - tau) / steps[:, None]).T)
        except InputError:
            raise
        except SSTError as error:  # a trial state went too far: the last Jacobian serves there
            self.failure = error
        return self._last


#: A time, the coordinates and the state.
Node = tuple[float, States, Array]


class Run:
    """One integration, step by step; it ends before a singularity, or goes through it.

    `stopped` says why it ended before the last time, `crossings` what it went through, `missed`
    where it stepped over a torque or load.
    """

    def __init__(
        self,
        motion: Motion,
        mechanism: Mechanism,
        method: str,
        options: dict[str, Any],
        limit: float,
        progress: Callable[[float], None] | None,
        through: bool,
        max_step: float,
    ) -> None:
        from scipy import integrate

        self._motion, self._solver, self._options = motion, getattr(integrate, method), options
        self._mechanism, self._most, self._through = mechanism, limit, through
        self._max_step, self.missed = max_step, ""
        self._varies = any(x.varies for x in (motion.torque, motion.load) if x)
        self._progress = progress or (lambda time: None)
        self._stride, self._limit, self._left, self._noticed = np.inf, 0.0, 0.0, -np.inf
        self._nodes = deque[Node](maxlen=3 * _NODES)
        self.stopped, self._why, self.crossings = "", "", list[Crossing]()

    @np.errstate(over="ignore", invalid="ignore")  # a motion that diverges ends
    def integrate(self, times: Array, start: Array) -> list[Array]:
        """q, va, aa of the robot's coordinates and torques, at the times reached."""
        motion, self._times, self._t = self._motion, times, float(times[0])
        if not np.isfinite(motion.rate(self._t, start)).all():
            why = motion.failure or "its rates are not finite"
            raise SimulationError(f"the motion cannot start ({why})", self._t)
        self._q = motion.own.closed(start)
        self._state, self._bounds = start, [float(times[-1])]
        self._settle()
        self._sample()
        self._parts, self._done = [motion.along(times[:1], self._state[None])], 1
        self._progress(self._t)
        while self._t < times[-1] and not self.stopped:
            motion.close_first = len(self._bounds) > 1
            if self._t < self._bounds[0]:
                self._advance(min(self._bounds[0], self._sample()))
            if self._t >= self._bounds[0] < times[-1]:
                self._bounds.pop(0)
                if len(self._bounds) == 1 and not self._cross():
                    nearer = self._t + self._left / 2
                    if nearer <= self._noticed:
                        self._left /= 2
                        self._bounds.insert(0, nearer)
        return [np.concatenate(part) for part in zip(*self._parts, strict=True)]

    def _sample(self) -> float:
        """Let sampled torques see the state, and say until when they are constant."""
        sampling = self._motion.torque.sampling
        if sampling is None:
            return np.inf
        sampling.reach(self._t, partial(self._motion.seen, self._state))
        return sampling.until(self._times)

    def _advance(self, bound: float) -> None:
        """Go on to a time, or until other coordinates are needed."""
        motion, states, cuts = self._motion, self._motion.states, 0
        solver = self._begin(bound)
        self._nodes.append((self._t, states, self._state))
        while solver.status == "running" and states is motion.states:
            solver.max_step = self._longest(solver.t)
            message = solver.step()
            if solver.status == "failed":
                why = motion.failure or message
                raise SimulationError(f"the integrator stopped ({why})", float(solver.t))
            held = motion.torque.sampling is not None and solver.t == bound
            # A step that ends where torques change could have been longer.
            longer = self._stride if held and self._stride < np.inf else 0.0
            self._stride = max(solver.step_size, longer)
            self._progress(float(solver.t))
            t, (fraction, q) = float(solver.t), self._follow(solver, self._q)
            # Where torques change, results are those of the new ones.
            until = np.nextafter(t, -np.inf) if held and t < self._times[-1] else t
            if fraction == 1 and not self._keep(solver, until):
                fraction = 0.5
            if fraction < 1:
                t = float(solver.t_old + fraction * (t - solver.t_old))
                self._stride *= max(fraction, _SHORTER)
                if self._approaches(t, q):
                    return
                # A part of a step is less exact than a step: integrate anew until there.
                t -= (t - self._t) * min(0.5, _SHY * 10**cuts)
                if t > self._t:
                    solver, cuts = self._begin(t), cuts + 1
                    continue
            else:
                self._t, self._q, self._state = t, q, solver.y
                self._nodes.append((t, states, solver.y))
            if fraction < 1 or (cuts and solver.status == "finished"):
                self._settle(irregular=True)
                return
            better = states is not motion.own and motion.own.condition_number(q) < WELL_CONDITIONED
            calm = len(self._bounds) == 1 and self._limit > _POOR
            if better or (calm and states.condition_number(q) * MARGIN**2 < self._limit):
                self._settle()

    def _longest(self, t: float) -> float:
        """The longest step from a time on that misses no change of a torque or load."""
        longest = self._max_step
        for times in (x.times for x in (self._motion.torque, self._motion.load) if x):
            if times is not None:
                k = min(int(times.searchsorted(t, "right")), len(times) - 1)
                spacing = times[k] - times[k - 1]
                longest = min(longest, spacing, times[min(k + 1, len(times) - 1)] - t)
        return longest

    def _begin(self, bound: float) -> OdeSolver:
        """An integrator from the present state to a time."""
        first = min(self._stride, bound - self._t) if self._stride < np.inf else None
        # Errors of the coordinates are those of other joints, divided by their condition number.
        exact = MARGIN * self._motion.states.condition_number(self._q)
        options = self._options | {
            name: max(self._options[name] / exact, min(self._options[name], _FINEST))
            for name in ("rtol", "atol")
        }
        # Forces are no smoother than the rounding of the positions.
        rounding = _ROUNDINGS * float(np.spacing(np.abs(self._q).max()))
        options["atol"] = max(options["atol"], rounding)
        return self._solver(
            self._motion.rate,
            self._t,
            self._state,
            bound,
            first_step=first,
            max_step=self._longest(self._t),
            **options,
        )

    def _keep(self, solver: OdeSolver, until: float) -> bool:
        """Add the results of the last step, unless loops cannot be closed between its ends."""
        new = self._times[self._done :]
        new = new[new <= until]
        if len(new):
            try:
                part = self._motion.along(new, solver.dense_output()(new).T)
            except (ClosureError, SingularConfigurationError):
                return False
            self._parts.append(part)
            self._compare(new, *part[1:3])
            self._done += len(new)
        return True

    def _compare(self, t: Array, va: Array, aa: Array) -> None:
        """Note where va, within one step, changes otherwise than the integral of aa."""
        h = np.diff(t)[:, None]
        integral = (h * (aa[1:] + aa[:-1]) / 2).sum(axis=0)
        error = np.abs(va[-1] - va[0] - integral)
        # Trapezoids are as exact as aa varies.
        sure = (h * np.abs(np.diff(aa, axis=0)) / 2).sum(axis=0)
        sure += _ALIKE * (np.abs(va).max(axis=0) + (h * np.abs(aa[1:])).sum(axis=0))
        if self._varies and (error > sure).any() and not self.missed:
            self.missed = (
                f"the motion has missed a torque or load that changes fast: from t = {t[0]:.9g} s "
                f"to {t[-1]:.9g} s its rates do not change by the integral of aa (off by "
                f"{error.max():.3g}); give a smaller max_step"
            )

    def _settle(self, *, irregular: bool = False) -> None:
        """Choose coordinates that suit the state and the limit of their condition number.

        The motion ends where a step was irregular and no others are better.
        """
        motion, own, q = self._motion, self._motion.own, self._q
        before, (states, condition) = motion.states, own.suited(q)
        rates = self._state[len(q) :]
        if states is not before:
            rates = before.joint_rates(q, rates)[states.coordinates]
            motion.states = states
        self._state = np.concatenate([q, rates])
        limit, self._limit = self._limit, min(self._most, max(_POOR, MARGIN * condition))
        self._bounds = self._bounds[-1:]
        stuck = self._stride < _STUCK * (self._times[-1] - self._times[0])
        alike = states is before and limit >= self._most == self._limit
        if irregular and (stuck or alike):
            self.stopped = (
                f"stopped at t = {self._t:.9g} s before a singularity: "
                f"condition number {self._limit:g}{self._why}"
            )

    def _follow(self, solver: OdeSolver, before: Array) -> tuple[float, Array]:
        """How much of the last step is regular, and the configuration there."""
        states, start, length = self._motion.states, solver.t_old, solver.t - solver.t_old
        course = cache(solver.dense_output)

        def way(q: Array, low: float, high: float) -> Array:
            return states.closed(solver.y if high == 1 else course()(start + high * length))

        return states.follow(before, way, self._limit, self._turn(solver.y))

    def _turn(self, state: Array) -> float:
        """Where the last step turns round, as a fraction of it; 1 if it does not.

        The way there and back may be long though its ends are near each other.
        """
        nq, scale = len(self._q), self._mechanism.rate_scale[self._motion.states.coordinates]
        before, after = self._state[nq:] / scale, state[nq:] / scale
        slowed = before - after
        at = float(before.dot(slowed) / max(slowed.dot(slowed), 1e-300))
        least = np.linalg.norm(before - at * slowed)
        turns = 0 < at < 1 and least < min(map(np.linalg.norm, (before, after))) / 2
        return at if turns else 1.0

    # --- through a singular configuration ---------------------------------------------------

    def _approaches(self, t: float, q: Array) -> bool:
        """Whether a singular configuration lies ahead of q; if so, go back some steps before it."""
        states, last = self._motion.states, self._bounds[-1]
        if not self._through or len(self._bounds) > 1:
            return False
        if states.suited(q)[0] is not states:
            return False
        there, here = (np.linalg.svd(states.Phi(x), compute_uv=False) for x in (self._q, q))
        k = len(states.Phi(q).T) - len(states.coordinates) - 1
        if not here[k] < there[k]:
            return False
        left = float((t - self._t) * here[k] / (there[k] - here[k]))
        at = t + left
        wide = min(_EARLIER * left, (last - at) / 2)
        if wide < left / _EARLIER or t <= self._noticed:
            return False
        self._noticed = t
        while len(self._nodes) > 1 and self._nodes[-1][0] > at - wide:
            self._nodes.pop()
        self._t, before, state = self._nodes[-1]
        self._q = before.closed(state)
        va = before.joint_rates(self._q, state[len(q) :])[states.coordinates]
        self._state = np.concatenate([self._q, va])
        self._left = at - max(at - wide, self._t)
        self._bounds, self._limit = [at - self._left, last], MARGIN * _EARLIER * self._limit
        return True

    def _cross(self) -> bool:
        """Go to the far side of the singular configuration ahead, along the smooth branch."""
        motion, start = self._motion, self._t
        self._why, self._limit = "", min(self._most, self._limit)
        try:
            course, middle = self._course(self._before()), np.inf
            found = crossing_of(motion.states, course, start, self._left)
            for _ in range(_STEPS):
                if isinstance(found, str) or abs(found.time - middle) < _CENTRED * self._left:
                    break
                middle, far = found.time, 2 * found.time - start
                times, stages = gauss_step(
                    motion.states, motion.rate, start, self._state, far, course
                )
                nodes = [(t, motion.states, y) for t, y in zip(times, stages, strict=True)]
                whole = motion.whole(far, stages[-1])
                course = self._course(nodes[:-1])
                found = crossing_of(motion.states, course, start, self._left)
            if isinstance(found, str):
                self._why = f"; the branch behind it is not determined: {found}"
                return False
            off = mismatch(self._mechanism, course, far, whole, far - start)
        except SSTError as error:
            self._why = f"; the motion behind it is not found ({error})"
            return False
        if not off < max(_EXACT, _TOLERANCES * self._options["rtol"]):
            self._why = f"; the motion behind it does not continue this one (by {off:.1g})"
            return False
        new = self._times[self._done :]
        new = new[new <= far]
        if len(new):
            own = motion.own.coordinates
            q, v, v_dot = (
                np.array([f(t) for t in new]) for f in (course.q, course.v, course.v_dot)
            )
            tau = motion.torque.along(new, q, v[:, own])
            self._parts.append((q, v[:, own], v_dot[:, own], tau))
            self._done += len(new)
        self.crossings.append(found)
        self._nodes.clear()
        self._t, self._q, self._state = far, whole[0], stages[-1]
        self._limit = 0.0
        self._settle()
        condition = motion.states.condition_number(self._q)
        self._limit = max(self._limit, MARGIN * condition)  # it falls from here on
        return True

    def _before(self) -> list[Node]:
        """The last states of the motion, spread over the time before a singular configuration."""
        chosen = [self._nodes[-1]]
        for node in reversed(self._nodes):
            near, far = (chosen[0][0] + self._left - x[0] for x in (chosen[-1], node))
            if far > _SPREAD * near and len(chosen) < _NODES:
                chosen.append(node)
        return chosen

    def _course(self, nodes: list[Node]) -> Course:
        """The smooth motion through some states."""
        motion, current = self._motion, self._motion.states
        found = []
        for time, motion.states, state in nodes:
            found.append(motion.whole(time, state))
        motion.states = current
        q, v, v_dot = map(np.array, zip(*found, strict=True))
        times = np.array([node[0] for node in nodes])
        return Course(self._mechanism, times, q, v, v_dot, self._left)
