# SPDX-License-Identifier: BSD-2-Clause
"""The examples: arms of a da Vinci, their loops and logs; an SST that MuJoCo simulates."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sst_pin import coordinate_motion
from sst_pin.identification import base_parameters, random_states
from tests.support.files import load

sst_identification = load("examples/sst_identification.py")
dvrk = load("examples/dvrk_identification.py")


@pytest.mark.parametrize(("make", "number"), [(dvrk.mtm, 73), (dvrk.psm, 49)])
def test_an_arm_has_as_many_base_parameters_as_its_authors_count(make, number):
    arm = make()
    assert len(base_parameters(arm.chain, arm.which)) == number


def test_the_bars_of_both_arms_stay_parallel():
    """In no random state do they cross, though the closures would allow it."""
    chain = dvrk.mtm().chain
    q = dict(zip(chain.position_names, random_states(chain, 20)[0].T, strict=True))
    assert_allclose(q["elbow"], q["lever"] - q["shoulder"], atol=1e-9)
    assert_allclose(q["rod"], q["shoulder"] - q["lever"], atol=1e-9)
    geared = dvrk.PLATFORM * (q["shoulder"] - q["lever"]) + q["motor_4"]
    assert_allclose(q["platform"], geared, atol=1e-9)
    chain = dvrk.psm().chain
    q = dict(zip(chain.position_names, random_states(chain, 20)[0].T, strict=True))
    for level in ("bottom", "top"):
        assert_allclose(q[level], -q["pitch"], atol=1e-9)
    for upright in ("end", "front"):
        assert_allclose(q[upright], q["pitch"], atol=1e-9)


def test_intervals_of_ratios_hold_the_true_one():
    """Fieller's interval of two moments that share a run without weight: 95 % of 2000 trials."""
    random, true = np.random.default_rng(0), np.array([[0.01, 0.05], [0.02, 0.1]])
    runs = np.array([0.001, 0.005])
    held = []
    for _ in range(2000):
        session = runs / np.sqrt(2) * random.normal(size=(3, 2))
        moments = true + session[1:] - session[0]
        weights = dvrk.Weights(moments, np.tile(runs, (2, 1)), runs)
        held.append([low < 2 < high for low, high in (weights.ratio(k) for k in (0, 1))])
    assert_allclose(np.mean(held), 0.95, atol=0.01)
    nothing = dvrk.Weights(0 * true + 0.001, np.tile(runs, (2, 1)), runs)
    assert nothing.ratio(1) is None


@pytest.mark.filterwarnings("ignore:.*the first moment and the inertia of the body stay")
@pytest.mark.slow
def test_a_log_of_an_mtm_that_is_known_is_predicted_by_physical_parameters(capsys):
    """Training and test of 12 s with friction that jumps, encoder steps and noise of 1 %."""
    arm = dvrk.mtm()
    friction = {f"{name}.coulomb": 0.02 for name in ("outer_yaw", "shoulder", "elbow", "lever")}
    friction |= {f"{name}.viscous": 0.05 for name in ("outer_yaw", "shoulder", "rod", "lever")}
    real = arm.chain.with_parameters({**friction, "spring.stiffness": 200.0, "lever.mass": 3.0})
    random, t = np.random.default_rng(0), np.arange(0, 12, 0.005)
    logs = []
    for _ in range(2):
        a, b = random.uniform(-0.12, 0.12, (2, 3, 7))
        phase = 2 * np.pi * np.outer(t, [0.2, 0.5, 0.9])
        x = np.sin(phase) @ a + np.cos(phase) @ b
        true = coordinate_motion(real, t[::10], x[::10])
        tau = np.array([np.interp(t, true.t, column) for column in true.tau.T]).T
        tau += 0.01 * tau.std(axis=0) * random.normal(size=tau.shape)
        logs.append(np.hstack([np.round(x, 4), np.gradient(x, t, axis=0), tau]))
    dvrk.judged(arm, *logs, dvrk.OF_MTM)
    records = [line.split() for line in capsys.readouterr().out.splitlines()[3:]]
    assert max(float(error) for line in records for error in line[2:]) < 0.1


@pytest.mark.slow
def test_the_parameters_of_the_machine_are_within_their_intervals_and_predict_another_motion():
    """The drawn robot is 20 % too light and has no friction; by itself it misses by far more."""
    result = sst_identification.identified(2, duration=3.0, tries=1)
    assert (np.abs(result.missed) < 3).mean() > 0.93
    assert (result.unseen < 1.5 * result.least).all()
    assert (result.least < 1.3 * result.noise).all()
