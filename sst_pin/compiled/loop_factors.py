# SPDX-License-Identifier: BSD-2-Clause
"""Factorises Phi_u, with pivots chosen at sample configurations.

Phi_u are the columns of Phi for the dependent rates. It is factorised on three levels:

1. Phi_u falls into *components* that share no row and no rate: loops that have nothing in common.
2. A component is mostly eliminated (`Factors`), with some of its rows: those that get pivots. If
   each choice of rows is singular at some configuration, as for the Bennett linkage, it is
   factorised with all of its independent rows (`Orthogonal`).
3. An eliminated component falls into *blocks*: loops that are solved one after the other. The rows
   of a block can contain rates of blocks before it. If the products with these rates take many
   operations, `shared_links` adds *auxiliary unknowns*: entries of the twist of a link that blocks
   share. It also adds a row for each of them: its definition.

`LoopFactors.pivots` does all of this. Where numbers of different columns of Phi_u are compared,
each row is multiplied by its scale (`Mechanism.row_scale`) and each column by its unit
(`Mechanism.rate_scale`), so that they are free of units. `pivot_order` compares numbers within a
column, which needs the scales of the rows only.
"""

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
    """Phi_u, factorised, and the sizes of its pivots."""

    factors: Blocks
    #: For each entry of `factors.parts`, which are the blocks that define no auxiliary unknown: the
    #: largest size of each pivot in the samples. For an `Orthogonal`, the largest of each of its
    #: `squares`.
    sizes: list[Array]
    #: |det Phi_u| of the rows with pivots, free of units. An `Orthogonal` contributes the product
    #: of its singular values.
    determinant: Any
    #: The largest norm of Phi_u in the samples, free of units.
    norm: float


class _Component(NamedTuple):
    """A component of Phi_u, factorised."""

    #: Entries of its rows, by row and column, with the rows that define auxiliary unknowns.
    entries: Mapping[int, Sparse]
    #: Its blocks in the order of solution, with those that define auxiliary unknowns.
    sequence: Sequence[Block]
    #: As in `Pivots`, for each block that defines no auxiliary unknown.
    sizes: list[Array]


class LoopFactors:
    """Factorises Phi_u of one mechanism.

    Args:
        mechanism: The mechanism.
        kinematics: The motion of its links.
        rows: All rows of its closures.
        at_samples: A function that evaluates a matrix of symbols at the samples, as
            `Equations.at_samples`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        kinematics: Kinematics,
        rows: Sequence[Row],
        at_samples: Callable[[SX], Array],
    ) -> None:
        self._mechanism = mechanism
        self._kinematics = kinematics
        self._rows = rows
        self._Phi = [row.Phi for row in rows]
        self._at_samples = at_samples
        self._dependent = [int(i) for i in mechanism.dependent]

    def pivots(self) -> Pivots:
        """Phi_u, factorised component by component."""
        pattern, values = self._Phi_u_at_samples()
        entries = dict[int, Sparse]()
        sequence = list[Block]()
        sizes = list[Array]()
        for rows, columns in connected(pattern):
            scales = self._scales_of_orthogonal_component(values, rows, columns)
            if scales:
                component = self._orthogonal_component(scales, columns)
            else:
                # Auxiliary unknowns get indices of rows and columns that nothing has yet. Each
                # auxiliary unknown of a component before has a row in `entries`. So there are at
                # most len(entries) of them, and indices may be skipped.
                most_used = len(entries)
                first_auxiliary = FirstIndices(
                    row=len(self._rows) + most_used, column=self._mechanism.model.nv + most_used
                )
                component = self._eliminated_component(
                    pattern, values, rows, columns, first_auxiliary
                )
            entries |= component.entries
            sequence += component.sequence
            sizes += component.sizes
        factors = Blocks(entries, sequence)
        units = self._mechanism.rate_scale[self._dependent]
        # `factors.rows` are rows of Phi: those of auxiliary unknowns are not among them.
        norms = np.linalg.norm(values[:, factors.rows] * units, axis=(1, 2))
        return Pivots(factors, sizes, self._determinant(factors), float(norms.max(initial=0.0)))

    def _Phi_u_at_samples(self) -> tuple[Flags, Array]:
        """Which entries of Phi_u may differ from zero, and Phi_u in the samples.

        The shapes are (rows, dependent rates) and (samples, rows, dependent rates). In the samples
        the rows have their scales, but the columns do not have their units.
        """
        Phi_u = (column(Phi, self._dependent).T for Phi in self._Phi)
        matrix = ca.vertcat(SX(0, len(self._dependent)), *Phi_u)
        values = self._at_samples(matrix) * self._mechanism.row_scale[:, None]
        pattern = ca.DM(matrix.sparsity(), 1).full() > 0
        # A row that is zero in all samples counts as zero: for instance the row that holds a planar
        # arm in its own plane.
        units = self._mechanism.rate_scale[self._dependent]
        sizes_of_rows = np.abs(values * units).max(axis=(0, 2), initial=0.0)
        pattern &= sizes_of_rows[:, None] > RANK_TOLERANCE
        return pattern, values

    def _scales_of_orthogonal_component(
        self, values: Array, rows: Indices, columns: Indices
    ) -> dict[int, float]:
        """Scales of all independent rows, if a component needs them all; empty if it does not.

        In one sample, as many rows are independent as there are columns; the other rows are linear
        combinations of them. If the coefficients are the same in all samples, the same rows can be
        left out everywhere. Then the matrix of all samples side by side, shape
        (rows, samples * columns), has no more independent rows than one sample. If it has more, the
        combinations change with q, and each choice of rows may be singular somewhere.

        Args:
            values: Phi_u in the samples, of `_Phi_u_at_samples`.
            rows: Rows of the component.
            columns: Columns of the component, among the dependent rates.
        """
        units = self._mechanism.rate_scale[self._mechanism.dependent[columns]]
        side_by_side = np.hstack(list(values[:, rows][:, :, columns] * units))
        independent = independent_rows(side_by_side)
        if len(independent) <= len(columns):
            return {}
        return {int(i): float(self._mechanism.row_scale[i]) for i in rows[independent]}

    def _orthogonal_component(self, scales: Mapping[int, float], columns: Indices) -> _Component:
        """A component of Phi_u that is factorised with all rows that are in `scales`."""
        rates = [self._dependent[k] for k in columns]
        factors, squares = orthogonal_factors(self._Phi, scales, rates, self._at_samples)
        return _Component({i: self._Phi[i] for i in scales}, [factors], [squares])

    def _eliminated_component(
        self,
        pattern: Flags,
        values: Array,
        rows: Indices,
        columns: Indices,
        first_auxiliary: FirstIndices,
    ) -> _Component:
        """A component of Phi_u that is eliminated block by block, with the rows that get pivots.

        Args:
            pattern: Which entries of Phi_u may differ from zero.
            values: Phi_u in the samples, of `_Phi_u_at_samples`: with the scales of the rows,
                without the units of the columns.
            rows: Rows of the component.
            columns: Columns of the component, among the dependent rates.
            first_auxiliary: Indices of the first auxiliary unknown, if there is one.
        """
        pattern_of_component = pattern[np.ix_(rows, columns)]
        values_of_component = values[:, rows][:, :, columns]
        blocks = list[Factors]()
        sizes = list[Array]()
        for order, scaled_sizes in _pivots_by_blocks(pattern_of_component, values_of_component):
            rows_of_pivots = rows[[i for i, _ in order]]
            rates = [self._dependent[columns[k]] for _, k in order]
            order_in_Phi = list(zip(rows_of_pivots.tolist(), rates, strict=True))
            blocks.append(Factors(self._Phi, order_in_Phi))
            # The values contain the scales of the rows, Phi does not.
            sizes.append(scaled_sizes / self._mechanism.row_scale[rows_of_pivots])
        # `coupled` puts definitions of auxiliary unknowns between the blocks and keeps their order.
        entries, sequence = coupled(self._kinematics, self._rows, blocks, first_auxiliary)
        return _Component(entries, sequence, sizes)

    def _determinant(self, factors: Blocks) -> Any:
        """det Phi_u, up to its sign: pivots times scales of the rows times units of the columns.

        The pivots of an `Orthogonal` contain the scales of its rows.
        """
        determinant = SX(float(np.prod(self._mechanism.rate_scale[self._dependent])))
        for block in factors.parts:
            if isinstance(block, Factors):
                determinant *= float(np.prod(self._mechanism.row_scale[block.rows]))
        for block in factors.parts:
            for pivot in block.pivots:
                determinant *= pivot
        return determinant


def _pivots_by_blocks(
    pattern: Flags, values: Array
) -> Iterator[tuple[list[tuple[int, int]], Array]]:
    """The result of `pivot_order` for each block of a matrix, in the order of solution.

    First, pivots of the whole matrix determine which rows are used and what the blocks are. Then
    the pivots of each block are chosen again, within the block.

    Args:
        pattern: Which entries may differ from zero, shape (rows, columns).
        values: The matrix in the samples, shape (samples, rows, columns).
    """
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
        order_in_block, sizes = pivot_order(pattern[np.ix_(i, j)], values[:, i][:, :, j])
        yield [(int(i[k]), int(j[m])) for k, m in order_in_block], sizes


def orthogonal_factors(
    rows: Rows,
    scale: Mapping[int, float],
    columns: Sequence[int],
    at_samples: Callable[[SX], Array],
) -> tuple[Orthogonal, Array]:
    """Factors of a matrix, and the largest of each of their `squares` in the samples.

    Args:
        rows: Rows of a matrix.
        scale: As in `Orthogonal`.
        columns: As in `Orthogonal`.
        at_samples: As in `LoopFactors`.
    """
    factors = Orthogonal(rows, scale, columns)
    squares = at_samples(ca.vertcat(*map(SX, factors.squares)))
    return factors, squares[..., 0].max(axis=0)
