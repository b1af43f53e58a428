# SPDX-License-Identifier: BSD-2-Clause
"""Groups of coordinates that move the same branches of a robot.

Derivatives are computed for several coordinates side by side, in the lanes of one register. Each
group of coordinates has its own code, a *pass*. Links that no coordinate of the group moves take no
operations in it. A group with more coordinates than lanes runs its pass several times. In a
humanoid, the coordinates of the base are a group, and those of each limb are one.

More groups mean less work in each pass, but more passes. The time is estimated as the number of
moved links in all passes.
"""

from collections.abc import Sequence

from .equations import Equations

#: The most coordinates whose derivatives are computed side by side: lanes of a register.
LANES = 8


def groups(equations: Equations) -> list[list[int]]:
    """The coordinates in groups, by index.

    The code of all groups together is longer than that of a single group: about twice as long for a
    base with limbs, and longer if limbs branch again.
    """
    return _groups(range(len(equations.L)), _moved_links(equations))


def _moved_links(equations: Equations) -> list[set[int]]:
    """For each coordinate the links that it moves.

    These are the links behind all joints that move with the coordinate, dependent joints included.
    """
    tree = equations.kinematics.tree
    moved: list[set[int]] = []
    for L in equations.L:
        links = set[int]()
        for i, link in enumerate(tree.links):  # parents come first
            if link.parent in links or not L.keys().isdisjoint(link.v):
                links.add(i)
        moved.append(links)
    return moved


def _groups(coordinates: Sequence[int], moved: Sequence[set[int]]) -> list[list[int]]:
    """Coordinates in groups, split where that saves time.

    Coordinates that move no link in common are in different groups. The *trunk* of a connected
    group are the coordinates that move all of its links, for instance those of a humanoid's base.
    It is split from the other coordinates if that saves time. These are then divided again.

    Args:
        coordinates: Indices of the coordinates.
        moved: The links that each coordinate moves.
    """
    parts = _connected(coordinates, moved)
    if len(parts) > 1:
        all_groups = list[list[int]]()
        for part in parts:
            all_groups += _groups(part, moved)
        return all_groups
    whole = list(coordinates)
    links = set[int]().union(*(moved[k] for k in whole))
    trunk = [k for k in whole if moved[k] == links]
    rest = [k for k in whole if moved[k] != links]
    if not trunk or not rest:
        return [whole]
    split = [trunk, *_groups(rest, moved)]
    if sum(_time(group, moved) for group in split) < _time(whole, moved):
        return split
    return [whole]


def _connected(coordinates: Sequence[int], moved: Sequence[set[int]]) -> list[list[int]]:
    """Parts of the coordinates: coordinates of different parts move no link in common."""
    parts: list[tuple[list[int], set[int]]] = []  # coordinates, and the links that they move
    for k in coordinates:
        # Coordinate k joins all parts with which it moves a link in common to one part.
        members = [k]
        links = set(moved[k])
        separate = []
        for members_of_part, links_of_part in parts:
            if links_of_part.isdisjoint(moved[k]):
                separate.append((members_of_part, links_of_part))
            else:
                members = members_of_part + members
                links = links | links_of_part
        parts = [*separate, (members, links)]
    return [sorted(members) for members, _ in parts]


def _time(group: Sequence[int], moved: Sequence[set[int]]) -> int:
    """The estimated time of a group: number of moved links times runs of its pass."""
    links = set[int]().union(*(moved[k] for k in group))
    runs = -(-len(group) // LANES)  # rounded up
    return len(links) * runs
