# SPDX-License-Identifier: BSD-2-Clause
"""Base parameters: how many, which, and that forces depend on nothing else."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import any_chain
import sst_pin
from sst_pin import ClosedChain, InputError, UnknownNameError, robots
from sst_pin.identification import base_parameters, random_states

BODIES = [f"*.{word}" for word in ("mass", "m[xyz]", "i[xyz][xyz]")]


@pytest.mark.parametrize(
    "model", [pin.buildSampleModelManipulator(), pin.buildSampleModelHumanoidRandom()]
)
def test_open_trees_have_the_rank_of_pinocchios_regressor(model):
    model.armature = model.damping = model.friction = np.zeros(model.nv)
    limits = np.pi * np.ones(model.nq)
    model.lowerPositionLimit, model.upperPositionLimit = -limits, limits
    random, data, rows = np.random.default_rng(0), model.createData(), []
    pin.seed(0)
    for _ in range(10 * model.njoints // model.nv + 40):
        v, a = random.normal(size=(2, model.nv))
        q = pin.randomConfiguration(model)
        rows.append(pin.computeJointTorqueRegressor(model, data, q, v, 9 * a).copy())
    W = np.vstack(rows)
    W = W[:, np.abs(W).max(axis=0) > 1e-9]
    rank = np.linalg.matrix_rank(W / np.linalg.norm(W, axis=0), tol=1e-7)
    names = [name for name in list(model.names)[1:] if name != "root_joint"]
    chain = ClosedChain(model, [], names)
    assert len(base_parameters(chain, BODIES)) == rank


@pytest.mark.parametrize(("gravity", "number"), [((0, 0, -9.81), 31), ((1, 2, -9), 33)])
def test_the_sst_has_as_many_as_are_derived_by_hand(gravity, number):
    """docs/identification.md: 33, and 31 where one motor's axis is vertical."""
    robot = sst_pin.SST()
    robot.model.gravity.linear = np.array(gravity, dtype=float)
    robot.refresh()
    base = base_parameters(robot)
    assert len(base) == number
    assert len(base_parameters(robot, seed=5)) == number


@pytest.mark.parametrize(
    "make", [robots.delta, robots.four_bar, sst_pin.SST, lambda: any_chain.with_joint("RY")]
)
def test_forces_depend_on_the_base_parameters_alone(make):
    """Parameters that move along the null space of the combinations change no force."""
    chain = make()
    base, theta = base_parameters(chain), np.asarray(chain.dynamic_parameters)
    motions = random_states(chain, 4, 7)
    f, Y = chain.generalized_forces(*motions), chain.torque_regressor(*motions)
    of_base = Y[..., base.columns] @ (base.matrix @ theta)
    assert_allclose(of_base, f, atol=1e-9 * np.abs(f).max())
    hidden = theta.copy()
    step = 0.1 * np.random.default_rng(1).normal(size=len(base.considered))
    hidden[base.considered] += step
    change = base.matrix @ (hidden - theta)
    hidden[base.columns] -= change
    size = np.abs(hidden - theta).max()
    assert size > 0.1
    assert_allclose(Y @ hidden, f, atol=1e-9 * size * np.abs(Y).max())


def test_parameters_that_no_motion_shows_are_named():
    """A planar four-bar: what does not move in its plane has no effect."""
    base = base_parameters(robots.four_bar(), ["coupler.*", "crank.viscous"])
    assert "coupler.mz" in base.unseen
    assert "coupler.ixx" in base.unseen
    assert "crank.viscous" in base.names
    assert len(base.names) == len(base) == np.linalg.matrix_rank(base.matrix)


def test_a_motion_shows_less_than_random_states():
    """At rest there is no inertia to be seen."""
    chain = robots.five_bar()
    chain.model.gravity.linear = np.array([0, -9.81, 0])
    chain.refresh()
    q, va, _ = random_states(chain, 40)
    still = base_parameters(chain, BODIES, motion=(q, 0 * va, 0 * va))
    assert "elbow_1.izz" in still.unseen
    assert len(still) < len(base_parameters(chain, BODIES))


def test_bad_arguments_are_refused():
    chain = robots.four_bar()
    with pytest.raises(UnknownNameError, match=r"crank\.weight"):
        base_parameters(chain, ["crank.weight"])
    with pytest.raises(InputError, match="give more samples"):
        base_parameters(chain, motion=random_states(chain, 3))
    with pytest.raises(InputError, match="count"):
        random_states(chain, 0)
