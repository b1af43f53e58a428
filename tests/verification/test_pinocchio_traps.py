# SPDX-License-Identifier: BSD-2-Clause
"""What is wrong in Pinocchio without an error, and why it is then no referee."""

import numpy as np
import pinocchio as pin
import pytest

import robots
import sst_pin
from pinocchio_peers import Constrained
from sst_pin.verification.referees import lagrange

BREADTH_FIRST = [0, 2, 1]  # crank, rocker, and then the coupler that the crank bears


@pytest.mark.parametrize("order", [[0, 1, 2], BREADTH_FIRST])
def test_constraint_dynamics_is_right_for_depth_first_trees_only(order):
    """A four-bar: equal to 1e-9 depth-first, off by a third and without an error otherwise."""
    table = robots.four_bar()
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
    assert np.allclose(aa, lagrange.accelerations(chain, q, va, np.ones(1)))
    assert error < 1e-9 if order != BREADTH_FIRST else error > 0.1


def test_crba_is_right_for_depth_first_trees_only():
    """Against columns of RNEA, which is right in every order."""
    table, errors = robots.four_bar(), []
    for order in ([0, 1, 2], BREADTH_FIRST):
        model = table.model(order)
        data, q, zero = model.createData(), np.full(3, 0.5), np.zeros(3)
        M = np.triu(pin.crba(model, data, q))
        rest = pin.rnea(model, data, q, zero, zero)
        columns = [pin.rnea(model, data, q, zero, e) - rest for e in np.eye(3)]
        errors.append(np.abs(M - np.triu(np.column_stack(columns))).max())
    assert errors[0] < 1e-12
    assert errors[1] > 1e-2
