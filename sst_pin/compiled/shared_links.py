# SPDX-License-Identifier: BSD-2-Clause
"""Loops that share links, coupled by the twists of these links.

In a scissor lift each loop stands on all cells below it. A row of loop k has entries for the joints
of all loops before it. So the number of entries of Phi grows with the square of the number of
loops. To avoid this, `coupled` makes the twist [u; omega] of a link that several loops share an
auxiliary unknown. It is defined by the twist of a link p before it:

    omega_i = omega_p + s_i v_i,   u_i = u_p + omega_p x (o_i - o_p) + t_i v_i,

with the origin o_i of link i, the velocity u_i of this point, and the axis [t_i; s_i] of its joint.
A row then has entries only for the joints of its own loop and for the twists of two links, one for
each branch of the loop. All twists are relative to the *base*: the last link that carries both
branches. They are in the axes of the base.

The system is Phi_u v_u = b with the dependent rates v_u. So the twists contain only what dependent
rates give. What the coordinates give is in b. The rows that define twists have b = 0.
"""

from collections import Counter
from collections.abc import Mapping, Sequence, Set
from typing import NamedTuple

import casadi as ca
from casadi import SX

from .closure_rows import End, Row
from .elimination import Definition, Factors
from .link_kinematics import Kinematics
from .symbols import Sparse, is_zero, sx

#: Twists are used if the solution without them takes at least this many times as many products.
_WORTH = 1.25

#: The columns of a twist in the matrix, by component 0 to 5. Components that are zero have none.
TwistColumns = dict[int, int]


class FirstIndices(NamedTuple):
    """Indices of the first row and the first column of auxiliary unknowns."""

    row: int
    column: int


class _KnownPart(NamedTuple):
    """The first part of a branch, whose dependent rates are known before a row is solved."""

    #: The last link of this part whose joint has a dependent rate.
    link: int
    #: The dependent rates of this part.
    rates: set[int]


def coupled(
    kinematics: Kinematics,
    rows: Sequence[Row],
    blocks: Sequence[Factors],
    first: FirstIndices,
) -> tuple[dict[int, Sparse], list[Factors | Definition]]:
    """Rows of blocks and of auxiliary unknowns, and the order in which all are solved.

    The result has auxiliary unknowns only if they save products.

    Args:
        kinematics: The motion of the links.
        rows: All rows of the closures.
        blocks: Blocks of Phi_u in the order of solution.
        first: The indices of the first auxiliary unknown.
    """
    entries = {i: rows[i].Phi for block in blocks for i in block.rows}
    if len(blocks) == 1:
        return entries, list(blocks)
    by_twists = _ByTwists(kinematics, rows, blocks, first)
    if _products(entries, blocks) < _WORTH * _products(by_twists.entries, by_twists.sequence):
        return entries, list(blocks)
    return by_twists.entries, by_twists.sequence


def _products(entries: Mapping[int, Sparse], blocks: Sequence[Factors | Definition]) -> int:
    """Number of products with unknowns of earlier blocks in one solution.

    An entry that is 1 or -1 takes no product.
    """
    known = set[int]()
    count = 0
    for block in blocks:
        for i in block.rows:
            for j, x in entries[i].items():
                entry = SX(x)
                if j in known and not (entry.is_one() or entry.is_minus_one()):
                    count += 1
        known.update(block.columns)
    return count


class _ByTwists:
    """Rows of blocks that are coupled by twists; the arguments are those of `coupled`.

    Attributes:
        entries: Entries of each row by column, rows of definitions included.
        sequence: Blocks and definitions in the order of solution.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        rows: Sequence[Row],
        blocks: Sequence[Factors],
        first: FirstIndices,
    ) -> None:
        self._kinematics = kinematics
        self._links = kinematics.tree.links
        self._dependent = {j for block in blocks for j in block.columns}
        links_of_rate = Counter(j for link in self._links for j in link.v)
        #: Dependent rates that move a single link relative to its parent. Other rates belong to a
        #: joint and to the mimic joints that follow it, so that they move several links. The entry
        #: of a row for such a rate is a sum over these links. The twist of one link cannot replace
        #: it.
        self._of_one_link = {j for j in self._dependent if links_of_rate[j] == 1}
        #: Indices of the next auxiliary unknown.
        self._next_row, self._next_column = first
        #: The twists that are defined so far, by base and link.
        self._twists: dict[tuple[int, int], TwistColumns] = {}
        self.entries: dict[int, Sparse] = {}
        self.sequence: list[Factors | Definition] = []
        known = set[int]()
        for block in blocks:
            for i in block.rows:
                # This adds the definitions that the row needs to the sequence, before its block.
                self.entries[i] = self._row_with_twists(rows[i], known)
            self.sequence.append(block)
            known.update(block.columns)

    def _row_with_twists(self, row: Row, known: Set[int]) -> Sparse:
        """Entries of a row with twists in place of known rates. New twists are defined.

        Args:
            row: The row.
            known: The rates of earlier blocks.
        """
        entries = dict(row.Phi)
        for end in row.ends:
            part = self._known_part(end, known)
            if not part.rates:
                continue
            for j in part.rates:
                entries.pop(j, None)
            # The rates of this part move only the links up to `part.link`, and the end as if it
            # were fixed to this link: their part of the row is that of the twist of the link.
            # Both points are in the axes of the base, from its origin.
            lever = end.point - self._origin(end.base, part.link)
            coefficients = _coefficients_of_twist(end, lever)
            for component, column in self._defined_twist(end.base, part.link).items():
                if not is_zero(coefficients[component]):
                    entries[column] = coefficients[component]
        return entries

    def _known_part(self, end: End, known: Set[int]) -> _KnownPart:
        """The known part of the branch from the base to an end.

        It ends before the first link with a dependent rate that is not known, or that moves other
        links too.
        """
        last = end.base
        rates = set[int]()
        usable = known & self._of_one_link
        for link in self._path(end.base, end.link):
            of_link = self._dependent_rates(link)
            if not of_link <= usable:
                break
            if of_link:
                last = link
                rates |= of_link
        return _KnownPart(last, rates)

    def _defined_twist(self, base: int, link: int) -> TwistColumns:
        """The twist of a link relative to a base, which is defined now if it is new.

        It is defined by the twist of the last link before it whose joint has a dependent rate.
        """
        if (base, link) not in self._twists:
            before = base
            for other in self._path(base, link)[:-1]:
                if self._dependent_rates(other):
                    before = other
            twist_before: TwistColumns = {}
            if before != base:
                twist_before = self._defined_twist(base, before)
            self._twists[base, link] = self._define(base, before, twist_before, link)
        return self._twists[base, link]

    def _define(
        self, base: int, before: int, twist_before: TwistColumns, link: int
    ) -> TwistColumns:
        """Add rows that define the twist of a link by the twist of a link before it.

        Row k is twist_k - (X twist_before)_k - (axes v)_k = 0 for twists [u; omega]. X gives the
        velocity at the origin of the link: u + omega x lever = u - skew(lever) omega.
        """
        lever = self._origin(base, link) - self._origin(base, before)
        X = SX.eye(6)
        X[:3, 3:] = -ca.skew(lever)
        R, _ = self._kinematics.pose(base, link)
        axes = ca.diagcat(R, R) @ sx(self._links[link].S)
        twist: TwistColumns = {}
        for k in range(6):
            entries = Sparse()
            for component, column in twist_before.items():
                if not is_zero(X[k, component]):
                    entries[column] = -X[k, component]
            for place, rate in enumerate(self._links[link].v):
                if rate in self._dependent and not is_zero(axes[k, place]):
                    entries[rate] = -axes[k, place]
            if entries:
                twist[k] = self._add_definition(entries)
        return twist

    def _add_definition(self, entries: Sparse) -> int:
        """Add a row that defines an auxiliary unknown; returns the column of the unknown.

        Args:
            entries: The other entries of the row.
        """
        row = self._next_row
        column = self._next_column
        self._next_row += 1
        self._next_column += 1
        self.entries[row] = entries | {column: SX(1)}
        self.sequence.append(Definition(row, column))
        return column

    def _origin(self, base: int, link: int) -> SX:
        """Origin of a link, from the origin and in the axes of one of its ancestors."""
        _, p = self._kinematics.pose(base, link)
        return p

    def _path(self, base: int, link: int) -> list[int]:
        """The links from the base, which is left out, to a link."""
        path = self._kinematics.tree.ancestors(link)
        return path[path.index(base) + 1 :]

    def _dependent_rates(self, link: int) -> set[int]:
        """The dependent rates of the joint of a link."""
        return self._dependent.intersection(self._links[link].v)


def _coefficients_of_twist(end: End, lever: SX) -> list[SX]:
    """Coefficients of the six components of a link's twist in a row.

    The rate of the end is a linear function of the twist. So its gradient has the coefficients.

    Args:
        end: An end of the row.
        lever: The vector from the origin of the link to the end.
    """
    u = SX.sym("u", 3)
    omega = SX.sym("turn", 3)
    rate = end.rate(u + ca.cross(omega, lever), omega)
    return ca.vertsplit(ca.gradient(rate, ca.vertcat(u, omega)))
