# SPDX-License-Identifier: BSD-2-Clause
"""The ankle that is designed in a minute."""

import time

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.support.derivative_cases import derivative
from tests.support.files import load

pytest.importorskip("matplotlib")
design = load("examples/design_ankle.py")


@pytest.mark.slow
def test_the_derivatives_of_the_example_are_differences():
    ankle, p = design.Ankle(), np.linspace(-4e-3, 4e-3, 10)
    _, by_tau, (condition, _), by_sizes = ankle.evaluate(p)
    apart = condition > 1.1  # singular values that meet have no derivatives
    assert apart.sum() >= 4
    for k in (0, 3, 9):

        def results(s, k=k):
            tau, _, sizes, _ = ankle.evaluate(p + s * (np.arange(10) == k))
            return np.append(tau, sizes[:, apart])

        slope = derivative(results, 1e-5)  # rounding: 1e-15 / 1e-5 of the torques
        exact = np.append(by_tau[..., k], by_sizes[:, apart, k])
        assert_allclose(exact, slope, rtol=1e-6, atol=1e-7 * np.abs(slope).max())


@pytest.mark.slow
def test_peak_and_ripple_fall_within_the_limits_in_a_minute():
    start, ankle = time.process_time(), design.Ankle()
    p = design.optimise(ankle)
    assert time.process_time() - start < 60
    before, after = ankle.evaluate(0 * p), ankle.evaluate(p)
    assert np.abs(after[0]).max() < 0.75 * np.abs(before[0]).max()
    assert design.ripple(after[0]) < 0.85 * design.ripple(before[0])
    condition, speed = after[2].max(axis=1)
    assert condition < design.CONDITION + 1e-3
    assert speed < design.SPEED + 1e-3
    assert np.abs(p).max() <= design.LARGEST
