# SPDX-License-Identifier: BSD-2-Clause
"""The momentum observer against forces that are known."""

import numpy as np
import pytest

import sst_pin
from sst_pin import robots
from sst_pin.control import ForceObserver
from sst_pin.errors import InputError

#: Sampling period, [s].
DT = 1e-3


@pytest.fixture(scope="module")
def pushed():
    """A delta in motion, which 2 N and -3 N push at its platform from 0.05 s on."""
    delta = robots.delta()
    body = delta.model.frames[delta.model.getFrameId("platform")].parentJoint - 1
    load = np.zeros((delta.model.njoints - 1, 6))
    load[body, :3] = (2.0, 0.0, -3.0)
    tau = delta.compute_torques(delta.home, np.zeros(3), np.zeros(3))
    t = np.arange(0, 0.05 + DT / 2, DT)
    before = delta.simulate(tau, delta.home, np.full(3, 0.3), t)
    after = delta.simulate(tau, before.q[-1], before.va[-1], t, external_wrenches=load)
    q, va = (np.vstack([a, b[1:]]) for a, b in ((before.q, after.q), (before.va, after.va)))
    return delta, DT * np.arange(len(q)), q, va, np.tile(tau, (len(q), 1))


def forces_of(delta, q):
    """The pushing force along the coordinates; the platform's mass centre is in its origin."""
    return np.array([delta.frame_jacobian(x, "platform").T @ [2, 0, -3, 0, 0, 0] for x in q])


def test_the_estimate_follows_a_step_with_the_time_constant_of_its_gain(pushed):
    delta, t, q, va, tau = pushed
    gain = 80.0
    r = ForceObserver(delta, gain).forces(t, q, va, tau)
    f = forces_of(delta, q)
    before, after = t <= 0.05 + DT / 2, t > 0.05 + DT / 2
    # Trapezoids over 1 ms have an error of 1e-4 of the forces of this motion.
    assert np.abs(r[before]).max() < 1e-3 * np.abs(f).max()
    expected = np.zeros(3)
    for k in np.flatnonzero(after):
        keep = np.exp(-gain * DT)
        expected = keep * expected + (1 - keep) * (f[k] + f[k - 1]) / 2
        np.testing.assert_allclose(r[k], expected, atol=2e-3 * np.abs(f).max())


def test_samples_one_by_one_give_the_estimates_of_the_log(pushed):
    delta, t, q, va, tau = pushed
    observer = ForceObserver(delta, [50.0, 60.0, 70.0])
    together = observer.forces(t, q, va, tau)
    observer.reset()
    alone = [observer.update(*sample) for sample in zip(t, q, va, tau, strict=True)]
    np.testing.assert_allclose(alone, together, rtol=1e-12)


def test_a_period_far_longer_than_the_time_constant_is_stable(pushed):
    delta, t, q, va, tau = pushed
    every = slice(None, None, 10)
    r = ForceObserver(delta, 1e6).forces(t[every], q[every], va[every], tau[every])
    # The estimate is then the mean force since the sample before.
    f = forces_of(delta, q)[every]
    np.testing.assert_allclose(r[-1], (f[-1] + f[-2]) / 2, atol=0.01 * np.abs(f).max())


def test_a_load_in_the_gripper_is_weighed():
    """By hand: torques that hold 0.3 kg more at rest show its weight at the platform."""
    delta = robots.delta()
    body = delta.joint_names[delta.model.frames[delta.model.getFrameId("platform")].parentJoint - 1]
    mass = delta.dynamic_parameters[f"{body}.mass"]
    with pytest.warns(sst_pin.DescriptionWarning):
        loaded = delta.with_parameters({f"{body}.mass": mass + 0.3})
    rest = np.zeros(3)
    tau = loaded.compute_torques(delta.home, rest, rest)
    observer = ForceObserver(delta, 20.0)
    t = np.arange(0, 1, 0.01)
    q, still, held = (np.tile(x, (len(t), 1)) for x in (delta.home, rest, tau))
    r = observer.forces(t, q, still, held)
    w = observer.wrench(delta.home, r[-1], "platform", ["fx", "fy", "fz"])
    weight = -0.3 * 9.81
    # exp(-20 * 0.99) = 3e-9 of the step is still missing.
    np.testing.assert_allclose(w, [0, 0, weight, 0, 0, 0], atol=1e-7)


def test_friction_that_the_model_does_not_know_is_seen_as_a_force():
    known = robots.four_bar()
    real = known.with_parameters({"crank.viscous": 0.4})
    t = np.linspace(0, 0.5, 501)
    motion = real.simulate([0.3], known.home, [1.0], t)
    r = ForceObserver(known, 200.0).forces(t, motion.q, motion.va, motion.tau)
    late = t > 0.1
    # It lags by 1 / gain = 5 ms, in which the rate changes by less than 4 percent of 2 rad/s.
    np.testing.assert_allclose(r[late, 0], -0.4 * motion.va[late, 0], atol=0.4 * 0.08)


def test_redundant_motors_and_lines_are_explained():
    arm = robots.planar_4rrr()
    tau = arm.compute_torques(arm.home, np.zeros(3), [1.0, 2.0, 3.0], preload=[2.0])
    motion = arm.simulate(tau, arm.home, np.zeros(3), np.linspace(0, 0.05, 51))
    r = ForceObserver(arm, 100.0).forces(motion.t, motion.q, motion.va, motion.tau)
    assert np.abs(r).max() < 1e-4 * np.abs(tau).max()


def test_components_that_coordinates_cannot_distinguish_are_refused():
    lift = robots.five_bar()
    observer = ForceObserver(lift, 10.0)
    with pytest.raises(InputError, match="2 coordinates cannot distinguish fx, fy, fz of platform"):
        observer.wrench(lift.home, [1.0, 2.0], "platform", ["fx", "fy", "fz"])
    w = observer.wrench(lift.home, [1.0, 2.0], "platform", ["fx", "fy"])
    np.testing.assert_allclose(lift.frame_jacobian(lift.home, "platform").T @ w, [1, 2], rtol=1e-9)
    with pytest.raises(InputError, match="Fx: known are fx"):
        observer.wrench(lift.home, [1.0, 2.0], "platform", ["Fx"])


def test_wrong_samples_are_refused():
    bar = robots.four_bar()
    observer = ForceObserver(bar, 10.0)
    observer.update(0.0, bar.home, [0.0], [0.0])
    with pytest.raises(InputError, match="not later"):
        observer.update(0.0, bar.home, [0.0], [0.0])
    with pytest.raises(InputError, match="gain"):
        ForceObserver(bar, 0.0)
    with pytest.raises(InputError, match="a row for each time"):
        observer.forces([0.0, 0.1], [bar.home], [[0.0]], [[0.0]])
    with pytest.raises(sst_pin.DescriptionError, match="nothing can move"):
        ForceObserver(bar.with_brakes(["crank"]), 10.0)
