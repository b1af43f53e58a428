# SPDX-License-Identifier: BSD-2-Clause
"""Figures refuse what they cannot show."""

import numpy as np
import pytest

import sst_pin
from tests.support.bad_calls import faults

plots = pytest.importorskip("sst_pin.plots", reason="extra `plot` is not installed")
Figure = pytest.importorskip("matplotlib.figure").Figure
CHAIN = sst_pin.robots.four_bar()
MOTION = CHAIN.simulate([0.0], CHAIN.home, [0.0], np.linspace(0, 0.01, 3))


def test_a_page_of_a_motion_refuses_bad_arguments():
    good = {"robot": CHAIN, "motion": MOTION, "subjects": ["torques"]}
    assert faults(plots.motion_page, good, {"frame"}) == []


def test_a_page_shows_subjects_of_a_motion_of_its_robot_with_two_samples():
    other = sst_pin.robots.five_bar()
    for call, message in (
        ((CHAIN, MOTION, []), "subjects"),
        ((CHAIN, MOTION[:1]), "one sample"),
        ((other, MOTION), "another robot"),
    ):
        with pytest.raises(sst_pin.InputError, match=message):
            plots.motion_page(*call)


DRAWN = {
    "motor_torques": plots.motor_torques,
    "joint_angles": plots.joint_angles,
    "torques_page": lambda _, x: plots.torques_page(x, MOTION.tau),
    "paths_on_sphere": lambda ax, x: plots.paths_on_sphere(ax, sst_pin.SST(), x),
    "paths_on_sphere, a path": lambda ax, x: plots.paths_on_sphere(ax, sst_pin.SST(), [("a", x)]),
    "reach_map": plots.reach_map,
    "tolerance_shares": plots.tolerance_shares,
    "convex_set": plots.convex_set,
}


@pytest.mark.parametrize("name", DRAWN)
@pytest.mark.parametrize(
    "value", [None, 5, "x", CHAIN, np.zeros(3)], ids=lambda x: type(x).__name__
)
def test_what_is_not_of_the_kind_that_is_drawn_is_refused(name, value):
    ax = Figure().add_subplot()
    with pytest.raises(sst_pin.InputError, match=r"^(motion|motions|poses|tolerances|shape): "):
        DRAWN[name](ax, value)
