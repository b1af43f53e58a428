# SPDX-License-Identifier: BSD-2-Clause
"""Small mechanisms that slide, roll, bounce and lean, for laws that can be written by hand."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

import sst_pin
from sst_pin import Contact

G = 9.81
#: Coordinates of `planar`.
PLANAR = ["x", "z", "turn"]


def tree(*joints: tuple[str, pin.JointModel, float, float], gravity: bool = True) -> pin.Model:
    """A chain of joints at one place, each with a mass and a moment of inertia."""
    model, parent = pin.Model(), 0
    model.gravity.linear = np.array([0, 0, -G * gravity])
    for name, joint, mass, inertia in joints:
        parent = model.addJoint(parent, joint, pin.SE3.Identity(), name)
        body = pin.Inertia(mass, np.zeros(3), inertia * np.eye(3))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    return model


def frame(model: pin.Model, name: str, joint: str, p: Sequence[float], R: object = None) -> None:
    """Add a frame to the body of a joint; "universe" is the world."""
    parent = 0 if joint == "universe" else model.getJointId(joint)
    rotation = np.eye(3) if R is None else np.asarray(R)
    place = pin.SE3(rotation, np.array(p, dtype=float))
    model.addFrame(pin.Frame(name, parent, place, pin.FrameType.OP_FRAME))


def planar(mass: float, inertia: float, *, gravity: bool = True) -> pin.Model:
    """A body that moves in the plane x, z and turns about y."""
    slides = ("x", pin.JointModelPX(), 0.0, 0.0), ("z", pin.JointModelPZ(), 0.0, 0.0)
    return tree(*slides, ("turn", pin.JointModelRY(), mass, inertia), gravity=gravity)


def block_on_slope(angle: float, friction: float) -> tuple[sst_pin.ClosedChain, np.ndarray]:
    """A free block on four corners, at rest on a slope that falls along x, and its start."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "block")
    size = np.array([0.2, 0.3, 0.1])
    body = pin.Inertia.FromBox(2.0, *size)
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    R = pin.utils.rotate("y", angle)
    frame(model, "slope", "universe", (0, 0, 0), R)
    corners = []
    for x in (-0.1, 0.1):
        for y in (-0.15, 0.15):
            corners.append(f"corner_{len(corners)}")
            frame(model, corners[-1], "block", (x, y, -0.05))
    contacts = [Contact(name, friction=friction, ground="slope") for name in corners]
    place = pin.SE3(R, R @ [0, 0, 0.05])
    return sst_pin.ClosedChain(model, [], [], contacts=contacts), pin.SE3ToXYZQUAT(place)


def ladder(length: float, friction: float) -> sst_pin.ClosedChain:
    """A ladder on a floor with friction, against a smooth wall at x = 0."""
    model = planar(1.0, length**2 / 12)
    for name, side in (("foot", -0.5), ("top", 0.5)):
        frame(model, name, "turn", (side * length, 0, 0))
    frame(model, "wall", "universe", (0, 0, 0), pin.utils.rotate("y", -np.pi / 2))  # z is -x
    contacts = [Contact("foot", friction=friction), Contact("top", ground="wall")]
    return sst_pin.ClosedChain(model, [], [], coordinates=PLANAR, contacts=contacts)


def flat_bar(*, touches: bool) -> sst_pin.ClosedChain:
    """A four-bar in a tilted plane, and a point of its coupler on a wall parallel to this plane."""
    bar = sst_pin.robots.four_bar()
    tilt = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.7, -0.4), np.zeros(3))
    model = pin.Model()
    base = model.addFrame(pin.Frame("base", 0, tilt, pin.FrameType.OP_FRAME))
    model = pin.appendModel(model, bar.model, base, pin.SE3.Identity())
    model.referenceConfigurations["home"] = bar.home
    frame(model, "tip", "coupler", (0.1, 0.02, 0.03))
    data = model.createData()
    pin.framesForwardKinematics(model, data, bar.home)
    axis = pin.SE3(pin.utils.rotate("x", -np.pi / 2), np.zeros(3))  # its z is y, that of the bar
    at_tip = pin.SE3(tilt.rotation, data.oMf[model.getFrameId("tip")].translation) * axis
    model.addFrame(pin.Frame("wall", 0, at_tip, pin.FrameType.OP_FRAME))
    contacts = [Contact("tip", friction=0.5, ground="wall")] if touches else []
    return sst_pin.ClosedChain(model, bar.closures, ["crank"], contacts=contacts)
