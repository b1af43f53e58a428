# SPDX-License-Identifier: BSD-2-Clause
"""A robot with a joint for each error of its geometry.

There are three kinds of errors. A place is a joint or a frame.

    "elbow.x"       displaces the place elbow along the x axis of the link that carries it
    "elbow.rz"      turns the place elbow about its own z axis
    "a - b.length"  changes the length of the rod, a `Distance` closure, between the frames a and b

The enlarged robot has a slide or a hinge for each error, which is at zero in the robot as drawn.
With closed loops, the Jacobian of a frame by the rates of these joints has the derivatives of the
frame's pose by the errors.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..arrays import Array, names_matching_any
from ..arrays import names as checked_names
from ..closed_chain import ClosedChain
from ..errors import InputError
from ..model import geometry
from ..model.enlarged_tree import RestingJoint, enlarged, with_extended_rods
from ..model.thresholds import RANK_TOLERANCE
from ..model.tree import frame_id
from ..reading import Urdf
from ..summaries import listed
from .urdf_origins import carriers_of

#: An error opens the loops if, whatever the joints do, the gap per error is larger than this; both
#: are free of units. Rounding leaves far less. A gap below a millionth is lost in noise.
_CLOSED = 1e-6


class EnlargedRobot:
    """A robot as drawn, and the same robot with a joint for each error.

    Attributes:
        chain: The robot with the additional joints. Its coordinates are those of the robot as
            drawn, then the errors that the loops allow independently of each other.
        errors: Names of these errors, in the order of the coordinates.
        columns: Their numbers among the coordinates of `chain`.
    """

    def __init__(self, drawn: ClosedChain, errors: Sequence[str]) -> None:
        # A joint for each error: it displaces one place, or it is a slide in one rod.
        joints = []
        rods_of_joints = dict[str, str]()
        for name in errors:
            for place, displacement in geometry.displacements(drawn.mechanism, {name: 1.0}).items():
                joints.append(RestingJoint(name, place, displacement))
            for rod in geometry.extensions(drawn.closures, {name: 1.0}):
                rods_of_joints[name] = rod
        model = enlarged(drawn.mechanism.model, joints, slides=rods_of_joints)
        closures = with_extended_rods(drawn.closures, rods_of_joints)
        # All errors are given as motors. The robot takes as coordinates as many of them, in their
        # order, as are independent.
        self.chain = ClosedChain(model, closures, [*drawn.coordinates, *errors])
        lost = set(drawn.coordinates) - set(self.chain.coordinates)
        if lost:
            raise InputError("which", f"the errors leave no choice of {listed(sorted(lost))}")
        count = len(drawn.coordinates)
        self.errors = self.chain.coordinates[count:]
        self.columns = np.arange(count, len(self.chain.coordinates))
        self._all_errors = errors
        self._drawn = drawn

    def without_errors(self, q: Array) -> Array:
        """Configurations with all errors at zero, for configurations q of the robot as drawn."""
        result = np.tile(pin.neutral(self.chain.mechanism.model), (len(q), 1))
        places = [self.chain.position_names.index(name) for name in self._drawn.position_names]
        result[:, places] = q
        return result

    def opening_errors(self, q: Array) -> list[str]:
        """The errors that alone open the loops in all configurations q of the enlarged robot.

        Let the joints of the drawn robot close the loops after a single error as far as they can.
        What remains is the gap: the part of the error's column in Phi that is outside the span of
        the columns of these joints. In a singular configuration every error may leave a gap. So the
        least gap of all q is compared with the limit.
        """
        mechanism = self.chain.mechanism
        rates_of_errors = mechanism.space.rates_of(self._all_errors)
        least_gaps = np.full(len(self._all_errors), np.inf)
        for configuration in q:
            Phi = self.chain.Phi(configuration)
            Phi = Phi * mechanism.rate_scale * mechanism.row_scale[:, None]  # free of units
            columns_of_errors = Phi[:, rates_of_errors]
            columns_of_joints = np.delete(Phi, rates_of_errors, axis=1)
            U, s, _ = np.linalg.svd(columns_of_joints, full_matrices=False)
            span = U[:, s > RANK_TOLERANCE * s.max(initial=0.0)]  # an orthonormal basis of it
            outside = columns_of_errors - span @ (span.T @ columns_of_errors)
            gaps = np.linalg.norm(outside, axis=0)
            least_gaps = np.minimum(least_gaps, gaps)
        return [self._all_errors[k] for k in np.flatnonzero(least_gaps > _CLOSED).tolist()]


def error_names(places: Iterable[str]) -> list[str]:
    """Names of the six errors of each place."""
    names = []
    for place in places:
        names += [f"{place}.{axis}" for axis in geometry.AXES]
    return names


def considered_errors(
    drawn: ClosedChain,
    frames: Sequence[str],
    which: Sequence[str] | None,
    urdf: str | Path | None,
    unknown: Container[str],
) -> list[str]:
    """Names of the errors of the robot that are considered: lengths of rods, then displacements.

    Args:
        drawn: The robot as drawn.
        frames: Frames that measurements compare.
        which: Names or patterns of errors; by default all lengths of rods, and all displacements of
            joints and of frames of closures and lines that `urdf` can store. Measured frames are
            left out by default: a displaced frame looks like a displaced body.
        urdf: A URDF that must be able to store the displacements; None for no such condition.
        unknown: The names in `frames` that belong to measuring systems, not to the robot.
    """
    mechanism = drawn.mechanism
    for frame in frames:
        frame_id(mechanism.model, frame)  # raises an error for an unknown frame
    measured = [frame for frame in frames if frame != "universe" and frame not in unknown]
    joints_and_closures = geometry.places_of(mechanism)
    places = list(dict.fromkeys([*joints_and_closures, *measured]))
    lengths = geometry.length_names(mechanism.closures)
    storable = set(places)
    if urdf is not None:
        storable = set(carriers_of(Urdf.read(urdf).root, mechanism.model))

    if which is None:
        patterns = list(lengths)
        for place in joints_and_closures:
            if place in storable and place not in measured:
                patterns.append(f"{place}.*")
    else:
        patterns = list(checked_names("which", which))
    all_names = [*lengths, *error_names(places)]
    considered = names_matching_any("error of the geometry", patterns, all_names)
    not_storable = []
    for name in considered:
        if name not in lengths and name.rpartition(".")[0] not in storable:
            not_storable.append(name)
    if not_storable:
        problem = f"{urdf} cannot store {listed(not_storable)}: no joint of it is there"
        raise InputError("which", f"{problem}; leave them out")
    return considered
