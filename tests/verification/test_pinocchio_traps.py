# SPDX-License-Identifier: BSD-2-Clause
"""Where Pinocchio is a referee of closed loops, and where it is wrong without an error."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.verification.lagrange import LagrangeMultipliers
from tests.support import link_tables
from tests.support.derivative_cases import carried_four_bar, close, derivative
from tests.support.files import load

Constrained = load("scripts/benchmark/pinocchio_peers.py").Constrained

BREADTH_FIRST = [0, 2, 1]  # crank, rocker, and then the coupler that the crank bears


@pytest.mark.parametrize("order", [[0, 1, 2], BREADTH_FIRST])
def test_constraint_dynamics_is_right_for_depth_first_trees_only(order):
    """A four-bar: equal to 1e-9 depth-first, off by a third and without an error otherwise."""
    table = link_tables.four_bar()
    model = table.model(order)
    chain = sst_pin.ClosedChain(model, table.closures, table.actuated)
    q, va = chain.assemble(np.full(3, 0.5)), np.array([0.3])
    v = chain.joint_rates(q, va)
    aa = chain.compute_accelerations(q, va, [1.0])
    tau = np.where(np.array(chain.joint_names) == "crank", 1.0, 0.0)
    given = tau - model.damping * v - model.friction * np.sign(v)
    wanted = chain.joint_accelerations(q, va, aa)
    found = Constrained(chain, iterations=20).accelerations(q, v, given)
    error = np.abs(found - wanted).max() / np.abs(wanted).max()
    assert np.allclose(aa, LagrangeMultipliers(chain).accelerations(q, va, np.ones(1)))
    assert error < 1e-9 if order != BREADTH_FIRST else error > 0.1


def test_crba_is_right_for_depth_first_trees_only():
    """Against columns of RNEA, which is right in every order."""
    table, errors = link_tables.four_bar(), []
    for order in ([0, 1, 2], BREADTH_FIRST):
        model = table.model(order)
        data, q, zero = model.createData(), np.full(3, 0.5), np.zeros(3)
        M = np.triu(pin.crba(model, data, q))
        rest = pin.rnea(model, data, q, zero, zero)
        columns = [pin.rnea(model, data, q, zero, e) - rest for e in np.eye(3)]
        errors.append(np.abs(M - np.triu(np.column_stack(columns))).max())
    assert errors[0] < 1e-12
    assert errors[1] > 1e-2


def derivatives(model, closures, motors, q):
    """d aa / dq and d aa / d va at a random state, along motions that keep the loops closed.

    Pinocchio's, and ours.
    """
    chain, random = sst_pin.ClosedChain(model, closures, motors), np.random.default_rng(0)
    q = chain.assemble(q)
    n = chain.degrees_of_freedom
    va, tau = random.uniform(-1, 1, (2, n))
    model = pin.Model(model)
    model.damping = model.friction = np.zeros(model.nv)
    bare, columns = sst_pin.ClosedChain(model, closures, motors), list(chain.actuated)
    full = np.zeros(model.nv)
    full[columns] = tau
    L, theirs = chain.joint_rates(q, np.eye(n)).T, Constrained(bare, iterations=100)
    v_dot = theirs.accelerations(q, L @ va, full)
    np.testing.assert_allclose(v_dot[columns], bare.compute_accelerations(q, va, tau), rtol=1e-7)
    by_q, by_v = theirs.derivatives()

    def rates(k, s):
        return chain.joint_rates(chain.assemble(pin.integrate(model, q, s * L[:, k])), va)

    v_q = np.array([derivative(lambda s, k=k: rates(k, s)) for k in range(n)]).T
    found = (by_q @ L + by_v @ v_q)[columns], (by_v @ L)[columns]
    return found, bare.acceleration_derivatives(q, va, tau)[:2]


@pytest.mark.parametrize("name", ["four-bar, closed at the ground", "four-bar, coupler welded"])
def test_derivatives_are_right_for_points_on_the_ground_and_for_welds(name):
    robot = link_tables.ROBOTS[name]
    q = robot.joints(robot.x).real
    for found, ours in zip(
        *derivatives(robot.model(), robot.closures, robot.actuated, q), strict=True
    ):
        close(found, ours, 1e-6)


def test_derivatives_are_wrong_for_points_on_a_moving_joint():
    """The yaw column of a four-bar on a yaw joint, zero by symmetry, is not."""
    (by_q, by_va), ours = derivatives(*carried_four_bar(pin.JointModelRZ()))
    assert np.abs(ours[0][:, 0]).max() < 1e-12 * np.abs(ours[0]).max()
    assert np.abs(by_q[:, 0]).max() > 1e-3 * np.abs(by_q).max()
    close(by_va, ours[1], 1e-6)
