# SPDX-License-Identifier: BSD-2-Clause
"""What is drawn of any closed chain: where its model has it, as large as its numbers say."""

import functools
import warnings

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import trimesh

import sst_pin
from sst_pin import errors
from sst_pin.cli import main
from sst_pin.description.colours import HUES
from sst_pin.viewer import Viewer
from sst_pin.viewer.force_shares import torque_shares
from sst_pin.viewer.robot_scene import Scene
from tests.support import any_chain
from tests.support.files import ROOT, load

run_pages = load("scripts/pages/run_pages.py")

DELTA = ROOT / "examples" / "delta.urdf"
BARE = pin.GeometryModel()

#: What links of the five-bar are drawn with.
STEEL = '<material name="steel"><color rgba="0.2 0.4 0.6 1"/></material>'
VISUAL = """<visual><origin xyz="0 0\t0.1" rpy="0.1 0 0"/><geometry>{}</geometry>
  <material name="steel"/></visual>"""


def five_bar(folder, **shapes):
    """The five-bar of docs/own_robot.md without a home; shapes are XML of <geometry> by link."""
    run_pages.paste((ROOT / "docs" / "own_robot.md").read_text(encoding="utf-8"), folder)
    (folder / "five_bar.srdf").unlink()
    path = folder / "five_bar.urdf"
    text = path.read_text().replace('name="five_bar">', f'name="five_bar">{STEEL}')
    text = text.replace('<link name="base"/>', '<link name="base"></link>')
    for link, shape in shapes.items():
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{VISUAL.format(shape)}')
    path.write_text(text)
    chain = sst_pin.ClosedChain.from_urdf(path)
    return chain, chain.assemble([-0.5, 1.2, 0.5, -1.2], fixed=["left", "right"]), path


MJCF = """
<mujoco model="linkage">
  <compiler angle="radian"/>
  <asset>
    <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.2"/>
    <material name="red" rgba="0.8 0.1 0.1 1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="crank" pos="0 0 0.1" euler="0.3 0 0">
      <joint name="crank" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.1" size="0.01" mass="0.1" material="red"/>
      <geom type="box" size="0.02 0.03 0.04" pos="0.1 0 0" mass="0.1" group="3"/>
      <body name="coupler" pos="0 0 0.1">
        <joint name="elbow" axis="0 1 0" ref="0.2"/>
        <geom name="wedge" type="mesh" mesh="wedge" mass="0.2" rgba="0 1 0 0.5"/>
        <geom type="ellipsoid" size="0.01 0.02 0.05" pos="0 0 0.3" euler="0 0.4 0" mass="0.1"/>
      </body>
    </body>
    <body name="rocker" pos="0.3 0 0.1">
      <joint name="rocker" pos="0.01 0 0.02" axis="0 1 0"/>
      <geom type="cylinder" fromto="0 0 0 0.1 0 0.2" size="0.01" mass="0.1"/>
      <geom type="sphere" size="0.03" pos="0.1 0 0.2" mass="0.1"/>
    </body>
  </worldbody>
  <equality><connect body1="coupler" body2="rocker" anchor="0 0 0.3"/></equality>
  <actuator><motor joint="crank"/></actuator>
</mujoco>
"""


@functools.cache
def robot_of(name):
    """A robot and an assembled configuration."""
    if name == "delta.urdf":
        delta = sst_pin.ClosedChain.from_urdf(DELTA)
        return delta, delta.assemble(pin.neutral(delta.model), fixed=())
    if name == "rods":
        rods = any_chain.rods()
        return rods, any_chain.states(rods, 1, 0)[0][0]
    robot = getattr(sst_pin.robots, name)()
    return robot, robot.home


#: Every kind of joint and closure; a few of them in the quick run.
QUICK = ("four_bar", "delta.urdf", "rods")
ALL = {*QUICK, *(name for name in sst_pin.robots.__all__ if name.islower())}
ALL = [pytest.param(x, marks=() if x in QUICK else pytest.mark.slow) for x in sorted(ALL)]


def placed(scene, q, shape):
    """Vertices of a shape in the base, shape (n, 3)."""
    at = scene.poses(q)[shape.mover] @ shape.at
    return shape.mesh.vertices @ at[:3, :3].T + at[:3, 3]


@pytest.mark.parametrize("name", ALL)
def test_ends_of_closed_loops_are_drawn_at_one_place(name):
    """Balls of both frames of each `Closure` that holds points, to the loops' own residual."""
    robot, q = robot_of(name)
    scene = Scene(robot, BARE)
    ends = {s.name: placed(scene, q, s).mean(axis=0) for s in scene.shapes if "end_" in s.name}
    for closure in robot.closures:
        if isinstance(closure, sst_pin.Closure) and all(closure.held[:3]):
            a, b = (ends[f"end_{name}"] for name in (closure.frame_a, closure.frame_b))
            assert np.linalg.norm(a - b) < 1e-8


@pytest.mark.parametrize("name", ["stewart", "rods"])
def test_an_ellipsoid_is_the_homogeneous_solid_of_the_bodys_inertia(name):
    """Centre and inertia of the drawn surface, filled with the body's mass, as trimesh integrates.

    Its 320 triangles lie inside the ellipsoid: its moments are smaller by less than 3 %.
    """
    robot, _ = robot_of(name)
    drawn = {s.name: s for s in Scene(robot, BARE).shapes if s.layer == "inertia"}
    compared = 0
    for joint, inertia in enumerate(robot.model.inertias):
        shape = drawn.get(f"mass_{robot.model.names[joint]}")
        moments = np.linalg.eigvalsh(inertia.inertia)
        if shape is None or moments.sum() < 2.01 * moments.max():  # flat, or a needle
            continue
        vertices = shape.mesh.vertices @ shape.at[:3, :3].T + shape.at[:3, 3]
        solid = trimesh.Trimesh(vertices, shape.mesh.faces)
        solid.density = inertia.mass / solid.volume
        size = np.sqrt(moments.max() / inertia.mass)
        assert np.abs(solid.center_mass - inertia.lever).max() < 1e-9 * max(size, 1)
        assert np.abs(solid.moment_inertia - inertia.inertia).max() < 0.03 * moments.max()
        compared += 1
    assert compared


@pytest.mark.parametrize("name", ALL)
def test_axes_are_those_of_the_joints(name):
    """Direction and a point: the velocity of the joint's own frame, by Pinocchio's Jacobian."""
    robot, _ = robot_of(name)
    scene = Scene(robot, BARE)
    data = robot.model.createData()
    J = pin.computeJointJacobians(robot.model, data, scene.start)
    axes = [s for s in scene.shapes if s.layer == "axes"]
    assert len(axes) == robot.model.nv
    for i, shape in enumerate(axes):
        at = scene.poses(scene.start)[shape.mover] @ shape.at
        direction, point = at[:3, 2], at[:3, 3]
        linear, angular = J[:3, i], J[3:, i]
        if np.linalg.norm(angular) > 1e-9:
            pitch = linear + np.cross(angular, point)  # of the point that is drawn
            assert np.abs(np.cross(pitch, direction)).max() < 1e-9
            linear = angular
        assert np.abs(direction - linear / np.linalg.norm(linear)).max() < 1e-9


@pytest.mark.parametrize("name", ["four_bar", "excavator"])
def test_arrows_are_as_large_as_the_torques_and_turn_with_their_sign(name):
    robot, q = robot_of(name)
    viewer = Viewer(robot)
    tau = np.linspace(-1, 3, len(robot.motor_names)) ** 3
    viewer.show(q, tau)
    arrows = viewer._scene.arrows
    assert [arrow.motor for arrow in arrows] == list(range(len(tau)))
    units = np.array(robot.motor_units)
    effort = torque_shares(robot, tau[None])[0]
    for unit in set(units):
        assert np.abs(effort[units == unit]).max() == pytest.approx(1)
    full = [np.linalg.norm(arrow.shape.at[:3, 0]) for arrow in arrows]
    for arrow, size in zip(arrows, full, strict=True):
        matrix = arrow.placement(effort)[:3, :3]
        shrunk = np.linalg.norm(matrix[:, 0]) / size
        assert shrunk == pytest.approx(max(np.sqrt(abs(effort[arrow.motor])), 1e-3))
        assert np.sign(np.linalg.det(matrix)) == (-1 if effort[arrow.motor] < 0 else 1)


def test_rods_without_mass_and_forces_along_lines_reach_from_frame_to_frame():
    robot, _ = robot_of("rods")
    rods = [c for c in robot.closures if isinstance(c, sst_pin.Distance)]
    poses = Scene(robot, BARE).poses(any_chain.states(robot, 1, 1)[0][0])
    lengths = [np.linalg.norm(poses[f"rod_{k}"][:3, 2]) for k in range(len(rods))]
    assert rods
    assert lengths == pytest.approx([rod.distance for rod in rods])
    bar = sst_pin.robots.four_bar()
    ends = "universe", "platform"
    kinds = {"cylinder": {}, "coil": {"stiffness": 3}, "damper": {"damping": 2}}
    lines = [sst_pin.LineForce(*ends, name=name, **how) for name, how in kinds.items()]
    robot = sst_pin.ClosedChain(bar.model, bar.closures, ["crank", "cylinder"], lines=lines)
    scene = Scene(robot, BARE)
    shapes = {shape.name: shape for shape in scene.shapes if shape.mover.startswith("line_")}
    cylinder, coil, damper = (shapes[f"line {name}"] for name in kinds)
    assert cylinder.colour == HUES[1]
    assert len(coil.mesh.vertices) > 5 * len(damper.mesh.vertices)
    poses = scene.poses(bar.home)
    lengths = [np.linalg.norm(poses[f"line_{k}"][:3, 2]) for k in range(3)]
    assert lengths == pytest.approx(robot.line_lengths(bar.home))


def test_a_urdf_by_hand_brings_its_visuals(tmp_path):
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "meshes" / "block.stl")
    chain, q, _ = five_bar(
        tmp_path,
        base='<box size="0.3 0.1  0.02"/>',
        left_arm='<cylinder radius="0.01" length="0.2"/>',
        right_arm='<sphere radius="0.05"/>',
        right_rod='<mesh filename="meshes/block.stl" scale="1 1 0.5"/>',
        left_rod=f'<mesh filename="package://{tmp_path.name}/meshes/block.stl"/>',
    )
    scene = Scene(chain, None)
    sizes = {s.name: np.ptp(s.mesh.vertices, axis=0) for s in scene.shapes if s.layer == "bodies"}
    wanted = {
        "base_0": (0.3, 0.1, 0.02),
        "left_arm_0": (0.02, 0.02, 0.2),
        "right_arm_0": (0.1, 0.1, 0.1),
        "right_rod_0": (0.1, 0.2, 0.15),
        "left_rod_0": (0.1, 0.2, 0.3),
    }
    assert set(sizes) == set(wanted)
    for name, size in wanted.items():
        assert sizes[name] == pytest.approx(size, rel=0.01), name
    data = chain.model.createData()
    pin.framesForwardKinematics(chain.model, data, q)
    offset = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0, 0), np.array([0, 0, 0.1]))
    for shape in (s for s in scene.shapes if s.layer == "bodies"):
        frame = data.oMf[chain.model.getFrameId(shape.name.removesuffix("_0"))]
        at = scene.poses(q)[shape.mover] @ shape.at
        assert np.abs(at - (frame * offset).homogeneous).max() < 1e-12
        assert shape.colour == "#336699"


def test_a_mesh_that_cannot_be_read_is_told(tmp_path, capsys):
    chain, q, path = five_bar(tmp_path, base='<mesh filename="meshes/gone.stl"/>')
    chain.compute_torques(q, [0, 0], [0, 0])
    with pytest.raises(errors.DescriptionError, match=r"gone\.stl.*show --skeleton"):
        chain.show(q, open_browser=False)
    assert "bodies" not in Viewer(chain, BARE)._panel["layers"]
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "gone.stl").write_text("no mesh")
    with pytest.raises(errors.DescriptionError, match=r"gone\.stl"):
        Viewer(chain)
    page = str(tmp_path / "page.html")
    assert main(["show", "--robot", str(path), "--html", page]) == 2
    assert main(["show", "--robot", str(path), "--html", page, "--skeleton"]) == 0
    assert "five_bar ->" in capsys.readouterr().out


def test_an_mjcf_is_drawn_as_mujoco_has_it(tmp_path):
    """Centres of its geoms by mj_forward, its colours; collision shapes and floors stay away."""
    path = tmp_path / "linkage.xml"
    path.write_text(MJCF)
    # The crank's axis is tilted, so its rates lead to no other pose; it is drawn all the same.
    with pytest.warns(errors.DescriptionWarning, match="lead to no other pose"):
        chain = sst_pin.ClosedChain.from_mjcf(path)
    q = chain.assemble(pin.neutral(chain.model), fixed=())
    scene = Scene(chain, None)
    bodies = {int(s.name.split("_")[0]): s for s in scene.shapes if s.layer == "bodies"}
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, value in zip(chain.joint_names, q, strict=True):
        data.joint(name).qpos = value
    mujoco.mj_kinematics(model, data)
    shown = [i for i in range(model.ngeom) if model.geom_group[i] < 3 and model.geom_type[i] > 0]
    assert sorted(bodies) == shown
    for i, shape in bodies.items():
        at = scene.poses(q)[shape.mover] @ shape.at
        assert np.abs(at[:3, 3] - data.geom_xpos[i]).max() < 1e-9
        assert np.abs(at[:3, :3] - data.geom_xmat[i].reshape(3, 3)).max() < 1e-9
        reach = np.linalg.norm(shape.mesh.vertices, axis=1).max()
        assert reach == pytest.approx(model.geom_rbound[i], rel=0.5)
    colours = {s.colour for s in bodies.values()}
    assert {"#CC1A1A", "#00FF00"} <= colours
    wedge = next(s for s in bodies.values() if s.colour == "#00FF00")
    assert wedge.opacity == 0.5
    path.unlink()  # it was read once, its shapes included
    assert "bodies" in Viewer(chain)._panel["layers"]


def test_a_page_warns_of_open_loops_and_limits(tmp_path):
    chain, q, _ = five_bar(tmp_path)
    viewer = Viewer(chain)
    viewer.show(q)
    assert viewer.warnings == ()
    viewer.show(q + 0.1 * np.eye(4)[0])
    assert "the loops are open by" in viewer.warnings[0]
    chain.model.upperPositionLimit[:] = q + np.array((-0.2, 1, 1, 1))
    chain.refresh()
    zero = np.zeros((2, 2))
    inside = chain.assemble(q - 0.3 * np.eye(4)[0], fixed=["left", "right"])
    viewer.play(chain.trajectory([0, 1], [q, inside], zero, zero))
    assert viewer.warnings[0].startswith("left leaves its limits of -3.2 to ")
    assert viewer.warnings[0].endswith(" rad at t = 0 s")


def test_who_shows_a_robot_without_home_is_told_that_its_mode_was_chosen(tmp_path):
    chain, q, _ = five_bar(tmp_path)
    with pytest.warns(sst_pin.DescriptionWarning, match="an assembly mode was chosen"):
        chain.show(open_browser=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error", sst_pin.DescriptionWarning)
        chain.show(q, open_browser=False)
