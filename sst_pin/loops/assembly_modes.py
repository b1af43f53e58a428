# SPDX-License-Identifier: BSD-2-Clause
"""All assembly modes: the configurations with closed loops where some joints are held.

Loops that share no free joint are solved apart. A loop that two parallel hinges close, a planar
dyad, is a triangle with two solutions; after it others may be dyads too. The rest is searched from
random starts by Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices, in_one_turn
from ..errors import InputError
from ..model.closures import Closure, holds_points
from ..model.named_positions import put
from ..model.thresholds import CLOSURE_TOLERANCE, RANK_TOLERANCE
from ..model.tree import frame_id
from ..summaries import Summary, listed
from .assembly import Assembly, home_of
from .loops import connected
from .mobility import independent_rows, scaled_Phi

#: A search ends after so many starts, and so many for each mode, without a new mode; or after most.
_STARTS, _STARTS_PER_MODE, _MOST_STARTS = 100, 15, 3000
#: Half the range of random starts, [rad] or lengths of the loop.
_TURN, _SLIDE = np.pi, 1.0
#: After so many modes a search stops if all of them can move.
_JUDGED = 3
#: Configurations that differ by less are one, [rad] or lengths of the loop: Newton's method leaves
#: the root of its tolerance where two modes meet.
_ONE = 1e-5
#: Directions and cosines that differ by less are equal, and so are points, in robot lengths.
_EQUAL = 1e-9


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
        rows = [("branches", listed(["".join("-0+"[k + 1] for k in x) for x in self.branches], 40))]
        verdict = "all there are" if self.complete else "others may exist"
        return f"{len(self)} assembly modes, {verdict}", rows


def modes_of(
    assembly: Assembly,
    positions: Mapping[str, float],
    frame: str | None,
    solutions: Array | None = None,
) -> AssemblyModes:
    """All modes, in closed form or by search; or `solutions`, if these are all."""
    mechanism, home = assembly.mechanism, home_of(assembly.mechanism)
    start = pin.neutral(mechanism.model) if home is None else home
    search = _Search(assembly, put(mechanism.space, start, positions), positions, frame)
    candidates, complete = (solutions, True) if solutions is not None else search.all_modes()
    modes = search.distinct(candidates)
    branches = search.branches(modes)
    order = sorted(range(len(modes)), key=lambda k: (*branches[k], *modes[k].round(6)))
    q = np.array(modes).reshape(-1, search.model.nq)
    return AssemblyModes(q[order], branches[order], complete)


class _Search:
    """Modes of one mechanism with all joints of `held` at their positions in `start`."""

    def __init__(
        self, assembly: Assembly, start: Array, held: Iterable[str], frame: str | None
    ) -> None:
        self._assembly, self._loops, self._start = assembly, assembly.loops, start
        self._mechanism, self.model = assembly.mechanism, assembly.mechanism.model
        space = self._mechanism.space
        self._frame = None if frame is None else frame_id(self.model, frame)
        self._free = np.setdiff1d(np.arange(self.model.nv), space.rates_of(list(held)))
        self._touched = self._loops.touched & self._loops.holonomic[:, None]
        self._parts = [(rows, self._free[k]) for rows, k in connected(self._touched[:, self._free])]
        if loose := [k for rows, rates in self._parts if not len(rows) for k in rates]:
            names = listed([space.rate_names[k] for k in loose])
            raise InputError("positions", f"no loop holds {names}; give their positions")
        self._turns = np.array(space.rate_units) == "rad"
        units, entries = np.array(space.position_units), np.zeros(self.model.nq, bool)
        for joint in list(self.model.joints)[1:]:
            entries[joint.idx_q : joint.idx_q + joint.nq] = joint.idx_v in self._free
        self._angles = (units == "rad") & entries

    def all_modes(self) -> tuple[list[Array], bool]:
        """Configurations, and whether these are all."""
        of_parts: list[list[Array]] = []
        complete = True
        for rows, rates in self._parts:
            closures = [k for k, s in enumerate(self._loops.slices) if s.start in rows]
            modes = self._by_dyads(self._start, set(rates.tolist()), closures)
            complete &= modes is not None
            modes = self._by_starts(rows, rates) if modes is None else modes
            closer = [self._assembly.closer(q, rates) for q in modes]
            of_parts.append([q for q in closer if not self._assembly.gap(q, rows)])
        return [self._combined(parts) for parts in product(*of_parts)], complete

    def _combined(self, configurations: Sequence[Array]) -> Array:
        """The configuration with the free joints of each part from another one."""
        way = np.zeros(self.model.nv)
        for q, (_, rates) in zip(configurations, self._parts, strict=True):
            way[rates] = pin.difference(self.model, self._start, q)[rates]
        return np.asarray(pin.integrate(self.model, self._start, way))

    # --- random starts ----------------------------------------------------------------------

    def _by_starts(self, rows: Indices, rates: Indices) -> list[Array]:
        random, modes, idle = np.random.default_rng(0), _Distinct(self._key), 0
        width = np.where(self._turns, _TURN, _SLIDE) * self._mechanism.rate_scale
        for _ in range(_MOST_STARTS):
            way = np.zeros(self.model.nv)
            way[rates] = width[rates] * random.uniform(-1, 1, len(rates))
            q = pin.integrate(self.model, self._start, way * self._turns)
            q = pin.integrate(self.model, q, way * ~self._turns)
            q = self._assembly.closer(q, rates)
            idle += 1
            if not self._assembly.gap(q, rows) and modes.add(q):
                idle = 0
                if len(modes.q) == _JUDGED:
                    self._regular(modes.q, rows, rates)
            if idle > _STARTS + _STARTS_PER_MODE * len(modes.q):
                break
        return modes.q

    def distinct(self, configurations: Iterable[Array]) -> list[Array]:
        """Configurations that differ, their angles in one turn where the loops allow it."""
        modes, rows = _Distinct(self._key), np.arange(len(self._loops.touched))
        for q in configurations:
            turned = np.where(self._angles, in_one_turn(q), q)
            modes.add(q if self._assembly.gap(turned, rows) else turned)
        return modes.q

    def _key(self, q: Array) -> Array:
        """Where all bodies are, or the frame: numbers free of units."""
        self._loops.evaluate(q)
        data, bodies = self._loops.data, self._loops.tree.bodies[1:]
        frame = self._frame
        places = [data.oMi[j] for j in bodies] if frame is None else [data.oMf[frame]]
        columns = [(x.translation / self._mechanism.length, x.rotation) for x in places]
        return np.concatenate([np.column_stack(pair).ravel() for pair in columns])

    def branches(self, configurations: Sequence[Array]) -> Indices:
        """Signs of determinants; refuses modes that are not isolated."""
        signs = np.zeros((len(configurations), len(self._parts)), dtype=int)
        for k, (rows, rates) in enumerate(self._parts if configurations else ()):
            blocks, regular = self._regular(configurations, rows, rates)
            chosen = independent_rows(blocks[regular.index(True)])
            signs[:, k] = np.sign(np.linalg.det([x[chosen] for x in blocks])) * regular
        return signs

    def _regular(
        self, configurations: Sequence[Array], rows: Indices, rates: Indices
    ) -> tuple[list[Array], list[bool]]:
        """Blocks of Phi, and whether they hold all rates; refused if none does."""
        matrices = [scaled_Phi(self._mechanism, self._loops, q) for q in configurations]
        blocks = [Phi[np.ix_(rows, rates)] for Phi in matrices]
        regular = [np.linalg.matrix_rank(x, RANK_TOLERANCE) == len(rates) for x in blocks]
        if not any(regular):
            names = listed([self._mechanism.space.rate_names[i] for i in rates])
            raise InputError("positions", f"{names} can move; give the position of one more")
        return blocks, regular

    # --- planar dyads -----------------------------------------------------------------------

    def _by_dyads(self, q: Array, free: set[int], closures: list[int]) -> list[Array] | None:
        """All configurations of loops that are dyads one after the other; None for others."""
        if not free:
            return [q] if all(self._closed(q, k) for k in closures) else []
        for k in closures:
            rates = free.intersection(
                np.flatnonzero(self._touched[self._loops.slices[k]].any(axis=0))
            )
            both = self._dyad(q, k, sorted(rates)) if len(rates) == 2 else None
            if both is not None:
                others = [x for x in closures if x != k]
                each = [self._by_dyads(x, free - rates, others) for x in both if self._closed(x, k)]
                return None if None in each else [x for modes in each for x in modes or ()]
        return None

    def _closed(self, q: Array, closure: int) -> bool:
        self._loops.evaluate(q)
        rows = self._loops.slices[closure]
        f = self._loops.f[rows] * self._mechanism.row_scale[rows]
        return bool(np.abs(f).max() < CLOSURE_TOLERANCE)

    def _dyad(self, q: Array, k: int, rates: list[int]) -> list[Array] | None:
        """Both configurations of two parallel hinges that close a point; None if it is no dyad."""
        closure, model = self._mechanism.closures[k], self.model
        joints = [joint for joint in list(model.joints)[1:] if joint.idx_v in rates]
        single = [(joint.nq, joint.nv) for joint in joints] == [(1, 1)] * 2
        one_each = single and model.nvExtended == model.nv
        if not (isinstance(closure, Closure) and holds_points(closure) and one_each):
            return None
        self._loops.evaluate(q)
        tree, data = self._loops.tree, self._loops.data
        twists = np.array(data.J).reshape(6, -1).dot(tree.S)[:, rates].T
        linear, (n, other) = np.split(twists, 2, axis=1)
        axes = np.array([n, other])
        slides = np.vecdot(linear, axes)  # of a screw, or of a slide, which has no axis
        if (
            np.abs([*(np.linalg.norm(axes, axis=1) - 1), *slides, *np.cross(n, other)]).max()
            > _EQUAL
        ):
            return None
        plane = np.linalg.svd(n[None])[2][1:]
        plane[1] *= np.linalg.det([n, *plane])

        def flat(point: Array) -> complex:
            return complex(*(plane @ point))

        end_a, end_b = (frame_id(model, x) for x in (closure.frame_a, closure.frame_b))
        points = [flat(data.oMf[end].translation) for end in (end_a, end_b)]
        moves_b = tree.supports[tree.model.frames[end_b].parentJoint]
        first, second = (moves_b @ tree.S)[rates].astype(int)
        h, g = (flat(np.cross(*pair)) for pair in zip(axes, linear, strict=True))
        # e^(i x) (a + e^(i y) b) = c, with y relative to x where both hinges move one end.
        a, b, c = points[first] - h, g - points[second], g - h
        if first == second:
            a, b, c = g - h, points[first] - g, points[1 - first] - h
        if min(map(abs, (a, b, c))) <= _EQUAL * self._mechanism.length:
            return None
        cosine = (abs(c) ** 2 - abs(a) ** 2 - abs(b) ** 2) / (2 * abs(a) * abs(b))
        both = list[Array]()
        for sign in (-1, 1) if abs(cosine) <= 1 + _EQUAL else ():
            y = sign * np.arccos(np.clip(cosine, -1, 1)) - np.angle(b / a)
            x = np.angle(c / (a + np.exp(1j * y) * b))
            both.append(q.copy())
            turn = y if first == second else x + y
            both[-1][[joint.idx_q for joint in joints]] += x, turn * np.sign(n @ other)
        return both


class _Distinct:
    """Configurations that differ by their keys."""

    def __init__(self, key: Callable[[Array], Array]) -> None:
        self.q, self._keys, self._key = list[Array](), list[Array](), key

    def add(self, q: Array) -> bool:
        """Take in a configuration, if it is new."""
        key = self._key(q)
        new = not self.q or bool((np.abs(np.array(self._keys) - key).max(axis=1) > _ONE).all())
        if new:
            self.q.append(q)
            self._keys.append(key)
        return new
