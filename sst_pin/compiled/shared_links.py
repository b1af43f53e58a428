# SPDX-License-Identifier: BSD-2-Clause
"""Loops that share links, coupled by the twists of these links.

In a scissor lift each loop lies on all cells below it. Written with the joint rates only, the row
of loop k has entries for the joints of all loops before k, and the robot as many as the square of
the number of loops. Here the twist of a link that several loops share is an auxiliary unknown,
which follows from the twist of the link before it:

    omega_i = omega_p + s_i v_i,   u_i = u_p + omega_p x (o_i - o_p) + t_i v_i,

with the origin o_i of link i, its velocity u_i, and the axis [t_i; s_i] of its joint. A row then
has entries for the joints of its own loop and for two twists. All twists are relative to the last
link that carries both branches of the loop, in its axes.

The system that is solved is Phi_u v_u = b with the rates v_u of dependent joints. The twists are
therefore only the parts that dependent rates give; what coordinates give is in b. The equations
that define twists have b = 0.
"""

from collections import Counter
from collections.abc import Mapping, Sequence, Set

import casadi as ca
from casadi import SX

from .closure_rows import End, Row
from .elimination import Definition, Factors
from .link_kinematics import Kinematics
from .symbols import Sparse, is_zero, sx

#: Twists are used if the solution without them has at least this many times the products.
_WORTH = 1.25


def coupled(
    kinematics: Kinematics,
    rows: Sequence[Row],
    blocks: Sequence[Factors],
    first: tuple[int, int],
) -> tuple[dict[int, Sparse], list[Factors | Definition]]:
    """Rows of blocks of loops and of auxiliary unknowns, and the order in which all are solved.

    `first` are the indices of the first row and the first column of auxiliary unknowns.
    """
    entries = {i: rows[i].Phi for block in blocks for i in block.rows}
    if len(blocks) == 1:
        return entries, list(blocks)
    by_twists = _ByTwists(kinematics, rows, blocks, first)
    if _products(entries, blocks) < _WORTH * _products(by_twists.entries, by_twists.sequence):
        return entries, list(blocks)
    return by_twists.entries, by_twists.sequence


def _products(entries: Mapping[int, Sparse], blocks: Sequence[Factors | Definition]) -> int:
    """Products that couple blocks in one solution; an entry that is 1 or -1 costs none."""
    known = set[int]()
    count = 0
    for block in blocks:
        for i in block.rows:
            before = (SX(x) for j, x in entries[i].items() if j in known)
            count += sum(not (x.is_one() or x.is_minus_one()) for x in before)
        known.update(block.columns)
    return count


class _ByTwists:
    """Rows of blocks of loops that are coupled by twists."""

    def __init__(
        self,
        kinematics: Kinematics,
        rows: Sequence[Row],
        blocks: Sequence[Factors],
        first: tuple[int, int],
    ) -> None:
        self._kinematics = kinematics
        self._links = kinematics.tree.links
        self._dependent = {j for block in blocks for j in block.columns}
        links_of_rate = Counter(j for link in self._links for j in link.v)
        #: Dependent rates that move one link relative to its parent. The rate of a joint that mimic
        #: joints follow moves several: a row's entry for it is more than a part of one twist.
        self._of_one_link = {j for j in self._dependent if links_of_rate[j] == 1}
        self._row, self._column = first
        #: Columns of the components of the twist of a link relative to another one, by both; None
        #: for components that are zero.
        self._twists: dict[tuple[int, int], list[int | None]] = {}
        self.entries: dict[int, Sparse] = {}
        self.sequence: list[Factors | Definition] = []
        known = set[int]()
        for block in blocks:
            for i in block.rows:
                # This adds the definitions that the row needs to the sequence, before its block.
                self.entries[i] = self._coupled(rows[i], known)
            self.sequence.append(block)
            known.update(block.columns)

    def _coupled(self, row: Row, known: Set[int]) -> Sparse:
        """A row with twists in place of the known rates that they contain."""
        entries = dict(row.Phi)
        for end in row.ends:
            link, rates = self._last_known(end, known)
            if not rates:
                continue
            for j in rates:
                entries.pop(j, None)
            # The velocity of the end is that of the link, continued to the point of the end.
            of_twist = _by_twist(end, end.point - self._origin(end.base, link))
            for column, entry in zip(self._columns_of_twist(end.base, link), of_twist, strict=True):
                if column is not None and not is_zero(entry):
                    entries[column] = entry
        return entries

    def _last_known(self, end: End, known: Set[int]) -> tuple[int, set[int]]:
        """The last link up to which all dependent rates are known, and these rates.

        Known are the rates of earlier blocks. Links with coordinates only are passed. A link whose
        rate moves other links too counts as unknown.
        """
        known = known & self._of_one_link
        last = end.base
        rates = set[int]()
        for link in self._path(end.base, end.link):
            of_link = self._dependent_rates(link)
            if not of_link <= known:
                break
            if of_link:
                last = link
                rates |= of_link
        return last, rates

    def _columns_of_twist(self, base: int, link: int) -> list[int | None]:
        """Columns of the twist of a link, which is defined here at its first use."""
        if (base, link) not in self._twists:
            before = base
            for other in self._path(base, link)[:-1]:
                if self._dependent_rates(other):
                    before = other
            columns: list[int | None] = [None] * 6
            if before != base:
                columns = self._columns_of_twist(base, before)
            self._twists[base, link] = self._define(base, before, columns, link)
        return self._twists[base, link]

    def _define(
        self, base: int, before: int, columns: list[int | None], link: int
    ) -> list[int | None]:
        """New unknowns: the twist of a link from that of one before it, which has these columns.

        Row k of a definition is twist_k - carried_k twist_before - axes_k v = 0, twists [u; omega].
        """
        lever = self._origin(base, link) - self._origin(base, before)
        carried = SX.eye(6)
        carried[:3, 3:] = -ca.skew(lever)
        R, _ = self._kinematics.pose(base, link)
        axes = ca.diagcat(R, R) @ sx(self._links[link].S)
        twist: list[int | None] = []
        for k in range(6):
            entries = Sparse()
            for j, column in enumerate(columns):
                if column is not None and not is_zero(carried[k, j]):
                    entries[column] = -carried[k, j]
            for j, rate in enumerate(self._links[link].v):
                if rate in self._dependent and not is_zero(axes[k, j]):
                    entries[rate] = -axes[k, j]
            if not entries:
                twist.append(None)
                continue
            twist.append(self._column)
            self.entries[self._row] = entries | {self._column: SX(1)}
            self.sequence.append(Definition(self._row, self._column))
            self._row += 1
            self._column += 1
        return twist

    def _origin(self, base: int, link: int) -> SX:
        """Origin of a link in the axes of one of its ancestors."""
        return self._kinematics.pose(base, link)[1]

    def _path(self, base: int, link: int) -> list[int]:
        """Links from behind the base to a link."""
        path = self._kinematics.tree.ancestors(link)
        return path[path.index(base) + 1 :]

    def _dependent_rates(self, link: int) -> set[int]:
        return self._dependent.intersection(self._links[link].v)


def _by_twist(end: End, lever: SX) -> list[SX]:
    """Coefficients in a row of the twist of a link; `lever` leads from its origin to the end.

    The rate of the end is linear in the twist, so that its gradient are the coefficients.
    """
    u, turn = SX.sym("u", 3), SX.sym("turn", 3)
    rate = end.rate(u + ca.cross(turn, lever), turn)
    return ca.vertsplit(ca.gradient(rate, ca.vertcat(u, turn)))
