# SPDX-License-Identifier: BSD-2-Clause
"""Torques of a spherical 3-RRR are those of MSC ADAMS."""

import numpy as np

from tests.gallery import adams_spherical_3rrr as adams


def test_torques_are_those_of_adams():
    """ADAMS gave sizes; its integration leaves 1e-3 N m, of a peak of 1.1."""
    off = np.abs(adams.torques()) - np.abs(adams.DATA["tau"])
    assert np.abs(adams.DATA["tau"]).max() > 1.09
    assert np.sqrt((off**2).mean()) < 3e-4
    assert np.abs(off).max() < 1e-3
