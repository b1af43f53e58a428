# SPDX-License-Identifier: BSD-2-Clause
"""Configurations that have a name."""

from __future__ import annotations

from ..arrays import Array
from ..description.frames import base_orientations, star_orientations
from ..description.parameters import Parameters
from ..errors import SingularConfigurationError
from . import kinematics
from .platform_motion import paper_circle


def configurations_of(parameters: Parameters) -> dict[str, Array]:
    """Joint coordinates, shape (9,), of the poses that every description offers, by name.

    `home` is the pose of `SST.home`, `circle_start` the first one of the paper's circle; one in
    which a leg would lie flat on its arc is left out.
    """
    geometry = kinematics.Geometry(base_orientations(parameters), star_orientations(parameters))
    orientations = {
        "home": kinematics.home_orientation(geometry),
        "circle_start": paper_circle([0.0]).R[0],
    }
    found = {}
    for name, R in orientations.items():
        try:
            legs = kinematics.legs_of_orientation(geometry, R, (1, 1, 1))
        except SingularConfigurationError:
            continue
        # The last bit of an arctangent is the machine's own; files shall be the same everywhere.
        found[name] = kinematics.joints_of_legs(geometry, legs).round(14)
    return found
