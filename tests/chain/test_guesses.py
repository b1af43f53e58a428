# SPDX-License-Identifier: BSD-2-Clause
"""Guesses for robots whose configurations are no plain lists of angles."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import sst_pin

DELTA = Path(__file__).resolve().parents[2] / "examples" / "delta.urdf"


def test_a_guess_without_quaternions_is_the_way_from_the_neutral_configuration():
    """A ball counts three angles there, four numbers in q; both lead to the same robot."""
    delta = sst_pin.ClosedChain.from_urdf(DELTA)
    assert (delta.model.nq, delta.model.nv) == (19, 18)
    guess = pin.integrate(delta.model, pin.neutral(delta.model), np.full(18, 0.1))
    q = delta.assemble([0.1] * 18)
    assert np.array_equal(q, delta.assemble(guess))
    assert np.abs(delta.residual(q)).max() < 1e-11
    with pytest.raises(sst_pin.InputError, match=r"expected \(19,\)"):
        delta.assemble([0.1] * 17)


def test_joints_that_a_guess_does_not_name_start_from_home():
    """The SST's home follows from its dimensions; no description has to give it."""
    robot = sst_pin.SST()
    assert np.array_equal(robot.assemble({}), robot.home)
    assert np.abs(robot.assemble({"gamma_1": 0.8}) - robot.home).max() < 0.02
