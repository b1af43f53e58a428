# SPDX-License-Identifier: BSD-2-Clause
"""The geometry of a robot in parameters: placements of joints and frames, and lengths of links.

A *place* is a joint, or a frame of a closure or line. There are three kinds of parameters:

    "crank.x"        displaces one place, a joint or frame with the name crank
    "crank.length"   displaces all places at the end of the link that joint crank moves
    "a - b.length"   extends the rod, a `Distance` closure, between the frames a and b

A displacement is [linear; angular], shape (6,), [m] and [rad]. Its linear part is in the axes of
the body to which the place is fixed, its angular part in the axes of the place itself. Displacing a
joint also moves all bodies after it.

`parameter_names` lists the parameters. `displacements` and `extensions` give the effects of changes
of parameters on places and rods. `displaced` and `lengthened` apply the effects to a tree and to
closures.
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

#: The six displacements of a place: along x, y, z and about them.
AXES = ("x", "y", "z", "rx", "ry", "rz")
#: Points on a body coincide if their distance, relative to the length of the robot, is not larger.
#: Rounding is smaller, and points that files keep apart differ by more.
_SAME_POINT = 1e-9
#: Displacements of places, each of shape (6,), by the names of the places.
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
    """Names of the lengths of links, of the lengths of rods, then of displacements of places."""
    lengths = [f"{link}.length" for link in _lengths(mechanism)]
    places = [f"{place}.{axis}" for place in places_of(mechanism) for axis in AXES]
    return (*lengths, *length_names(mechanism.closures), *places)


def displacements(mechanism: Mechanism, changes: Mapping[str, float]) -> Displacements:
    """The displacement of each place for changes of named parameters, [m] and [rad].

    Changes of the lengths of rods displace no place and are left out; see `extensions`.
    """
    lengths = _lengths(mechanism)
    names_of_rods = length_names(mechanism.closures)
    total: Displacements = {}
    for name, change in changes.items():
        if name in names_of_rods:
            continue
        link_or_place, _, axis = name.rpartition(".")
        if axis == "length":
            directions = lengths[link_or_place]
        else:
            directions = {link_or_place: np.eye(6)[AXES.index(axis)]}
        for place, direction in directions.items():
            total[place] = total.get(place, 0) + change * direction
    return total


def extensions(closures: Iterable[Constraint], changes: Mapping[str, float]) -> dict[str, float]:
    """The change of the length of each rod, [m], for changes of named parameters."""
    names_of_rods = length_names(closures)
    return {
        name.removesuffix(".length"): change
        for name, change in changes.items()
        if name in names_of_rods
    }


def lengthened(
    closures: Sequence[Constraint], changes: Mapping[str, float]
) -> tuple[Constraint, ...]:
    """The closures with longer rods; `changes` of the lengths, [m], are by the names of rods."""
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
    end. Lengthening displaces these places and all other frames at this point.
    """
    model = mechanism.model

    def coincide(a: Array, b: Array) -> bool:
        return bool(np.linalg.norm(a - b) <= _SAME_POINT * mechanism.length)

    # The places on each body that are not at its joint, which is the origin, with their positions.
    places: dict[int, dict[str, Array]] = defaultdict(dict)
    for place in places_of(mechanism):
        body, placement = place_of(model, place)
        if body and not coincide(placement.translation, np.zeros(3)):
            places[body][place] = placement.translation
    lengths: dict[str, Displacements] = {}
    for body, positions in places.items():
        end = next(iter(positions.values()))
        # A body whose places are at several points has no single length.
        if not all(coincide(position, end) for position in positions.values()):
            continue
        at_end = set[str]()
        for frame in model.frames:
            if frame.parentJoint == body and coincide(frame.placement.translation, end):
                at_end.add(frame.name)
        along = np.append(end / float(np.linalg.norm(end)), np.zeros(3))
        lengths[model.names[body]] = dict.fromkeys([*positions, *sorted(at_end)], along)
    return lengths


def place_of(model: pin.Model, place: str) -> tuple[int, pin.SE3]:
    """The body to which a joint or frame is fixed, and its placement on this body.

    The body is given by the index of the joint that moves it, 0 for the base.
    """
    if model.existJointName(place):
        joint = model.getJointId(place)
        return int(model.parents[joint]), model.jointPlacements[joint]
    frame = frame_named(model, place)
    return int(frame.parentJoint), frame.placement


def frames_of_place(model: pin.Model, place: str) -> list[pin.Frame]:
    """The frame that is a place, and the frames of the same name that coincide with it.

    For instance, a link and its fixed joint can have one name. A fixed joint elsewhere can have the
    name too; its frame is not among these.
    """
    chosen = frame_named(model, place)
    frames = list[pin.Frame]()
    for frame in model.frames:
        is_on_same_body = frame.parentJoint == chosen.parentJoint
        if frame.name == place and is_on_same_body and frame.placement == chosen.placement:
            frames.append(frame)
    return frames


def relative(placement: pin.SE3, displacement: Array) -> pin.SE3:
    """The placement D of a displaced place relative to the place before its displacement.

    The displaced place has the placement `placement * D`. The angular part consists of turns about
    x, then about the new y, then about the new z.
    """
    turn = np.eye(3)
    for vector in np.diag(displacement[3:]):  # the rotation vectors of the three turns
        turn = turn @ pin.exp3(vector)
    return pin.SE3(turn, placement.rotation.T @ displacement[:3])


def displaced(model: pin.Model, changes: Displacements) -> pin.Model:
    """The tree with displaced joints and frames."""
    model = pin.Model(model)
    for place, displacement in changes.items():
        _, placement = place_of(model, place)
        placement = placement * relative(placement, displacement)
        if model.existJointName(place):
            model.jointPlacements[model.getJointId(place)] = placement
        else:
            for frame in frames_of_place(model, place):
                frame.placement = placement
    return model


def take_placements(model: pin.Model, source: pin.Model) -> None:
    """Give a tree the placements of another tree that has the same joints and frames."""
    for j in range(model.njoints):
        model.jointPlacements[j] = source.jointPlacements[j]
    for frame, other in zip(model.frames, source.frames, strict=True):
        frame.placement = other.placement
