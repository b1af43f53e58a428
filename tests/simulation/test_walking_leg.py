# SPDX-License-Identifier: BSD-2-Clause
"""The leg of Theo Jansen's walking machines: three loops, eight ways to put it together."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import make_interp_spline

import sst_pin
from tests.support.by_hand import add, at, mark

#: Lengths of Jansen's bars by his letters, [m].
A, B, C, D, E, F, G, H, IN, J, K, LIFT, M = (
    np.array([380, 415, 393, 401, 558, 394, 367, 657, 490, 500, 619, 78, 150]) / 1000
)
WALKING = [0, 1.227, -1.286, 2.466, -2.315, -2.392, -2.352]


def corner(base, left, right):
    """The third corner of a triangle on x."""
    x = (left**2 + base**2 - right**2) / (2 * base)
    return x, np.sqrt(left**2 - x**2)


def place(model, q, frame):
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(frame)].translation[:2]


def leg(compiled):
    model = pin.Model()
    model.name, model.gravity.linear = "leg", np.array([0, -9.81, 0])

    def bar(name, on, start, **ends):
        middle = np.array([*np.mean([(0, 0), *ends.values()], axis=0), 0])
        body = pin.Inertia(1.0, middle, np.diag([0.01, 0.02, 0.03]))
        k = add(model, on, pin.JointModelRZ(), name, at(*start), body)
        for end, place in ends.items():
            mark(model, k, f"{name}_{end}", at(*place))
        return k

    crank = bar("crank", 0, (A, LIFT), end=(M, 0))
    upper = bar("upper", 0, (0, 0), rod=(B, 0), foot=corner(B, D, E))
    lower = bar("lower", 0, (0, 0), end=(C, 0))
    bar("upper_rod", crank, (M, 0), end=(J, 0))
    bar("lower_rod", crank, (M, 0), end=(K, 0))
    bar("link", upper, corner(B, D, E), end=(F, 0))
    bar("foot", lower, (C, 0), link=(G, 0), toe=corner(G, IN, H))
    closed = (
        ("upper_rod", "upper_rod_end"),
        ("lower_end", "lower_rod_end"),
        ("link_end", "foot_link"),
    )
    model.referenceConfigurations["home"] = np.array(WALKING)
    chain = sst_pin.ClosedChain(model, [sst_pin.Closure(*x, "3d") for x in closed], ["crank"])
    if compiled:
        chain.compile()
    return chain


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_leg_walks_in_one_mode_and_its_motor_gives_the_power(compiled):
    """The toe stays on Jansen's curve; the crank's torque is the rate of energy by differences."""
    chain, t = leg(compiled), np.linspace(0, 1, 401)
    motion = sst_pin.coordinate_motion(chain, t, 2 * np.pi * t[:, None])
    turns = (motion.q[-1] - motion.q[0]) / (2 * np.pi)
    assert_allclose(turns, [1, 0, 0, -1, -1, 0, 0], atol=1e-9)  # rods are turned on the crank
    toe = np.array([place(chain.model, q, "foot_toe") for q in motion.q])
    assert_allclose(toe.min(axis=0), [-0.335, -0.840], atol=2e-3)
    assert_allclose(toe.max(axis=0), [0.344, -0.616], atol=2e-3)
    tau = chain.compute_torques(motion.q, motion.va, motion.aa)[:, 0]
    energy = chain.kinetic_energy(motion.q, motion.va) + chain.potential_energy(motion.q)
    power = make_interp_spline(t, energy, k=9).derivative()(t)
    error = np.abs(tau * motion.va[:, 0] - power)[20:-20]  # splines are poor at their ends
    assert error.max() < 1e-7 * np.abs(power).max()
    swing = chain.simulate([0.0], motion.q[0], [3.0], np.linspace(0, 2, 21))
    energy = chain.kinetic_energy(swing.q, swing.va) + chain.potential_energy(swing.q)
    assert np.ptp(energy) < 1e-9
