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


@pytest.mark.parametrize("subjects", [[], (), [None], 5, "torques", [["torques"]], ["torque"]])
def test_subjects_of_a_page_are_names_that_are_known(subjects):
    with pytest.raises(sst_pin.SSTError):
        plots.motion_page(CHAIN, MOTION, subjects)


@pytest.mark.parametrize("motion", [MOTION[:1], "five-bar"])
def test_a_page_shows_a_motion_of_its_robot_with_two_samples(motion):
    robot = sst_pin.robots.five_bar() if motion == "five-bar" else CHAIN
    motion = MOTION if motion == "five-bar" else motion
    with pytest.raises(sst_pin.SSTError):
        plots.motion_page(robot, motion)


@pytest.mark.parametrize("path", ["a.jpg", "a.csv", "a", b"a.png"])
def test_a_picture_has_an_ending_that_is_known(path):
    with pytest.raises(sst_pin.SSTError):
        plots.picture_kind(path)
