# SPDX-License-Identifier: BSD-2-Clause
"""Torques computed once in each period, acting later, held in between."""

from collections import deque

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from tests.support.by_hand import add, at

KP, KD = 30.0, 4.0


def cart(mass):
    """One body that slides without weight."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    body = pin.Inertia(mass, np.zeros(3), np.eye(3))
    add(model, 0, pin.JointModelPZ(), "slide", at(), body)
    return sst_pin.ClosedChain(model, [], ["slide"])


def spring(t, q, va):
    """A spring and a damper to a place that moves."""
    return np.array([KP * (np.sin(t) - q[0]) - KD * va[0]])


@pytest.mark.parametrize("delay", [0.0, 0.007, 0.02, 0.053])
def test_a_cart_moves_as_constant_forces_move_it_by_hand(delay):
    """Between two changes of the force x and v are polynomials of time."""
    m, period, count, called = 2.0, 0.02, 20, []
    x, v, force, waiting = 0.3, -0.1, 0.0, deque()
    places, forces = [x], []
    for k in range(count):
        t = k * period
        waiting.append((t + delay, KP * (np.sin(t) - x) - KD * v))
        until, forces_now = t + period, []
        while t < until - 1e-9:
            while waiting and waiting[0][0] < t + 1e-9:
                force = waiting.popleft()[1]
            forces_now.append(force)
            h = min(until, waiting[0][0] if waiting else until) - t
            x, v, t = x + v * h + force / m / 2 * h * h, v + force / m * h, t + h
        places.append(x)
        forces.append(forces_now[0])

    def law(t, q, va):
        called.append((t, q[0]))
        return spring(t, q, va)

    torque = sst_pin.SampledTorque(law, period, delay=delay)
    motion = cart(m).simulate(torque, [0.3], [-0.1], np.arange(count + 1) * period)
    assert np.abs(motion.q[:, 0] - places).max() < 1e-13
    assert np.abs(motion.tau[:-1, 0] - forces).max() < 1e-11
    # The function is called once in each period, in the order of time.
    assert np.abs(called - np.column_stack([motion.t, motion.q])[:-1]).max() < 1e-12
    other = cart(m).simulate(
        sst_pin.SampledTorque(spring, period, delay=delay), [0.3], [-0.1], [0, 0.111, 0.4]
    )
    assert abs(other.q[-1] - motion.q[-1]) < 1e-12  # whatever the times of the output


def test_torques_that_a_caller_changes_do_not_change_those_that_act():
    torque = sst_pin.SampledTorque(lambda t, q, va: [1.0], 1.0)
    tau = torque.torque(0.0, np.zeros(1), np.zeros(1))
    tau += 5.0
    assert torque.torque(0.5, np.zeros(1), np.zeros(1)) == [1.0]


def test_a_plain_number_is_no_torque_of_each_motor():
    torque = sst_pin.SampledTorque(lambda t, q, va: 1.0, 1.0)
    with pytest.raises(sst_pin.InputError, match=r"shape \(\), expected \(motors,\)"):
        torque.torque(0.0, np.zeros(1), np.zeros(1))
