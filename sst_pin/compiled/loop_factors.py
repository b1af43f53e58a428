# SPDX-License-Identifier: BSD-2-Clause
"""Factorises Phi_u, with pivots chosen at sample configurations."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from casadi import SX

from ..arrays import Array, Flags, Indices
from ..loops.loops import connected
from ..loops.ranks import independent_rows
from ..model.mechanism import Mechanism
from ..model.thresholds import RANK_TOLERANCE
from .closure_rows import Row
from .elimination import (
    Block,
    Blocks,
    Factors,
    Orthogonal,
    Rows,
    pivot_order,
    triangular_blocks,
)
from .link_kinematics import Kinematics
from .shared_links import FirstIndices, coupled
from .symbols import Sparse, column


class Pivots(NamedTuple):
    """Phi_u, factorised."""

    factors: Blocks
    #: For each entry of `factors.parts`, in this order: the largest sizes of its pivots in the
    #: samples; of an `Orthogonal`, the largest squares.
    sizes: list[Array]
    #: |det| of the rows with pivots, free of units; for parts in which all rows count, the product
    #: of the singular values.
    determinant: Any
    #: The largest norm of Phi_u in the samples, scaled.
    norm: float


class _Part(NamedTuple):
    """A part of Phi_u, factorised. It shares no row and no rate with other parts."""

    #: Rows of its blocks, by number.
    entries: Mapping[int, Sparse]
    #: Its blocks in the order of solution.
    sequence: Sequence[Block]
    #: As in `Pivots`, for each block that defines no auxiliary unknown.
    sizes: list[Array]


class LoopFactors:
    """Factorises Phi_u of one mechanism.

    Args:
        mechanism: The mechanism.
        kinematics: The motion of its links.
        rows: All rows of its closures.
        at_samples: Function that evaluates symbols at the samples, as `Equations.at_samples`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        kinematics: Kinematics,
        rows: Sequence[Row],
        at_samples: Callable[[SX], Array],
    ) -> None:
        self.mechanism = mechanism
        self.kinematics = kinematics
        self.rows = rows
        self.at_samples = at_samples
        self._dependent = [int(i) for i in mechanism.dependent]
        self._rates = range(mechanism.model.nv)

    def pivots(self) -> Pivots:
        """Phi_u in parts that share no row and no rate, and these in blocks of loops."""
        pattern, values = self._Phi_u_at_samples()
        entries = dict[int, Sparse]()
        sequence = list[Block]()
        sizes = list[Array]()
        for rows, columns in connected(pattern):
            independent = self._rows_without_choice(values, rows, columns)
            if independent:
                part = self._orthogonal_part(independent, columns)
            else:
                # Auxiliary unknowns get indices of rows and columns that nothing has yet.
                used = len(entries)
                first_auxiliary = FirstIndices(
                    row=len(self.rows) + used, column=len(self._rates) + used
                )
                part = self._part_by_blocks(pattern, values, rows, columns, first_auxiliary)
            entries |= part.entries
            sequence += part.sequence
            sizes += part.sizes
        factors = Blocks(entries, sequence)
        units = self.mechanism.rate_scale[self._dependent]
        norms = np.linalg.norm(values[:, factors.rows] * units, axis=(1, 2))
        return Pivots(factors, sizes, self._determinant(factors), float(norms.max(initial=0.0)))

    def _Phi_u_at_samples(self) -> tuple[Flags, Array]:
        """The entries of Phi_u that may differ from zero, and Phi_u in the samples.

        The scales of the rows are in the values; the units of the columns are not.
        """
        Phi_u = (column(row.Phi, self._dependent).T for row in self.rows)
        matrix = ca.vertcat(SX(0, len(self._dependent)), *Phi_u)
        values = self.at_samples(matrix) * self.mechanism.row_scale[:, None]
        pattern = ca.DM(matrix.sparsity(), 1).full() > 0
        # Rows that hold nothing, such as a plane's for a planar arm, are rounding.
        units = self.mechanism.rate_scale[self._dependent]
        sizes_of_rows = np.abs(values * units).max(axis=(0, 2), initial=0.0)
        pattern &= sizes_of_rows[:, None] > RANK_TOLERANCE
        return pattern, values

    def _rows_without_choice(
        self, values: Array, rows: Indices, columns: Indices
    ) -> dict[int, float]:
        """Independent rows, with their scales, of a part where no choice of rows always suffices.

        Side by side over all samples, such a part has more independent rows than columns. For
        another part the result is empty: some of its rows suffice in every sample.
        """
        units = self.mechanism.rate_scale[self.mechanism.dependent[columns]]
        side_by_side = np.hstack(list(values[:, rows][:, :, columns] * units))
        independent = independent_rows(side_by_side)
        if len(independent) <= len(columns):
            return {}
        return {int(i): float(self.mechanism.row_scale[i]) for i in rows[independent]}

    def _orthogonal_part(self, scale: Mapping[int, float], columns: Indices) -> _Part:
        """A part of Phi_u in which all rows count: those in `scale`, with their scales."""
        Phi = [row.Phi for row in self.rows]
        rates = [self._dependent[k] for k in columns]
        factors, squares = orthogonal_factors(Phi, scale, rates, self.at_samples)
        return _Part({i: Phi[i] for i in scale}, [factors], [squares])

    def _part_by_blocks(
        self,
        pattern: Flags,
        values: Array,
        rows: Indices,
        columns: Indices,
        first_auxiliary: FirstIndices,
    ) -> _Part:
        """A part of Phi_u in which elimination chooses rows, block by block.

        `first_auxiliary` are the indices of the first auxiliary unknown, if it gets any.
        """
        Phi = [row.Phi for row in self.rows]
        pattern_of_part = pattern[np.ix_(rows, columns)]
        values_of_part = values[:, rows][:, :, columns]
        blocks = list[Factors]()
        sizes = list[Array]()
        for order, scaled_sizes in _pivots_by_blocks(pattern_of_part, values_of_part):
            chosen = rows[[i for i, _ in order]]
            rates = [self._dependent[columns[k]] for _, k in order]
            blocks.append(Factors(Phi, list(zip(chosen.tolist(), rates, strict=True))))
            # The scale of a row is a factor of its pivot in the samples. Phi has no scales.
            sizes.append(scaled_sizes / self.mechanism.row_scale[chosen])
        # `coupled` puts definitions of auxiliary unknowns between the blocks and keeps their order.
        entries, sequence = coupled(self.kinematics, self.rows, blocks, first_auxiliary)
        return _Part(entries, sequence, sizes)

    def _determinant(self, factors: Blocks) -> Any:
        """det Phi_u, up to its sign: pivots times scales of the rows times units of the columns.

        The pivots of an orthogonal part contain the scales of its rows.
        """
        determinant = SX(float(np.prod(self.mechanism.rate_scale[self._dependent])))
        for part in factors.parts:
            if isinstance(part, Factors):
                determinant *= float(np.prod(self.mechanism.row_scale[part.rows]))
        for part in factors.parts:
            for pivot in part.pivots:
                determinant *= pivot
        return determinant


def _pivots_by_blocks(
    pattern: Flags, values: Array
) -> Iterator[tuple[list[tuple[int, int]], Array]]:
    """As `pivot_order`, for each block of the rows that have pivots."""
    order, sizes = pivot_order(pattern, values)
    rows = np.array([i for i, _ in order])
    columns = np.array([j for _, j in order])
    blocks = triangular_blocks(pattern[np.ix_(rows, columns)])
    if len(blocks) == 1:
        yield order, sizes
        return
    for block in blocks:
        i = rows[block]
        j = columns[block]
        of_block, sizes = pivot_order(pattern[np.ix_(i, j)], values[:, i][:, :, j])
        yield [(int(i[k]), int(j[m])) for k, m in of_block], sizes


def orthogonal_factors(
    rows: Rows,
    scale: Mapping[int, float],
    columns: Sequence[int],
    at_samples: Callable[[SX], Array],
) -> tuple[Orthogonal, Array]:
    """Factors of a matrix with all of these rows, and the largest squares in the samples."""
    factors = Orthogonal(rows, scale, columns)
    squares = at_samples(ca.vertcat(*map(SX, factors.squares)))
    return factors, squares[..., 0].max(axis=0)
