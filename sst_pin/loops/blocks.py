# SPDX-License-Identifier: BSD-2-Clause
"""Blocks of the columns of Phi for the dependent rates.

Where loops can be closed one after the other, this part of Phi is block triangular, and it is
singular where one of its diagonal blocks is. The blocks are smaller and better conditioned than the
whole.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from ..model.mechanism import Mechanism
from .loops import Loops, connected
from .ranks import scaled_Phi

#: Smaller singular values of a loop count as zero, relative to its largest or to one. Those that
#: vanish have noise of 1e-12 in assembled loops.
_INDEPENDENT = 1e-6


@dataclass(frozen=True)
class Blocks:
    """The diagonal blocks that have the same number of rows and the same number of rates.

    Attributes:
        rows: Indices of their rows, shape (blocks, rows).
        rates: Indices in v of their rates, shape (blocks, rates).
        usual_sizes: Their usual sizes, shape (blocks,), see `Mechanism.usual_size`.
    """

    rows: Indices
    rates: Indices
    usual_sizes: Array

    def of(self, Phi: Array) -> Array:
        """These blocks of Phi, shape (blocks, rows, rates)."""
        return Phi[self.rows[:, :, None], self.rates[:, None, :]]


class _Block(NamedTuple):
    """Indices of the rows and rates of one block."""

    rows: Indices
    rates: Indices


def diagonal_blocks(mechanism: Mechanism, loops: Loops) -> list[Blocks]:
    """All diagonal blocks of Phi, those of one shape together.

    Their ranks are judged at the mechanism's example. Without one, each part of Phi that shares no
    dependent rate with the others is one block.
    """
    if mechanism.example is not None:
        Phi = scaled_Phi(mechanism, loops, mechanism.example)
    else:
        Phi = np.zeros(loops.touched.shape)  # of rank 0, so that no loop is a block of its own
    blocks_of_shape = dict[tuple[int, int], list[_Block]]()
    for rows, columns in connected(loops.touched[:, mechanism.dependent]):
        for block in _blocks_of_part(loops, Phi, rows, mechanism.dependent[columns]):
            shape = (len(block.rows), len(block.rates))
            blocks_of_shape.setdefault(shape, []).append(block)
    result = list[Blocks]()
    for blocks in blocks_of_shape.values():
        usual_sizes = [mechanism.usual_size(block.rows, block.rates) for block in blocks]
        result.append(
            Blocks(
                rows=np.array([block.rows for block in blocks]),
                rates=np.array([block.rates for block in blocks]),
                usual_sizes=np.array(usual_sizes),
            )
        )
    return result


def _blocks_of_part(loops: Loops, Phi: Array, rows: Indices, rates: Indices) -> list[_Block]:
    """The diagonal blocks of one part of Phi.

    A loop is a block if its rank is the number of its rates that are in no earlier block: then it
    determines these rates. For this, the ranks of all loops of the part must add up to the number
    of its rates. Otherwise other loops may determine the rates where one loop is singular, and the
    part is one block.
    """
    blocks = list[_Block]()
    # `ranks`, `rows` and `rates` are of the loops that are in no block yet.
    ranks = _ranks_of_loops(loops, Phi, rows, rates)
    while sum(ranks.values()) == len(rates):
        closure = _determined_loop(loops, ranks, rates)
        if closure is None:
            break
        loop = loops.slices[closure]
        block = _Block(
            rows=np.arange(loop.start, loop.stop),
            rates=rates[loops.touched[loop, rates].any(axis=0)],
        )
        blocks.append(block)
        rows = np.setdiff1d(rows, block.rows)
        rates = np.setdiff1d(rates, block.rates)
        del ranks[closure]
    if len(rates):
        blocks.append(_Block(rows, rates))
    return blocks


def _determined_loop(loops: Loops, ranks: dict[int, int], rates: Indices) -> int | None:
    """The index of the first closure whose loop determines its rates among `rates`, or None."""
    for closure, rank in ranks.items():
        loop = loops.slices[closure]
        count = int(loops.touched[loop, rates].any(axis=0).sum())
        if 0 < count == rank:
            return closure
    return None


def _ranks_of_loops(loops: Loops, Phi: Array, rows: Indices, rates: Indices) -> dict[int, int]:
    """The rank of each loop that has some of the rows, by the index of its closure."""
    ranks = dict[int, int]()
    for closure, loop in enumerate(loops.slices):
        if np.isin(np.arange(loop.start, loop.stop), rows).any():
            sizes = np.linalg.svd(Phi[loop, rates], compute_uv=False)
            ranks[closure] = int((sizes > _INDEPENDENT * sizes.max(initial=1.0)).sum())
    return ranks
