# SPDX-License-Identifier: BSD-2-Clause
"""Motions go on where the coordinates do not determine them but the mechanism is regular."""

import warnings

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import make_interp_spline

import sst_pin
from sst_pin import robots
from tests.support.by_hand import add, at, mark


def by(chain, *names):
    """A robot of the gallery without weight, driven and described by other joints."""
    model = chain.model.copy()
    model.gravity.linear = np.zeros(3)
    return sst_pin.ClosedChain(model, chain.closures, names, coordinates=names)


def rod(kind, motor):
    """A crank and a slider or a second crank without weight, with a rod without mass between."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    joint, apart = (pin.JointModelPX, 0.0) if kind == "slider" else (pin.JointModelRZ, 0.5)
    for name, moves, x in (("crank", pin.JointModelRZ, 0.0), (kind, joint, apart)):
        inertia = pin.Inertia(1.0, np.array([0.1, 0.02, 0]), np.diag([0.01, 0.02, 0.02]))
        k = add(model, 0, moves(), name, at(x), inertia)
        mark(model, k, f"{name}_pin", at(0.0 if name == "slider" else 0.2))
    reach = 0.2 * np.cos(1.0) + np.sqrt(0.25 - (0.2 * np.sin(1.0)) ** 2)
    model.referenceConfigurations["home"] = np.array([1.0, reach if kind == "slider" else 1.0])
    return sst_pin.ClosedChain(model, [sst_pin.Distance("crank_pin", f"{kind}_pin", 0.5)], [motor])


@pytest.mark.parametrize(
    ("chain", "va"),
    [
        (by(robots.four_bar(crank=0.08, rocker=0.25), "rocker"), [-1.0]),
        (by(robots.five_bar(), "elbow_1", "elbow_2"), [3.0, 3.0]),
        (rod("slider", "slider"), [1.0]),  # one row, whose size tells how near they are
    ],
    ids=["four-bar by its rocker", "five-bar by its elbows", "crank by its slider"],
)
def test_idle_linkages_swing_through_their_dead_points(chain, va):
    """A free motion from home, without any warning."""
    tau = np.zeros(len(chain.motor_names))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = chain.simulate(tau, chain.home, va, np.linspace(0, 1, 31))
    assert not motion.stopped
    assert len(motion) == 31
    # Energies are compared where these rates determine those of the other joints well.
    condition = chain.condition_number(motion.q)
    assert condition.max() > 100
    sound = condition < 100
    assert sound.sum() > len(motion) / 2
    assert np.ptp(chain.kinetic_energy(motion.q[sound], motion.va[sound])) < 1e-8


@pytest.mark.slow
def test_results_and_torques_are_in_the_coordinates_of_the_robot():
    """Hinge 2 of Bricard's linkage turns round; a damper there is the same by hinge 1."""
    chain, t, seen = robots.bricard(), np.linspace(0, 2, 41), []
    second = sst_pin.ClosedChain(chain.model, chain.closures, ["hinge_2"])

    def torque(time, q, va):
        seen.append((time, q[1], va[0]))
        return -0.5 * va

    options = {"rtol": 1e-10, "atol": 1e-10}
    motion = second.simulate(torque, chain.home, [0.0], t, **options)
    assert not motion.stopped
    assert np.abs(motion.tau + 0.5 * motion.va).max() < 1e-12
    # va and aa are the derivatives of the hinge's angle, splines apart.
    angle, inner = make_interp_spline(t, motion.q[:, 1], k=5), slice(5, -5)
    assert np.abs(angle.derivative(1)(t) - motion.va[:, 0])[inner].max() < 1e-4
    assert np.abs(angle.derivative(2)(t) - motion.aa[:, 0])[inner].max() < 1e-2
    assert np.diff(np.sign(motion.va[1:, 0])).any()
    # The torque is called with the same hinge's angle and rate.
    times, angles, rates = np.array(seen).T
    assert np.abs(angle(times) - angles).max() < 1e-3
    assert np.abs(angle.derivative(1)(times) - rates).max() < 1e-2
    damped = sst_pin.ClosedChain(
        chain.model, chain.closures, ["hinge_1"], viscous_friction=[0, 0.5, 0, 0, 0]
    )
    expected = damped.simulate([0.0], chain.home, [0.0], t, **options)
    assert np.abs(motion.q - expected.q).max() < 1e-7


@pytest.mark.parametrize(
    ("through", "compiled"), [(True, True), pytest.param(False, False, marks=pytest.mark.slow)]
)
def test_a_loop_of_one_row_keeps_its_mode_where_its_row_vanishes(through, compiled):
    """A parallelogram with a rod is singular at 0: both cranks turn evenly, or the motion stops."""
    chain = rod("rocker", "crank")
    if compiled:
        chain.compile()
    t = np.linspace(0, 1.2, 13)
    for speed in (-5.0, -3.0):
        for tolerance in (1e-3, 1e-12):
            options = {"rtol": tolerance, "atol": tolerance, "through_singularities": through}
            with warnings.catch_warnings(record=True) as records:
                warnings.simplefilter("always")
                motion = chain.simulate([0.0], chain.home, [speed], t, **options)
            ahead = 1 + speed * motion.t[:, None]
            assert np.abs(motion.q - ahead).max() < 20 * tolerance + 1e-9
            assert bool(motion.stopped) is bool(records) is not through
            assert bool(motion.crossings) is through
