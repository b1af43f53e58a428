# SPDX-License-Identifier: BSD-2-Clause
"""Positions of joints by name: the angle of a revolute joint, or the length of a prismatic one.

The functions here convert between such positions and q. A bounded joint has one entry in q, its
position. A continuous joint has two, the cosine and the sine of its angle.
`JointSpace.indices_of_positions` has the indices of these entries by the name of the joint. It also
has single angles and lengths of joints of several axes, such as "base_x", but not quaternions.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, single_array
from ..errors import InputError, UnknownNameError
from ..summaries import listed
from .joint_space import JointSpace


def units_by_joint(space: JointSpace) -> dict[str, str]:
    """The unit "rad" or "m" of the position of each joint of one axis, by the joint's name."""
    units: dict[str, str] = {}
    for name, indices in space.indices_of_positions.items():
        # `position_units` has no unit for a cosine, but the position of this joint is an angle.
        units[name] = space.position_units[indices[0]] or "rad"
    return units


def with_positions(space: JointSpace, q: Array, positions: Mapping[str, ArrayLike]) -> Array:
    """A copy of q, shape (..., nq), in which the named joints have these positions.

    Each position is an angle [rad] or a length [m], of the shape (...) of the batch.
    """
    q = np.array(q)
    for name, position in positions.items():
        indices = _indices_in_q(space, name)
        value = single_array(name, position, q.shape[:-1])
        if len(indices) == 1:
            q[..., indices[0]] = value
        else:
            q[..., indices[0]] = np.cos(value)
            q[..., indices[1]] = np.sin(value)
    return q


def positions_of(space: JointSpace, q: Array, names: Sequence[str]) -> Array:
    """Positions of the named joints at q, shape (..., names), [rad] or [m].

    Angles of continuous joints are in (-pi, pi].
    """
    positions = np.empty((*q.shape[:-1], len(names)))
    for k, name in enumerate(names):
        indices = _indices_in_q(space, name)
        if len(indices) == 1:
            positions[..., k] = q[..., indices[0]]
        else:
            positions[..., k] = np.arctan2(q[..., indices[1]], q[..., indices[0]])
    return positions


def _indices_in_q(space: JointSpace, name: str) -> list[int]:
    """Indices in q of a joint of one axis; other names raise an error that says why."""
    if name in space.indices_of_positions:
        return space.indices_of_positions[name]
    if name in space.joint_names or name in space.rate_names:
        problem = "this joint neither turns about one axis nor slides along one"
        raise InputError(
            name, f"{problem}; joints that do are {listed(list(space.indices_of_positions), 12)}"
        )
    raise UnknownNameError("revolute or prismatic joint", name, space.indices_of_positions)
