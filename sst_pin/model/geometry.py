# SPDX-License-Identifier: BSD-2-Clause
"""The geometry of a robot in parameters: placements of joints and frames, and lengths of links.

A *place* is a joint, or a frame of a closure or line. A parameter displaces a place: "crank.x" by a
coordinate of its position, "crank.length" all places at the end of a link. Displacing a joint also
moves all bodies after it. A displacement is [linear; angular], shape (6,): linear along the axes of
the body on which the place is, angular about the axes of the place itself.

A *rod* is a `Distance` closure, named by its frames: "a - b.length" is the parameter of its length.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import InputError
from .closures import Constraint, Distance, ExtendedDistance, frames_of
from .joint_series import Series
from .mechanism import Mechanism
from .rebuilt_tree import rebuilt
from .tree import frame_named

#: Displacements of a place: along x, y, z and about them.
AXES = ("x", "y", "z", "rx", "ry", "rz")
#: Ends of a link coincide if their distance, relative to the link's length, is not larger. Rounding
#: is smaller, and points that files keep apart differ by more.
_SAME_POINT = 1e-9
#: Displacements of places by their names.
Displacements = dict[str, Array]


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


def places_of(mechanism: Mechanism) -> list[str]:
    """Names of the joints and of the frames that closures and lines connect."""
    names = list(mechanism.model.names)[1:]
    for closure in mechanism.closures:
        names += frames_of(closure)
    for line in mechanism.lines.forces:
        names += (line.frame_a, line.frame_b)
    return [name for name in dict.fromkeys(names) if name != "universe"]


def length_names(closures: Iterable[Constraint]) -> list[str]:
    """Names of the lengths of rods."""
    rods = [str(closure) for closure in closures if isinstance(closure, Distance)]
    return [f"{rod}.length" for rod in dict.fromkeys(rods)]


def parameter_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the lengths of links and rods, then those of all displacements of places."""
    lengths = [f"{link}.length" for link in _lengths(mechanism)]
    places = [f"{place}.{axis}" for place in places_of(mechanism) for axis in AXES]
    return (*lengths, *length_names(mechanism.closures), *places)


def displacements(mechanism: Mechanism, changes: Mapping[str, float]) -> Displacements:
    """The displacement of each place by changes of named parameters, [m] and [rad].

    Lengths of rods displace no place; see `extensions`.
    """
    lengths = _lengths(mechanism)
    names_of_rods = length_names(mechanism.closures)
    total: Displacements = {}
    for name, change in changes.items():
        if name in names_of_rods:
            continue
        place, _, axis = name.rpartition(".")
        if axis == "length":
            directions = lengths[place]
        else:
            directions = {place: np.eye(6)[AXES.index(axis)]}
        for end, direction in directions.items():
            total[end] = total.get(end, 0) + change * direction
    return total


def extensions(closures: Iterable[Constraint], changes: Mapping[str, float]) -> dict[str, float]:
    """The change of the length of each rod by changes of named parameters, [m]."""
    names_of_rods = length_names(closures)
    return {
        name.removesuffix(".length"): change
        for name, change in changes.items()
        if name in names_of_rods
    }


def lengthened(
    closures: Sequence[Constraint], changes: Mapping[str, float]
) -> tuple[Constraint, ...]:
    """The closures with changed lengths of rods, by the names of the rods, [m]."""
    result: list[Constraint] = []
    for closure in closures:
        if isinstance(closure, Distance) and str(closure) in changes:
            result.append(replace(closure, distance=closure.distance + changes[str(closure)]))
        else:
            result.append(closure)
    return tuple(result)


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


def _lengths(mechanism: Mechanism) -> dict[str, Displacements]:
    """For each link with a length the displacements that lengthen it by 1 m.

    A link has a length if all places on its body that are not at its joint are at one point, its
    end. Then all frames there move, not only those of closures.
    """
    model = mechanism.model
    # The places on each body that are not at its joint.
    places: dict[int, Displacements] = defaultdict(dict)
    for place in places_of(mechanism):
        body, placement = place_of(model, place)
        if body and placement.translation.any():
            places[body][place] = placement.translation
    lengths: dict[str, Displacements] = {}
    for body, points in places.items():
        end = next(iter(points.values()))
        # A body whose places are at several points has no single length.
        if not all(_coincide(point, end) for point in points.values()):
            continue
        at_end = set[str]()
        for frame in model.frames:
            if frame.parentJoint == body and _coincide(frame.placement.translation, end):
                at_end.add(frame.name)
        along = np.append(end / float(np.linalg.norm(end)), np.zeros(3))
        lengths[model.names[body]] = dict.fromkeys([*points, *sorted(at_end)], along)
    return lengths


def _coincide(point: Array, end: Array) -> bool:
    """Whether a point of a link is at its end."""
    return bool(np.linalg.norm(point - end) <= _SAME_POINT * float(np.linalg.norm(end)))


def place_of(model: pin.Model, place: str) -> tuple[int, pin.SE3]:
    """Index of the parent joint of a joint or frame, and the placement relative to it."""
    if model.existJointName(place):
        joint = model.getJointId(place)
        return int(model.parents[joint]), model.jointPlacements[joint]
    frame = frame_named(model, place)
    return int(frame.parentJoint), frame.placement


def relative(placement: pin.SE3, displacement: Array) -> pin.SE3:
    """The displacement as a placement D in the axes of the place: the new one is `placement * D`.

    The angular part are turns about x, then y, then z.
    """
    turn = np.eye(3)
    for axis_turn in np.diag(displacement[3:]):
        turn = turn @ pin.exp3(axis_turn)
    return pin.SE3(turn, placement.rotation.T @ displacement[:3])


def displaced(model: pin.Model, changes: Displacements) -> pin.Model:
    """The tree with its joints and frames displaced."""
    model = pin.Model(model)
    for place, displacement in changes.items():
        _, placement = place_of(model, place)
        placement = placement * relative(placement, displacement)
        if model.existJointName(place):
            model.jointPlacements[model.getJointId(place)] = placement
        else:
            for frame in model.frames:
                if frame.name == place:
                    frame.placement = placement
    return model


def take_placements(model: pin.Model, source: pin.Model) -> None:
    """Give a tree the placements of joints and frames of another tree with the same ones."""
    for j in range(model.njoints):
        model.jointPlacements[j] = source.jointPlacements[j]
    for frame, other in zip(model.frames, source.frames, strict=True):
        frame.placement = other.placement


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
