# SPDX-License-Identifier: BSD-2-Clause
"""Assembly of a closed chain: Newton's method on the closures.

Each step solves Phi dq = -f for the shortest dq, and is halved until the error |f| falls. All
numbers are free of units: rows of f and Phi are multiplied by `row_scale`, rates by `rate_scale`.
Groups of loops that share no free joint are solved side by side, each with its own error and its
own step, so that one group that cannot be closed does not keep the others open.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags, Indices
from ..errors import ClosureError
from ..model.mechanism import Mechanism
from ..model.thresholds import ROUNDED_PLACEMENTS
from ..summaries import listed
from .joint_limits import JointLimits
from .loops import Loops, connected
from .ranks import free_motions, scaled_Phi

# `_ASSEMBLED` says whether Newton's method has succeeded, `_POLISHED` when it may stop: it makes
# closed loops better while their error still falls. Where rounding is larger than one of these, it
# takes its place.
#: Rows with a larger error are open. It is far below `CLOSURE_TOLERANCE`, so that an assembled
#: configuration counts as closed, and far above the rounding of long chains.
_ASSEMBLED = 1e-11
#: Newton's method ends at this error of a group, some roundings of numbers of size one.
_POLISHED = 1e-4 * _ASSEMBLED
#: Most steps of Newton's method: steps of `_STRIDE` lead through eight turns of a joint.
_STEPS = 100
#: A group does not close if its error falls by less than a tenth in this number of steps. Even
#: towards a singular configuration the error falls to a quarter in one step: there it grows with
#: the square of the distance, and Newton's method halves the distance.
_PATIENCE = 10
#: Longest step, [rad] or lengths of the loop: closures are far from linear beyond it. Joints that
#: only linear couplings hold, such as motors behind gears, have no limit.
_STRIDE = 0.5
#: A step is rejected if the error does not fall after this number of halvings. 1e-6 of the step is
#: then left, along which f is linear: the error would fall if it could.
_HALVINGS = 20
#: Relative rounding of a number.
_ROUNDING = float(np.finfo(float).eps)
#: Singular values below this part of the largest count as zero; see `_shortest`. Those of redundant
#: rows are of the size of the loops' errors; this is ten times `_ASSEMBLED`.
_NO_RANK = 1e-10
#: Loops that stay open by less are tried again with the tolerance of rounded placements. The errors
#: of the placements of a loop add up, so that it is some times one of them.
_NEARLY = 10 * ROUNDED_PLACEMENTS
#: Largest standard deviation of the random starts of `Assembly.try_starts`, [rad] or lengths of the
#: loop: angles are then spread over the whole turn.
_AROUND = 2.0
#: Largest motion of a joint in `Assembly.aside`, [rad] or lengths of the loop. It is shorter than
#: `_STRIDE`, so that Newton's method closes the loops.
_ASIDE = 0.2


class _GroupIndices(NamedTuple):
    """A group of loops that share no free joint with others.

    Attributes:
        rows: Indices of its rows.
        rates: Indices of its free rates.
    """

    rows: Indices
    rates: Indices


class Assembly:
    """Newton's method on the closures of one mechanism; one object per thread.

    Without `slipping`, rows that hold rates only, those of rolling and brakes, also bind the steps.
    """

    def __init__(self, mechanism: Mechanism, loops: Loops, *, slipping: bool = True) -> None:
        self.mechanism = mechanism
        self.loops = loops
        #: The rows that bind the steps.
        if slipping:
            self._rows = np.flatnonzero(loops.holonomic)
        else:
            self._rows = np.arange(len(loops.holonomic))
        #: Factors that make Phi free of units.
        self._scale = mechanism.row_scale[:, None] * mechanism.rate_scale
        #: The groups for each set of free rates, which is the key, as bytes.
        self._groups_of_free: dict[bytes, list[_GroupIndices]] = {}

    # --- closed configurations --------------------------------------------------------------

    def assemble(self, q: Array, free: Indices, *, limits: bool = False) -> Array:
        """A configuration with closed loops near q; only the rates `free` move.

        With `limits` joints of one coordinate stay within their limits. The error names the loops
        that stay open, the largest gap, and the joints at their limits.
        """
        bounds = JointLimits(self.mechanism, free) if limits else None
        start = q.copy() if bounds is None else bounds.clipped(q)
        q, open_rows = self._newton(start, free, bounds)
        if len(open_rows) and np.abs(self._error(q)).max() < _NEARLY:
            # Rows that contradict each other a little may lead away from the best pose.
            q, open_rows = self._newton(start, free, bounds, ROUNDED_PLACEMENTS)
        if bounds is not None:
            q = bounds.clipped(q)
            bounds.require_within(q)
        if len(open_rows):
            raise self._not_closed(q, open_rows, bounds)
        return q

    def closed(self, q: Array) -> Array:
        """The closed configuration near q with the coordinates fixed.

        Brakes hold their joints if the loops close so.
        """
        return self.holding_brakes(self.mechanism.dependent, lambda free: self.assemble(q, free))

    def holding_brakes(self, free: Indices, close: Callable[[Indices], Array]) -> Array:
        """A configuration by `close(free)`; brakes hold their joints if the loops close so."""
        braked = self.mechanism.braked
        if len(braked):
            with suppress(ClosureError):
                return close(np.setdiff1d(free, braked))
        return close(free)

    def near(self, q: Array, fixed: Indices) -> Array:
        """A configuration with closed loops near q; the rates `fixed` are held if possible."""
        rates = np.arange(self.mechanism.model.nv)
        try:
            return self.assemble(q, np.setdiff1d(rates, fixed))
        except ClosureError:
            return self.assemble(q, rates)

    def try_starts(
        self, q: Array, free: Indices, tries: int, seed: int, *, limits: bool = False
    ) -> Array:
        """The first assembly from q and random starts around it; the error is that of the best."""
        random = np.random.default_rng(seed)
        model = self.mechanism.model
        failures = list[ClosureError]()
        for k in range(tries):
            start = q
            if k > 0:
                # The starts lie farther and farther from q.
                deviation = _AROUND * k / (tries - 1)
                displacement = np.zeros(model.nv)
                displacement[free] = deviation * random.normal(size=len(free))
                start = pin.integrate(model, q, displacement * self.mechanism.rate_scale)
            try:
                return self.assemble(start, free, limits=limits)
            except ClosureError as error:
                failures.append(error)
        raise min(failures, key=lambda error: error.residual)

    def aside(self, q: Array, seed: int) -> Array:
        """A closed configuration beside a closed q, about 0.2 rad away along a random motion."""
        mechanism = self.mechanism
        motions = free_motions(scaled_Phi(mechanism, self.loops, q))
        random = np.random.default_rng(seed)
        # The projection of a random vector does not depend on the basis of the motions.
        direction = motions @ (motions.T @ random.normal(size=len(motions)))
        # Without motions the direction is zero, and so is the step: 1e-300 avoids 0 / 0.
        step = _ASIDE * direction / max(float(np.abs(direction).max(initial=0.0)), 1e-300)
        guess = pin.integrate(mechanism.model, q, step * mechanism.rate_scale)
        return self.assemble(guess, np.arange(mechanism.model.nv))

    # --- configurations that may be open ----------------------------------------------------

    def closer(self, q: Array, free: Indices, tolerance: float = _NO_RANK) -> Array:
        """A configuration near q with a locally least error; only the rates `free` move.

        Singular values of Phi below `tolerance` times the largest of their group count as zero.
        """
        return self._newton(q, free, None, tolerance)[0]

    def gap(self, q: Array, rows: Indices) -> float:
        """Largest error of some rows at q, free of units; 0 if it is rounding."""
        f = self._error(q)
        if not self._is_open(q, f)[rows].any():
            return 0.0
        return float(np.abs(f[rows]).max())

    # --- Newton's method --------------------------------------------------------------------

    def _newton(
        self, q: Array, free: Indices, limits: JointLimits | None, tolerance: float = _NO_RANK
    ) -> tuple[Array, Indices]:
        """A configuration near q with the loops closed where possible, and the open rows.

        It ends when no group is left that still moves and improves.
        """
        f = self._error(q)
        groups = self._groups(free)
        for _ in range(_STEPS):
            for group in groups:
                group.add_error(f)
            groups = [group for group in groups if group.improves]
            if not groups:
                break
            Phi = self.loops.Phi * self._scale  # at q, where `_error` was called last
            step = np.zeros(Phi.shape[1])
            for group in groups:
                step[group.rates] = self._step_of_group(group, q, f, Phi, limits, tolerance)
            q, f, groups = self._line_search(q, f, Phi, step, groups)
        return q, self._rows[self._is_open(q, f)[self._rows]]

    def _step_of_group(
        self,
        group: _Group,
        q: Array,
        f: Array,
        Phi: Array,
        limits: JointLimits | None,
        tolerance: float,
    ) -> Array:
        """Newton's step of the rates of a group, shape (its rates,), shortened to what is allowed.

        Its length is at most `_STRIDE`, and it does not lead beyond limits: joints at a limit do
        not step beyond it, and the whole step ends where another joint reaches its limit.
        """
        rates = group.rates
        Phi_of_group = Phi[group.rows][:, rates]
        right = -f[group.rows]
        if limits is None:
            step = _shortest(Phi_of_group, right, tolerance)
        else:
            step = _within_limits(q, rates, Phi_of_group, right, tolerance, limits)
        longest = np.abs(step[self.loops.curved[rates]]).max(initial=0.0)
        step = step * float(_STRIDE / max(_STRIDE, longest))
        if limits is not None:
            step = step * limits.fraction_to_limit(q, rates, step)
        return step

    def _line_search(
        self, q: Array, f: Array, Phi: Array, step: Array, groups: list[_Group]
    ) -> tuple[Array, Array, list[_Group]]:
        """The configuration after a step, its errors, and the groups that have moved.

        The step of each group is halved until the group's error falls. It becomes zero, so that the
        group does not move, if the error does not fall, or if the group was closed before the step:
        then its error is mostly rounding, which no step can lower.
        """
        model = self.mechanism.model
        scale = self.mechanism.rate_scale
        step = step.copy()
        # Groups share no free joint. So a group whose error has fallen keeps its step and its
        # error, and a group that is worse now was worse in all passes: its step was halved in each.
        # The count of the passes is the number of halvings of all groups that are worse.
        halvings = 0
        while True:
            trial = pin.integrate(model, q, step * scale)
            f_trial = self._error(trial)
            moving = [group for group in groups if step[group.rates].any()]
            worse = [group for group in moving if not group.size(f_trial) < group.size(f)]
            if not worse:
                return trial, f_trial, moving
            # The rounding of f at q. The loops are now evaluated at the trial, where coordinates
            # of frames are about as large as at q.
            largest_closed = np.maximum(_ASSEMBLED, self._rounding(q, Phi))
            for group in worse:
                was_closed = (np.abs(f[group.rows]) < largest_closed[group.rows]).all()
                if was_closed or halvings == _HALVINGS:
                    step[group.rates] = 0.0
                else:
                    step[group.rates] /= 2
            halvings += 1

    def _error(self, q: Array) -> Array:
        """f at q, free of units, shape (rows,); the loops are evaluated at q."""
        self.loops.evaluate(q)
        return self.loops.f * self.mechanism.row_scale

    # --- open rows --------------------------------------------------------------------------

    def _is_open(self, q: Array, f: Array) -> Flags:
        """Which rows are open by more than rounding, shape (rows,).

        f is the error at q, where `_error` was called last.
        """
        closed = np.abs(f) < _ASSEMBLED  # not if f is NaN
        if not closed.all():
            closed |= np.abs(f) < self._rounding(q, self.loops.Phi * self._scale)
        return ~closed

    def _rounding(self, q: Array, Phi: Array) -> Array:
        """Rounding of f, shape (rows,); the loops are evaluated at q or a step from it.

        It grows with turns of the joints and with the distance of the loops from the origin: a
        position q_k has an error of its size times `_ROUNDING`, which Phi takes to f.
        """
        # Joints whose coordinate is one number, which may contain many turns.
        entries, rates = self.mechanism.space.plain
        turns = np.abs(Phi[:, rates]) @ np.abs(q[entries] / self.mechanism.rate_scale[rates])
        # f is the sum of several rounded terms.
        return 4 * (_ROUNDING * turns + self._rounding_of_positions())

    def _rounding_of_positions(self) -> Array:
        """Rounding of the positions of the frames of each row, free of units, shape (rows,).

        Rows of turns may be open by as much: where rows are redundant, least squares spread the
        rounding of positions over all rows.
        """
        return _ROUNDING * self.loops.largest_coordinates / self.mechanism.row_lengths

    def _not_closed(self, q: Array, open_rows: Indices, limits: JointLimits | None) -> ClosureError:
        """The error for loops that stay open at q."""
        self.loops.evaluate(q)
        largest = float(np.abs(self.loops.f)[open_rows].max())
        names = [
            str(closure)
            for closure, rows in zip(self.mechanism.closures, self.loops.slices, strict=True)
            if np.isin(open_rows, np.arange(rows.start, rows.stop)).any()
        ]
        reached = "" if limits is None else limits.reached(q)
        return ClosureError(
            f"the loops cannot be closed from this guess{reached}: {largest:.3g} "
            f"(m or rad) stays open at {listed(names, 4)}; start closer to a closed "
            "configuration, hold fewer joints (fixed=), try several starts (tries=), or check "
            "the geometry",
            largest,
        )

    # --- groups -----------------------------------------------------------------------------

    def _groups(self, free: Indices) -> list[_Group]:
        """The groups of loops that share no free joint; call it after `_error`."""
        key = free.tobytes()
        if key not in self._groups_of_free:
            self._groups_of_free[key] = self._indices_of_groups(free)
        rounding = self._rounding_of_positions()
        groups = list[_Group]()
        for rows, rates in self._groups_of_free[key]:
            least = max(_POLISHED, float(rounding[rows].max(initial=0.0)))
            groups.append(_Group(rows, rates, least))
        return groups

    def _indices_of_groups(self, free: Indices) -> list[_GroupIndices]:
        """Rows and free rates of each group of loops that share no free joint."""
        loops = self.loops
        # A closure as a whole belongs to one group: a row for each closure, which says the rates
        # that it depends on.
        touched_by_closure = np.zeros((len(loops.slices), loops.model.nv), dtype=bool)
        closure_of_row = np.zeros(len(loops.touched), dtype=np.intp)
        for closure, rows in enumerate(loops.slices):
            touched_by_closure[closure] = loops.touched[rows].any(axis=0)
            closure_of_row[rows] = closure
        groups = list[_GroupIndices]()
        for closures, columns in connected(touched_by_closure[:, free]):
            is_in_group = np.isin(closure_of_row[self._rows], closures)
            if is_in_group.any():
                groups.append(_GroupIndices(rows=self._rows[is_in_group], rates=free[columns]))
        return groups


@dataclass
class _Group:
    """A group of loops during Newton's method.

    Attributes:
        rows, rates: Indices of its rows, and of its free rates.
        least: Smaller errors are rounding.
        sizes: Size of the error at each configuration so far.
    """

    rows: Indices
    rates: Indices
    least: float
    sizes: list[float] = field(default_factory=list)

    def size(self, f: Array) -> float:
        """|f| of the group."""
        part = f[self.rows]
        return math.sqrt(part.dot(part))

    def add_error(self, f: Array) -> None:
        """Add the error at another configuration to `sizes`."""
        self.sizes.append(self.size(f))

    @property
    def improves(self) -> bool:
        """Whether the group is open, and its error has fallen in the last `_PATIENCE` steps."""
        size = self.sizes[-1]
        if len(self.sizes) <= _PATIENCE:
            return self.least <= size < math.inf
        return self.least <= size < 0.9 * self.sizes[-1 - _PATIENCE]


def _shortest(A: Array, right: Array, tolerance: float) -> Array:
    """The shortest x with the least |A x - right|, for rows free of units.

    Singular values below `tolerance` times the largest count as zero. If the largest is below one,
    they are compared with one, as rows that hold a motion have the natural size one.
    """
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    rank = np.count_nonzero(s > tolerance * s.max(initial=1.0))
    return np.asarray(Vt[:rank].T @ (U[:, :rank].T @ right / s[:rank]), dtype=float)


def _within_limits(
    q: Array, rates: Indices, Phi: Array, right: Array, tolerance: float, limits: JointLimits
) -> Array:
    """Newton's step of some rates; joints at a limit stay at rest if they would step beyond it.

    Without them the others take another step, which may push other joints at a limit beyond it.
    Phi has the columns of these rates.
    """
    moving = np.ones(len(rates), dtype=bool)
    while True:
        step = np.zeros(len(rates))
        step[moving] = _shortest(Phi[:, moving], right, tolerance)
        beyond = moving & ~limits.can_step(q, rates, step)
        if not beyond.any():
            return step
        moving &= ~beyond
