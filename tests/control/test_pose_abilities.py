# SPDX-License-Identifier: BSD-2-Clause
"""What a pose can do, against the dynamics with forces and torques applied."""

from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

import sst_pin
from tests.support.by_hand import wrenches_of

LIMIT = 2.0
FRAME = "platform"
#: A planar robot, one with a surplus motor, and one that also turns.
ROBOTS = ("five_bar", "planar_4rrr", "stewart")


def made(name):
    chain = getattr(sst_pin.robots, name)()
    rest = np.zeros(chain.degrees_of_freedom)
    hold = np.abs(chain.compute_torques(chain.home, rest, rest)).max()
    return chain, chain.home, 2 * hold + LIMIT


def inside(points, corners, slack=1e-9):
    """Whether points lie in the convex hull, in the directions that it has."""
    middle = corners.mean(axis=0)
    _, s, axes = np.linalg.svd(corners - middle)
    flat = axes[: (s > 1e-9 * s[0]).sum()]
    hull = ConvexHull((corners - middle) @ flat.T)
    local = (points - middle) @ flat.T
    gaps = local @ hull.equations[:, :-1].T + hull.equations[:, -1]
    return (gaps.max(axis=1) <= slack * np.abs(corners).max()).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_forces_at_the_corners_take_a_motor_to_its_limit(name):
    """Inverse dynamics with the reaction applied: none beyond, two or more at their limits."""
    chain, q, limit = made(name)
    rest = np.zeros(chain.degrees_of_freedom)
    for force in sst_pin.force_polytope(chain, q, FRAME, limit):
        tau = chain.compute_torques(q, rest, rest, external_wrenches=wrenches_of(chain, q, -force))
        assert np.abs(tau).max() == pytest.approx(limit, rel=1e-9)
        assert (np.abs(tau) > limit * (1 - 1e-9)).sum() >= 2


@pytest.mark.parametrize("name", ROBOTS)
def test_squares_of_torques_sum_up_to_one_on_the_ellipsoid_of_forces(name):
    chain, q, limit = made(name)
    rest = np.zeros(chain.degrees_of_freedom)
    hold = chain.compute_torques(q, rest, rest)
    _, sizes, axes = sst_pin.force_ellipsoid(chain, q, FRAME, limit)
    for size, axis in zip(sizes, axes, strict=True):
        load = wrenches_of(chain, q, -axis * (size if np.isfinite(size) else 1.0))
        tau = chain.compute_torques(q, rest, rest, external_wrenches=load) - hold
        wanted = 1.0 if np.isfinite(size) else 0.0
        assert np.sum((tau / limit) ** 2) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_accelerations_of_all_torques_lie_in_the_polytope(name):
    """Direct dynamics and Pinocchio's frame accelerations are the referee; corners are reached."""
    chain, q, limit = made(name)
    rng = np.random.default_rng(5)
    va = rng.uniform(-1, 1, chain.degrees_of_freedom) * 0.3
    corners = sst_pin.acceleration_polytope(chain, q, FRAME, limit, va=va)
    shape = 60, len(chain.motor_names)
    tau = limit * np.vstack([rng.uniform(-1, 1, shape), rng.choice([-1, 1], shape)])
    model, data = chain.model, chain.model.createData()
    result = []
    for aa in chain.compute_accelerations(q, va, tau):
        v, dv = chain.joint_rates(q, va), chain.joint_accelerations(q, va, aa)
        pin.forwardKinematics(model, data, q, v, dv)
        frame = model.getFrameId(FRAME), pin.LOCAL_WORLD_ALIGNED
        result.append(pin.getFrameClassicalAcceleration(model, data, *frame).linear.copy())
    assert inside(np.array(result), corners, 1e-7)
    gaps = np.linalg.norm(np.array(result)[:, None] - corners, axis=2).min(axis=0)
    assert gaps.min() < 1e-7 * np.abs(corners).max()


@pytest.mark.parametrize("name", ROBOTS)
def test_the_ellipsoid_of_accelerations_lies_in_the_polytope(name):
    chain, q, limit = made(name)
    center, sizes, axes = sst_pin.acceleration_ellipsoid(chain, q, FRAME, limit)
    corners = sst_pin.acceleration_polytope(chain, q, FRAME, limit)
    ends = center + np.vstack([sizes[:, None] * axes, -sizes[:, None] * axes])
    assert inside(ends, corners)
    assert np.linalg.norm(corners - center, axis=1).max() >= sizes[0] * (1 - 1e-9)


def test_the_star_at_home_turns_alike_about_all_axes(robot):
    """Isotropic: the moments of unit torques are a unit ball, its corners those of a cube."""
    sizes = sst_pin.force_ellipsoid(robot, robot.home, "star_1", 1.0, turning=True).sizes
    assert np.abs(sizes - 1).max() < 1e-12
    free = sst_pin.SST(sst_pin.Parameters(gravity=(0.0, 0.0, 0.0)))
    corners = sst_pin.force_polytope(free, free.home, "star_1", 1.0, turning=True)
    assert corners.shape == (8, 3)
    assert np.abs(np.linalg.norm(corners, axis=1) - np.sqrt(3)).max() < 1e-9


def test_a_five_bar_bears_what_leaves_its_plane():
    lift, q, limit = made("five_bar")
    result = sst_pin.force_ellipsoid(lift, q, FRAME, limit)
    assert np.isinf(result.sizes[0])
    assert np.abs(result.axes[0]) == pytest.approx([0, 0, 1])
    assert sst_pin.acceleration_ellipsoid(lift, q, FRAME, limit).sizes[2] < 1e-9
    assert np.abs(sst_pin.force_polytope(lift, q, FRAME, limit)[:, 2]).max() < 1e-9


def test_a_batch_is_its_samples():
    chain = sst_pin.robots.delta()
    q = np.array([chain.assemble(chain.home + 0.05 * k) for k in range(4)]).reshape(2, 2, -1)
    accelerations = partial(sst_pin.acceleration_ellipsoid, va=np.ones(3))
    for ellipsoid in (sst_pin.force_ellipsoid, accelerations):
        result, one = (ellipsoid(chain, x, FRAME, LIMIT) for x in (q, q[1, 0]))
        assert result.axes.shape == (2, 2, 3, 3)
        assert np.abs(result.sizes[1, 0] - one.sizes).max() < 1e-9 * one.sizes.max()
        assert np.abs(result.center[1, 0] - one.center).max() < 1e-9


@pytest.mark.parametrize("turning", [False, True])
def test_forces_that_move_what_no_motor_holds_are_refused(turning):
    lift = sst_pin.robots.five_bar()
    poor = sst_pin.ClosedChain(lift.model, lift.closures, lift.motor_names[:1])
    q = np.array([[lift.home] * 2] * 3)
    with pytest.raises(sst_pin.ActuationError, match=r"6 of 6 samples.*no motor holds") as caught:
        sst_pin.force_ellipsoid(poor, q, FRAME, 1.0, turning=turning)
    assert poor.coordinates[1] in str(caught.value)
    poor.model.gravity.linear = np.zeros(3)
    poor.refresh()
    with pytest.raises(sst_pin.ActuationError, match="no motor holds"):
        sst_pin.force_polytope(poor, poor.home, FRAME, 1.0, turning=turning)
