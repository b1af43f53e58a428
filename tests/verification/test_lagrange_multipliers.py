# SPDX-License-Identifier: BSD-2-Clause
"""The multipliers and the orthogonal complement agree for every joint, closure, motor, spring.

The trees are not added depth-first, so `pin.crba` would be wrong for them.
"""

import numpy as np
import pytest

from sst_pin import ClosedChain, Closure
from sst_pin.chain.closures import Coupling
from sst_pin.verification.verify import verify_chain
from trees import CONSTRAINTS, JOINTS, tree


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_of_every_closure(name):
    """On a free base, springs and friction in a joint; tau of a motor and of a tendon."""
    model = tree("free", ["RX", "revolute", "RZ"], ["RZ", "ball", "PZ"], seed=3)
    stiffness, friction = np.zeros((2, model.nv))
    k = model.joints[model.getJointId("a1_revolute")].idx_v
    stiffness[k], friction[k] = 20, 0.3
    chain = ClosedChain(
        model,
        [CONSTRAINTS[name], Coupling("a2_RZ", {"a0_RX": (0.1, 0.5, 0.3), "b2_PZ": (0, 2)})],
        ["a0_RX", {"a1_revolute": 2, "b2_PZ": -3}],
        stiffness=stiffness,
        viscous_friction=friction,
        coulomb_friction=friction,
    )
    _agree(chain)


@pytest.mark.parametrize("joint", JOINTS)
def test_of_every_joint(joint):
    chain = ClosedChain(
        tree("", [joint, "RX"], ["RZ", "ball", "translation"], seed=4),
        [Closure("A", "B", "6d")],
        ["a1_RX"],
    )
    _agree(chain)


def _agree(chain):
    """1e-9: rounding, times condition numbers up to 1e3 of the loop and some of the inertia."""
    *forces, accelerations = verify_chain(chain, 5)
    assert forces[-1].cases == accelerations.cases == 5
    assert max(line.relative for line in (*forces, accelerations)) < 1e-9
