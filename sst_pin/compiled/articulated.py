# SPDX-License-Identifier: BSD-2-Clause
"""Accelerations from forces by articulated bodies, for robots of many coordinates.

Coordinates that move the same loops form a *group*; the links of a group hang on one link, its
*base*. From the tips to the ground, each group is eliminated as Featherstone's algorithm eliminates
a joint; constraint embedding (A. Jain, Multibody graph transformations and analysis II, Nonlinear
Dynamics 67, 2012) extends it to groups with loops. For a group let

    t_i   columns of L as twists [u; omega] of link i relative to the base,
    A_i   the inertia of link i with all that hangs on it,
    X_i   the map of the twist of the base to that of link i, if the joints between them are fixed.

Then, with the sums over the links of the group,

    D = sum t_i^T A_i t_i + inertia of rotors,   F = sum X_i^T A_i t_i,

and the base gets the inertia

    A_base += sum X_i^T A_i X_i - F D^-1 F^T,

where the last term stands for the joints of the group, which move. Operations grow in proportion to
the number of groups; those of the factors of L^T M L grow with its square and more.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import casadi as ca
from casadi import SX

from .link_kinematics import Kinematics
from .links import LinkTree
from .symbols import Sparse, SymmetricFactors, column, sx
from .tree_dynamics import SpatialInertia, TreeDynamics


class Group(NamedTuple):
    """Coordinates that move the same loops."""

    #: The link on which all its links hang.
    base: int
    #: Parents first.
    links: list[int]
    #: Indices of columns of L.
    coordinates: list[int]


def groups(tree: LinkTree, L: Sequence[Sparse], tied: Iterable[Iterable[int]]) -> list[Group]:
    """All groups, each before the group that its base is in.

    Rates that are tied share a group although they move no link together, as those whose inertia
    is coupled by the mass of a line.
    """
    sets = _DisjointSets()
    for link in tree.links:
        sets.unite(link.v)
    for column_of_L in L:
        sets.unite(column_of_L)
    for rates in tied:
        sets.unite(rates)
    while True:
        result = list[Group]()
        united = False
        for representative, links in _links_by_set(tree, sets).items():
            base, between = _base_of(tree, links)
            # Links between the base and these links belong to the group. If this unites groups,
            # the result is dropped, and the bases of all groups are looked for again.
            for i in between:
                united |= sets.unite((representative, *tree.links[i].v))
            coordinates = []
            for k, column_of_L in enumerate(L):
                some_rate = next(iter(column_of_L))
                if sets.find(some_rate) == sets.find(representative):
                    coordinates.append(k)
            result.append(Group(base, links, coordinates))
        if not united:
            # If a group hangs on a link of another group, its base is a link of that group, and
            # so it comes later than the base of that group, which carries all its links.
            return sorted(result, key=lambda group: -group.base)


def _links_by_set(tree: LinkTree, sets: "_DisjointSets") -> dict[int, list[int]]:
    """The links that the rates of each set move, by the representative of the set."""
    links: dict[int, list[int]] = {}
    for i, link in enumerate(tree.links):
        if link.v:
            links.setdefault(sets.find(link.v[0]), []).append(i)
    return links


def _base_of(tree: LinkTree, links: Sequence[int]) -> tuple[int, list[int]]:
    """The last link that carries all of these, and other links between it and them."""
    paths = [tree.ancestors(tree.links[i].parent) for i in links]
    shared = set(paths[0]).intersection(*paths[1:])
    base = max(shared)  # parents come first
    behind_base = {i for path in paths for i in path if i > base}
    return base, sorted(behind_base - set(links))


class _DisjointSets:
    """Disjoint sets of rates; one rate of each set, its smallest, represents it."""

    def __init__(self) -> None:
        #: Another rate of the same set, for each rate but the representatives.
        self._next: dict[int, int] = {}

    def find(self, rate: int) -> int:
        """The representative of the set of a rate."""
        while rate in self._next:
            rate = self._next[rate]
        return rate

    def unite(self, rates: Iterable[int]) -> bool:
        """Unite the sets of these rates; whether they were different ones."""
        representatives = sorted({self.find(rate) for rate in rates})
        for other in representatives[1:]:
            self._next[other] = representatives[0]
        return len(representatives) > 1


class _LinkInertia(NamedTuple):
    """The inertia A = rigid - moving of a link with all that hangs on it, in its frame."""

    #: The inertia if the joints of the groups that hang on it were fixed.
    rigid: SpatialInertia
    #: The sum of F D^-1 F^T of these groups.
    moving: SX


class _Elimination(NamedTuple):
    """One group, eliminated; the letters are those of the module."""

    group: Group
    #: t_i by link, shape (6, n).
    t: dict[int, SX]
    F: SX
    D: SymmetricFactors
    #: The diagonal of D as if all joints that hang on the group were fixed.
    rigid_diagonal: list[Any]
    #: D^-1 F^T.
    by_base: SX


class ArticulatedBodies:
    """L^T M L, factorised group by group; see the module.

    Attributes:
        diagonal: Entries [k, k] of L^T M L, by coordinate.
        inverses: Reciprocals of the pivots, by coordinate.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        dynamics: TreeDynamics,
        L: Sequence[Sparse],
        hanging: Sequence[Group],
    ) -> None:
        self._links = kinematics.tree.links
        self._placements = kinematics.placements
        self.diagonal: list[Any] = [SX(0)] * len(L)
        self.inverses: list[Any] = [SX(0)] * len(L)
        #: From the tips to the ground.
        self._eliminations = list[_Elimination]()
        inertias = [_LinkInertia(body, SX(6, 6)) for body in dynamics.link_inertias]
        for group in hanging:
            columns = [L[k] for k in group.coordinates]
            of_rotors = dynamics.inertia_of_rotors_and_lines(columns)
            elimination = self._eliminated(group, columns, of_rotors, inertias)
            self._eliminations.append(elimination)
            for place, k in enumerate(group.coordinates):
                self.diagonal[k] = elimination.rigid_diagonal[place]
                self.inverses[k] = elimination.D.inverses[place]
            if group.base:
                rigid, moving = self._inertia_at_base(group, inertias)
                moving = moving + _symmetric(elimination.F @ elimination.by_base)
                inertias[group.base] = _LinkInertia(rigid, moving)

    def solve(self, b: SX) -> SX:
        """x with L^T M L x = b, for each column of b."""
        count = b.shape[1]
        # From the tips: y = D^-1 (b - sum t_i^T w_i), where the wrench w_i is what link i must
        # exert on what hangs on it, and w_base += sum X_i^T w_i + F y. These are the bias forces
        # of Featherstone's algorithm.
        wrenches = [SX(6, count) for _ in self._links]
        y = list[SX]()
        for group, t, F, D, _, _ in self._eliminations:
            forces = b[group.coordinates, :]
            for i in group.links:
                forces -= t[i].T @ wrenches[i]
            y.append(D.solve(forces))
            on_links = {i: wrenches[i] for i in group.links}
            wrenches[group.base] += self._sum_at_base(group, on_links, SX(6, count)) + F @ y[-1]
        # From the ground: x = y - D^-1 F^T a_base, with the accelerations a_i of links.
        x = SX(*b.shape)
        accelerations = [SX(6, count) for _ in self._links]
        for k in reversed(range(len(self._eliminations))):
            elimination = self._eliminations[k]
            group = elimination.group
            of_base = accelerations[group.base]
            x_group = y[k] - elimination.by_base @ of_base
            x[group.coordinates, :] = x_group
            with_base = {group.base: of_base}  # accelerations of links that are fixed to the base
            for i in group.links:
                with_base[i] = self._continued(i, with_base[self._links[i].parent])
                accelerations[i] = with_base[i] + elimination.t[i] @ x_group
        return x

    # --- inside -----------------------------------------------------------------------------

    def _eliminated(
        self,
        group: Group,
        columns: Sequence[Sparse],
        of_rotors: SX,
        inertias: Sequence[_LinkInertia],
    ) -> _Elimination:
        """The elimination of a group.

        Args:
            group: The group.
            columns: Its columns of L.
            of_rotors: Inertia of its rotors and of masses of lines, for these columns.
            inertias: A_i of all links.
        """
        t = self._twists(group, columns)
        # D = D_rigid + D_moving, by the two parts of the inertias.
        D_rigid = of_rotors
        D_moving = SX(*of_rotors.shape)
        momenta = dict[int, SX]()  # A_i t_i
        for i in group.links:
            rigid, moving = inertias[i]
            columns_of_rigid = [rigid.momentum(x) for x in ca.horzsplit(t[i])]
            momentum = ca.horzcat(SX(6, 0), *columns_of_rigid)
            D_rigid += t[i].T @ momentum
            D_moving -= t[i].T @ moving @ t[i]
            momenta[i] = momentum - moving @ t[i]
        D = SymmetricFactors(_symmetric(D_rigid + D_moving))
        F = self._sum_at_base(group, momenta, SX(6, len(columns)))
        return _Elimination(
            group=group,
            t=t,
            F=F,
            D=D,
            rigid_diagonal=[D_rigid[k, k] for k in range(len(columns))],
            by_base=D.solve(F.T),
        )

    def _twists(self, group: Group, columns: Sequence[Sparse]) -> dict[int, SX]:
        """t_i of each link, and zero for the base, from the columns of L."""
        t = {group.base: SX(6, len(columns))}
        for i in group.links:
            link = self._links[i]
            rates = ca.horzcat(SX(len(link.v), 0), *(column(x, link.v) for x in columns))
            t[i] = self._continued(i, t[link.parent]) + sx(link.S) @ rates
        return t

    def _continued(self, i: int, of_parent: SX) -> SX:
        """Twists of link i from those of its parent, as if the joint between them were fixed."""
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
        carried = {**wrenches, group.base: zero}
        for i in reversed(group.links):
            R, p = self._placements[i]
            force = R @ carried[i][:3, :]
            moment = R @ carried[i][3:, :] + ca.skew(p) @ force
            parent = self._links[i].parent
            carried[parent] = carried[parent] + ca.vertcat(force, moment)
        return carried[group.base]

    def _inertia_at_base(self, group: Group, inertias: Sequence[_LinkInertia]) -> _LinkInertia:
        """The inertia of the base with the links of a group fixed to it: A_base + sum X^T A X."""
        carried = {i: inertias[i] for i in (group.base, *group.links)}
        for i in reversed(group.links):
            R, p = self._placements[i]
            parent = self._links[i].parent
            carried[parent] = _LinkInertia(
                rigid=carried[i].rigid.joined_to(carried[parent].rigid, R, p),
                moving=carried[parent].moving + _moved(carried[i].moving, R, p),
            )
        return carried[group.base]


def _moved(A: SX, R: SX, p: SX) -> SX:
    """X^T A X with the map X of twists of the parent to those of a link that is placed at R, p."""
    M = _symmetric(R @ A[:3, :3] @ R.T)
    H = R @ A[:3, 3:] @ R.T
    J = R @ A[3:, 3:] @ R.T
    P = ca.skew(p)
    H_parent = H - M @ P
    J_parent = _symmetric(J - H.T @ P + P @ H_parent)
    return ca.blockcat([[M, H_parent], [H_parent.T, J_parent]])


def _symmetric(A: SX) -> SX:
    """A matrix by its upper triangle, so that no entry is computed twice."""
    return ca.triu2symm(ca.triu(A))
