# SPDX-License-Identifier: BSD-2-Clause
"""Arrows of torques and forces: of motors, of joints and closures, of contacts.

The sizes in this module are relative to a length `scale` [m], which depends on the robot. The page
scales an arrow to its share of the largest torque or force (`scene_parts`).
"""

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
#: Length of the arrow of a force, and the part of it before the head.
_LENGTH = 2.0
_HEAD = 0.7
#: Radii of the shafts of arrows.
_MOTOR_RADIUS = 0.055
_FORCE_RADIUS = 0.04
#: The arrow of a torque is an arc of a unit circle: angles of its shaft and its head, [rad].
_SHAFT_ANGLE = np.radians(250)
_HEAD_ANGLE = 0.6
#: Distance of the arrow of a motor from the axis of its slide.
_BESIDE_SLIDE = 0.35
#: Motors that are closer than this would have their arrows at one place, for instance in the centre
#: of a spherical robot. Then each arrow is moved away from there, against its axis.
_MEETING = 0.1
_FROM_CENTRE = 0.93
#: Radius of the mark of a contact.
_MARK_RADIUS = 0.08
#: A sphere with a larger radius would hide the arrow of its contact.
_HIDING_RADIUS = 0.2


def torque_arrows(
    model: pin.Model, q: Array, axes: Sequence[RateAxis], B: Array, scale: float
) -> Iterator[TorqueArrow]:
    """Arrows of the motor torques and forces, at the joints on which the motors act.

    Args:
        model: The model of the robot.
        q: Configuration at which the distances between motors are judged, shape (nq,).
        axes: The axis of each rate at q.
        B: Matrix from the motor torques to the torques along the rates, shape (nv, motors).
        scale: Scale of the largest arrow, [m].
    """
    shaft_angles = np.linspace(0, _SHAFT_ANGLE, 40)
    torque = arrow(circle([*shaft_angles, _SHAFT_ANGLE + _HEAD_ANGLE]), _MOTOR_RADIUS)
    force = _straight_arrow(_MOTOR_RADIUS)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    origins = np.array([data.oMi[axis.mover].act(axis.origin) for axis in axes])
    driven_origins = origins[B.any(axis=1)]
    for rate, motor in np.argwhere(B):
        axis = axes[rate]
        R = along(axis.direction)
        distances = np.linalg.norm(driven_origins - origins[rate], axis=1)
        # One of the distances is zero: the distance of this rate from itself.
        meets_others = np.count_nonzero(distances < _MEETING * scale) > 1
        if axis.turns:
            mesh = torque
            mirror = (1.0, -1.0, 1.0)  # the arc then turns the other way about z
            origin = axis.origin
            if meets_others:
                origin = origin - _FROM_CENTRE * scale * axis.direction
        else:
            mesh = force
            mirror = (1.0, 1.0, -1.0)  # the arrow then points along -z
            origin = axis.origin + _BESIDE_SLIDE * scale * R[:, 0]
        name = f"{motor + 1}_{model.names[axis.joint]}"
        at = homogeneous(scale * R, origin)
        shape = Shape(str(axis.mover), "torques", name, mesh, HUES[motor % len(HUES)], at=at)
        share = float(B[rate, motor] / np.abs(B[:, motor]).max())
        yield TorqueArrow(shape, motor=int(motor), share=share, mirror=mirror)


def reaction_arrows(robot: ClosedChain, layout: EffortLayout, scale: float) -> Iterator[ForceArrow]:
    """Arrows of the reaction forces: in joints and then in closures, as in `ClosedChain.reactions`.

    In a joint it is the force of the parent on the child, in the axes of the joint. In a closure it
    is the force of frame A on frame B, in the axes of B. The forces of couplings and brakes act at
    no single point, so they have no arrow. `scale` is the scale of the largest arrow, [m].
    """
    model = robot.mechanism.model
    mesh = _straight_arrow(_FORCE_RADIUS)
    largest = np.diag([scale, scale, scale, 1.0])
    for k in range(1, model.njoints):
        number = k - 1
        shape = Shape(str(k), "reactions", f"{number}", mesh, _FORCE, at=largest)
        yield ForceArrow(shape, first=layout.reaction(number))
    # The number of the first closure follows the numbers of the joints.
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
    """The spheres of contacts that have a radius."""
    for place in places:
        if place.radius > 0:
            mover = str(place.frame.parentJoint)
            at = place.frame.placement.homogeneous
            ball = solid(coal.Sphere(place.radius))
            name = f"sphere_{place.node}"
            yield Shape(mover, "contacts", name, ball, GREY, opacity=0.5, at=at)


def contact_arrows(
    places: Sequence[ContactPlace], layout: EffortLayout, scale: float
) -> Iterator[ForceArrow | ForceMark]:
    """An arrow and a mark for each contact; they show the force of the ground on the body.

    The arrow starts at the point that touches the ground. With a large sphere it ends there,
    because the sphere would hide it. `scale` is the scale of the largest arrow, [m].
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
    """An arrow of a force, from the origin along z."""
    return arrow([(0, 0, 0), (0, 0, _HEAD * _LENGTH), (0, 0, _LENGTH)], radius)
