# SPDX-License-Identifier: BSD-2-Clause
"""Estimates from noisy torques, and the standard deviations that they claim."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sst_pin import ClosedChain, InputError, robots
from sst_pin.identification import (
    base_parameters,
    condition_number,
    estimate,
    predicted_torques,
    random_states,
    report,
)

MAKE = {"five_bar": robots.five_bar, "more motors than freedoms": robots.planar_4rrr}


@cache
def case(name, count=80):
    """A robot with friction in its motors, base parameters, a motion and its torques."""
    chain = MAKE[name]()
    friction = {f"{motor}.viscous": 0.1 for motor in chain.motor_names}
    chain = chain.with_parameters(friction)
    motion = random_states(chain, count, 3)
    return chain, base_parameters(chain), motion, chain.compute_torques(*motion)


@pytest.mark.parametrize("decimate", [1, 4])
@pytest.mark.parametrize("name", MAKE)
def test_torques_without_noise_give_the_parameters(name, decimate):
    """Filtered or not: both sides of the equations are filtered alike."""
    chain, base, motion, tau = case(name)
    found = estimate(chain, base, *motion, tau, decimate=decimate)
    true = base.matrix @ chain.dynamic_parameters
    assert_allclose(found.values, true, rtol=1e-7, atol=1e-9 * np.abs(true).max())
    assert (found.noise < 1e-8 * np.abs(tau).max()).all()


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("five_bar", {"robust": False}),
        *(
            pytest.param(*more, marks=pytest.mark.slow)
            for more in [
                ("five_bar", {"robust": True}),
                ("five_bar", {"decimate": 2}),
                ("more motors than freedoms", {"robust": False}),
                ("more motors than freedoms", {"robust": True}),
            ]
        ),
    ],
)
def test_values_are_within_their_standard_deviations(name, options):
    """A normal distribution has 68 % within one, 99.7 % within three."""
    chain, base, motion, tau = case(name)
    true = base.matrix @ chain.dynamic_parameters
    sizes = np.array([0.01, 0.05]) if name == "five_bar" else 0.02
    missed = []
    for seed in range(30):
        noise = np.random.default_rng(seed).normal(size=tau.shape) * sizes
        found = estimate(chain, base, *motion, tau + noise, **options)
        if "decimate" not in options:  # the filter takes noise away
            assert_allclose(found.noise, np.full(tau.shape[1], sizes), rtol=0.5)
        missed.append(np.abs(found.values - true) / found.deviations)
    assert 0.58 < np.mean(np.array(missed) < 1) < 0.78
    assert np.mean(np.array(missed) < 3) > 0.98


def test_friction_that_depends_on_the_direction_is_found():
    """Forwards 0.3 N m, back 0.1 N m: the mean is Coulomb's, half the difference an offset."""
    chain, _, motion, tau = case("five_bar")
    first = chain.motor_names[0]
    forwards = motion[1][:, 0] > 0
    tau = tau + np.column_stack([np.where(forwards, 0.3, -0.1), np.zeros(len(tau))])
    names = [f"{first}.coulomb", f"{first}.offset"]
    base = base_parameters(chain, ["*.m*", "*.i*", "*.viscous", *names])
    found = dict(zip(base.names, estimate(chain, base, *motion, tau).values, strict=True))
    assert_allclose([found[name] for name in names], [0.2, 0.1], rtol=1e-6)


def test_outliers_count_less_in_a_robust_estimate():
    chain, base, motion, tau = case("five_bar")
    true, random = base.matrix @ chain.dynamic_parameters, np.random.default_rng(0)
    noisy = tau + 0.01 * random.normal(size=tau.shape)
    noisy[random.integers(len(tau), size=6)] += 20.0
    plain, robust = (estimate(chain, base, *motion, noisy, robust=x) for x in (False, True))
    assert np.abs(robust.values - true).max() < 0.05 * np.abs(plain.values - true).max()
    assert (np.abs(robust.values - true) < 5 * robust.deviations).all()


def test_parameters_that_are_not_considered_keep_their_values():
    chain, _, motion, tau = case("five_bar")
    friction = base_parameters(chain, ["*.viscous"])
    found = estimate(chain, friction, *motion, tau)
    assert_allclose(found.values, friction.matrix @ chain.dynamic_parameters, atol=1e-9)


def test_the_report_marks_what_the_data_do_not_support():
    chain, _, motion, tau = case("five_bar")
    base = base_parameters(chain, ["*.viscous", "shoulder_1.coulomb"])
    noise = 0.01 * np.random.default_rng(2).normal(size=tau.shape)
    found = estimate(chain, base, *motion, tau + noise)
    shown = dict(zip(base.names, found.supported, strict=True))
    assert shown["shoulder_1.viscous"]
    assert not shown["shoulder_1.coulomb"]
    assert str(found).count("not supported") == np.sum(~found.supported)


def test_bad_measurements_are_refused():
    chain, base, (q, va, aa), tau = case("five_bar")
    with pytest.raises(InputError, match="tau"):
        estimate(chain, base, q, va, aa, tau[:-1])
    with pytest.raises(InputError, match="tau"):
        estimate(chain, base, q, va, aa, np.full_like(tau, np.nan))
    with pytest.raises(InputError, match="too few"):
        estimate(chain, base, q[:3], va[:3], aa[:3], tau[:3])
    with pytest.raises(InputError, match="does not show"):
        estimate(chain, base, q, 0 * va, 0 * aa, tau)


@pytest.mark.parametrize("name", ["predicted_torques", "report", "condition_number"])
def test_the_motion_of_another_robot_is_refused(name):
    """Its motors stand in the other order: the same joints, rates and torques in other columns."""
    chain, base, states, tau = case("five_bar")
    found, theta = estimate(chain, base, *states, tau), chain.dynamic_parameters
    motion = chain.trajectory(np.arange(len(tau)), *states)
    uses = {
        "predicted_torques": lambda robot: predicted_torques(robot, theta, motion),
        "report": lambda robot: report(robot, found, theta, motion),
        "condition_number": lambda robot: condition_number(robot, base, motion),
    }
    uses[name](chain)
    other = ClosedChain(chain.model, chain.closures, chain.motor_names[::-1])
    with pytest.raises(InputError, match="belongs to another robot"):
        uses[name](other)
