# SPDX-License-Identifier: BSD-2-Clause
"""Bodies on which only a share of their weight acts, or none.

Some programs switch gravity off for single links, or compensate a share of their weights. A link
with the mass m and the mass centre c then has the weight s m g at c, with its share s.

Several links that are fixed to each other are one body, and their shares may differ. With the mass
m and the mass centre c of the body, its weight is s m g, where s is the mean share. But this weight
does not act at c. Its first moment about the origin is s m c + m d, with an offset d [m] of the
body. Weight and first moment are linear in the mass m and the first moment m c of the body, and so
are the forces.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, as_array, read_only, single_array
from ..errors import InputError
from .tree import joint_id

#: The share s of a body, or [s, d_x, d_y, d_z] with the offset d in the axes of its joint, [m].
Share = float | Sequence[float]

#: [s, d_x, d_y, d_z] of a body with its whole weight.
WHOLE_WEIGHT = read_only(np.array([1.0, 0.0, 0.0, 0.0]))
_NO_OFFSET = read_only(np.zeros(3))  # all links without an offset share it


class Link(NamedTuple):
    """A link of a body.

    Attributes:
        joint: Number of the joint that moves it.
        mass: [kg].
        center: Its mass centre in the frame of the joint, shape (3,), [m].
        share: The share s of its weight.
        offset: The offset d of its weight, axes of the joint, shape (3,), [m]. It is zero for a
            single link; a link that was a body of several links may have one.
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
        shares: The share s of each body, 1 for the whole weight, shape (r,).
        offsets: The offset d of each body in the axes of its joint, shape (r, 3), [m]: the first
            moment of its weight about its mass centre, divided by m and g.
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

    def weightless_factor(self, body: int) -> Array:
        """W, shape (4, 4): W [m; m c] is the part of [m; m c] of a body on which no weight acts.

        The first moment m c is about the origin and in the axes of the joint.
        """
        # Mass: m - s m = (1 - s) m. First moment: m c - (s m c + m d) = (1 - s) m c - m d.
        W = (1 - self.shares[body]) * np.eye(4)
        W[1:, 0] = -self.offsets[body]
        return W

    def weightless_parts(self, model: pin.Model) -> dict[int, Array]:
        """Mass and first moment on which no weight acts, of each body that lacks weight.

        They are [mass; first moment], shape (4,), [kg] and [kg m], by the index of the body from 0.
        """
        parts = dict[int, Array]()
        for body in self.bodies:
            mass_and_moment = model.inertias[body + 1].toDynamicParameters()[:4]
            parts[body] = self.weightless_factor(body) @ mass_and_moment
        return parts


def weight_shares_of(model: pin.Model, shares: Mapping[str, Array]) -> WeightShares | None:
    """The shares of all bodies; None if all have their whole weight.

    `shares` are results of `checked_shares`, by the names of joints. Other bodies have their whole
    weight.
    """
    of_bodies = np.tile(WHOLE_WEIGHT, (model.njoints - 1, 1))
    for name, share_and_offset in shares.items():
        of_bodies[joint_id(model, name) - 1] = share_and_offset
    if (of_bodies == WHOLE_WEIGHT).all():
        return None
    return WeightShares(of_bodies[:, 0], of_bodies[:, 1:])


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
    """[share; offset] of each body that is named, shape (4,), by the names of joints."""
    if not isinstance(shares, Mapping):
        problem = f'{shares!r}: a mapping of names to shares is needed, such as {{"crank": 0.0}}'
        raise InputError("weight_shares", problem)
    checked = dict[str, Array]()
    for name, share in shares.items():
        share_and_offset = WHOLE_WEIGHT.copy()
        numbers = as_array(f"weight_shares {name}", share, ())
        if numbers.ndim:
            share_and_offset[:] = single_array(f"weight_shares {name}", numbers, (4,))
        else:
            share_and_offset[0] = single_array(f"weight_shares {name}", numbers, ())
        checked[name] = share_and_offset
    return checked


def shares_of_links(model: pin.Model, links: Iterable[Link]) -> dict[str, Array]:
    """[share; offset] of the bodies that lack weight, shape (4,), by the names of joints.

    `links` must contain all links with mass of these bodies. Links of the base are left out.
    """
    links_by_joint = dict[int, list[Link]]()
    for link in links:
        if link.joint and link.mass:
            links_by_joint.setdefault(link.joint, []).append(link)
    shares = dict[str, Array]()
    for joint, links_of_body in sorted(links_by_joint.items()):
        different = {(link.share, *link.offset) for link in links_of_body}
        if len(different) == 1:  # equal shares stay exactly as they are, without rounding
            share_and_offset = np.array(different.pop())
        else:
            share_and_offset = _mean_share(model.names[joint], links_of_body)
        if (share_and_offset != WHOLE_WEIGHT).any():
            shares[model.names[joint]] = share_and_offset
    return shares


def _mean_share(joint: str, links: Sequence[Link]) -> Array:
    """[share; offset] of the body of a joint that consists of several links, shape (4,)."""
    mass = sum(link.mass for link in links)
    if not mass:
        problem = (
            f"the links that joint {joint} moves have no mass in all; give them the same share"
        )
        raise InputError("weight_shares", problem)
    center = sum((link.mass * link.center for link in links), np.zeros(3)) / mass
    weight = sum(link.share * link.mass for link in links)
    # The first moment of the weight about the mass centre of the body, divided by g.
    moment = np.zeros(3)
    for link in links:
        moment += link.mass * (link.share * (link.center - center) + link.offset)
    return np.array([weight / mass, *(moment / mass)])
