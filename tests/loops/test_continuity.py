# SPDX-License-Identifier: BSD-2-Clause
"""Motions are followed from pose to pose in bounded work."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, Closure, Coupling
from sst_pin.errors import ClosureError
from sst_pin.loops.loops import Loops
from tests.support.by_hand import add
from tests.support.planar_bars import planar


@pytest.fixture
def evaluations(monkeypatch):
    """The configurations at which loops are evaluated; more than 30,000 are an error."""
    configurations, evaluate = [], Loops.evaluate

    def counted(self, q):
        configurations.append(q)
        assert len(configurations) < 30_000
        evaluate(self, q)

    monkeypatch.setattr(Loops, "evaluate", counted)
    return configurations


def test_motors_behind_gears_ask_for_no_more_poses_than_the_crank_they_drive(evaluations):
    """Two motors in a row behind 1:157: the crank turns by 3 rad, each motor by 471 rad."""
    bars = [("crank", "universe", 0, 0.3), ("coupler", "crank", 0.3, 0.7)]
    model = planar([*bars, ("rocker", "universe", 0.8, 0.6)])
    joints, closures = ["crank"], [Closure("coupler_end", "rocker_end", "3d")]
    counts = []
    for k, ratio in enumerate((157, 1, 1)):
        chain = ClosedChain(model, closures, [joints[-1]])
        q = chain.assemble(np.array([0.3, -0.2, 1.0, *[47.1] * k]), ["crank"])
        evaluations.clear()
        chain.engine.reference.moved(q, np.array([471.0 if k else 3.0]))
        counts.append(len(evaluations))
        body = pin.Inertia(1.0, np.zeros(3), np.eye(3))
        add(model, 0, pin.JointModelRZ(), f"motor_{k}", pin.SE3.Identity(), body)
        closures.append(Coupling(f"motor_{k}", {joints[-1]: (0, ratio)}))
        joints.append(f"motor_{k}")
    assert max(counts) < 2 * counts[0]


def test_a_jump_of_a_thousand_turns_is_refused_and_says_so():
    chain = sst_pin.robots.four_bar()
    x = chain.home[0] + np.array([[0.0], [0.0], [2e3 * np.pi], [2e3 * np.pi]])
    with pytest.warns(match="full turn"), pytest.raises(ClosureError) as caught:
        sst_pin.coordinate_motion(chain, range(4), x, chain.home)
    assert "index 2" in str(caught.value)
    assert "give poses in between" in str(caught.value)
