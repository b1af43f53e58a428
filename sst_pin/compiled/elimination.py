# SPDX-License-Identifier: BSD-2-Clause
"""Solves sparse linear systems on symbols, with pivots that are chosen on numbers.

`Factors` eliminates. Its pivots are chosen once, for all configurations: few fill-ins (Markowitz),
and in every sample not much smaller than the rest of their column, so that no element grows. Rows
that follow from others with constant coefficients get no pivot. Where the coefficients change with
the configuration, each choice is singular somewhere: `Orthogonal` takes all of these rows.

A matrix is factorised block by block: `triangular_blocks` orders loops so that each needs only the
ones before it, and `Blocks` solves them in this order.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array, Flags, Indices
from ..errors import SingularConfigurationError

#: Rows of a sparse matrix: entries by column. The entries are symbols or numbers.
Rows = Sequence[Mapping[int, Any]]

#: How much smaller than the largest of its column a pivot may be in a sample.
_SOUND = 0.1
#: Smaller entries count as zero, relative to the largest of their row. Entries that are zero in all
#: closed configurations are off by as much as the loops of the samples, which close to 1e-11.
_ZERO = 1e-9
#: How much smaller than in the samples a pivot may be.
_SMALL = 1e-3


def pivot_order(pattern: Flags, values: Array) -> tuple[list[tuple[int, int]], Array]:
    """Rows and columns of the pivots in the order of elimination, and their largest sizes.

    Each step takes the pivot with the smallest fill-in (r - 1) (c - 1), where r and c count the
    entries of its row and its column (Markowitz). A pivot must be sound: in each sample, at least
    `_SOUND` of the largest entry of its column. Of pivots with the same fill-in the soundest one is
    taken. Then the pivot is eliminated from the samples and from the pattern.

    Args:
        pattern: Which entries may differ from zero, shape (rows, columns).
        values: The matrix in the samples, shape (samples, rows, columns).
    """
    values = values.copy()
    noise = _ZERO * np.abs(values).max(axis=(0, 2), initial=0.0)  # for each row
    order: list[tuple[int, int]] = []
    sizes = []
    for _ in range(pattern.shape[1]):
        # Rounding noise of redundant rows is no pivot and makes no fill.
        pattern = pattern & (np.abs(values) > noise[:, None]).any(axis=0)

        # The soundness of an entry is its size over the largest one of its column, in the worst
        # sample.
        size = np.abs(np.where(pattern, values, 0.0))
        with np.errstate(invalid="ignore", divide="ignore"):
            soundness = np.nan_to_num(size / size.max(axis=1, keepdims=True, initial=0)).min(axis=0)
        if not soundness.any():
            raise SingularConfigurationError(
                "the coordinates do not determine the joint rates at the sample configurations; "
                "give a regular configuration of yours: compile(q), casadi(q)",
                np.inf,
            )

        # Choose the pivot. A half of the soundness, below one, decides between equal fill-ins.
        sound = soundness >= min(_SOUND, soundness.max())
        fill = np.outer(pattern.sum(axis=1) - 1, pattern.sum(axis=0) - 1)
        cost = np.where(sound, fill - soundness / 2, np.inf)
        i, j = np.unravel_index(np.argmin(cost), cost.shape)
        order.append((int(i), int(j)))
        sizes.append(size[:, i, j].max())

        # Eliminate its column from the other rows; its own row and column are done.
        below = np.flatnonzero(pattern[:, j])
        right = np.flatnonzero(pattern[i])
        factors = values[:, below, j] / values[:, i, j, None]
        block = np.ix_(np.arange(len(values)), below, right)
        values[block] -= factors[:, :, None] * values[:, None, i, right]
        pattern[np.ix_(below, right)] = True
        pattern[i] = pattern[:, j] = False
    return order, np.array(sizes)


def triangular_blocks(pattern: Flags) -> list[Indices]:
    """Blocks of a square matrix, in an order in which it is block lower triangular.

    The pattern, shape (n, n), has the pivots on its diagonal. Each block is an array of indices;
    the rows of a block have entries in its columns and in those of blocks before it only.
    """
    needs = pattern | np.eye(len(pattern), dtype=bool)  # row i needs the unknown j
    for _ in range(len(pattern).bit_length()):
        needs = needs @ needs
    # Unknowns that need one another form a block. It needs more unknowns than each block that it
    # depends on, so that the order by this number is a right one.
    together = needs & needs.T
    first = together.argmax(axis=1)
    starts = sorted(set(first.tolist()), key=lambda k: (int(needs[k].sum()), k))
    return [np.flatnonzero(first == k) for k in starts]


class _Step(NamedTuple):
    """The elimination of one pivot."""

    row: int
    column: int
    #: What the row of the pivot was multiplied by when it was subtracted from other rows, by these.
    factors: dict[int, Any]
    #: One over the pivot.
    inverse: Any


class Factors:
    """Factors of the part of a matrix that has pivots; the last two may form one 2 x 2 block.

    Attributes:
        rows, columns: Of the pivots, in the order of elimination.
        pivots: The pivots; the last one may be the determinant of a 2 x 2 block.
        inverses: One over each of these.
    """

    def __init__(self, rows: Rows, order: Sequence[tuple[int, int]]) -> None:
        columns = {j for _, j in order}
        work = {i: {j: x for j, x in rows[i].items() if j in columns} for i, _ in order}
        self._order = list(order)
        self.rows = [i for i, _ in order]
        self.columns = [j for _, j in order]
        self._steps: list[_Step] = []
        self.pivots: list[Any] = []
        self.inverses: list[Any] = []
        #: Entries of the inverse of the last 2 x 2 block, by column and row of the block; empty
        #: if there is none.
        self._inverse_of_block: dict[tuple[int, int], Any] = {}
        waiting = [i for i, _ in order]
        for i, j in order:
            if len(waiting) == 2 and self._invert_last_block([work[k] for k in waiting]):
                break  # the block stands for the last two pivots
            waiting.remove(i)
            row = work[i]
            pivot = work[i].pop(j)
            inverse = 1 / pivot
            factors = {}
            for k in waiting:
                if j in work[k]:
                    factors[k] = work[k].pop(j) * inverse
                    _subtract(work[k], factors[k], row)
            self._steps.append(_Step(i, j, factors, inverse))
            self.pivots.append(pivot)
            self.inverses.append(inverse)
        #: What is left of each row beside its pivot.
        self._upper = work

    def _invert_last_block(self, rows: list[Mapping[int, Any]]) -> bool:
        """Invert the last 2 x 2 block of two rows, unless it is triangular; whether it was done.

        One of the two pivots may vanish while the block [[a, b], [c, d]] is regular.
        """
        (i, j), (k, m) = self._order[-2:]
        if m not in rows[0] or j not in rows[1]:
            return False
        a = rows[0].get(j, 0.0)
        b = rows[0].get(m, 0.0)
        c = rows[1].get(j, 0.0)
        d = rows[1].get(m, 0.0)
        determinant = a * d - b * c
        inverse = 1 / determinant
        self.pivots.append(determinant)
        self.inverses.append(inverse)
        self._inverse_of_block = {
            (j, i): d * inverse,
            (j, k): -b * inverse,
            (m, i): -c * inverse,
            (m, k): a * inverse,
        }
        return True

    def small(self, sizes: Array) -> Any:
        """A check: sum of (`_SMALL` size / pivot)^2, with a size for each pivot.

        It is more than 1 where a pivot is less than `_SMALL` of its size in the samples.
        """
        if len(self.inverses) < len(sizes):  # a 2 x 2 block, with its determinant as pivot
            sizes = np.append(sizes[:-2], sizes[-2] * sizes[-1])
        pairs = zip(sizes, self.inverses, strict=True)
        return total([(_SMALL * float(s) * x) ** 2 for s, x in pairs])

    @property
    def changed(self) -> tuple[list[int], list[int]]:
        """Rows and columns of A with elements that elimination changes, so that they may grow."""
        rows = set[int]()
        columns = set[int]()
        for step in self._steps:
            upper = self._upper[step.row]
            if upper and step.factors:
                rows.update(step.factors)
                columns.update(upper)
        return [i for i in self.rows if i in rows], sorted(columns)

    def solve(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """x by column with A x = right; entries of `right` by row, zeros left out."""
        y: dict[int, Any] = dict(right)
        x: dict[int, Any] = {}
        for i, _, factors, _ in self._steps:
            if i in y:
                for k, factor in factors.items():
                    _add(y, k, -(factor * y[i]))
        for (j, i), entry in self._inverse_of_block.items():
            if i in y:
                _add(x, j, entry * y[i])
        for i, j, _, inverse in reversed(self._steps):
            for k, entry in self._upper[i].items():
                if k in x:
                    _add(y, i, -(entry * x[k]))
            if i in y:
                x[j] = y[i] * inverse
        return x

    def solve_transposed(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """x by row with A^T x = right; entries of `right` by column, zeros left out."""
        y: dict[int, Any] = dict(right)
        x: dict[int, Any] = {}
        for i, j, _, inverse in self._steps:
            if j in y:
                x[i] = y[j] * inverse
                for k, entry in self._upper[i].items():
                    _add(y, k, -(entry * x[i]))
        for (j, i), entry in self._inverse_of_block.items():
            if j in y:
                _add(x, i, entry * y[j])
        for i, _, factors, _ in reversed(self._steps):
            for k, factor in factors.items():
                if k in x:
                    _add(x, i, -(factor * x[k]))
        return x


class Orthogonal:
    """Factors Q R of a sparse matrix A with independent columns, by modified Gram-Schmidt.

    Pivots need no sound order: the squares of the columns of Q, which are not normalised, are at
    least the square of the smallest singular value. So the columns are in the order that fills Q
    least. Both solutions are backward stable (Bjoerck, Numerical methods for least squares
    problems, 1996, Sects. 2.4.4 and 2.4.5).

    The rows of A are those in `scale`, each times its scale; they are at least as many as columns.
    `columns` are in their order, `squares` are the squared lengths of the columns of Q, `inverses`
    their reciprocals.
    """

    changed: tuple[list[int], list[int]] = [], []  #: No element of Q grows.

    def __init__(self, rows: Rows, scale: Mapping[int, float], columns: Sequence[int]) -> None:
        self.rows = list(scale)
        self.columns = _least_filled({j: {i for i in scale if j in rows[i]} for j in columns})
        self._scale = scale
        A = [{i: rows[i][j] * x for i, x in scale.items() if j in rows[i]} for j in self.columns]
        self._Q = A
        self.squares = list[Any]()
        self.inverses = list[Any]()
        self._R: list[dict[int, Any]] = []  # above the diagonal, which is one, row by row
        for k, q in enumerate(A):
            self.squares.append(_product(q, q))
            self.inverses.append(1 / self.squares[k])
            self._R.append({})
            for j in range(k + 1, len(A)):
                if q.keys() & A[j].keys():
                    self._R[k][j] = _product(q, A[j]) * self.inverses[k]
                    _subtract(A[j], self._R[k][j], q)

    @property
    def pivots(self) -> list[Any]:
        """Lengths of the columns of Q; their product is that of the singular values."""
        return [square**0.5 for square in self.squares]

    def small(self, sizes: Array) -> Any:
        """A check: sum of (`_SMALL`^2 size / square)^2, with a size for each squared length.

        It is more than 1 where a column of Q is shorter than `_SMALL` of its length in the samples.
        """
        pairs = zip(sizes, self.inverses, strict=True)
        return total([(_SMALL**2 * float(s) * x) ** 2 for s, x in pairs])

    def solve(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """x by column, for which A x is nearest to right; entries of `right` by row."""
        b = {i: value * self._scale[i] for i, value in right.items()}
        y: dict[int, Any] = {}
        for k, q in enumerate(self._Q):
            if q.keys() & b.keys():
                y[k] = _product(q, b) * self.inverses[k]
                _subtract(b, y[k], q)
        for k in reversed(range(len(self._Q))):
            for j, entry in self._R[k].items():
                if j in y:
                    _add(y, k, -(entry * y[j]))
        return {self.columns[k]: value for k, value in y.items()}

    def solve_transposed(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """The shortest x by row with A^T x = right; entries of `right` by column."""
        w = {k: right[j] for k, j in enumerate(self.columns) if j in right}
        for k in range(len(self._Q)):
            if k in w:
                for j, entry in self._R[k].items():
                    _add(w, j, -(entry * w[k]))
        x: dict[int, Any] = {}
        for k in reversed(range(len(self._Q))):
            # x changes along q_k until q_k^T x = w_k.
            excess: dict[int, Any] = {}
            if k in w:
                excess[k] = -w[k]
            if self._Q[k].keys() & x.keys():
                _add(excess, k, _product(self._Q[k], x))
            if excess:
                _subtract(x, excess[k] * self.inverses[k], self._Q[k])
        return {i: value * self._scale[i] for i, value in x.items()}


def _least_filled(columns: Mapping[int, set[int]]) -> list[int]:
    """Columns, each with its rows, in the order in which Gram-Schmidt takes few operations.

    A column is subtracted from the later ones that share a row with it, and fills them with its
    rows. Each step takes the column that is subtracted with the fewest products.
    """
    waiting = dict(columns)
    order = []
    while waiting:
        changed_by = {
            j: [k for k, others in waiting.items() if k != j and rows & others]
            for j, rows in waiting.items()
        }
        column = min(waiting, key=lambda j: len(waiting[j]) * len(changed_by[j]))
        rows = waiting.pop(column)
        order.append(column)
        for k in changed_by[column]:
            waiting[k] = waiting[k] | rows
    return order


class Definition:
    """A row that defines an auxiliary unknown: its entry in the column of this unknown is one."""

    def __init__(self, row: int, column: int) -> None:
        self.rows = [row]
        self.columns = [column]

    def solve(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """The unknown by its column; empty if it is zero."""
        return _renamed(right, self.rows, self.columns)

    def solve_transposed(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """The multiplier by its row; empty if it is zero."""
        return _renamed(right, self.columns, self.rows)


def _renamed(x: Mapping[int, Any], old: Sequence[int], new: Sequence[int]) -> dict[int, Any]:
    """A sparse vector with new indices for the old ones."""
    return {j: x[i] for i, j in zip(old, new, strict=True) if i in x}


#: A block of a block lower triangular matrix.
Block = Factors | Orthogonal | Definition


class Blocks:
    """A sparse block lower triangular matrix of full column rank.

    The rows of a block have entries in its own columns and in columns of blocks before it; entries
    in all other columns are ignored. Solutions leave auxiliary unknowns out.
    """

    def __init__(
        self,
        rows: Mapping[int, Mapping[int, Any]],
        sequence: Sequence[Factors | Orthogonal | Definition],
    ) -> None:
        self._sequence = list(sequence)
        #: The blocks without those that define auxiliary unknowns.
        self.parts = [block for block in sequence if not isinstance(block, Definition)]
        self.rows = [i for part in self.parts for i in part.rows]
        self._columns = {j for part in self.parts for j in part.columns}
        #: Entries of each row in the columns of blocks before its own.
        self._before: dict[int, dict[int, Any]] = {}
        known = set[int]()
        for block in sequence:
            for i in block.rows:
                self._before[i] = {j: x for j, x in rows[i].items() if j in known}
            known.update(block.columns)

    @property
    def changed(self) -> tuple[list[int], list[int]]:
        """Rows and columns with elements that elimination changes."""
        both = [part.changed for part in self.parts]
        columns = sorted(j for _, of_part in both for j in of_part)
        return [i for rows, _ in both for i in rows], columns

    def solve(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """x by column, from the first block to the last one."""
        b = dict(right)
        x: dict[int, Any] = {}
        for block in self._sequence:
            for i in block.rows:
                for j, entry in self._before[i].items():
                    if j in x:
                        _add(b, i, -(entry * x[j]))
            x |= block.solve({i: b[i] for i in block.rows if i in b})
        return {j: value for j, value in x.items() if j in self._columns}

    def solve_transposed(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """x by row, from the last block to the first one."""
        b = dict(right)
        x: dict[int, Any] = {}
        for block in reversed(self._sequence):
            of_block = block.solve_transposed({j: b[j] for j in block.columns if j in b})
            for i, value in of_block.items():
                for j, entry in self._before[i].items():
                    _add(b, j, -(entry * value))
            x |= of_block
        return {i: x[i] for i in self.rows if i in x}


def _product(a: Mapping[int, Any], b: Mapping[int, Any]) -> Any:
    """a^T b of sparse vectors."""
    return total(x * b[i] for i, x in a.items() if i in b)


def _subtract(row: dict[int, Any], factor: Any, other: Mapping[int, Any]) -> None:
    """Change a sparse vector: row -= factor * other."""
    for k, entry in other.items():
        _add(row, k, -(factor * entry))


def _add(row: dict[int, Any], k: int, term: Any) -> None:
    """Change a sparse vector: row[k] += term."""
    row[k] = row[k] + term if k in row else term


def total(terms: Iterable[Any]) -> Any:
    """Sum of symbols; 0 for none."""
    result = None
    for term in terms:
        result = term if result is None else result + term
    return 0.0 if result is None else result
