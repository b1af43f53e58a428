# SPDX-License-Identifier: BSD-2-Clause
"""Robots of the gallery on feet: spheres below their soles that touch the floor."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

import sst_pin
from sst_pin import Contact

#: Radius of the spheres, and corners of a sole in its ankle's frame, [m].
RADIUS = 0.01
_CORNERS = ((0.15, 0.04), (0.15, -0.04), (-0.06, 0.04), (-0.06, -0.04))


def _add(
    model: pin.Model, parent: int, joint: pin.JointModel, name: str, p: Sequence[float]
) -> int:
    return model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array(p, dtype=float)), name)


def _load(model: pin.Model, joint: int, mass: float, random: np.random.Generator) -> None:
    lever, moments = random.uniform(-0.05, 0.05, 3), mass * random.uniform(0.004, 0.006, 3)
    body = pin.Inertia(mass, lever, np.diag(moments))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())


def biped(*, friction: float = 0.8, contacts: bool = True) -> sst_pin.ClosedChain:
    """A free pelvis on two legs of the gallery: 18 degrees of freedom, 6 loops, 8 points.

    Each leg has hips of two joints, and rods for its knee and ankle. `home` is 10 mm above the
    floor.
    """
    random, base, leg = np.random.default_rng(5), pin.Model(), sst_pin.robots.leg()
    root = _add(base, 0, pin.JointModelFreeFlyer(), "pelvis", (0, 0, 0))
    _load(base, root, 10.0, random)
    closures: list[sst_pin.Closure] = []
    motors, feet = [], []
    for side, y in (("l", 0.1), ("r", -0.1)):
        roll = _add(base, root, pin.JointModelRX(), f"{side}_roll", (0, y, -0.05))
        _load(base, roll, 1.5, random)
        yaw = _add(base, roll, pin.JointModelRZ(), f"{side}_yaw", (0, 0, -0.05))
        _load(base, yaw, 1.5, random)
        hip = pin.Frame(f"{side}_hip_frame", yaw, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
        part = pin.Model(leg.mechanism.model)
        for j in range(1, part.njoints):
            part.names[j] = f"{side}_{part.names[j]}"
        for frame in part.frames:
            if frame.name != "universe":
                frame.name = f"{side}_{frame.name}"
        base = pin.appendModel(base, part, base.addFrame(hip), pin.SE3.Identity())
        for closure in leg.closures:
            ends = {x: f"{side}_{getattr(closure, x)}" for x in ("frame_a", "frame_b")}
            closures.append(replace(closure, **ends))
        motors += [f"{side}_roll", f"{side}_yaw", *(f"{side}_{x}" for x in leg.motor_names)]
        foot = base.getJointId(f"{side}_ankle_roll")
        for k, corner in enumerate(_CORNERS):
            feet.append(f"{side}_sole_{k}")
            place = pin.SE3(np.eye(3), np.array([*corner, RADIUS - 0.05]))
            base.addFrame(pin.Frame(feet[-1], foot, place, pin.FrameType.OP_FRAME))
    q, tree = pin.neutral(base), leg.mechanism.model
    for side in "lr":
        for name in list(tree.names)[1:]:
            a = tree.joints[tree.getJointId(name)]
            b = base.joints[base.getJointId(f"{side}_{name}")]
            q[b.idx_q : b.idx_q + b.nq] = leg.home[a.idx_q : a.idx_q + a.nq]
    q[2] -= lowest(base, q, feet) - 0.01
    base.referenceConfigurations["home"] = q
    points = [Contact(foot, radius=RADIUS, friction=friction) for foot in feet]
    return sst_pin.ClosedChain(base, closures, motors, contacts=points if contacts else ())


def lowest(model: pin.Model, q: np.ndarray, feet: Sequence[str]) -> float:
    """Height of the lowest sphere."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return min(data.oMf[model.getFrameId(foot)].translation[2] for foot in feet) - RADIUS
