# SPDX-License-Identifier: BSD-2-Clause
"""A boom that a hydraulic cylinder lifts; in line with the boom it has a dead point."""

import numpy as np
import pinocchio as pin

from sst_pin import ClosedChain, Closure

#: Height of the cylinder's foot below the hinge of the boom, [m].
_FOOT = -0.7


def cylinder_boom(angle: float, stroke: tuple[float, float] = (-np.inf, np.inf)) -> ClosedChain:
    """The boom, at home at an angle, with the limits of the cylinder.

    The length of the boom is 1 m. At -pi/2 it points upwards and the cylinder has a dead point.
    """
    model, here = pin.Model(), pin.SE3.Identity()
    model.name = "boom"

    def body(joint: int, mass: float, x: float, about_y: float) -> None:
        inertia = np.diag([about_y / 10, about_y, about_y])
        model.appendBodyToJoint(joint, pin.Inertia(mass, np.array([x, 0, 0]), inertia), here)

    boom = model.addJoint(0, pin.JointModelRY(), here, "boom")
    body(boom, 300.0, 1.2, 150.0)
    foot = pin.SE3(np.eye(3), np.array([0, 0, _FOOT]))
    barrel = model.addJoint(0, pin.JointModelRY(), foot, "barrel")
    body(barrel, 30.0, 0.3, 2.0)
    rod = model.addJoint(barrel, pin.JointModelPX(), here, "stroke")
    body(rod, 20.0, -0.3, 2.0)
    model.lowerPositionLimit[2], model.upperPositionLimit[2] = stroke
    pin_place = pin.SE3(np.eye(3), np.array([1.0, 0, 0]))
    model.addFrame(pin.Frame("pin", boom, 0, pin_place, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("eye", rod, 0, here, pin.FrameType.OP_FRAME))
    reach = np.array([np.cos(angle), 0, -np.sin(angle) - _FOOT])
    barrel_angle = np.arctan2(-reach[2], reach[0])
    home = np.array([angle, barrel_angle, np.linalg.norm(reach)])
    model.referenceConfigurations["home"] = home
    closures = [Closure("pin", "eye", "3d")]
    return ClosedChain(model, closures, ["stroke"], coordinates=["stroke"])
