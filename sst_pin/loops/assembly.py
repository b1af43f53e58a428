# SPDX-License-Identifier: BSD-2-Clause
"""Assembly of a closed chain: Newton's method on the closures.

Each step solves Phi dq = -f for the shortest dq, and is halved until the error |f| falls. All
numbers are free of units: rows of f and Phi are multiplied by `row_scale`, rates by `rate_scale`.
Groups of loops that share no free joint are solved side by side, each with its own error and its
own step, so that one group that cannot be closed does not keep the others open.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field

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

# A row is open if its error is above both `_ASSEMBLED` and `Assembly._rounding`. Newton's method
# goes on below that, until the error is below `_POLISHED` or the rounding of the positions.
#: Largest error of an assembled configuration.
_ASSEMBLED = 1e-11
_STEPS = 100
#: A group does not close if its error falls by less than a tenth in this number of steps.
_PATIENCE = 10
#: Longest step, [rad] or lengths of the loop: closures are far from linear beyond it. Joints that
#: only linear couplings hold, such as motors behind gears, have no limit.
_STRIDE = 0.5
#: A step is rejected if the error does not fall after this number of halvings.
_HALVINGS = 20
#: Relative rounding of a position.
_ROUNDING = float(np.finfo(float).eps)
#: Newton's method goes on down to this error, although loops count as closed before.
_POLISHED = 1e-4 * _ASSEMBLED
#: Singular values below this part of the largest, or of one, count as zero.
_NO_RANK = 1e-10
#: Loops that stay open by less are tried again with the tolerance of rounded placements.
_NEARLY = 10 * ROUNDED_PLACEMENTS
#: Largest motion of a joint in `Assembly.aside`, [rad] or lengths of the loop.
_ASIDE = 0.2


class Assembly:
    """Newton's method on the closures of one mechanism; one object per thread.

    Without `slipping`, rows that hold rates only, those of rolling and brakes, also bind the steps.
    """

    def __init__(self, mechanism: Mechanism, loops: Loops, *, slipping: bool = True) -> None:
        self.mechanism, self.loops = mechanism, loops
        if slipping:
            self._rows = np.flatnonzero(loops.holonomic)
        else:
            self._rows = np.arange(len(loops.holonomic))
        self._scale = mechanism.row_scale[:, None] * mechanism.rate_scale
        self._groups_of_free: dict[bytes, list[tuple[Indices, Indices]]] = {}

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

        Brakes hold their joints if the loops can be closed so.
        """
        mechanism = self.mechanism
        if len(mechanism.braked):
            with suppress(ClosureError):
                return self.assemble(q, np.setdiff1d(mechanism.dependent, mechanism.braked))
        return self.assemble(q, mechanism.dependent)

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
        model, failures = self.mechanism.model, list[ClosureError]()
        for k in range(tries):
            start = q
            if k:
                aside = np.zeros(model.nv)
                aside[free] = 2.0 * k / (tries - 1) * random.normal(size=len(free))
                start = pin.integrate(model, q, aside * self.mechanism.rate_scale)
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
        # A projection does not depend on the basis of the motions.
        direction = motions @ (motions.T @ random.normal(size=len(motions)))
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
        """A configuration near q with the loops closed where possible, and the open rows."""
        f = self._error(q)
        groups = self._groups(free)
        for _ in range(_STEPS):
            for group in groups:
                group.sizes.append(group.size(f))
            groups = [group for group in groups if group.improves]
            if not groups:
                break
            Phi = self.loops.Phi * self._scale
            step = np.zeros(Phi.shape[1])
            for group in groups:
                A, right = Phi[group.rows], -f[group.rows]
                if limits is None:
                    part = _shortest(A[:, group.rates], right, tolerance)
                else:
                    part = _within_limits(q, group.rates, A, right, tolerance, limits)
                step[group.rates] = part * self._shortening(group.rates, part)
                if limits is not None:
                    step[group.rates] *= limits.reach(q, group.rates, step[group.rates])
            q, f = self._line_search(q, f, step, groups, Phi)
            groups = [group for group in groups if step[group.rates].any()]
        return q, self._rows[self._is_open(q, f)[self._rows]]

    def _shortening(self, rates: Indices, step: Array) -> float:
        """The factor that makes a step at most `_STRIDE` long, 1 for shorter steps."""
        longest = np.abs(step[self.loops.curved[rates]]).max(initial=0.0)
        return float(_STRIDE / max(_STRIDE, longest))

    def _line_search(
        self, q: Array, f: Array, step: Array, groups: list[_Group], Phi: Array
    ) -> tuple[Array, Array]:
        """The configuration after a step, and its errors.

        The step of each group is halved, in `step`, until the group's error falls. It becomes zero
        if the error does not fall, or if the error before the step is rounding already, which no
        step can lower.
        """
        model = self.mechanism.model
        scale = self.mechanism.rate_scale
        halvings = 0
        # Each pass halves the steps of some groups or ends them, so that the loop ends. Groups
        # share no free joint, so that they do not disturb each other.
        while True:
            trial = pin.integrate(model, q, step * scale)
            f_trial = self._error(trial)
            worse = [
                group
                for group in groups
                if step[group.rates].any() and not group.size(f_trial) < group.size(f)
            ]
            if not worse:
                return trial, f_trial
            rounding = np.maximum(_ASSEMBLED, self._rounding(q, Phi))
            for group in worse:
                is_rounding = (np.abs(f[group.rows]) < rounding[group.rows]).all()
                if is_rounding or halvings == _HALVINGS:
                    step[group.rates] = 0.0
                else:
                    step[group.rates] /= 2
            halvings += 1

    def _error(self, q: Array) -> Array:
        """f at q, shape (rows,); the loops are evaluated at q."""
        self.loops.evaluate(q)
        return self.loops.f * self.mechanism.row_scale

    # --- open rows --------------------------------------------------------------------------

    def _is_open(self, q: Array, f: Array) -> Flags:
        """Which rows are open at q by more than rounding, shape (rows,), for `_error` f of q."""
        closed = np.abs(f) < _ASSEMBLED  # not if f is NaN
        if not closed.all():
            closed |= np.abs(f) < self._rounding(q, self.loops.Phi * self._scale)
        return ~closed

    def _rounding(self, q: Array, Phi: Array) -> Array:
        """Rounding of f, shape (rows,); the loops are evaluated at q or near it.

        It grows with turns of the joints and with the distance of the loops from the origin.
        """
        # Joints whose coordinate is one number, which may contain many turns.
        entries, rates = self.mechanism.space.plain
        turns = np.abs(Phi[:, rates]) @ np.abs(q[entries] / self.mechanism.rate_scale[rates])
        distances = self.loops.largest_coordinates * self.mechanism.row_scale
        return 4 * _ROUNDING * (turns + distances)

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
            self._groups_of_free[key] = self._rows_and_rates(free)
        rounding = _ROUNDING * self.loops.largest_coordinates * self.mechanism.row_scale
        return [
            _Group(rows, rates, max(_POLISHED, float(rounding[rows].max(initial=0.0))))
            for rows, rates in self._groups_of_free[key]
        ]

    def _rows_and_rates(self, free: Indices) -> list[tuple[Indices, Indices]]:
        """Rows and free rates of each group of loops that share no free joint."""
        loops, nv = self.loops, self.loops.model.nv
        of_closures = np.zeros((len(loops.slices), nv), dtype=bool)
        closure_of_row = np.zeros(len(loops.touched), dtype=np.intp)
        for k, rows in enumerate(loops.slices):
            of_closures[k] = loops.touched[rows].any(axis=0)
            closure_of_row[rows] = k
        groups = list[tuple[Indices, Indices]]()
        for closures, columns in connected(of_closures[:, free]):
            rows_of_group = self._rows[np.isin(closure_of_row[self._rows], closures)]
            if len(rows_of_group):
                groups.append((rows_of_group, free[columns]))
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

    @property
    def improves(self) -> bool:
        """Whether the group is open, and its error has fallen in the last steps."""
        size = self.sizes[-1]
        if len(self.sizes) <= _PATIENCE:
            return self.least <= size < math.inf
        return self.least <= size < 0.9 * self.sizes[-1 - _PATIENCE]


def _shortest(A: Array, right: Array, tolerance: float) -> Array:
    """The shortest x with the least |A x - right|, for rows free of units.

    Singular values below `tolerance` times the largest count as zero. The largest counts as one at
    least, as rows that hold a motion have the natural size one.
    """
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    rank = np.count_nonzero(s > tolerance * s.max(initial=1.0))
    return np.asarray(Vt[:rank].T @ (U[:, :rank].T @ right / s[:rank]), dtype=float)


def _within_limits(
    q: Array, rates: Indices, Phi: Array, right: Array, tolerance: float, limits: JointLimits
) -> Array:
    """Newton's step of some rates; those that lead beyond a limit stay at rest.

    Without them the others take another step, which may lead to another limit.
    """
    moving = np.ones(len(rates), dtype=bool)
    while True:
        step = np.zeros(len(rates))
        step[moving] = _shortest(Phi[:, rates[moving]], right, tolerance)
        beyond = moving & ~limits.allowed(q, rates, step)
        if not beyond.any():
            return step
        moving &= ~beyond
