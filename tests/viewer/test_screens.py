# SPDX-License-Identifier: BSD-2-Clause
"""The page on phones, tablets and desks: the robot fits, and hands find what they look for."""

import numpy as np
import pytest

import sst_pin
from sst_pin.sst import paper
from sst_pin.viewer import Viewer
from tests.support.browser import DESK, EXTENT, LYING, PHONE, TABLET, opened, with_slow

pytestmark = pytest.mark.slow


def example(name):
    if name == "sst":
        robot = sst_pin.SST()
        motion = paper.example_1(robot, np.linspace(0, paper.PERIOD, 21))
    else:
        robot = getattr(sst_pin.robots, name)()
        n = robot.degrees_of_freedom
        start = np.zeros(len(robot.motor_names)), robot.home, np.zeros(n)
        motion = robot.simulate(*start, np.linspace(0, 0.15, 11))
    viewer = Viewer(robot)
    viewer.play(motion, title=name)
    return viewer


MORE = {"scissor_lift": [PHONE], "planar_3rrr": [TABLET], "stewart": [PHONE]}


@pytest.mark.parametrize(
    ("name", "size"), with_slow(("four_bar", PHONE), sst=(PHONE, TABLET, DESK, LYING), **MORE)
)
def test_all_of_the_robot_is_in_the_picture(chromium, tmp_path, name, size):
    """At each instant, from each preset view; and it fills the picture one way at least.

    Filled is 0.9 of the width or height by points that lie farthest out over the whole motion;
    half of that may be another instant's.
    """
    with opened(chromium, example(name), tmp_path / "page.html", size) as page:
        pane = page.locator("#pane").bounding_box()
        assert pane["height"] > 0.45 * min(size[1], 600)
        assert pane["width"] > 0.45 * size[0]
        for view in ("usual", "front", "side", "top", "iso"):
            spans = []
            for share in (0, 0.6):
                low, high = np.array(page.evaluate(EXTENT, [view, share]))
                assert low.min() > -1, (view, share)
                assert high.max() < 1, (view, share)
                spans.append(np.max(high - low) / 2)
            assert max(spans) > 0.45, view


@pytest.mark.slow
def test_below_800_px_panes_are_stacked_and_words_are_for_fingers(chromium, tmp_path):
    viewer = example("four_bar")
    for size, stacked in ((PHONE, True), (DESK, False)):
        with opened(chromium, viewer, tmp_path / "page.html", size) as page:
            view, aside = (page.locator(part).bounding_box() for part in ("#view", "aside"))
            assert (aside["y"] >= view["y"] + view["height"]) == stacked
            assert (aside["x"] >= view["x"] + view["width"]) != stacked
            assert page.get_by_text("pinch to zoom").is_visible() == stacked
            assert page.get_by_text("wheel to zoom").is_visible() != stacked
            if stacked:  # the buttons lie above the robot, not on it
                buttons, pane = (page.locator(p).bounding_box() for p in ("#views", "#pane"))
                assert buttons["y"] + buttons["height"] <= pane["y"]
            across = "document.documentElement.scrollWidth <= innerWidth"
            assert page.evaluate(across)
