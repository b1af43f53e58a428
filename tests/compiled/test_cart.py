# SPDX-License-Identifier: BSD-2-Clause
"""A cart that rolls, with a mimic joint, a coupling, springs on a ball and a wheel: compiled."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

import any_chain
from exported_c import Exported
from sst_pin import ClosedChain, robots
from sst_pin.chain.backend import Key
from sst_pin.compiled import build


@pytest.fixture(scope="module")
def pair():
    """By kernels and by the reference path."""
    kernels, reference = any_chain.cart(), any_chain.cart()
    for chain in (kernels, reference):
        chain.generic_configuration()
    kernels.compile()
    return kernels, reference


@pytest.fixture(scope="module")
def motions(pair):
    return any_chain.states(pair[1], 12, 0)


def same(actual, expected, tolerance=1e-12):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@pytest.mark.slow
def test_a_rollout_rolls_as_on_the_reference_path(pair, motions):
    """Wheels roll on while the loops are closed; friction smooth: the paths round differently.

    The stages of a step lie off the closures by h^2, where each path solves other rows: one step of
    1e-3 s differs by 3e-12, half of it by a 32nd of that, and steps of 2.5e-4 s by rounding.
    """
    (kernels, reference), (q, va, _) = pair, motions
    tau = np.random.default_rng(0).normal(size=(3, 20, va.shape[1]))

    def rolled(h, steps=20):
        return [
            chain.rollout(tau[:, :steps], q[:3], 0.5 * va[:3], h, sign_width=0.3) for chain in pair
        ]

    ours, theirs = rolled(2.5e-4)
    same(ours.q, theirs.q)
    same(ours.va, theirs.va, 1e-11)
    step = reference.casadi(sign_width=0.3).step(q[0], 0.5 * va[0], tau[0, 0], 2.5e-4)
    same(step[0].full().ravel(), theirs.q[0, 1])
    same(step[1].full().ravel(), theirs.va[0, 1])
    assert np.abs(ours.q[:, -1] - ours.q[:, 0]).max() > 1e-3
    assert "rollout" not in kernels.path
    one, half = (np.abs(a.va - b.va).max() for a, b in (rolled(2e-3, 1), rolled(1e-3, 1)))
    assert one / half == pytest.approx(32, rel=0.1)


def test_gravity_and_inertias_count_without_compiling_again(pair, motions, monkeypatch):
    kernels, (q, va, aa) = pickle.loads(pickle.dumps(pair[0])), motions
    monkeypatch.setattr(build, "_compile", None)  # whoever compiles fails
    before = kernels.compute_torques(q, va, aa)
    model = kernels.model
    model.gravity.linear = np.array([0.0, 3.0, -20.0])
    for joint in ("follower", "ball", "base"):
        model.inertias[model.getJointId(joint)] += pin.Inertia.FromSphere(0.7, 0.2)
    kernels.refresh()
    after = kernels.compute_torques(q, va, aa)
    assert np.abs(after - before).max() > 1
    reference = any_chain.cart()
    reference.model.gravity, reference.model.inertias[:] = model.gravity, model.inertias
    reference.refresh()
    same(after, reference.compute_torques(q, va, aa))
    assert kernels.path.startswith("compiled")


def test_a_robot_without_motors_falls_as_on_the_reference_path(tmp_path):
    robot = robots.four_bar()
    kernels, reference = (ClosedChain(robot.model, robot.closures, []) for _ in range(2))
    q, va, _ = any_chain.states(reference, 3, 0)
    kernels.generic_configuration()
    kernels.compile()
    tau = np.empty((3, 0))
    assert not len(
        kernels._current.backend.kernel(Key("accelerations")).many((q, va, tau), np.empty((3, 1)))
    )
    expected = reference.compute_accelerations(q, va, tau)
    same(kernels.compute_accelerations(q, va, tau), expected)
    same(kernels.compute_accelerations(q[0], va[0], tau[0]), expected[0])
    code, aa = Exported(reference, tmp_path)("accelerations", 1, q[1], va[1])
    assert code == 0
    same(aa, expected[1])
