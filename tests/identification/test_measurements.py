# SPDX-License-Identifier: BSD-2-Clause
"""Motions that show parameters, within their limits, and logs as motions, as they were."""

import warnings
from contextlib import nullcontext, suppress

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from sst_pin import (
    ClosedChain,
    DescriptionWarning,
    InputError,
    LineForce,
    coordinate_motion,
    robots,
)
from sst_pin.identification import base_parameters, condition_number, excitation, measured_motion

T = np.linspace(0, 6, 3001)
CHAIN = robots.five_bar()
HOME = np.array([CHAIN.home[CHAIN.position_names.index(name)] for name in CHAIN.coordinates])
AMPLITUDE, RATE = np.array([0.2, 0.1]), np.array([3.0, 5.0])
X = HOME + AMPLITUDE * np.sin(RATE * T[:, None])
TAU = np.cos(RATE * T[:, None])


def test_rates_and_accelerations_are_those_of_the_motion():
    motion = measured_motion(CHAIN, T, X, TAU, cutoff=15)
    t = motion.t[:, None]
    assert_allclose(motion.va, AMPLITUDE * RATE * np.cos(RATE * t), atol=2e-3)
    assert_allclose(motion.aa, -AMPLITUDE * RATE**2 * np.sin(RATE * t), atol=0.1)
    assert_allclose(motion.tau, np.cos(RATE * t), atol=1e-3)
    assert np.abs(CHAIN.residual(motion.q)).max() < 1e-9
    assert np.diff(motion.t) == pytest.approx(1 / 30, rel=0.01)


def test_encoder_steps_noise_jitter_and_outliers_leave_the_motion():
    rng = np.random.default_rng(1)
    t = T + rng.uniform(-4e-4, 4e-4, T.size)
    t[[0, -1]] = T[[0, -1]]
    x = np.round((HOME + AMPLITUDE * np.sin(RATE * t[:, None])) / 2e-4) * 2e-4
    tau = np.cos(RATE * t[:, None]) + 0.02 * rng.normal(size=TAU.shape)
    x[[700, 1500, 1501]] += 1.0
    tau[[900, 2000]] -= 30.0
    motion = measured_motion(CHAIN, t, x, tau, cutoff=15)
    at = motion.t[:, None]
    assert_allclose(motion.va, AMPLITUDE * RATE * np.cos(RATE * at), atol=0.02)
    assert_allclose(motion.tau, np.cos(RATE * at), atol=0.03)


def test_torques_that_jump_are_no_outliers_and_those_replaced_are_counted():
    """Dry friction reverses five times a second; two readings of the sensor are wrong."""
    friction = np.sign(np.sin(10 * np.pi * T))[:, None] * [1.0, 2.0]
    tau = friction + 0.02 * np.random.default_rng(2).normal(size=TAU.shape)
    peak = 5 * np.exp(-(((T - 3.21) / 0.01) ** 2))
    tau[:, 1] += peak
    log = {"t": T, "x": X, "cutoff": 15, "decimate": 10}
    good = measured_motion(CHAIN, tau=tau, **log)
    assert good.replaced == {}
    bad, x = tau.copy(), X.copy()
    bad[[900, 2000], 1] -= 30.0
    x[1500] += 1.0
    motion = measured_motion(CHAIN, tau=bad, **log | {"x": x})
    assert motion.replaced == motion[10:20].replaced
    assert motion.replaced.keys() == {*CHAIN.coordinates, "torque of shoulder_2"}
    assert motion.replaced["torque of shoulder_2"] == 2
    assert_allclose(motion.tau, good.tau, atol=0.1)


def test_a_log_with_many_wrong_torques_is_refused_as_one_with_many_wrong_positions():
    random, tau = np.random.default_rng(0), TAU.copy()
    at = random.choice(np.arange(100, 2900), 300, replace=False)
    tau[at, 0] += 9.0 * random.choice([-1, 1], 300)
    with pytest.raises(InputError, match=r"^tau: \d+ of \d+ samples of torque of shoulder_1 are"):
        measured_motion(CHAIN, T, X, tau, cutoff=10)


def test_an_encoder_that_begins_anew_at_each_turn_gives_the_same_motion():
    model = pin.Model()
    for k, joint in enumerate((pin.JointModelRUBZ(), pin.JointModelRX())):
        model.addJoint(k, joint, pin.SE3.Identity(), f"joint_{k}")
        model.appendBodyToJoint(k + 1, pin.Inertia.Random(), pin.SE3.Identity())
    wheel = ClosedChain(model, [], ["joint_0", "joint_1"])
    x = np.column_stack([2 * T + 4 * np.sin(T), 4 * np.sin(T)])
    jumping = np.column_stack([x[:, 0] % (2 * np.pi), x[:, 1]])
    jumping[700, 0] += 4.0
    start = pin.neutral(model)
    arguments = {"tau": TAU, "cutoff": 15, "start": start}
    one, other = (measured_motion(wheel, T, log, **arguments) for log in (x, jumping))
    assert_allclose(one.va[:, 0], 2 + 4 * np.cos(one.t), atol=2e-3)
    assert_allclose(other.va, one.va, atol=0.02)
    assert_allclose(other.q, one.q, atol=1e-3)


def test_a_frequency_above_the_cutoff_is_gone_and_one_below_is_not_late():
    fast = X + 0.01 * np.sin(2 * np.pi * 100 * T)[:, None]
    motion = measured_motion(CHAIN, T, fast, TAU, cutoff=15)
    slow = measured_motion(CHAIN, T, X, TAU, cutoff=15)
    assert_allclose(motion.va[3:-3], slow.va[3:-3], atol=1e-3)  # of 6.3 rad/s that were added
    assert_allclose(motion.va, slow.va, atol=0.02)  # the filter knows nothing beyond the ends


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"cutoff": 300}, "cutoff"),
        ({"cutoff": 1}, "cutoff"),
        ({"t": T[::-1]}, "t"),
        ({"decimate": 34}, "the log has 500 in 1 s: at most 33"),
    ],
)
def test_what_cannot_be_filtered_is_refused(change, problem):
    with pytest.raises(InputError, match=problem):
        measured_motion(**{"chain": CHAIN, "t": T, "x": X, "tau": TAU, "cutoff": 15.0} | change)


def test_a_gap_that_hides_motion_is_refused():
    """Shorter ones are bridged; across longer ones the rates would be wrong."""
    late = (T <= 2) | (T > 2.03)
    measured_motion(CHAIN, T[late], X[late], TAU[late], cutoff=15)
    late = (T <= 2) | (T > 2.05)
    with pytest.raises(InputError, match=r"no samples for 0.052 s from 2 s on"):
        measured_motion(CHAIN, T[late], X[late], TAU[late], cutoff=15)


@pytest.mark.parametrize(("cutoff", "count"), [(30.0, 1), (30.0, 10), (3.0, 10), (3.0, 100)])
def test_a_run_of_wrong_positions_is_bridged_or_refused(cutoff, count):
    """Rates are those of the log without the run, to ten times what the noise does, or none."""
    x = X + 1e-4 * np.random.default_rng(count).normal(size=X.shape)
    clean = measured_motion(CHAIN, T, x, TAU, cutoff=cutoff)
    x[1500 : 1500 + count, 0] += 3.0
    short, long = count == 1, count > 500 / cutoff / 3
    refused = pytest.raises(InputError, match=f"{CHAIN.coordinates[0]} jumps")
    with refused if long else nullcontext() if short else suppress(InputError):
        motion = measured_motion(CHAIN, T, x, TAU, cutoff=cutoff)
        assert_allclose(motion.va, clean.va, atol=0.1)


BASE = base_parameters(CHAIN)
LIMITS = {"rates": 2.0, "torques": 0.01, "harmonics": 3}


@pytest.fixture(scope="module")
def motion():
    with pytest.warns(RuntimeWarning, match="shows the parameters poorly"):  # one try
        return excitation(CHAIN, BASE, 3.0, tries=1, **LIMITS)


@pytest.mark.slow
def test_limits_are_kept_between_the_samples_too(motion):
    between = coordinate_motion(CHAIN, motion.t[:-1] + 0.004, np.array(motion.q)[:-1, [0, 2]])
    for each in (motion, between):
        assert np.abs(each.va).max() <= 2.0 * 1.001
        assert np.abs(each.tau).max() <= 0.01 * 1.01
    assert np.abs(CHAIN.residual(motion.q)).max() < 1e-9


def test_it_begins_and_ends_at_rest_in_the_same_place(motion):
    assert_allclose(motion.q[0], motion.q[-1], atol=1e-9)
    assert np.abs(motion.va[[0, -1]]).max() < 1e-4 * np.abs(motion.va).max()
    assert np.abs(motion.aa[[0, -1]]).max() < 1e-3 * np.abs(motion.aa).max()


@pytest.mark.slow
def test_it_shows_parameters_better_than_sines_of_the_same_rates(motion):
    t = np.linspace(0, 3, 301)
    x = np.array(CHAIN.home)[[0, 2]] + 0.12 * np.sin(2 * np.pi / 3 * np.outer(t, [1, 2]))
    sines = coordinate_motion(CHAIN, t, x)
    assert condition_number(CHAIN, BASE, motion) < condition_number(CHAIN, BASE, sines)


@pytest.mark.slow
def test_a_motion_that_shows_little_is_told():
    """Small limits leave a base regressor of a large condition number."""
    with pytest.warns(RuntimeWarning, match=r"shows the parameters poorly: condition number \d"):
        excitation(CHAIN, BASE, 3.0, tries=1, **LIMITS)
    pair = base_parameters(CHAIN, ["shoulder_*.viscous"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        excitation(CHAIN, pair, 3.0, tries=1, **LIMITS)


def test_the_limits_of_the_model_are_those_of_check_limits():
    """A geared motor and a cylinder: the limits are of forces on the joint and on the line."""
    model = pin.Model(CHAIN.model)
    model.effortLimit[:] = 0.05
    line = LineForce("platform", "universe", name="cylinder", effort=0.3)
    motors = [{"geared": {"shoulder_1": 2.0}}, "cylinder"]
    coordinates = ["shoulder_1", "shoulder_2"]
    chain = ClosedChain(model, CHAIN.closures, motors, coordinates=coordinates, lines=[line])
    motion = excitation(chain, base_parameters(chain, ["shoulder_*.viscous"]), 1.5, tries=1)
    assert not [str(finding) for finding in chain.check_limits(motion) if "effort" in str(finding)]


def test_limits_that_nothing_keeps_are_refused():
    with pytest.raises(InputError, match="no motion about it stays within the limits"):
        excitation(CHAIN, BASE, 3.0, tries=1, torques=1e-6, harmonics=2)
    for wrong in ({"rates": 0.0}, {"rates": [1, 2, 3]}, {"harmonics": 1}, {"tries": 0}):
        with pytest.raises(InputError, match=f"{next(iter(wrong))}: "):
            excitation(CHAIN, BASE, 3.0, **wrong)


def test_a_start_that_nobody_chose_is_told():
    chain = ClosedChain(CHAIN.model, CHAIN.closures, CHAIN.motor_names)
    del chain.model.referenceConfigurations["home"]
    chain.refresh()
    told = pytest.raises(DescriptionWarning, match="no configuration is named home")
    with warnings.catch_warnings(), told:
        warnings.simplefilter("error", DescriptionWarning)  # so that nothing is optimised
        excitation(chain, BASE, 3.0, tries=1, harmonics=2)
