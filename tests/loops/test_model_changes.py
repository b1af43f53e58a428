# SPDX-License-Identifier: BSD-2-Clause
"""Whatever changes in the model, a chain computes what a newly built one computes."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, Closure
from tests.support import any_chain
from tests.support.any_chain import tree

MOTORS = ["a0_RY", "b0_RY"]


def _array(name):
    return lambda model: setattr(model, name, getattr(model, name) * 0.7 + 0.03)


def _set(attributes, value):
    """What sets, by a path such as "inertias.2.mass", one number or array of a model."""

    def change(model):
        *owners, last = attributes.split(".")
        for x in owners:
            model = model[int(x)] if x.isdecimal() else getattr(model, x)
        if last.isdecimal():
            model[int(last)] = value
        else:
            setattr(model, last, value)

    return change


def _load(model):
    model.addBodyFrame("load", 2, pin.SE3.Identity(), 0)
    model.appendBodyToJoint(2, pin.Inertia.Random(), pin.SE3.Identity())


def _joint(model):
    index = model.addJoint(2, pin.JointModelRX(), pin.SE3.Random(), "tail")
    model.appendBodyToJoint(index, pin.Inertia.Random(), pin.SE3.Identity())


def _in_memory(model):
    model.gravity.linear[:] = (1.0, 2.0, 3.0)


PLACE = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([1.0, 2, 3]))
CHANGES = {
    **{name: _array(name) for name in ("armature", "damping", "friction")},
    "mass": _set("inertias.2.mass", 7.0),
    "placement": _set("jointPlacements.1", PLACE),
    "gravity in memory": _in_memory,
    "body": _load,
    "frame": lambda m: m.addFrame(pin.Frame("tool", 2, pin.SE3.Random(), pin.FrameType.OP_FRAME)),
    "joint": _joint,
}


def build(model):
    return ClosedChain(model, [Closure("A", "B", "6d")], MOTORS)


def floating():
    """Three and three joints on a base that floats."""
    model = tree("free-flyer", ["RY", "revolute", "RY"], ["RY", "revolute", "spherical"], seed=2)
    model.referenceConfigurations["home"] = model.referenceConfigurations["closed"]
    return model


@pytest.fixture
def chain():
    """A robot whose model a test may change."""
    return build(floating())


def everything(chain, q, random):
    """All results that depend on the numbers of a model, by single samples and by batches."""
    n, m = chain.mobility(q).degrees_of_freedom, len(chain.motor_names)
    va, aa = random.normal(size=(2, n))
    result = [chain.friction.viscous, chain.friction.coulomb, chain.noc(q, va).inertia]
    frame = chain.model.frames[1].name
    for x in (q, np.stack([q, q])):
        result += chain.torque_derivatives(x, va, aa)
        result += chain.acceleration_derivatives(x, va, np.ones(m))
        result += [chain.compute_accelerations(x, va, np.ones(m)), chain.joint_rates(x, va)]
        result += [chain.generalized_forces(x, va, aa), chain.potential_energy(x)]
        result += [chain.kinetic_energy(x, va), chain.frame_jacobian(x, frame)]
    return np.concatenate([np.ravel(x) for x in result])


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_model_counts_after_refresh_and_not_before(chain, name):
    """To the last bit, for every method: before as before, then as a newly built chain."""
    model, q = chain.model, chain.model.referenceConfigurations["closed"]
    before = everything(chain, q, np.random.default_rng(0))
    pin.seed(0)
    CHANGES[name](model)
    assert np.array_equal(everything(chain, q, np.random.default_rng(0)), before)
    q = np.concatenate([q, np.zeros(model.nq - len(q))])
    model.referenceConfigurations["home"] = q
    chain.refresh()
    new = build(pin.Model(model))
    one, other = (everything(robot, q, np.random.default_rng(0)) for robot in (chain, new))
    assert np.array_equal(one, other)


@pytest.mark.filterwarnings("ignore:.*the first moment and the inertia of the body stay")
def test_what_the_caller_gave_is_the_robot_and_not_the_caller_s_own():
    """Lists, dictionaries and arrays changed afterwards, and generators, count once."""
    plain = sst_pin.robots.four_bar()
    motors, tendon, friction = ["rocker"], {"crank": 1.0, "rocker": -1.0}, np.ones(3)
    closures, rest = list(plain.closures), {"spring_reference": np.full(3, 0.1)}
    motors.append(tendon)
    chain = ClosedChain(
        plain.model,
        closures,
        (motor for motor in motors),
        coordinates=iter(["crank"]),
        viscous_friction=friction,
        stiffness=friction,
        **rest,
    )
    state = chain.home, [1.0], [0.5]
    before = chain.compute_torques(*state)
    motors.append("coupler"), closures.clear()
    tendon["rocker"], friction[:], rest["spring_reference"][:] = 7.0, 5.0, 5.0
    chain.refresh()
    others = [pickle.loads(pickle.dumps(chain)), copy.deepcopy(chain)]
    others += [chain.with_coordinates(["crank"]), chain.with_parameters({"crank.mass": 1.0})]
    for other in (chain, *others):
        assert other.motor_names == ("rocker", "1 crank - 1 rocker")
        assert other.coordinates == ("crank",)
    for other in (chain, *others[:3]):
        np.testing.assert_allclose(other.compute_torques(*state), before, rtol=1e-12)


@pytest.mark.parametrize("copied", [lambda c: c, lambda c: pickle.loads(pickle.dumps(c))])
def test_arrays_of_a_robot_are_read_only(copied):
    chain = copied(sst_pin.robots.four_bar())
    mechanism = chain.mechanism
    names = ["coordinates", "actuation", "example", "dependent", "selection"]
    names += ["possible_springs", "driven", "row_scale", "rate_scale"]
    arrays = [getattr(mechanism, name) for name in names]
    arrays += [chain.actuation, chain.motor_indices, chain.friction.viscous, chain.friction.coulomb]
    arrays += [mechanism.springs.stiffness, mechanism.springs.reference]
    arrays.append(mechanism.lines.actuation)
    assert not any(array.flags.writeable for array in arrays)


def test_an_sst_in_other_coordinates_has_its_platform():
    robot = sst_pin.SST()
    other = robot.with_coordinates(["mu_1", "mu_2", "mu_3"])
    how = {"platform_moment": [0.3, -0.2, 0.5]}
    rest = robot.home, np.zeros(3), np.zeros(3)
    tau = robot.compute_torques(*rest, **how)
    np.testing.assert_allclose(other.compute_torques(*rest, **how), tau, atol=1e-11)


@pytest.mark.parametrize(
    "change", [_set("inertias.2.mass", np.nan), _set("gravity.angular", np.array([0.0, 0.0, 1.0]))]
)
@pytest.mark.parametrize("compiled", [True, False])
def test_a_model_that_is_refused_leaves_the_robot_as_it_was(compiled, change):
    robot = sst_pin.robots.four_bar()
    if compiled:
        robot.compile()
    motion = robot.home, [1.0], [1.0]
    before = robot.compute_torques(*motion)
    change(robot.model)
    for _ in range(3):
        with pytest.raises(sst_pin.DescriptionError, match=r"NaN|gravity\.angular"):
            robot.refresh()
        assert np.array_equal(robot.compute_torques(*motion), before)


def compiled():
    chain = sst_pin.robots.four_bar()
    chain.compile()
    return chain


@pytest.mark.parametrize("make", [lambda: build(floating()), any_chain.lines, compiled])
def test_copies_threads_and_other_processes_compute_the_same(make):
    """In the coordinates and with the lines of the original, whoever asks a new robot first."""
    chain = make()
    states = any_chain.states(chain, 8, 0)
    q, random = states[0][0], np.random.default_rng
    wanted = everything(chain, q, random(0))
    for copied in (copy.copy, copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))):
        other = copied(chain)
        assert np.array_equal(everything(other, q, random(0)), wanted)
        for name in ("coordinates", "lines", "backend"):
            assert getattr(other, name) == getattr(chain, name)
    lines, wanted = chain.lines, [chain.generalized_forces(*x) for x in zip(*states, strict=True)]
    with ThreadPoolExecutor(8) as pool:
        for _ in range(5):
            assert np.array_equal(list(pool.map(make().generalized_forces, *states)), wanted)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        calls = zip(*states, strict=True)
        assert np.array_equal(pool.starmap(chain.generalized_forces, calls), wanted)
    chain.refresh()
    assert chain.lines == lines
