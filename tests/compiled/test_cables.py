# SPDX-License-Identifier: BSD-2-Clause
import numpy as np
import pytest

import sst_pin
from sst_pin import LineForce
from tests.gallery.touching import PLANAR, frame, planar


@pytest.mark.slow
def test_kernels_know_which_cables_are_slack():
    """A mass on two cables that only pull, many states; the reference path is the referee."""
    model = planar(1.0, 0.01)
    frame(model, "mass", "turn", (0, 0, 0.1))
    cables = []
    for name, x in (("left", -1.0), ("right", 1.0)):
        frame(model, name, "universe", (x, 0, 0))
        numbers = {"stiffness": 50.0, "rest_length": 1.0, "damping": 0.2, "preload": 1.0}
        cables.append(LineForce(name, "mass", pulls_only=True, **numbers))
    slow = sst_pin.ClosedChain(model, [], [], coordinates=PLANAR, lines=cables)
    fast = sst_pin.ClosedChain(model, [], [], coordinates=PLANAR, lines=cables)
    fast.compile()
    q, va, aa = np.random.default_rng(0).normal(size=(3, 100, 3)) * [[[0.3]], [[1]], [[1]]]
    f = slow.generalized_forces(q, va, aa)
    assert np.abs(fast.generalized_forces(q, va, aa) - f).max() < 1e-12
    names = ("reduced_terms", (va,)), ("torque_derivatives", (va, aa))
    for name, arguments in names:
        pairs = zip(
            getattr(slow, name)(q, *arguments), getattr(fast, name)(q, *arguments), strict=True
        )
        assert all(np.abs(a - b).max() < 1e-12 for a, b in pairs)
    Y = fast.torque_regressor(q, va, aa)
    assert np.abs(Y @ slow.dynamic_parameters.values - f).max() < 1e-12
    at_rest = slow.reduced_terms(q, 0 * va).gravity
    for i, step in enumerate(1e-6 * np.eye(3)):
        slope = (slow.potential_energy(q + step) - slow.potential_energy(q - step)) / 2e-6
        assert np.abs(slope + at_rest[:, i]).max() < 1e-6  # the square of the step, and rounding
    lengths = slow.line_lengths(q)
    assert 20 < (lengths < 0.98).sum() < 180  # slack and taut cables are among them
