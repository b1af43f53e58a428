# SPDX-License-Identifier: BSD-2-Clause
"""Whether standard deviations of estimates are those of their errors."""

import numpy as np

#: Runs, each with another noise. With as many, deviations that are a fourth too small, or twice
#: as large as they should be, fail.
RUNS = 40


def assert_deviations_are_those_of_errors(ratios):
    """Errors over their standard deviations, shape (runs, errors), are standard normal numbers.

    The deviations must be those for the true noise. The mean square of one error in k runs has a
    standard deviation of sqrt(2 / k); the mean of those of several errors has no larger one.
    """
    z = np.array(ratios)
    assert abs(np.mean(z**2) - 1) < 3 * np.sqrt(2 / len(z))
    assert np.mean((np.abs(z) < 3).all(axis=1)) >= 0.95
