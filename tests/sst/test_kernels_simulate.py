# SPDX-License-Identifier: BSD-2-Clause
"""`simulate` by the kernels against `simulate` on the reference path."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import sst_pin
from sst_pin.dynamics import dynamics
from sst_pin.sst import kernels
from sst_pin.sst.kernels import STAR
from sst_pin.sst.kinematics import legs_of_joints
from sst_pin.verification.sampling import random_parameters, random_state
from tests.support.without_kernels import on_reference_path

compiled = pytest.mark.skipif(bool(kernels.missing()), reason=f"no kernels: {kernels.missing()}")
T = np.linspace(0, 0.1, 11)


def both(parameters=None):
    return sst_pin.SST(parameters), sst_pin.SST(parameters, kernels=False)


LOADS = {
    "none": {},
    "moment": {"platform_moment": [0.1, 0.2, -0.3]},
    "moment that changes": {"platform_moment": lambda t, q, va: [t, np.sin(q[1]), -va[0]]},
    "wrenches": {"external_wrenches": np.arange(54.0).reshape(9, 6) / 50},
    "both": {
        "platform_moment": [0.1, 0.2, -0.3],
        "external_wrenches": lambda t, q, va: np.full((9, 6), va[1]),
    },
}
TORQUES = {
    "constant": [0.1, 0.2, 0.3],
    "samples": np.sin(np.outer(T, (3, 4, 5))),
    "a law of q and va": lambda t, q, va: np.cos(q[[1, 4, 7]]) - va,
}
PAIRS = [
    pytest.param(load, torque, marks=[pytest.mark.slow] * (load != "none" and torque != "constant"))
    for load in LOADS
    for torque in TORQUES
]


@pytest.mark.parametrize(("load", "torque"), PAIRS)
def test_both_paths_take_the_same_motion(load, torque):
    rng = np.random.default_rng(0)
    fast, slow = both(random_parameters(rng))
    q, va, _ = fast.joint_motion(*random_state(fast, rng))
    options = LOADS[load] | {"sign_width": 0.5}
    a, b = (robot.simulate(TORQUES[torque], q, va, T, **options) for robot in (fast, slow))
    for name in ("q", "va", "aa", "tau"):
        assert np.abs(getattr(a, name) - getattr(b, name)).max() < 1e-10
    assert max(np.abs(fast.residual(x)).max() for x in a.q) < 1e-13
    assert np.abs(a.q[-1] - q).max() > 1e-2  # it did move


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("torque", TORQUES)
def test_samples_hold_the_torques_asked_for_and_the_rates_of_the_motion(robot, load, torque):
    """aa is the slope of va, by a spline of degree five through 101 samples."""
    t = np.linspace(0, 0.1, 101)
    given = np.sin(np.outer(t, (3, 4, 5))) if torque == "samples" else TORQUES[torque]
    motion = robot.simulate(given, robot.home, (1, 1, -1), t, **LOADS[load])
    tau = given
    if callable(given):
        tau = [given(*sample) for sample in zip(motion.t, motion.q, motion.va, strict=True)]
    assert np.abs(motion.tau - tau).max() < 1e-12
    slope = make_interp_spline(t, motion.va, k=5).derivative()(t)
    assert np.abs(slope - motion.aa).max() < 1e-6 * np.abs(motion.aa).max()


@pytest.mark.parametrize("gap", [1e-9, 1e-4, 1e-2])
def test_rates_are_those_of_the_closed_loops(robot, gap):
    """Where passive joints have drifted, and in a trial step that goes far off."""
    fast, slow = (r.engine.states(0.0) for r in (robot, on_reference_path(robot)))
    rng = np.random.default_rng(2)
    for _ in range(5):
        q, va, tau = robot.joint_motion(*random_state(robot, rng))
        drifted = q + gap * rng.choice((-1, 1), 9) * ~np.isin(range(9), robot.actuated)
        state = np.concatenate([drifted, va])
        assert np.abs(fast.closed(state) - q).max() < 1e-14 + gap * 1e-13
        wanted = slow.rate(state, tau, None)
        assert np.abs(fast.rate(state, tau, None) - wanted).max() < 1e-11 * np.abs(wanted).max()


@compiled
def test_loads_stay_on_the_kernels(robot, monkeypatch):

    def forbidden(*_):
        raise AssertionError("the reference path")

    monkeypatch.setattr(dynamics, "direct_dynamics", forbidden)
    load = np.zeros((9, 6))
    load[STAR, :3] = 0.1, 0.2, 0.3
    for loads in (*LOADS.values(), {"external_wrenches": load}):
        robot.simulate(np.zeros(3), robot.home, np.zeros(3), T, **loads)


@pytest.mark.parametrize("limit", [7.0, 10.0])
def test_both_paths_stop_at_the_same_time_before_a_singularity(limit):
    """The bound on the condition number only spares what is far from the limit."""
    stops = []
    for robot in both():
        state, t = (np.zeros(3), robot.home, (5, -5, 5)), np.linspace(0, 1, 11)
        with pytest.warns(sst_pin.SingularityWarning):
            motion = robot.simulate(*state, t, max_condition_number=limit)
        stops.append(float(motion.stopped.split("t = ")[1].split(" s")[0]))
    assert stops[0] == pytest.approx(stops[1], rel=1e-8)


def test_det_A_bounds_the_condition_number(odd):
    """|det A| = |det Phi^u| and the squares of six singular values, 3 at most, sum to 8."""
    rng = np.random.default_rng(1)
    passive = [i for i in range(9) if i not in odd.actuated]
    for _ in range(20):
        q, _, _ = odd.joint_motion(*random_state(odd, rng))
        values = np.linalg.svd(odd.Phi(q)[:, passive], compute_uv=False)
        det_A = np.linalg.det(legs_of_joints(odd.geometry, q).y_2)
        assert np.prod(values) == pytest.approx(abs(det_A), rel=1e-11)
        assert (values**2).sum() == pytest.approx(8, rel=1e-13)
        assert values[0] <= np.sqrt(3) + 1e-14
        assert odd.condition_number(q) < 5.62 / abs(det_A)
