# SPDX-License-Identifier: BSD-2-Clause
"""Measuring systems whose base or target is at an unknown place: frames that are added to a robot.

The base of a measuring system is fixed in the base of the robot, its target on the frame that is
measured. Where one of them is unknown, a frame stands for it at a first guess, and its six errors
are estimated together with those of the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import InputError
from ..model import geometry
from ..model.tree import frame_id
from .geometry_measurements import Measurement, unknown_frames


class RobotWithSystems(NamedTuple):
    """A robot with a frame for each unknown base and target of its measuring systems."""

    chain: ClosedChain
    #: For each of these frames, by name, the frame that carries it: "universe" carries a base.
    carriers: dict[str, str]

    def placements(self, errors: geometry.Displacements) -> dict[str, Array]:
        """Homogeneous matrices of the unknown frames on their carriers, after displacements."""
        model = geometry.displaced(self.chain.mechanism.model, errors)
        matrices = dict[str, Array]()
        for name, carrier in self.carriers.items():
            _, placement = geometry.place_of(model, name)
            if carrier != "universe":
                _, placement_of_carrier = geometry.place_of(model, carrier)
                placement = placement_of_carrier.actInv(placement)
            matrices[name] = placement.homogeneous
        return matrices


def with_systems(
    chain: ClosedChain, measurements: Sequence[Measurement], q: Sequence[Array]
) -> RobotWithSystems:
    """The robot with a frame for each unknown base and target.

    Args:
        chain: The robot as drawn.
        measurements: All measurements. Those with one name share their unknown frames.
        q: Configurations of each measurement, for the first guess of its base.
    """
    model = pin.Model(chain.mechanism.model)
    carriers = dict[str, str]()
    for measurement, configurations in zip(measurements, q, strict=True):
        for name in unknown_frames(measurement):
            is_base = name == measurement.reference
            carrier = "universe" if is_base else measurement.frame
            if carriers.setdefault(name, carrier) != carrier:
                problem = f"{name} is on {carriers[name]} and on {carrier}; give name="
                raise InputError("measurements", problem)
            if model.existFrame(name):  # of a measurement with the same name
                continue
            if is_base:
                joint = 0
                poses = chain.engine.loops.placements(configurations, measurement.frame)
                placement = measurement.guess_of_base(poses)
            else:
                frame = model.frames[frame_id(model, measurement.frame)]
                joint = frame.parentJoint
                placement = frame.placement
            model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.OP_FRAME))
    if carriers:
        chain = chain.with_model(model)
    return RobotWithSystems(chain, carriers)
