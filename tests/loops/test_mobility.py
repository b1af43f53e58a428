# SPDX-License-Identifier: BSD-2-Clause
"""Degrees of freedom: closures that hold nothing, and motions that are infinitesimal."""

import warnings

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from sst_pin import (
    ClosedChain,
    Closure,
    DescriptionError,
    DescriptionWarning,
    Distance,
    SingularConfigurationError,
    SSTError,
)
from sst_pin.compiled import compiled_backend
from tests.support.by_hand import add, at, mark
from tests.support.planar_bars import planar, rhombus


def plane_arm(seed, size, joints):
    """An arm in a plane of its own, whose hand is marked, and a mark on the world in this plane."""
    random, model = np.random.default_rng(seed), pin.Model()
    base = pin.SE3(pin.exp3(random.normal(size=3)), size * random.normal(size=3))
    j, link = 0, base
    for k, kind in enumerate(joints):
        body = pin.Inertia(1.0, np.array([0.1 * size, 0, 0]), 0.01 * size**2 * np.eye(3))
        j = add(model, j, kind(), f"joint_{k}", link, body)
        turn = pin.exp3(np.array([0, 0, random.uniform(-2, 2)]))
        link = pin.SE3(turn, size * np.array([0.3, 0.1, 0]))
    mark(model, 0, "ground", base)
    mark(model, j, "hand", link)
    model.referenceConfigurations["home"] = np.zeros(model.nq)
    return model


PLANE = pin.JointModelRZ, pin.JointModelPX, pin.JointModelRZ, pin.JointModelRZ
GANTRY = pin.JointModelPX, pin.JointModelPY, pin.JointModelPX


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(
    ("joints", "held"),
    [
        (PLANE, "planar"),
        (PLANE, (False, False, False, True, True, False)),
        (GANTRY, (False, False, True, True, True, False)),
    ],
)
def test_a_closure_that_holds_nothing_leaves_the_torques_of_the_open_arm(joints, held, seed, size):
    """Its rows are rounding. They are compared with the natural size of a row, not with another.

    The referee is Pinocchio's inverse dynamics of the arm without the closure.
    """
    model = plane_arm(seed, size, joints)
    chain = ClosedChain(model, [Closure("ground", "hand", held)], list(model.names)[1:])
    n = len(joints)
    assert chain.coordinates == tuple(model.names)[1:]
    assert chain.mobility().rank == 0
    random = np.random.default_rng(seed)
    q = size * random.uniform(-1, 1, n)
    va, aa = random.normal(size=(2, n))
    tau = pin.rnea(model, model.createData(), q, va, aa)
    assert_allclose(
        chain.compute_torques(q, va, aa), tau, rtol=1e-9, atol=1e-12 * np.abs(tau).max()
    )


def parallel_rods(lengths, stations=(0.0, 0.3, 0.7), angle=np.pi / 2):
    """Parallel rods at home between the ground and a plate."""
    model, direction = pin.Model(), np.array([np.cos(angle), np.sin(angle)])
    bars = [
        (f"rod_{k}", "universe", x, length)
        for k, (x, length) in enumerate(zip(stations, lengths, strict=True))
    ]
    planar([*bars, ("plate", "rod_0", lengths[0], 0.1)], model=model)
    closures = []
    for k in (1, 2):
        x, y = (lengths[k] - lengths[0]) * direction
        mark(model, model.getJointId("plate"), f"plate_{k}", at(stations[k] + x, y))
        closures.append(Closure(f"plate_{k}", f"rod_{k}_end", "3d"))
    model.referenceConfigurations["home"] = np.array([angle] * 3 + [-angle])
    return model, closures, ["rod_0"]


#: A parallelogram at home.
BARS = [
    ("crank", "universe", 0.0, 0.3),
    ("rocker", "universe", 0.5, 0.3),
    ("coupler", "crank", 0.3, 0.5),
]
PARALLEL = [1.2, 1.2, -1.2]


def braced_four_bar(first=0.15, second=0.25):
    """A parallelogram whose coupler carries two bars in one line, fixed at both ends."""
    braces = [("brace_1", "coupler", 0.1, first), ("brace_2", "brace_1", first, second)]
    model = planar([*BARS, *braces])
    mark(model, model.getJointId("coupler"), "brace_end", at(0.1 + first + second))
    ends = ("coupler_end", "rocker_end"), ("brace_2_end", "brace_end")
    model.referenceConfigurations["home"] = np.array([*PARALLEL, 0.0, 0.0])
    return model, [Closure(*pair, "3d") for pair in ends], ["crank"]


def leg_lines(turn, feet, heads):
    """Plücker coordinates of six legs, and their lengths, with the platform turned about z."""
    at_heads = heads @ pin.exp3(np.array([0.2, -0.1, turn])).T + np.array([0.1, 0.05, 0.8])
    lines, lengths = at_heads - feet, np.linalg.norm(at_heads - feet, axis=1)
    return np.hstack([lines, np.cross(feet, lines)]) / lengths[:, None], lengths


def hexapod_at_a_singular_pose():
    """A platform on six rods of fixed lengths, turned until the lines of the rods are dependent."""
    random = np.random.default_rng(3)
    feet, heads = (
        radius * np.column_stack([np.cos(a), np.sin(a), np.zeros(6)])
        for radius, a in zip((1.0, 0.5), np.sort(random.uniform(0, 2 * np.pi, (2, 6))), strict=True)
    )
    turn = brentq(lambda x: np.linalg.det(leg_lines(x, feet, heads)[0]), 0.3, 2.5, xtol=1e-15)
    model, closures = pin.Model(), []
    add(model, 0, pin.JointModelFreeFlyer(), "platform", at(0), pin.Inertia.Random())
    for k, length in enumerate(leg_lines(turn, feet, heads)[1]):
        mark(model, 0, f"foot_{k}", at(*feet[k]))
        mark(model, 1, f"head_{k}", at(*heads[k]))
        closures.append(Distance(f"foot_{k}", f"head_{k}", float(length)))
    pose = pin.SE3(pin.exp3(np.array([0.2, -0.1, turn])), np.array([0.1, 0.05, 0.8]))
    model.referenceConfigurations["home"] = pin.SE3ToXYZQUAT(pose)
    return model, closures, []


@pytest.mark.parametrize(
    ("robot", "coordinates"),
    [
        (parallel_rods((0.4, 0.4, 0.5)), ()),
        (parallel_rods((0.4, 0.5, 0.4), (0.0, 0.5, 0.6), 1.1), ()),
        (braced_four_bar(), ("crank",)),
        (hexapod_at_a_singular_pose(), ()),
    ],
)
def test_rates_that_lead_to_no_other_pose_are_no_freedoms(robot, coordinates):
    """Phi allows one rate more than there are motions; it is named, and nothing is computed of it.

    Two bars in one line between fixed points are rigid. Parallel rods of different lengths cannot
    turn together, nor can rods of a platform in general beside the pose where they are dependent.
    """
    with pytest.warns(DescriptionWarning, match="lead to no other pose"):
        chain = ClosedChain(*robot)
    assert chain.coordinates == coordinates
    mobility, n = chain.mobility(chain.home), np.zeros(len(coordinates))
    assert mobility.degrees_of_freedom == len(coordinates)
    assert mobility.degrees_of_freedom + mobility.rank == chain.model.nv - 1
    assert mobility.shaking_joints
    torques = np.zeros(len(chain.motor_names))
    for ask in (
        lambda: chain.generalized_forces(chain.home, n, n),
        lambda: chain.compute_accelerations(chain.home, n, torques),
        lambda: chain.simulate(torques, chain.home, n, [0, 1]),
    ):
        with pytest.raises(SSTError, match=r"nothing can move|singular"):
            ask()


def test_locked_joints_cure_a_brace():
    """The torques are those of a coupler with the masses of the brace."""
    model, closures, motors = braced_four_bar(0.15, 0.25)
    cured = ClosedChain(model, closures, motors, locked=["brace_1", "brace_2"])
    rigid = planar(BARS)
    for k, x in ((4, 0.1), (5, 0.25)):
        rigid.appendBodyToJoint(rigid.getJointId("coupler"), model.inertias[k], at(x))
    exact = ClosedChain(rigid, closures[:1], motors)
    assert cured.coordinates == ("crank",)
    torques = [chain.compute_torques(PARALLEL, [1.0], [2.0]) for chain in (cured, exact)]
    assert_allclose(*torques, rtol=1e-12)


def test_equal_rods_move():
    """The third rod is redundant at all poses; freedoms and torques are those of two rods."""
    model, closures, motors = parallel_rods((0.4, 0.4, 0.4))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chain = ClosedChain(model, closures, motors)
    assert chain.coordinates == ("rod_0",)
    assert chain.mobility().shaking_joints == ()


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "kernels",
    ["none", pytest.param("whole", marks=SLOW), pytest.param("by directions", marks=SLOW)],
)
def test_calls_refuse_rates_to_which_no_accelerations_exist(kernels, monkeypatch):
    """Phi a + Phi_dot v is not zero for any a; at rest, and along motions, it is."""
    with pytest.warns(DescriptionWarning):
        chain = ClosedChain(*parallel_rods((0.4, 0.4, 0.5)), coordinates=["rod_0"])
    q, one = chain.home, np.ones(1)
    v = chain.joint_rates(q, one)
    Phi, drift = chain.Phi(q), chain.Phi_dot(q, v) @ v
    assert np.abs(Phi @ v).max() < 1e-15
    assert np.abs(drift + Phi @ np.linalg.lstsq(Phi, -drift)[0]).max() > 1e-3
    if kernels != "none":
        monkeypatch.setattr(compiled_backend, "_LARGEST", 10_000 if kernels == "whole" else 0)
        chain.compile(q)
    for ask in (
        lambda: chain.compute_torques(q, one, one),
        lambda: chain.joint_accelerations(q, one, one),
        lambda: chain.compute_accelerations(q, one, one),
        lambda: chain.reduced_terms(q, one),
        lambda: chain.noc(q, one),
        lambda: chain.torque_regressor(q, one, one),
        lambda: chain.frame_drift(q, one, "plate_end"),
        lambda: chain.frame_jacobian_rate(q, one, "plate_end"),
        lambda: chain.frame_velocity_derivatives(q, one, "plate_end"),
        lambda: chain.torque_derivatives(q, one, one),
        lambda: chain.acceleration_derivatives(q, one, one),
    ):
        with pytest.raises(SingularConfigurationError, match="rod_0, rod_1, rod_2, plate"):
            ask()
    assert np.isfinite(chain.compute_torques(q, [0.0], [1.0])).all()
    # It must not crawl from rest with ever shorter steps.
    with pytest.raises(SSTError, match="no motion with them"):
        chain.simulate([1.0], q, [0.0], [0.0, 1.0])


@pytest.mark.parametrize("angle", [1e-3, 1e-6])
def test_a_parallelogram_beside_its_flat_pose_is_regular(angle):
    """Its inertia is that of two bars that turn and of one that is carried along a circle."""
    model, closures, _ = rhombus()
    model.referenceConfigurations["home"] = np.array([angle, -angle, angle])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chain = ClosedChain(model, closures, ["crank"])
    tau = [chain.compute_torques(chain.home, [1.0], [aa]) for aa in (0.0, 1.0)]
    about_joint, carried = 0.004 + 0.15**2, 0.3**2
    assert_allclose(tau[1] - tau[0], 2 * about_joint + carried, rtol=1e-8)


def test_freedoms_of_a_robot_that_cannot_be_assembled_are_not_known():
    """Two bars do not reach each other; the number of motors is no answer."""
    model = planar([("crank", "universe", 0.0, 0.1), ("rocker", "universe", 1.0, 0.1)])
    chain = ClosedChain(model, [Closure("crank_end", "rocker_end", "3d")], ["crank", "rocker"])
    with pytest.raises(DescriptionError, match="no configuration was assembled"):
        _ = chain.degrees_of_freedom
