# SPDX-License-Identifier: BSD-2-Clause
"""`robot.check`: what the equations allow and the machine cannot take."""

import numpy as np
import pytest

import sst_pin
from sst_pin.sst import arc_limits
from sst_pin.sst.kinematics import legs_of_joints
from tests.support.sampling import random_parameters

T = np.linspace(0, 1, 41)


def motion_of(robot, q, t=T):
    """Only the angles count."""
    zero, names = np.zeros((len(q), 3)), (robot.joint_names, robot.motor_names)
    return sst_pin.Trajectory(t[: len(q)], q, zero, zero, zero, *names)


def tilted(robot, phi):
    """The star at theta = 20 deg and some colatitudes."""
    return robot.inverse_kinematics(sst_pin.sst.orientation(np.radians(20), phi))


def test_the_papers_circle_is_within_arcs_and_limits_and_away_from_singularities(robot):
    """Sect. 7.2, to which the machine was designed."""
    q = robot.inverse_kinematics(sst_pin.paper_circle(T).R)
    assert robot.check_limits(motion_of(robot, q)) == ()


@pytest.mark.parametrize("seed", range(4))
def test_a_joint_is_found_off_its_arc_where_its_slider_is(seed):
    """R_k between P_k and P_k+1, and between the ends of arc k, by vectors and not by angles."""
    rng = np.random.default_rng(seed)
    robot = sst_pin.SST(random_parameters(rng))
    R = sst_pin.sst.orientation(*rng.uniform(-np.pi, np.pi, (3, len(T))))
    q = robot.inverse_kinematics(R)
    result = {
        f.joints[0]: f for f in robot.check_limits(motion_of(robot, q)) if " arc of " in f.problem
    }
    legs, v = legs_of_joints(robot.geometry, q), robot.geometry.R_0[:, :, 0]
    for k in range(3):
        u, s, n = legs.u[:, k], legs.s[:, k], legs.n[:, k]
        side = np.linalg.lstsq(np.stack([v[k], v[(k + 1) % 3]], axis=1), u.T, rcond=None)[0]
        end = -np.cross(n, s)
        for name, out in (
            (f"gamma_{k + 1}", (side < 0).any(axis=0)),
            (f"beta_{k + 1}", ((u * s).sum(axis=1) < 0) | ((u * end).sum(axis=1) < 0)),
        ):
            times = result[name].times if name in result else []
            assert np.array_equal(times, T[out])


def test_a_finding_carries_times_values_and_limits_and_says_the_worst(robot):
    """beta_1 is 90 deg - phi at theta = 20 deg; its arc begins at 0."""
    phi = np.radians(np.linspace(60, 155, len(T)))
    result = robot.check_limits(motion_of(robot, tilted(robot, phi)))
    beta = next(f for f in result if f.joints == ("beta_1",))
    assert beta.limits == (0, np.pi / 2)
    assert np.array_equal(beta.times, T[phi > np.pi / 2])
    assert beta.values == pytest.approx((np.pi / 2 - phi)[phi > np.pi / 2], abs=1e-12)
    assert str(beta) == (
        "beta_1 leaves its arc of 0 to 90 deg: -65 deg at t = 1 s (28 samples from 0.325 to 1 s)"
    )


def test_the_ends_of_an_arc_belong_to_it(robot):
    q = tilted(robot, np.array([np.pi / 2]))
    assert abs(q[0, 2]) < 1e-15
    assert robot.check_limits(motion_of(robot, q)) == ()


def test_whole_turns_leave_no_arc_but_joint_limits(robot):
    """The slider is where it was; the joint's stops are not."""
    once, twice = (robot.home + 2 * np.pi * turns * np.eye(9)[0] for turns in (1, -2))
    result = robot.check_limits(motion_of(robot, np.array([robot.home, once, twice])))
    assert [f.joints for f in result] == [("gamma_1",)]
    assert "leaves its limits of -360 to 360 deg" in result[0].problem
    assert list(result[0].times) == [T[1], T[2]]


@pytest.mark.slow
def test_both_kinds_of_singularity_are_found_where_they_are_near(robot):
    """|sin mu_k| and the condition number are those of `singularities`."""
    angles = np.random.default_rng(5).uniform(-np.pi, np.pi, (3, 4000))
    q = robot.inverse_kinematics(sst_pin.sst.orientation(*angles))
    t, near = np.arange(len(q)) / 100, robot.singularities(q)
    result = robot.check_limits(motion_of(robot, q, t))
    first = [f for f in result if f.joints[0].startswith("mu")]
    second = [f for f in result if f.joints == robot.motor_names]
    flat = near.first_kind < arc_limits.SMALLEST_SINE
    assert flat.any()
    assert np.array_equal(np.unique(np.concatenate([f.times for f in first])), t[flat])
    assert min(f.values.min() for f in first) == pytest.approx(near.first_kind.min(), rel=1e-12)
    ill = near.condition_number > arc_limits.LARGEST_CONDITION
    assert ill.any()
    (result,) = second
    assert np.array_equal(result.times, t[ill])
    # Rounding of the singular values grows with the condition number.
    assert result.values == pytest.approx(near.condition_number[ill], rel=1e-9)
