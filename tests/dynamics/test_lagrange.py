# SPDX-License-Identifier: BSD-2-Clause
"""Any robot, any motors: the dynamics are those of Lagrange multipliers on the tree's RNEA."""

from itertools import cycle

import pytest

from sst_pin import ClosedChain, Closure
from sst_pin.errors import ActuationError
from sst_pin.verification.verify import verify_chain
from tests.support.any_chain import CONSTRAINTS, TREES, states, tree
from tests.support.derivative_cases import CASES, close, of_tree


def branched(motors):
    """Two branches from the ground, closed by a weld."""
    branches = ["RY", "revolute", "RY", "PX"], ["revolute", "RY", "RY", "spherical"]
    return ClosedChain(tree("", *branches, seed=3), [Closure("A", "B", "6d")], motors)


def floating(motors):
    branches = ["RY", "revolute", "RY"], ["RY", "revolute", "spherical"]
    return ClosedChain(tree("free-flyer", *branches, seed=3), [Closure("A", "B", "6d")], motors)


MOTORS = {
    "more motors": ["a0_RY", "a1_revolute", "a2_RY", "a3_PX", "b3_spherical"],
    "a tendon": [{"a0_RY": 0.3, "b1_RY": -1.2}, "a1_revolute", "b0_revolute"],
}
#: Every type of closure, and of joint, in trees that are not added depth-first, so that `pin.crba`
#: would be wrong for them; motors; a coupling by polynomials, mimic joints, forces along lines.
VERIFIED = {
    **{
        f"{name}, {kind}": lambda name=name, kind=kind: of_tree(name, kind).chain
        for kind, name in zip(CONSTRAINTS, cycle(TREES), strict=False)
    },
    **{name: lambda motors=motors: branched(motors) for name, motors in MOTORS.items()},
    "floating, no motors": lambda: floating([]),
    **{
        name: lambda name=name: CASES[name][0](*CASES[name][1:]).chain
        for name in ("floating four-bar", "geared", "mimicking", "two motors on lines")
    },
}


@pytest.mark.parametrize("name", VERIFIED)
def test_dynamics_are_those_of_every_referee(name):
    """With friction and springs in all joints that may have them, but for `MOTORS`."""
    rows = list(verify_chain(VERIFIED[name](), 3))
    assert "Lagrange multipliers" in {row.referee for row in rows}
    for row in rows:
        assert row.cases == 3
        # Rounding, times condition numbers up to 1e3 of the loop and of the inertia.
        assert row.relative < 1e-9, row


def test_forces_that_nobody_supplies_are_named():
    """A floating robot: the missing forces are those of the base's coordinates, no others."""
    driven = ["a0_RY", "b0_RY"]
    chain = floating(driven)
    q, va, aa = (x[0] for x in states(chain, 1, 0))
    f = chain.generalized_forces(q, va, aa)
    with pytest.raises(ActuationError, match="no motor supplies") as caught:
        chain.compute_torques(q, va, aa)
    names = chain.mechanism.coordinate_rate_names
    expected = {n: x for n, x in zip(names, f, strict=True) if n not in driven}
    assert set(caught.value.missing) == set(expected)
    close([caught.value.missing[n] for n in expected], list(expected.values()), 1e-9)
