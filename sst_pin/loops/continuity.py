# SPDX-License-Identifier: BSD-2-Clause
"""Tests whether a motion stays in its assembly mode, for each block of loops.

Phi_a and Phi_b are the columns of a block for the dependent rates, at configurations a and b. If b
is near a in the same mode, Phi_b is near Phi_a. If a and b lie in different modes, or a singular
configuration lies between them, the mean of Phi over the path from a to b is singular, so that
|Phi_a^+ (Phi_b - Phi_a)| is about 2 or more. A step is continuous below 1/2; a longer one is
divided. This measure does not depend on the units of rows. The determinant of all loops is no
measure: it keeps its sign if two blocks become singular at once.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import ClosureError, SSTError
from ..model.mechanism import Mechanism
from .loops import Loops, connected
from .mobility import largest_condition, scaled_Phi

#: Computes the configuration at a later fraction of a step from that at an earlier one. It raises
#: an SSTError if there is none.
Path = Callable[[Array, float, float], Array]

#: Largest |Phi_a^+ (Phi_b - Phi_a)| of two configurations that count as neighbours.
CHANGE = 0.5
#: Largest motion of a joint between them, [rad] or lengths of the loop.
TRAVEL = 0.5
#: The most configurations between two samples of a motion: about forty turns.
LOOKS = 2000
#: Smaller singular values of a loop count as zero, relative to its largest or to one.
_INDEPENDENT = 1e-6
#: Parts of a step are not divided further, as a fraction of the step.
_SHORTEST = 1e-12


class _Sample(NamedTuple):
    """A configuration, shape (nq,), and its blocks of Phi, shapes (count, rows, rates)."""

    q: Array
    blocks: list[Array]


class Continuity:
    """Follows motions of one mechanism from a configuration to the next; one object per thread."""

    def __init__(self, mechanism: Mechanism, loops: Loops) -> None:
        self._mechanism, self._loops = mechanism, loops
        self._moving = np.flatnonzero(loops.curved)
        shapes = dict[tuple[int, int], list[tuple[Indices, Indices]]]()
        for rows, rates in self._blocks():
            shapes.setdefault((len(rows), len(rates)), []).append((rows, rates))
        self._entries = [
            (np.array([r for r, _ in alike])[:, :, None], np.array([k for _, k in alike])[:, None])
            for alike in shapes.values()
        ]
        #: Usual sizes of the blocks, shapes (count,).
        self._sizes = [np.array([mechanism.usual_size(*b) for b in x]) for x in shapes.values()]
        self._last: _Sample | None = None
        self._anchor: _Sample
        self._inverses: list[Array]
        self._smallest: list[Array]

    def _blocks(self) -> Iterator[tuple[Indices, Indices]]:
        """Rows and dependent rates of the diagonal blocks of Phi, which is block triangular.

        Parts that share no dependent rate are blocks. If the ranks of a part's loops add up to the
        number of its rates, a loop is a block if its rank is the number of its rates that are in no
        earlier block. Otherwise the part is one block, because other loops may determine the rates
        where one loop is singular.
        """
        mechanism, loops = self._mechanism, self._loops
        Phi, all_rows = np.zeros(loops.touched.shape), np.arange(len(loops.touched))
        if mechanism.example is not None:
            Phi = scaled_Phi(mechanism, loops, mechanism.example)
        for part_rows, part in connected(loops.touched[:, mechanism.dependent]):
            rows, rates, ranks = part_rows, mechanism.dependent[part], dict[int, int]()
            for k, loop in enumerate(loops.slices):
                if np.isin(all_rows[loop], rows).any():
                    sizes = np.linalg.svd(Phi[loop, rates], compute_uv=False)
                    ranks[k] = int((sizes > _INDEPENDENT * sizes.max(initial=1.0)).sum())
            block = True
            while block and sum(ranks.values()) == len(rates) > 0:
                block = False
                for k, rank in ranks.items():
                    loop = loops.slices[k]
                    loop_rates = rates[loops.touched[loop, rates].any(axis=0)]
                    if 0 < len(loop_rates) == rank:
                        yield all_rows[loop], loop_rates
                        rates = np.setdiff1d(rates, loop_rates)
                        rows = np.setdiff1d(rows, all_rows[loop])
                        del ranks[k]
                        block = True
                        break
            if len(rates):
                yield rows, rates

    def condition_number(self, q: Array) -> float:
        """Condition number of the dependent part of Phi at q, infinite if it is singular.

        It is the largest one of its blocks.
        """
        return self._condition(self._sample(q))

    def follow(
        self, start: Array, path: Path, limit: float, first: float = 1.0, looks: int = LOOKS
    ) -> tuple[float, Array]:
        """The fraction of a step that is continuous and regular, and the configuration at its end.

        `path` gives configurations at fractions of the step; `limit` is the largest condition
        number. `first` is the fraction that is tried first, for example where the motion reverses.
        A step that needs more than `looks` configurations raises an error.
        """
        q, low, high, count = start, 0.0, first, 0
        while low < 1 and high - low >= _SHORTEST:
            if count == looks:
                raise ClosureError(
                    f"the motion is too long: {100 * low:.2g} % of it took {looks} steps; give "
                    "poses in between",
                    0.0,
                )
            count += 1
            configuration: Array | None = None
            with suppress(SSTError):
                configuration = path(q, low, high)
            if configuration is not None and self._near(q, configuration, limit):
                q, low, high = configuration, high, min(1.0, high + 2 * (high - low))
            else:
                high = (low + high) / 2
        return low, q

    def _near(self, before: Array, after: Array, limit: float) -> bool:
        """Whether a configuration is next to the one before it, and regular."""
        sample, last = self._sample(after), self._last
        if last is None or not np.array_equal(last.q, before):
            last = self._sample(before)
            self._anchor_at(last)
        if not self._continues(sample, limit):
            if last is self._anchor:
                return False
            self._anchor_at(last)
            if not self._continues(sample, limit):
                return False
        self._last = sample
        return True

    def _anchor_at(self, sample: _Sample) -> None:
        self._anchor = self._last = sample
        self._inverses, self._smallest = [], []
        for blocks in sample.blocks:
            U, s, Vt = np.linalg.svd(blocks, full_matrices=False)
            inverses = np.where(s > 0, 1 / np.where(s > 0, s, 1), 0)[:, None]
            self._inverses.append(np.swapaxes(Vt, 1, 2) @ np.swapaxes(U * inverses, 1, 2))
            full = s.shape[1] == blocks.shape[2]
            self._smallest.append(s[:, -1] if full else np.zeros(len(blocks)))

    def _continues(self, sample: _Sample, limit: float) -> bool:
        anchor = self._anchor
        if not all((s > 0).all() for s in self._smallest):
            return False
        step = pin.difference(self._mechanism.model, anchor.q, sample.q)
        step /= self._mechanism.rate_scale
        if not np.abs(step[self._moving]).max(initial=0.0) <= TRAVEL:
            return False
        for inverse, a, b in zip(self._inverses, anchor.blocks, sample.blocks, strict=True):
            E = inverse @ (b - a)
            if not np.einsum("bij,bij->b", E, E).max() <= CHANGE**2:
                return False
        # As |E| <= 1/2, the smallest singular value is at least half of that at the anchor. This
        # bound avoids an SVD.
        if all(
            (np.maximum(np.linalg.norm(b, axis=(1, 2)), size) < limit * (1 - CHANGE) * s).all()
            for b, size, s in zip(sample.blocks, self._sizes, self._smallest, strict=True)
        ):
            return True
        return self._condition(sample) < limit

    def _condition(self, sample: _Sample) -> float:
        return largest_condition(zip(sample.blocks, self._sizes, strict=True))

    def _sample(self, q: Array) -> _Sample:
        Phi = scaled_Phi(self._mechanism, self._loops, q)
        return _Sample(q.copy(), [Phi[entries] for entries in self._entries])
