# SPDX-License-Identifier: BSD-2-Clause
"""The picture of measured and predicted torques shows them and their difference."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sst_pin import InputError, coordinate_motion, plots, robots


@pytest.mark.parametrize("make", [robots.four_bar, robots.five_bar])
def test_a_row_of_each_motor_shows_both_and_the_difference(make):
    chain, t = make(), np.linspace(0, 1, 21)
    x = np.array([chain.home[chain.position_names.index(name)] for name in chain.coordinates])
    motion = coordinate_motion(chain, t, x + 0.1 * np.sin(t)[:, None])
    page = plots.torques_page(motion, 0.5 * motion.tau)
    assert len(page.axes) == len(chain.motor_names)
    for ax, tau in zip(page.axes, motion.tau.T, strict=True):
        drawn = {line.get_label(): line.get_ydata() for line in ax.lines[1:]}
        assert_array_equal(drawn["measured"], tau)
        assert_array_equal(drawn["predicted"], 0.5 * tau)
        assert_array_equal(drawn["difference"], 0.5 * tau)
    with pytest.raises(InputError, match="predicted"):
        plots.torques_page(motion, motion.tau[1:])
