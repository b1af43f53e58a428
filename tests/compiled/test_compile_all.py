# SPDX-License-Identifier: BSD-2-Clause
"""`compile(all=True)`: no later call compiles, and a person who waits is told once."""

import logging

import numpy as np
import pytest

import sst_pin
from sst_pin.compiled import build


@pytest.mark.slow
def test_nothing_is_left_to_compile(tmp_path, monkeypatch, caplog):
    """Every method with a kernel, also with wrenches, leaves the cache as it is."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    chain = sst_pin.robots.four_bar()
    chain.compile(all=True)
    caplog.set_level(logging.INFO, logger="sst_pin")
    caplog.clear()
    q, zero = chain.home, np.zeros(1)
    for wrench in (None, np.zeros((chain.model.njoints - 1, 6))):
        load = {} if wrench is None else {"external_wrenches": wrench}
        tau = chain.compute_torques(q, zero, zero, **load)
        chain.generalized_forces(q, zero, zero, **load)
        chain.compute_accelerations(q, zero, tau, **load)
        chain.torque_derivatives(q, zero, zero, **load)
        chain.acceleration_derivatives(q, zero, tau, **load)
        chain.linearize(q, zero, tau, **load)
        chain.rollout(np.zeros((3, 1)), q, zero, 1e-3, **load)
        chain.simulate(tau, q, zero, np.linspace(0, 0.01, 3), **load)
    chain.joint_rates(q, zero)
    chain.joint_accelerations(q, zero, zero)
    chain.reduced_terms(q, zero)
    assert [record.getMessage() for record in caplog.records] == []


def test_a_person_who_waits_longer_than_a_second_is_told_once(tmp_path, monkeypatch, caplog):
    """Two kernels that take longer, one line; a quick one, none."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    build._tell.cache_clear()
    wait, source = build.time.sleep, "int zero(void) { return 0; }"
    for kernel, seconds in (("quick", 0), ("slow", 1.2), ("slower", 1.2)):
        build.library("bars", kernel, b"", "plain_one", lambda s=seconds: wait(s) or source)
    told = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
    assert told == ["sst-pin: compiling kernels of bars; the cache keeps them"]
