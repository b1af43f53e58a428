# SPDX-License-Identifier: BSD-2-Clause
"""Pinocchio's derivatives of constrained dynamics, along the motions that keep the loops closed."""

import numpy as np
import pinocchio as pin
from numpy.testing import assert_allclose

from derivative_cases import carried_four_bar, close, derivative
from pinocchio_peers import Constrained
from robots import ROBOTS
from sst_pin import ClosedChain

#: Loops that hang on the ground by points or are closed by welds.
RIGHT = ("four-bar, closed at the ground", "four-bar, coupler welded")


def assert_Pinocchio_agrees(name, ours):
    """To 1e-6 by q and va, for a robot of the table.

    `ours(chain, q, va, tau)` gives d aa / dq and d aa / d va.
    """
    robot = ROBOTS[name]
    q = robot.joints(robot.x).real
    theirs, found = both(robot.model(), robot.closures, robot.actuated, q, ours)
    close(theirs[0], found[0], 1e-6)
    close(theirs[1], found[1], 1e-6)


def assert_Pinocchio_is_wrong(ours):
    """The yaw column of a four-bar on a yaw joint, zero by symmetry, is not; arguments as above."""
    theirs, found = both(*carried_four_bar(pin.JointModelRZ()), ours)
    assert np.abs(found[0][:, 0]).max() < 1e-12 * np.abs(found[0]).max()
    assert np.abs(theirs[0][:, 0]).max() > 1e-3 * np.abs(theirs[0]).max()
    close(theirs[1], found[1], 1e-6)


def both(model, closures, motors, q, ours):
    """Derivatives by q and va at a random state: Pinocchio's, and those of the function `ours`."""
    chain, random = ClosedChain(model, closures, motors), np.random.default_rng(0)
    q = chain.assemble(q)
    n = chain.degrees_of_freedom
    va, tau = random.uniform(-1, 1, (2, n))
    model = pin.Model(model)
    model.damping = model.friction = np.zeros(model.nv)
    bare, columns = ClosedChain(model, closures, motors), list(chain.actuated)
    full = np.zeros(model.nv)
    full[columns] = tau
    L, theirs = chain.joint_rates(q, np.eye(n)).T, Constrained(bare, iterations=100)
    v_dot = theirs.accelerations(q, L @ va, full)
    assert_allclose(v_dot[columns], bare.compute_accelerations(q, va, tau), rtol=1e-7)
    by_q, by_v = theirs.derivatives()

    def rates(k, s):
        return chain.joint_rates(chain.assemble(pin.integrate(model, q, s * L[:, k])), va)

    v_q = np.array([derivative(lambda s, k=k: rates(k, s)) for k in range(n)]).T
    theirs = by_q @ L + by_v @ v_q, by_v @ L
    return [x[columns] for x in theirs], ours(bare, q, va, tau)
