# SPDX-License-Identifier: BSD-2-Clause
"""Base parameters, and estimates of them: their number, their effect, their deviations."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
import scipy.signal
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import ClosedChain, InputError, identification, robots
from sst_pin.identification import base_parameters, estimate, random_states
from sst_pin.model.named_positions import positions_of
from tests.support import any_chain

BODIES = [f"*.{word}" for word in ("mass", "m[xyz]", "i[xyz][xyz]")]


@pytest.mark.parametrize("kind", ["Manipulator", "HumanoidRandom"])
def test_open_trees_have_the_rank_of_pinocchios_regressor(kind):
    model = getattr(pin, f"buildSampleModel{kind}")()
    model.armature = model.damping = model.friction = np.zeros(model.nv)
    limits = np.pi * np.ones(model.nq)
    model.lowerPositionLimit, model.upperPositionLimit = -limits, limits
    random, data, rows = np.random.default_rng(0), model.createData(), []
    pin.seed(0)
    for _ in range(10 * model.njoints // model.nv + 40):
        v, a = random.normal(size=(2, model.nv))
        q = pin.randomConfiguration(model)
        rows.append(pin.computeJointTorqueRegressor(model, data, q, v, 9 * a).copy())
    W = np.vstack(rows)
    W = W[:, np.abs(W).max(axis=0) > 1e-9]
    rank = np.linalg.matrix_rank(W / np.linalg.norm(W, axis=0), tol=1e-7)
    names = [name for name in list(model.names)[1:] if name != "root_joint"]
    chain = ClosedChain(model, [], names)
    assert len(base_parameters(chain, BODIES)) == rank


@pytest.mark.parametrize(
    ("gravity", "number", "seed"), [((0, 0, -9.81), 31, 0), ((1, 2, -9), 33, 5)]
)
def test_the_sst_has_as_many_as_are_derived_by_hand(gravity, number, seed):
    """docs/identification.md: 33, and 31 where one motor's axis is vertical."""
    robot = sst_pin.SST()
    robot.model.gravity.linear = np.array(gravity, dtype=float)
    robot.refresh()
    assert len(base_parameters(robot, seed=seed)) == number


@pytest.mark.parametrize("make", [robots.four_bar, lambda: any_chain.with_joint("RY")])
def test_forces_depend_on_the_base_parameters_alone(make):
    """Parameters that move along the null space of the combinations change no force."""
    chain = make()
    base, theta = base_parameters(chain), np.asarray(chain.dynamic_parameters)
    motions = random_states(chain, 4, 7)
    f, Y = chain.generalized_forces(*motions), chain.torque_regressor(*motions)
    of_base = Y[..., base.columns] @ (base.matrix @ theta)
    assert_allclose(of_base, f, atol=1e-9 * np.abs(f).max())
    hidden = theta.copy()
    step = 0.1 * np.random.default_rng(1).normal(size=len(base.considered))
    hidden[base.considered] += step
    change = base.matrix @ (hidden - theta)
    hidden[base.columns] -= change
    size = np.abs(hidden - theta).max()
    assert size > 0.1
    assert_allclose(Y @ hidden, f, atol=1e-9 * size * np.abs(Y).max())


def test_parameters_that_no_motion_shows_are_named():
    """A planar four-bar: what does not move in its plane has no effect."""
    base = base_parameters(robots.four_bar(), ["coupler.*", "crank.viscous"])
    assert "coupler.mz" in base.unseen
    assert "coupler.ixx" in base.unseen
    assert "crank.viscous" in base.names
    assert len(base.names) == len(base) == np.linalg.matrix_rank(base.matrix)


def test_a_joint_whose_name_looks_like_a_pattern_is_named():
    model = robots.four_bar().model
    model.names[model.getJointId("coupler")] = "coupler[1]"
    named = ClosedChain(model, robots.four_bar().closures, ["crank"])
    base = base_parameters(named, ["coupler[1].izz"])
    assert base.names == ("coupler[1].izz",)


def test_a_motion_shows_less_than_random_states():
    """At rest there is no inertia to be seen."""
    chain = robots.five_bar()
    chain.model.gravity.linear = np.array([0, -9.81, 0])
    chain.refresh()
    q, va, _ = random_states(chain, 40)
    still = base_parameters(chain, BODIES, motion=(q, 0 * va, 0 * va))
    assert "elbow_1.izz" in still.unseen
    assert len(still) < len(base_parameters(chain, BODIES))


MORE_MOTORS = "planar_4rrr"


@cache
def case(name, count=80):
    """A robot with friction in its motors, base parameters, a motion and its torques."""
    chain = getattr(robots, name)()
    friction = {f"{motor}.viscous": 0.1 for motor in chain.motor_names}
    chain = chain.with_parameters(friction)
    motion = random_states(chain, count, 3)
    return chain, base_parameters(chain), motion, chain.compute_torques(*motion)


@pytest.mark.parametrize(("name", "decimate"), [("five_bar", 4), (MORE_MOTORS, 1)])
def test_torques_without_noise_give_the_parameters(name, decimate):
    """Filtered or not: both sides of the equations are filtered alike."""
    chain, base, motion, tau = case(name)
    result = estimate(chain, base, *motion, tau, decimate=decimate)
    true = base.matrix @ chain.dynamic_parameters
    assert_allclose(result.values, true, rtol=1e-7, atol=1e-9 * np.abs(true).max())
    assert (result.noise < 1e-8 * np.abs(tau).max()).all()


@pytest.mark.parametrize(
    ("name", "robust"),
    [("five_bar", False), pytest.param(MORE_MOTORS, True, marks=pytest.mark.slow)],
)
def test_values_are_within_their_standard_deviations(name, robust):
    """A normal distribution has 68 % within one, 99.7 % within three."""
    chain, base, motion, tau = case(name)
    true = base.matrix @ chain.dynamic_parameters
    sizes = np.array([0.01, 0.05]) if name == "five_bar" else 0.02
    missed = []
    for seed in range(30):
        noise = np.random.default_rng(seed).normal(size=tau.shape) * sizes
        result = estimate(chain, base, *motion, tau + noise, robust=robust)
        assert_allclose(result.noise, np.full(tau.shape[1], sizes), rtol=0.5)
        missed.append(np.abs(result.values - true) / result.deviations)
    assert 0.58 < np.mean(np.array(missed) < 1) < 0.78
    assert np.mean(np.array(missed) < 3) > 0.98


@pytest.mark.slow
@pytest.mark.parametrize("count", [14, 17])
def test_intervals_of_few_samples_cover_the_truth(count):
    """13 parameters, two motors of different noise: intervals of 95 % hold 95 %.

    Of 13 x 60 values 5 % are 39; they depend on each other, so that twice as many are likely.
    """
    friction = {f"{joint}.viscous": 0.1 for joint in ("shoulder_1", "shoulder_2", "elbow_1")}
    chain = robots.five_bar().with_parameters(
        {**friction, "elbow_2.viscous": 0.1, "shoulder_1.coulomb": 0.1, "shoulder_2.coulomb": 0.1}
    )
    base, motion = base_parameters(chain), random_states(chain, count, 1)
    assert len(base) == 13
    tau, random = chain.compute_torques(*motion), np.random.default_rng(0)
    true, within = base.matrix @ chain.dynamic_parameters, []
    for _ in range(60):
        noise = random.normal(size=tau.shape) * [0.01, 0.03]
        result = estimate(chain, base, *motion, tau + noise)
        within.append(np.abs(result.values - true) < result.intervals(0.95))
        assert result.degrees_of_freedom < count
    assert np.mean(within) > 0.9


def test_too_few_samples_for_the_noise_of_a_motor_are_refused():
    """Eight equations of one motor, seven parameters: its noise would come out as zero."""
    chain = robots.five_bar()
    base, motion = base_parameters(chain, BODIES), random_states(chain, 8)
    tau = chain.compute_torques(*motion)
    with pytest.raises(InputError, match="degrees of freedom for the noise of motor shoulder_"):
        estimate(chain, base, *motion, tau)


@pytest.mark.slow
def test_intervals_of_many_samples_are_those_of_the_normal_distribution():
    chain, base, motion, tau = case("five_bar", 400)
    noise = 0.01 * np.random.default_rng(0).normal(size=tau.shape)
    result = estimate(chain, base, *motion, tau + noise)
    assert_allclose(result.intervals(), 3 * result.deviations, rtol=0.02)
    with pytest.raises(InputError, match="level"):
        result.intervals(1.5)


def test_an_estimate_belongs_to_its_robot():
    """The numbers of columns differ, or only their names."""
    chain, base, motion, tau = case("five_bar")
    noisy = tau + 0.01 * np.random.default_rng(0).normal(size=tau.shape)
    found = estimate(chain, base, *motion, noisy)
    for other in (robots.four_bar(), robots.planar_3rrr()):
        with pytest.raises(InputError, match="parameters are not those of"):
            identification.consistent_parameters(other, found)
    with pytest.raises(InputError, match="parameters are not those of"):
        estimate(robots.four_bar(), base, *random_states(robots.four_bar(), 40), np.zeros((40, 1)))


def test_torques_whose_squares_overflow_are_refused():
    chain, base, motion, tau = case("five_bar")
    with pytest.raises(InputError, match="squares overflow"):
        estimate(chain, base, *motion, 1e200 * tau)


def test_no_names_are_no_parameters():
    with pytest.raises(InputError, match="no names"):
        base_parameters(robots.four_bar(), [])


def log_at_100_hz(name, monkeypatch):
    """A robot with dry friction in its motors, its base parameters, states, torques, true values.

    The sensor filters torques that jump between its samples. The regressor of the states is
    computed once.
    """
    plain = sst_pin.SST() if name == "sst" else getattr(robots, name)()
    words = {"viscous": 0.05, "coulomb": 0.1}
    friction = {f"{m}.{word}": x for m in plain.motor_names for word, x in words.items()}
    chain = plain.with_parameters(friction)
    t, n = np.arange(0, 8, 0.0025), chain.degrees_of_freedom
    rates = np.random.default_rng(5).uniform(2, 5, n)
    phase = np.outer(t, rates) + np.sin(np.outer(t, rates / 2))
    x = positions_of(plain.mechanism.space, plain.home, plain.coordinates) + 0.1 * np.sin(phase)
    motion = sst_pin.coordinate_motion(chain, t, x, plain.home)
    tau = scipy.signal.decimate(motion.tau, 4, ftype="fir", axis=0)
    state = [np.array(each[::4]) for each in (motion.q, motion.va, motion.aa)]
    base = base_parameters(plain, [*BODIES, *friction])
    arrays = {
        "torque_regressor": chain.torque_regressor(*state),
        "actuator_jacobian": chain.actuator_jacobian(state[0]),
        "joint_rates": chain.joint_rates(*state[:2]),
    }
    for method, array in arrays.items():
        monkeypatch.setattr(ClosedChain, method, lambda *_, array=array: array.copy())
    return chain, base, state, tau, base.matrix @ chain.dynamic_parameters


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "decimate"),
    [
        ("five_bar", 2),
        ("five_bar", 10),
        ("four_bar", 10),
        ("delta", 2),
        ("planar_3rrr", 10),
        ("sst", 10),
    ],
)
def test_intervals_of_five_robots_cover_the_truth(name, decimate, monkeypatch):
    """95 % of them."""
    chain, base, state, tau, true = log_at_100_hz(name, monkeypatch)
    away, random = [], np.random.default_rng(0)
    for _ in range(200):
        noise = 0.02 * random.normal(size=tau.shape)
        result = estimate(chain, base, *state, tau + noise, decimate=decimate)
        away.append((result.values - true) / result.deviations)
    assert 0.93 < np.mean(np.abs(away) < 1.96) < 0.97


@pytest.mark.slow
@pytest.mark.parametrize(("decimate", "cover"), [(2, 0.98), (10, 0.93)])
def test_intervals_of_robust_estimates_cover_about_what_they_say(decimate, cover, monkeypatch):
    """3 % of the torques are off by 25 to 100 deviations; the docstring tells these numbers.

    Of 11 values in 200 logs, which depend on each other in each log, the share of those within
    their intervals has a standard deviation of at most sqrt(0.05 * 0.95 / 200) = 0.015.
    """
    chain, base, state, tau, true = log_at_100_hz("five_bar", monkeypatch)
    away, random = [], np.random.default_rng(0)
    for _ in range(200):
        noise = 0.02 * random.normal(size=tau.shape)
        off = random.random(tau.shape) < 0.03
        sizes = random.uniform(0.5, 2, off.sum())
        noise[off] += random.choice([-1, 1], off.sum()) * sizes
        result = estimate(chain, base, *state, tau + noise, decimate=decimate, robust=True)
        away.append((result.values - true) / result.deviations)
    assert np.mean(np.abs(away) < 1.96) == pytest.approx(cover, abs=0.015)


def test_friction_that_depends_on_the_direction_is_found():
    """Forwards 0.3 N m, back 0.1 N m: the mean is Coulomb's, half the difference an offset."""
    chain, _, motion, tau = case("five_bar")
    first = chain.motor_names[0]
    forwards = motion[1][:, 0] > 0
    tau = tau + np.column_stack([np.where(forwards, 0.3, -0.1), np.zeros(len(tau))])
    names = [f"{first}.coulomb", f"{first}.offset"]
    base = base_parameters(chain, ["*.m*", "*.i*", "*.viscous", *names])
    result = dict(zip(base.names, estimate(chain, base, *motion, tau).values, strict=True))
    assert_allclose([result[name] for name in names], [0.2, 0.1], rtol=1e-6)


def test_outliers_count_less_in_a_robust_estimate():
    chain, base, motion, tau = case("five_bar")
    true, random = base.matrix @ chain.dynamic_parameters, np.random.default_rng(0)
    noisy = tau + 0.01 * random.normal(size=tau.shape)
    noisy[random.integers(len(tau), size=6)] += 20.0
    plain, robust = (estimate(chain, base, *motion, noisy, robust=x) for x in (False, True))
    assert np.abs(robust.values - true).max() < 0.05 * np.abs(plain.values - true).max()
    assert (np.abs(robust.values - true) < 5 * robust.deviations).all()


def test_the_report_marks_what_the_data_do_not_support():
    chain, _, motion, tau = case("five_bar")
    base = base_parameters(chain, ["*.viscous", "shoulder_1.coulomb"])
    noise = 0.01 * np.random.default_rng(2).normal(size=tau.shape)
    result = estimate(chain, base, *motion, tau + noise)
    shown = dict(zip(base.names, result.supported, strict=True))
    assert shown["shoulder_1.viscous"]
    assert not shown["shoulder_1.coulomb"]
    assert str(result).count("not supported") == np.sum(~result.supported)


def test_the_report_has_no_relative_error_of_a_motor_without_torque():
    """An error relative to zero is no number. The run makes warnings of NumPy errors."""
    chain, base, states, tau = case("five_bar")
    tau[:, 0] = 0.0
    result = estimate(chain, base, *states, tau)
    motion = chain.trajectory(np.arange(len(tau)), *states, tau=tau)
    text = identification.report(chain, result, chain.dynamic_parameters, motion)
    rows = [line.split("|") for line in text.splitlines() if line.startswith("| shoulder")]
    assert rows[0][4].strip() == ""
    assert float(rows[1][4]) >= 0


def test_the_motion_of_another_robot_is_refused():
    """Its motors stand in the other order: the same joints, rates and torques in other columns."""
    chain, base, states, tau = case("five_bar")
    result, theta = estimate(chain, base, *states, tau), chain.dynamic_parameters
    motion = chain.trajectory(np.arange(len(tau)), *states)
    other = ClosedChain(chain.model, chain.closures, chain.motor_names[::-1])
    for use, arguments in (
        (identification.predicted_torques, (theta, motion)),
        (identification.report, (result, theta, motion)),
        (identification.condition_number, (base, motion)),
    ):
        use(chain, *arguments)
        with pytest.raises(InputError, match="belongs to another robot"):
            use(other, *arguments)
