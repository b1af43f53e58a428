# SPDX-License-Identifier: BSD-2-Clause
"""What is kept in motion: energy, momentum, rolling; with springs, floating bases, wheels."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from sst_pin import ClosedChain, Closure, LineForce
from sst_pin.model.closures import Rolling
from tests.gallery.touching import tree
from tests.support.by_hand import add, at, mark
from tests.support.planar_bars import planar

SHAPE = np.diag([0.02, 0.03, 0.035])
LOOP = Closure("coupler_end", "rocker_end", "3d")


def body(model, parent, joint, name, place=(), mass=1.0, lever=(0.2, 0.02, 0.01)):
    return add(model, parent, joint, name, at(*place), pin.Inertia(mass, np.array(lever), SHAPE))


def four_bar_on(model, base):
    """A four-bar linkage, its ground link on a body; the angles near its closure."""
    bars = [("crank", base, 0.0, 0.3), ("coupler", "crank", 0.3, 0.7), ("rocker", base, 0.8, 0.6)]
    planar(bars, model=model)
    return np.array([1.2, -0.7, 2.0])


def momentum(chain, q, va):
    """Linear momentum, and angular momentum about the origin."""
    model, data = chain.model, chain.model.createData()
    pin.computeCentroidalMomentum(model, data, q, chain.joint_rates(q, va))
    linear, angular = data.hg.linear.copy(), data.hg.angular.copy()
    return linear, angular + np.cross(data.com[0], linear)


@pytest.mark.parametrize("seconds", [2, pytest.param(100, marks=pytest.mark.slow)])
def test_a_free_closed_robot_keeps_energy_and_momentum(seconds):
    """A tumbling four-bar in space: to 1e-9 of their size, whatever the time."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    body(model, 0, pin.JointModelFreeFlyer(), "base", mass=2.0)
    guess = np.concatenate([pin.neutral(model), four_bar_on(model, "base")])
    chain = ClosedChain(model, [LOOP], [])
    if seconds > 10:  # on the reference path for a short time only
        chain.compile()
    q = chain.assemble(guess)
    va = np.array([0.1, 0.2, -0.1, 0.3, 0.5, 0.4, 1.0])
    times = np.linspace(0, seconds, 11)
    motion = chain.simulate(np.zeros(0), q, va, times, rtol=1e-13, atol=1e-13)
    energy = chain.kinetic_energy(motion.q, motion.va)
    assert_allclose(energy, energy[0], rtol=1e-9)
    kept = [momentum(chain, *sample) for sample in zip(motion.q, motion.va, strict=True)]
    for quantity in map(np.array, zip(*kept, strict=True)):
        assert np.abs(quantity - quantity[0]).max() < 1e-9 * np.linalg.norm(quantity[0])
    # It has moved, and its loop stayed closed.
    assert np.abs(motion.q[-1] - motion.q[0]).max() > 0.1
    assert max(np.abs(chain.residual(q)).max() for q in motion.q) < 1e-10


def vehicle(kind):
    """What rolls, its configuration and rates of the coordinates."""
    model = pin.Model()
    model.gravity.linear = np.array([0, 0, -9.8])
    axle = at(turned=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))  # z of the frame along y
    if kind == "disc":
        body(model, 0, pin.JointModelFreeFlyer(), "disc", lever=(0, 0, 0))
        mark(model, 1, "wheel", axle)
        q = pin.neutral(model)
        q[2], q[3:] = 0.25, pin.Quaternion(pin.exp3(np.array([0.3, 0, 0]))).coeffs()
        return model, [Rolling("universe", "wheel", 0.25)], [], q
    base = body(model, 0, pin.JointModelPlanar(), "base", lever=(0.05, 0, 0.3), mass=5.0)
    wheels = []
    for side, y in (("left", 0.3), ("right", -0.3)):
        joint = body(model, base, pin.JointModelRY(), side, (0, y, 0.25), lever=(0, 0, 0))
        mark(model, joint, side, axle)
        wheels.append(Rolling("universe", side, 0.25))
    q = np.concatenate([pin.neutral(model), four_bar_on(model, "base")])
    return model, [*wheels, LOOP], ["left", "right", "crank"], q


@pytest.mark.parametrize("kind", ["disc", "vehicle"])
def test_what_rolls_keeps_its_energy_and_does_not_slip(kind):
    """A leaning disc, a cart on two wheels with a four-bar."""
    model, closures, motors, guess = vehicle(kind)
    chain = ClosedChain(model, closures, motors)
    q = chain.assemble(guess, fixed=())
    va = np.random.default_rng(0).normal(size=chain.degrees_of_freedom)
    va[np.abs(va) > 1] = 0.5
    motion = chain.simulate(np.zeros(len(motors)), q, va, np.linspace(0, 0.3, 7))
    energy = chain.kinetic_energy(motion.q, motion.va) + chain.potential_energy(motion.q)
    assert np.abs(energy - energy[0]).max() < 1e-9 * chain.kinetic_energy(q, va)
    for q, va in zip(motion.q, motion.va, strict=True):
        v = chain.joint_rates(q, va)
        assert np.abs(chain.Phi(q) @ v).max() < 1e-12 * np.abs(v).max()


def on_a_cable(**numbers):
    """A body of 1 kg that slides along x, on an elastic cable from the origin."""
    model = tree(("slide", pin.JointModelPX(), 1.0, 1.0), gravity=False)
    mark(model, 1, "hook", at())
    cable = LineForce("universe", "hook", pulls_only=True, **numbers)
    return ClosedChain(model, [], [], coordinates=["slide"], lines=[cable])


@pytest.mark.parametrize(
    ("length", "rate", "tension", "of_spring"),
    [
        (0.6, 1.0, 5.0, 1.0),  # spring and damper pull
        (0.6, -1.0, 0.0, 1.0),  # the damper takes the whole pull of the spring
        (0.4, 1.0, 3.0, 0.0),  # the damper pulls, less the push of the spring
        (0.4, -1.0, 0.0, 0.0),
    ],
)
def test_a_damped_cable_takes_the_power_of_its_tension_beyond_its_spring(
    length, rate, tension, of_spring
):
    """By hand: stiffness 10 N/m, rest length 0.5 m, damping 4 N s/m, along a slide."""
    chain = on_a_cable(stiffness=10, rest_length=0.5, damping=4)
    assert chain.compute_accelerations([length], [rate], []) == pytest.approx(-tension)
    power = chain.friction_power([length], [rate])
    assert power == pytest.approx(-(tension - of_spring) * rate, abs=1e-12)


def test_a_cable_that_never_pulls_has_no_energy():
    chain = on_a_cable(preload=-3.0, damping=1.0)
    assert chain.potential_energy([[0.2], [0.9]]).tolist() == [0.0, 0.0]
