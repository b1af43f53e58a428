# SPDX-License-Identifier: BSD-2-Clause
"""A tree with the same motions for which every function of Pinocchio is right.

Some functions of Pinocchio fail or give wrong results without an error for trees whose joints were
not added depth-first, for joints whose axes move in the joint (universal joints, Euler angles,
composites) and for mimic joints. The normal tree has depth-first order. Joints in series replace a
joint with moving axes, and an ordinary joint replaces a mimic joint.
"""

from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags


class NormalTree:
    """The normal tree of a model; frames keep their indices.

    Attributes:
        model: The normal tree.
        bodies: For each joint of the original model the joint that carries its body, 0 first.
        entries, factors, offsets: Its configuration from that of the model; see `configurations`.
        S: Rates of the normal tree are S v, shape (rates of the normal tree, nv).
    """

    def __init__(self, original: pin.Model) -> None:
        self.model = pin.Model()
        self.bodies = [0] * original.njoints
        self.model.name = original.name
        self.model.gravity = original.gravity
        # For each entry of q of the normal tree: the entry of the original q, factor and offset.
        q: list[tuple[int, float, float]] = []
        # For each rate of the normal tree: the original rate, factor, and the share of its rotor.
        v: list[tuple[int, float, float]] = []
        stack = list(original.children[0])[::-1]  # depth-first, the first child first
        while stack:
            j = stack.pop()
            joint = original.joints[j]
            factor = 1.0
            offset = 0.0
            rotors = 1.0
            if not joint.nv:  # a mimic joint; the joint that it follows has the rotors of both
                mimic = joint.extract()
                factor = mimic.scaling
                offset = mimic.offset
                rotors = 0.0
            self._add(original, j)
            q += [(joint.idx_q + k, factor, offset) for k in range(joint.nq or 1)]
            v += [(joint.idx_v + k, factor, rotors) for k in range(joint.nv or 1)]
            stack += list(original.children[j])[::-1]
        for frame in map(pin.Frame, list(original.frames)[1:]):
            frame.parentJoint = self.bodies[frame.parentJoint]
            self.model.addFrame(frame, False)
        entries, self.factors, self.offsets = np.array(q).reshape(-1, 3).T.copy()
        rates, factors, rotors_of = np.array(v).reshape(-1, 3).T
        self.entries = entries.astype(np.intp)
        rates = rates.astype(np.intp)
        self.S = factors[:, None] * np.eye(original.nv)[rates]
        self.model.armature = original.armature[rates] * rotors_of

    def configurations(self, q: Array) -> Array:
        """Configurations of the normal tree for those of the model, shapes (..., entries).

        Each entry is linear in one entry of q: factors * q[entries] + offsets. Factors and offsets
        of mimic joints differ from 1 and 0.
        """
        return np.asarray(self.factors * q.take(self.entries, axis=-1) + self.offsets)

    @cached_property
    def supports(self) -> Flags:
        """Which rates of the normal tree move the body of each joint, shape (joints, rates)."""
        moves = np.zeros((self.model.njoints, self.model.nv), dtype=bool)
        for joint in list(self.model.joints)[1:]:
            bodies = list(self.model.subtrees[joint.id])
            moves[bodies, joint.idx_v : joint.idx_v + joint.nv] = True
        return moves

    @cached_property
    def before(self) -> Flags:
        """Entry (i, k): whether rate i moves the parent of rate k's joint, (rates, rates)."""
        parent_of_rate = np.zeros(self.model.nv, dtype=np.intp)
        for joint in list(self.model.joints)[1:]:
            parent_of_rate[joint.idx_v : joint.idx_v + joint.nv] = self.model.parents[joint.id]
        return np.asarray(self.supports[parent_of_rate].T)

    def _add(self, original: pin.Model, j: int) -> None:
        """Add joint j and its body."""
        joint = original.joints[j]
        parent = self.bodies[original.parents[j]]
        if joint.nv:
            series = series_of(joint)
        else:
            series = [(_ordinary(joint), pin.SE3.Identity())]
        placement = original.jointPlacements[j]
        for number, (part, offset) in enumerate(series):
            name = f"{original.names[j]}/{number}" if len(series) > 1 else original.names[j]
            parent = self.model.addJoint(parent, part, placement * offset, name)
            placement = pin.SE3.Identity()
        self.bodies[j] = parent
        self.model.inertias[parent] = original.inertias[j]


def series_of(joint: Any) -> list[tuple[Any, pin.SE3]]:
    """The joints of one axis, or of fixed axes, that a joint consists of, with placements."""
    short = joint.shortname()
    here = pin.SE3.Identity()
    if short == "JointModelSphericalZYX":
        axes = (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)
        return [(axis(), here) for axis in axes]
    if short not in ("JointModelUniversal", "JointModelComposite"):
        return [(joint, here)]
    joint = joint.extract() if hasattr(joint, "extract") else joint
    if short == "JointModelUniversal":
        both = (joint.axis1, joint.axis2)
        return [(pin.JointModelRevoluteUnaligned(np.array(axis)), here) for axis in both]
    series: list[tuple[Any, pin.SE3]] = []
    for part, placement in zip(joint.joints, joint.jointPlacements, strict=True):
        # The placement is that of the first joint of the part.
        before = placement
        for single, single_placement in series_of(part):
            series.append((single, before * single_placement))
            before = here
    return series


def _ordinary(joint: Any) -> Any:
    """The ordinary joint that a mimic joint is made of, by its unit twist; Pinocchio hides it."""
    data = joint.createData()
    joint.calc(data, np.zeros(joint.idx_q + 1))
    linear, angular = np.split(np.ravel(np.array(data.S)) / joint.extract().scaling, 2)
    if not angular.any():
        return pin.JointModelPrismaticUnaligned(linear)
    return pin.JointModelRevoluteUnaligned(angular)
