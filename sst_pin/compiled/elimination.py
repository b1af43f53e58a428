# SPDX-License-Identifier: BSD-2-Clause
"""Solves sparse linear systems on symbols, with pivots that are chosen on numbers.

The matrix A of a system depends on the configuration. It may have more rows than unknowns, because
some rows follow from the others. There are two ways to factorise it:

- `Factors` eliminates unknown by unknown. `pivot_order` chooses the pivots once for all
  configurations, on the numbers of A at sample configurations: few fill-ins (Markowitz), and in
  every sample not much smaller than the rest of their column, so that no element grows. Rows that
  get no pivot are left out.
- `Orthogonal` uses all rows. It is for a matrix in which each choice of rows is singular at some
  configuration.

A large matrix is factorised block by block: `triangular_blocks` finds the order in which each block
needs only unknowns of blocks before it, and `Blocks` solves the blocks in this order.

Vectors are sparse: dictionaries of entries by row or by column of A, zeros left out.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array, Flags, Indices
from ..errors import SingularConfigurationError

#: Rows of a sparse matrix: entries by column. The entries are symbols or numbers.
Rows = Sequence[Mapping[int, Any]]

#: Smallest size of a pivot in a sample, relative to the largest entry of its column. Then one step
#: of elimination lets no element grow to more than 1 + 1 / 0.1 = 11 times the largest.
_SOUND = 0.1
#: Smaller entries count as zero, relative to the largest of their row. Entries that are zero in all
#: closed configurations are off by as much as the loops of the samples, which close to 1e-11.
_ZERO = 1e-9
#: Smallest size of a pivot at any configuration, relative to its largest size in the samples. With
#: such a pivot a solution may lose three digits.
_SMALL = 1e-3


def pivot_order(pattern: Flags, values: Array) -> tuple[list[tuple[int, int]], Array]:
    """Rows and columns of the pivots in the order of elimination, and their largest sizes.

    The soundness of an entry is its size relative to the largest entry of its column, in the worst
    sample. A pivot must have at least the soundness `_SOUND`, if there is such an entry. Of these
    entries, each step takes the one with the smallest fill-in (r - 1) (c - 1), where r and c count
    the entries of its row and its column (Markowitz). Of entries with the same fill-in, it takes
    the soundest one. Then its column is eliminated from the samples and from the pattern.

    Args:
        pattern: Which entries may differ from zero, shape (rows, columns).
        values: The matrix in the samples, shape (samples, rows, columns).
    """
    values = values.copy()
    noise = _ZERO * np.abs(values).max(axis=(0, 2), initial=0.0)  # for each row
    order: list[tuple[int, int]] = []
    sizes = []
    for _ in range(pattern.shape[1]):
        # Redundant rows become rounding noise, which is no pivot and makes no fill.
        pattern = pattern & (np.abs(values) > noise[:, None]).any(axis=0)

        size = np.abs(np.where(pattern, values, 0.0))  # (samples, rows, columns)
        largest_of_column = size.max(axis=1, keepdims=True, initial=0)
        with np.errstate(invalid="ignore", divide="ignore"):  # 0 / 0 in columns that are done
            soundness = np.nan_to_num(size / largest_of_column).min(axis=0)  # (rows, columns)
        if not soundness.any():
            raise SingularConfigurationError(
                "the coordinates do not determine the joint rates at the sample configurations; "
                "give a regular configuration of yours: compile(q), casadi(q)",
                np.inf,
            )

        # Choose the pivot. Fill-ins are whole numbers and soundnesses at most 1, so half of the
        # soundness decides only between equal fill-ins.
        sound = soundness >= min(_SOUND, soundness.max())
        fill = np.outer(pattern.sum(axis=1) - 1, pattern.sum(axis=0) - 1)
        cost = np.where(sound, fill - soundness / 2, np.inf)
        i, j = np.unravel_index(np.argmin(cost), cost.shape)
        order.append((int(i), int(j)))
        sizes.append(size[:, i, j].max())

        # In each sample, subtract multiples of row i from the rows with an entry in column j. Row i
        # is one of these rows: its factor is 1, and it becomes zero. Row i and column j are done.
        rows = np.flatnonzero(pattern[:, j])
        columns = np.flatnonzero(pattern[i])
        factors = values[:, rows, j] / values[:, i, j, None]  # (samples, rows)
        block = np.ix_(np.arange(len(values)), rows, columns)
        pivot_row = values[:, None, i, columns]  # (samples, 1, columns)
        values[block] -= factors[:, :, None] * pivot_row
        pattern[np.ix_(rows, columns)] = True
        pattern[i] = pattern[:, j] = False
    return order, np.array(sizes)


def triangular_blocks(pattern: Flags) -> list[Indices]:
    """Blocks of a square matrix, in an order in which it is block lower triangular.

    Each block is an array of indices. The rows of a block have entries only in columns of this
    block and of blocks before it.

    Args:
        pattern: Which entries may differ from zero, shape (n, n), with the pivots on the diagonal.
    """
    # needs[i, j]: the row i, which determines the unknown i, contains the unknown j. The powers of
    # this Boolean matrix add what it needs by way of other unknowns. Each squaring doubles the
    # length of such ways, up to n.
    needs = pattern | np.eye(len(pattern), dtype=bool)
    for _ in range(len(pattern).bit_length()):
        needs = needs @ needs
    # Unknowns that need one another form a block. If block A depends on block B, then A needs all
    # unknowns that B needs, and also its own unknowns, which B does not need. So A needs more
    # unknowns than B. An order by the number of needed unknowns puts B before A.
    together = needs & needs.T
    first = together.argmax(axis=1)  # the first unknown of the block of each unknown
    starts = sorted(set(first.tolist()), key=lambda k: (int(needs[k].sum()), k))
    return [np.flatnonzero(first == k) for k in starts]


class _Step(NamedTuple):
    """The elimination of one pivot."""

    #: Row of the pivot.
    row: int
    #: Column of the pivot.
    column: int
    #: The multiple of the pivot's row that was subtracted from each other row, by this row.
    factors: dict[int, Any]
    #: One over the pivot.
    inverse: Any


class Factors:
    """Gauss elimination of the square part A of a matrix that has the pivots.

    The last two pivots may be replaced by one 2 x 2 block.

    Args:
        rows: Rows of the whole matrix.
        order: Row and column of each pivot, in the order of elimination.

    Attributes:
        rows: Rows of the pivots, in the order of elimination.
        columns: Columns of the pivots, in the order of elimination.
        pivots: The pivots. The last one may be the determinant of the 2 x 2 block.
        inverses: One over each of `pivots`.
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
        remaining = [i for i, _ in order]
        for i, j in order:
            if len(remaining) == 2 and self._invert_last_block([work[k] for k in remaining]):
                break  # the block replaces the last two pivots
            remaining.remove(i)
            row = work[i]
            pivot = row.pop(j)
            inverse = 1 / pivot
            factors = {}
            for k in remaining:
                if j in work[k]:
                    factors[k] = work[k].pop(j) * inverse
                    _subtract(work[k], factors[k], row)
            self._steps.append(_Step(i, j, factors, inverse))
            self.pivots.append(pivot)
            self.inverses.append(inverse)
        #: The other entries of each row of a pivot at its step of the elimination.
        self._upper = work

    def _invert_last_block(self, rows: list[Mapping[int, Any]]) -> bool:
        """Invert the block [[a, b], [c, d]] of the last two rows, unless it is triangular.

        Such a block can be regular although one of its two pivots vanishes.

        Returns:
            Whether the block was inverted.
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

    def pivot_check(self, sizes: Array) -> Any:
        """A number that is more than 1 if a pivot is too small.

        A pivot is too small if it is less than `_SMALL` times its largest size in the samples. The
        number is the sum of (`_SMALL` size / pivot)^2.

        Args:
            sizes: The largest size of each pivot in the samples.
        """
        if len(self.inverses) < len(sizes):  # a 2 x 2 block, with its determinant as pivot
            # The determinant is the product of the two pivots that the block replaces. So its
            # largest size is at most the product of their largest sizes.
            sizes = np.append(sizes[:-2], sizes[-2] * sizes[-1])
        pairs = zip(sizes, self.inverses, strict=True)
        return total([(_SMALL * float(size) * inverse) ** 2 for size, inverse in pairs])

    @property
    def changed_elements(self) -> tuple[list[int], list[int]]:
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
        """x by column with A x = right, with `right` by row."""
        y: dict[int, Any] = dict(right)
        x: dict[int, Any] = {}
        # Subtract rows from the right-hand side as in the elimination.
        for step in self._steps:
            if step.row in y:
                for k, factor in step.factors.items():
                    _add(y, k, -(factor * y[step.row]))
        # The unknowns of the 2 x 2 block.
        for (j, i), entry in self._inverse_of_block.items():
            if i in y:
                _add(x, j, entry * y[i])
        # The other unknowns, from the last one to the first one.
        for step in reversed(self._steps):
            for k, entry in self._upper[step.row].items():
                if k in x:
                    _add(y, step.row, -(entry * x[k]))
            if step.row in y:
                x[step.column] = y[step.row] * step.inverse
        return x

    def solve_transposed(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """x by row with A^T x = right, with `right` by column."""
        y: dict[int, Any] = dict(right)
        x: dict[int, Any] = {}
        # The transposed steps of `solve`, in reverse order.
        for step in self._steps:
            if step.column in y:
                x[step.row] = y[step.column] * step.inverse
                for k, entry in self._upper[step.row].items():
                    _add(y, k, -(entry * x[step.row]))
        for (j, i), entry in self._inverse_of_block.items():
            if j in y:
                _add(x, i, entry * y[j])
        for step in reversed(self._steps):
            for k, factor in step.factors.items():
                if k in x:
                    _add(x, step.row, -(factor * x[k]))
        return x


class Orthogonal:
    """Factors A = Q R of a sparse matrix with independent columns, by modified Gram-Schmidt.

    The columns of Q are orthogonal but not normalised, and R has ones on its diagonal. No order of
    the columns is unsound: the length of each column of Q is at least the smallest singular value
    of A. So the columns are in the order that fills Q least. Both solutions are backward stable
    (Bjoerck, Numerical methods for least squares problems, 1996, Sects. 2.4.4 and 2.4.5).

    Args:
        rows: Rows of a matrix.
        scale: Scales of the rows that A consists of, by row. Row i of A is row i of the matrix
            times its scale.
        columns: The columns of A.

    Attributes:
        rows: The rows of A.
        columns: The columns of A in the order of Gram-Schmidt.
        squares: Squared lengths of the columns of Q.
        inverses: One over each of `squares`.
        changed_elements: As in `Factors`; empty, because no element of Q grows.
    """

    changed_elements: tuple[list[int], list[int]] = [], []

    def __init__(self, rows: Rows, scale: Mapping[int, float], columns: Sequence[int]) -> None:
        self.rows = list(scale)
        self.columns = _least_filled({j: {i for i in scale if j in rows[i]} for j in columns})
        self._scale = scale
        self.squares = list[Any]()
        self.inverses = list[Any]()
        #: Columns of Q. At the beginning they are those of A.
        self._Q = [
            {i: rows[i][j] * x for i, x in scale.items() if j in rows[i]} for j in self.columns
        ]
        #: Rows of R without the diagonal, by place in `columns`.
        self._R: list[dict[int, Any]] = []
        for k, q in enumerate(self._Q):
            self.squares.append(_product(q, q))
            self.inverses.append(1 / self.squares[k])
            self._R.append({})
            for j in range(k + 1, len(self._Q)):
                if q.keys() & self._Q[j].keys():
                    self._R[k][j] = _product(q, self._Q[j]) * self.inverses[k]
                    _subtract(self._Q[j], self._R[k][j], q)

    @property
    def pivots(self) -> list[Any]:
        """Lengths of the columns of Q. Their product is the product of the singular values."""
        return [square**0.5 for square in self.squares]

    def pivot_check(self, sizes: Array) -> Any:
        """A number that is more than 1 if a column of Q is too short.

        A column is too short if its length is less than `_SMALL` times its largest length in the
        samples. The number is the sum of (`_SMALL`^2 size / square)^2.

        Args:
            sizes: The largest squared length of each column of Q in the samples.
        """
        pairs = zip(sizes, self.inverses, strict=True)
        return total([(_SMALL**2 * float(size) * inverse) ** 2 for size, inverse in pairs])

    def solve(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """x by column, for which A x is nearest to `right`, which is by row."""
        b = {i: value * self._scale[i] for i, value in right.items()}
        # y with Q y nearest to b. Each step subtracts from b its part along a column of Q.
        y: dict[int, Any] = {}
        for k, q in enumerate(self._Q):
            if q.keys() & b.keys():
                y[k] = _product(q, b) * self.inverses[k]
                _subtract(b, y[k], q)
        # R x = y, from the last unknown to the first one.
        for k in reversed(range(len(self._Q))):
            for j, entry in self._R[k].items():
                if j in y:
                    _add(y, k, -(entry * y[j]))
        return {self.columns[k]: value for k, value in y.items()}

    def solve_transposed(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """The shortest x by row with A^T x = right, with `right` by column."""
        # A^T x = R^T Q^T x. First w with R^T w = right.
        w = {k: right[j] for k, j in enumerate(self.columns) if j in right}
        for k in range(len(self._Q)):
            if k in w:
                for j, entry in self._R[k].items():
                    _add(w, j, -(entry * w[k]))
        # Then x with Q^T x = w. It changes along column k of Q until q_k^T x = w_k.
        x: dict[int, Any] = {}
        for k in reversed(range(len(self._Q))):
            excess: dict[int, Any] = {}
            if k in w:
                excess[k] = -w[k]
            if self._Q[k].keys() & x.keys():
                _add(excess, k, _product(self._Q[k], x))
            if excess:
                _subtract(x, excess[k] * self.inverses[k], self._Q[k])
        return {i: value * self._scale[i] for i, value in x.items()}


def _least_filled(columns: Mapping[int, set[int]]) -> list[int]:
    """The order of columns in which Gram-Schmidt takes few operations.

    A column is subtracted from the later columns that share a row with it, and fills them with its
    rows. Each step takes the column that is subtracted with the fewest products.

    Args:
        columns: The rows with an entry, for each column.
    """
    remaining = dict(columns)
    order = []
    while remaining:
        neighbours = {
            j: [k for k, others in remaining.items() if k != j and rows & others]
            for j, rows in remaining.items()
        }
        column = min(remaining, key=lambda j: len(remaining[j]) * len(neighbours[j]))
        rows = remaining.pop(column)
        order.append(column)
        for k in neighbours[column]:
            remaining[k] = remaining[k] | rows
    return order


class Definition:
    """A row that defines an auxiliary unknown, with a one in the column of this unknown.

    An auxiliary unknown is not a rate of a joint. It stands for an expression in other unknowns
    that several rows contain, such as a component of the twist of a link. `shared_links` adds such
    rows and unknowns to a matrix. Row and unknown are a block of size one.
    """

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

    The rows of a block have entries in its own columns and in columns of blocks before it. Entries
    in all other columns are ignored. Solutions leave auxiliary unknowns out.

    Args:
        rows: Entries of each row by column.
        sequence: The blocks, in the order of solution.
    """

    def __init__(
        self,
        rows: Mapping[int, Mapping[int, Any]],
        sequence: Sequence[Block],
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
    def changed_elements(self) -> tuple[list[int], list[int]]:
        """Rows and columns with elements that elimination changes."""
        rows = list[int]()
        columns = list[int]()
        for part in self.parts:
            rows_of_part, columns_of_part = part.changed_elements
            rows += rows_of_part
            columns += columns_of_part
        return rows, sorted(columns)

    def solve(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """x by column, solved from the first block to the last one."""
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
        """x by row for the transposed matrix, solved from the last block to the first one."""
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
