# SPDX-License-Identifier: BSD-2-Clause
"""Coulomb friction of joints whose rates are zero up to rounding."""

import numpy as np
import pytest

import sst_pin


@pytest.mark.parametrize("kernels", [True, False])
def test_joints_at_rest_have_no_coulomb_friction(kernels):
    """All motors alike at home: by symmetry beta_k rest, and mu_k turn by sqrt(2) each.

    So each motor needs F_c (1 + sqrt(2)) more than without friction; a sign of rounding would add
    F_c to some of them.
    """
    parameters = sst_pin.Parameters(coulomb_friction=0.3)
    rough = sst_pin.SST(parameters, kernels=kernels)
    bare = sst_pin.SST(kernels=kernels)
    motion = rough.home, [1, 1, 1], [0, 0, 0]
    v = rough.joint_rates(*motion[:2])
    assert np.abs(v[2::3]).max() < 1e-14
    found = rough.compute_torques(*motion) - bare.compute_torques(*motion)
    assert np.allclose(found, 0.3 * (1 + np.sqrt(2)), rtol=0, atol=1e-12)
