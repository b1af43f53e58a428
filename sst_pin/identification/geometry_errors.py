# SPDX-License-Identifier: BSD-2-Clause
"""Errors of a geometry as joints of an enlarged robot: three slides, three hinges at each place.

The natural orthogonal complement of this robot has the derivatives of a pose by the errors, with
closed loops.
"""

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import InputError, UnknownNameError
from ..model import geometry
from ..model.thresholds import RANK_TOLERANCE
from ..model.tree import frame_id
from ..reading import Urdf
from ..summaries import listed
from .urdf_numbers import bearers_of

#: What the joints do not close of an error, free of units, counts as none below this.
_CLOSED = 1e-6


def enlarged(
    chain: ClosedChain,
    frame: str,
    which: Sequence[str] | None,
    urdf: str | Path | None = None,
) -> tuple[ClosedChain, list[str]]:
    """The robot whose geometry can err, and the names of the errors that are independent.

    With a URDF, they are errors that it can store.
    """
    mechanism = chain.mechanism
    frame_id(mechanism.model, frame)
    places = list(dict.fromkeys([*geometry.places_of(mechanism), frame]))
    names = [f"{place}.{axis}" for place in places for axis in geometry.AXES]
    stored = places if urdf is None else bearers_of(Urdf.read(urdf).root, mechanism.model)
    by_default = [f"{place}.*" for place in places if place != frame and place in stored]
    patterns = by_default if which is None else which
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise UnknownNameError("error of the geometry", pattern, names)
    errors = [name for name in names if any(fnmatchcase(name, p) for p in patterns)]
    if others := [name for name in errors if name.rpartition(".")[0] not in stored]:
        problem = f"{urdf} cannot store {listed(others)}: no joint of it is there; leave them out"
        raise InputError("which", problem)
    ways = [geometry.displacements(mechanism, {name: 1.0}) for name in errors]
    joints = [(name, *pair) for name, way in zip(errors, ways, strict=True) for pair in way.items()]
    model = geometry.enlarged(mechanism.model, joints)
    large = ClosedChain(model, chain.closures, [*chain.coordinates, *errors])
    if lost := set(chain.coordinates) - set(large.coordinates):
        raise InputError("which", f"the errors leave no choice of {listed(sorted(lost))}")
    return large, [name for name in errors if name in large.coordinates]


def opening(
    large: ClosedChain, errors: list[str], drawn: Sequence[Mapping[str, float]]
) -> list[str]:
    """The errors that alone open the loops of the robot as it is drawn, in all its poses."""
    model = large.mechanism.model
    columns = [model.joints[model.getJointId(name)].idx_v for name in errors]
    least = np.full(len(errors), np.inf)
    for positions in drawn:
        Phi = large.Phi(without_errors(large, positions)) * large.mechanism.rate_scale
        Phi *= large.mechanism.row_scale[:, None]
        U, s, _ = np.linalg.svd(np.delete(Phi, columns, axis=1), full_matrices=False)
        closing = U[:, s > RANK_TOLERANCE * s.max(initial=0.0)]
        E = Phi[:, columns]
        least = np.minimum(least, np.linalg.norm(E - closing @ (closing.T @ E), axis=0))
    return [name for name, size in zip(errors, least, strict=True) if size > _CLOSED]


def without_errors(large: ClosedChain, positions: Mapping[str, float]) -> Array:
    """The configuration of the enlarged robot where that without errors has given positions."""
    q = pin.neutral(large.mechanism.model)
    for k, name in enumerate(large.position_names):
        q[k] = positions.get(name, q[k])
    return np.asarray(q, float)
