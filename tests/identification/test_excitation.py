# SPDX-License-Identifier: BSD-2-Clause
"""Motions that show parameters: within all limits, at rest at their ends, better than most."""

import numpy as np
import pytest

from sst_pin import ClosedChain, DescriptionWarning, InputError, coordinate_motion, robots
from sst_pin.identification import base_parameters, condition_number, excitation

CHAIN = robots.five_bar()
BASE = base_parameters(CHAIN)
LIMITS = {"rates": 2.0, "torques": 0.01, "harmonics": 3}


@pytest.fixture(scope="module")
def motion():
    return excitation(CHAIN, BASE, 3.0, tries=3, **LIMITS)


def test_limits_are_kept_between_the_samples_too(motion):
    between = coordinate_motion(CHAIN, motion.t[:-1] + 0.004, np.array(motion.q)[:-1, [0, 2]])
    for each in (motion, between):
        assert np.abs(each.va).max() <= 2.0 * 1.001
        assert np.abs(each.tau).max() <= 0.01 * 1.01
    assert np.abs(CHAIN.residual(motion.q)).max() < 1e-9


def test_it_begins_and_ends_at_rest_in_the_same_place(motion):
    np.testing.assert_allclose(motion.q[0], motion.q[-1], atol=1e-9)
    assert np.abs(motion.va[[0, -1]]).max() < 1e-4 * np.abs(motion.va).max()
    assert np.abs(motion.aa[[0, -1]]).max() < 1e-3 * np.abs(motion.aa).max()


def test_it_shows_parameters_better_than_sines_of_the_same_rates(motion):
    t = np.linspace(0, 3, 301)
    x = np.array(CHAIN.home)[[0, 2]] + 0.12 * np.sin(2 * np.pi / 3 * np.outer(t, [1, 2]))
    sines = coordinate_motion(CHAIN, t, x)
    assert condition_number(CHAIN, BASE, motion) < condition_number(CHAIN, BASE, sines)


def test_limits_that_nothing_keeps_are_refused():
    with pytest.raises(InputError, match="no motion about it stays within the limits"):
        excitation(CHAIN, BASE, 3.0, tries=1, torques=1e-6, harmonics=2)
    for wrong in ({"rates": 0.0}, {"rates": [1, 2, 3]}, {"harmonics": 1}, {"tries": 0}):
        with pytest.raises(InputError):
            excitation(CHAIN, BASE, 3.0, **wrong)


def test_a_start_that_nobody_chose_is_told():
    chain = ClosedChain(CHAIN.model, CHAIN.closures, CHAIN.motor_names)
    del chain.model.referenceConfigurations["home"]
    chain.refresh()
    with pytest.warns(DescriptionWarning, match="no configuration is named home"):
        excitation(chain, BASE, 3.0, tries=1, harmonics=2)


@pytest.mark.slow
def test_motions_that_meet_a_singular_configuration_between_the_samples_judged_are_left_out():
    """With these numbers the best of those judged cannot be followed in short steps."""
    motion = excitation(CHAIN, BASE, 5.0)
    assert len(motion) == 501
    assert np.abs(CHAIN.residual(motion.q)).max() < 1e-9
