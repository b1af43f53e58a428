# SPDX-License-Identifier: BSD-2-Clause
"""`simulate` by kernels against `simulate` on the reference path."""

import numpy as np
import pytest

import sst_pin
from sst_pin.dynamics import dynamics
from tests.support.sampling import random_state

T = np.linspace(0, 0.1, 11)
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
    (load, torque) for load in LOADS for torque in TORQUES if load == "none" or torque == "constant"
]


@pytest.fixture(scope="module")
def both():
    """An SST with friction, whose kernels are those of the paper's: compiled, and not."""
    parameters = sst_pin.Parameters(viscous_friction=0.3, coulomb_friction=0.1)
    compiled, reference = sst_pin.SST(parameters), sst_pin.SST(parameters)
    compiled.compile(compiled.home)
    return compiled, reference


@pytest.mark.parametrize(("load", "torque"), PAIRS)
def test_both_paths_take_the_same_motion(both, load, torque):
    q, va, _ = both[0].joint_motion(*random_state(both[0], np.random.default_rng(0)))
    options = LOADS[load] | {"sign_width": 0.5}
    a, b = (robot.simulate(TORQUES[torque], q, va, T, **options) for robot in both)
    for name in ("q", "va", "aa", "tau"):
        assert np.abs(getattr(a, name) - getattr(b, name)).max() < 1e-10
    assert max(np.abs(both[0].residual(x)).max() for x in a.q) < 1e-13
    assert np.abs(a.q[-1] - q).max() > 1e-2  # it did move


@pytest.mark.parametrize("gap", [1e-9, 1e-4, 1e-2])
def test_rates_are_those_of_the_closed_loops(both, gap):
    """Where passive joints have drifted, and in a trial step that goes far off."""
    robot, (fast, slow) = both[0], (r._engine.states(0.0) for r in both)
    rng = np.random.default_rng(2)
    for _ in range(5):
        q, va, tau = robot.joint_motion(*random_state(robot, rng))
        drifted = q + gap * rng.choice((-1, 1), 9) * ~np.isin(range(9), robot.actuated)
        state = np.concatenate([drifted, va])
        assert np.abs(fast.closed(state) - q).max() < 1e-14 + gap * 1e-13
        wanted = slow.rate(state, tau, None)
        assert np.abs(fast.rate(state, tau, None) - wanted).max() < 1e-11 * np.abs(wanted).max()


def test_loads_stay_on_the_kernels(both, monkeypatch):
    def forbidden(*_):
        raise AssertionError("the reference path")

    monkeypatch.setattr(dynamics, "direct_dynamics", forbidden)
    robot = both[0]
    for loads in LOADS.values():
        robot.simulate(np.zeros(3), robot.home, np.zeros(3), T, **loads)


@pytest.mark.slow
@pytest.mark.parametrize("limit", [7.0])
def test_both_paths_stop_at_the_same_time_before_a_singularity(robot, compiled_robot, limit):
    stops = []
    for each in (robot, compiled_robot):
        state, t = (np.zeros(3), each.home, (5, -5, 5)), np.linspace(0, 1, 11)
        with pytest.warns(sst_pin.SingularityWarning):
            motion = each.simulate(*state, t, max_condition_number=limit)
        stops.append(float(motion.stopped.split("t = ")[1].split(" s")[0]))
    assert stops[0] == pytest.approx(stops[1], rel=1e-8)
