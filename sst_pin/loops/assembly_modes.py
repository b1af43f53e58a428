# SPDX-License-Identifier: BSD-2-Clause
"""All assembly modes: the configurations with closed loops for positions of some joints.

A planar loop that two free joints close is a dyad. It has up to two solutions in closed form; see
`dyads`. Once these two joints are placed, other loops may become dyads. The loops that remain are
solved by Newton's method from random starts.

`modes_of` is the main function. `_Search` finds the configurations.
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

# A search by random starts ends after `_STARTS` + `_STARTS_PER_MODE` (modes found so far) starts in
# a row without a new mode, or after `_MOST_STARTS` starts in all. These numbers are choices: with
# fewer starts, modes are missed.
_STARTS = 100
_STARTS_PER_MODE = 15
_MOST_STARTS = 3000
#: Random starts turn joints by at most this angle in each direction, [rad]: a whole turn.
_TURN = np.pi
#: Random starts shift joints by at most this in each direction, in lengths of the loop.
_SLIDE = 1.0
#: Configurations are the same if their keys (positions in robot lengths, rotation matrices) differ
#: by less. Where two modes meet, the error of the loops grows with the square of the distance from
#: the mode. So if the loops are closed to 1e-11, configurations of one mode differ by up to 3e-6.
_SAME = 1e-5


@dataclass(frozen=True, repr=False, eq=False)
class AssemblyModes(Summary):
    """Configurations with closed loops for positions of some joints, one for each mode.

    Attributes:
        q: The configurations, sorted by `branches` and then by q, shape (modes, nq).
        branches: For each group of loops that share free joints, the sign of the determinant of
            its rows of Phi, in the columns of its free rates, shape (modes, groups); 0 where it is
            singular. Redundant rows are left out, the same ones in all modes.
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

    Args:
        assembly: Newton's method on the closures of the robot.
        positions: Positions by the names of joints, [rad] or [m].
        frame: Modes that differ only by bodies away from this frame are one mode; None to
            distinguish the placements of all bodies.
        solutions: All configurations, if they are known; else they are searched.
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
    # Sorted by the branches, then by q; rounded, so that rounding of q does not change the order.
    order = sorted(range(len(branches)), key=lambda k: (*branches[k], *modes.q[k].round(6)))
    q = np.array(modes.q).reshape(-1, assembly.mechanism.model.nq)
    return AssemblyModes(q[order], branches[order], configurations.complete)


class _Distinct:
    """A list of configurations without repetitions.

    Configurations are the same if their keys, which `key` computes, differ by at most `_SAME`.

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
        """Raise an error if, in general, joints can move although those with positions are held.

        This is judged at the example of the mechanism.
        """
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
        """The configurations with closed loops, by dyads and random starts."""
        closures = list[int]()  # indices of the closures without rows that hold rates only
        for k, rows in enumerate(self._loops.slices):
            if self._loops.holonomic[rows].all():
                closures.append(k)
        solutions = self._solve(self._start, self._free, closures)
        # Solutions of dyads are closed to their tolerance; Newton's method improves them.
        closed = list[Array]()
        for solution in solutions.q:
            q = self._assembly.closer(solution, self._free)
            if self._assembly.gap(q, self._rows) == 0:
                closed.append(q)
        return _Configurations(closed, solutions.complete)

    def _solve(self, q: Array, free: Indices, closures: list[int]) -> _Configurations:
        """Configurations that differ from q by the positions of the free rates, with closed loops.

        `closures` are the indices of the closures that are still open. If one of them is a dyad,
        each of its solutions is a configuration with two free rates fewer. There the other closures
        are solved in the same way, by recursion. If none is a dyad, they are solved from random
        starts.
        """
        if not len(free):
            return _Configurations([q], complete=True)
        for k in closures:
            at = self._loops.slices[k]
            rates = free[self._touched[at, free].any(axis=0)]  # the free rates of this closure
            if len(rates) != 2:
                continue
            closure = self._mechanism.closures[k]
            solutions = dyad_configurations(self._loops, closure, rates, q)
            if solutions is None:
                continue  # the closure is no dyad
            rows = np.arange(at.start, at.stop)
            other_rates = np.setdiff1d(free, rates)
            other_closures = [other for other in closures if other != k]
            configurations = list[Array]()
            complete = True
            for solution in solutions:
                if self._assembly.gap(solution, rows) >= CLOSURE_TOLERANCE:
                    continue  # the points meet, but other rows of the closure are open
                of_solution = self._solve(solution, other_rates, other_closures)
                configurations += of_solution.q
                complete = complete and of_solution.complete
            return _Configurations(configurations, complete)
        return _Configurations(self._by_random_starts(q, free), complete=False)

    def _by_random_starts(self, start: Array, free: Indices) -> list[Array]:
        """Configurations by Newton's method; the search ends when no new ones are found.

        Random starts differ from `start` by the free rates.
        """
        random = np.random.default_rng(0)
        modes = _Distinct(self.key)
        turns = np.array(self._space.rate_units) == "rad"
        width = np.where(turns, _TURN, _SLIDE) * self._mechanism.rate_scale
        rows = np.flatnonzero(self._touched[:, free].any(axis=1))
        starts_without_new = 0
        for _ in range(_MOST_STARTS):
            step = np.zeros(self._model.nv)
            step[free] = width[free] * random.uniform(-1, 1, len(free))
            # The two parts of the step are taken one after the other: if a free body turned and
            # shifted at once, it would move on a screw.
            after_turns = pin.integrate(self._model, start, np.where(turns, step, 0.0))
            guess = pin.integrate(self._model, after_turns, np.where(turns, 0.0, step))
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
        """q with its angles in [-pi, pi), unless that opens a loop, as with geared joints.

        The joints with positions keep these, which may be more than a turn.
        """
        wrapped = np.where(np.array(self._space.position_units) == "rad", in_one_turn(q), q)
        wrapped = with_positions(self._space, wrapped, self._positions)
        return q if self._assembly.gap(wrapped, self._rows) else wrapped

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
        """`AssemblyModes.branches` of configurations, shape (configurations, groups)."""
        signs = np.zeros((len(configurations), len(self._groups)), dtype=int)
        if not configurations:
            return signs
        matrices = [scaled_Phi(self._mechanism, self._loops, q) for q in configurations]
        for k, group in enumerate(self._groups):
            blocks = np.array([Phi[np.ix_(group.rows, group.rates)] for Phi in matrices])
            ranks = [rank_of(sizes) for sizes in np.linalg.svd(blocks, compute_uv=False)]
            is_regular = np.array(ranks) == len(group.rates)
            if is_regular.any():
                # The same independent rows in all configurations, so that signs can be compared.
                first_regular = int(np.argmax(is_regular))
                rows = independent_rows(blocks[first_regular])
                determinants = np.linalg.det(blocks[:, rows])
                signs[:, k] = np.where(is_regular, np.sign(determinants), 0)
        return signs
