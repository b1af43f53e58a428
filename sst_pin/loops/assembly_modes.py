# SPDX-License-Identifier: BSD-2-Clause
"""All assembly modes: the configurations with closed loops for positions of some joints.

A planar loop that two joints close is a dyad, with up to two solutions in closed form, see `dyads`.
With these joints placed, other loops may become dyads. The remaining loops are solved by Newton's
method from random starts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

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

#: A search ends after _STARTS + _STARTS_PER_MODE * modes starts in a row without a new mode, or
#: after _MOST_STARTS starts in all.
_STARTS, _STARTS_PER_MODE, _MOST_STARTS = 100, 15, 3000
#: Half the range of random starts, [rad] or lengths of the loop.
_TURN, _SLIDE = np.pi, 1.0
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


def modes_of(
    assembly: Assembly,
    positions: Mapping[str, float],
    frame: str | None,
    solutions: Sequence[Array] | Array | None,
) -> AssemblyModes:
    """All modes: those of `solutions`, a complete list, if given; else by dyads and search."""
    search, complete = _Search(assembly, positions, frame), True
    if solutions is None:
        solutions, complete = search.all_modes()
    modes = _Distinct(search.key)
    for q in solutions:
        modes.add(search.in_one_turn(q))
    branches = search.branches(modes.q)
    order = sorted(range(len(branches)), key=lambda k: (*branches[k], *modes.q[k].round(6)))
    q = np.array(modes.q).reshape(-1, assembly.mechanism.model.nq)
    return AssemblyModes(q[order], branches[order], complete)


class _Distinct:
    """Configurations that differ by their keys."""

    def __init__(self, key: Callable[[Array], Array]) -> None:
        self.q, self._keys, self._key = list[Array](), list[Array](), key

    def add(self, q: Array) -> bool:
        """Add a configuration if it is new."""
        key = self._key(q)
        new = not self.q or bool((np.abs(np.array(self._keys) - key).max(axis=1) > _SAME).all())
        if new:
            self.q.append(q)
            self._keys.append(key)
        return new


class _Search:
    """Modes of one mechanism with some joints at their positions."""

    def __init__(
        self, assembly: Assembly, positions: Mapping[str, float], frame: str | None
    ) -> None:
        self._assembly, self._loops, self._positions = assembly, assembly.loops, positions
        self._mechanism = mechanism = assembly.mechanism
        self._model, self._space = mechanism.model, mechanism.space
        self._frame = None if frame is None else frame_id(self._model, frame)
        named = self._space.rates_of(list(positions))
        self._free = free = np.setdiff1d(np.arange(self._model.nv), named)
        self._rows = np.flatnonzero(self._loops.holonomic)
        self._touched = self._loops.touched & self._loops.holonomic[:, None]
        self._parts = [(rows, free[k]) for rows, k in connected(self._touched[:, free])]
        home = home_of(mechanism)
        start = pin.neutral(self._model) if home is None else home
        self._start = with_positions(self._space, start, positions)
        if mechanism.example is not None:
            motions = free_motions(scaled_Phi(mechanism, self._loops, mechanism.example)[:, free])
            if k := motions.shape[1]:
                moving = free[np.abs(motions).max(axis=1) > RESTS]
                names = listed([self._space.rate_names[i] for i in moving])
                raise InputError("positions", f"leave {k} freedoms; name {k} more of {names}")

    def all_modes(self) -> tuple[list[Array], bool]:
        """Configurations, and whether these are all."""
        closures = [k for k, s in enumerate(self._loops.slices) if self._loops.holonomic[s].all()]
        modes, complete = self._solve(self._start, self._free, closures)
        closer = [self._assembly.closer(q, self._free) for q in modes]
        return [q for q in closer if not self._assembly.gap(q, self._rows)], complete

    def _solve(self, q: Array, free: Indices, closures: list[int]) -> tuple[list[Array], bool]:
        """Configurations with other positions of the free rates, and whether these are all.

        Dyads among the closures are solved one after the other, each in the configurations of the
        one before. The other loops are solved from random starts.
        """
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
            others = [other for other in closures if other != k]
            modes, complete = list[Array](), True
            for solution in solutions:
                if self._assembly.gap(solution, rows) >= CLOSURE_TOLERANCE:
                    continue  # its axes, or other rows of the closure, do not fit
                of_solution, all_there_are = self._solve(
                    solution, np.setdiff1d(free, rates), others
                )
                modes += of_solution
                complete &= all_there_are
            return modes, complete
        if not len(free):
            return [q], True
        return self._by_random_starts(q, free), False

    def _by_random_starts(self, start: Array, free: Indices) -> list[Array]:
        """Configurations by Newton's method; the search ends when no new ones are found."""
        random, modes, starts_without_new = np.random.default_rng(0), _Distinct(self.key), 0
        turns = np.array(self._space.rate_units) == "rad"
        width = np.where(turns, _TURN, _SLIDE) * self._mechanism.rate_scale
        rows = np.flatnonzero(self._touched[:, free].any(axis=1))
        for _ in range(_MOST_STARTS):
            step = np.zeros(self._model.nv)
            step[free] = width[free] * random.uniform(-1, 1, len(free))
            # A free body would move on a screw if it turned and slid at once.
            turned = pin.integrate(self._model, start, np.where(turns, step, 0.0))
            guess = pin.integrate(self._model, turned, np.where(turns, 0.0, step))
            q = self._assembly.closer(guess, free)
            if not self._assembly.gap(q, rows) and modes.add(q):
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
        """Poses of all bodies, or of the frame only, in a row, free of units."""
        self._loops.evaluate(q)
        data = self._loops.data
        if self._frame is None:
            places = [data.oMi[body] for body in self._loops.tree.bodies[1:]]
        else:
            places = [data.oMf[self._frame]]
        numbers = list[Array]()
        for place in places:
            numbers += [place.translation / self._mechanism.length, place.rotation.ravel()]
        return np.concatenate(numbers)

    def branches(self, configurations: Sequence[Array]) -> Indices:
        """Sign of det Phi of each part, independent rows only; 0 if it is singular."""
        signs = np.zeros((len(configurations), len(self._parts)), dtype=int)
        matrices = [scaled_Phi(self._mechanism, self._loops, q) for q in configurations]
        for k, part in enumerate(self._parts):
            blocks = [Phi[np.ix_(*part)] for Phi in matrices]
            sizes = [np.linalg.svd(block, compute_uv=False) for block in blocks]
            regular = np.array([rank_of(x) == len(part[1]) for x in sizes], dtype=bool)
            if regular.any():
                # The same independent rows in all modes, so that signs can be compared.
                rows = independent_rows(blocks[int(np.argmax(regular))])
                determinants = np.linalg.det([block[rows] for block in blocks])
                signs[:, k] = np.where(regular, np.sign(determinants), 0)
        return signs
