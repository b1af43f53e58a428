# SPDX-License-Identifier: BSD-2-Clause
"""A tree with additional joints that stay at zero, for derivatives by its geometry.

The derivative by a displacement of a joint or frame equals the derivative by the position of an
additional joint just before it. `enlarged` adds such joints. The derivative by the length of a rod,
a `Distance` closure, equals the derivative by the position of an additional slide on the ground;
`with_extended_rods` adds this position to the length. Additional joints are "at rest": they stay at
zero.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import InputError
from .closures import Constraint, Distance, ExtendedDistance
from .geometry import frames_of_place, place_of
from .joint_series import Series
from .rebuilt_tree import rebuilt


class RestingJoint(NamedTuple):
    """A joint that stays at zero; its motion would displace a place, see `geometry`.

    Attributes:
        name: Its name, which begins with the name of the place.
        place: Name of the joint or frame that it displaces.
        direction: The displacement, shape (6,), which is either linear or angular. Its size does
            not count.
    """

    name: str
    place: str
    direction: Array


def enlarged(
    model: pin.Model, joints_at_rest: Iterable[RestingJoint], slides: Iterable[str] = ()
) -> pin.Model:
    """The tree with additional joints at places, and slides on the ground.

    The additional joints of a place are in series between its body and the joint or frame that is
    the place. The result has no named configurations.

    Args:
        model: The tree.
        joints_at_rest: The joints at places.
        slides: Names of the slides for `with_extended_rods`, which move nothing.
    """
    if list(model.mimicking_joints):
        raise InputError("model", "has mimic joints; use ordinary ones with a Coupling")
    # The joints at each place, by the suffixes that follow the place in their names.
    joints_at: dict[str, dict[str, Any]] = defaultdict(dict)
    for resting in joints_at_rest:
        suffix = resting.name.removeprefix(resting.place)
        joints_at[resting.place][suffix] = _joint_model(model, resting)

    changes: dict[int, Series] = {}
    for j, name in enumerate(model.names):
        if name in joints_at:  # the place is a joint
            # The joints at rest come before the joint itself.
            at_rest = Series.named(joints_at[name])
            joint = Series.whole(model.joints[j])
            changes[j] = Series([*at_rest.parts, *joint.parts])
    large = rebuilt(model, changes).model
    for place, joints in joints_at.items():
        if place not in model.names:  # the place is a frame
            _insert_before_frame(large, place, joints)
    for name in slides:
        large.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), name)
    for pose in list(large.referenceConfigurations):
        del large.referenceConfigurations[pose.key()]
    return large


def _joint_model(model: pin.Model, resting: RestingJoint) -> Any:
    """The joint of Pinocchio for a joint at rest."""
    slide, turn = np.split(resting.direction / np.linalg.norm(resting.direction), 2)
    if turn.any():
        return pin.JointModelRevoluteUnaligned(turn)
    # A linear displacement is in axes of the body. The axis of Pinocchio's joint is in the axes of
    # the place.
    _, placement = place_of(model, resting.place)
    return pin.JointModelPrismaticUnaligned(placement.rotation.T @ slide)


def _insert_before_frame(model: pin.Model, name: str, joints: Mapping[str, Any]) -> None:
    """Insert joints between a body and the frames of a place; `joints` are by their suffixes."""
    frames = frames_of_place(model, name)
    parent = frames[0].parentJoint
    placement = frames[0].placement.copy()
    for suffix, joint in joints.items():
        parent = model.addJoint(parent, joint, placement, name + suffix)
        placement = pin.SE3.Identity()
    for frame in frames:
        frame.parentJoint = parent
        frame.placement = placement


def with_extended_rods(
    closures: Sequence[Constraint], rods_of_joints: Mapping[str, str]
) -> tuple[Constraint, ...]:
    """The closures with rods that slides of `enlarged` extend.

    `rods_of_joints` is the name of the rod that each slide extends, by the name of the slide.
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
