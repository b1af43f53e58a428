# SPDX-License-Identifier: BSD-2-Clause
"""Mimic joints of Pinocchio: the same robot as with ordinary joints and couplings."""

import copy
import pickle

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from any_chain import states
from by_hand import add, mark
from sst_pin import ClosedChain, Closure, Coupling
from sst_pin.errors import DescriptionError, InputError

FACTOR, OFFSET = -0.7, 0.3
KINDS = {
    "RZ": pin.JointModelRZ(),
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
#: The mimic joint carries the loop, or hangs behind a branch that is in no loop.
LOOPS = {"inside": ("f", "g"), "outside": ("c", "d")}


def ordinary(kind, seed=0):
    """The tree with ordinary joints."""
    pin.seed(seed)
    model, joints = pin.Model(), {n: j for n, _, j in JOINTS}
    joints["e"] = kind
    for name, parent, _ in JOINTS:
        index = add(model, parent, joints[name], name, pin.SE3.Random(), pin.Inertia.Random())
        mark(model, index, f"{name}_end", pin.SE3.Random())
    model.armature = np.abs(np.random.default_rng(seed).normal(size=model.nv))
    model.armature[model.joints[5].idx_v] = 0
    return model


@pytest.fixture(params=LOOPS)
def loop(request):
    return request.param


@pytest.fixture(params=["RZ", "PY", "unaligned"])
def pair(request, loop):
    """The chain with a mimic joint, with a coupling, and q and v of the second from the first."""
    model = ordinary(KINDS[request.param])
    mimicking = pin.transformJointIntoMimic(model, 2, 5, FACTOR, OFFSET)
    closures = [Closure(*(f"{name}_end" for name in LOOPS[loop]), "3d")]
    coupling = Coupling("e", {"b": (0.0, FACTOR)}, OFFSET)
    random = np.random.default_rng(1)
    viscous, coulomb, stiffness = np.abs(random.normal(size=(3, mimicking.nv)))
    stiffness[-3:] = 1.0  # a ball has one
    k = model.joints[5].idx_v
    D, F, S = (np.insert(x, k, 0.0) for x in (viscous, coulomb, stiffness))
    a = ClosedChain(
        mimicking,
        closures,
        ["a", "b"],
        viscous_friction=viscous,
        coulomb_friction=coulomb,
        stiffness=stiffness,
    )
    names = a.coordinates
    b = ClosedChain(
        model,
        [*closures, coupling],
        ["a", "b"],
        coordinates=names,
        viscous_friction=D,
        coulomb_friction=F,
        stiffness=S,
    )

    def to_b(q):
        return np.insert(q, model.joints[5].idx_q, FACTOR * q[model.joints[2].idx_q] + OFFSET)

    return a, b, to_b, k


def test_dynamics_are_those_of_the_coupled_robot(pair):
    """To 1e-10 of the largest, derivatives to 1e-9: that is rounding."""
    a, b, to_b, k = pair
    random = np.random.default_rng(3)
    for q, va, aa in zip(*states(a, 5, 2), strict=True):
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


URDF = """<robot name="gripper"><link name="base"/><link name="x"/><link name="y"/>
<joint name="one" type="revolute"><parent link="base"/><child link="x"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="two" type="revolute"><parent link="base"/><child link="y"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/>
<mimic joint="one" multiplier="-1.0" offset="0.2"/></joint></robot>"""


def test_a_urdf_read_with_its_mimic_joints_is_computed():
    """Two fingers that turn against each other: Phi of a coupling of their angle is that of q."""
    model = pin.buildModelFromXML(URDF, mimic=True)
    chain = ClosedChain(model, [Closure("x", "y", "orientation")], ["one"])
    q = chain.assemble([0.4], ())
    assert_allclose(q, [0.1], atol=1e-12)
    assert_allclose(chain.Phi(q), [[0.0], [0.0], [-2.0]], atol=1e-12)


def test_two_mimic_joints_follow_each_its_own():
    model = ordinary(pin.JointModelRZ())
    model.armature = np.zeros(model.nv)
    mimicking = pin.transformJointIntoMimic(model, 2, 5, FACTOR, OFFSET)
    mimicking = pin.transformJointIntoMimic(mimicking, 1, 6, 1.4, -0.2)
    loop = Closure("f_end", "g_end", "3d")
    gears = [Coupling("e", {"b": (0, FACTOR)}, OFFSET), Coupling("f", {"a": (0, 1.4)}, -0.2)]
    a = ClosedChain(mimicking, [loop], ["a", "b"])
    b = ClosedChain(model, [loop, *gears], ["a", "b"], coordinates=a.coordinates)
    for q, va, aa in zip(*states(a, 2, 2), strict=True):
        Q = np.array([*q[:5], FACTOR * q[1] + OFFSET, 1.4 * q[0] - 0.2, *q[5:]])
        assert_allclose(a.generalized_forces(q, va, aa), b.generalized_forces(Q, va, aa), atol=1e-9)
        pairs = zip(a.torque_derivatives(q, va, aa), b.torque_derivatives(Q, va, aa), strict=True)
        for x, y in pairs:
            assert_allclose(x, y, atol=1e-9 * max(1.0, np.abs(y).max()))


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
