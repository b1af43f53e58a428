# SPDX-License-Identifier: BSD-2-Clause
"""Reactions and actuator Jacobians by kernels are those of the reference path."""

import numpy as np
import pytest

import any_chain
import sst_pin
from sst_pin import robots

CHAINS = {
    **{name: getattr(robots, name) for name in ("delta", "five_bar", "planar_4rrr", "ladder")},
    **{name: getattr(robots, name) for name in ("bennett", "bricard", "governor", "excavator")},
    "cart": any_chain.cart,
    "sst": sst_pin.SST,
    "rods": any_chain.rods,
    "coupled": any_chain.coupled,
    "composite": lambda: any_chain.with_joint("composite"),
    "motors on dependent joints": lambda: any_chain.chain(
        kind="hinge", coordinates=["arm_1", "arm_2"]
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "loaded"),
    [*((name, True) for name in CHAINS), *((name, False) for name in ("bennett", "cart", "sst"))],
)
def test_kernels_give_the_reactions_of_the_reference_path(name, loaded):
    """1e-11 of the largest: two ways of solving, with condition numbers up to 1e3."""
    chain = CHAINS[name]()
    q, va, _ = any_chain.states(chain, 5, 2)
    random = np.random.default_rng(1)
    tau = random.normal(size=(5, len(chain.motor_names)))
    loads = {}
    if loaded:
        loads["external_wrenches"] = random.normal(size=(5, chain.model.njoints - 1, 6))
    aa = chain.compute_accelerations(q, va, tau, **loads)
    J = chain.actuator_jacobian(q)
    rows = [chain._current.reference.reactions(*x) for x in samples(q, va, aa, tau, loads)]
    chain.compile()
    w = chain.reactions(q, va, tau=tau, **loads)
    assert chain.actuator_jacobian(q) == pytest.approx(J, rel=1e-11, abs=1e-11)
    assert "by the reference path" not in chain.path
    others = sst_pin.chain.reactions.unpacked(chain.mechanism, np.array(rows), False)
    assert np.array_equal(w.determined.joints, others.determined.joints)
    assert np.array_equal(w.determined.closures, others.determined.closures)
    largest = np.nanmax(np.abs(others.joints))
    for part in ("joints", "closures", "ground", "motors"):
        found, wanted = getattr(w, part), getattr(others, part)
        assert found == pytest.approx(wanted, abs=1e-11 * largest, nan_ok=True)


def samples(q, va, aa, tau, loads):
    load = loads.get("external_wrenches", [None] * len(q))
    return zip(q, va, aa, tau, load, strict=True)


@pytest.mark.slow
def test_batches_are_their_samples_in_any_array_and_with_any_number_of_threads():
    chain = robots.bennett()
    plain = list(any_chain.states(chain, 6, 1))
    wanted = chain.reactions(*plain)
    chain.compile()
    numbers = 7 * 4 + 6 + 1
    room = np.zeros((12, 2 * numbers))
    w = chain.reactions(*plain, out=room[::2, ::2])
    assert np.shares_memory(w.joints, room)
    many = chain.reactions(*(np.tile(x, (2, 500, 1)) for x in plain), threads=2)
    for found in (w.joints, many.joints[1, -6:], many.joints[0, :6]):
        assert found == pytest.approx(wanted.joints, abs=1e-11, nan_ok=True)
    assert np.array_equal(many.determined.joints[1, -6:], wanted.determined.joints)
    plain[0][2] += 0.3
    w = chain.reactions(*plain, on_error="nan")
    assert np.isnan(w.joints[2]).all()
    assert not w.determined.joints[2].any()
    assert w.joints[3] == pytest.approx(wanted.joints[3], abs=1e-11, nan_ok=True)
    assert chain.reactions(*(x[:0] for x in plain)).determined.joints.shape == (0, 3, 6)
