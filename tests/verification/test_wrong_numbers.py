# SPDX-License-Identifier: BSD-2-Clause
"""Robots of the page "Published numbers that are wrong": the right numbers, by other ways."""

from functools import cache

import numpy as np
import pinocchio as pin
from numpy.testing import assert_allclose

import sst_pin
from tests.support.files import load

desk = load("examples/desk_head.py")
head = cache(desk.desk_head)


def height(chain, q):
    """Potential energy of the robot, [J]."""
    model = chain.model
    return pin.computePotentialEnergy(model, model.createData(), q)


def test_the_heads_torques_are_the_slope_of_its_weight():
    """Virtual work, by differences of the assembled robot's height; their error is 1e-9."""
    chain, zero = head(), np.zeros(6)
    torques = chain.compute_torques(chain.home, zero, zero)
    step = 1e-4
    for k, motor in enumerate(desk.MOTORS):
        others = dict.fromkeys(desk.MOTORS, 0.0)
        higher, lower = (chain.assemble(others | {motor: s * step}) for s in (1, -1))
        slope = (height(chain, higher) - height(chain, lower)) / (2 * step)
        assert_allclose(torques[k], slope, rtol=0, atol=1e-8)


def test_the_heads_torques_are_those_of_its_published_model():
    """From the published model, all of whose joints were read, in four digits."""
    expected = [0.02006, -0.02028, 0.02134, -0.02093, 0.02211, -0.02230]
    torques = head().compute_torques(head().home, np.zeros(6), np.zeros(6))
    assert_allclose(torques, expected, rtol=0, atol=6e-6)


def test_six_spins_of_the_rods_are_named_and_change_no_torque():
    """15 closure equations, 27 rates: six motors and six spins; rods that spin weigh the same."""
    free = desk.desk_head(locked=False)
    assert free.degrees_of_freedom == 12
    spins = [f"rod_{k}_wz" for k in range(1, 7)]
    assert set(free.coordinates) == {*desk.MOTORS, *spins}
    (idle,) = (line for line in str(free.mobility()).splitlines() if line.startswith("idle"))
    assert all(spin in idle for spin in spins[:5])
    forces = free.generalized_forces(free.home, np.zeros(12), np.zeros(12))
    by_name = dict(zip(free.coordinates, forces, strict=True))
    torques = head().compute_torques(head().home, np.zeros(6), np.zeros(6))
    assert_allclose([by_name[name] for name in desk.MOTORS], torques, rtol=0, atol=1e-12)
    assert_allclose([by_name[name] for name in spins], 0, atol=1e-12)


def two_cardan_shafts():
    """Two equal double-Cardan shafts between the same ends, whose axes are 0.1 m apart."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    apart = np.array([0.3, 0.1, 0])
    body = pin.Inertia(1.0, np.zeros(3), 0.01 * np.eye(3))
    at_end = pin.SE3(np.eye(3), apart)
    ends = {}
    for name, at in (("input", pin.SE3.Identity()), ("output", at_end)):
        ends[name] = model.addJoint(0, pin.JointModelRX(), at, name)
        model.appendBodyToJoint(ends[name], body, pin.SE3.Identity())
    closures = []
    # "universal": the output turns about x of A and y of B. Both yokes of a shaft are parallel.
    yokes = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    for k in (1, 2):
        cross = pin.JointModelUniversal(np.array([0, 1.0, 0]), np.array([0, 0, 1.0]))
        shaft = model.addJoint(ends["input"], cross, pin.SE3.Identity(), f"shaft_{k}")
        model.appendBodyToJoint(shaft, body, pin.SE3(np.eye(3), apart / 2))
        for side, joint, at in (("a", shaft, apart), ("b", ends["output"], np.zeros(3))):
            frame = pin.Frame(f"{side}_{k}", joint, pin.SE3(yokes, at), pin.FrameType.OP_FRAME)
            model.addFrame(frame)
        closures.append(sst_pin.Closure(f"a_{k}", f"b_{k}", "universal"))
    model.referenceConfigurations["home"] = np.zeros(model.nq)
    return sst_pin.ClosedChain(model, closures, ["input"])


def test_two_double_cardan_shafts_keep_the_speed_and_share_a_torque_in_no_unique_way():
    """OpenModelica's report 8365: a second, equal shaft, which its index reduction refuses."""
    chain = two_cardan_shafts()
    assert chain.degrees_of_freedom == 1
    for angle in np.linspace(0.1, 6, 7):
        q = chain.assemble({"input": angle})
        rates = chain.joint_rates(q, [1.0])
        assert_allclose(rates[:2], 1, rtol=0, atol=1e-12)
        wrenches = chain.reactions(q, [1.0], [2.0])
        unique = dict(zip(chain.joint_names, wrenches.determined.joints, strict=True))
        assert not unique["shaft_1"].all()
        assert not unique["shaft_2"].all()
        # What the motor gives is unique.
        assert_allclose(wrenches.motors, chain.compute_torques(q, [1.0], [2.0]), rtol=1e-12)
