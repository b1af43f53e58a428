# SPDX-License-Identifier: BSD-2-Clause
"""Overconstrained loops: each choice of as many rows as rates is singular somewhere on the way."""

import numpy as np
import pytest
from overconstrained import LOOPS

from sst_pin.chain.backend import Key

#: These meet singular configurations on their way.
STOPPING = {
    "threefold Bricard",
    "another threefold Bricard",
    "line-symmetric Bricard",
    "Sarrus",
    "right-angled Sarrus",
}
TURNING = [
    pytest.param(name, marks=() if name == "Bennett" else pytest.mark.slow)
    for name in LOOPS
    if name not in STOPPING
]


@pytest.mark.parametrize("name", TURNING)
def test_loops_turn_fully_by_kernels_and_follow_the_reference_path(name):
    """No kernel leaves a sample of a full turn to the reference path, where all is regular."""
    kernels, reference = LOOPS[name](), LOOPS[name]()
    q0 = kernels.generic_configuration()
    kernels.compile()
    motion = kernels.simulate([0.0], q0, [3.0], np.linspace(0, 8, 101), rtol=1e-9, atol=1e-9)
    assert not motion.stopped
    assert np.ptp(motion.q[:, 0]) > 2 * np.pi
    q, va = motion.q, motion.va
    aa = np.random.default_rng(0).normal(size=va.shape)
    for ours, theirs in (
        (kernels.compute_torques, reference.compute_torques),
        (kernels.compute_accelerations, reference.compute_accelerations),
    ):
        expected = theirs(q, va, aa)
        key, result = Key(ours.__name__.removeprefix("compute_")), np.empty_like(expected)
        assert not len(kernels._current.backend.kernel(key).many((q, va, aa), result))
        # Condition numbers are below 1e3.
        assert np.allclose(result, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(STOPPING))
def test_loops_stop_where_they_are_singular(name):
    chain = LOOPS[name]()
    q0 = chain.generic_configuration()
    chain.compile()
    with pytest.warns(match="before a singularity"):
        motion = chain.simulate([0.0], q0, [3.0], np.linspace(0, 4, 20001), rtol=1e-9, atol=1e-9)
    assert chain.condition_number(motion.q[-1]) > 100


def test_an_open_loop_is_refused_whichever_row_is_open():
    chain = LOOPS["Bennett"]()
    q = chain.generic_configuration()
    chain.compile()
    random, zero = np.random.default_rng(1), np.zeros(1)
    for _ in range(20):
        aside = q + 1e-5 * random.normal(size=3)
        assert chain._current.torques_of(aside, zero, zero, None, None, 1) is None
