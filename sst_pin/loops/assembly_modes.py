# SPDX-License-Identifier: BSD-2-Clause
"""All assembly modes: the configurations with closed loops for positions of some joints.

A planar loop that two joints close is a dyad: two hinges, or a hinge and a slide. It has up to two
solutions in closed form; with these joints placed, other loops may become dyads. The remaining
loops are solved by Newton's method from random starts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices, in_one_turn
from ..errors import InputError
from ..model.closures import Closure, holds_points
from ..model.named_positions import put
from ..model.thresholds import CLOSURE_TOLERANCE, RESTS
from ..model.tree import frame_id
from ..summaries import Summary, listed
from .assembly import Assembly
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
        new = not self.q or bool((np.abs(np.array(self._keys) - key).max(axis=1) > _ONE).all())
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
        self._start = put(self._space, start, positions)
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
        """Solve dyads one after the other, then the other loops from random starts."""
        for k in closures:
            rows = np.arange(self._loops.slices[k].start, self._loops.slices[k].stop)
            rates = free[self._touched[np.ix_(rows, free)].any(axis=0)]
            both = self._dyad(q, k, rates) if len(rates) == 2 else None
            if both is not None:
                others = [x for x in closures if x != k]
                closed = [x for x in both if self._assembly.gap(x, rows) < CLOSURE_TOLERANCE]
                each = [self._solve(x, np.setdiff1d(free, rates), others) for x in closed]
                return [x for modes, _ in each for x in modes], all(proof for _, proof in each)
        return self._by_starts(q, free) if len(free) else [q], not len(free)

    def _by_starts(self, start: Array, free: Indices) -> list[Array]:
        random, modes, idle = np.random.default_rng(0), _Distinct(self.key), 0
        turns = np.array(self._space.rate_units) == "rad"
        width = np.where(turns, _TURN, _SLIDE) * self._mechanism.rate_scale
        rows = np.flatnonzero(self._touched[:, free].any(axis=1))
        for _ in range(_MOST_STARTS):
            step = np.zeros(self._model.nv)
            step[free] = width[free] * random.uniform(-1, 1, len(free))
            q = pin.integrate(self._model, start, step * turns)
            q = self._assembly.closer(pin.integrate(self._model, q, step * ~turns), free)
            if not self._assembly.gap(q, rows) and modes.add(q):
                self._require_isolated(q, free)
                idle = 0
            else:
                idle += 1
            if idle > _STARTS + _STARTS_PER_MODE * len(modes.q):
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
        turned = put(self._space, turned, self._positions)
        return q if self._assembly.gap(turned, self._rows) else turned

    def key(self, q: Array) -> Array:
        """Poses of all bodies, or of the frame only, in a row, free of units."""
        self._loops.evaluate(q)
        data, bodies = self._loops.data, self._loops.tree.bodies[1:]
        frame = self._frame
        places = [data.oMi[j] for j in bodies] if frame is None else [data.oMf[frame]]
        columns = [(x.translation / self._mechanism.length, x.rotation) for x in places]
        return np.concatenate([np.column_stack(pair).ravel() for pair in columns])

    def branches(self, configurations: Sequence[Array]) -> Indices:
        """Sign of det Phi of each part, independent rows only; 0 if it is singular."""
        signs = np.zeros((len(configurations), len(self._parts)), dtype=int)
        matrices = [scaled_Phi(self._mechanism, self._loops, q) for q in configurations]
        for k, part in enumerate(self._parts):
            blocks = [Phi[np.ix_(*part)] for Phi in matrices]
            sizes = [np.linalg.svd(block, compute_uv=False) for block in blocks]
            regular = [rank_of(x) == len(part[1]) for x in sizes]
            if any(regular):
                rows = independent_rows(blocks[regular.index(True)])
                signs[:, k] = np.sign(np.linalg.det([x[rows] for x in blocks])) * regular
        return signs

    def _dyad(self, q: Array, k: int, rates: Indices) -> list[Array] | None:
        """Configurations in which two joints of a dyad close the loop; None if it is no dyad."""
        closure, model = self._mechanism.closures[k], self._model
        joints = [joint for joint in list(model.joints)[1:] if joint.idx_v in rates]
        one_each = [(joint.nq, joint.nv) for joint in joints] == [(1, 1)] * 2
        if not (isinstance(closure, Closure) and holds_points(closure) and one_each):
            return None
        self._loops.evaluate(q)
        tree, data = self._loops.tree, self._loops.data
        linear, axes = np.split((data.J.reshape(6, -1) @ tree.S)[:, rates].T, 2, axis=1)
        plane = _plane(linear, axes)
        if plane is None:
            return None
        x = int(not axes[0].any())  # a hinge, and the other joint
        y, slides = 1 - x, not axes[1 - x].any()
        ends = [frame_id(model, name) for name in (closure.frame_a, closure.frame_b)]
        moves_b = tree.supports[tree.model.frames[ends[1]].parentJoint] @ tree.S
        first, other = moves_b[rates[[x, y]]].astype(int)
        points = [data.oMf[ends[first]].translation, data.oMf[ends[1 - first]].translation]
        points += [*np.cross(axes, linear)[[x, y]], linear[y]]
        near, far, h, g, d = (complex(*(plane @ point)) for point in points)
        # y moves `near` about h, or `far`; where it bears x, it moves `far` in the opposite sense.
        after = first == other and y > x
        moved, fixed = (near, far) if after else (far, near)
        meetings = _meetings(moved - h, abs(fixed - h), None if slides else g - h, d)
        if meetings is None:
            return None
        sign = (-1 if first == other and not after else 1) * (1 if slides else axes[x] @ axes[y])
        both = [q.copy() for _ in meetings]
        for configuration, (move, point) in zip(both, meetings, strict=True):
            turn = np.angle((fixed - h) / point if after else point / (fixed - h))
            configuration[[joints[x].idx_q, joints[y].idx_q]] += turn, sign * move
        return both


def _plane(linear: Array, axes: Array) -> Array | None:
    """The plane, shape (2, 3), in which joints with these twists move, one or both of them hinges.

    A turn about the first hinge is one from its first to its second direction.
    """
    turns = np.linalg.norm(axes, axis=1)
    n = axes[int(not turns[0])]
    along = np.where(turns > 0, np.vecdot(linear, axes), linear @ n)  # of screws, and of slides
    off = np.abs([*(turns - turns.round()), *along, *np.cross(n, axes).ravel()]).max()
    if not n.any() or off > _EQUAL:
        return None
    plane = np.linalg.svd(n[None])[2][1:]
    plane[1] *= np.linalg.det([n, *plane])
    return np.asarray(plane)


def _meetings(p: complex, r: float, g: complex | None, d: complex) -> list[Any] | None:
    """Turns about g, or shifts along d, that bring p to the distance r from 0, and the new p."""
    if r <= _EQUAL * abs(p):
        return None
    if g is None:
        middle = -(p * d.conjugate()).real
        square = r * r - abs(p + middle * d) ** 2
        distances = [middle + sign * np.sqrt(max(square, 0.0)) for sign in (-1, 1)]
        return [(x, p + x * d) for x in distances] if square >= -_EQUAL * r * r else []
    arm = p - g
    if min(abs(arm), abs(g)) <= _EQUAL * r:
        return None
    cosine = (r * r - abs(g) ** 2 - abs(arm) ** 2) / (2 * abs(g) * abs(arm))
    corner = np.arccos(np.clip(cosine, -1, 1))
    turns = [sign * corner - np.angle(arm / g) for sign in (-1, 1)]
    return [(x, g + np.exp(1j * x) * arm) for x in turns] if abs(cosine) <= 1 + _EQUAL else []
