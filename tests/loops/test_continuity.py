# SPDX-License-Identifier: BSD-2-Clause
"""Motions are followed from pose to pose in bounded work."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, Closure, Coupling
from sst_pin.errors import ClosureError
from sst_pin.loops.loops import Loops
from tests.support.by_hand import add, at, mark
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


def humanoid(digits=None):
    """Limbs of 14 four-bars, the coupler of each welded to a pin on the end of its rocker.

    Link frames are turned at random, as CAD turns them, and placements have a few digits.
    """
    random, model, closures = np.random.default_rng(0), pin.Model(), []
    body = pin.Inertia(0.2, np.array([0.02, 0, 0]), 1e-4 * np.eye(3))

    def turned():
        return pin.SE3(pin.Quaternion(random.normal(size=4)).normalized(), np.zeros(3))

    def rounded(M):
        if digits is None:
            return M
        rpy = pin.rpy.matrixToRpy(M.rotation).round(digits)
        return pin.SE3(pin.rpy.rpyToMatrix(rpy), M.translation.round(digits))

    def bar(parent, name, place, before, frame):
        joint = pin.JointModelRevoluteUnaligned(frame.rotation.T[:, 2])
        return add(model, parent, joint, name, rounded(before.inverse() * place * frame), body)

    trunk = add(model, 0, pin.JointModelFreeFlyer(), "trunk", pin.SE3.Identity(), body)
    for k in range(14):
        if k % 4 == 0:
            bearer, before = trunk, pin.SE3.Identity()
        place = turned() * at(*(0.1 * random.normal(size=3)))
        frames = [turned() for _ in range(4)]
        crank = bar(bearer, f"crank_{k}", place, before, frames[0])
        coupler = bar(crank, f"coupler_{k}", at(0.03), frames[0], frames[1])
        rocker = bar(bearer, f"rocker_{k}", place * at(0.08), before, frames[2])
        end = bar(rocker, f"pin_{k}", at(0.04), frames[2], frames[3])
        mark(model, coupler, f"a_{k}", rounded(frames[1].inverse() * at(0.07)))
        mark(model, end, f"b_{k}", rounded(frames[3].inverse()))
        closures.append(Closure(f"a_{k}", f"b_{k}", "6d"))
        bearer, before = rocker, frames[2]
    return model, closures, [f"crank_{k}" for k in range(14)]


def test_a_robot_of_fourteen_rounded_loops_is_read_in_bounded_work(evaluations):
    """MuJoCo's welds close exactly at the first pose, and elsewhere only to the digits."""
    home = ClosedChain(*humanoid()).generic_configuration()
    model, closures, motors = humanoid(digits=5)
    data = model.createData()
    pin.framesForwardKinematics(model, data, home)
    for closure in closures:
        a, b = (model.getFrameId(name) for name in (closure.frame_a, closure.frame_b))
        bearer = data.oMi[model.frames[b].parentJoint]
        model.frames[b].placement = bearer.inverse() * data.oMf[a]
    model.referenceConfigurations["home"] = home
    evaluations.clear()
    ClosedChain(model, closures, motors)
    assert len(evaluations) < 20_000  # about 0.1 ms each


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
