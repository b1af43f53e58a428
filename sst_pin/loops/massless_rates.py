# SPDX-License-Identifier: BSD-2-Clause
"""Rates that move no mass, such as the turn of a thin rod between two balls about itself."""

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

#: Coordinates move no mass where their inertia is less than this part of the largest that their
#: bodies could have. About its axis, a wire of 1 m with a diameter of 0.1 mm has more.
_NO_MASS = 1e-8


def massless_rates(
    mechanism: Mechanism, loops: Loops, coordinates: Indices, q: Array, motions: Array
) -> tuple[str, ...]:
    """Names of coordinates that move no mass, or of rates that describe the motion in their place.

    The mass matrix L^T M L is singular there to rounding, at every configuration. Each coordinate
    is scaled by the inertia that it would move if each body turned about its heaviest axis. The
    motions, without units, are those from the configuration q.
    """
    Phi = scaled_Phi(mechanism, loops, q)
    chosen = choose_coordinates(mechanism, Phi, [coordinates], motions)
    if not len(chosen):
        return ()

    # v = L v_chosen: the motions as functions of the rates that are chosen.
    motions = mechanism.rate_scale[:, None] * motions
    L = motions @ np.linalg.inv(motions[chosen])

    # The mass matrix, and the diagonal of the one with the heaviest axes. The loops are at q.
    tree = loops.tree.model
    L_of_tree = loops.tree.S @ L
    of_lines = _inertia_of_lines(mechanism, q, L)
    inertia = L_of_tree.T @ pin.crba(tree, loops.data, loops.q) @ L_of_tree + of_lines
    heaviest = pin.crba(_with_heaviest_axes(tree), loops.data, loops.q)
    largest = (L_of_tree * (heaviest @ L_of_tree)).sum(axis=0) + np.diag(of_lines)

    # Singular directions of the scaled mass matrix, and the coordinates that take part in them.
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


def _with_heaviest_axes(tree: pin.Model) -> pin.Model:
    """The tree whose bodies have the trace of their inertia as moment about each axis."""
    heaviest = pin.Model(tree)
    for j, body in enumerate(tree.inertias):
        moments = abs(np.trace(body.inertia)) * np.eye(3)
        heaviest.inertias[j] = pin.Inertia(abs(body.mass), body.lever, moments)
    return heaviest
