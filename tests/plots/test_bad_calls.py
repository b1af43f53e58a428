# SPDX-License-Identifier: BSD-2-Clause
"""Figures refuse what they cannot show."""

import numpy as np
import pytest

import sst_pin
from tests.support.bad_calls import faults

plots = pytest.importorskip("sst_pin.plots", reason="extra `plot` is not installed")
CHAIN = sst_pin.robots.four_bar()
MOTION = CHAIN.simulate([0.0], CHAIN.home, [0.0], np.linspace(0, 0.01, 3))


def test_a_page_of_a_motion_refuses_bad_arguments():
    good = {"robot": CHAIN, "motion": MOTION, "subjects": ["torques"]}
    assert faults(plots.motion_page, good, {"frame"}) == []


def test_a_page_shows_subjects_of_a_motion_of_its_robot_with_two_samples():
    other = sst_pin.robots.five_bar()
    for call in ((CHAIN, MOTION, []), (CHAIN, MOTION[:1]), (other, MOTION)):
        with pytest.raises(sst_pin.SSTError):
            plots.motion_page(*call)
