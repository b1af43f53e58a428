# SPDX-License-Identifier: BSD-2-Clause
"""Integrates a motion; other coordinates are chosen where these do not determine it well."""

from __future__ import annotations

from collections import deque
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..errors import ClosureError, SimulationError, SingularConfigurationError, SSTError
from ..model.mechanism import Mechanism
from ..model.thresholds import MARGIN, WELL_CONDITIONED
from ..states import States
from .crossings import Branch, Crossing, crossing_of, gauss_step, mismatch
from .input_watch import InputWatch
from .inputs import IMPLICIT, Settings
from .state_equations import StateEquations

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver

#: Condition number above which better coordinates are searched.
_POOR = 50.0
#: An irregular step is repeated with its regular part, or at least this part of its length. The
#: motion ends when steps are shorter than this part of its duration.
_SHORTER, _STUCK = 0.25, 1e-12
#: A repeated step is shorter than the regular part by this fraction; ten times more at each repeat.
_SHY = 1e-10
#: rtol and atol are not tightened below this; atol is at least this many roundings of max |q|.
_FINEST, _ROUNDINGS = 1e-12, 16
#: The most states from which a motion is extrapolated through a singular configuration. The times
#: from these to that configuration differ by more than this factor.
_NODES, _SPREAD = 6, 1.5
#: The step over a singular configuration starts at this multiple of the time that is left when the
#: configuration is noticed: next to it, accelerations are noisy.
_EARLIER = 4.0
#: The middle of this step is at the singular configuration to this part of half the step, after at
#: most this number of tries.
_CENTRED, _STEPS = 0.01, 3
#: Largest `mismatch` of the branch and the end of this step: the larger one of the first number and
#: of the second one times rtol.
_EXACT, _TOLERANCES = 1e-7, 100.0


#: A time, the state space and the state.
Node = tuple[float, States, Array]


class Integration:
    """Integrates equations of motion step by step, in coordinates that suit each state.

    Implicit methods use the Jacobian of the equations if it is `exact`.

    Attributes:
        stopped: Why the motion ended before the last time; empty if it did not.
        crossings: The singular configurations that it went through.
    """

    def __init__(
        self, equations: StateEquations, mechanism: Mechanism, settings: Settings, *, exact: bool
    ) -> None:
        from scipy import integrate

        self._equations = equations
        self._mechanism = mechanism
        self._settings = settings
        self._solver = getattr(integrate, settings.method)
        if exact and settings.method in IMPLICIT:
            self._solver = partial(self._solver, jac=equations.jacobian)
        self._progress = settings.progress or (lambda time: None)
        self._stride = np.inf
        self._limit = 0.0
        self._left = 0.0
        self._noticed = -np.inf
        self._nodes = deque[Node](maxlen=3 * _NODES)
        self._no_branch = ""
        self.crossings = list[Crossing]()
        self.stopped = ""

    @property
    def missed(self) -> str:
        """Where no step was short enough for a torque or load; empty if there is no such place."""
        if np.isnan(self._watch.missed):
            return ""
        return (
            f"a torque or load function changes too fast at t = {self._watch.missed:.9g} s: the "
            "motion has missed a part of it"
        )

    @np.errstate(over="ignore", invalid="ignore")  # a motion that diverges ends
    def integrate(self, times: Array, start: Array) -> list[Array]:
        """q, va, aa of the robot's coordinates and torques, at the times reached."""
        equations = self._equations
        self._times = times
        self._t = float(times[0])
        q0, rates = np.split(start, [self._mechanism.model.nq])
        if not rates.any():  # at rest the rates of all coordinates are 0
            equations.states, _ = equations.robot_states.suited(q0)
        if not np.isfinite(equations.rate(self._t, start)).all():
            why = equations.failure or "its rates are not finite"
            raise SimulationError(f"the motion cannot start ({why})", self._t)
        self._q = equations.states.closed(start)
        self._state = start
        self._bounds = [float(times[-1])]
        self._watch = InputWatch(equations, times, self._settings)
        self._settle()
        self._sample_torques()
        self._results = [equations.along(times[:1], self._state[None])]
        self._done = 1
        self._progress(self._t)
        while self._t < times[-1] and not self.stopped:
            equations.close_first = len(self._bounds) > 1
            if self._t < self._bounds[0]:
                self._advance(min(self._bounds[0], self._sample_torques()))
            if self._t >= self._bounds[0] < times[-1]:
                self._bounds.pop(0)
                if len(self._bounds) == 1 and not self._cross():
                    nearer = self._t + self._left / 2
                    if nearer <= self._noticed:
                        self._left /= 2
                        self._bounds.insert(0, nearer)
        return [np.concatenate(part) for part in zip(*self._results, strict=True)]

    def _sample_torques(self) -> float:
        """Sample a controller if it is due; return the time until which torques are constant."""
        sampling = self._equations.torque.sampling
        if sampling is None:
            return np.inf
        sampling.reach(self._t, partial(self._equations.robot_state, self._state))
        return sampling.until(self._times)

    def _advance(self, bound: float) -> None:
        """Integrate until a time, or until other coordinates are needed."""
        equations = self._equations
        states = self._equations.states
        cuts = 0
        solver = self._begin(bound)
        self._nodes.append((self._t, states, self._state))
        while solver.status == "running" and states is equations.states:
            self._evaluate(solver)
            if self._watch.misses(solver, self._dense):
                self._stride = min(self._stride, self._watch.longest(self._t))
                solver = self._begin(bound)
                continue
            fraction, q = self._follow_step(solver, bound)
            t = float(solver.t)
            if fraction < 1:
                t = float(solver.t_old + fraction * (t - solver.t_old))
                self._stride *= max(fraction, _SHORTER)
                if self._approaches(t, q):
                    return
                # A part of a step is less exact than a step: integrate again until there.
                t -= (t - self._t) * min(0.5, _SHY * 10**cuts)
                if t > self._t:
                    solver = self._begin(t)
                    cuts = cuts + 1
                    continue
            else:
                self._t = t
                self._q = q
                self._state = solver.y
                self._nodes.append((t, states, solver.y))
            if fraction < 1 or (cuts and solver.status == "finished"):
                self._settle(irregular=True)
                return
            if self._better_coordinates(q):
                self._settle()

    def _evaluate(self, solver: OdeSolver) -> None:
        """One step of the integrator."""
        solver.max_step = self._longest(solver.t)
        message = solver.step()
        if solver.status == "failed":
            why = self._equations.failure or message
            raise SimulationError(f"the integrator stopped ({why})", float(solver.t))
        self._dense = cache(solver.dense_output)

    def _follow_step(self, solver: OdeSolver, bound: float) -> tuple[float, Array]:
        """The fraction of the last step that is regular, and q there; its results are recorded."""
        t, changes = float(solver.t), self._equations.torque.sampling and solver.t == bound
        # A step that ends where torques change could have been longer.
        longer = self._stride if changes and self._stride < np.inf else 0.0
        self._stride = max(solver.step_size, longer)
        self._progress(t)
        fraction, q = self._follow(solver, self._q)
        # Where torques change, the results are those of the new torques.
        until = np.nextafter(t, -np.inf) if changes and t < self._times[-1] else t
        if fraction == 1 and not self._record(solver, until):
            fraction = 0.5
        return fraction, q

    def _better_coordinates(self, q: Array) -> bool:
        """Whether the robot's coordinates are good again, or the condition far below its limit."""
        states = self._equations.states
        robot_states = self._equations.robot_states
        if states is not robot_states and robot_states.condition_number(q) < WELL_CONDITIONED:
            return True
        if len(self._bounds) > 1 or not self._limit > _POOR:
            return False
        return bool(states.condition_number(q) * MARGIN**2 < self._limit)

    def _longest(self, t: float) -> float:
        """The longest step from a time that misses no change of a torque or load."""
        longest = min(self._settings.max_step or np.inf, self._watch.longest(t))
        for times in (x.times for x in (self._equations.torque, self._equations.load) if x):
            if times is not None:
                k = min(int(times.searchsorted(t, "right")), len(times) - 1)
                spacing = times[k] - times[k - 1]
                longest = min(longest, spacing, times[min(k + 1, len(times) - 1)] - t)
        return longest

    def _begin(self, bound: float) -> OdeSolver:
        """An integrator from the present state to a time."""
        first = min(self._stride, bound - self._t) if self._stride < np.inf else None
        # The dependent joints have the errors of the coordinates times the condition number.
        factor = MARGIN * self._equations.states.condition_number(self._q)
        rtol, atol = (
            max(tolerance / factor, min(tolerance, _FINEST))
            for tolerance in (self._settings.rtol, self._settings.atol)
        )
        # Forces are no smoother than the rounding of the positions.
        rounding = _ROUNDINGS * float(np.spacing(np.abs(self._q).max()))
        return self._solver(
            self._equations.rate,
            self._t,
            self._state,
            bound,
            first_step=first,
            max_step=self._longest(self._t),
            rtol=rtol,
            atol=max(atol, rounding),
        )

    def _record(self, solver: OdeSolver, until: float) -> bool:
        """Add the results of the last step; False if loops cannot be closed within it."""
        new = self._times[self._done :]
        new = new[new <= until]
        if len(new):
            try:
                part = self._equations.along(new, self._dense()(new).T)
            except (ClosureError, SingularConfigurationError):
                return False
            self._results.append(part)
            self._done += len(new)
        return True

    def _settle(self, *, irregular: bool = False) -> None:
        """Choose good coordinates for the state, and the limit of their condition number.

        The motion ends after an irregular step if steps are too short or no coordinates are better.
        """
        equations = self._equations
        q = self._q
        before, (states, condition) = equations.states, equations.robot_states.suited(q)
        rates = self._state[len(q) :]
        if states is not before:
            rates = before.joint_rates(q, rates)[states.coordinates]
            equations.states = states
        self._state = np.concatenate([q, rates])
        largest = self._settings.max_condition_number
        limit = self._limit
        self._limit = min(largest, max(_POOR, MARGIN * condition))
        self._bounds = self._bounds[-1:]
        stuck = self._stride < _STUCK * (self._times[-1] - self._times[0])
        alike = states is before and limit >= largest == self._limit
        if irregular and (stuck or alike):
            self.stopped = (
                f"stopped at t = {self._t:.9g} s before a singularity: "
                f"condition number {self._limit:g}{self._no_branch}"
            )

    def _follow(self, solver: OdeSolver, before: Array) -> tuple[float, Array]:
        """The fraction of the last step that is regular, and the configuration at its end."""
        states = self._equations.states
        start = solver.t_old
        length = solver.t - solver.t_old

        def path(q: Array, low: float, high: float) -> Array:
            state = solver.y if high == 1 else self._dense()(start + high * length)
            return states.closed(state)

        return states.follow(before, path, self._limit, self._turn(solver.y))

    def _turn(self, state: Array) -> float:
        """The fraction of the last step after which its motion reverses; 1 if it does not.

        A step there and back may be long although its ends are close.
        """
        nq = len(self._q)
        scale = self._mechanism.rate_scale[self._equations.states.coordinates]
        before, after = self._state[nq:] / scale, state[nq:] / scale
        slowed = before - after
        at = float(before.dot(slowed) / max(slowed.dot(slowed), 1e-300))
        least = np.linalg.norm(before - at * slowed)
        turns = 0 < at < 1 and least < min(map(np.linalg.norm, (before, after))) / 2
        return at if turns else 1.0

    # --- through a singular configuration ---------------------------------------------------

    def _approaches(self, t: float, q: Array) -> bool:
        """Whether a singular configuration is ahead of q; if so, go back some steps."""
        states = self._equations.states
        last = self._bounds[-1]
        if not self._settings.through_singularities or len(self._bounds) > 1:
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
        self._bounds = [at - self._left, last]
        self._limit = MARGIN * _EARLIER * self._limit
        return True

    def _cross(self) -> bool:
        """Step over the singular configuration ahead, along the smooth branch."""
        equations = self._equations
        start = self._t
        self._no_branch = ""
        self._limit = min(self._settings.max_condition_number, self._limit)
        try:
            branch, crossing, states, far = self._branch_behind(start)
            if isinstance(crossing, str):
                self._no_branch = f"; the branch behind it is not determined: {crossing}"
                return False
            motion = equations.joint_motion(far, states[-1])
            off = mismatch(self._mechanism, branch, far, motion, far - start)
        except SSTError as error:
            self._no_branch = f"; the motion behind it is not found ({error})"
            return False
        if not off < max(_EXACT, _TOLERANCES * self._settings.rtol):
            self._no_branch = f"; the motion behind it does not continue this one (by {off:.1g})"
            return False
        self._record_branch(branch, far)
        self.crossings.append(crossing)
        self._nodes.clear()
        self._t = far
        self._q = motion[0]
        self._state = states[-1]
        self._limit = 0.0
        self._settle()
        condition = equations.states.condition_number(self._q)
        self._limit = max(self._limit, MARGIN * condition)  # it falls from here on
        return True

    def _branch_behind(self, start: float) -> tuple[Branch, Crossing | str, Array, float]:
        """The branch, where it is singular, states of the step over it and the end of the step."""
        equations = self._equations
        middle = np.inf
        far = start
        states = self._state[None]
        branch = self._branch(self._last_nodes())
        for step in range(_STEPS + 1):
            crossing = crossing_of(equations.states, branch, start, self._left)
            if isinstance(crossing, str) or step == _STEPS:
                break
            if abs(crossing.time - middle) < _CENTRED * self._left:
                break
            middle = crossing.time
            far = 2 * crossing.time - start
            times, states = gauss_step(
                equations.states, equations.rate, start, self._state, far, branch
            )
            nodes = [(t, equations.states, y) for t, y in zip(times, states, strict=True)]
            branch = self._branch(nodes[:-1])
        return branch, crossing, states, far

    def _record_branch(self, branch: Branch, until: float) -> None:
        """Add the results of the step over a singular configuration."""
        new = self._times[self._done :]
        new = new[new <= until]
        if len(new):
            coordinates = self._equations.robot_states.coordinates
            curves = branch.q, branch.v, branch.v_dot
            q, v, v_dot = (np.array([curve(t) for t in new]) for curve in curves)
            va = v[:, coordinates]
            aa = v_dot[:, coordinates]
            self._results.append((q, va, aa, self._equations.torque.along(new, q, va)))
            self._done += len(new)

    def _last_nodes(self) -> list[Node]:
        """The last states of the motion, spread over the time before a singular configuration."""
        chosen = [self._nodes[-1]]
        for node in reversed(self._nodes):
            near, far = (chosen[0][0] + self._left - x[0] for x in (chosen[-1], node))
            if far > _SPREAD * near and len(chosen) < _NODES:
                chosen.append(node)
        return chosen

    def _branch(self, nodes: list[Node]) -> Branch:
        """The smooth motion through some states."""
        equations = self._equations
        states = self._equations.states
        motions = []
        for time, equations.states, state in nodes:
            motions.append(equations.joint_motion(time, state))
        equations.states = states
        q, v, v_dot = map(np.array, zip(*motions, strict=True))
        times = np.array([node[0] for node in nodes])
        return Branch(self._mechanism, times, q, v, v_dot, self._left)
