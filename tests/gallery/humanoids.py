# SPDX-License-Identifier: BSD-2-Clause
"""A humanoid: 32 degrees of freedom, 48 joint rates, six loops in its legs."""

import numpy as np
import pinocchio as pin

from sst_pin import ClosedChain, robots
from sst_pin.model.closures import Closure

#: Axes of an arm's joints, and the lengths of the links behind them along -z, [m].
_ARM = (("RY", 0.0), ("RX", 0.0), ("RZ", 0.3), ("RY", 0.0), ("RZ", 0.25), ("RY", 0.0), ("RX", 0.0))


def humanoid() -> ClosedChain:
    """Floating pelvis, two hips of two joints, two legs of the gallery, two arms of seven joints.

    All joints of the hips, the motors of the legs and all joints of the arms have motors.
    """
    model, closures, motors = pin.Model(), list[Closure](), list[str]()
    model.name = "humanoid"
    free = pin.JointModelFreeFlyer()
    pelvis = model.addJoint(0, free, pin.SE3.Identity(), "pelvis")
    model.appendBodyToJoint(
        pelvis, pin.Inertia.FromBox(15.0, 0.2, 0.3, 0.5), pin.SE3(np.eye(3), np.array([0, 0, 0.2]))
    )
    for side, sign in (("left", 1.0), ("right", -1.0)):
        body = pelvis
        for kind in ("RZ", "RX"):
            name = f"{side}_hip_{kind[1].lower()}"
            at = pin.SE3(np.eye(3), np.array([0, 0.1 * sign, 0]) if body == pelvis else np.zeros(3))
            body = model.addJoint(body, getattr(pin, f"JointModel{kind}")(), at, name)
            model.appendBodyToJoint(body, pin.Inertia.FromSphere(1.0, 0.05), pin.SE3.Identity())
            motors.append(name)
        _add_leg(model, body, side, closures, motors)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        body, length = pelvis, np.array([0, 0.2 * sign, 0.45])
        for k, (kind, link) in enumerate(_ARM):
            name = f"{side}_arm_{k}"
            at = pin.SE3(np.eye(3), length)
            body = model.addJoint(body, getattr(pin, f"JointModel{kind}")(), at, name)
            inertia = pin.Inertia.FromCylinder(0.8, 0.03, 0.1 + link)
            model.appendBodyToJoint(body, inertia, pin.SE3(np.eye(3), np.array([0, 0, -link / 2])))
            length = np.array([0, 0, -link])
            motors.append(name)
    return ClosedChain(model, closures, motors, coordinates=["pelvis", *motors])


def _add_leg(
    model: pin.Model, hip: int, side: str, closures: list[Closure], motors: list[str]
) -> None:
    """Add the gallery's leg with its loops, each name after its side."""
    leg = robots.leg()
    joint_of = {0: hip}
    for i in range(1, leg.model.njoints):
        parent, name = joint_of[leg.model.parents[i]], f"{side}_{leg.model.names[i]}"
        joint_of[i] = model.addJoint(
            parent, leg.model.joints[i], leg.model.jointPlacements[i], name
        )
        model.appendBodyToJoint(joint_of[i], leg.model.inertias[i], pin.SE3.Identity())
    for frame in leg.model.frames:
        if frame.type == pin.FrameType.OP_FRAME:
            moved = pin.Frame(
                f"{side}_{frame.name}", joint_of[frame.parentJoint], frame.placement, frame.type
            )
            model.addFrame(moved)
    for closure in leg.closures:
        closures.append(
            Closure(f"{side}_{closure.frame_a}", f"{side}_{closure.frame_b}", closure.kind)
        )
    motors += [f"{side}_{name}" for name in leg.motor_names]
