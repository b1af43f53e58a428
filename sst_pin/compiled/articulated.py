# SPDX-License-Identifier: BSD-2-Clause
"""Accelerations from forces by articulated bodies, for robots of many coordinates.

Coordinates that move the same loops form a *group*. The links of a group hang on one link, its
*base*. `groups` finds the groups. `ArticulatedBodies` eliminates group by group, from the tips to
the ground, as Featherstone's algorithm eliminates joint by joint; constraint embedding (A. Jain,
Multibody graph transformations and analysis II, Nonlinear Dynamics 67, 2012) extends it to groups
with loops. For a group let

    t_i   columns of L as twists [u; omega] of link i relative to the base,
    A_i   the inertia of link i with all that hangs on it,
    X_i   the map of the twist of the base to that of link i, if the joints between them are fixed.

Then, with the sums over the links of the group,

    D = sum t_i^T A_i t_i + inertia of rotors and lines,   F = sum X_i^T A_i t_i,

and the base gets the inertia

    A_base += sum X_i^T A_i X_i - F D^-1 F^T.

The last term is there because the joints of the group yield. The inertias are computed as

    A_i = rigid_i - reduction_i,

where rigid_i is the inertia if all joints of the groups that hang on link i were fixed, and
reduction_i is the sum of the terms F D^-1 F^T of these groups. The first takes fewer operations,
because it has only ten different numbers.

The number of operations grows in proportion to the number of groups. With the factors of the whole
matrix L^T M L it grows with the square of this number and more.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import casadi as ca
from casadi import SX

from .link_kinematics import Kinematics
from .links import LinkTree
from .symbols import Sparse, SymmetricFactors, column, sx
from .tree_dynamics import SpatialInertia, TreeDynamics

# --- groups -------------------------------------------------------------------------------------


class Group(NamedTuple):
    """Coordinates that move the same loops."""

    #: Index of the link on which all its links hang.
    base: int
    #: Indices of its links, parents first.
    links: list[int]
    #: Indices of its coordinates, which are columns of L.
    coordinates: list[int]


def groups(tree: LinkTree, L: Sequence[Sparse], coupled: Iterable[Iterable[int]]) -> list[Group]:
    """All groups, from the tips to the ground.

    Args:
        tree: The links.
        L: Columns of L.
        coupled: Sets of rates whose inertia is coupled although they move no link together, for
            instance by the mass of a line. Each set is in one group.
    """
    sets = _rates_of_groups(tree, L, coupled)
    result = list[Group]()
    for representative, links in _links_by_set(tree, sets).items():
        base, _ = _base_and_links_between(tree, links)
        coordinates = []
        for k, column_of_L in enumerate(L):
            any_rate = next(iter(column_of_L))  # all rates of a column are in the same set
            if sets.find(any_rate) == representative:
                coordinates.append(k)
        result.append(Group(base, links, coordinates))
    # A group that hangs on a link of another group has this link as its base. The base of the other
    # group carries this link and has a smaller index.
    return sorted(result, key=lambda group: -group.base)


class _DisjointSets:
    """Disjoint sets of rates; one rate of each set, its smallest, represents it."""

    def __init__(self) -> None:
        #: Another rate of the same set, for each rate except the representatives.
        self._next: dict[int, int] = {}

    def find(self, rate: int) -> int:
        """The representative of the set of a rate."""
        while rate in self._next:
            rate = self._next[rate]
        return rate

    def unite(self, rates: Iterable[int]) -> bool:
        """Unite the sets of these rates; returns whether they were different sets."""
        representatives = sorted({self.find(rate) for rate in rates})
        for other in representatives[1:]:
            self._next[other] = representatives[0]
        return len(representatives) > 1


def _rates_of_groups(
    tree: LinkTree, L: Sequence[Sparse], coupled: Iterable[Iterable[int]]
) -> _DisjointSets:
    """The rates of each group, as one set; the arguments are those of `groups`."""
    sets = _DisjointSets()
    for link in tree.links:
        sets.unite(link.v)
    for column_of_L in L:
        sets.unite(column_of_L)
    for rates in coupled:
        sets.unite(rates)
    # The links between the base of a group and its other links belong to the group too. With them
    # two groups can become one, which may have another base. So this is repeated until it changes
    # nothing.
    changed = True
    while changed:
        changed = False
        for representative, links in _links_by_set(tree, sets).items():
            _, between = _base_and_links_between(tree, links)
            for i in between:
                if sets.unite((representative, *tree.links[i].v)):
                    changed = True
    return sets


def _links_by_set(tree: LinkTree, sets: _DisjointSets) -> dict[int, list[int]]:
    """The links whose joints have a rate of each set, by the representative of the set."""
    links: dict[int, list[int]] = {}
    for i, link in enumerate(tree.links):
        if link.v:
            links.setdefault(sets.find(link.v[0]), []).append(i)
    return links


def _base_and_links_between(tree: LinkTree, links: Sequence[int]) -> tuple[int, list[int]]:
    """The last link that carries all of these links, and the other links between it and them."""
    paths = [tree.ancestors(tree.links[i].parent) for i in links]
    shared = set(paths[0]).intersection(*paths[1:])
    base = max(shared)  # parents have smaller indices
    behind_base = {i for path in paths for i in path if i > base}
    return base, sorted(behind_base - set(links))


# --- elimination --------------------------------------------------------------------------------


class _LinkInertia(NamedTuple):
    """The inertia A = rigid - reduction of a link with all that hangs on it, in its frame."""

    rigid: SpatialInertia
    #: Shape (6, 6).
    reduction: SX


class _Elimination(NamedTuple):
    """The elimination of one group with m coordinates; the letters are those of the module."""

    group: Group
    #: t_i by link, shape (6, m).
    t: dict[int, SX]
    #: Shape (6, m).
    F: SX
    D: SymmetricFactors
    #: D^-1 F^T, shape (m, 6): what an acceleration of the base subtracts from those of the
    #: coordinates.
    base_gain: SX
    #: The diagonal of D with rigid_i in place of A_i.
    rigid_diagonal: list[Any]


class ArticulatedBodies:
    """L^T M L, factorised group by group; see the module.

    Args:
        kinematics: The motion of the links.
        dynamics: The dynamics of the tree.
        L: Columns of L.
        all_groups: The result of `groups`.

    Attributes:
        diagonal: Entries [k, k] of L^T M L, by coordinate.
        inverses: Reciprocals of the pivots, by coordinate.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        dynamics: TreeDynamics,
        L: Sequence[Sparse],
        all_groups: Sequence[Group],
    ) -> None:
        self._links = kinematics.tree.links
        self._placements = kinematics.placements
        self._dynamics = dynamics
        self.diagonal: list[Any] = [SX(0)] * len(L)
        self.inverses: list[Any] = [SX(0)] * len(L)
        #: From the tips to the ground.
        self._eliminations = list[_Elimination]()
        inertias = [_LinkInertia(rigid, SX(6, 6)) for rigid in dynamics.link_inertias]
        for group in all_groups:
            columns = [L[k] for k in group.coordinates]
            elimination = self._eliminate(group, columns, inertias)
            self._eliminations.append(elimination)
            for place, k in enumerate(group.coordinates):
                self.diagonal[k] = elimination.rigid_diagonal[place]
                self.inverses[k] = elimination.D.inverses[place]
            if group.base:  # nobody needs the inertia of the ground, link 0
                rigid, reduction = self._inertia_at_base(group, inertias)
                reduction = reduction + _symmetric(elimination.F @ elimination.base_gain)
                inertias[group.base] = _LinkInertia(rigid, reduction)

    def solve(self, b: SX) -> SX:
        """x with L^T M L x = b, for each column of b.

        Let w_i be the wrench that link i must exert on what hangs on it, and a_i the acceleration
        of link i. From the tips to the ground, with zero acceleration of the base, each group gives

            y = D^-1 (b - sum t_i^T w_i),   w_base += sum X_i^T w_i + F y.

        From the ground to the tips, the acceleration of the base changes this to

            x = y - D^-1 F^T a_base,   a_i = X_i a_base + t_i x.

        In Featherstone's algorithm the wrenches w are the bias forces.
        """
        count = b.shape[1]
        wrenches = [SX(6, count) for _ in self._links]
        y_of_groups = list[SX]()
        for elimination in self._eliminations:
            group = elimination.group
            forces = b[group.coordinates, :]
            for i in group.links:
                forces -= elimination.t[i].T @ wrenches[i]
            y = elimination.D.solve(forces)
            y_of_groups.append(y)
            on_links = {i: wrenches[i] for i in group.links}
            at_base = self._sum_at_base(group, on_links, SX(6, count))
            wrenches[group.base] += at_base + elimination.F @ y

        x = SX(*b.shape)
        accelerations = [SX(6, count) for _ in self._links]
        for elimination, y in zip(reversed(self._eliminations), reversed(y_of_groups), strict=True):
            group = elimination.group
            of_base = accelerations[group.base]
            x_of_group = y - elimination.base_gain @ of_base
            x[group.coordinates, :] = x_of_group
            fixed_to_base = {group.base: of_base}  # X_i a_base
            for i in group.links:
                of_parent = fixed_to_base[self._links[i].parent]
                fixed_to_base[i] = self._twist_from_parent(i, of_parent)
                accelerations[i] = fixed_to_base[i] + elimination.t[i] @ x_of_group
        return x

    # --- inside -----------------------------------------------------------------------------

    def _eliminate(
        self, group: Group, columns: Sequence[Sparse], inertias: Sequence[_LinkInertia]
    ) -> _Elimination:
        """Eliminate a group.

        Args:
            group: The group.
            columns: Its columns of L.
            inertias: A_i of all links.
        """
        t = self._twists(group, columns)
        # D = D_rigid + D_reduction, by the two parts of the inertias A_i.
        D_rigid = self._dynamics.inertia_of_rotors_and_lines(columns)
        D_reduction = SX(*D_rigid.shape)
        momenta = dict[int, SX]()  # A_i t_i
        for i in group.links:
            rigid, reduction = inertias[i]
            rigid_momenta = [rigid.momentum(twist) for twist in ca.horzsplit(t[i])]
            rigid_momentum = ca.horzcat(SX(6, 0), *rigid_momenta)
            D_rigid += t[i].T @ rigid_momentum
            D_reduction -= t[i].T @ reduction @ t[i]
            momenta[i] = rigid_momentum - reduction @ t[i]
        D = SymmetricFactors(_symmetric(D_rigid + D_reduction))
        F = self._sum_at_base(group, momenta, SX(6, len(columns)))
        return _Elimination(
            group=group,
            t=t,
            F=F,
            D=D,
            base_gain=D.solve(F.T),
            rigid_diagonal=[D_rigid[k, k] for k in range(len(columns))],
        )

    def _twists(self, group: Group, columns: Sequence[Sparse]) -> dict[int, SX]:
        """t_i of each link, and zero for the base, from the columns of L."""
        t = {group.base: SX(6, len(columns))}
        for i in group.links:
            link = self._links[i]
            rates = ca.horzcat(SX(len(link.v), 0), *(column(x, link.v) for x in columns))
            t[i] = self._twist_from_parent(i, t[link.parent]) + sx(link.S) @ rates
        return t

    def _twist_from_parent(self, i: int, of_parent: SX) -> SX:
        """Twist of link i from that of its parent, if the joint between them is fixed.

        Several twists are side by side, shape (6, m), each in the axes of its own link.
        """
        R, p = self._placements[i]
        u = of_parent[:3, :]
        omega = of_parent[3:, :]
        return ca.vertcat(R.T @ (u - ca.skew(p) @ omega), R.T @ omega)

    def _sum_at_base(self, group: Group, wrenches: dict[int, SX], zero: SX) -> SX:
        """sum X_i^T w_i of wrenches w_i on the links of a group; `zero` has the shape of the sum.

        At the ground nobody needs the sum, and the result is zero.
        """
        if not group.base:
            return zero
        sums = {**wrenches, group.base: zero}
        for i in reversed(group.links):
            R, p = self._placements[i]
            force = R @ sums[i][:3, :]
            moment = R @ sums[i][3:, :] + ca.skew(p) @ force
            parent = self._links[i].parent
            sums[parent] = sums[parent] + ca.vertcat(force, moment)
        return sums[group.base]

    def _inertia_at_base(self, group: Group, inertias: Sequence[_LinkInertia]) -> _LinkInertia:
        """The inertia of the base with the links of a group fixed to it: A_base + sum X^T A X."""
        sums = {i: inertias[i] for i in (group.base, *group.links)}
        for i in reversed(group.links):
            R, p = self._placements[i]
            parent = self._links[i].parent
            sums[parent] = _LinkInertia(
                rigid=sums[i].rigid.joined_to(sums[parent].rigid, R, p),
                reduction=sums[parent].reduction + _at_parent(sums[i].reduction, R, p),
            )
        return sums[group.base]


def _at_parent(A: SX, R: SX, p: SX) -> SX:
    """X^T A X with the map X of twists of the parent to those of a link.

    The link has the orientation R and the origin p in its parent. With A = [[M, H], [H^T, J]] in
    the axes of the parent and P = skew(p), X subtracts P omega from u, so that

        X^T A X = [[M, H - M P], [., J - H^T P + P (H - M P)]].
    """
    M = _symmetric(R @ A[:3, :3] @ R.T)
    H = R @ A[:3, 3:] @ R.T
    J = R @ A[3:, 3:] @ R.T
    P = ca.skew(p)
    H_parent = H - M @ P
    J_parent = _symmetric(J - H.T @ P + P @ H_parent)
    return ca.blockcat([[M, H_parent], [H_parent.T, J_parent]])


def _symmetric(A: SX) -> SX:
    """A symmetric matrix from its upper triangle, so that no entry is computed twice."""
    return ca.triu2symm(ca.triu(A))
