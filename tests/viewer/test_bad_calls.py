# SPDX-License-Identifier: BSD-2-Clause
"""The viewer refuses what it cannot draw."""

import numpy as np
import pytest

import sst_pin
from sst_pin.viewer import Viewer
from tests.support.bad_calls import faults

CHAIN = sst_pin.robots.four_bar()
MOTION = CHAIN.simulate([0.0], CHAIN.home, [0.0], np.linspace(0, 0.01, 3))
ARGUMENTS = {
    "show": {"q": CHAIN.home, "tau": np.ones(1)},
    "play": {"motion": MOTION, "speed": 1.0},
    "save": {"path": "a.html"},
    "serve": {"host": "127.0.0.1", "port": 0},
}


@pytest.mark.parametrize("name", ARGUMENTS)
def test_the_viewer_refuses_bad_arguments(name, here):
    (here / "file").write_text("in the way")
    assert faults(getattr(Viewer(CHAIN), name), ARGUMENTS[name], {"title"}) == []


def test_the_viewer_draws_robots_and_plays_their_motions():
    for robot in (None, "robot", 5):
        with pytest.raises(sst_pin.InputError, match="is not a robot"):
            Viewer(robot)
    with pytest.raises(sst_pin.InputError, match="another robot"):
        Viewer(sst_pin.robots.five_bar()).play(MOTION)
