# SPDX-License-Identifier: BSD-2-Clause
"""A planar robot whose joints have axes that are oblique to its plane."""

import numpy as np
import pinocchio as pin

import sst_pin


def with_oblique_axes(chain, seed):
    """The same planar robot, with axes of its joints and closures that point anywhere."""
    random = np.random.default_rng(seed)
    old, new = chain.model, pin.Model()
    turns = [pin.SE3.Identity()]
    for j in range(1, old.njoints):
        quaternion = random.normal(size=4)
        quaternion /= np.linalg.norm(quaternion)
        turns.append(pin.SE3(pin.Quaternion(*quaternion).matrix(), np.zeros(3)))
        parent, turn = old.parents[j], turns[j]
        axis = turn.rotation.T @ [0, 0, 1]  # all hinges turn about z
        place = turns[parent].inverse() * old.jointPlacements[j] * turn
        new.addJoint(parent, pin.JointModelRevoluteUnaligned(axis), place, old.names[j])
        new.appendBodyToJoint(j, turn.actInv(old.inertias[j]), pin.SE3.Identity())
    for k, name in enumerate(["coupler_pin", "rocker_pin"]):
        frame = old.frames[old.getFrameId(name)]
        place = turns[frame.parentJoint].inverse() * frame.placement * turns[1 + k]
        new.addFrame(pin.Frame(name, frame.parentJoint, place, pin.FrameType.OP_FRAME))
    return sst_pin.ClosedChain(new, chain.closures, ["crank"])
