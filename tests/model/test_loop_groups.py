# SPDX-License-Identifier: BSD-2-Clause
"""Each loop is judged by its own length; what rounding has put beside zero is no length."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from sst_pin import ClosedChain, Closure, ClosureError
from tests.support.by_hand import add, at, mark
from tests.support.planar_bars import planar

#: Crank, coupler and rocker of a four-bar with its ground of 0.4 m.
BARS = [("crank", 0.0, 0.1), ("coupler", 0.1, 0.3), ("rocker", 0.4, 0.25)]


def four_bars(sizes, places, carrier="universe", model=None):
    """Four-bars of these sizes, at these places on the ground or on a joint."""
    bars, closures = [], []
    for k, (size, place) in enumerate(zip(sizes, places, strict=True)):
        for name, x, length in BARS:
            parent = f"crank_{k}" if name == "coupler" else carrier
            start = size * x + (0.0 if name == "coupler" else place)
            bars.append((f"{name}_{k}", parent, start, size * length))
        closures.append(Closure(f"coupler_{k}_end", f"rocker_{k}_end", "3d"))
    return ClosedChain(planar(bars, model=model), closures, [c for c, *_ in bars if "crank" in c])


def test_a_loop_open_by_less_than_a_millimetre_is_open_beside_a_robot_a_kilometre_away():
    near, far = four_bars([1], [0.0]), four_bars([1, 1], [0.0, 1000.0])
    guess = np.array([0.7, 0.6, 1.8])
    q = near.assemble(guess, ["crank_0"])
    both = far.assemble(np.tile(q, 2), ["crank_0", "crank_1"])
    assert_allclose(both, np.tile(q, 2), atol=1e-11)
    both[2] += 1e-3
    assert np.abs(far.residual(both)).max() < 1e-3
    with pytest.raises(ClosureError, match="lengths of the loop"):
        far.compute_torques(both, np.zeros(2), np.zeros(2))


def test_a_gripper_on_a_crane_is_judged_as_the_gripper_alone():
    """A four-bar of 4 mm at the end of a boom of 40 m."""
    model = pin.Model()
    weight = pin.Inertia.FromSphere(100.0, 1.0)
    boom = add(model, 0, pin.JointModelRY(), "boom", at(), weight)
    add(model, boom, pin.JointModelRY(), "hand", at(40.0), weight)
    crane, alone = four_bars([0.01], [0.0], "hand", model), four_bars([0.01], [0.0])
    guess = np.array([0.7, 0.6, 1.8])
    q = alone.assemble(guess, ["crank_0"])
    assert_allclose(crane.assemble([0.3, 0.2, *guess], ["crank_0"])[2:], q, atol=1e-9)
    assert crane.mechanism.row_scale == pytest.approx(alone.mechanism.row_scale)
    assert crane.condition_number([0, 0, *q]) == pytest.approx(alone.condition_number(q), rel=1e-6)
    assert crane.degrees_of_freedom == 2 + alone.degrees_of_freedom
    q[2] += 1e-3  # a hair of the crane, much of the gripper
    with pytest.raises(ClosureError, match="the loops are open"):
        crane.compute_torques([0.3, 0.2, *q], np.zeros(3), np.zeros(3))


def test_where_a_robot_stands_does_not_count():
    model = planar([("arm", "universe", 1000.0, 0.5)])
    mark(model, 1, "hand", at(0.5))
    assert ClosedChain(model, [], ["arm"]).mechanism.length == 1.0  # an arm without joints on it
    assert four_bars([1, 1], [0.0, 1e3]).mechanism.length == pytest.approx(0.4)
