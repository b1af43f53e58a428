# SPDX-License-Identifier: BSD-2-Clause
"""A robot in plain numbers, which any engine can read: joints, bodies, closures, motors.

Lengths are rounded to 15 decimals and angles, in degrees, to 12: what follows is exact.
"""

import numpy as np
import pinocchio as pin

KINDS = {"Revolute": "revolute", "R": "revolute", "Prismatic": "prismatic", "P": "prismatic"}
KINDS |= {"Universal": "universal", "Spherical": "spherical", "FreeFlyer": "free-flyer"}


def describe(chain) -> dict:
    """The description of a `ClosedChain` whose joints have no friction, springs and rotors."""
    model = chain.model
    assert not np.any([model.armature, model.damping, model.friction])
    joints = [_joint(model, i) for i in range(1, model.njoints)]
    numbers = ("stiffness", "rest_length", "damping", "preload")
    closures = [{"kind": c.kind, **_ends(model, c)} for c in chain.closures]
    forces = [_ends(model, f) | {x: getattr(f, x) for x in numbers} for f in chain.lines]
    return {
        "gravity": _numbers(model.gravity.linear),
        "joints": joints,
        "closures": closures,
        "forces": forces,
        "coordinates": list(chain.coordinates),
        "motors": list(chain.motor_names),
        "platform": _frame(model, "platform" if model.existFrame("platform") else "E"),
    }


def _joint(model, i) -> dict:
    joint = model.joints[i]
    body = model.inertias[i]
    short = joint.shortname().removeprefix("JointModel")
    kind = KINDS[short.removesuffix("Unaligned").rstrip("XYZ") or short]
    record = {"name": model.names[i], "type": kind}
    if kind in ("revolute", "prismatic", "universal"):
        S = pin.computeJointJacobian(model, model.createData(), pin.neutral(model), i)
        part = slice(0, 3) if kind == "prismatic" else slice(3, 6)
        axes = S[part, joint.idx_v : joint.idx_v + joint.nv].T
        record["axes"] = [_numbers(axis) for axis in axes]
    record["parent"] = "base" if model.parents[i] == 0 else model.names[model.parents[i]]
    record["placement"] = _placement(model.jointPlacements[i])
    record["mass"] = _number(body.mass)
    record["mass_centre"] = _numbers(body.lever)
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia
    record["inertia"] = _numbers([xx, yy, zz, xy, xz, yz])
    return record


def _ends(model, pair) -> dict:
    return {end: _frame(model, getattr(pair, end)) for end in ("frame_a", "frame_b")}


def _frame(model, name) -> dict:
    frame = model.frames[model.getFrameId(name)]
    joint = "base" if frame.parentJoint == 0 else model.names[frame.parentJoint]
    return {"joint": joint, "placement": _placement(frame.placement)}


def _placement(at) -> dict:
    rpy = np.degrees(pin.rpy.matrixToRpy(at.rotation))
    return {"xyz": _numbers(at.translation), "rpy_degrees": [_number(a, 12) for a in rpy]}


def _numbers(values) -> list[float]:
    return [_number(value) for value in values]


def _number(value, decimals=15) -> float:
    return round(float(value), decimals) + 0.0  # no minus zero
