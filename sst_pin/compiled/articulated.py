# SPDX-License-Identifier: BSD-2-Clause
"""Accelerations from forces by articulated bodies, for robots of many coordinates.

Coordinates that move the same loops form a group; the links of a group hang on one link, its base.
From the tips to the ground, each group is eliminated as Featherstone's algorithm eliminates a
joint; constraint embedding (A. Jain, Multibody graph transformations and analysis II, Nonlinear
Dynamics 67, 2012) extends it to groups with loops. With the columns t_i of L as twists of link i
relative to the base, and the inertia A_i of link i with all that hangs on it,

    D = sum t_i^T A_i t_i,   F = sum X_i^T A_i t_i,   A_base += sum X_i^T A_i X_i - F D^-1 F^T,

where X_i maps the twist of the base to that of link i. Operations grow in proportion to the number
of groups; those of the factors of L^T M L grow with its square and more.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import casadi as ca
from casadi import SX

from .link_kinematics import Kinematics
from .links import LinkTree
from .symbols import Sparse, SymmetricFactors, column, sx
from .tree_dynamics import RigidBody, TreeDynamics


class Group(NamedTuple):
    """Coordinates that move the same loops."""

    #: The link on which all its links hang.
    base: int
    #: Parents first.
    links: list[int]
    #: Indices of columns of L.
    coordinates: list[int]


def groups(tree: LinkTree, L: Sequence[Sparse], tied: Iterable[Iterable[int]]) -> list[Group]:
    """All groups, each before the group that its base is in. Rates that are tied share a group."""
    sets = _Sets()
    for rates in (*(link.v for link in tree.links), *(x.keys() for x in L), *tied):
        sets.unite(rates)
    while True:
        result = list[Group]()
        changed = False
        for name, links in _links_by_set(tree, sets).items():
            base, between = _base_of(tree, links)
            for link in between:
                changed |= sets.unite((name, *tree.links[link].v))
            of_group = [k for k, x in enumerate(L) if sets.find(next(iter(x))) == sets.find(name)]
            result.append(Group(base, links, of_group))
        if not changed:
            # A group hangs on a link of another one only if its base comes later.
            return sorted(result, key=lambda group: -group.base)


def _links_by_set(tree: LinkTree, sets: "_Sets") -> dict[int, list[int]]:
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
    between = {i for path in paths for i in path if i > base} - set(links)
    return base, sorted(between)


class _Sets:
    """Disjoint sets of rates."""

    def __init__(self) -> None:
        self._parent: dict[int, int] = {}

    def find(self, rate: int) -> int:
        """The name of the set of a rate."""
        while (parent := self._parent.setdefault(rate, rate)) != rate:
            rate = parent
        return rate

    def unite(self, rates: Iterable[int]) -> bool:
        """Unite the sets of these rates; whether they were different ones."""
        names = sorted({self.find(rate) for rate in rates})
        for other in names[1:]:
            self._parent[other] = names[0]
        return len(names) > 1


class ArticulatedBodies:
    """L^T M L, factorised group by group; see the module.

    The inertia A_i of a link is that of a rigid body, with all that hangs on it, less the sum of
    F D^-1 F^T of these groups, because their joints move.
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
        self._groups = hanging
        #: Entries [k, k] of L^T M L, and reciprocals of pivots, by coordinate.
        self.diagonal: list[Any] = [SX(0)] * len(L)
        self.inverses: list[Any] = [SX(0)] * len(L)
        #: Of each group: t_i by link, shape (6, n); F; D; D^-1 F^T.
        self._t = [self._twists(group, L) for group in hanging]
        self._F = list[SX]()
        self._D = list[SymmetricFactors]()
        self._by_base = list[SX]()
        rigid = dynamics.rigid_bodies
        # A_i = rigid[i] - less[i]: the matrix less[i] is the sum of F D^-1 F^T, in the axes of link
        # i, of all groups that hang on it.
        less = [SX(6, 6) for _ in rigid]
        for group, t in zip(hanging, self._t, strict=True):
            columns = [L[k] for k in group.coordinates]
            momenta = dict[int, SX]()
            as_rigid = dynamics.inertia_of_joints(columns)
            D = SX(*as_rigid.shape)
            for i in group.links:
                of_rigid = [rigid[i].momentum(x) for x in ca.horzsplit(t[i])]
                momentum = ca.horzcat(SX(6, 0), *of_rigid)
                as_rigid += t[i].T @ momentum
                D -= t[i].T @ less[i] @ t[i]
                momenta[i] = momentum - less[i] @ t[i]
            factors = SymmetricFactors(_symmetric(as_rigid + D))
            for place, k in enumerate(group.coordinates):
                self.diagonal[k] = as_rigid[place, place]
                self.inverses[k] = factors.inverses[place]
            F = self._carried(group, momenta, SX(6, len(columns)))
            by_base = factors.solve(F.T)
            self._F.append(F)
            self._D.append(factors)
            self._by_base.append(by_base)
            if group.base:
                self._hang(group, rigid, less)
                less[group.base] += _symmetric(F @ by_base)

    def solve(self, b: SX) -> SX:
        """x with L^T M L x = b, for each column of b."""
        count = b.shape[1]
        # From the tips: y = D^-1 (b - sum t_i^T w_i), with the wrenches w_i on links by what hangs
        # on them.
        wrenches = [SX(6, count) for _ in self._links]
        y = list[SX]()
        for group, t, D, F in zip(self._groups, self._t, self._D, self._F, strict=True):
            forces = b[group.coordinates, :]
            for i in group.links:
                forces -= t[i].T @ wrenches[i]
            y.append(D.solve(forces))
            on_links = {i: wrenches[i] for i in group.links}
            at_base = self._carried(group, on_links, SX(6, count))
            wrenches[group.base] += at_base + F @ y[-1]
        # From the ground: x = y - D^-1 F^T a_base, with the accelerations a_i of links.
        x = SX(*b.shape)
        accelerations = [SX(6, count) for _ in self._links]
        for k in reversed(range(len(self._groups))):
            group = self._groups[k]
            of_base = accelerations[group.base]
            x_group = y[k] - self._by_base[k] @ of_base
            x[group.coordinates, :] = x_group
            with_base = {group.base: of_base}
            for i in group.links:
                with_base[i] = self._continued(i, with_base[self._links[i].parent])
                accelerations[i] = with_base[i] + self._t[k][i] @ x_group
        return x

    # --- inside -----------------------------------------------------------------------------

    def _twists(self, group: Group, L: Sequence[Sparse]) -> dict[int, SX]:
        """Twists of links relative to the base, by the coordinates: t_i, shape (6, n)."""
        t = {group.base: SX(6, len(group.coordinates))}
        for i in group.links:
            link = self._links[i]
            rates = ca.horzcat(
                SX(len(link.v), 0), *(column(L[k], link.v) for k in group.coordinates)
            )
            t[i] = self._continued(i, t[link.parent]) + sx(link.S) @ rates
        return t

    def _continued(self, i: int, of_parent: SX) -> SX:
        """Twists of a link that is fixed to its parent, by those of the parent."""
        R, p = self._placements[i]
        u, turn = of_parent[:3, :], of_parent[3:, :]
        return ca.vertcat(R.T @ (u - ca.skew(p) @ turn), R.T @ turn)

    def _carried(self, group: Group, wrenches: dict[int, SX], at_base: SX) -> SX:
        """Sum of wrenches on the links of a group at its base; at the ground none is needed."""
        if not group.base:
            return at_base
        carried = {**wrenches, group.base: at_base}
        for i in reversed(group.links):
            R, p = self._placements[i]
            force = R @ carried[i][:3, :]
            moment = R @ carried[i][3:, :] + ca.skew(p) @ force
            parent = self._links[i].parent
            carried[parent] = carried[parent] + ca.vertcat(force, moment)
        return carried[group.base]

    def _hang(self, group: Group, rigid: list[RigidBody], less: list[SX]) -> None:
        """Add the inertia of the links of a group to that of its base."""
        of_group = {i: (rigid[i], less[i]) for i in (group.base, *group.links)}
        for i in reversed(group.links):
            R, p = self._placements[i]
            parent = self._links[i].parent
            body, of_joints = of_group[i]
            of_group[parent] = (
                body.joined_to(of_group[parent][0], R, p),
                of_group[parent][1] + _moved(of_joints, R, p),
            )
        rigid[group.base], less[group.base] = of_group[group.base]


def _moved(A: SX, R: SX, p: SX) -> SX:
    """X^T A X with the map X of twists of the parent to those of a link that is placed at R, p."""
    M, H, J = (R @ block @ R.T for block in (A[:3, :3], A[:3, 3:], A[3:, 3:]))
    M = _symmetric(M)
    P = ca.skew(p)
    H_parent = H - M @ P
    J_parent = _symmetric(J - H.T @ P + P @ H_parent)
    return ca.blockcat([[M, H_parent], [H_parent.T, J_parent]])


def _symmetric(A: SX) -> SX:
    """A matrix by its upper triangle, so that no entry is computed twice."""
    return ca.triu2symm(ca.triu(A))
