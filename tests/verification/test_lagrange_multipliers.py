# SPDX-License-Identifier: BSD-2-Clause
"""The multipliers and the orthogonal complement agree for every joint, closure, motor, spring.

The trees are not added depth-first, so `pin.crba` would be wrong for them.
"""

from functools import partial

import numpy as np
import pytest

from robots import ROBOTS
from sst_pin import ClosedChain, Closure
from sst_pin.chain.closures import Coupling
from sst_pin.verification.verify import verify_chain
from trees import CONSTRAINTS, JOINTS, tree


def closed_by(constraint):
    """On a free base, springs and friction in a joint; tau of a motor and of a tendon."""
    model = tree("free", ["RX", "revolute", "RZ"], ["RZ", "ball", "PZ"], seed=3)
    stiffness, friction = np.zeros((2, model.nv))
    k = model.joints[model.getJointId("a1_revolute")].idx_v
    stiffness[k], friction[k] = 20, 0.3
    return ClosedChain(
        model,
        [constraint, Coupling("a2_RZ", {"a0_RX": (0.1, 0.5, 0.3), "b2_PZ": (0, 2)})],
        ["a0_RX", {"a1_revolute": 2, "b2_PZ": -3}],
        stiffness=stiffness,
        viscous_friction=friction,
        coulomb_friction=friction,
    )


def hinged_by(joint):
    model = tree("", [joint, "RX"], ["RZ", "ball", "translation"], seed=4)
    return ClosedChain(model, [Closure("A", "B", "6d")], ["a1_RX"])


#: How to make them, and the tolerance of forces: rounding, times condition numbers up to 1e3 of the
#: loop; those of the table are regular.
CASES = {
    **{f"closure {name}": (partial(closed_by, c), 1e-9) for name, c in CONSTRAINTS.items()},
    **{f"joint {name}": (partial(hinged_by, name), 1e-9) for name in JOINTS},
    **{name: (robot.chain, 1e-10) for name, robot in ROBOTS.items()},
}


@pytest.mark.parametrize("name", CASES)
def test_forces_torques_and_accelerations_agree(name):
    make, tolerance = CASES[name]
    *forces, accelerations = verify_chain(make(), 5)
    assert forces[-1].cases == accelerations.cases == 5
    assert max(line.relative for line in forces) < tolerance
    assert accelerations.relative < 1e-9  # and the condition number of the inertia
