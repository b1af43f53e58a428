# SPDX-License-Identifier: BSD-2-Clause
"""A tree without closures is a robot too: every call gives what Pinocchio gives of the tree."""

import warnings

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import ClosedChain
from tests.support.any_chain import GRAVITY, JOINTS, add_frame, add_joint
from tests.support.differences import random_q

#: Names of joints, each on the one before or on the one whose number stands behind it.
TREES = {
    "pendulum": ["RY"],  # one joint, which compiles quickly
    "arm": ["RY", "revolute", "RY", "RY", "revolute", "RY", "RY"],
    "free flyer": ["free-flyer", "RY", ("PX", 1)],
    # No universal joint: Pinocchio's derivatives are wrong for it.
    "planar": ["planar", "RUBX", ("PX", 1), "spherical"],
}


def model_of(name):
    random, model = np.random.default_rng(3), pin.Model()
    model.name, model.gravity.linear = name.replace(" ", "_"), GRAVITY
    for k, joint in enumerate(TREES[name]):
        kind, parent = joint if isinstance(joint, tuple) else (joint, k)
        index = add_joint(model, parent, f"joint_{k + 1}", JOINTS[kind](), random)
    add_frame(model, "tip", index, random)
    return model


def chain_of(name):
    model = model_of(name)
    return ClosedChain(model, [], list(model.names)[1:])


def states_of(chain):
    """q, va, aa of three random states."""
    random = np.random.default_rng(4)
    q = np.stack([random_q(chain.model, random) for _ in range(3)])
    return q, *random.normal(size=(2, 3, chain.model.nv))


def rnea(model, q, v, a):
    return np.stack([pin.rnea(model, model.createData(), *x) for x in zip(q, v, a, strict=True)])


@pytest.mark.parametrize(
    ("name", "compiled"),
    [
        *((name, False) for name in TREES if name != "pendulum"),
        ("pendulum", True),
        *(pytest.param(name, True, marks=pytest.mark.slow) for name in TREES if name != "pendulum"),
    ],
)
def test_dynamics_and_derivatives_are_pinocchios(name, compiled):
    chain = chain_of(name)
    model, (q, va, aa) = chain.model, states_of(chain)
    if compiled:
        chain.compile(derivatives=True)
    tau = rnea(model, q, va, aa)
    # Two recursions in another order: rounding.
    assert_allclose(chain.compute_torques(q, va, aa), tau, rtol=0, atol=1e-12)
    assert_allclose(chain.generalized_forces(q, va, aa), tau, rtol=0, atol=1e-12)
    assert_allclose(chain.compute_accelerations(q, va, tau), aa, rtol=0, atol=1e-11)
    data = model.createData()
    for x in zip(q, va, aa, tau, strict=True):
        d = chain.torque_derivatives(*x[:3])
        pin.computeRNEADerivatives(model, data, *x[:3])
        inertia = np.triu(data.M) + np.triu(data.M, 1).T
        for ours, theirs in zip(d, (data.dtau_dq, data.dtau_dv, inertia), strict=True):
            assert_allclose(ours, theirs, rtol=0, atol=1e-11)
        d = chain.acceleration_derivatives(*x[:2], x[3])
        pin.computeABADerivatives(model, data, *x[:2], x[3])
        inverse = np.triu(data.Minv) + np.triu(data.Minv, 1).T
        for ours, theirs in zip(d, (data.ddq_dq, data.ddq_dv, inverse), strict=True):
            # Times the condition number of the inertia matrix, below 1e3.
            assert_allclose(ours, theirs, rtol=0, atol=1e-9)
        J = pin.computeFrameJacobian(
            model, data, x[0], model.getFrameId("tip"), pin.LOCAL_WORLD_ALIGNED
        )
        assert_allclose(chain.frame_jacobian(x[0], "tip"), J.reshape(6, -1), rtol=0, atol=1e-13)
        A, B = chain.linearize(*x[:2], x[3])
        n = model.nv
        assert_allclose(B, np.vstack([np.zeros((n, n)), inverse]), rtol=0, atol=1e-9)
        assert_allclose(A[n:, :n], data.ddq_dq, rtol=0, atol=1e-9)


def test_casadi_gives_the_same():
    chain = chain_of("planar")
    q, va, aa = (x[0] for x in states_of(chain))
    tau, f = chain.compute_torques(q, va, aa), chain.casadi()
    assert_allclose(f.torques(q, va, aa).full().ravel(), tau, rtol=0, atol=1e-11)
    assert_allclose(f.accelerations(q, va, tau).full().ravel(), aa, rtol=0, atol=1e-10)


@pytest.mark.parametrize("method", ["simulate", "rollout"])
def test_a_free_motion_keeps_its_energy_and_obeys_pinocchio(method):
    """No motor; the accelerations along it are those of pin.aba."""
    chain = chain_of("planar")
    q0, va0, _ = (x[0] for x in states_of(chain))
    if method == "simulate":
        motion = chain.simulate(np.zeros(chain.model.nv), q0, va0, np.linspace(0, 0.5, 6))
        assert not motion.stopped
        data, none = chain.model.createData(), np.zeros(chain.model.nv)
        states = zip(motion.q, motion.va, strict=True)
        expected = np.array([pin.aba(chain.model, data, q, va, none) for q, va in states])
        assert_allclose(motion.aa, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        assert not chain.check_limits(motion)
    else:
        motion = chain.rollout(np.zeros((100, chain.model.nv)), q0, va0, 0.001)
    energy = chain.kinetic_energy(motion.q, motion.va) + chain.potential_energy(motion.q)
    # simulate: tolerance 1e-12 per step; rollout: the step to the fourth power, 1e-12, times
    # derivatives of fifth order, at rates up to 10 rad/s.
    assert np.ptp(energy) < {"simulate": 1e-9, "rollout": 1e-6}[method]


ARM = """<robot name="arm">
 <link name="base"/>
 <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
 <link name="lower"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
 <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
  <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="3"/></joint>
 <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
  <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="2" effort="50" velocity="3"/></joint>
</robot>"""


def test_a_urdf_without_yaml_is_an_open_tree_and_says_so(tmp_path):
    """It has a motor at each joint, and warns unless the caller names the motors."""
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    with pytest.warns(
        sst_pin.DescriptionWarning, match=r"no arm\.yaml .* each joint of one axis has a motor"
    ):
        arm = sst_pin.ClosedChain.from_urdf(path)
    q, rates = np.array([[0.3, -0.5]]), np.array([[1.0, 2.0]])
    expected = rnea(pin.buildModelFromUrdf(str(path)), q, rates, rates)
    assert_allclose(arm.compute_torques(q, rates, rates), expected, rtol=0, atol=1e-13)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chosen = sst_pin.ClosedChain.from_urdf(path, actuated=["elbow"])
        assert chosen.motor_names == ("elbow",)
        path.with_suffix(".yaml").write_text("name_mot: [shoulder, elbow]")
        assert sst_pin.ClosedChain.from_urdf(path).motor_names == ("shoulder", "elbow")
    assert sst_pin.validate(path) == []
    with pytest.raises(sst_pin.DescriptionError, match="YAML of the cuts cannot be read"):
        sst_pin.ClosedChain.from_urdf(path, tmp_path / "other.yaml")


def test_an_mjcf_without_equalities_is_an_open_tree(tmp_path):
    """It has the actuators of the file."""
    pytest.importorskip("mujoco")
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco model="arm"><worldbody><body><joint name="a" axis="0 1 0" damping="0.1"/>'
        '<geom type="capsule" fromto="0 0 0 .4 0 0" size=".03"/><body pos=".4 0 0">'
        '<joint name="b" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>'
        "</body></body></worldbody>"
        '<actuator><motor joint="a"/><motor joint="b"/></actuator></mujoco>'
    )
    arm = sst_pin.ClosedChain.from_mjcf(path)
    assert [p.text for p in sst_pin.validate(path)] == ["contacts are not computed"]
    assert arm.motor_names == arm.coordinates == ("a", "b")
