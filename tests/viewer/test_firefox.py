# SPDX-License-Identifier: BSD-2-Clause
"""The page in a browser that is not Chromium."""

import io

import numpy as np
import pytest
from PIL import Image

import sst_pin
from browser import EXTENT
from firefox import firefox, needs_firefox
from sst_pin.viewer import Viewer

SIZE = (820, 1180)


#: Everything but the floor.
HIDE = """[...document.querySelectorAll("[data-layer]")].map((box) => box.dataset.layer)
  .filter((name) => name !== "floor").forEach((name) => stage.showLayer(name, false))"""


@pytest.mark.slow
@needs_firefox
def test_firefox_draws_all_of_the_robot_where_it_says(tmp_path):
    """What vanishes with its layers fills the box of its vertices, two pixels aside."""
    robot = sst_pin.robots.four_bar()
    viewer = Viewer(robot)
    viewer.play(robot.simulate([0.0], robot.home, [0.0], np.linspace(0, 0.15, 11)))
    viewer.save(tmp_path / "page.html")
    with firefox() as page:
        page.visit((tmp_path / "page.html").as_uri(), *SIZE)
        page.evaluate("viewer.set_3d_pane_size()")  # Meshcat's first frame may come late
        low, high = np.array(page.evaluate(f"({EXTENT})(['usual', 0])"))
        pane = page.evaluate("document.getElementById('pane').getBoundingClientRect()")
        drawn = picture(page)
        page.evaluate(HIDE)
        empty = picture(page)
    assert low.min() > -1
    assert high.max() < 1
    assert np.max(high - low) / 2 > 0.45
    rows, columns = np.nonzero(np.abs(drawn - empty).max(axis=2) > 60)  # shadows change less
    (left, right), (bottom, top) = np.stack([low, high], axis=1)
    wanted = [
        pane["x"] + (1 + np.array((left, right))) / 2 * pane["width"],
        pane["y"] + (1 - np.array((top, bottom))) / 2 * pane["height"],
    ]
    seen = [(x.min(), x.max() + 1) for x in (columns, rows)]
    assert np.abs(np.array(seen) - wanted).max() < 2.0


def picture(page):
    """What a page shows, once it has been drawn, shape (height, width, 3)."""
    page.evaluate("panel.still(0)")
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), dtype=int)
