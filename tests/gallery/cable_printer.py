# SPDX-License-Identifier: BSD-2-Clause
"""A printer on four cables, whose tensions are published."""

from dataclasses import replace

import numpy as np
import pinocchio as pin

from sst_pin import ClosedChain, LineForce

#: Anchors of the cables, [m]. The load has 2 kg.
ANCHORS = {"A": (0, -2, -0.1), "B": (2, 1, -0.1), "C": (-2, 1, -0.1), "D": (0, 0, 3)}


def cable_printer(
    stiffness: np.ndarray | None = None, lengths: np.ndarray | None = None
) -> ClosedChain:
    """The load on its cables; with stiffnesses [N/m] and lengths without tension, on springs."""
    model, load = pin.Model(), 0
    slides = {"x": pin.JointModelPX(), "y": pin.JointModelPY(), "z": pin.JointModelPZ()}
    for name, joint in slides.items():
        load = model.addJoint(load, joint, pin.SE3.Identity(), name)
    body = pin.Inertia(2.0, np.zeros(3), 0.01 * np.eye(3))
    model.appendBodyToJoint(load, body, pin.SE3.Identity())
    model.addFrame(pin.Frame("load", load, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    lines = []
    for name, place in ANCHORS.items():
        at = pin.SE3(np.eye(3), np.array(place, dtype=float))
        model.addFrame(pin.Frame(name, 0, at, pin.FrameType.OP_FRAME))
        lines.append(LineForce(name, "load", name=f"cable_{name}"))
    model.referenceConfigurations["home"] = np.zeros(3)
    if stiffness is not None and lengths is not None:
        numbers = zip(lines, stiffness, lengths, strict=True)
        lines = [replace(x, stiffness=k, rest_length=length) for x, k, length in numbers]
    return ClosedChain(model, [], [{x.name[-1]: {x.name: -1.0}} for x in lines], lines=lines)
