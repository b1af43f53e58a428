# SPDX-License-Identifier: BSD-2-Clause
"""Motions that go on through singular configurations, on the branch on which they come."""

import warnings

import numpy as np
import pytest

import sst_pin
from sst_pin.simulation.motion_output import MotionOutput
from sst_pin.simulation.singularity_crossing import SingularityCrossing
from tests.support.planar_bars import planar


def parallelogram():
    """Without weight."""
    bars = [("crank", "universe", 0.0, 0.4), ("coupler", "crank", 0.4, 0.7)]
    model = planar([*bars, ("rocker", "universe", 0.7, 0.4)])
    model.gravity.linear = np.zeros(3)
    model.referenceConfigurations["home"] = np.array([0.7, -0.7, 0.7])
    closure = sst_pin.Closure("coupler_end", "rocker_end", "3d")
    return sst_pin.ClosedChain(model, [closure], ["crank"])


@pytest.mark.parametrize("kind", ["3d", "hinge"])  # one redundant row, or three
def test_a_kite_passes_where_two_joints_meet(kind):
    """Ground and crank, coupler and rocker are equal: at crank angle zero the crank's end meets
    the rocker's pivot, and coupler and rocker could turn together about it, but do not."""
    a, b = 0.5, 0.8
    bars = ("crank", "universe", 0.0, a), ("coupler", "crank", a, b), ("rocker", "universe", a, b)
    closure = sst_pin.Closure("coupler_end", "rocker_end", kind)
    chain = sst_pin.ClosedChain(planar(bars), [closure], ["crank"])

    def kite(crank):
        top = a * np.cos(crank / 2) + np.sqrt(b**2 - (a * np.sin(crank / 2)) ** 2)
        x, y = top * np.cos(crank / 2), top * np.sin(crank / 2)
        coupler = np.arctan2(y - a * np.sin(crank), x - a * np.cos(crank)) - crank
        return np.stack([crank, coupler, np.arctan2(y, x - a)], axis=-1)

    t, start = np.linspace(0, 0.3, 7), chain.assemble(kite(1.4))
    motion = chain.simulate([0.0], start, [-12.0], t, through_singularities=True)
    assert np.abs(motion.q - kite(motion.q[:, 0])).max() < 1e-9
    energy = chain.kinetic_energy(motion.q, motion.va) + chain.potential_energy(motion.q)
    assert np.ptp(energy) < 1e-8 * chain.kinetic_energy(start, [-12.0])
    assert len(motion) == 7
    assert [np.abs(crossing.q).max() < 1e-9 for crossing in motion.crossings] == [True]


def test_a_motion_may_start_next_to_a_singular_configuration():
    chain = parallelogram()
    for start in (1e-3, 1e-2):
        q0 = chain.assemble(start * np.sign(chain.home))
        motion = chain.simulate([0], q0, [-1.0], [0, 1], through_singularities=True)
        assert not motion.stopped
        assert [crossing.time for crossing in motion.crossings] == [pytest.approx(start, abs=1e-9)]
        assert np.abs(motion.q[-1] - (start - 1) * np.sign(chain.home)).max() < 1e-9


@pytest.mark.parametrize("least", [1e-3, 1e-6])
def test_a_motion_that_turns_round_goes_through_nothing(least):
    """The crank comes to rest at a small angle and returns; too near, no branch is determined."""
    chain, start = parallelogram(), 0.3
    q0 = chain.assemble(start * np.sign(chain.home))
    push = 1 / 2 / (start - least)
    tau, t = chain.compute_torques(q0, [0.0], [push]), np.linspace(0, 2 / push, 11)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        motion = chain.simulate(tau, q0, [-1.0], t, through_singularities=True)
    assert motion.crossings == ()
    if least > 1e-4:
        assert not caught
        assert np.abs(motion.q[:, 0] - (start - t + push * t**2 / 2)).max() < 1e-8
    else:
        assert "singularity" in motion.stopped
        assert len(caught) == 1
    assert np.abs(motion.q[:, 0] + motion.q[:, 1]).max() < 1e-9


def test_a_singular_configuration_is_expected_from_the_configuration_at_its_own_time(monkeypatch):
    """Also after a step in which the loops cannot be closed at an output time."""
    refused: list[float] = []
    pairs: list[tuple[float, np.ndarray]] = []
    add_step = MotionOutput.add_step
    begin_approach = SingularityCrossing.begin_approach

    def refuses_once(output, step, **options):
        if not refused and step.start > 0.1:
            refused.append(step.start)
            return False
        return add_step(output, step, **options)

    def recorded(crossing, state, t, q):
        pairs.append((t, q))
        return begin_approach(crossing, state, t, q)

    monkeypatch.setattr(MotionOutput, "add_step", refuses_once)
    monkeypatch.setattr(SingularityCrossing, "begin_approach", recorded)
    chain = parallelogram()
    q0 = chain.assemble(0.5 * np.sign(chain.home))
    motion = chain.simulate([0], q0, [-1.0], [0, 0.4], through_singularities=True)
    assert refused
    assert not motion.stopped
    # Without weight and torque, all bars turn with the rate of the crank, -1 rad/s.
    for t, q in pairs:
        assert np.abs(q - (0.5 - t) * np.sign(chain.home)).max() < 1e-6
