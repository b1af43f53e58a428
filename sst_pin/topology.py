# SPDX-License-Identifier: BSD-2-Clause
"""What a tree must look like to be an SST."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .description import JOINT_NAMES
from .errors import DescriptionError
from .kinematics import Geometry


def geometry_of(model: pin.Model, source: str) -> Geometry:
    """Read {0k} and {E} in {3k} off a tree, and tell what keeps it from being an SST's.

    Raises:
        DescriptionError: With every problem found.
    """
    names = list(model.names)[1:]
    if sorted(names) != sorted(JOINT_NAMES):
        missing = [n for n in JOINT_NAMES if n not in names]
        extra = [n for n in names if n not in JOINT_NAMES]
        found = [f"joint {n} is missing" for n in missing]
        found += [f"joint {n} is not an SST's" for n in extra]
        raise DescriptionError(source, [*found, "an SST has nine joints gamma_k, mu_k, beta_k"])
    problems: list[str] = []
    R_0, R_E = [], []
    for k in (1, 2, 3):
        parent = 0
        for joint, axis in (("gamma", "RZ"), ("mu", "RX"), ("beta", "RZ")):
            name = f"{joint}_{k}"
            index = model.getJointId(name)
            placement = model.jointPlacements[index]
            kind = model.joints[index].shortname()
            if kind != f"JointModel{axis}":
                problems.append(f"joint {name}: {kind}, an SST has a JointModel{axis} there")
            if model.parents[index] != parent:
                problems.append(f"joint {name}: hangs on {model.names[model.parents[index]]}")
            if np.abs(placement.translation).max() > 1e-9:
                problems.append(f"joint {name}: off the centre O, origin xyz must be 0 0 0")
            if joint != "gamma" and np.abs(placement.rotation - np.eye(3)).max() > 1e-9:
                problems.append(f"joint {name}: origin rpy must be 0 0 0")
            parent = index
        R_0.append(model.jointPlacements[model.getJointId(f"gamma_{k}")].rotation)
        frame = "closedloop1_A" if k == 1 else f"closedloop{k - 1}_B"
        if not model.existFrame(frame):
            problems.append(f"frame {frame} of the cuts is missing")
            continue
        f = model.frames[model.getFrameId(frame)]
        if f.parentJoint != parent or np.abs(f.placement.translation).max() > 1e-9:
            problems.append(f"frame {frame}: must be fixed to star_{k} with origin xyz 0 0 0")
        R_E.append(f.placement.rotation)
    if problems:
        raise DescriptionError(source, problems)
    return Geometry(np.array(R_0), np.array(R_E))
