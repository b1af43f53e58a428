# SPDX-License-Identifier: BSD-2-Clause
"""Mimic joints of Pinocchio: the same robot as with ordinary joints and couplings."""

import copy
import pickle

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from sst_pin import ClosedChain, Closure, Coupling
from sst_pin.errors import DescriptionError, InputError
from tests.support.any_chain import states
from tests.support.by_hand import add, mark

FACTOR, OFFSET = -0.7, 0.3
KINDS = {
    "PY": pin.JointModelPY(),
    "unaligned": pin.JointModelRevoluteUnaligned(np.array([0.0, 0.6, -0.8])),
}
#: Name, parent, type; the mimic joint e follows b. Added in an order that is not depth-first.
JOINTS = (
    ("a", 0, pin.JointModelRZ()),
    ("b", 1, pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8]))),
    ("c", 2, pin.JointModelUniversal(np.array([1.0, 0, 0]), np.array([0.0, 1, 0]))),
    ("d", 1, pin.JointModelPX()),
    ("e", 3, pin.JointModelRZ()),
    ("f", 5, pin.JointModelRY()),
    ("g", 4, pin.JointModelSpherical()),
)
#: Mimic joints, their leaders, factors and offsets.
FOLLOWERS = [("e", "b", FACTOR, OFFSET), ("f", "a", 1.4, -0.2)]
#: The mimic joint carries the loop, or hangs behind a branch that is in no loop.
LOOPS = {"inside": ("f", "g"), "outside": ("c", "d")}
TWO = ("two", "inside")


def ordinary(kind, seed=0):
    """The tree with ordinary joints."""
    pin.seed(seed)
    model, joints = pin.Model(), {n: j for n, _, j in JOINTS}
    joints["e"] = kind
    for name, parent, _ in JOINTS:
        index = add(model, parent, joints[name], name, pin.SE3.Random(), pin.Inertia.Random())
        mark(model, index, f"{name}_end", pin.SE3.Random())
    model.armature = np.abs(np.random.default_rng(seed).normal(size=model.nv))
    return model


@pytest.fixture(params=[("PY", "outside"), ("unaligned", "inside"), TWO], ids="-".join)
def pair(request):
    """The chain with mimic joints, with couplings, and q and the rates of these joints there."""
    kind, loop = request.param
    model = mimicking = ordinary(KINDS.get(kind, pin.JointModelRZ()))
    followers = FOLLOWERS if kind == "two" else FOLLOWERS[:1]
    joints = [model.joints[model.getJointId(name)] for name, *_ in followers]
    rows = [joint.idx_v for joint in joints]
    model.armature[rows] = 0
    for name, leader, *numbers in followers:
        ids = (mimicking.getJointId(x) for x in (leader, name))
        mimicking = pin.transformJointIntoMimic(mimicking, *ids, *numbers)
    closures = [Closure(*(f"{name}_end" for name in LOOPS[loop]), "3d")]
    gears = [Coupling(name, {leader: (0.0, x)}, offset) for name, leader, x, offset in followers]
    terms = np.abs(np.random.default_rng(1).normal(size=(3, mimicking.nv)))
    terms[2, -3:] = 1.0  # a ball has one stiffness
    names = "viscous_friction", "coulomb_friction", "stiffness"

    def among(numbers, at, followed):
        return np.insert(numbers, np.array(at) - np.arange(len(at)), followed)

    coefficients = dict(zip(names, terms, strict=True))
    a = ClosedChain(mimicking, closures, ["a", "b"], **coefficients)
    coefficients = {name: among(x, rows, 0.0) for name, x in coefficients.items()}
    b = ClosedChain(model, closures + gears, ["a", "b"], coordinates=a.coordinates, **coefficients)

    def to_b(q):
        leaders = (model.joints[model.getJointId(leader)].idx_q for _, leader, *_ in followers)
        values = [x * q[k] + y for k, (*_, x, y) in zip(leaders, followers, strict=True)]
        return among(q, [joint.idx_q for joint in joints], values)

    return a, b, to_b, rows


def test_dynamics_are_those_of_the_coupled_robot(pair):
    """To 1e-10 of the largest, derivatives to 1e-9: that is rounding."""
    a, b, to_b, k = pair
    random = np.random.default_rng(3)
    for q, va, aa in zip(*states(a, 3, 2), strict=True):
        Q = to_b(q)
        assert np.abs(b.residual(Q)).max() < 1e-10
        wrenches = random.normal(size=(a.model.njoints - 1, 6))
        tau = random.normal(size=2)

        def same(x, y):
            assert_allclose(x, y, atol=1e-10 * max(1.0, np.abs(y).max()), rtol=1e-10)

        for method, third in (("generalized_forces", aa), ("compute_accelerations", tau)):
            x = getattr(a, method)(q, va, third, external_wrenches=wrenches)
            same(x, getattr(b, method)(Q, va, third, external_wrenches=wrenches))
        same(a.joint_rates(q, va), np.delete(b.joint_rates(Q, va), k))
        same(a.joint_accelerations(q, va, aa), np.delete(b.joint_accelerations(Q, va, aa), k))
        for frame in ("e_end", "f_end", "d_end"):
            same(a.frame_jacobian(q, frame), b.frame_jacobian(Q, frame))
            same(a.frame_drift(q, va, frame), b.frame_drift(Q, va, frame))
            same(a.frame_jacobian_rate(q, va, frame), b.frame_jacobian_rate(Q, va, frame))
        x, y = a.noc(q, va), b.noc(Q, va)
        for name in ("T", "T_dot", "inertia", "coriolis", "gravity", "friction", "springs", "N_l"):
            same(getattr(x, name), getattr(y, name))
        same(x.N_l @ x.N_d, x.K)
        same(a.kinetic_energy(q, va), b.kinetic_energy(Q, va))
        same(a.potential_energy(q), b.potential_energy(Q))
        for method, third in (("torque_derivatives", aa), ("acceleration_derivatives", tau)):
            parts = (getattr(x, method) for x in (a, b))
            parts = (f(at, va, third, sign_width=0.1) for f, at in zip(parts, (q, Q), strict=True))
            for x, y in zip(*parts, strict=True):
                assert_allclose(x, y, atol=1e-9 * max(1.0, np.abs(y).max()))


def test_what_a_mimic_joint_cannot_be_is_refused():
    model = pin.transformJointIntoMimic(ordinary(pin.JointModelRZ()), 2, 5, FACTOR, OFFSET)
    loop = Closure("f_end", "g_end", "3d")
    with pytest.raises(InputError, match="mimic joint"):
        ClosedChain(model, [loop], ["e"])
    with pytest.raises(InputError, match="mimic joint"):
        ClosedChain(model, [loop], ["a"], coordinates=["e"])
    with pytest.raises(InputError, match="mimic joints"):
        ClosedChain(model, [loop], ["a"], locked=["d"])
    chain = ClosedChain(model, [loop], ["a"])
    with pytest.raises(InputError, match="mimic joint"):
        chain.assemble(chain.generic_configuration(), ["e"])
    with pytest.raises(DescriptionError, match="e has"):
        ClosedChain(model, [loop, Coupling("e", {"a": (0.0, 1.0)})], ["a"])


@pytest.mark.parametrize(
    ("kind", "factor"),
    [
        (pin.JointModelHX(0.3), FACTOR),  # Pinocchio leaves out the pitch
        (pin.JointModelHelicalUnaligned(np.array([0, 0, 1.0]), 0.3), FACTOR),  # crashes
        (pin.JointModelRX(), 0.0),
    ],
)
def test_mimic_joints_that_pinocchio_computes_wrongly_are_refused(kind, factor):
    model = pin.transformJointIntoMimic(ordinary(kind), 2, 5, factor, OFFSET)
    with pytest.raises(DescriptionError, match=r"mimic joint e: .* Coupling"):
        ClosedChain(model, [Closure("f_end", "g_end", "3d")], ["a"])


@pytest.mark.parametrize("pair", [TWO], indirect=True)
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))])
def test_the_model_of_a_copied_robot_computes(pair, copied):
    """Mimic joints of an unpickled model end the process; a robot has a copy of it."""
    a, q = pair[0], pair[0].generic_configuration()
    other = copied(a)
    for model in (other.model, other.mechanism.model):
        data, wanted = model.createData(), a.model.createData()
        pin.forwardKinematics(model, data, q)
        pin.forwardKinematics(a.model, wanted, q)
        assert all(x == y for x, y in zip(data.oMi, wanted.oMi, strict=True))
    other.refresh()
    assert other.coordinates == a.coordinates
