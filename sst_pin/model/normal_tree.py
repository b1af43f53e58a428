# SPDX-License-Identifier: BSD-2-Clause
"""A tree with the same motions for which every function of Pinocchio is right.

Some functions of Pinocchio fail or give wrong results without an error for trees whose joints were
not added depth-first, for joints whose axes move in the joint (universal joints, Euler angles,
composites) and for mimic joints. The normal tree has depth-first order. Joints in series replace a
joint with moving axes, and an ordinary joint replaces a mimic joint.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags


class _Position(NamedTuple):
    """An entry of q of the normal tree: factor * q[entry] + offset, with the original q."""

    entry: int
    factor: float
    offset: float


class _Rate(NamedTuple):
    """A rate of the normal tree: factor * v[entry], with the original v.

    Attributes:
        entry: Index in the original v.
        factor: 1, or the factor of a mimic joint.
        rotors: Part of the armature of the original rate that this rate gets, 1 or 0.
    """

    entry: int
    factor: float
    rotors: float


class NormalTree:
    """The normal tree of a model; frames keep their indices.

    Attributes:
        model: The normal tree.
        bodies: For each joint of the original model, 0 (the base) first, the joint of the normal
            tree that carries its body.
        entries: For each entry of its q the index in the original q.
        factors: Factor of each entry, 1 except for mimic joints.
        offsets: Offset of each entry, 0 except for mimic joints.
        S: Rates of the normal tree are S v, shape (rates of the normal tree, nv).
    """

    def __init__(self, original: pin.Model) -> None:
        self.model = pin.Model()
        self.bodies = [0] * original.njoints
        self.model.name = original.name
        self.model.gravity = original.gravity
        positions: list[_Position] = []
        rates: list[_Rate] = []
        stack = list(original.children[0])[::-1]  # depth-first, the first child first
        while stack:
            j = stack.pop()
            joint = original.joints[j]
            factor = 1.0
            offset = 0.0
            rotors = 1.0
            if not joint.nv:
                # A mimic joint. The armature of the joint that it follows counts for both rotors.
                mimic = joint.extract()
                factor = mimic.scaling
                offset = mimic.offset
                rotors = 0.0
            self._add(original, j)
            # A mimic joint has nq = nv = 0; its indices are those of the joint that it follows.
            for k in range(joint.nq or 1):
                positions.append(_Position(joint.idx_q + k, factor, offset))
            for k in range(joint.nv or 1):
                rates.append(_Rate(joint.idx_v + k, factor, rotors))
            stack += list(original.children[j])[::-1]
        for frame in map(pin.Frame, list(original.frames)[1:]):
            frame.parentJoint = self.bodies[frame.parentJoint]
            self.model.addFrame(frame, False)
        self.entries = np.array([position.entry for position in positions], dtype=np.intp)
        self.factors = np.array([position.factor for position in positions], dtype=float)
        self.offsets = np.array([position.offset for position in positions], dtype=float)
        self.S = np.zeros((len(rates), original.nv))
        for k, rate in enumerate(rates):
            self.S[k, rate.entry] = rate.factor
            self.model.armature[k] = original.armature[rate.entry] * rate.rotors

    def configurations(self, q: Array) -> Array:
        """Configurations of the normal tree for configurations q of the model, shape (..., nq).

        The result has shape (..., entries).
        """
        return np.asarray(self.factors * q.take(self.entries, axis=-1) + self.offsets)

    @cached_property
    def supports(self) -> Flags:
        """Entry (i, k): whether rate k moves the body of joint i, shape (joints, rates).

        Joints and rates are those of the normal tree.
        """
        moves = np.zeros((self.model.njoints, self.model.nv), dtype=bool)
        for joint in list(self.model.joints)[1:]:
            bodies = list(self.model.subtrees[joint.id])
            moves[bodies, joint.idx_v : joint.idx_v + joint.nv] = True
        return moves

    @cached_property
    def before(self) -> Flags:
        """Entry (i, k): whether rate i moves the body before rate k, shape (rates, rates)."""
        parent_of_rate = np.zeros(self.model.nv, dtype=np.intp)
        for joint in list(self.model.joints)[1:]:
            parent_of_rate[joint.idx_v : joint.idx_v + joint.nv] = self.model.parents[joint.id]
        return np.asarray(self.supports[parent_of_rate].T)

    def _add(self, original: pin.Model, j: int) -> None:
        """Add joint j of the original, or joints in series for it, and its body."""
        joint = original.joints[j]
        parent = self.bodies[original.parents[j]]
        if joint.nv:
            series = series_of(joint)
        else:
            series = [(_ordinary(joint), pin.SE3.Identity())]
        placement = original.jointPlacements[j]
        for number, (part, placement_in_series) in enumerate(series):
            name = f"{original.names[j]}/{number}" if len(series) > 1 else original.names[j]
            placement = placement * placement_in_series
            parent = self.model.addJoint(parent, part, placement, name)
            placement = pin.SE3.Identity()
        self.bodies[j] = parent
        self.model.inertias[parent] = original.inertias[j]


def series_of(joint: Any) -> list[tuple[Any, pin.SE3]]:
    """Joints in series that move as a joint does, and whose axes do not move in the joint.

    Each has a placement relative to the joint before it in the series.
    """
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
        # A part may be a series itself. `placement` is the placement of its first joint.
        (first, first_placement), *others = series_of(part)
        series += [(first, placement * first_placement), *others]
    return series


def _ordinary(joint: Any) -> Any:
    """The ordinary joint with the kind and the axis of a mimic joint.

    Pinocchio gives no access to it. But the twist S of a mimic joint per rate of the joint that it
    follows is the axis times the factor of the mimic joint.
    """
    data = joint.createData()
    joint.calc(data, np.zeros(joint.idx_q + 1))
    linear, angular = np.split(np.ravel(np.array(data.S)) / joint.extract().scaling, 2)
    if not angular.any():
        return pin.JointModelPrismaticUnaligned(linear)
    return pin.JointModelRevoluteUnaligned(angular)
