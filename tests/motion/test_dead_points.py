# SPDX-License-Identifier: BSD-2-Clause
"""Motions go on where the coordinates do not determine them but the mechanism is regular."""

import warnings

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import sst_pin
from sst_pin import robots


def by(chain, *names):
    """The mechanism without weight, driven and described by other joints."""
    model = chain.model.copy()
    model.gravity.linear = np.zeros(3)
    return sst_pin.ClosedChain(model, chain.closures, names, coordinates=names)


def kinetic_energy(chain, motion):
    """Where the rates of the coordinates determine those of the other joints well."""
    sound = chain.condition_number(motion.q) < 100
    assert sound.sum() > len(motion) / 2
    return chain.kinetic_energy(motion.q[sound], motion.va[sound])


def idle_linkages(random):
    """Planar and spatial ones whose motors have dead points."""
    crank, rocker = random.uniform(0.05, 0.12), random.uniform(0.22, 0.3)
    planar = robots.four_bar(crank=crank, rocker=rocker)
    return {
        "four-bar by its rocker": by(planar, planar.joint_names[-1]),
        "slider-crank by its slider": by(robots.slider_crank(), "slider"),
        "five-bar by its elbows": by(robots.five_bar(), "elbow_1", "elbow_2"),
        "Bennett's linkage": by(robots.bennett(), robots.bennett().joint_names[1]),
        "Bricard's linkage by hinge 2": by(robots.bricard(), "hinge_2"),
    }


def swing(chain, seconds, random, compiled):
    """A free motion from home at random rates, without any warning."""
    if compiled:
        chain.compile()
    va = random.uniform(0.5, 1, chain.degrees_of_freedom)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return chain.simulate(
            np.zeros(len(chain.motor_names)), chain.home, va, np.linspace(0, seconds, 101)
        )


LINKAGES = idle_linkages(np.random.default_rng(0))
CASES = [
    pytest.param(which, compiled, marks=[pytest.mark.slow] * (compiled or "slider" in which))
    for which in LINKAGES
    for compiled in (False, True)
]


@pytest.mark.parametrize(("which", "compiled"), CASES)
def test_idle_linkages_swing_through_their_dead_points(which, compiled):
    """The first two take a second for each second: their cranks turn four times in it."""
    random = np.random.default_rng(3)
    seconds = 1 if not compiled else 10 if "by its" in which and "elbows" not in which else 100
    chain = idle_linkages(random)[which]
    motion = swing(chain, seconds, random, compiled)
    assert not motion.stopped
    assert len(motion) == 101
    energy = kinetic_energy(chain, motion)
    assert np.ptp(energy) < 1e-8


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


def test_torques_at_a_dead_point_are_refused_by_name():
    """The motion has one, but no torque of the motor describes it."""
    chain = idle_linkages(np.random.default_rng(0))["four-bar by its rocker"]
    flat = chain.assemble({"coupler": 0.0})  # in line with the crank
    with pytest.raises(sst_pin.SingularConfigurationError, match="crank, coupler"):
        chain.compute_torques(flat, [1.0], [0.0])
