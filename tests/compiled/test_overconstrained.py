# SPDX-License-Identifier: BSD-2-Clause
"""Overconstrained loops: each choice of as many rows as rates is singular somewhere on the way."""

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import SST, robots
from sst_pin.dynamics.quantities import Quantity
from tests.gallery import ladder

#: Loops of one degree of freedom; the first one turns on without end.
LOOPS = {"Bennett": (robots.bennett, 2 * np.pi), "Bricard": (robots.bricard, 4)}


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOPS)
def test_loops_turn_far_by_kernels_and_follow_the_reference_path(name):
    """No kernel leaves a sample of a turn to the reference path, where all is regular."""
    make, turn = LOOPS[name]
    kernels, reference = make(), make()
    kernels.compile()
    q0 = kernels.generic_configuration()
    motion = kernels.simulate([0.0], q0, [10.0], np.linspace(0, 2, 101), rtol=1e-9, atol=1e-9)
    assert not motion.stopped
    assert np.ptp(motion.q[:, 0]) > turn
    q, va = motion.q, motion.va
    aa = np.random.default_rng(0).normal(size=va.shape)
    for ours, theirs in (
        (kernels.compute_torques, reference.compute_torques),
        (kernels.compute_accelerations, reference.compute_accelerations),
    ):
        expected = theirs(q, va, aa)
        key, result = Quantity(ours.__name__.removeprefix("compute_")), np.empty_like(expected)
        assert not len(kernels.engine.kernel(key).many((q, va, aa), result))
        # Condition numbers are below 1e3.
        assert np.allclose(result, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("build", [robots.bennett, robots.bricard, robots.agile_wrist, ladder, SST])
def test_redundant_rows_hold_where_loops_are_open_by_the_tolerance(build):
    """Loops as open as they may be break their redundant rows; this is no refusal."""
    chain, random = build(), np.random.default_rng(0)
    mechanism, q = chain.mechanism, chain.generic_configuration()
    model, va = mechanism.model, np.ones(chain.degrees_of_freedom)
    closed = chain.joint_rates(q, va)
    for _ in range(20):
        way = random.normal(size=model.nv) * mechanism.rate_scale
        gap = np.abs(chain.residual(pin.integrate(model, q, 1e-6 * way)) * mechanism.row_scale)
        aside = pin.integrate(model, q, 0.99e-12 / gap.max() * way)
        assert np.allclose(chain.joint_rates(aside, va), closed, rtol=1e-3, atol=1e-3)


def test_an_open_loop_is_refused_whichever_row_is_open():
    chain = robots.bennett()
    q = chain.generic_configuration()
    chain.compile()
    random, zero = np.random.default_rng(1), np.zeros(1)
    for _ in range(20):
        aside = q + 1e-5 * random.normal(size=3)
        assert chain.engine.torque_kernel(aside, zero, zero, None, None, 1) is None
