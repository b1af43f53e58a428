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

#: A coordinate with a smaller part of the inertia that its bodies could have moves no mass.
_NO_MASS = 1e-8


def massless_rates(
    mechanism: Mechanism, loops: Loops, coordinates: Indices, q: Array, motions: Array
) -> tuple[str, ...]:
    """Names of coordinates that move no mass, or of rates that describe the motion in their place.

    The mass matrix L^T M L is singular there to rounding, at every configuration. Each coordinate
    is scaled by the inertia that it would move if each body turned about its heaviest axis. The
    motions, without units, are those from the configuration q.
    """
    Phi, unit = scaled_Phi(mechanism, loops, q), mechanism.rate_scale
    chosen = choose_coordinates(mechanism, Phi, [coordinates], motions)
    if not len(chosen):
        return ()
    L = unit[:, None] * motions @ np.linalg.inv(motions[chosen] * unit[chosen, None])
    on_lines = np.zeros((len(chosen), len(chosen)))
    if mechanism.lines.masses.any():
        with suppress(SingularConfigurationError):  # where the ends of a line coincide
            on_lines = L.T @ LineKinematics(mechanism).inertia(q) @ L
    tree, L_tree = loops.tree.model, loops.tree.S @ L
    inertia = L_tree.T @ pin.crba(tree, loops.data, loops.q) @ L_tree + on_lines
    heaviest = pin.crba(_with_heaviest_axes(tree), loops.data, loops.q)
    most = (L_tree * (heaviest @ L_tree)).sum(axis=0) + np.diag(on_lines)
    scale = 1 / np.sqrt(np.maximum(np.abs(most), 1e-300))
    values, vectors = np.linalg.eigh(scale[:, None] * inertia * scale)
    without = vectors[:, np.abs(values) < _NO_MASS]
    massless = np.abs(without).max(axis=1, initial=0.0) > INDEPENDENT
    return tuple(np.array(mechanism.space.rate_names)[chosen[massless]].tolist())


def _with_heaviest_axes(tree: pin.Model) -> pin.Model:
    """The tree whose bodies have the trace of their inertia as moment about each axis."""
    heaviest = pin.Model(tree)
    for j, body in enumerate(tree.inertias):
        moments = abs(np.trace(body.inertia)) * np.eye(3)
        heaviest.inertias[j] = pin.Inertia(abs(body.mass), body.lever, moments)
    return heaviest
