# SPDX-License-Identifier: BSD-2-Clause
"""Assembly of a closed chain: Newton's method on the closures, loop by loop."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from zlib import crc32

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags, Indices
from ..errors import ClosureError, DescriptionError, InputError
from ..model.mechanism import Mechanism
from ..model.thresholds import ROUNDED_PLACEMENTS
from ..summaries import listed
from .loops import Loops, connected
from .mobility import free_motions, scaled_Phi

_STEPS = 100
#: Largest scaled error of an assembled configuration.
_ASSEMBLED = 1e-11
#: A loop does not close if its error falls by less than a tenth in this number of steps.
_PATIENCE = 10
#: Longest step, [rad] or of the loop's length: closures are far from linear beyond it. Joints that
#: only linear couplings hold, such as motors behind gears, have no limit.
_STRIDE = 0.5
#: A step is rejected if the error does not fall after this number of halvings.
_HALVINGS = 20
#: Joints at a smaller scaled distance from a limit are at the limit.
_AT_LIMIT = 1e-12
#: Relative rounding of a position.
_ROUNDING = float(np.finfo(float).eps)
#: Singular values below this part of the largest, or of one, count as zero.
_NO_RANK = 1e-10
#: Loops that stay open by less, without units, are tried again with that tolerance.
_NEARLY = 10 * ROUNDED_PLACEMENTS
_NONE = np.zeros(0, dtype=np.intp)
#: Largest motion of a joint in `Assembly.aside`, [rad] or lengths of the loop.
_ASIDE = 0.2


class Assembly:
    """Newton's method on the closures of one mechanism; one object per thread.

    Loops that share no joints are solved separately. If not `slipping`, each Newton step also
    satisfies the rolling constraints.
    """

    def __init__(self, mechanism: Mechanism, loops: Loops, *, slipping: bool = True) -> None:
        self.mechanism, self.loops = mechanism, loops
        self._rows = np.flatnonzero(loops.holonomic | (not slipping))
        self._scale = mechanism.row_scale[:, None] * mechanism.rate_scale
        self._known_parts: dict[bytes, list[tuple[Indices, Indices]]] = {}

    def assemble(self, q: Array, free: Indices, *, limits: bool = False) -> Array:
        """A configuration with closed loops near q; only the rates `free` move.

        With `limits` joints of one coordinate stay within their limits. The error names the loops
        that stay open, the largest gap, and the joints at their limits.
        """
        bounds = _Limits(self.mechanism, free, limits)
        start = bounds.clipped(q)
        q, open_rows = self._newton(start, free, bounds)
        if len(open_rows) and np.abs(self._residual(q)).max() < _NEARLY:
            # Rows that contradict each other a little may lead away from the best pose.
            q, open_rows = self._newton(start, free, bounds, ROUNDED_PLACEMENTS)
        q = bounds.clipped(q)
        bounds.require_within(q)
        if len(open_rows):
            loops, mechanism = self.loops, self.mechanism
            largest = float(np.abs(loops.f)[open_rows].max())
            names = [
                str(closure)
                for closure, rows in zip(mechanism.closures, loops.slices, strict=True)
                if np.isin(open_rows, np.arange(rows.start, rows.stop)).any()
            ]
            raise ClosureError(
                f"the loops cannot be closed from this guess{bounds.reached(q)}: {largest:.3g} "
                f"(m or rad) stays open at {listed(names, 4)}; start closer to a closed "
                "configuration, hold fewer joints (fixed=), try several starts (tries=), or check "
                "the geometry",
                largest,
            )
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

    def try_starts(
        self, q: Array, free: Indices, tries: int, seed: int, *, limits: bool = False
    ) -> Array:
        """The first assembly from q and random starts around it; the error is that of the best."""
        if tries == 1:
            return self.assemble(q, free, limits=limits)
        random = np.random.default_rng(seed)
        model, failures = self.mechanism.model, []
        for k in range(tries):
            width = 2.0 * k / max(tries - 1, 1)
            aside = np.zeros(model.nv)
            aside[free] = width * random.normal(size=len(free))
            start = pin.integrate(model, q, aside * self.mechanism.rate_scale)
            try:
                return self.assemble(start, free, limits=limits)
            except ClosureError as error:
                failures.append(error)
        raise min(failures, key=lambda error: error.residual)

    def closer(self, q: Array, free: Indices, tolerance: float = _NO_RANK) -> Array:
        """A configuration near q with a locally least error; only the rates `free` move.

        Singular values of Phi below `tolerance` times the largest of their loop count as zero.
        """
        return self._newton(q, free, _Limits(self.mechanism, free, wanted=False), tolerance)[0]

    def gap(self, q: Array, rows: Indices) -> float:
        """Largest error of some rows at q, free of units; 0 if it is rounding."""
        f = self._residual(q)
        return float(np.abs(f[rows]).max()) if self._open(q, f)[rows].any() else 0.0

    def near(self, q: Array, fixed: Indices) -> Array:
        """A configuration with closed loops near q; the rates `fixed` are held if possible."""
        rates = np.arange(self.mechanism.model.nv)
        try:
            return self.assemble(q, np.setdiff1d(rates, fixed))
        except ClosureError:
            return self.assemble(q, rates)

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

    def _newton(
        self, q: Array, free: Indices, bounds: _Limits, tolerance: float = _NO_RANK
    ) -> tuple[Array, Indices]:
        """A configuration near q with the loops closed where possible, and the open rows."""
        f = self._residual(q)
        key = free.tobytes()
        if key not in self._known_parts:
            parts = list(self._parts(free))
            self._known_parts[key] = parts
        parts = self._known_parts[key]
        rounding = _ROUNDING * self.loops.largest_coordinates * self.mechanism.row_scale
        least = np.array(
            [max(1e-4 * _ASSEMBLED, rounding[rows].max(initial=0.0)) for rows, _ in parts]
        )
        before = [np.full(len(parts), np.inf)] * _PATIENCE
        open_still = np.ones(len(parts), dtype=bool)
        for _ in range(_STEPS):
            sizes = np.array([_size(f[rows]) for rows, _ in parts])
            open_still &= (sizes >= least) & (sizes < 0.9 * before[-_PATIENCE])
            busy = [parts[k] for k in np.flatnonzero(open_still)]
            if not busy:
                break
            before.append(sizes)
            Phi = self.loops.Phi * self._scale
            step = np.zeros(Phi.shape[1])
            for rows, of_loop in busy:
                columns, part = bounds.project(q, of_loop, Phi[rows], -f[rows], tolerance)
                far = float(np.abs(part[self.loops.curved[columns]]).max(initial=0))
                step[columns] = part * (_STRIDE / max(_STRIDE, far))
                step[columns] *= bounds.reach(q, columns, step[columns])
            q, f = self._descend(q, f, step, busy, Phi)
            open_still &= [step[columns].any() for _, columns in parts]
        return q, self._rows[self._open(q, f)[self._rows]]

    def _open(self, q: Array, f: Array) -> Flags:
        """Which rows are open by more than rounding, shape (rows,), at the current q."""
        is_open = ~(np.abs(f) < _ASSEMBLED)
        if is_open.any():
            is_open &= ~(np.abs(f) < self._rounding(q, self.loops.Phi * self._scale))
        return is_open

    def _rounding(self, q: Array, Phi: Array) -> Array:
        """Rounding of f, shape (rows,), for Phi without units.

        It grows with turns of the joints and with the distance of the loops from the origin.
        """
        entries, rates = self.mechanism.space.plain
        size = np.abs(Phi[:, rates]) @ np.abs(q[entries] / self.mechanism.rate_scale[rates])
        return 4 * _ROUNDING * (size + self.loops.largest_coordinates * self.mechanism.row_scale)

    def _descend(
        self,
        q: Array,
        f: Array,
        step: Array,
        parts: list[tuple[Indices, Indices]],
        Phi: Array,
    ) -> tuple[Array, Array]:
        """Halve each loop's step until its residual falls, to zero if it never does."""
        model, scale = self.mechanism.model, self.mechanism.rate_scale
        for halvings in range(_HALVINGS + 1):
            trial = pin.integrate(model, q, step * scale)
            f_trial = self._residual(trial)
            worse = [
                (rows, columns)
                for rows, columns in parts
                if step[columns].any() and not _size(f_trial[rows]) < _size(f[rows])
            ]
            if not worse:
                break
            least = np.maximum(_ASSEMBLED, self._rounding(q, Phi))
            for rows, columns in worse:
                step[columns] /= 2
                if halvings == _HALVINGS - 1 or (np.abs(f[rows]) < least[rows]).all():
                    step[columns] = 0.0  # a dead end, or rounding
        return (trial, f_trial) if step.any() else (q, self._residual(q))

    def _residual(self, q: Array) -> Array:
        """f at q, free of units, shape (rows,); the loops are evaluated at q."""
        self.loops.evaluate(q)
        return self.loops.f * self.mechanism.row_scale

    def _parts(self, free: Indices) -> Iterator[tuple[Indices, Indices]]:
        """Rows and free rates of each part; parts share no rows and no free rates."""
        loops = self.loops
        of_closures = np.array([loops.touched[rows].any(axis=0) for rows in loops.slices])
        number = np.repeat(np.arange(len(loops.slices)), [s.stop - s.start for s in loops.slices])
        for closures, columns in connected(of_closures.reshape(-1, loops.model.nv)[:, free]):
            rows = self._rows[np.isin(number[self._rows], closures)]
            if len(rows):
                yield rows, free[columns]


def _size(f: Array) -> float:
    return math.sqrt(f.dot(f))


def _shortest(A: Array, right: Array, tolerance: float) -> Array:
    """The shortest x with the least |A x - right|, for rows free of units.

    Singular values below `tolerance` times the largest count as zero. The largest counts as one at
    least, as rows that hold a motion have the natural size one.
    """
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    rank = np.count_nonzero(s > tolerance * s.max(initial=1.0))
    return np.asarray(Vt[:rank].T @ (U[:, :rank].T @ right / s[:rank]), dtype=float)


class _Limits:
    """Limits of all joints of one coordinate; only the rates `free` move. None if not `wanted`."""

    def __init__(self, mechanism: Mechanism, free: Indices, wanted: bool) -> None:
        model, self._mechanism = mechanism.model, mechanism
        self._q = self._v = self._may_move = _NONE
        if not wanted:
            return
        joints = list(model.joints)[1:]
        single = [(j.idx_q, j.idx_v) for j in joints if (j.nq, j.nv) == (1, 1)]
        self._q, self._v = np.array(single, dtype=np.intp).reshape(-1, 2).T
        self._lower, self._upper = model.lowerPositionLimit, model.upperPositionLimit
        self._may_move = self._q[np.isin(self._v, free)]

    def clipped(self, q: Array) -> Array:
        """The nearest configuration within the limits."""
        q, k = q.copy(), self._may_move
        if len(k):
            q[k] = np.clip(q[k], self._lower[k], self._upper[k])
        return q

    def project(
        self, q: Array, columns: Indices, Phi: Array, right: Array, rcond: float
    ) -> tuple[Indices, Array]:
        """Newton's step without the rates that lead beyond a limit."""
        while True:
            part = _shortest(Phi[:, columns], right, rcond)
            if not len(self._v):
                return columns, part
            down, up = self._room(q)[:, columns]
            outward = np.where(part < 0, down, up) <= _AT_LIMIT
            if not outward.any():
                return columns, part
            columns = columns[~outward]

    def reach(self, q: Array, columns: Indices, step: Array) -> float:
        """The part of a step that reaches the first limit, at most 1."""
        if not len(self._v):
            return 1.0
        down, up = self._room(q)[:, columns]
        room = np.where(step < 0, down, up)
        return float((room / np.maximum(np.abs(step), 1e-300)).min(initial=1.0))

    def require_within(self, q: Array) -> None:
        """Raise an error for joints outside their limits, and for empty ranges."""
        if not len(self._v):
            return
        room = self._room(q).min(axis=0)
        if (room < 0).any():
            raise ClosureError(
                f"fixed outside their limits, or with empty ranges: {self._names(room < 0)}; fix "
                "fewer joints, start within the limits, or correct the limits",
                float(-(room * self._mechanism.rate_scale).min()),
            )

    def reached(self, q: Array) -> str:
        """Which joints are at their limits, in words."""
        if not len(self._v):
            return ""
        at = self._room(q).min(axis=0) <= _AT_LIMIT
        return f" within the joint limits ({self._names(at) or 'none'} at a limit)"

    def _room(self, q: Array) -> Array:
        """Distances to the lower and upper limits, scaled, shape (2, nv)."""
        room = np.full((2, self._mechanism.model.nv), np.inf)
        k = self._q
        room[:, self._v] = q[k] - self._lower[k], self._upper[k] - q[k]
        return room / self._mechanism.rate_scale

    def _names(self, chosen: Flags) -> str:
        return ", ".join(np.array(self._mechanism.space.rate_names)[chosen])


def displacement(mechanism: Mechanism, width: float) -> Array:
    """A random displacement up to 1.5 `width`, the same for the same joint names, (nv,)."""
    step = np.zeros(mechanism.model.nv)
    for name, rates in mechanism.space.rates.items():
        step[rates] = width * np.array(_drawn(round(1000 * width), name, len(rates)))
    return step * mechanism.rate_scale


@lru_cache(maxsize=10_000)
def _drawn(seed: int, name: str, count: int) -> tuple[float, ...]:
    """Random numbers, always the same for a seed and a name."""
    random = np.random.default_rng([seed, crc32(name.encode())])
    return tuple(random.uniform(-1.5, 1.5, count))


def home_of(mechanism: Mechanism) -> Array | None:
    """The configuration named home, shape (nq,), even if its loops are open; or None."""
    model = mechanism.model
    known = model.referenceConfigurations
    if "home" not in known:
        return None
    home = np.array(known["home"])
    problem = f"home: {home.size} numbers; {model.nq} finite ones are needed"
    if home.shape == (model.nq,) and np.isfinite(home).all():
        try:
            return mechanism.space.normalised(home)
        except InputError as error:
            problem = f"home: {error.args[0].removeprefix('q: ')}"
    raise DescriptionError(f"model {model.name}", [problem])
