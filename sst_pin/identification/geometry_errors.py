# SPDX-License-Identifier: BSD-2-Clause
"""Errors of a geometry as joints of an enlarged robot: three slides, three hinges at each place.

The natural orthogonal complement of this robot has the derivatives of a pose by the errors, with
closed loops.
"""

from collections.abc import Sequence
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


def considered(
    chain: ClosedChain, frame: str, which: Sequence[str] | None, urdf: str | Path | None
) -> list[str]:
    """Names of the errors that fit patterns; with a URDF, it has to store them."""
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
    return errors


def enlarged(chain: ClosedChain, errors: Sequence[str]) -> ClosedChain:
    """The robot whose geometry can err; its coordinates are the chain's and independent errors."""
    mechanism = chain.mechanism
    ways = [geometry.displacements(mechanism, {name: 1.0}) for name in errors]
    joints = [(name, *pair) for name, way in zip(errors, ways, strict=True) for pair in way.items()]
    model = geometry.enlarged(mechanism.model, joints)
    large = ClosedChain(model, chain.closures, [*chain.coordinates, *errors])
    if lost := set(chain.coordinates) - set(large.coordinates):
        raise InputError("which", f"the errors leave no choice of {listed(sorted(lost))}")
    return large


def without_errors(large: ClosedChain, chain: ClosedChain, q: Array) -> Array:
    """Configurations of the enlarged robot for those of the chain, shape (N, nq)."""
    result = np.tile(pin.neutral(large.mechanism.model), (len(q), 1))
    result[:, [large.position_names.index(name) for name in chain.position_names]] = q
    return result


def opening(large: ClosedChain, errors: Sequence[str], q: Array) -> list[str]:
    """The errors that alone open the loops in all configurations of the enlarged robot."""
    columns = large.mechanism.space.rates_of(errors)
    least = np.full(len(errors), np.inf)
    for configuration in q:
        Phi = large.Phi(configuration) * large.mechanism.rate_scale
        Phi *= large.mechanism.row_scale[:, None]
        U, s, _ = np.linalg.svd(np.delete(Phi, columns, axis=1), full_matrices=False)
        closing = U[:, s > RANK_TOLERANCE * s.max(initial=0.0)]
        E = Phi[:, columns]
        least = np.minimum(least, np.linalg.norm(E - closing @ (closing.T @ E), axis=0))
    return [name for name, size in zip(errors, least, strict=True) if size > _CLOSED]
