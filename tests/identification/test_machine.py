# SPDX-License-Identifier: BSD-2-Clause
"""The machine of examples/sst_identification.py, simulated by MuJoCo: honest errors."""

import numpy as np
import pytest

pytest.importorskip("mujoco")
import sst_identification as example


@pytest.mark.slow
def test_the_parameters_of_the_machine_are_within_their_intervals_and_predict_another_motion():
    """The drawn robot is 20 % too light and has no friction; by itself it misses by far more."""
    result = example.identified(2, duration=3.0, tries=1)
    assert (np.abs(result.missed) < 3).mean() > 0.93
    assert (result.unseen < 1.5 * result.least).all()
    assert (result.least < 1.3 * result.noise).all()
