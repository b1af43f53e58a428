# SPDX-License-Identifier: BSD-2-Clause
"""Putting a closed chain together: Newton's method on the closures, loop by loop."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import ClosureError
from .loops import Loops
from .mechanism import Mechanism

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Scaled residual that an assembled configuration stays below.
ASSEMBLED = 1e-11
_STEPS = 100
#: Longest stride, [rad] or of the robot's length: the closures are far from linear beyond it.
_STRIDE = 0.5
#: How far a configuration next to another one lies, likewise.
_ASIDE = 0.2


class Assembly:
    """Newton's method on the closures of one mechanism; a workspace, one per thread.

    Loops that share no joints are solved apart: each comes as near as it can, whatever the others
    do.

    Args:
        mechanism: What is put together.
        loops: Its closures.
    """

    def __init__(self, mechanism: Mechanism, loops: Loops) -> None:
        self.mechanism, self._loops = mechanism, loops
        self._rows = np.flatnonzero(loops.holonomic)
        self._scale = mechanism.row_scale[:, None] * mechanism.rate_scale
        self._known_parts: dict[bytes, list[tuple[Indices, Indices]]] = {}

    def assemble(self, q: Array, free: Indices) -> Array:
        """The configuration next to q with closed loops.

        Args:
            q: A guess, shape (nq,).
            free: Indices of the rates that may move.

        Raises:
            ClosureError: When there is none within reach: which loops stay open, by how much.
        """
        q, open_rows = self._newton(q, free)
        if len(open_rows):
            loops, mechanism = self._loops, self.mechanism
            residual = np.abs(loops.residual())
            largest = float(residual[open_rows].max())
            names = [
                str(closure)
                for closure, rows in zip(mechanism.closures, loops.slices, strict=True)
                if np.isin(open_rows, np.arange(rows.start, rows.stop)).any()
            ]
            shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" * (len(names) > 4))
            raise ClosureError(
                f"the loops cannot be closed from this guess: {largest:.3g} (m or rad) stays open "
                f"at {shown}; start nearer, hold fewer joints, try several starts "
                "(tries=), or check the geometry",
                largest,
            )
        return q

    def try_starts(self, q: Array, free: Indices, tries: int, seed: int) -> Array:
        """The first success from q and from random configurations around it.

        Raises:
            ClosureError: That of the start that came nearest.
        """
        random, model = np.random.default_rng(seed), self.mechanism.model
        failures = []
        for width in np.linspace(0.0, 2.0, tries):
            aside = np.zeros(model.nv)
            aside[free] = width * random.normal(size=len(free))
            start = pin.integrate(model, q, aside * self.mechanism.rate_scale)
            try:
                return self.assemble(start, free)
            except ClosureError as error:
                failures.append(error)
        raise min(failures, key=lambda error: error.residual)

    def aside(self, q: Array, seed: int) -> Array:
        """Another configuration of the same assembly mode as q, which lies on the closures.

        Raises:
            ClosureError: When a fifth of a radian leads out of the mode.
        """
        from scipy.linalg import null_space

        mechanism, loops = self.mechanism, self._loops
        loops.evaluate(q)
        motions = null_space(loops.Phi() * self._scale, rcond=1e-8)
        random = np.random.default_rng(seed)
        direction = motions @ random.normal(size=motions.shape[1])
        step = _ASIDE * direction / max(float(np.abs(direction).max(initial=0.0)), 1e-300)
        moved = pin.integrate(mechanism.model, q, step * mechanism.rate_scale)
        return self.assemble(moved, np.arange(mechanism.model.nv))

    def _newton(self, q: Array, free: Indices) -> tuple[Array, Indices]:
        """The nearest configuration and the rows that stay open."""
        f = self._residual(q)
        key = free.tobytes()
        if key not in self._known_parts:
            self._known_parts[key] = list(self._parts(free))
        parts = self._known_parts[key]
        for _ in range(_STEPS):
            busy = [
                (rows, columns)
                for rows, columns in parts
                if np.linalg.norm(f[rows]) >= 1e-3 * ASSEMBLED
            ]
            if not busy:
                break
            Phi = self._loops.Phi() * self._scale
            step = np.zeros(Phi.shape[1])
            for rows, columns in busy:
                block = Phi[np.ix_(rows, columns)]
                part = np.linalg.lstsq(block, -f[rows], rcond=1e-10)[0]
                step[columns] = part * (_STRIDE / max(_STRIDE, float(np.abs(part).max(initial=0))))
            q, f, moved = self._descend(q, f, step, busy)
            if not moved:
                break
        return q, self._rows[~(np.abs(f[self._rows]) < ASSEMBLED)]

    def _descend(
        self, q: Array, f: Array, step: Array, parts: list[tuple[Indices, Indices]]
    ) -> tuple[Array, Array, bool]:
        """Halve each loop's step until its residual falls."""
        model, scale = self.mechanism.model, self.mechanism.rate_scale
        while True:
            trial = pin.integrate(model, q, step * scale)
            f_trial = self._residual(trial)
            worse = [
                (rows, columns)
                for rows, columns in parts
                if not np.linalg.norm(f_trial[rows]) < np.linalg.norm(f[rows])
            ]
            if all(not step[columns].any() for _, columns in worse):
                moved = bool(step.any())
                if not moved:
                    self._residual(q)  # the loops are at q again
                return (trial, f_trial, True) if moved else (q, f, False)
            for rows, columns in worse:
                step[columns] /= 2
                rounding = np.abs(f[rows]).max() < ASSEMBLED
                if rounding or np.abs(step[columns]).max(initial=0.0) < 1e-16:
                    step[columns] = 0.0  # rounding, or a dead end

    def _residual(self, q: Array) -> Array:
        self._loops.evaluate(q)
        return self._loops.residual() * self.mechanism.row_scale

    def _parts(self, free: Indices) -> Iterator[tuple[Indices, Indices]]:
        """Rows and free rates of loops that share none."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        touched = self._loops.touched
        rows, columns = np.nonzero(touched[:, free])
        n, m = touched.shape[0], len(free)
        graph = coo_matrix((np.ones(len(rows)), (rows, columns + n)), shape=(n + m, n + m))
        _, label = connected_components(graph, directed=False)
        of_closure = label[:n].copy()
        for part in self._loops.slices:  # the rows of one closure stay together
            of_closure[part] = label[part.start]
        order = self._rows
        for name in dict.fromkeys(of_closure[order].tolist()):
            members = order[of_closure[order] == name]
            yield members, free[np.isin(label[n:], np.unique(label[members]))]


def generic_configuration(assembly: Assembly) -> Array:
    """Some assembled configuration away from the symmetric ones, the same at each call.

    Raises:
        ClosureError: When twenty guesses lead to none.
    """
    random, model = np.random.default_rng(0), assembly.mechanism.model
    failures = []
    for width in np.linspace(0.1, 2.0, 20):
        aside = width * random.normal(size=model.nv) * assembly.mechanism.rate_scale
        guess = pin.integrate(model, pin.neutral(model), aside)
        try:
            return assembly.assemble(guess, np.arange(model.nv))
        except ClosureError as error:
            failures.append(error)
    raise min(failures, key=lambda error: error.residual)
