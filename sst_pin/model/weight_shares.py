# SPDX-License-Identifier: BSD-2-Clause
"""Bodies on which only a share of their weight acts, or none.

Some programs switch gravity off for single links, or compensate a share of their weights. A link
with the mass m and the mass centre c then has the weight s m g at c, with its share s.

Several links that are fixed to each other are one body, and their shares may differ. The weight of
a body is therefore s m g, and its first moment is s m c + m d, with a share s and an offset d of
the body. This is linear in the mass and the first moment m c of the body, and so are the forces.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, as_array, read_only, single_array
from ..errors import InputError
from .tree import joint_id

#: The share of a body, or its share and the three components of its offset, [m].
Share = float | Sequence[float]

_WHOLE = np.array([1.0, 0, 0, 0])
_NO_OFFSET = read_only(np.zeros(3))  # all links without an offset share it


class Link(NamedTuple):
    """A link of a body.

    Attributes:
        joint: Number of the joint that moves it.
        mass: [kg].
        center: Its mass centre in the frame of the joint, shape (3,), [m].
        share: The share of its weight.
        offset: The offset of its weight, axes of the joint, shape (3,), [m].
    """

    joint: int
    mass: float
    center: Array
    share: float
    offset: Array = _NO_OFFSET


@dataclass(frozen=True)
class WeightShares:
    """Shares of all bodies, in the order of the joints; arrays are read-only.

    Attributes:
        shares: 1 for the whole weight, shape (r,).
        offsets: The first moment of the weight about the mass centre, divided by the mass of the
            body and g, in the axes of the joint, shape (r, 3), [m].
    """

    shares: Array
    offsets: Array

    def __post_init__(self) -> None:
        for name in ("shares", "offsets"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def bodies(self) -> list[int]:
        """Indices of the bodies that do not have their whole weight, from 0."""
        differ = (self.shares != 1) | self.offsets.any(axis=1)
        return [int(body) for body in np.flatnonzero(differ)]

    def without_weight(self, body: int) -> Array:
        """W, shape (4, 4): [mass; first moment] without weight are W [mass; first moment].

        The first moments are about the origin and in the axes of the joint. The weight of the body
        is that of its mass and its first moment less those without weight.
        """
        W = (1 - self.shares[body]) * np.eye(4)
        W[1:, 0] = -self.offsets[body]
        return W

    def lifted(self, model: pin.Model) -> dict[int, Array]:
        """[mass; first moment] without weight by body, each of shape (4,), [kg], [kg m]."""
        return {
            body: self.without_weight(body) @ model.inertias[body + 1].toDynamicParameters()[:4]
            for body in self.bodies
        }


def weight_shares_of(model: pin.Model, shares: Mapping[str, Array]) -> WeightShares | None:
    """The shares by the names of joints, as `checked_shares` gives them, for all bodies.

    The result is None if all bodies have their whole weights.
    """
    rows = np.tile(_WHOLE, (model.njoints - 1, 1))
    for name, row in shares.items():
        rows[joint_id(model, name) - 1] = row
    if (rows == _WHOLE).all():
        return None
    return WeightShares(rows[:, 0], rows[:, 1:])


def shares_by_name(model: pin.Model, shares: WeightShares | None) -> dict[str, Share]:
    """The shares of the bodies that do not have their whole weight, by the names of joints."""
    by_name = dict[str, Share]()
    if shares is not None:
        for body in shares.bodies:
            share = float(shares.shares[body])
            offset = shares.offsets[body].tolist()
            by_name[model.names[body + 1]] = [share, *offset] if any(offset) else share
    return by_name


def checked_shares(shares: Mapping[str, Share] | object) -> dict[str, Array]:
    """Share and offset of each body that is named, shape (4,)."""
    if not isinstance(shares, Mapping):
        problem = f'{shares!r}: a mapping of names to shares is needed, such as {{"crank": 0.0}}'
        raise InputError("weight_shares", problem)
    checked = dict[str, Array]()
    for name, share in shares.items():
        row = _WHOLE.copy()
        numbers = as_array(f"weight_shares {name}", share, ())
        if numbers.ndim:
            row[:] = single_array(f"weight_shares {name}", numbers, (4,))
        else:
            row[0] = single_array(f"weight_shares {name}", numbers, ())
        checked[name] = row
    return checked


def shares_of_links(model: pin.Model, links: Iterable[Link]) -> dict[str, Array]:
    """Share and offset of the bodies of which some link lacks weight, by the names of joints.

    `links` are all links of these bodies that have mass. Links of the base do not count.
    """
    by_joint = dict[int, list[Link]]()
    for link in links:
        if link.joint and link.mass:
            by_joint.setdefault(link.joint, []).append(link)
    shares = dict[str, Array]()
    for joint, of_body in sorted(by_joint.items()):
        rows = {(link.share, *link.offset) for link in of_body}
        if len(rows) == 1:  # exactly the same, without rounding
            row = np.array(rows.pop())
        else:
            row = _together(model.names[joint], of_body)
        if (row != _WHOLE).any():
            shares[model.names[joint]] = row
    return shares


def _together(joint: str, links: Sequence[Link]) -> Array:
    """Share and offset of the body of a joint that consists of links."""
    mass = sum(link.mass for link in links)
    if not mass:
        problem = (
            f"the links that joint {joint} moves have no mass in all; give them the same share"
        )
        raise InputError("weight_shares", problem)
    center = sum((link.mass * link.center for link in links), np.zeros(3)) / mass
    weight = sum(link.share * link.mass for link in links)
    # The first moment of the weight about the mass centre of the body.
    moment = np.zeros(3)
    for link in links:
        moment += link.mass * (link.share * (link.center - center) + link.offset)
    return np.array([weight / mass, *(moment / mass)])
