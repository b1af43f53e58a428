# SPDX-License-Identifier: BSD-2-Clause
"""Arrows of torques and forces: of motors, of joints and closures, of contacts."""

from collections.abc import Iterator, Sequence

import coal
import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..description.colours import HUES
from ..model.closures import Brake, Coupling, frames_of
from ..model.tree import frame_named
from .rate_axes import RateAxis
from .scene_parts import (
    GREY,
    ContactPlace,
    EffortLayout,
    ForceArrow,
    ForceMark,
    Mesh,
    Shape,
    TorqueArrow,
    along,
    homogeneous,
)
from .triangles import arrow, circle, solid

_FORCE = "#263238"
_CONTACT = "#00796B"
#: Length of the arrow of a force, in the scale of the largest arrow, and where its head begins.
_LENGTH = 2.0
_HEAD = 0.7
#: Radii of the shafts of arrows, in the same scale.
_MOTOR_RADIUS = 0.055
_FORCE_RADIUS = 0.04
#: The bow of a torque, and the angle of its head, [rad].
_BOW = np.radians(250)
_BOW_HEAD = 0.6
#: Distance of the arrow of a motor from the axis of its slide, in the same scale.
_BESIDE_SLIDE = 0.35
#: Motors that are closer meet, as in spherical robots; then the arrows move away from the centre.
_MEETING = 0.1
_FROM_CENTRE = 0.93
#: Radius of the mark of a contact, and of a sphere that would hide the arrow of its contact, in the
#: same scale.
_MARK_RADIUS = 0.08
_HIDING_RADIUS = 0.2


def torque_arrows(
    model: pin.Model, q: Array, axes: Sequence[RateAxis], B: Array, scale: float
) -> Iterator[TorqueArrow]:
    """Arrows of the motor torques, at the joints that the motors act on by B, shape (nv, motors).

    `axes` are the axes of all rates at the configuration q; `scale` is that of the largest arrow,
    [m].
    """
    bow = np.linspace(0, _BOW, 40)
    torque = arrow(circle([*bow, bow[-1] + _BOW_HEAD]), _MOTOR_RADIUS)
    force = _straight_arrow(_MOTOR_RADIUS)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    places = np.array([data.oMi[axis.mover].act(axis.origin) for axis in axes])
    driven = np.flatnonzero(B.any(axis=1))
    for rate, motor in np.argwhere(B):
        axis = axes[rate]
        axes_along = along(axis.direction)
        distances = np.linalg.norm(places[driven] - places[rate], axis=1)
        meets_others = np.count_nonzero(distances < _MEETING * scale) > 1
        if axis.turns:
            mesh = torque
            mirror = (1.0, -1.0, 1.0)
            origin = axis.origin
            if meets_others:
                origin = origin - _FROM_CENTRE * scale * axis.direction
        else:
            mesh = force
            mirror = (1.0, 1.0, -1.0)
            origin = axis.origin + _BESIDE_SLIDE * scale * axes_along[:, 0]
        name = f"{motor + 1}_{model.names[axis.joint]}"
        at = homogeneous(scale * axes_along, origin)
        shape = Shape(str(axis.mover), "torques", name, mesh, HUES[motor % len(HUES)], at=at)
        share = float(B[rate, motor] / np.abs(B[:, motor]).max())
        yield TorqueArrow(shape, motor=int(motor), share=share, mirror=mirror)


def reaction_arrows(robot: ClosedChain, layout: EffortLayout, scale: float) -> Iterator[ForceArrow]:
    """Arrows of the forces of `reactions`: of parents on children in joints, of A on B in closures.

    Couplings and brakes have no place, and so no arrow. `scale` is that of the largest arrow, [m].
    """
    model = robot.mechanism.model
    mesh = _straight_arrow(_FORCE_RADIUS)
    largest = np.diag([scale, scale, scale, 1.0])
    for k in range(1, model.njoints):
        number = k - 1
        shape = Shape(str(k), "reactions", f"{number}", mesh, _FORCE, at=largest)
        yield ForceArrow(shape, first=layout.reaction(number))
    for number, closure in enumerate(robot.closures, model.njoints - 1):
        if isinstance(closure, (Coupling, Brake)):
            continue
        _, frame_b = frames_of(closure)
        frame = frame_named(model, frame_b)
        at = frame.placement.homogeneous @ largest
        mover = str(frame.parentJoint)
        shape = Shape(mover, "reactions", f"{number}", mesh, _FORCE, at=at)
        yield ForceArrow(shape, first=layout.reaction(number))


def contact_places(robot: ClosedChain) -> list[ContactPlace]:
    """The places of all contacts, in their order."""
    model = robot.mechanism.model
    places = []
    for k, contact in enumerate(robot.mechanism.contacts.points):
        place = ContactPlace(
            node=f"contact_{k}",
            frame=frame_named(model, contact.frame),
            ground=frame_named(model, contact.ground),
            radius=contact.radius,
        )
        places.append(place)
    return places


def contact_spheres(places: Sequence[ContactPlace]) -> Iterator[Shape]:
    """The spheres of contacts that are no points."""
    for place in places:
        if place.radius > 0:
            mover = str(place.frame.parentJoint)
            at = place.frame.placement.homogeneous
            ball = solid(coal.Sphere(place.radius))
            yield Shape(mover, "contacts", f"sphere_{place.node}", ball, GREY, 0.5, at)


def contact_arrows(
    places: Sequence[ContactPlace], layout: EffortLayout, scale: float
) -> Iterator[ForceArrow | ForceMark]:
    """An arrow and a mark for each contact that acts: the force of the ground on the body.

    The arrow starts at the place; at a large sphere it ends there, because the sphere would hide
    it. `scale` is that of the largest arrow, [m].
    """
    mesh = _straight_arrow(_FORCE_RADIUS)
    ball = solid(coal.Sphere(_MARK_RADIUS * scale))
    largest = np.diag([scale, scale, scale, 1.0])
    for k, place in enumerate(places):
        force = Shape(place.node, "contacts", "force", mesh, _CONTACT, at=largest)
        start = _LENGTH if place.radius > _HIDING_RADIUS * scale else 0.0
        yield ForceArrow(force, first=layout.contact(k), start=start)
        mark = Shape(place.node, "contacts", "point", ball, _CONTACT)
        yield ForceMark(mark, first=layout.contact(k))


def _straight_arrow(radius: float) -> Mesh:
    """An arrow from the origin along z."""
    return arrow([(0, 0, 0), (0, 0, _HEAD * _LENGTH), (0, 0, _LENGTH)], radius)
