# SPDX-License-Identifier: BSD-2-Clause
"""An equal tree whose derivatives Pinocchio computes rightly.

`pin.computeRNEADerivatives` is wrong in silence for trees whose joints were not added depth-first,
and for joints whose axes move in the joint: universal joints, Euler angles, composites. It refuses
mimic joints. In the plain tree each joint stands before its subtree, and such a joint is a row of
joints with bodies of no mass between them; a mimic joint is an ordinary one with a coupling, and
has entries of its own in q and v. Otherwise these are the same numbers in another order.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array
from .closures import Coupling
from .mechanism import Friction, Mechanism, Springs
from .tree import series_of


class PlainTree:
    """A mechanism on its plain tree; coordinates and motors keep their order."""

    def __init__(self, mechanism: Mechanism) -> None:
        given, model = mechanism.model, pin.Model()
        model.gravity = given.gravity
        q: list[int] = []
        v: list[int] = []
        own: list[bool] = []  # not that of the joint that a mimic joint follows
        couplings: list[Coupling] = []
        scaling: list[tuple[int, float, float]] = []
        # Pinocchio's mimicked_joints does not keep the order of mimicking_joints.
        leaders = {o.idx_v: n for n, o in zip(given.names, given.joints, strict=True) if o.nv}
        ids = [0] * given.njoints
        waiting = list(given.children[0])[::-1]
        while waiting:
            j = waiting.pop()
            joint, parent, placement = given.joints[j], ids[given.parents[j]], pin.SE3.Identity()
            if joint.nv:
                series = series_of(joint)
            else:
                mimic = joint.extract()
                series = [(_followed(joint), pin.SE3.Identity())]
                terms = {leaders[joint.idx_v]: (0.0, mimic.scaling)}
                couplings.append(Coupling(given.names[j], terms, mimic.offset))
                scaling.append((len(q), mimic.scaling, mimic.offset))
            for number, (part, offset) in enumerate(series):
                name = f"{given.names[j]}/{number}" if len(series) > 1 else given.names[j]
                placement = offset if number else given.jointPlacements[j] * offset
                parent = model.addJoint(parent, part, placement, name)
            ids[j] = parent
            model.appendBodyToJoint(parent, given.inertias[j], pin.SE3.Identity())
            q += range(joint.idx_q, joint.idx_q + (joint.nq or 1))
            v += range(joint.idx_v, joint.idx_v + (joint.nv or 1))
            own += [joint.nv > 0] * (joint.nv or 1)
            waiting += list(given.children[j])[::-1]
        for frame in map(pin.Frame, list(given.frames)[1:]):
            frame.parentJoint = ids[frame.parentJoint]
            model.addFrame(frame, False)
        once = np.array(own, dtype=float)
        model.armature = given.armature[v] * once
        self._scale, self._offset = np.ones(len(q)), np.zeros(len(q))
        for i, factor, offset in scaling:
            self._scale[i], self._offset[i] = factor, offset
        self._q, self._bodies = np.array(q), np.array(ids[1:]) - 1
        friction, springs = mechanism.friction, mechanism.springs
        self.mechanism = replace(
            mechanism,
            model=model,
            closures=(*mechanism.closures, *couplings),
            coordinates=np.flatnonzero(own)[np.argsort(np.array(v)[own])][mechanism.coordinates],
            motors=mechanism.motors[v] * once[:, None],
            friction=Friction(
                friction.viscous[v] * once, friction.coulomb[v] * once, friction.sign_width
            ),
            springs=Springs(springs.stiffness[v] * once, springs.reference[q]),
        )

    def configuration(self, q: Array) -> Array:
        """q of the plain tree, shape (nq,)."""
        return q[self._q] * self._scale + self._offset

    def wrenches(self, wrenches: Array | None) -> Array | None:
        """External wrenches on the bodies of the plain tree, shape (r', 6)."""
        if wrenches is None:
            return None
        plain = np.zeros((self.mechanism.model.njoints - 1, 6))
        plain[self._bodies] = wrenches
        return plain


def _followed(joint: Any) -> Any:
    """The ordinary joint that a mimic joint is made of, by its unit twist; Pinocchio hides it."""
    data = joint.createData()
    joint.calc(data, np.zeros(joint.idx_q + 1))
    linear, angular = np.split(np.ravel(np.array(data.S)) / joint.extract().scaling, 2)
    if not angular.any():
        return pin.JointModelPrismaticUnaligned(linear)
    return pin.JointModelRevoluteUnaligned(angular)
