# SPDX-License-Identifier: BSD-2-Clause
"""Positions of joints by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, single_array
from ..errors import UnknownNameError
from .joint_space import JointSpace


def angles_and_lengths(space: JointSpace) -> dict[str, str]:
    """Names of joints with one coordinate, and "rad" or "m" for each."""
    units = dict(zip(space.position_names, space.position_units, strict=True))
    endless = {name[:-4]: "rad" for name, unit in units.items() if _is_cosine(name, unit, units)}
    return {name: unit for name, unit in units.items() if unit} | endless


def _is_cosine(name: str, unit: str, units: Mapping[str, str]) -> bool:
    return not unit and name.endswith("_cos") and f"{name[:-4]}_sin" in units


def put(space: JointSpace, q: Array, positions: Mapping[str, ArrayLike]) -> Array:
    """Configurations, (..., nq), with the joints named, which turn or slide, at positions, (...).

    Positions are in [rad] or [m].
    """
    known, names, q = angles_and_lengths(space), list(space.position_names), np.array(q)
    for name, position in positions.items():
        if name not in known:
            raise UnknownNameError("revolute or prismatic joint", name, known)
        value = single_array(name, position, q.shape[:-1])
        if name in names:
            q[..., names.index(name)] = value
        else:
            q[..., names.index(f"{name}_cos")] = np.cos(value)
            q[..., names.index(f"{name}_sin")] = np.sin(value)
    return q


def taken(space: JointSpace, q: Array, names: Sequence[str]) -> Array:
    """Positions of named joints, which turn or slide, shape (..., names), [rad] or [m]."""
    places = {name: k for k, name in enumerate(space.position_names)}
    known, columns = angles_and_lengths(space), []
    for name in names:
        if name not in known:
            raise UnknownNameError("revolute or prismatic joint", name, known)
        if name in places:
            columns.append(q[..., places[name]])
        else:
            cosine, sine = (q[..., places[f"{name}_{part}"]] for part in ("cos", "sin"))
            columns.append(np.arctan2(sine, cosine))
    return np.stack(columns, axis=-1) if columns else np.zeros((*q.shape[:-1], 0))
