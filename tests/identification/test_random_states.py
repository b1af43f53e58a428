# SPDX-License-Identifier: BSD-2-Clause
"""Random states keep limits that a configuration nearby can keep."""

from importlib import import_module

import numpy as np
import pytest

from sst_pin.identification import random_states
from tests.gallery.cylinder_boom import cylinder_boom


@pytest.mark.parametrize("angle", [-0.2, 0.9])
def test_random_states_are_within_limits(angle):
    """Home is within the stroke, then far outside it; the stroke is a tenth of the boom."""
    low, high = 0.85, 0.95
    q, _, _ = random_states(cylinder_boom(angle, (low, high)), 30)
    assert q[:, 2].min() > low - 1e-9
    assert q[:, 2].max() < high + 1e-9
    assert np.ptp(q[:, 2]) > (high - low) / 2


def test_limits_that_no_configuration_keeps_do_not_hinder_random_states():
    """The cylinder is at least 0.3 m long."""
    q, _, _ = random_states(cylinder_boom(-0.2, (0.0, 0.1)), 5)
    assert q[:, 2].min() > 0.1


def test_robots_with_large_condition_numbers_move_into_their_limits_too(monkeypatch):
    """With a bound of 1 every condition number is large; home is far outside the stroke."""
    monkeypatch.setattr(import_module("sst_pin.identification.random_states"), "_REGULAR", 1.0)
    q, _, _ = random_states(cylinder_boom(0.9, (0.85, 0.95)), 5)
    assert q[:, 2].max() < 0.95 + 1e-9
    assert q[:, 2].min() > 0.85 - 1e-9
