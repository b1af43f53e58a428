# SPDX-License-Identifier: BSD-2-Clause
"""Failure is loud, specific, and says what to do."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import errors
from sst_pin.errors import InputError, UnknownNameError
from tests.support.by_hand import at, mark
from tests.support.derivative_cases import carried_four_bar
from tests.support.planar_bars import planar

HOME = sst_pin.SST().home


def four_bar(crank, coupler, rocker, base):
    """Model with the end of the rocker and the pivot that it belongs on; axes along y."""
    bars = [("crank", "universe", 0.0, crank), ("coupler", "crank", crank, coupler)]
    model = planar([*bars, ("rocker", "coupler", coupler, rocker)], pin.JointModelRY)
    mark(model, 0, "pivot", at(base))
    return model, [sst_pin.Closure("rocker_end", "pivot", "3d")]


def test_assembly_that_is_impossible_says_soon_how_far_it_came(monkeypatch):
    """Links of 0.2 + 0.3 + 0.2 m do not span 1 m: the residual that stays is in the message."""
    chain = sst_pin.ClosedChain(*four_bar(0.2, 0.3, 0.2, 1.0), ["crank"])
    lstsq, solved = np.linalg.lstsq, []
    monkeypatch.setattr(np.linalg, "lstsq", lambda *x, **y: solved.append(1) or lstsq(*x, **y))
    with pytest.raises(sst_pin.ClosureError, match="cannot be closed") as caught:
        chain.assemble([0.1, 0.2, -0.1], fixed=())
    assert caught.value.residual > 0.29  # m
    assert len(solved) < 40  # a tenth is not gained in ten steps: 100 otherwise
    with pytest.raises(sst_pin.ClosureError):
        chain.mobility()


def test_assemble_holds_the_joints_it_was_told_to_hold(robot):
    q = HOME + 0.01 * np.arange(9)
    for fixed, held in ((None, [0, 3, 6]), (["mu_1", "mu_2", "mu_3"], [1, 4, 7]), ((), [])):
        closed = robot.assemble(q, fixed=fixed)
        assert np.abs(robot.residual(closed)).max() < 1e-12
        assert np.array_equal(closed[held], q[held])
    with pytest.raises(UnknownNameError, match="joint 'gama_1' not in the model; known: gamma_1"):
        robot.assemble(q, fixed=["gama_1"])


@pytest.fixture(scope="module")
def afloat():
    """A four-bar on a base that floats, whose quaternion no loop depends on."""
    model, closures, _, _ = carried_four_bar(pin.JointModelFreeFlyer())
    return sst_pin.ClosedChain(model, closures, ["crank"])


def test_a_quaternion_off_length_one_is_that_samples_fault(afloat):
    """Wherever q goes in, named among the samples; NaN where samples at fault become NaN."""
    q, one = afloat.generic_configuration(), np.ones(7)
    long, unknown = q.copy(), q.copy()
    long[3:7] *= 1.1
    unknown[4] = np.nan
    for wrong, word in ((long, "differs from 1 by 0.1"), (unknown, r"entry \[4\] is nan")):
        for call in (
            afloat.residual,
            afloat.Phi,
            afloat.condition_number,
            afloat.mobility,
            afloat.potential_energy,
            lambda q: afloat.noc(q, one),
            lambda q: afloat.joint_rates(q, one),
            lambda q: afloat.frame_jacobian(q, "A"),
            lambda q: afloat.rollout(np.zeros((3, 1)), q, one, 1e-3),
        ):
            with pytest.raises(InputError, match=word):
                call(wrong)
        batch = np.array([q, wrong, q])
        with pytest.raises(InputError, match=word) as caught:
            afloat.generalized_forces(batch, one, one)
        assert caught.value.samples == ((1,),)
        f = afloat.generalized_forces(batch, one, one, on_error="nan")
        assert np.isnan(f[1]).all()
        assert np.array_equal(f[[0, 2]], [afloat.generalized_forces(q, one, one)] * 2)
        rolled = afloat.rollout(np.zeros((3, 3, 1)), batch, one, 1e-3, on_error="nan")
        assert np.isnan(rolled.q).all(axis=(1, 2)).tolist() == [False, True, False]


def test_motors_that_are_more_are_told(robot):
    pairs = [("closedloop1_A", "closedloop1_B"), ("closedloop2_A", "closedloop2_B")]
    many = sst_pin.ClosedChain(robot.model, pairs, ["gamma_1", "gamma_2", "gamma_3", "mu_1"])
    assert many.coordinates == ("gamma_1", "gamma_2", "gamma_3")
    assert many.mobility(HOME).redundantly_actuated
    assert "REDUNDANT: 1 more" in str(many.mobility(HOME))


def test_names_that_are_not_there_are_told_with_those_that_are(robot):
    model = robot.model
    with pytest.raises(UnknownNameError, match=r"frame 'F' not in the model; known: .*star_1"):
        sst_pin.ClosedChain(model, [("F", "closedloop1_B")], ["gamma_1"])
    with pytest.raises(UnknownNameError) as caught:
        sst_pin.ClosedChain(model, [("closedloop1_A", "closedloop1_B")], ["gamma_4"])
    assert caught.value.name == "gamma_4"
    assert "gamma_3" in caught.value.known
    with pytest.raises(sst_pin.DescriptionError, match="known: 6d, 3d, orientation"):
        sst_pin.Closure("a", "b", "5d")


@pytest.mark.parametrize(
    "error",
    [
        errors.InputError("q", "bad"),
        errors.ParametersError(["a", "b"]),
        errors.DescriptionError("file", ["a"]),
        errors.UnknownNameError("joint", "x", ["y"]),
        errors.ClosureError("open", 0.1),
        errors.SingularConfigurationError("flat", 1e9),
        errors.SimulationError("gave up", 1.5),
        errors.FileFormatError("a.csv", "text", 3),
        errors.OutputError("a.csv", "exists"),
        errors.MissingExtraError("matplotlib", "plot"),
    ],
)
def test_errors_come_back_whole_from_worker_processes(error):
    copy = pickle.loads(pickle.dumps(error))
    assert isinstance(copy, sst_pin.SSTError)
    assert str(copy) == str(error)
    assert copy.__dict__ == error.__dict__
    assert getattr(copy, "name", "") == getattr(error, "name", "")


def test_a_tendon_is_called_by_its_shares():
    model, closures = four_bar(0.2, 0.3, 0.25, 0.3)
    chain = sst_pin.ClosedChain(model, closures, [{"crank": -1.5, "coupler": -0.5, "rocker": 2}])
    assert chain.motor_names == ("-1.5 crank - 0.5 coupler + 2 rocker",)


def test_wrenches_that_are_not_finite_and_what_overflows_are_told(afloat):
    q, one = afloat.generic_configuration(), np.ones(7)
    wrenches = np.zeros((3, afloat.model.njoints - 1, 6))
    wrenches[1, 0, 3] = np.inf
    with pytest.raises(InputError, match="external_wrenches") as caught:
        afloat.generalized_forces(q, one, one, external_wrenches=wrenches)
    assert caught.value.samples == ((1,),)
    f = afloat.generalized_forces(q, one, one, external_wrenches=wrenches, on_error="nan")
    assert np.isnan(f).all(axis=1).tolist() == [False, True, False]
    with pytest.raises(InputError, match=r"result: not finite: .* too large"):
        afloat.generalized_forces(q, 1e200 * one, one)
