# SPDX-License-Identifier: BSD-2-Clause
"""L near singular configurations, where redundant rows need care."""

import numpy as np
import pytest

from sst_pin import ClosedChain, Closure
from tests.support.planar_bars import planar

CRANK, COUPLER, ROCKER = 0.6, 0.5, 0.6


@pytest.mark.parametrize("bend", [1.0, 1e-2, 1e-4, 1e-5, 1e-6, 1e-7])
def test_rates_of_a_four_bar_near_its_dead_point_follow_the_law_of_sines(bend):
    """The coupler and the rocker, at an angle `bend`, are almost in line.

    The closure has a redundant row, out of the plane. The velocities of its point along and across
    the rocker give CRANK sin(crank - coupler) = rocker_rate ROCKER sin(rocker - coupler). The
    inverse loses the condition number times rounding, here about 1 / bend.
    """
    coupler = 0.4  # all angles are to the ground
    rocker = coupler + np.pi - bend
    tip = ROCKER * np.exp(1j * rocker) - COUPLER * np.exp(1j * coupler)
    ground = np.sqrt(CRANK**2 - tip.imag**2) - tip.real
    crank = np.angle(tip + ground)
    bars = [("crank", "universe", 0.0, CRANK), ("coupler", "crank", CRANK, COUPLER)]
    bars += [("rocker", "universe", ground, ROCKER)]
    chain = ClosedChain(planar(bars), [Closure("coupler_end", "rocker_end", "3d")], ["crank"])

    rates = chain.joint_rates(np.array([crank, coupler - crank, rocker]), [1.0])
    expected = CRANK * np.sin(crank - coupler) / (ROCKER * np.sin(rocker - coupler))
    assert rates[2] == pytest.approx(expected, rel=20 * np.finfo(float).eps / np.sin(bend))
