# SPDX-License-Identifier: BSD-2-Clause
"""Matrices of vectors and twists, against Pinocchio and against moved frames."""

import numpy as np
import pinocchio as pin
import pytest

from sst_pin.loops import vectors

STEP = 1e-6
#: Of central differences of numbers of size one.
DIFFERENCES = 1e-9


@pytest.fixture
def random():
    return np.random.default_rng(3)


def placements(random, count):
    return [pin.SE3(pin.exp3(random.normal(size=3)), random.normal(size=3)) for _ in range(count)]


def test_a_placement_that_moves_with_a_twist_has_the_rate_of_hat(random):
    (M,) = placements(random, 1)
    t = random.normal(size=6)
    after = (pin.exp6(pin.Motion(STEP * t)) * M).homogeneous
    before = (pin.exp6(pin.Motion(-STEP * t)) * M).homogeneous
    rate = (after - before) / (2 * STEP)
    np.testing.assert_allclose(vectors.hat(t) @ M.homogeneous, rate, atol=DIFFERENCES)


def test_inverses_and_actions_of_many_placements_are_those_of_pinocchio(random):
    each = placements(random, 4)
    matrices = np.array([M.homogeneous for M in each])
    inverses = np.array([M.inverse().homogeneous for M in each])
    actions = np.array([M.action for M in each])
    np.testing.assert_allclose(vectors.inverse(matrices), inverses, atol=1e-14)
    np.testing.assert_allclose(vectors.action(matrices), actions, atol=1e-14)


def test_brackets_are_those_of_pinocchio(random):
    a, b = random.normal(size=(2, 6, 3))
    pairs = zip(a.T, b.T, strict=True)
    expected = np.array([pin.Motion(x).cross(pin.Motion(y)).vector for x, y in pairs]).T
    np.testing.assert_allclose(vectors.brackets(a, b), expected, atol=1e-14)
    by_matrices = np.array([vectors.bracket_matrix(x) @ y for x, y in zip(a.T, b.T, strict=True)])
    np.testing.assert_allclose(by_matrices.T, expected, atol=1e-14)


def test_the_rate_of_a_unit_vector_is_that_of_differences(random):
    d, d_dot = random.normal(size=(2, 3))
    after, before = vectors.unit(d + STEP * d_dot), vectors.unit(d - STEP * d_dot)
    rate = (after - before) / (2 * STEP)
    np.testing.assert_allclose(vectors.unit_rate(d, d_dot), rate, atol=DIFFERENCES)
