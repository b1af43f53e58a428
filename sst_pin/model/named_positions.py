# SPDX-License-Identifier: BSD-2-Clause
"""Positions of joints by their names.

`JointSpace.places` has the indices in q of each joint that turns about or slides along one axis:
one index, or two for the cosine and the sine of an angle.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, single_array
from ..errors import InputError, UnknownNameError
from ..summaries import listed
from .joint_space import JointSpace


def angles_and_lengths(space: JointSpace) -> dict[str, str]:
    """Names of joints with one coordinate, and "rad" or "m" for each."""
    return {name: space.position_units[k[0]] or "rad" for name, k in space.places.items()}


def put(space: JointSpace, q: Array, positions: Mapping[str, ArrayLike]) -> Array:
    """Configurations, shape (..., nq), with the named joints at these positions, [rad] or [m].

    The joints must turn about or slide along one axis. Each position has the shape (...).
    """
    q = np.array(q)
    for name, position in positions.items():
        place = _place(space, name)
        value = single_array(name, position, q.shape[:-1])
        entries = [value] if len(place) == 1 else [np.cos(value), np.sin(value)]
        for k, entry in zip(place, entries, strict=True):
            q[..., k] = entry
    return q


def taken(space: JointSpace, q: Array, names: Sequence[str]) -> Array:
    """Positions of named joints, which turn or slide, shape (..., names), [rad] or [m]."""
    columns = []
    for name in names:
        entry, *sine = [q[..., k] for k in _place(space, name)]
        columns.append(np.arctan2(sine[0], entry) if sine else entry)
    return np.stack(columns, axis=-1) if columns else np.zeros((*q.shape[:-1], 0))


def _place(space: JointSpace, name: str) -> list[int]:
    """Indices of a joint in q; joints of several axes and unknown names are refused."""
    if name not in space.places and name in (*space.joint_names, *space.rate_names):
        problem = "this joint neither turns about one axis nor slides along one"
        raise InputError(name, f"{problem}; joints that do are {listed(list(space.places), 12)}")
    if name not in space.places:
        raise UnknownNameError("revolute or prismatic joint", name, space.places)
    return space.places[name]
