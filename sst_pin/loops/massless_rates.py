# SPDX-License-Identifier: BSD-2-Clause
"""Rates that move no mass, such as the turn of a thin rod between two balls about itself.

At such rates the mass matrix L^T M L of the coordinates is singular to rounding.
"""

from contextlib import suppress

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import SingularConfigurationError
from ..model.mechanism import Mechanism
from ..model.thresholds import INDEPENDENT
from .coordinate_choice import choose_coordinates
from .line_kinematics import LineKinematics
from .loops import Loops
from .ranks import scaled_Phi

#: Coordinates move no mass if their inertia is below this fraction of the largest inertia that
#: their bodies could have. A wire of 1 m with a diameter of 0.1 mm has more about its own axis.
_NO_MASS = 1e-8


def massless_rates(
    mechanism: Mechanism, loops: Loops, coordinates: Indices, q: Array, motions: Array
) -> tuple[str, ...]:
    """Names of coordinates that move no mass.

    If the coordinates are dependent at q, other independent rates are judged in their place.

    Args:
        mechanism: The mechanism.
        loops: Its loops.
        coordinates: Indices in v of the coordinates.
        q: A closed configuration without symmetry, so that the result holds everywhere.
        motions: Orthonormal motions from q, free of units, shape (nv, n).
    """
    Phi = scaled_Phi(mechanism, loops, q)
    chosen = choose_coordinates(mechanism, Phi, [coordinates], motions)
    if not len(chosen):
        return ()

    # v = L v_chosen. The motions are v = motions x, so that x = motions[chosen]^-1 v_chosen.
    motions = mechanism.rate_scale[:, None] * motions
    L = motions @ np.linalg.inv(motions[chosen])

    # The mass matrix. The loops are at q.
    tree = loops.tree.model
    L_of_tree = loops.tree.S @ L
    inertia_of_lines = _inertia_of_lines(mechanism, q, L)
    inertia = L_of_tree.T @ pin.crba(tree, loops.data, loops.q) @ L_of_tree + inertia_of_lines

    # The largest inertia that each coordinate could have: the diagonal of the mass matrix of bodies
    # with larger moments, diag(L^T M L) = sums over the rows of L * (M L).
    M_of_largest = pin.crba(_with_largest_moments(tree), loops.data, loops.q)
    largest = (L_of_tree * (M_of_largest @ L_of_tree)).sum(axis=0) + np.diag(inertia_of_lines)

    # Singular directions of the mass matrix, divided by the largest inertias, and the coordinates
    # that take part in them.
    scale = 1 / np.sqrt(np.maximum(np.abs(largest), 1e-300))
    values, vectors = np.linalg.eigh(scale[:, None] * inertia * scale)
    without_mass = vectors[:, np.abs(values) < _NO_MASS]
    massless = np.abs(without_mass).max(axis=1, initial=0.0) > INDEPENDENT
    return tuple(np.array(mechanism.space.rate_names)[chosen[massless]].tolist())


def _inertia_of_lines(mechanism: Mechanism, q: Array, L: Array) -> Array:
    """L^T M L of the masses that move with the lengths of lines; zero where ends coincide."""
    count = L.shape[1]
    if mechanism.lines.masses.any():
        with suppress(SingularConfigurationError):
            return np.asarray(L.T @ LineKinematics(mechanism).inertia(q) @ L)
    return np.zeros((count, count))


def _with_largest_moments(tree: pin.Model) -> pin.Model:
    """The tree with bodies that have the trace of their inertia as moment about each axis.

    It is a bound: no moment of inertia is larger than the trace.
    """
    enlarged = pin.Model(tree)
    for j, body in enumerate(tree.inertias):
        moments = abs(np.trace(body.inertia)) * np.eye(3)
        enlarged.inertias[j] = pin.Inertia(abs(body.mass), body.lever, moments)
    return enlarged
