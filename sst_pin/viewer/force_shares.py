# SPDX-License-Identifier: BSD-2-Clause
"""Torques and forces as shares of the largest, for arrows, with curves and notes for a page.

The length of an arrow depends on the share that its torque or force has of the largest one. So a
share is between 0 and 1; a torque's share has the sign of the torque.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Flags
from ..closed_chain import ClosedChain
from ..errors import ActuationError, ClosureError, SingularConfigurationError
from ..summaries import listed, three_digits
from .curve_sets import contacts_of, forces_of

#: The longest arrow of a contact shows at most this force, as a multiple of the robot's weight.
_MOST_WEIGHTS = 2.0


class ShownForces(NamedTuple):
    """Forces of some samples, as the page shows them."""

    #: Forces as vectors, divided by the largest, shape (n, forces, 3); None for no arrows.
    shares: Array | None
    curves: list[dict[str, Any]]  #: Sets of curves, see `curve_sets`.
    note: str  #: A text below the curves.


NO_FORCES = ShownForces(None, [], "")


def torque_shares(robot: ClosedChain, tau: Array) -> Array:
    """Motor torques of n samples, each divided by the largest of all motors with the same unit.

    So torques are compared with torques and forces with forces. Both shapes are (n, motors).
    """
    shares = np.zeros_like(tau)
    units = np.array(robot.motor_units)
    for unit in set(robot.motor_units):
        has_unit = units == unit
        largest = np.abs(tau[:, has_unit]).max(initial=0.0)
        shares[:, has_unit] = tau[:, has_unit] / (largest or 1.0)
    return shares


def moving_mass(model: pin.Model) -> float:
    """Mass of all moving bodies, [kg]; the first body of a model is fixed to the world."""
    return sum(float(body.mass) for body in model.inertias[1:])


def contact_forces(robot: ClosedChain, forces: Array) -> ShownForces:
    """Forces of contacts, shape (n, contacts, 3), as shares of the longest arrow's force."""
    sizes = np.linalg.norm(forces, axis=2, keepdims=True)
    largest = float(sizes.max(initial=0.0))
    if largest == 0:
        return ShownForces(forces, [contacts_of(robot, forces)], "No forces on contacts.")
    # The force of an impact is hundreds of times larger than the forces of a robot that stands.
    # If it had the longest arrow, the others would not be seen. So arrows have a greatest length.
    model = robot.mechanism.model
    weight = float(np.linalg.norm(model.gravity.linear)) * moving_mass(model)
    longest = largest
    if weight > 0:
        longest = min(largest, _MOST_WEIGHTS * weight)
    more = " or more" if largest > longest else ""
    note = (
        f"Green arrows: forces on what touches a ground; the longest is "
        f"{three_digits(longest)}\xa0N{more}. Lengths grow with the square root."
    )
    # A force above `longest` becomes a unit vector.
    shares = forces / np.maximum(sizes, longest)
    return ShownForces(shares, [contacts_of(robot, forces)], note)


def reaction_forces(
    robot: ClosedChain,
    q: Array,
    va: Array,
    aa: Array | None,
    tau: Array | None,
    stiffness: Mapping[str, ArrayLike] | None,
) -> ShownForces:
    """Unique forces in joints and closures as shares of the largest.

    The arguments are those of `ClosedChain.reactions` for n samples. If the reactions are not
    defined, there are no arrows, and the note says why.
    """
    engine = robot.engine
    try:
        w = engine.reactions(q, va, aa, tau, stiffness)
        # Forces in joints and closures, shape (n, forces, 3). Wrenches are [force; moment], and
        # components that are not unique are NaN.
        forces = np.concatenate([w.joints, w.closures], axis=1)[..., :3]
        # True for each component that is not unique in some sample, shape (forces, 3).
        is_unknown = np.isnan(forces).any(axis=0)
        # For each force the number of directions along which it is not unique, 0 to 3: the largest
        # number of all samples.
        unknown_directions = np.zeros(len(w.names))
        if is_unknown.any():
            # In a planar robot the unique parts are the forces in its plane.
            forces, counts = engine.unique_forces(q, va, aa, tau, stiffness)
            unknown_directions = counts.max(axis=0)
    except (ActuationError, ClosureError, SingularConfigurationError) as error:
        return ShownForces(None, [], f"No reactions: {error}")
    # A force is drawn if a part of it is unique in all samples. The others count as zero.
    is_drawn = unknown_directions < 3
    drawn_forces = np.zeros_like(forces)
    drawn_forces[:, is_drawn] = forces[:, is_drawn]
    largest = float(np.linalg.norm(drawn_forces, axis=2).max(initial=0.0))

    curves = []
    notes = []
    if is_drawn.any():
        curves.append(forces_of(w.names, drawn_forces, is_drawn))
        if largest == 0:
            notes.append("No forces in joints.")
        else:
            notes.append(
                f"Dark arrows: forces of joints on what they carry; the largest is "
                f"{three_digits(largest)}\xa0N. Lengths grow with the square root."
            )
    not_unique = []
    for k, name in enumerate(w.names):
        if unknown_directions[k]:
            not_unique.append(name + _directions(is_unknown[k], int(unknown_directions[k])))
    if not_unique:
        notes.append(f"Not unique, so not drawn: {listed(not_unique)}.")
    return ShownForces(drawn_forces / (largest or 1.0), curves, " ".join(notes))


def _directions(is_unknown: Flags, count: int) -> str:
    """The directions along which a force is not unique, in words; empty for all three.

    Args:
        is_unknown: Components x, y, z that are not unique, shape (3,).
        count: Number of these directions. It is less than the number of such components if the
            directions are oblique to the axes.
    """
    if count == 3:
        return ""
    letters = [letter for letter, unknown in zip("xyz", is_unknown, strict=True) if unknown]
    if count == len(letters):
        return f" ({', '.join(letters)})"
    return " (along one direction)" if count == 1 else " (along two directions)"
