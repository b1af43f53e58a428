# SPDX-License-Identifier: BSD-2-Clause
"""A tree with additional joints that stay at zero, for derivatives by its geometry."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import InputError
from .closures import Constraint, Distance, ExtendedDistance
from .geometry import place_of
from .joint_series import Series
from .rebuilt_tree import rebuilt


class RestingJoint(NamedTuple):
    """A joint that stays at zero; its motion displaces a place.

    Attributes:
        name: Its name, which begins with the name of the place.
        place: The place.
        direction: Displacement of the place, shape (6,): a slide or a turn.
    """

    name: str
    place: str
    direction: Array


def extended(
    closures: Sequence[Constraint], rods_of_joints: Mapping[str, str]
) -> tuple[Constraint, ...]:
    """The closures with rods that joints of `enlarged` extend.

    `rods_of_joints` has the rod that each joint extends.
    """
    result: list[Constraint] = []
    for closure in closures:
        joints = [joint for joint, rod in rods_of_joints.items() if rod == str(closure)]
        if joints and isinstance(closure, Distance):
            rod = ExtendedDistance(
                closure.frame_a, closure.frame_b, closure.distance, tuple(joints)
            )
            result.append(rod)
        else:
            result.append(closure)
    return tuple(result)


def _joint_model(model: pin.Model, resting: RestingJoint) -> Any:
    """The joint of Pinocchio whose motion displaces a place as a joint at rest does."""
    slide, turn = np.split(resting.direction / np.linalg.norm(resting.direction), 2)
    if turn.any():
        return pin.JointModelRevoluteUnaligned(turn)
    # The direction of a slide is in axes of the body; the axis of a joint is in its own axes.
    _, placement = place_of(model, resting.place)
    return pin.JointModelPrismaticUnaligned(placement.rotation.T @ slide)


def _insert_before_frame(model: pin.Model, name: str, joints: Mapping[str, Any]) -> None:
    """Insert joints, by the suffixes of their names, between a body and the frames of a name."""
    frames = [frame for frame in model.frames if frame.name == name]
    parent = frames[0].parentJoint
    placement = frames[0].placement.copy()
    for suffix, joint in joints.items():
        parent = model.addJoint(parent, joint, placement, name + suffix)
        placement = pin.SE3.Identity()
    for frame in frames:
        frame.parentJoint = parent
        frame.placement = placement


def enlarged(
    model: pin.Model, joints_at_rest: Iterable[RestingJoint], slides: Iterable[str] = ()
) -> pin.Model:
    """The tree with additional joints at the places, which stay at zero.

    They are in series between a body and the place: before the joint that is the place, or between
    the body and the frame that is the place. The derivative by a displacement of the place equals
    the derivative by the position of such a joint. The result has no named configurations.

    Args:
        model: The tree.
        joints_at_rest: The joints at places.
        slides: Names of the joints for `extended`: slides on the ground, which move nothing.
    """
    if list(model.mimicking_joints):
        raise InputError("model", "has mimic joints; use ordinary ones with a Coupling")
    # The joints at each place, by what their names have after the name of the place.
    joints_at: dict[str, dict[str, Any]] = defaultdict(dict)
    for resting in joints_at_rest:
        suffix = resting.name.removeprefix(resting.place)
        joints_at[resting.place][suffix] = _joint_model(model, resting)

    changes: dict[int, Series] = {}
    for j, name in enumerate(model.names):
        if name in joints_at:
            series = Series.named(joints_at[name])
            changes[j] = Series([*series.parts, *Series.whole(model.joints[j]).parts])
    large = rebuilt(model, changes).model
    for place, joints in joints_at.items():
        if place not in model.names:
            _insert_before_frame(large, place, joints)
    for name in slides:
        large.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), name)
    for pose in list(large.referenceConfigurations):
        del large.referenceConfigurations[pose.key()]
    return large
