# SPDX-License-Identifier: BSD-2-Clause
"""Blocks of the columns of Phi for the dependent rates.

Where loops can be closed one after the other, this part of Phi is block triangular, and it is
singular where one of its diagonal blocks is. The blocks are smaller and better conditioned than the
whole.
"""

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Indices
from ..model.mechanism import Mechanism
from .loops import Loops, connected
from .ranks import scaled_Phi

#: Smaller singular values of a loop count as zero, relative to its largest or to one.
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


def diagonal_blocks(mechanism: Mechanism, loops: Loops) -> list[Blocks]:
    """All diagonal blocks of Phi, those of one shape together.

    Their ranks are judged at the mechanism's example. Without one, each part of Phi that shares no
    dependent rate with the others is one block.
    """
    Phi = np.zeros(loops.touched.shape)
    if mechanism.example is not None:
        Phi = scaled_Phi(mechanism, loops, mechanism.example)
    of_shape = dict[tuple[int, int], list[tuple[Indices, Indices]]]()
    for rows, columns in connected(loops.touched[:, mechanism.dependent]):
        for block in _blocks_of_part(loops, Phi, rows, mechanism.dependent[columns]):
            block_rows, block_rates = block
            of_shape.setdefault((len(block_rows), len(block_rates)), []).append(block)
    return [
        Blocks(
            rows=np.array([rows for rows, _ in alike]),
            rates=np.array([rates for _, rates in alike]),
            usual_sizes=np.array([mechanism.usual_size(*block) for block in alike]),
        )
        for alike in of_shape.values()
    ]


def _blocks_of_part(
    loops: Loops, Phi: Array, rows: Indices, rates: Indices
) -> list[tuple[Indices, Indices]]:
    """Rows and rates of the diagonal blocks of one part of Phi.

    A loop is a block if its rank is the number of its rates that are in no earlier block: it
    determines these rates. This holds only if the ranks of all loops of the part add up to the
    number of its rates. Otherwise other loops may determine the rates where one loop is singular,
    and the part is one block.
    """
    blocks = list[tuple[Indices, Indices]]()
    ranks = _ranks_of_loops(loops, Phi, rows, rates)
    while sum(ranks.values()) == len(rates):
        for closure, rank in ranks.items():
            loop = loops.slices[closure]
            loop_rates = rates[loops.touched[loop, rates].any(axis=0)]
            if 0 < len(loop_rates) == rank:
                break
        else:
            break  # no loop determines its rates
        loop_rows = np.arange(loop.start, loop.stop)
        blocks.append((loop_rows, loop_rates))
        rates = np.setdiff1d(rates, loop_rates)
        rows = np.setdiff1d(rows, loop_rows)
        del ranks[closure]
    if len(rates):
        blocks.append((rows, rates))
    return blocks


def _ranks_of_loops(loops: Loops, Phi: Array, rows: Indices, rates: Indices) -> dict[int, int]:
    """The rank of each closure that has some of the rows, by its index."""
    ranks = dict[int, int]()
    for closure, loop in enumerate(loops.slices):
        if np.isin(np.arange(loop.start, loop.stop), rows).any():
            sizes = np.linalg.svd(Phi[loop, rates], compute_uv=False)
            ranks[closure] = int((sizes > _INDEPENDENT * sizes.max(initial=1.0)).sum())
    return ranks
