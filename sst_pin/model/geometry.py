# SPDX-License-Identifier: BSD-2-Clause
"""The geometry of a robot in parameters: placements of joints and frames, and lengths of links.

A parameter displaces places: joints with all that they bear, and frames of closures and lines. A
displacement is [linear; angular], shape (6,): linear along the axes of the body that bears the
place, angular about the axes of the place itself.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import InputError
from .closures import frames_of
from .joint_series import Series
from .mechanism import Mechanism
from .rebuilt_tree import rebuilt
from .tree import frame_id

#: Displacements of a place: along x, y, z and about them.
AXES = ("x", "y", "z", "rx", "ry", "rz")
_LENGTH = "length"
#: Places of one link that are closer, relative to its length, are one.
_SAME_POINT = 1e-9

#: Displacements of places by their names.
Displacements = dict[str, Array]
#: A joint at rest: its name, its place, and a displacement, which is a slide or a turn.
Error = tuple[str, str, Array]


def places_of(mechanism: Mechanism) -> list[str]:
    """Names of the joints and of the frames that closures and lines connect."""
    ends = [end for closure in mechanism.closures for end in frames_of(closure)]
    ends += [end for line in mechanism.lines.forces for end in (line.frame_a, line.frame_b)]
    names = dict.fromkeys([*list(mechanism.model.names)[1:], *ends])
    return [name for name in names if name != "universe"]


def parameter_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the lengths of links, then those of all displacements of places."""
    lengths = [f"{link}.{_LENGTH}" for link in _lengths(mechanism)]
    places = places_of(mechanism)
    return (*lengths, *(f"{place}.{axis}" for place in places for axis in AXES))


def displacements(mechanism: Mechanism, changes: Mapping[str, float]) -> Displacements:
    """What changes of named parameters displace."""
    lengths, total = _lengths(mechanism), Displacements()
    for name, change in changes.items():
        place, _, axis = name.rpartition(".")
        is_length = axis == _LENGTH
        moves = lengths[place] if is_length else {place: np.eye(6)[AXES.index(axis)]}
        for end, direction in moves.items():
            total[end] = total.get(end, 0) + change * direction
    return total


def _lengths(mechanism: Mechanism) -> dict[str, Displacements]:
    """For each link of one length the displacements that make it longer by one, by its joint.

    Such a link bears all its places at its origin or at one other point.
    """
    model, places = mechanism.model, places_of(mechanism)
    ends: dict[int, Displacements] = {}
    for place in places:
        ends.setdefault(bearer_of(model, place), {})[place] = placement_of(model, place).translation
    lengths: dict[str, Displacements] = {}
    for joint, points in ends.items():
        far = {place: p for place, p in points.items() if p.any()}
        if not joint or not far:
            continue
        end = next(iter(far.values()))
        size = float(np.linalg.norm(end))
        if all(np.linalg.norm(p - end) <= _SAME_POINT * size for p in far.values()):
            others = [f for f in model.frames if f.parentJoint == joint and f.name not in far]
            names = [f.name for f in others if np.allclose(f.placement.translation, end, 1e-9)]
            along = np.append(end / size, np.zeros(3))
            lengths[model.names[joint]] = dict.fromkeys([*far, *names], along)
    return lengths


def placement_of(model: pin.Model, place: str) -> pin.SE3:
    """Placement of a joint or frame on the body that bears it."""
    if model.existJointName(place):
        return model.jointPlacements[model.getJointId(place)]
    return model.frames[frame_id(model, place)].placement


def bearer_of(model: pin.Model, place: str) -> int:
    """The joint whose body bears a joint or frame."""
    if model.existJointName(place):
        return int(model.parents[model.getJointId(place)])
    return int(model.frames[frame_id(model, place)].parentJoint)


def relative(placement: pin.SE3, displacement: Array) -> pin.SE3:
    """What a displacement is in the axes of the place: it comes behind the placement."""
    turn = np.eye(3)
    for axis, angle in zip(np.eye(3), displacement[3:], strict=True):
        turn = turn @ pin.exp3(angle * axis)
    return pin.SE3(turn, placement.rotation.T @ displacement[:3])


def displaced(model: pin.Model, changes: Displacements) -> pin.Model:
    """The tree with its joints and frames displaced."""
    model = pin.Model(model)
    for place, displacement in changes.items():
        placement = placement_of(model, place)
        placement = placement * relative(placement, displacement)
        if model.existJointName(place):
            model.jointPlacements[model.getJointId(place)] = placement
        else:
            for frame in (frame for frame in model.frames if frame.name == place):
                frame.placement = placement
    return model


def enlarged(model: pin.Model, errors: Sequence[Error]) -> pin.Model:
    """The tree with a joint at rest for each error, in series from the body to the place.

    The derivative by a change of the geometry is that by the position of such a joint. The tree has
    no named configurations.
    """
    if list(model.mimicking_joints):
        raise InputError("model", "has mimic joints; use ordinary ones with a Coupling")
    by_place: dict[str, dict[str, Any]] = {}
    for name, place, way in errors:
        by_place.setdefault(place, {})[name.removeprefix(place)] = _joint(model, place, way)
    joints = {place: model.getJointId(place) for place in by_place if model.existJointName(place)}
    large = rebuilt(
        model,
        {
            j: Series(
                [*Series.named(by_place.pop(place)).parts, *Series.whole(model.joints[j]).parts]
            )
            for place, j in joints.items()
        },
    )
    for place, own in by_place.items():
        frames = [frame for frame in large.frames if frame.name == place]
        bearer, at = frames[0].parentJoint, frames[0].placement.copy()
        for suffix, joint in own.items():
            bearer = large.addJoint(bearer, joint, at, place + suffix)
            at = pin.SE3.Identity()
        for frame in frames:
            frame.parentJoint, frame.placement = bearer, at
    for pose in list(large.referenceConfigurations):
        del large.referenceConfigurations[pose.key()]
    return large


def _joint(model: pin.Model, place: str, way: Array) -> pin.JointModel:
    if way[3:].any():
        return pin.JointModelRevoluteUnaligned(way[3:])
    return pin.JointModelPrismaticUnaligned(placement_of(model, place).rotation.T @ way[:3])
