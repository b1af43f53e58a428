# SPDX-License-Identifier: BSD-2-Clause
"""An equal tree whose derivatives Pinocchio computes rightly.

`pin.computeRNEADerivatives` is wrong in silence for trees whose joints were not added depth-first,
and for joints whose axes move in the joint: universal joints, Euler angles, composites. In the
plain tree each joint stands before its subtree, and such a joint is a row of joints with bodies of
no mass between them. Its q and v are the same numbers in another order.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from .loops import _series
from .mechanism import Friction, Mechanism, Springs

Array = NDArray[np.float64]


class PlainTree:
    """A mechanism on its plain tree.

    Args:
        mechanism: On any tree.

    Attributes:
        mechanism: On the plain tree; coordinates and motors in the order of the given one.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        given, model = mechanism.model, pin.Model()
        model.gravity = given.gravity
        q: list[int] = []
        v: list[int] = []
        ids = [0] * given.njoints
        waiting = list(given.children[0])[::-1]
        while waiting:
            j = waiting.pop()
            joint, parent, placement = given.joints[j], ids[given.parents[j]], pin.SE3.Identity()
            series = _series(joint)
            for number, (part, offset) in enumerate(series):
                name = f"{given.names[j]}/{number}" if len(series) > 1 else given.names[j]
                placement = offset if number else given.jointPlacements[j] * offset
                parent = model.addJoint(parent, part, placement, name)
            ids[j] = parent
            model.appendBodyToJoint(parent, given.inertias[j], pin.SE3.Identity())
            q += range(joint.idx_q, joint.idx_q + joint.nq)
            v += range(joint.idx_v, joint.idx_v + joint.nv)
            waiting += list(given.children[j])[::-1]
        for frame in map(pin.Frame, list(given.frames)[1:]):
            frame.parentJoint = ids[frame.parentJoint]
            model.addFrame(frame, False)
        model.armature = given.armature[v]
        self._q, self._bodies = np.array(q), np.array(ids[1:]) - 1
        friction, springs = mechanism.friction, mechanism.springs
        self.mechanism = replace(
            mechanism,
            model=model,
            coordinates=np.argsort(v)[mechanism.coordinates],
            motors=mechanism.motors[v],
            friction=Friction(friction.viscous[v], friction.coulomb[v], friction.sign_width),
            springs=Springs(springs.stiffness[v], springs.reference[q]),
        )

    def configuration(self, q: Array) -> Array:
        """q of the plain tree, shape (nq,)."""
        return q[self._q]

    def wrenches(self, wrenches: Array | None) -> Array | None:
        """External wrenches on the bodies of the plain tree, shape (r', 6)."""
        if wrenches is None:
            return None
        plain = np.zeros((self.mechanism.model.njoints - 1, 6))
        plain[self._bodies] = wrenches
        return plain
