# SPDX-License-Identifier: BSD-2-Clause
"""The regressor by kernels is that of the reference path, which takes what kernels refuse."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import any_chain
from any_chain import states
from sst_pin import ClosureError, robots
from sst_pin.chain.backend import Key

SLOW = pytest.mark.slow
CHAINS = {
    "a line and bodies without mass": robots.governor,
    "sprung": lambda: any_chain.sprung("RY"),
    "all joints": any_chain.cart,
    "delta": robots.delta,
}


@pytest.mark.parametrize(
    "name", [next(iter(CHAINS)), *(pytest.param(x, marks=SLOW) for x in [*CHAINS][1:])]
)
def test_kernels_compute_the_regressor_of_the_reference_path(name):
    plain, fast = CHAINS[name](), CHAINS[name]()
    fast.compile()
    motions = states(plain, 9, 1)
    Y, expected = fast.torque_regressor(*motions, threads=2), plain.torque_regressor(*motions)
    # Samples near singularities have condition numbers up to 1e4.
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert_allclose(Y / scale, expected / scale, atol=1e-11)
    rows = np.zeros((9, expected[0].size))
    left = fast._current.backend.kernel(Key("torque_regressor")).many(motions, rows)
    assert not len(left)
    assert_allclose(rows.reshape(Y.shape), Y, rtol=0, atol=1e-13 * scale.max())


def test_other_masses_need_no_new_kernel_and_open_loops_are_refused():
    chain = robots.four_bar()
    chain.compile()
    q, va, aa = states(chain, 5, 0)
    heavier = chain.with_parameters({"coupler.mass": 3.0, "rocker.coulomb": 0.2})
    Y = heavier.torque_regressor(q, va, aa)
    assert_allclose(Y, chain.torque_regressor(q, va, aa), rtol=1e-12, atol=1e-13)
    forces = heavier.generalized_forces(q, va, aa)
    assert_allclose(Y @ heavier.dynamic_parameters, forces, atol=1e-12)
    q[2, 0] += 0.1
    with pytest.raises(ClosureError):
        chain.torque_regressor(q, va, aa)
    assert np.isnan(chain.torque_regressor(q, va, aa, on_error="nan")[2]).all()
