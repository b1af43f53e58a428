# SPDX-License-Identifier: BSD-2-Clause
"""Whether a step stays in its assembly mode does not depend on how it is divided."""

import pytest

from sst_pin import robots


@pytest.mark.parametrize("first", [1e-300, 1e-13, 0.3, 1 - 1e-13, 1.0])
def test_a_motion_that_does_nothing_is_continuous_to_its_end(first):
    chain = robots.five_bar()
    continuity = chain.engine.reference.context.continuity
    fraction, q = continuity.follow(chain.home, lambda q, low, high: q, 1e4, first)
    assert fraction == 1
    assert (q == chain.home).all()
