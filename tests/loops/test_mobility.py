# SPDX-License-Identifier: BSD-2-Clause
"""Degrees of freedom: closures that hold nothing, and motions that are infinitesimal."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from sst_pin import ClosedChain, Closure
from tests.support.by_hand import add, mark


def plane_arm(seed, size, joints):
    """An arm in a plane of its own, whose hand is marked, and a mark on the world in this plane."""
    random, model = np.random.default_rng(seed), pin.Model()
    base = pin.SE3(pin.exp3(random.normal(size=3)), size * random.normal(size=3))
    j, link = 0, base
    for k, kind in enumerate(joints):
        body = pin.Inertia(1.0, np.array([0.1 * size, 0, 0]), 0.01 * size**2 * np.eye(3))
        j = add(model, j, kind(), f"joint_{k}", link, body)
        turn = pin.exp3(np.array([0, 0, random.uniform(-2, 2)]))
        link = pin.SE3(turn, size * np.array([0.3, 0.1, 0]))
    mark(model, 0, "ground", base)
    mark(model, j, "hand", link)
    model.referenceConfigurations["home"] = np.zeros(model.nq)
    return model


PLANE = pin.JointModelRZ, pin.JointModelPX, pin.JointModelRZ, pin.JointModelRZ
GANTRY = pin.JointModelPX, pin.JointModelPY, pin.JointModelPX


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(
    ("joints", "held"),
    [
        (PLANE, "planar"),
        (PLANE, (False, False, False, True, True, False)),
        (GANTRY, (False, False, True, True, True, False)),
    ],
)
def test_a_closure_that_holds_nothing_leaves_the_torques_of_the_open_arm(joints, held, seed, size):
    """Its rows are rounding. They are compared with the natural size of a row, not with another.

    The referee is Pinocchio's inverse dynamics of the arm without the closure.
    """
    model = plane_arm(seed, size, joints)
    chain = ClosedChain(model, [Closure("ground", "hand", held)], list(model.names)[1:])
    n = len(joints)
    assert chain.coordinates == tuple(model.names)[1:]
    assert chain.mobility().rank == 0
    random = np.random.default_rng(seed)
    q = size * random.uniform(-1, 1, n)
    va, aa = random.normal(size=(2, n))
    tau = pin.rnea(model, model.createData(), q, va, aa)
    assert_allclose(
        chain.compute_torques(q, va, aa), tau, rtol=1e-9, atol=1e-12 * np.abs(tau).max()
    )
