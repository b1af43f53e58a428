# SPDX-License-Identifier: BSD-2-Clause
"""Any robot, any motors: the dynamics are those of Lagrange multipliers on the tree's RNEA."""

from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pytest
import qpsolvers
from numpy.testing import assert_allclose

from sst_pin import ClosedChain, Closure, Coupling
from sst_pin.errors import ActuationError
from sst_pin.verification.lagrange import LagrangeMultipliers
from sst_pin.verification.verify import verify_chain
from tests.support.any_chain import ALL_JOINTS, CONSTRAINTS, states, tree
from tests.support.differences import random_q


@dataclass
class Case:
    """A closed robot: its tree, what closes it, its motors."""

    parts: tuple
    kind: str
    motors: list = field(default_factory=list)
    springs: bool = False
    friction: bool = False

    def build(self, seed=3):
        model, random, options = tree(*self.parts, seed=seed), np.random.default_rng(seed), {}
        if self.springs:
            soft = np.zeros(model.nv)
            for joint, k in zip(list(model.joints)[1:], random.uniform(5, 50, 99), strict=False):
                if (joint.nq, joint.nv) in ((1, 1), (4, 3)) and "Planar" not in joint.shortname():
                    soft[joint.idx_v : joint.idx_v + joint.nv] = k
            options = {"stiffness": soft, "spring_reference": random_q(model, random, 0.3)}
        if self.friction:
            names = ("viscous_friction", "coulomb_friction")
            options |= dict(zip(names, random.uniform(0, 2, (2, model.nv)), strict=True))
        return ClosedChain(model, [Closure("A", "B", self.kind)], self.motors, **options)


ARM = ("", ["RY", "revolute", "RY", "PX"], ["revolute", "RY", "RY", "spherical"])
FLOATING = ("free-flyer", ["RY", "revolute", "RY"], ["RY", "revolute", "spherical"])
CASES = {
    "floating": Case(FLOATING, "6d", ["a0_RY", "b0_RY"]),
    "floating, no motors": Case(FLOATING, "hinge"),
    "balls": Case(
        ("", ["RY", "RY", "spherical"], ["spherical", "PX", "spherical"]), "3d", ["a0_RY", "a1_RY"]
    ),
    "springs": Case(FLOATING, "6d", ["a0_RY"], springs=True, friction=True),
    "springs in balls": Case(
        ("", ["RY", "spherical"], ["spherical", "PX"]), "3d", ["a0_RY"], springs=True
    ),
    "more motors": Case(ARM, "6d", ["a0_RY", "a1_revolute", "a2_RY", "a3_PX", "b0_revolute"]),
    "more motors, springs": Case(
        ARM, "6d", ["a0_RY", "a1_revolute", "a2_RY", "a3_PX", "b3_spherical"], springs=True
    ),
    "a tendon": Case(ARM, "6d", [{"a0_RY": 0.3, "b1_RY": -1.2}, "a1_revolute", "b0_revolute"]),
    "composite": Case(("", ["composite"], ["translation", "universal"]), "3d", ["b0_translation"]),
}


def close(actual, expected, tolerance=1e-9):
    """Equality relative to the largest entry."""
    assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max(initial=1e-3))


def closed_by(constraint):
    """On a free base, springs and friction in a joint; tau of a motor and of a tendon."""
    model = tree("free-flyer", ["RY", "revolute", "RY"], ["RY", "spherical", "PX"], seed=3)
    stiffness, friction = np.zeros((2, model.nv))
    k = model.joints[model.getJointId("a1_revolute")].idx_v
    stiffness[k], friction[k] = 20, 0.3
    return ClosedChain(
        model,
        [constraint, Coupling("a2_RY", {"a0_RY": (0.1, 0.5, 0.3), "b2_PX": (0, 2)})],
        ["a0_RY", {"a1_revolute": 2, "b2_PX": -3}],
        stiffness=stiffness,
        viscous_friction=friction,
        coulomb_friction=friction,
    )


def hinged_by(joint):
    return Case(("", [joint, "RY"], ["RY", "spherical", "translation"]), "6d", ["a1_RY"]).build(4)


#: Kinds of closures are masks of the same six rows; rods and wheels have rows of their own.
CLOSED_BY = ("3d", "6d", "mask", "rod", "disc", "ball")
VERIFIED = {
    **{name: made.build for name, made in CASES.items()},
    **{f"closure {name}": partial(closed_by, CONSTRAINTS[name]) for name in CLOSED_BY},
    **{f"joint {name}": partial(hinged_by, name) for name in ALL_JOINTS},
}


@pytest.mark.parametrize("name", VERIFIED)
def test_dynamics_are_those_of_every_referee(name):
    """The trees are not added depth-first, so `pin.crba` would be wrong for them."""
    rows = list(verify_chain(VERIFIED[name](), 3))
    assert {"virtual work", "Lagrange multipliers"} <= {row.referee for row in rows}
    for row in rows:
        assert row.cases == 3
        # Rounding, times condition numbers up to 1e3 of the loop and of the inertia.
        assert row.relative < 1e-9, row


@pytest.mark.parametrize("weighted", [False, True])
def test_with_more_motors_the_torques_are_the_least(weighted):
    """Those of a quadratic programme: least weighted squares with L^T B tau = f."""
    chain = CASES["more motors, springs"].build()
    motors, n = len(chain.motor_units), chain.degrees_of_freedom
    random = np.random.default_rng(0)
    for q, va, aa in zip(*states(chain, 3, 0), strict=True):
        weights = random.uniform(0.1, 10, motors) if weighted else None
        tau = chain.compute_torques(q, va, aa, weights=weights)
        A = chain.joint_rates(q, np.eye(n)) @ chain.mechanism.motors
        b = LagrangeMultipliers(chain).generalized_forces(q, va, aa)
        P = np.diag(np.ones(motors) if weights is None else weights)
        expected = qpsolvers.solve_qp(P, np.zeros(motors), A=A, b=b, solver="quadprog")
        close(tau, expected)


def test_forces_that_nobody_supplies_are_named():
    """A floating robot: the missing forces are those of the base's coordinates, no others."""
    chain = Case(FLOATING, "6d", ["a0_RY", "b0_RY"]).build()
    q, va, aa = (x[0] for x in states(chain, 1, 0))
    f = chain.generalized_forces(q, va, aa)
    with pytest.raises(ActuationError, match="no motor supplies") as caught:
        chain.compute_torques(q, va, aa)
    names = chain.mechanism.coordinate_rate_names
    driven = {"a0_RY", "b0_RY"}
    expected = {n: x for n, x in zip(names, f, strict=True) if n not in driven}
    assert set(caught.value.missing) == set(expected)
    close([caught.value.missing[n] for n in expected], list(expected.values()))
