# SPDX-License-Identifier: BSD-2-Clause
"""What a tree must look like to be an SST."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from ..chain.mechanism import read_only
from ..chain.tree import frame_named
from ..description import JOINT_NAMES
from ..errors import DescriptionError
from .kinematics import Geometry

#: Pairs of frames that the shipped cuts close.
CUTS = {("closedloop1_A", "closedloop1_B"), ("closedloop2_A", "closedloop2_B")}
#: Frames of the cuts and the arc of the star that each is fixed to.
_STAR_OF = {"closedloop1_A": 1, "closedloop2_A": 1, "closedloop1_B": 2, "closedloop2_B": 3}
#: [m] and [rad]; what a person writes with ten digits is exact.
EXACT = 1e-9


def geometry_of(model: pin.Model, source: str) -> Geometry:
    """Read {0k} and {E} in {3k} off a tree, or list all that keeps it from being an SST's."""
    # Joints first, then their axes and frames: the one makes no sense without the other.
    problems = list(_joint_problems(model)) or [*_axis_problems(model), *_frame_problems(model)]
    if problems:
        raise DescriptionError(source, problems)
    R_0 = [model.jointPlacements[model.getJointId(f"gamma_{k}")].rotation for k in (1, 2, 3)]
    ends = ("closedloop1_A", "closedloop1_B", "closedloop2_B")
    R_E = [frame_named(model, name).placement.rotation for name in ends]
    return Geometry(read_only(np.array(R_0)), read_only(np.array(R_E)))


def _joint_problems(model: pin.Model) -> Iterator[str]:
    names = list(model.names)[1:]
    if tuple(names) == JOINT_NAMES:
        return
    missing = [name for name in JOINT_NAMES if name not in names]
    for name in missing:
        yield f"joint {name} is missing"
    for name in names:
        if name not in JOINT_NAMES:
            yield f"joint {name}: an SST has no such joint"
    if missing or len(names) != len(JOINT_NAMES):
        yield "an SST has nine joints gamma_k, mu_k, beta_k"
    else:
        yield f"joints {', '.join(names)}; their order must be gamma_k, mu_k, beta_k of each leg"


def _axis_problems(model: pin.Model) -> Iterator[str]:
    for index, name in enumerate(JOINT_NAMES, start=1):
        joint = name.split("_")[0]
        placement, kind = model.jointPlacements[index], model.joints[index].shortname()
        wanted = "JointModelRX" if joint == "mu" else "JointModelRZ"
        parent = 0 if joint == "gamma" else index - 1
        if kind != wanted:
            yield f"joint {name}: type {kind}, expected {wanted}"
        if model.parents[index] != parent:
            expected, found = model.names[parent], model.names[model.parents[index]]
            yield f"joint {name}: its parent is {found}, expected {expected}"
        if np.abs(placement.translation).max() > EXACT:
            yield f"joint {name}: not in the centre O; origin xyz must be 0 0 0"
        if joint != "gamma" and np.abs(placement.rotation - np.eye(3)).max() > EXACT:
            yield f"joint {name}: origin rpy must be 0 0 0"


def _frame_problems(model: pin.Model) -> Iterator[str]:
    missing = [name for name in _STAR_OF if not model.existFrame(name)]
    for name in missing:
        yield f"frame {name} of the cuts is missing"
    for name, k in _STAR_OF.items():
        if name in missing:
            continue
        frame = frame_named(model, name)
        fixed_to_star = frame.parentJoint == model.getJointId(f"beta_{k}")
        if not fixed_to_star or np.abs(frame.placement.translation).max() > EXACT:
            yield f"frame {name}: must be fixed to star_{k} with origin xyz 0 0 0"
    if not missing:
        first, second = (frame_named(model, f"closedloop{loop}_A").placement for loop in (1, 2))
        if not first.actInv(second).isIdentity(EXACT):
            yield "frame closedloop2_A: must coincide with closedloop1_A"
