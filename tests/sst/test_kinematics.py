# SPDX-License-Identifier: BSD-2-Clause
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sst_pin
from sst_pin.arrays import in_one_turn
from sst_pin.errors import SingularConfigurationError
from tests.support.sampling import random_parameters, random_state, random_states

#: Between samples, and first derivatives by seven: error H^6 f^(7) / 140, and rounding eps / H.
H = 1e-3
AROUND = H * np.arange(-3, 4)
DIFFERENCES = np.array((-1, 9, -45, 0, 45, -9, 1)) / 60 / H


def off_rates(motion):
    """Errors of omega and alpha in the middle of seven samples, by differences of R and omega."""
    W = np.einsum("t,tij->ij", DIFFERENCES, motion.R) @ motion.R[3].T
    omega = np.array((W[2, 1], W[0, 2], W[1, 0]))
    pairs = (omega, motion.omega[3]), (DIFFERENCES @ motion.omega, motion.alpha[3])
    return [np.abs(result - given).max() for result, given in pairs]


def test_initial_conditions_of_the_paper_come_out_to_every_printed_digit(robot):
    """Sect. 7.3 from Sect. 7.2 at t = 0: which reading of psi the paper has."""
    q, va, _ = robot.joint_motion(*sst_pin.paper_circle(0.0))
    assert np.round(q[::3], 4).tolist() == [0.7854, 0.5549, 1.0159]
    assert np.round(va, 4).tolist() == [4.2096, -0.6918, -0.6918]
    assert q[0] == pytest.approx(np.pi / 4, abs=1e-15)


def test_path_of_the_paper_lies_on_the_unit_sphere_and_is_a_circle(robot):
    """s of length one at a constant angle to (1, 1, 1); theta and psi are those of Fig. 4."""
    t = np.linspace(0, np.pi / 6, 50)
    R = sst_pin.paper_circle(t).R
    s = R[:, :, 0]
    assert np.abs(np.linalg.norm(s, axis=1) - 1).max() < 1e-15
    assert np.ptp(s.sum(axis=1)) < 1e-14
    q = robot.inverse_kinematics(R)
    assert np.abs(q[:, 1] - np.pi / 2).max() < 1e-14  # psi = 0: mu_1 = 90 degrees
    assert np.abs(q[:, 0] - np.arctan2(s[:, 1], s[:, 0])).max() < 1e-14  # gamma_1 = theta


@pytest.mark.parametrize("seed", range(3))
def test_inverse_kinematics_closes_the_loops_on_all_branches(seed):
    """Each of the eight assemblies of legs holds the star at R, on the branch asked for."""
    rng = np.random.default_rng(seed)
    robot = sst_pin.SST(random_parameters(rng))
    R, _, _ = random_states(robot, rng, 5)
    q = robot.inverse_kinematics(R[:, None], sst_pin.sst.BRANCHES)
    assert q.shape == (5, 8, 9)
    assert np.abs(robot.platform_orientation(q) - R[:, None]).max() < 1e-13
    assert max(np.abs(robot.residual(x)).max() for x in q.reshape(-1, 9)) < 1e-13
    assert np.array_equal(robot.branch(q), np.broadcast_to(sst_pin.sst.BRANCHES, (5, 8, 3)))
    assert len(np.unique(q[0].round(6), axis=0)) == 8
    assert np.array_equal(q[:, 0], robot.inverse_kinematics(R))  # the working branch by default


def test_rates_and_accelerations_are_derivatives_of_the_angles(odd):
    start, _, _ = random_state(odd, np.random.default_rng(1))
    t, axis = 0.2 + AROUND, 0.7 * np.array((0.6, 0, 0.8))
    turn, omega = np.multiply.outer(np.sin(t), axis), np.multiply.outer(np.cos(t), axis)
    R = Rotation.from_rotvec(turn).as_matrix() @ start
    q, va, aa = odd.joint_motion(R, omega, -turn)
    gamma = np.unwrap(q[:, ::3], axis=0)
    assert np.abs(DIFFERENCES @ gamma - va[3]).max() < 1e-9 * max(1, np.abs(va).max())
    assert np.abs(DIFFERENCES @ va - aa[3]).max() < 1e-9 * max(1, np.abs(aa).max())


def test_platform_velocity_inverts_joint_motion(odd):
    rng = np.random.default_rng(2)
    R, omega, alpha = random_states(odd, rng, 10)
    q, va, _ = odd.joint_motion(R, omega, alpha)
    # Condition numbers up to 30 of two maps in a row.
    assert np.abs(odd.platform_velocity(q, va) - omega).max() < 1e-11


def test_a_batch_of_velocities_at_one_orientation_is_a_batch_of_motions(odd):
    R, omega, alpha = random_states(odd, np.random.default_rng(3), 4)
    everywhere = np.broadcast_to(R[0], R.shape)
    for arguments in ((R[0], omega, alpha), (R[0], omega, alpha[0]), (R[0], omega[0], alpha)):
        whole = [
            np.broadcast_to(x, y.shape) for x, y in zip(arguments[1:], (omega, alpha), strict=True)
        ]
        motion = odd.joint_motion(*arguments)
        expected = odd.joint_motion(everywhere, *whole)
        for x, y in zip(motion, expected, strict=True):
            assert np.array_equal(x, y)
    with pytest.raises(sst_pin.InputError, match="do not broadcast"):
        odd.joint_motion(R, omega[:3], alpha)


def test_direct_kinematics_finds_the_known_assemblies_of_the_paper(robot):
    """Eight at (pi/4, pi/4, pi/4), s = (1, 1, 1)/sqrt(3) among them; four at (0.3, 1.2, 0.8)."""
    eight = robot.forward_kinematics([np.pi / 4] * 3)
    assert eight.shape == (8, 9)
    s = robot.platform_orientation(eight)[..., 0]
    assert np.abs(s - 1 / np.sqrt(3)).max(axis=1).min() < 1e-12
    assert len(np.unique(s.round(8), axis=0)) == 4  # in pairs that share s
    assert robot.forward_kinematics((0.3, 1.2, 0.8)).shape == (4, 9)


@pytest.mark.parametrize("seed", range(3))
def test_direct_kinematics_holds_the_assembly_one_came_from(seed):
    """R -> gamma -> all assemblies: R among them, all closed to 1e-10, an even number."""
    rng = np.random.default_rng(seed)
    robot = sst_pin.SST(random_parameters(rng))
    R, _, _ = random_state(robot, rng)
    branch = sst_pin.sst.BRANCHES[rng.integers(8)]
    q = robot.inverse_kinematics(R, branch)
    solutions = robot.forward_kinematics(q[::3])
    assert 1 <= len(solutions) <= 8
    assert len(solutions) % 2 == 0  # R and R Rot(x, pi)
    assert max(np.abs(robot.residual(x)).max() for x in solutions) < 1e-10
    assert np.abs(in_one_turn(solutions - q)).max(axis=1).min() < 1e-10
    assert np.array_equal(solutions[:, ::3], np.tile(q[::3], (len(solutions), 1)))


def test_near_follows_a_motion_through_its_assemblies(odd):
    start, _, _ = random_state(odd, np.random.default_rng(9))
    turns = Rotation.from_rotvec(np.multiply.outer(np.linspace(0, 0.2, 21), (0.0, 0.6, 0.8)))
    q = odd.inverse_kinematics(turns.as_matrix() @ start)
    near = q[0]
    for expected in q:
        near = odd.forward_kinematics(expected[::3], near=near)
        assert np.abs(in_one_turn(near - expected)).max() < 1e-10


def test_motor_angles_without_assembly_are_told():
    rng = np.random.default_rng(0)
    robot = sst_pin.SST(random_parameters(rng))
    angles = (rng.uniform(-np.pi, np.pi, 3) for _ in range(300))
    gamma = next(each for each in angles if not len(robot.forward_kinematics(each)))
    assert robot.forward_kinematics(gamma).shape == (0, 9)
    with pytest.raises(sst_pin.WorkspaceError, match="no assembly exists"):
        robot.forward_kinematics(gamma, near=robot.home)


def test_a_star_that_moves_while_the_motors_stand_is_singular():
    flat = sst_pin.SST(sst_pin.Parameters(arc_angles=np.radians((90, 90, 180))))
    with pytest.raises(SingularConfigurationError, match="can move while the motors are fixed"):
        flat.forward_kinematics((0.3, np.pi / 2, 0))  # it turns about the normal of an arc


def test_home_of_the_paper_is_isotropic(robot):
    assert robot.home[::3] == pytest.approx([np.pi / 4] * 3)
    measure = robot.singularities(robot.home)
    assert measure.first_kind == pytest.approx(1)
    assert measure.condition_number == pytest.approx(1)


def test_home_is_assembled_on_the_working_branch(odd):
    assert np.abs(odd.residual(odd.home)).max() < 1e-14
    assert odd.branch(odd.home).tolist() == [1, 1, 1]


def test_measures_vanish_at_the_singularities_of_their_kind(robot):
    """First kind: a leg flat on its arc. Second kind: where the closures lose hold of the star."""
    e_1, n_1 = robot.geometry.e[0], robot.geometry.arc_normals[0]
    flat = Rotation.align_vectors([e_1], [n_1])[0]
    with pytest.raises(
        SingularConfigurationError, match="leg 1 is in the plane of its arc"
    ) as caught:
        robot.inverse_kinematics(flat.as_matrix())
    assert caught.value.condition_number > 1e8
    for angle in (0.1, 1e-3, 1e-5):  # turned away from there about an axis normal to e_1
        turn = Rotation.from_rotvec(angle * robot.geometry.R_0[0, :, 0])
        measure = robot.singularities(robot.inverse_kinematics((turn * flat).as_matrix()))
        assert measure.first_kind <= np.sin(angle) * (1 + 1e-6)

    q = robot.inverse_kinematics(Rotation.random(200, rng=np.random.default_rng(3)).as_matrix())
    second, condition = robot.singularities(q).second_kind, robot.condition_number(q)
    # The closures lose hold of the star where A does: the two measures fall and rise together.
    assert condition[second.argmin()] > 10 * np.median(condition)


def test_an_orientation_beyond_the_joint_limits_is_out_of_reach(tmp_path):
    """Limits of an edited URDF count; the error names joint, value and limits."""
    text = Path(sst_pin.URDF_PATH).read_text()
    (tmp_path / "short.urdf").write_text(text.replace(f'upper="{2 * np.pi!r}"', 'upper="1.0"'))
    robot = sst_pin.SST.from_urdf(tmp_path / "short.urdf")
    with pytest.raises(sst_pin.WorkspaceError, match=r"mu_1 would be 1\.571 rad"):
        robot.inverse_kinematics(sst_pin.paper_circle(0.0).R)


def test_smooth_interpolation_reproduces_a_motion_and_its_rates():
    """Through samples of the circle, orientation and rates, at the order of the spline."""
    errors = []
    for count in (101, 201):
        t = np.linspace(0, np.pi / 6, count)
        between = np.linspace(0.05, 0.45, 333)  # the ends of a spline are less exact
        motion = sst_pin.sst.interpolate_orientations(t, sst_pin.paper_circle(t).R, between)
        exact = sst_pin.paper_circle(between)
        errors.append([np.abs(a - b).max() for a, b in zip(motion, exact, strict=True)])
    orders = np.log2(np.array(errors[0]) / errors[1])
    assert (orders > (5.5, 4.5, 3.5)).all()  # h^6, h^5, h^4 for degree five
    assert (np.array(errors[1]) < (1e-8, 1e-6, 1e-4)).all()
    at_samples = sst_pin.sst.interpolate_orientations(t, sst_pin.paper_circle(t).R, t)
    assert np.abs(at_samples.R - sst_pin.paper_circle(t).R).max() < 1e-14


def test_interpolated_rates_are_the_derivatives_of_the_interpolated_motion():
    """Between samples so far apart that the spline leaves the unit sphere of quaternions."""
    t = np.linspace(0, 3, 7)
    R = Rotation.from_rotvec(np.array((np.sin(t), t**2 / 4, 1 - t)).T).as_matrix()
    motion = sst_pin.sst.interpolate_orientations(t, R, 1.2 + AROUND)
    assert max(off_rates(motion)) < 1e-11


def test_angles_of_the_paper_and_their_rates_are_consistent():
    t = 0.3 + AROUND
    theta, phi = (np.sin(t), np.cos(t), -np.sin(t)), (1 + 0.3 * t**2, 0.6 * t, 0.6)
    motion = sst_pin.sst.orientation_motion(theta, phi, (0.5 * t, 0.5, 0))
    assert max(off_rates(motion)) < 1e-11
