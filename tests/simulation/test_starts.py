# SPDX-License-Identifier: BSD-2-Clause
"""Simulations from rest where the coordinates of the robot are dependent."""

import numpy as np
import pytest
from scipy.optimize import brentq

import sst_pin


@pytest.fixture(scope="module")
def bars():
    """A crank-rocker and a pose in which the rocker turns back: its rate is 0 for any crank."""
    chain = sst_pin.robots.four_bar(crank=0.2, rocker=0.5, coupler=0.4, ground=0.6, point=0.3)
    rocker = chain.joint_names.index("rocker")

    def rate(angle: float) -> float:
        return chain.joint_rates(chain.assemble({"crank": angle}), [1.0])[rocker]

    return chain, chain.assemble({"crank": brentq(rate, 0.5, 1.5, xtol=1e-15)})


def test_a_motion_from_rest_starts_where_the_coordinates_are_dependent(bars):
    """It is the motion in coordinates that are independent there."""
    chain, q0 = bars
    t = np.linspace(0, 0.2, 11)
    expected = chain.simulate([0.0], q0, [0.0], t)
    other = chain.with_coordinates(["rocker"])
    motion = other.simulate([0.0], q0, [0.0], t)
    assert not motion.stopped
    assert motion.coordinates == ("rocker",)
    np.testing.assert_allclose(motion.q, expected.q, atol=1e-9)
    rates = chain.joint_rates(expected.q, expected.va)[:, chain.joint_names.index("rocker")]
    np.testing.assert_allclose(motion.va[:, 0], rates, atol=1e-8)


def test_rates_of_dependent_coordinates_do_not_start_a_motion(bars):
    chain, q0 = bars
    with pytest.raises(sst_pin.SingularConfigurationError, match="here crank describe"):
        chain.with_coordinates(["rocker"]).simulate([0.0], q0, [0.1], [0, 0.1])


def test_a_rate_of_almost_zero_that_reverses_at_once_is_as_rest():
    """The first step reverses after a part of it that is shorter than its rounding."""
    chain = sst_pin.robots.four_bar()
    t = [0, 0.01, 0.02]
    expected = chain.simulate([3.0], chain.home, [0.0], t)
    motion = chain.simulate([3.0], chain.home, [-1e-100], t)
    np.testing.assert_allclose(motion.q, expected.q, atol=1e-9)  # rtol is 1e-12
