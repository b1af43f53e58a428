# SPDX-License-Identifier: BSD-2-Clause
"""Models put together part by part."""

import numpy as np
import pinocchio as pin


def at(*p: float, turned: np.ndarray | None = None) -> pin.SE3:
    """A place x, y, z, of which the last may be left out."""
    return pin.SE3(np.eye(3) if turned is None else turned, np.array([*p, 0.0, 0.0, 0.0][:3]))


def add(
    model: pin.Model,
    parent: int,
    joint: pin.JointModel,
    name: str,
    place: pin.SE3,
    body: pin.Inertia,
) -> int:
    """The number of a new joint with its body."""
    index = model.addJoint(parent, joint, place, name)
    model.appendBodyToJoint(index, body, pin.SE3.Identity())
    return index


def mark(model: pin.Model, joint: int, name: str, place: pin.SE3) -> None:
    """A new frame on a joint."""
    model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))


def in_units(model: pin.Model, unit: float) -> pin.Model:
    """The model with lengths in metres over a unit, the mass in kilograms."""
    model = pin.Model(model)
    for k in range(1, model.njoints):
        place, body = model.jointPlacements[k], model.inertias[k]
        model.jointPlacements[k] = pin.SE3(place.rotation, unit * place.translation)
        model.inertias[k] = pin.Inertia(body.mass, unit * body.lever, unit**2 * body.inertia)
    for frame in model.frames:
        frame.placement = pin.SE3(frame.placement.rotation, unit * frame.placement.translation)
    model.gravity.linear = unit * model.gravity.linear
    return model


def wrenches_of(chain, q, force, moment=(0, 0, 0), name="platform"):
    """Wrenches [force; moment] on all bodies of a force and a moment on the frame."""
    model, data = chain.model, chain.model.createData()
    pin.framesForwardKinematics(model, data, q)
    frame = model.frames[model.getFrameId(name)]
    body = frame.parentJoint
    center = data.oMi[body].act(model.inertias[body].lever)
    arm = data.oMf[model.getFrameId(name)].translation - center
    wrenches = np.zeros((model.njoints - 1, 6))
    wrenches[body - 1] = np.concatenate([force, moment + np.cross(arm, force)])
    return wrenches
