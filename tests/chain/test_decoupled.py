# SPDX-License-Identifier: BSD-2-Clause
"""The decoupled form of the natural orthogonal complement, K = N_l N_d."""

import numpy as np
import pytest

import sst_pin

ROBOTS = {
    "SST": sst_pin.SST,
    "hexaglide": sst_pin.robots.hexaglide,
    "planar 3-RRR": sst_pin.robots.planar_3rrr,
    "Stewart": sst_pin.robots.stewart,
}


@pytest.fixture(params=ROBOTS)
def chain(request):
    return ROBOTS[request.param]()


def test_the_product_of_the_decoupled_factors_is_K(chain):
    """Two ways to the twists: all joints at once, and from body to body."""
    terms = chain.noc(chain.home, np.ones(chain.degrees_of_freedom))
    assert np.abs(terms.N_l @ terms.N_d - terms.K).max() < 1e-13


def test_the_factors_are_lower_triangular_and_diagonal(chain):
    """In blocks of six: a body is moved by its own joint, and by the bodies that bear it."""
    terms = chain.noc(chain.home, np.zeros(chain.degrees_of_freedom))
    r = len(terms.N_l) // 6
    N_l = terms.N_l.reshape(r, 6, r, 6).swapaxes(1, 2)
    for i in range(r):
        assert np.array_equal(N_l[i, i], np.eye(6))
        assert not N_l[i, i + 1 :].any()
        joint = chain.model.joints[i + 1]
        own = np.arange(joint.idx_v, joint.idx_v + joint.nv)
        assert not np.delete(terms.N_d[6 * i : 6 * i + 6], own, axis=1).any()


def test_momenta_carried_backward_by_N_l_are_the_generalised_ones(chain):
    """The backward recursion: N_d^T N_l^T M t = K^T M t, here held against the inertia matrix."""
    va = np.linspace(-1, 1, chain.degrees_of_freedom)
    terms = chain.noc(chain.home, va)
    momenta = terms.N_d.T @ (terms.N_l.T @ (terms.M @ (terms.T @ va)))
    rotors = chain.model.armature * (terms.L @ va)
    carried = terms.L.T @ (momenta + rotors)
    assert np.abs(carried - terms.inertia @ va).max() < 1e-12 * np.abs(carried).max()
