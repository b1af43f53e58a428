# SPDX-License-Identifier: BSD-2-Clause
"""All assembly modes: the configurations with closed loops for positions of some joints.

A planar loop that two joints close is a dyad, with up to two solutions in closed form, see `dyads`.
With these joints placed, other loops may become dyads. The remaining loops are solved by Newton's
method from random starts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices, in_one_turn
from ..errors import InputError
from ..model.named_positions import with_positions
from ..model.thresholds import CLOSURE_TOLERANCE, RESTS
from ..model.tree import frame_id
from ..summaries import Summary, listed
from .assembly import Assembly
from .dyads import dyad_configurations
from .finite_motions import finite_motions
from .guesses import home_of
from .loops import connected
from .ranks import free_motions, independent_rows, rank_of, scaled_Phi

#: A search by random starts ends after this number of starts in a row without a new mode,
_STARTS = 100
#: plus this number for each mode,
_STARTS_PER_MODE = 15
#: or after this number of starts in all.
_MOST_STARTS = 3000
#: Half the ranges of random starts: for turns, [rad], and for slides, in lengths of the loop.
_TURN = np.pi
_SLIDE = 1.0
#: Configurations are the same if their keys (positions in robot lengths, rotation matrices) differ
#: by less. Where two modes meet, Newton's method has errors of the root of its tolerance.
_SAME = 1e-5


@dataclass(frozen=True, repr=False, eq=False)
class AssemblyModes(Summary):
    """Configurations with closed loops for positions of some joints, one for each mode.

    Attributes:
        q: The configurations, sorted by `branches` and then by q, shape (modes, nq).
        branches: Sign of the determinant of the free columns of Phi for each group of loops that
            share free joints, shape (modes, groups); 0 at a singular configuration.
        complete: Whether it is proved that there are no other modes.
    """

    q: Array
    branches: Indices
    complete: bool

    def __len__(self) -> int:
        return len(self.q)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        signs = {-1: "-", 0: "0", 1: "+"}
        branches = ["".join(signs[int(k)] for k in mode) for mode in self.branches]
        rows = [("branches", listed(branches, 40))]
        verdict = "all there are" if self.complete else "others may exist"
        return f"{len(self)} assembly modes, {verdict}", rows


class _Configurations(NamedTuple):
    """Configurations with closed loops, and whether it is proved that there are no others."""

    q: list[Array]
    complete: bool


class _Group(NamedTuple):
    """Rows and free rates of loops that share no free joint with others."""

    rows: Indices
    rates: Indices


def modes_of(
    assembly: Assembly,
    positions: Mapping[str, float],
    frame: str | None,
    solutions: Sequence[Array] | Array | None,
) -> AssemblyModes:
    """All modes with some joints at their positions.

    They are those of `solutions`, a complete list, if given; else they are found by dyads and
    search. Modes differ by the placements of all bodies, or of `frame` only.
    """
    search = _Search(assembly, positions, frame)
    if solutions is None:
        configurations = search.all_modes()
    else:
        configurations = _Configurations(list(solutions), complete=True)
    modes = _Distinct(search.key)
    for q in configurations.q:
        modes.add(search.in_one_turn(q))
    branches = search.branches(modes.q)
    order = sorted(range(len(branches)), key=lambda k: (*branches[k], *modes.q[k].round(6)))
    q = np.array(modes.q).reshape(-1, assembly.mechanism.model.nq)
    return AssemblyModes(q[order], branches[order], configurations.complete)


class _Distinct:
    """Configurations that differ by their keys.

    Attributes:
        q: The configurations.
    """

    def __init__(self, key: Callable[[Array], Array]) -> None:
        self.q = list[Array]()
        self._keys = list[Array]()
        self._key = key

    def add(self, q: Array) -> bool:
        """Add a configuration if it is new; returns whether it is."""
        key = self._key(q)
        if self._keys:
            distances = np.abs(np.array(self._keys) - key).max(axis=1)
            if (distances <= _SAME).any():
                return False
        self.q.append(q)
        self._keys.append(key)
        return True


class _Search:
    """Modes of one mechanism with some joints at their positions.

    The rates of these joints are held; the others are free.
    """

    def __init__(
        self, assembly: Assembly, positions: Mapping[str, float], frame: str | None
    ) -> None:
        mechanism = assembly.mechanism
        loops = assembly.loops
        self._assembly = assembly
        self._loops = loops
        self._positions = positions
        self._mechanism = mechanism
        self._model = mechanism.model
        self._space = mechanism.space
        self._frame = None if frame is None else frame_id(self._model, frame)

        held = self._space.rates_of(list(positions))
        self._free = np.setdiff1d(np.arange(self._model.nv), held)
        #: Rows that have an error, and which rates they depend on, shape (rows, nv).
        self._rows = np.flatnonzero(loops.holonomic)
        self._touched = loops.touched & loops.holonomic[:, None]
        self._groups = [
            _Group(rows, rates=self._free[columns])
            for rows, columns in connected(self._touched[:, self._free])
        ]
        home = home_of(mechanism)
        start = pin.neutral(self._model) if home is None else home
        self._start = with_positions(self._space, start, positions)
        self._require_no_freedoms()

    def _require_no_freedoms(self) -> None:
        """Raise an error if joints can move although those with positions are held."""
        mechanism = self._mechanism
        if mechanism.example is None:
            return
        Phi = scaled_Phi(mechanism, self._loops, mechanism.example)
        motions = free_motions(Phi[:, self._free])
        count = motions.shape[1]
        if count:
            moving = self._free[np.abs(motions).max(axis=1) > RESTS]
            names = listed([self._space.rate_names[k] for k in moving])
            raise InputError("positions", f"leave {count} freedoms; name {count} more of {names}")

    def all_modes(self) -> _Configurations:
        """The modes, by dyads and random starts."""
        closures = list[int]()
        for k, rows in enumerate(self._loops.slices):
            if self._loops.holonomic[rows].all():
                closures.append(k)
        modes = self._solve(self._start, self._free, closures)
        closed = list[Array]()
        for mode in modes.q:
            q = self._assembly.closer(mode, self._free)
            if self._assembly.gap(q, self._rows) == 0:
                closed.append(q)
        return _Configurations(closed, modes.complete)

    def _solve(self, q: Array, free: Indices, closures: list[int]) -> _Configurations:
        """Configurations with other positions of the rates that are still free.

        `closures` are the indices of the closures that are still open. If one of them is a dyad,
        each of its solutions is a configuration with two free rates less; the other closures are
        solved there in the same way, by recursion. Without a dyad they are solved from random
        starts.
        """
        if not len(free):
            return _Configurations([q], complete=True)
        for k in closures:
            loop = self._loops.slices[k]
            rates = free[self._touched[loop, free].any(axis=0)]
            if len(rates) != 2:
                continue
            closure = self._mechanism.closures[k]
            solutions = dyad_configurations(self._loops, closure, rates, q)
            if solutions is None:
                continue
            rows = np.arange(loop.start, loop.stop)
            other_rates = np.setdiff1d(free, rates)
            other_closures = [other for other in closures if other != k]
            modes = list[Array]()
            complete = True
            for solution in solutions:
                if self._assembly.gap(solution, rows) >= CLOSURE_TOLERANCE:
                    continue  # its axes, or other rows of the closure, do not fit
                of_solution = self._solve(solution, other_rates, other_closures)
                modes += of_solution.q
                complete = complete and of_solution.complete
            return _Configurations(modes, complete)
        return _Configurations(self._by_random_starts(q, free), complete=False)

    def _by_random_starts(self, start: Array, free: Indices) -> list[Array]:
        """Configurations by Newton's method; the search ends when no new ones are found."""
        random = np.random.default_rng(0)
        modes = _Distinct(self.key)
        turns = np.array(self._space.rate_units) == "rad"
        width = np.where(turns, _TURN, _SLIDE) * self._mechanism.rate_scale
        rows = np.flatnonzero(self._touched[:, free].any(axis=1))
        starts_without_new = 0
        for _ in range(_MOST_STARTS):
            step = np.zeros(self._model.nv)
            step[free] = width[free] * random.uniform(-1, 1, len(free))
            # First turns, then slides: a free body would move on a screw if it did both at once.
            turned = pin.integrate(self._model, start, np.where(turns, step, 0.0))
            guess = pin.integrate(self._model, turned, np.where(turns, 0.0, step))
            q = self._assembly.closer(guess, free)
            is_closed = self._assembly.gap(q, rows) == 0
            if is_closed and modes.add(q):
                self._require_isolated(q, free)
                starts_without_new = 0
            else:
                starts_without_new += 1
            if starts_without_new > _STARTS + _STARTS_PER_MODE * len(modes.q):
                break
        return modes.q

    def _require_isolated(self, q: Array, free: Indices) -> None:
        """Raise an error for a mode in which joints move although the others are held."""
        motions = finite_motions(self._assembly, q, free)
        if motions.shape[1]:
            moving = np.flatnonzero(np.abs(motions).max(axis=1) > RESTS)
            names = listed([self._space.rate_names[k] for k in moving])
            raise InputError(
                "positions",
                f"with these positions the joints {names} can move in an assembly, so that its "
                "configurations are a continuum; give other positions, or name one of these joints",
            )

    def in_one_turn(self, q: Array) -> Array:
        """q with its angles in [-pi, pi), unless that opens a loop, as with geared joints."""
        turned = np.where(np.array(self._space.position_units) == "rad", in_one_turn(q), q)
        turned = with_positions(self._space, turned, self._positions)
        return q if self._assembly.gap(turned, self._rows) else turned

    def key(self, q: Array) -> Array:
        """Placements of all bodies, or of the frame only, as one vector, free of units."""
        self._loops.evaluate(q)
        data = self._loops.data
        if self._frame is None:
            placements = [data.oMi[body] for body in self._loops.tree.bodies[1:]]
        else:
            placements = [data.oMf[self._frame]]
        parts = list[Array]()
        for placement in placements:
            parts.append(placement.translation / self._mechanism.length)
            parts.append(placement.rotation.ravel())
        return np.concatenate(parts)

    def branches(self, configurations: Sequence[Array]) -> Indices:
        """Signs of det Phi of each group, shape (configurations, groups); 0 if it is singular.

        Redundant rows are left out: the same independent rows count in all configurations, so that
        signs can be compared.
        """
        signs = np.zeros((len(configurations), len(self._groups)), dtype=int)
        if not configurations:
            return signs
        matrices = [scaled_Phi(self._mechanism, self._loops, q) for q in configurations]
        for k, group in enumerate(self._groups):
            blocks = np.array([Phi[np.ix_(group.rows, group.rates)] for Phi in matrices])
            ranks = [rank_of(sizes) for sizes in np.linalg.svd(blocks, compute_uv=False)]
            is_regular = np.array(ranks) == len(group.rates)
            if is_regular.any():
                first_regular = int(np.argmax(is_regular))
                rows = independent_rows(blocks[first_regular])
                determinants = np.linalg.det(blocks[:, rows])
                signs[:, k] = np.where(is_regular, np.sign(determinants), 0)
        return signs
