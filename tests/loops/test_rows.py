# SPDX-License-Identifier: BSD-2-Clause
"""Rows of closures where vectors have no direction."""

import numpy as np
import pinocchio as pin

from sst_pin.loops.loops import Loops
from sst_pin.model.closures import Distance
from tests.support.by_hand import add, at, mark


def test_the_error_of_a_rod_whose_ends_coincide_is_its_length():
    model = pin.Model()
    slide = add(model, 0, pin.JointModelPX(), "slide", at(), pin.Inertia.Zero())
    mark(model, slide, "end", at())
    loops = Loops(model, [Distance("universe", "end", 0.4)])
    loops.evaluate(np.zeros(1))
    assert loops.f.tolist() == [-0.4]
    loops.evaluate(np.array([0.1]))
    np.testing.assert_allclose(loops.f, -0.3, rtol=1e-15)
