# SPDX-License-Identifier: BSD-2-Clause
"""The normal tree moves as the tree that it replaces."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from sst_pin.model.normal_tree import NormalTree
from tests.support.by_hand import add, at, mark


def odd_tree():
    """Composite, universal and mimic joints, not added depth-first."""
    pin.seed(3)
    model, inertia = pin.Model(), pin.Inertia.Random
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelRZ(), at(0.1, 0.2, 0.3))
    composite.addJoint(pin.JointModelPX(), at(0.0, 0.4, 0.0))
    a = add(model, 0, pin.JointModelRX(), "a", at(0.1), inertia())
    b = add(model, 0, composite, "b", at(0, 0.5), inertia())
    axes = np.array([1.0, 0, 0]), np.array([0.0, 1, 0])
    c = add(model, a, pin.JointModelUniversal(*axes), "c", at(0.3), inertia())
    d = add(model, b, pin.JointModelRY(), "d", at(0, 0, 0.2), inertia())
    add(model, c, pin.JointModelFreeFlyer(), "e", at(0.2), inertia())
    mark(model, d, "end", at(0.1, 0.2))
    model.armature = np.linspace(0.1, 1, model.nv)
    return pin.transformJointIntoMimic(model, a, d, -0.7, 0.3)


@pytest.mark.parametrize("seed", range(3))
def test_bodies_and_inverse_dynamics_are_those_of_the_tree(seed):
    """By `pin.rnea` and `pin.forwardKinematics`, which are right for every tree."""
    model, random = odd_tree(), np.random.default_rng(seed)
    tree = NormalTree(model)
    step = random.normal(size=model.nv)
    q, (v, a) = pin.integrate(model, pin.neutral(model), step), random.normal(size=(2, model.nv))
    data, normal = model.createData(), tree.model.createData()
    x, S = tree.configuration(q), tree.S
    expected = pin.rnea(model, data, q, v, a)
    tau = S.T @ pin.rnea(tree.model, normal, x, S @ v, S @ a)
    # Two ways to sum over seven bodies: rounding of 1e-16 times sizes below 1e3.
    assert_allclose(tau, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    pin.framesForwardKinematics(model, data, q)
    pin.framesForwardKinematics(tree.model, normal, x)
    for joint, body in enumerate(tree.bodies):
        assert normal.oMi[body].isApprox(data.oMi[joint], 1e-14)
    end = model.getFrameId("end")
    assert normal.oMf[end].isApprox(data.oMf[end], 1e-14)


def test_joints_stand_before_their_subtrees():
    model = NormalTree(odd_tree()).model
    subtrees = [list(subtree) for subtree in model.subtrees][1:]
    assert all(x == list(range(x[0], x[0] + len(x))) for x in subtrees)
    assert not list(model.mimicking_joints)
