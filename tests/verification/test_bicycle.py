# SPDX-License-Identifier: BSD-2-Clause
"""The benchmark bicycle against the numbers of its two publications."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from tests.data import PUBLISHED
from tests.support.files import load

bicycle = load("examples/bicycle.py")
NUMBERS = PUBLISHED["bicycle"]
robot = cache(bicycle.bicycle)


def test_the_bicycle_accelerates_as_published():
    """The state is published with 13 digits; so are the rates of the dependent joints."""
    chain, state = robot(), NUMBERS["state"]
    q = chain.assemble(state["q"])
    assert_allclose([q[chain.joint_names.index(name)] for name in state["q"]],
                    list(state["q"].values()), rtol=0, atol=2e-13)  # fmt: skip
    va = [state["v"][name] for name in chain.coordinates]
    rates = chain.joint_rates(q, va)
    assert_allclose(rates, [state["v"][name] for name in chain.joint_names], rtol=0, atol=2e-12)
    accelerations = chain.compute_accelerations(q, va, np.zeros(3))
    published = [state["dv"][name] for name in chain.coordinates]
    assert_allclose(accelerations, published, rtol=0, atol=2e-12)
    # And back: these accelerations need no torques.
    torques = chain.compute_torques(q, va, published)
    assert_allclose(torques, 0, atol=1e-9 * 85 * 9.81)


@pytest.mark.parametrize("speed", NUMBERS["eigenvalues"])
def test_eigenvalues_have_the_published_digits(speed):
    """Fourteen decimals are published."""
    real, imaginary = np.transpose(NUMBERS["eigenvalues"][speed])
    values = np.sort_complex(bicycle.eigenvalues(robot(), float(speed)))
    assert_allclose(values, np.sort_complex(real + 1j * imaginary), rtol=0, atol=2e-13)


def test_the_bicycle_is_stable_between_the_published_speeds():
    """Where the largest real part is zero: weave below, capsize above."""

    def largest(speed):
        return bicycle.eigenvalues(robot(), speed).real.max()

    # The capsize eigenvalue is flat there, 0.11 1/s for 1 m/s: rounding counts tenfold.
    assert_allclose(brentq(largest, 4.0, 5.0, xtol=1e-14), bicycle.STABLE[0], rtol=0, atol=1e-12)
    assert_allclose(brentq(largest, 5.5, 7.0, xtol=1e-14), bicycle.STABLE[1], rtol=0, atol=1e-11)
