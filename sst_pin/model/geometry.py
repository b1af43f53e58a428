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

import numpy as np
import pinocchio as pin

from ..arrays import Array
from .closures import Constraint, Distance, frames_of
from .mechanism import Mechanism
from .tree import frame_named

#: Displacements of a place: along x, y, z and about them.
AXES = ("x", "y", "z", "rx", "ry", "rz")
#: Ends of a link coincide if their distance, relative to the link's length, is not larger. Rounding
#: is smaller, and points that files keep apart differ by more.
_SAME_POINT = 1e-9
#: Displacements of places by their names.
Displacements = dict[str, Array]


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
