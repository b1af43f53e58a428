# SPDX-License-Identifier: BSD-2-Clause
"""Assembly of a closed chain: Newton's method on the closures.

Each step solves Phi dq = -f for the shortest dq, and is halved until the error |f| falls.

All numbers are free of units: f is multiplied by `row_scale`, and Phi by `row_scale` and
`rate_scale`. A step dq times `rate_scale` is in [rad] and [m].

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

#: Rows with a larger error are open, unless their error is rounding. It is far below
#: `CLOSURE_TOLERANCE`, so that an assembled configuration counts as closed, and far above the
#: rounding of long chains.
_ASSEMBLED = 1e-11
#: Newton's method takes further steps with closed loops while their error falls. It stops at this
#: error, which is some roundings of numbers of size one, or at the rounding of the positions of the
#: loops' frames, if that is larger.
_POLISHED = 1e-4 * _ASSEMBLED
#: Most steps of Newton's method: steps of `_STRIDE` lead through eight turns of a joint.
_STEPS = 100
#: Newton's method gives up if the error of a group falls by less than a tenth in this number of
#: steps. Even near a singular configuration each step divides the error by four: there the error
#: grows with the square of the distance, and Newton's method halves the distance.
_PATIENCE = 10
#: Longest step, [rad] or lengths of the loop: closures are far from linear beyond it. The limit is
#: not for joints that only linear couplings hold, such as motors behind gears.
_STRIDE = 0.5
#: A step is rejected if the error does not fall after this number of halvings. 1e-6 of the step is
#: then left, along which f is linear: the error would fall if it could.
_HALVINGS = 20
#: Relative rounding of a number.
_ROUNDING = float(np.finfo(float).eps)
#: Singular values below this part of the largest count as zero; see `_shortest`. Where rows are
#: redundant, some singular values are as small as the loops' errors. In closed loops these errors
#: are at most `_ASSEMBLED`, a tenth of this number.
_NO_RANK = 1e-10
#: Loops that stay open by less are tried again with `ROUNDED_PLACEMENTS` in place of `_NO_RANK`.
#: The errors of the placements in a loop add up, so that this is several times the error of one.
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

    - `assemble` closes the loops by the free rates, or raises an error; `closed`, `near` and
      `try_starts` call it with other free rates or starts.
    - `closer` closes the loops as far as it can; `gap` is the error that is left.

    Args:
        mechanism: The mechanism.
        loops: Its loops.
        slipping: Whether steps may violate rows that hold rates only: wheels slip, and braked
            joints move.
    """

    def __init__(self, mechanism: Mechanism, loops: Loops, *, slipping: bool = True) -> None:
        self.mechanism = mechanism
        self.loops = loops
        #: The rows with which steps are computed.
        if slipping:
            self._rows = np.flatnonzero(loops.holonomic)
        else:
            self._rows = np.arange(len(loops.holonomic))
        #: Factors that make Phi free of units, shape (rows, nv).
        self._scale = mechanism.row_scale[:, None] * mechanism.rate_scale
        #: The groups by the free rates. The key is the array of free rates, as bytes.
        self._groups_of_free: dict[bytes, list[_GroupIndices]] = {}

    # --- closed configurations --------------------------------------------------------------

    def assemble(self, q: Array, free: Indices, *, limits: bool = False) -> Array:
        """A configuration with closed loops near q, shape (nq,); only the rates `free` move.

        With `limits`, joints of one coordinate stay within their limits.

        Raises:
            ClosureError: With the loops that stay open, the largest error and, with `limits`, the
                joints at their limits.
        """
        bounds = JointLimits(self.mechanism, free) if limits else None
        start = q.copy() if bounds is None else bounds.clipped(q)
        q, open_rows = self._newton(start, free, bounds)
        if len(open_rows) and np.abs(self._error(q)).max() < _NEARLY:
            # Redundant rows of rounded placements contradict each other a little, and steps that
            # try to satisfy all of them may lead away from the best configuration.
            q, open_rows = self._newton(start, free, bounds, ROUNDED_PLACEMENTS)
        if bounds is not None:
            # Steps end at limits up to rounding, and this removes the rounding. It changes q too
            # little to open the loops, so that `open_rows` remains true.
            q = bounds.clipped(q)
            # `clipped` leaves fixed joints where they are, and cannot satisfy an empty range.
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
        """The result of `close(free)`; the brakes' rates are not free if the loops close so."""
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
        """The first closed configuration from q or from random starts around q, shape (nq,).

        `tries` is the number of starts, at least 1; the first one is q.

        Raises:
            ClosureError: If no start leads to one: the error of the start with the smallest gap.
        """
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
        """A closed configuration beside a closed q, along a random motion from q.

        Before the loops are closed, the fastest joint moves by `_ASIDE`.
        """
        mechanism = self.mechanism
        motions = free_motions(scaled_Phi(mechanism, self.loops, q))
        random = np.random.default_rng(seed)
        # The projection of a random vector does not depend on the basis of the motions.
        direction = motions @ (motions.T @ random.normal(size=len(motions)))
        # If nothing can move, the direction and the step are zero: 1e-300 avoids 0 / 0.
        step = _ASIDE * direction / max(float(np.abs(direction).max(initial=0.0)), 1e-300)
        guess = pin.integrate(mechanism.model, q, step * mechanism.rate_scale)
        return self.assemble(guess, np.arange(mechanism.model.nv))

    # --- configurations that may be open ----------------------------------------------------

    def closer(self, q: Array, free: Indices, tolerance: float = _NO_RANK) -> Array:
        """A configuration near q with closed loops, or with a locally least error.

        Only the rates `free` move. Singular values of Phi below `tolerance` times the largest of
        their group count as zero.
        """
        return self._newton(q, free, None, tolerance)[0]

    def gap(self, q: Array, rows: Indices) -> float:
        """Largest error of some rows at q, free of units; 0 if none of these rows is open."""
        f = self._error(q)
        if not self._is_open(q, f)[rows].any():
            return 0.0
        return float(np.abs(f[rows]).max())

    def open_rows(self, q: Array, rows: Indices) -> Indices:
        """The indices in `rows` of the rows that are open at q by more than rounding."""
        f = self._error(q)
        return rows[self._is_open(q, f)[rows]]

    # --- Newton's method --------------------------------------------------------------------

    def _newton(
        self, q: Array, free: Indices, limits: JointLimits | None, tolerance: float = _NO_RANK
    ) -> tuple[Array, Indices]:
        """A configuration near q with the loops closed where possible, and the open rows.

        Only groups that moved in the last step and still improve take another step.
        """
        f = self._error(q)
        groups = self._groups(free)
        for _ in range(_STEPS):
            for group in groups:
                group.add_error(f)
            groups = [group for group in groups if group.improves]
            if not groups:
                break
            # `_error` was called at q last, so that the loops are evaluated at q.
            Phi = self.loops.Phi * self._scale
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

        No rate that changes Phi steps by more than `_STRIDE`. Joints at a limit do not step beyond
        it, and the whole step ends where another joint reaches its limit.
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

        The step of each group is halved until the group's error falls. A group does not move at all
        if its error does not fall after `_HALVINGS` halvings. A group that was closed before the
        step does not move if its error does not fall at once: this error is mostly rounding.

        Groups share no free joint, so that the error of a group depends on its own step only. A
        group whose error has fallen keeps its step, and so its error, in the other trials.
        """
        model = self.mechanism.model
        scale = self.mechanism.rate_scale
        step = step.copy()
        for group in groups:
            group.halvings = 0
        while True:
            trial = pin.integrate(model, q, step * scale)
            f_trial = self._error(trial)
            moving = [group for group in groups if step[group.rates].any()]
            # `not <` instead of `>=`, so that a group whose error is NaN is worse too.
            worse = [group for group in moving if not group.size(f_trial) < group.size(f)]
            if not worse:
                return trial, f_trial, moving
            # The largest errors that count as closed at q. q and Phi are those before the step,
            # but the loops are evaluated at the trial. So the positions of their frames, which
            # `_rounding` also needs, are those at the trial; they are about as large as at q.
            largest_closed = np.maximum(_ASSEMBLED, self._rounding(q, Phi))
            for group in worse:
                was_closed = (np.abs(f[group.rows]) < largest_closed[group.rows]).all()
                if was_closed or group.halvings == _HALVINGS:
                    step[group.rates] = 0.0
                else:
                    step[group.rates] /= 2
                    group.halvings += 1

    def _error(self, q: Array) -> Array:
        """f at q, free of units, shape (rows,); the loops are evaluated at q."""
        self.loops.evaluate(q)
        return self.loops.f * self.mechanism.row_scale

    # --- open rows --------------------------------------------------------------------------

    def _is_open(self, q: Array, f: Array) -> Flags:
        """Which rows are open by more than rounding, shape (rows,).

        f is the error at q. The loops must be evaluated at q.
        """
        closed = np.abs(f) < _ASSEMBLED  # not if f is NaN
        if not closed.all():
            closed |= np.abs(f) < self._rounding(q, self.loops.Phi * self._scale)
        return ~closed

    def _rounding(self, q: Array, Phi: Array) -> Array:
        """Rounding of f at q, free of units, shape (rows,).

        It has two sources:

        - the positions of joints: q_k has the rounding `_ROUNDING` |q_k|, which changes f by
          `_ROUNDING` |Phi| |q|;
        - the positions of the loops' frames in the world. They are those where the loops are
          evaluated, at q or near it.

        Phi is free of units, at q.
        """
        # The positions of joints with one coordinate, which may be many turns. Entries of
        # quaternions are at most one, so that their rounding is small. Divided by `rate_scale`,
        # positions are free of units, as Phi is.
        entries, rates = self.mechanism.space.plain
        sizes = np.abs(q[entries] / self.mechanism.rate_scale[rates])
        of_joints = _ROUNDING * (np.abs(Phi[:, rates]) @ sizes)
        # f is a sum of several terms, each with its rounding. The factor 4 is a choice: if it is
        # too small, closed loops far from the origin or with many turns count as open.
        return 4 * (of_joints + self._rounding_of_positions())

    def _rounding_of_positions(self) -> Array:
        """Rounding of f from the positions of its frames in the world, shape (rows,).

        A coordinate of a frame has the rounding `_ROUNDING` times its size, in [m]. Divided by the
        length of the loop (`row_lengths`), it is free of units. Rows that hold a turn get this
        number too, although angles do not depend on positions: if rows are redundant, least squares
        spread the errors of positions over all rows of the loop.
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
        """The groups of loops that share no free joint.

        The loops must be evaluated: their rounding depends on the positions of their frames.
        """
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
        # All rows of a closure belong to one group. So groups are found from one row for each
        # closure: the rates on which any row of the closure depends.
        touched_by_closure = np.zeros((len(loops.slices), loops.model.nv), dtype=bool)
        closure_of_row = np.zeros(len(loops.touched), dtype=np.intp)
        for closure, rows in enumerate(loops.slices):
            touched_by_closure[closure] = loops.touched[rows].any(axis=0)
            closure_of_row[rows] = closure
        groups = list[_GroupIndices]()
        # Some parts have no row in `_rows`, and are no groups. A free rate on which no closure
        # depends is a part without closures. If wheels slip, closures that hold rates only have no
        # row in `_rows`. (A closure that depends on no free rate is in no part.)
        for closures, columns in connected(touched_by_closure[:, free]):
            is_in_group = np.isin(closure_of_row[self._rows], closures)
            if is_in_group.any():
                groups.append(_GroupIndices(rows=self._rows[is_in_group], rates=free[columns]))
        return groups


@dataclass
class _Group:
    """A group of loops during Newton's method.

    Attributes:
        rows: Indices of its rows.
        rates: Indices of its free rates.
        least: Errors |f| that are smaller are rounding.
        sizes: |f| of the group at each configuration so far.
        halvings: How often the present step has been halved.
    """

    rows: Indices
    rates: Indices
    least: float
    sizes: list[float] = field(default_factory=list)
    halvings: int = 0

    def size(self, f: Array) -> float:
        """|f| of the group."""
        part = f[self.rows]
        return math.sqrt(part.dot(part))

    def add_error(self, f: Array) -> None:
        """Add the error at another configuration to `sizes`."""
        self.sizes.append(self.size(f))

    @property
    def improves(self) -> bool:
        """Whether another step may help.

        It may if the error is above rounding and finite, and if it has fallen by a tenth in the
        last `_PATIENCE` steps.
        """
        size = self.sizes[-1]
        if len(self.sizes) <= _PATIENCE:
            return self.least <= size < math.inf
        return self.least <= size < 0.9 * self.sizes[-1 - _PATIENCE]


def _shortest(A: Array, right: Array, tolerance: float) -> Array:
    """The shortest x with the least |A x - right|, where A is free of units.

    Singular values below `tolerance` times the largest count as zero. If the largest is below one,
    they are compared with one, the usual size of the rows of Phi. If it is far below one, all of
    them are rounding.
    """
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    rank = np.count_nonzero(s > tolerance * s.max(initial=1.0))
    return np.asarray(Vt[:rank].T @ (U[:, :rank].T @ right / s[:rank]), dtype=float)


def _within_limits(
    q: Array, rates: Indices, Phi: Array, right: Array, tolerance: float, limits: JointLimits
) -> Array:
    """Newton's step of some rates; joints at a limit stay at rest if they would step beyond it.

    The step is computed again without such joints, until no joint at a limit steps beyond it. Phi
    has the columns of these rates.
    """
    moving = np.ones(len(rates), dtype=bool)
    while True:
        step = np.zeros(len(rates))
        step[moving] = _shortest(Phi[:, moving], right, tolerance)
        beyond = moving & ~limits.can_step(q, rates, step)
        if not beyond.any():
            return step
        moving &= ~beyond
