# SPDX-License-Identifier: BSD-2-Clause
"""Least squares with the covariance of the solution, against NumPy and the normal equations."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin.identification.least_squares import solved


def test_the_solution_is_that_of_numpy_for_columns_of_any_size():
    random = np.random.default_rng(0)
    A = random.normal(size=(20, 3, 4)) * [1e-6, 1.0, 1e3, 1e6]
    z = random.normal(size=(20, 3))
    x, inverse = solved(A, z)
    rows = A.reshape(-1, 4)
    sizes = np.linalg.norm(rows, axis=0)
    expected = np.linalg.lstsq(rows / sizes, z.ravel(), rcond=None)[0]
    # The columns have a condition number of about one.
    assert_allclose(x * sizes, expected, atol=1e-12)
    covariance = (inverse @ inverse.T) * np.outer(sizes, sizes)
    normal = (rows / sizes).T @ (rows / sizes)
    assert_allclose(covariance @ normal, np.eye(4), atol=1e-12)


def test_dependent_columns_are_refused():
    A = np.ones((10, 2))
    with pytest.raises(sst_pin.InputError, match="does not show"):
        solved(A, np.zeros(10))
