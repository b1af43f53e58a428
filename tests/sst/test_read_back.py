# SPDX-License-Identifier: BSD-2-Clause
"""Parameters through files and back; the conventions of other people's loaders."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.description.sst_mjcf import mjcf_of
from sst_pin.description.urdf_writer import urdf_of, yaml_of
from sst_pin.dynamics.dynamics import Friction
from sst_pin.sst.robot_wrapper import configurations_of
from sst_pin.sst.topology import geometry_of, parameters_of
from tests.support.sampling import parameters_of_odd_size

mujoco = pytest.importorskip("mujoco", reason="extra `verify` is not installed")


def assert_same(result, expected):
    """To rounding: 15 decimals of roll, pitch, yaw in the file, 16 digits of what comes back.

    Angles add up three errors of 5e-16 and cancel in 2 pi; the star's bodies are turned into {3k}
    and back; the links are as they were but for the 16 digits.
    """
    assert result.base_directions == pytest.approx(expected.base_directions, rel=0, abs=5e-16)
    assert result.arc_angles == pytest.approx(expected.arc_angles, rel=0, abs=5e-15)
    bodies = ((*p.links, *p.passive_links, p.star) for p in (result, expected))
    for ours, theirs in zip(*bodies, strict=True):
        assert ours.mass == pytest.approx(theirs.mass, rel=4e-16)
        assert ours.center_of_mass == pytest.approx(theirs.center_of_mass, rel=0, abs=2e-15)
        assert ours.inertia == pytest.approx(theirs.inertia, rel=0, abs=2e-15)
    assert type(result.link) is type(expected.link)
    for name in ("viscous_friction", "coulomb_friction", "gravity"):
        assert np.array_equal(getattr(result, name), getattr(expected, name))
    for name in ("base_radius", "star_radius"):
        assert getattr(result, name) == pytest.approx(getattr(expected, name), rel=4e-16)


#: A quarter turn and minus a third of one as in the shipped file.
QUARTER, THIRD = "1.570796326794896", "-2.094395102393195"
ROBOTS = [sst_pin.Parameters(), *map(parameters_of_odd_size, range(2))]


@pytest.mark.parametrize("p", ROBOTS)
def test_parameters_survive_the_way_through_urdf(p, tmp_path):
    (tmp_path / "sst.urdf").write_text(urdf_of(p))
    (tmp_path / "sst.yaml").write_text(yaml_of(p))
    result = sst_pin.SST.from_urdf(tmp_path / "sst.urdf").parameters
    assert_same(result, p)
    # The second way round changes nothing any more but last digits of the first.
    assert_same(sst_pin.SST(result).parameters, p)


@pytest.mark.parametrize("p", ROBOTS)
def test_parameters_survive_the_way_through_mjcf(p, tmp_path):
    """`SST.from_mjcf` reads them, and Pinocchio's reader with what that leaves out."""
    (tmp_path / "sst.xml").write_text(mjcf_of(p, configurations_of(p)))
    (tmp_path / "meshes").symlink_to(Path(sst_pin.sst.PACKAGE_PATH, "meshes"))
    assert_same(sst_pin.SST.from_mjcf(tmp_path / "sst.xml").parameters, p)
    model = pin.buildModelFromMJCF(str(tmp_path / "sst.xml"))
    compiled = mujoco.MjModel.from_xml_path(str(tmp_path / "sst.xml"))
    model.gravity.linear = compiled.opt.gravity
    for name in ("P_1", "P_2", "P_3"):
        placement = pin.SE3(np.eye(3), compiled.site(name).pos)
        model.addFrame(pin.Frame(name, 0, placement, pin.FrameType.OP_FRAME))
    geometry = geometry_of(model, "sst.xml")
    assert_same(parameters_of(model, geometry, Friction(model.damping, model.friction)), p)


def edited(tmp_path, *replacements, after="<", count=-1):
    """The shipped robot, its URDF edited behind some text; `count` times, -1 for all."""
    head, mark, tail = Path(sst_pin.URDF_PATH).read_text().partition(after)
    for old, new in replacements:
        assert old in tail
        tail = tail.replace(old, new, count)
    (tmp_path / "edited.urdf").write_text(head + mark + tail)
    return sst_pin.SST.from_urdf(tmp_path / "edited.urdf")


def test_a_mass_centre_in_the_origin_is_read_back():
    link = sst_pin.sst.RigidBody(2.0, (0, 0, 0), np.diag([0.01, 0.02, 0.02]))
    result = sst_pin.SST(sst_pin.Parameters(link=link)).parameters.link
    assert np.array_equal(result.center_of_mass, np.zeros(3))
    assert result.inertia == pytest.approx(link.inertia, rel=0, abs=2e-15)


def test_arcs_of_unequal_mass_are_read_as_their_sum(tmp_path):
    """A heavier star_2 is a heavier star: other parameters, the same closed robot."""
    heavy = ('"0.8666666666666667"', '"1.5"'), ('iyz="0.01', 'iyz="0.02')
    robot = edited(tmp_path, *heavy, after='<link name="star_2">', count=1)
    p = robot.parameters
    assert p.star.mass == pytest.approx(2.6 / 3 * 2 + 1.5, abs=1e-15)
    q, va, aa = robot.joint_motion(*sst_pin.paper_circle([0.1]))
    tau = robot.compute_torques(q, va, aa)
    assert np.abs(sst_pin.SST(p).compute_torques(q, va, aa) - tau).max() < 1e-12


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('"E"', '"F"', "frame E is missing"),
        (
            'xyz="0.0 0.35 0.0"',
            'xyz="0.0 0.36 0.0"',
            "P_2: origin xyz 0 0.36 0 rpy 0 0 0, expected xyz",
        ),
        (
            f'"{QUARTER} 0.0 {QUARTER}"',
            f'"1.5 0.0 {QUARTER}"',
            "gamma_2: origin xyz 0 0 0 rpy",
        ),
        ('upper="6.283185307179586"', 'upper="1.6"', "mu_1: limits -6.28319 and 1.6 rad"),
        (
            f'rpy="{THIRD} 0.0 0.0"',
            'rpy="-2.1 0.1 0.0"',
            "closedloop1_B: origin xyz 0 0 0 rpy -2",
        ),
    ],
)
def test_what_parameters_cannot_hold_is_refused_by_name(tmp_path, old, new, word):
    """Nothing is lost in silence: the robot computes, its parameters raise."""
    robot = edited(tmp_path, (old, new))
    assert np.isfinite(robot.compute_torques(robot.home, np.zeros(3), np.zeros(3))).all()
    with pytest.raises(sst_pin.DescriptionError) as caught:
        _ = robot.parameters
    assert word in str(caught.value)


def test_load_is_a_robot_wrapper_with_geometry_and_poses(robot):
    """model, q0, visual and collision models, as example_robot_data has them."""
    wrapper = sst_pin.load()
    assert isinstance(wrapper, pin.RobotWrapper)
    assert wrapper.model.nq == wrapper.model.nv == 9
    assert np.array_equal(wrapper.q0, robot.home)
    assert wrapper.model.gravity.linear.tolist() == [0, 0, -9.81]
    assert wrapper.visual_model.ngeoms == 12
    assert all(Path(g.meshPath).is_file() for g in wrapper.visual_model.geometryObjects)
    poses = wrapper.model.referenceConfigurations
    start = robot.inverse_kinematics(sst_pin.paper_circle([0.0]).R[0])
    for name, q in (("home", robot.home), ("circle_start", start)):
        assert poses[name] == pytest.approx(q, abs=1e-14)  # files have 14 decimals
        assert np.abs(robot.residual(poses[name])).max() < 1e-14
