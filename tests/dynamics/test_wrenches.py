# SPDX-License-Identifier: BSD-2-Clause
"""An external wrench w = [force; moment] does the work of J^T w along the coordinates.

J is the Jacobian [linear; angular] of a frame at the mass centre of the body.
"""

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import robots
from tests.support import any_chain

#: Both sides are the same sums in another order.
ROUNDING = 1e-11


def with_frames_at_mass_centres(chain):
    model = pin.Model(chain.model)
    for i, name in enumerate(list(model.names)[1:], 1):
        place = pin.SE3(np.eye(3), model.inertias[i].lever)
        model.addFrame(pin.Frame(f"centre of {name}", i, place, pin.FrameType.OP_FRAME))
    return chain.with_model(model)


@pytest.fixture(scope="module")
def robot():
    return with_frames_at_mass_centres(robots.ankle())


@pytest.fixture(scope="module")
def compiled():
    chain = with_frames_at_mass_centres(robots.ankle())
    chain.compile()
    return chain


@pytest.fixture(scope="module")
def case(robot):
    """A state, wrenches on all bodies, and their forces along the coordinates."""
    q, va, aa = (x[0] for x in any_chain.states(robot, 1, 0))
    wrenches = np.random.default_rng(2).normal(size=(len(robot.joint_names), 6))
    jacobians = [robot.frame_jacobian(q, f"centre of {name}") for name in robot.joint_names]
    work = sum(J.T @ wrench for J, wrench in zip(jacobians, wrenches, strict=True))
    return q, va, aa, wrenches, work


def close(actual, expected):
    assert np.abs(actual - expected).max() < ROUNDING * (1 + np.abs(expected).max())


@pytest.mark.parametrize("path", ["robot", pytest.param("compiled", marks=pytest.mark.slow)])
def test_both_paths_add_the_work_of_a_wrench(path, request, case):
    chain, (q, va, aa, wrenches, work) = request.getfixturevalue(path), case
    load = {"external_wrenches": wrenches}
    f, tau = chain.generalized_forces(q, va, aa), chain.compute_torques(q, va, aa)
    of_motors = np.linalg.solve(chain.actuator_jacobian(q).T, work)
    close(chain.generalized_forces(q, va, aa, **load), f - work)
    close(chain.compute_torques(q, va, aa, **load), tau - of_motors)
    driven = chain.compute_accelerations(q, va, tau + of_motors)
    close(chain.compute_accelerations(q, va, tau, **load), driven)
    motors = chain.reactions(q, va, aa, **load).motors
    close(motors, tau - of_motors)


def test_casadi_functions_add_the_work_of_a_wrench(robot, case):
    q, va, aa, wrenches, work = case
    functions = robot.casadi(external_wrenches=True)
    f = functions.generalized_forces(q, va, aa, 0 * wrenches).full()[:, 0]
    close(functions.generalized_forces(q, va, aa, wrenches).full()[:, 0], f - work)


@pytest.mark.slow
def test_warp_kernels_add_the_work_of_a_wrench(robot, case):
    wp = pytest.importorskip("warp", reason="needs the extra 'gpu'")
    batch, (q, va, aa, wrenches, work) = robot.warp(device="cpu"), case
    arrays = [wp.array(x[None], dtype=wp.float64, device="cpu") for x in (q, va, aa, wrenches)]
    f = batch.generalized_forces(*arrays[:3]).numpy()
    loaded = batch.generalized_forces(*arrays[:3], external_wrenches=arrays[3]).numpy()
    close(loaded, f - work)


def test_the_ground_carries_a_wrench(robot, case):
    """Its force as it is, its moment about the origin."""
    q, va, aa, wrenches, _ = case
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    ground = robot.reactions(q, va, aa).ground
    bodies = list(robot.model.inertias)[1:]
    for place, body, wrench in zip(list(data.oMi)[1:], bodies, wrenches, strict=True):
        centre = pin.SE3(np.eye(3), place.act(body.lever))
        ground = ground - centre.act(pin.Force(wrench)).vector
    close(robot.reactions(q, va, aa, external_wrenches=wrenches).ground, ground)
