# SPDX-License-Identifier: BSD-2-Clause
"""Samples of a page: forces keep their impulse, and an effort has its numbers where it says."""

import numpy as np
from numpy.testing import assert_allclose

from sst_pin.viewer.page_samples import mean_forces, samples_of_page
from sst_pin.viewer.scene_parts import EffortLayout


def test_the_means_between_samples_keep_the_impulse():
    forces = np.random.default_rng(0).normal(size=(2000, 2, 3))  # of steps of one unit of time
    samples = samples_of_page(2001)
    means = mean_forces(forces, samples)
    assert len(means) == len(samples) < 2001
    durations = np.diff(samples)[:, None, None]
    # Sums of 2000 numbers of size one, rounded.
    assert_allclose((means[1:] * durations).sum(axis=0), forces.sum(axis=0), atol=1e-10)
    assert_allclose(means[0], forces[0])


def test_an_effort_has_each_force_where_the_layout_says():
    layout = EffortLayout(motors=2, reactions=3, contacts=1)
    random = np.random.default_rng(1)
    torques = random.normal(size=(4, 2))
    reactions = random.normal(size=(4, 3, 3))
    contacts = random.normal(size=(4, 1, 3))
    efforts = layout.efforts(torques, reactions, contacts)
    assert_allclose(efforts[:, :2], torques)
    for k in range(3):
        first = layout.reaction(k)
        assert_allclose(efforts[:, first : first + 3], reactions[:, k])
    first = layout.contact(0)
    assert_allclose(efforts[:, first : first + 3], contacts[:, 0])
    assert efforts.shape == layout.efforts(torques, None, None).shape
