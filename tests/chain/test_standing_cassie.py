# SPDX-License-Identifier: BSD-2-Clause
"""The example of a standing Cassie: what its quadratic programme finds holds the robot."""

import numpy as np
import pinocchio as pin
import pytest

import standing_cassie as example


@pytest.fixture(scope="module")
def standing():
    """Robot, configuration and stance."""
    chain = example.robot()
    q = example.standing(chain)
    return chain, q, example.stance(chain, q)


def test_the_ground_bears_the_weight_within_the_cones_of_friction(standing):
    """1e-8 of 323 N: rounding of the programme."""
    chain, _, (_, forces) = standing
    weight = -pin.computeTotalMass(chain.model) * chain.model.gravity.linear
    np.testing.assert_allclose(forces.sum(axis=0), weight, atol=1e-6)
    assert (forces[:, 2] > 0).all()
    sideways = np.linalg.norm(forces[:, :2], axis=1)
    assert (sideways <= example.FRICTION * forces[:, 2] + 1e-9).all()


def test_under_its_torques_and_forces_the_robot_stays_at_rest(standing):
    """Direct dynamics with the floating base; 1e-8 N m over the least inertia of a rod."""
    chain, q, (torques, forces) = standing
    wrenches = example.contact_wrenches(chain, q, forces)
    rest = np.zeros(chain.degrees_of_freedom)
    aa = chain.compute_accelerations(q, rest, torques, external_wrenches=wrenches)
    assert np.abs(aa).max() < 1e-6
    tau = chain.compute_torques(q, rest, rest, external_wrenches=wrenches)
    np.testing.assert_allclose(tau, torques, atol=1e-6)


def test_no_other_forces_on_the_ground_need_less(standing):
    """Forces that only press the feet against one another, a little of them, cost torques."""
    chain, q, (torques, forces) = standing
    rest = np.zeros(chain.degrees_of_freedom)
    inner = np.zeros((4, 3))
    inner[:, 1] = [1, 1, -1, -1]  # the feet outwards, moments balanced
    data = chain.model.createData()
    pin.framesForwardKinematics(chain.model, data, q)

    def cost(forces):
        wrenches = example.contact_wrenches(chain, q, forces)
        tau = chain.compute_torques(q, rest, rest, external_wrenches=wrenches)
        return tau @ tau + example.OF_FORCES * (forces**2).sum()

    least = torques @ torques + example.OF_FORCES * (forces**2).sum()
    for push in (-0.1, 0.1):
        assert cost(forces + push * inner) > least
