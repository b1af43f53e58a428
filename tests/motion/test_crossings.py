# SPDX-License-Identifier: BSD-2-Clause
"""Motions that go on through singular configurations, on the branch on which they come."""

import warnings

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
import standard_referees as referees
from sst_pin import robots


def through(chain, t, va, **options):
    """The motion from home without torques, without any warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return chain.simulate([0.0], chain.home, [va], t, through_singularities=True, **options)


@pytest.mark.parametrize(
    ("loops", "seconds"),
    [
        (1, 3.0),
        (2, 3.0),
        pytest.param(2, 20.0, marks=pytest.mark.slow),
    ],
)
def test_the_row_of_four_bars_turns_as_one_pendulum(loops, seconds):
    """A02: where all bars lie on one line, the closures lose a rank for each loop."""
    chain, t = robots.n_four_bar(loops), np.linspace(0, seconds, 31)
    if seconds > 3:
        chain.compile()
    motion = through(chain, t, -1.0)
    ends = np.stack([np.cos(motion.q[:, 0]), np.sin(motion.q[:, 0])], axis=1)
    # The error of a passage is 1e-10 of the rate; it adds up, and grows near the upright.
    assert np.abs(ends - referees.n_four_bar(loops, t)).max() < 5e-8
    regular = chain.condition_number(motion.q) < 500
    q, va = motion.q[regular], motion.va[regular]
    energy = chain.kinetic_energy(q, va) + chain.potential_energy(q)
    assert np.ptp(energy) < 1e-8 * energy[0]
    assert len(motion.crossings) >= 3
    for crossing in motion.crossings:
        assert (crossing.rank_before, crossing.rank) == (2 * loops, loops)
        assert abs(np.sin(crossing.q[0])) < 1e-9
        place = referees.n_four_bar(loops, np.array([0, crossing.time]))[-1]
        assert abs(place[1]) < 1e-7


def parallelogram(crank, ground):
    """Without weight."""
    model = pin.Model()
    at = {0.0: pin.SE3.Identity(), ground: pin.SE3(np.eye(3), np.array([ground, 0, 0]))}
    at[crank] = pin.SE3(np.eye(3), np.array([crank, 0, 0]))
    for name, on, place, length in (
        ("crank", 0, 0.0, crank),
        ("coupler", 1, crank, ground),
        ("rocker", 0, ground, crank),
    ):
        k = model.addJoint(on, pin.JointModelRZ(), at[place], name)
        lever = np.array([length / 2, 0, 0])
        model.appendBodyToJoint(k, pin.Inertia(1.0, lever, np.diag([0.01] * 3)), pin.SE3.Identity())
        end = pin.SE3(np.eye(3), np.array([length, 0, 0]))
        model.addFrame(pin.Frame(f"{name}_end", k, 0, end, pin.FrameType.OP_FRAME))
    model.gravity.linear = np.zeros(3)
    model.referenceConfigurations["home"] = np.array([0.7, -0.7, 0.7])
    return sst_pin.ClosedChain(
        model, [sst_pin.Closure("coupler_end", "rocker_end", "3d")], ["crank"]
    )


@pytest.mark.parametrize("count", [4, pytest.param(20, marks=pytest.mark.slow)])
def test_a_parallelogram_stays_one_from_any_start_with_any_tolerance(count):
    """Its coupler keeps its direction through both flat positions; its crank turns evenly."""
    random, stops = np.random.default_rng(0), 0
    for _ in range(count):
        chain = parallelogram(*random.uniform(0.2, 1.0, 2))
        start, rate = random.uniform(0.3, 2.8), random.uniform(0.5, 4) * random.choice([-1, 1])
        tolerance, t = 10 ** random.uniform(-12, -6), np.linspace(0, 2 * np.pi / abs(rate), 9)
        q0 = chain.assemble(start * np.array([1, -1, 1.0]))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            motion = chain.simulate(
                [0], q0, [rate], t, rtol=tolerance, atol=tolerance, through_singularities=True
            )
        stops += bool(caught)
        assert len(motion.crossings) == 2 or motion.stopped
        assert np.abs(np.sin((motion.q[:, 0] + motion.q[:, 1]) / 2)).max() < 100 * tolerance + 1e-9
        # A passage is exact to 1e-7 of the way over it.
        assert np.abs(motion.q[:, 0] - start - rate * motion.t).max() < 1e4 * tolerance + 1e-7
    assert stops <= count / 10  # it says so where the branch is not clear enough


def test_crossings_are_those_of_the_samples_chosen():
    chain = robots.n_four_bar(1)
    motion = through(chain, np.linspace(0, 1.0, 11), -1.0, rtol=1e-9, atol=1e-9)
    (crossing,) = motion.crossings
    assert motion[motion.t < crossing.time].crossings == ()
    assert motion[::5].crossings == (crossing,)


def test_a_motion_may_start_next_to_a_singular_configuration():
    chain = parallelogram(0.4, 0.7)
    for start in (1e-3, 1e-2):
        q0 = chain.assemble(start * np.array([1, -1, 1.0]))
        motion = chain.simulate([0], q0, [-1.0], [0, 1], through_singularities=True)
        assert not motion.stopped
        assert [crossing.time for crossing in motion.crossings] == [pytest.approx(start, abs=1e-9)]
        assert np.abs(motion.q[-1] - (start - 1) * np.array([1, -1, 1])).max() < 1e-9


@pytest.mark.parametrize("least", [1e-2, 1e-3, 1e-6])
def test_a_motion_that_turns_round_goes_through_nothing(least):
    """The crank comes to rest at a small angle and returns; too near, no branch is determined."""
    chain, start = parallelogram(0.4, 0.7), 0.3
    q0 = chain.assemble(start * np.array([1, -1, 1.0]))
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
