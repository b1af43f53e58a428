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
from trees import tree

MOTORS = ["a0_RX", "b0_RZ"]


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


BODY = pin.Inertia(3.0, np.array([0.1, 0.0, 0.2]), np.diag([0.4, 0.5, 0.6]))
PLACE = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([1.0, 2, 3]))
CHANGES = {
    **{n: _array(n) for n in ("armature", "damping", "friction", "rotorInertia", "rotorGearRatio")},
    **{n: _array(n) for n in ("upperPositionLimit", "lowerPositionLimit", "velocityLimit")},
    "inertia": _set("inertias.2", BODY),
    "mass": _set("inertias.2.mass", 7.0),
    "placement": _set("jointPlacements.1", PLACE),
    "gravity": _set("gravity.linear", np.array([1.0, 2.0, 3.0])),
    "gravity in memory": _in_memory,
    "body": _load,
    "frame": lambda m: m.addFrame(pin.Frame("tool", 2, pin.SE3.Random(), pin.FrameType.OP_FRAME)),
    "name": _set("name", "renamed"),
    "joint": _joint,
}


def build(model):
    return ClosedChain(model, [Closure("A", "B", "6d")], MOTORS)


@pytest.fixture
def chain():
    """Three and three joints on a base that floats, whose model a test may change."""
    model = tree("free", ["RX", "revolute", "RZ"], ["RZ", "revolute", "ball"], seed=3)
    model.referenceConfigurations["home"] = model.referenceConfigurations["closed"]
    return build(model)


@pytest.fixture
def state(chain):
    q = chain.model.referenceConfigurations["closed"]
    return q, *np.random.default_rng(0).normal(size=(2, chain.mobility(q).degrees_of_freedom))


def numbers(chain, q, random):
    n = chain.mobility(q).degrees_of_freedom
    va, aa = random.normal(size=(2, n))
    return np.concatenate(
        [
            chain.generalized_forces(q, va, aa),
            chain.generalized_forces(np.stack([q, q]), va, aa).ravel(),
            chain.compute_accelerations(q, va, np.ones(2)),
            chain.noc(q, va).inertia.ravel(),
            np.atleast_1d(chain.potential_energy(q)),
        ]
    )


def everything(chain, q, random):
    """All results that depend on the numbers of a model, by single samples and by batches."""
    n, m = chain.degrees_of_freedom, len(chain.motor_names)
    va, aa = random.normal(size=(2, n))
    found = [numbers(chain, q, random), chain.friction.viscous, chain.friction.coulomb]
    for at in (q, np.stack([q, q])):
        found += chain.torque_derivatives(at, va, aa)
        found += chain.acceleration_derivatives(at, va, np.ones(m))
        found += [chain.compute_accelerations(at, va, np.ones(m)), chain.joint_rates(at, va)]
        found += [chain.kinetic_energy(at, va), chain.frame_jacobian(at, "A")]
    return np.concatenate([np.ravel(x) for x in found])


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
    one, other = (numbers(c, q, np.random.default_rng(0)) for c in (chain, build(pin.Model(model))))
    assert np.array_equal(one, other)


@pytest.mark.parametrize(
    "name", [n for n in CHANGES if n not in ("joint", "placement")]
)  # no star, open loops
def test_a_changed_sst_equals_a_new_one_on_kernels_and_the_reference_path(name):
    """A single call and a batch, before and after refresh()."""
    robot = sst_pin.SST()
    # No passive joint stands still: Coulomb friction would have any sign.
    q = robot.assemble(robot.home + 0.1 * np.random.default_rng(0).normal(size=9))
    va, aa = (1.0, 0.7, -0.6), (0.5, 0, 2)
    before = robot.compute_torques(q, va, aa)
    batch = (np.stack([q, q]), va, aa)
    many = robot.compute_torques(*batch)
    pin.seed(0)
    CHANGES[name](robot.model)
    assert np.array_equal(robot.compute_torques(q, va, aa), before)
    assert np.array_equal(robot.compute_torques(*batch), many)
    robot.refresh()
    single, several = robot.compute_torques(q, va, aa), robot.compute_torques(*batch)
    chain = ClosedChain(pin.Model(robot.model), robot.closures, robot.motor_names)
    expected = chain.compute_torques(q, va, aa)
    for tau in (single, *several):
        # Kernels and the reference path: two orders of the same sums.
        assert np.abs(tau - expected).max() < 1e-11 * max(1, np.abs(expected).max())


def test_a_frame_added_to_the_model_can_be_asked_for(chain, state):
    q, va, _ = state
    chain.joint_rates(q, va)
    chain.model.addFrame(pin.Frame("tool", 2, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    chain.refresh()
    assert chain.frame_jacobian(q, "tool").shape == (6, len(va))


@pytest.mark.parametrize(
    "change",
    [_set("inertias.2.mass", np.nan), _set("gravity.angular", np.array([0.0, 0.0, 1.0]))],
)
@pytest.mark.parametrize("kernels", [True, False])
def test_a_model_that_is_refused_leaves_the_robot_as_it_was(kernels, change):
    """refresh() raises at every call; the torques stay those of the model before."""
    robot = sst_pin.SST(kernels=kernels)
    motion = robot.home, np.ones(3), np.ones(3)
    before = robot.compute_torques(*motion)
    change(robot.model)
    for _ in range(3):
        with pytest.raises(sst_pin.DescriptionError, match=r"NaN|gravity\.angular"):
            robot.refresh()
        assert np.array_equal(robot.compute_torques(*motion), before)


@pytest.mark.parametrize("name", ["armature", "damping", "friction", "rotorInertia"])
@pytest.mark.parametrize("size", [0, 1, 40])
@pytest.mark.parametrize("locked", [(), ["b1_revolute"]])
def test_arrays_of_a_wrong_size_are_refused(name, size, locked):
    """Pinocchio would read memory beside them, or end the process."""
    model = tree("free", ["RX"], ["RZ", "revolute"], seed=3)
    setattr(model, name, np.ones(size))
    with pytest.raises(sst_pin.DescriptionError, match=f"{name}: {size} numbers, "):
        ClosedChain(model, [Closure("A", "B", "3d")], ["a0_RX"], locked=locked)


def test_a_model_with_a_nan_is_refused():
    model = tree("free", ["RX"], ["RZ"], seed=3)
    model.effortLimit = np.full(model.nv, np.nan)
    with pytest.raises(sst_pin.DescriptionError, match="NaN"):
        build(model)


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))]
)
def test_copies_compute_the_same(chain, copied):
    """Also in the coordinates that the original has settled on."""
    q = chain.model.referenceConfigurations["closed"]
    wanted = numbers(chain, q, np.random.default_rng(0))
    other = copied(chain)
    assert np.array_equal(numbers(other, q, np.random.default_rng(0)), wanted)
    assert other.coordinates == chain.coordinates


def test_threads_compute_the_same_from_the_first_call_on(chain, state):
    """Many threads ask a chain that nobody has asked before."""
    wanted = chain.generalized_forces(*state)
    with ThreadPoolExecutor(8) as pool:
        for _ in range(5):
            new = build(chain.model)
            calls = [pool.submit(new.generalized_forces, *state) for _ in range(32)]
            assert all(np.array_equal(call.result(), wanted) for call in calls)


def test_a_forked_process_computes_the_same(chain, state):
    wanted = chain.generalized_forces(*state)
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe()
    process = context.Process(target=lambda: there.send(chain.generalized_forces(*state)))
    process.start()
    assert here.poll(60)
    assert np.array_equal(here.recv(), wanted)
    process.join(60)
