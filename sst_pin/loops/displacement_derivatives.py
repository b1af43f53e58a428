# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives of the errors of closures by displacements of joints and frames.

`model/geometry` says what a place and its displacement are.
"""

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.geometry import place_of
from .loops import Loops


def by_displacements(loops: Loops, places: Mapping[str, int | None]) -> Array:
    """F, the derivatives of f by displacements of places, [m] and [rad], shape (rows, 6 places).

    The keys of `places` are names. A value is None for a joint, or the index of a frame. `loops`
    must be evaluated at a configuration.

    If a place moves, the frames B and A of a closure have the twists t_B and t_A, and the errors of
    the closure have the rate df/dt = W_B t_B - W_A t_A.
    """
    model = loops.model
    W = loops.W  # [W_B, -W_A], shape (rows, 12)
    F = np.zeros((len(loops.f), len(places), 6))
    for k, (place, frame) in enumerate(places.items()):
        # Column i of `twists` is the twist [v; omega], at the origin of the world, of a unit rate
        # of displacement i: linear along the axes of the body that carries the place, angular about
        # the axes of the place.
        body, placement = place_of(model, place)
        carrier = loops.data.oMi[loops.tree.bodies[body]]  # the body's joint in the normal tree
        twists = (carrier * placement).action
        twists[:3, :3] = carrier.rotation
        for rows in loops.of_frames:
            frame_b, frame_a = rows.frames  # in the normal tree, which keeps the indices of frames
            moves_b = _moves(model, place, frame, frame_b)
            moves_a = _moves(model, place, frame, frame_a)
            # A place that moves both frames as one body does not change the closure.
            if moves_b and not moves_a:
                F[rows.at, k] = W[rows.at, :6] @ twists  # W_B times the twists of B
            if moves_a and not moves_b:
                F[rows.at, k] = W[rows.at, 6:] @ twists  # -W_A times the twists of A
    return F.reshape(len(F), -1)


def _moves(model: pin.Model, place: str, frame: int | None, end: int) -> bool:
    """Whether a displacement of a place moves the frame with the index `end`.

    A frame moves itself only. A joint moves all frames after it.
    """
    if frame is not None:
        return frame == end
    return model.frames[end].parentJoint in model.subtrees[model.getJointId(place)]
