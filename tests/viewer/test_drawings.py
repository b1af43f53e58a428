# SPDX-License-Identifier: BSD-2-Clause
"""Drawings: arrows of reactions, the foot of a leg, the whole path, words as they are."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import Contact, robots
from sst_pin.cli import main
from sst_pin.viewer import Viewer
from sst_pin.viewer.arrows import reaction_arrows
from sst_pin.viewer.force_shares import contact_forces, reaction_forces
from sst_pin.viewer.robot_scene import Scene
from sst_pin.viewer.scene_parts import transform
from tests.gallery.touching import block_on_slope, frame, tree
from tests.support.oblique import with_oblique_axes

FOOT = np.array((0.3, 0.0, -0.4))


def test_arrows_are_the_forces_of_the_reactions():
    robot = robots.delta()
    q, tau = robot.home, np.linspace(1, 2, len(robot.motor_names))
    viewer = Viewer(robot, reactions=True)
    placed = {}
    placements = viewer._drawing._placements
    viewer._drawing.place = lambda q, effort: placed.update(placements(q, effort))
    viewer.show(q, tau)
    w = robot.reactions(q, np.zeros(robot.degrees_of_freedom), tau=tau)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    ends = [data.oMf[robot.model.getFrameId(closure.frame_b)] for closure in robot.closures]
    places = [*data.oMi[1:], *ends]
    forces = np.concatenate([w.joints, w.closures])[:, :3]
    forces = np.array([at.rotation @ f for at, f in zip(places, forces, strict=True)])
    arrows = [
        data.oMi[int(pull.shape.mover)].homogeneous @ placed[f"robot/{pull.shape.node}"]
        for pull in reaction_arrows(robot, viewer._scene.layout, viewer._scene.size)
    ]
    starts, ways = np.array(arrows)[:, :3, 3], np.array(arrows)[:, :3, 2]
    assert starts == pytest.approx(np.array([at.translation for at in places]), abs=1e-12)
    sizes = np.linalg.norm(forces, axis=1)
    large = sizes > 1e-4 * sizes.max()  # arrows have a smallest size
    longest = np.linalg.norm(ways, axis=1).max()
    lengths = longest * np.sqrt(sizes / sizes.max())
    directions = forces[large] / sizes[large, None]
    assert ways[large] == pytest.approx(lengths[large, None] * directions, abs=1e-9 * longest)
    assert f"the largest is {sizes.max():.3g}\\u00a0N" in viewer.html


def test_unique_forces_of_a_planar_robot_are_drawn_and_the_others_named():
    robot = robots.four_bar()
    swing = robot.simulate([0], robot.home, [0], np.linspace(0, 0.1, 5))
    with robot.show(swing, open_browser=False, reactions=True) as viewer:
        assert "Not unique, so not drawn: crank (z), coupler (z), rocker (z)" in viewer.html
        assert "Dark arrows" in viewer.html
    (pin,) = robot.closures
    doubled = sst_pin.ClosedChain(robot.model, [pin, pin], robot.motor_names)
    viewer = Viewer(doubled, reactions=True)
    viewer.show(doubled.home, [0.1])
    assert f"{pin} (1), {pin} (2)." in viewer.html  # nothing of them is unique
    soft = dict.fromkeys((*robot.joint_names, str(robot.closures[0])), np.ones(6))
    with robot.show(swing, open_browser=False, reactions=soft) as viewer:
        assert "Not unique" not in viewer.html
        assert "Dark arrows" in viewer.html
        assert viewer._panel["layers"]["reactions"]
    assert "reactions" not in Viewer(robot)._panel["layers"]


def test_forces_in_the_plane_are_drawn_whatever_the_axes_of_the_joints_are():
    """The arrows are those of the robot whose own axes are along its plane."""
    aligned = robots.four_bar()
    swing = aligned.simulate([0], aligned.home, [0], np.linspace(0, 0.1, 5))
    arrows = []
    for robot in (aligned, with_oblique_axes(aligned, 3)):
        motion = robot.trajectory(swing.t, swing.q, swing.va, swing.aa, swing.tau)
        viewer = Viewer(robot, reactions=True)
        placed = _placed_during(viewer, motion)
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, motion.q[-1])
        of_robot = []
        for pull in reaction_arrows(robot, viewer._scene.layout, viewer._scene.size):
            at = data.oMi[int(pull.shape.mover)].homogeneous
            matrix = at @ placed[-1][f"robot/{pull.shape.node}"] / viewer._scene.size
            of_robot.append(matrix[:3, 2])  # the arrow
        arrows.append(of_robot)
    assert np.linalg.norm(arrows[0], axis=1).max() > 0.1
    assert np.array(arrows[1]) == pytest.approx(np.array(arrows[0]), abs=1e-9)
    assert "crank (along one direction)" in viewer.html


def _placed_during(viewer, motion):
    """Placements of all nodes at each sample of a motion that the viewer plays."""
    placements = viewer._drawing._placements
    placed = []
    viewer._drawing.animate = lambda motion, effort, *_: placed.extend(
        map(placements, motion.q, effort)
    )
    viewer.play(motion)
    return placed


def test_contacts_that_act_are_drawn_with_their_forces():
    """A block that slides: arrows along the forces, at its corners, in world axes."""
    chain, q0 = block_on_slope(0.4, 0.3)
    motion = chain.rollout(np.zeros((4, 0)), q0, np.zeros(6), 0.01, nonsmooth=True)
    viewer = Viewer(chain)
    scene = viewer._scene
    placed = _placed_during(viewer, motion)
    slope = chain.frame_placement(q0, "slope")[1]
    forces = motion.contact_forces @ slope.T
    arrows = scene.arrows  # without motors and reactions: all of contacts
    for k in range(4):
        corners = chain.frame_placement(motion.q, f"corner_{k}")[0]
        force, point = (x.shape.node for x in arrows[2 * k : 2 * k + 2])
        for s in range(1, 5):
            at = placed[s][f"robot/contact_{k}"]
            assert at[:3, 3] == pytest.approx(corners[s], abs=1e-12)
            way = (at @ placed[s][f"robot/{force}"])[:3, 2]
            size = np.linalg.norm(forces[s - 1, k])
            assert way / np.linalg.norm(way) == pytest.approx(forces[s - 1, k] / size, abs=1e-9)
            assert placed[s][f"robot/{point}"][0, 0] == 1.0
    longest = np.linalg.norm(forces, axis=2).max()
    assert f"the longest is {longest:.3g}\\u00a0N." in viewer.html


def test_a_contact_is_drawn_only_while_it_acts_and_rest_is_seen_beside_an_impact():
    """A ball of 1 kg that falls and stays: the arrow of its weight has 0.7 of the longest."""
    model = tree(("z", pin.JointModelPZ(), 1.0, 0.1))
    frame(model, "ball", "z", (0, 0, 0))
    chain = sst_pin.ClosedChain(model, [], [], contacts=[Contact("ball", radius=0.1)])
    motion = chain.rollout(np.zeros((300, 0)), [0.2], [0], 1e-3, nonsmooth=True)
    viewer = Viewer(chain)
    placed = _placed_during(viewer, motion)
    lengths = [
        np.linalg.norm(x["robot/contact_0/contacts/force"][:3, 2]) / (0.45 * viewer._scene.size)
        for x in placed
    ]
    points = [x["robot/contact_0/contacts/point"][0, 0] for x in placed]
    impact = int(np.argmax(np.abs(motion.contact_forces[:, 0, 2]) > 0))
    assert max(lengths[: impact + 1]) == max(points[: impact + 1]) == 1e-3
    assert lengths[impact + 1] == pytest.approx(1)
    assert np.array(lengths[impact + 3 :]) == pytest.approx(np.sqrt(0.5), rel=1e-6)
    assert min(points[impact + 1 :]) == 1.0
    assert placed[-1]["robot/contact_0"][:3, 3] == pytest.approx([0, 0, 0], abs=1e-12)


@pytest.mark.slow
def test_forces_of_contacts_are_means_between_the_samples_of_the_page():
    """The impulse of an impact between two samples is kept."""
    chain, q0 = block_on_slope(0.0, 0.0)  # without friction all forces are along one direction
    q0[2] += 0.05
    motion = chain.rollout(np.zeros((1400, 0)), q0, np.zeros(6), 1e-4, nonsmooth=True)
    viewer = Viewer(chain)
    viewer.play(motion)
    curves = viewer._panel["curves"][0]
    assert curves["called"] == "contacts"
    assert curves["units"] == ["N"] * 4
    times = np.array(viewer._panel["t"])
    drawn = np.diff(times) @ np.array(curves["values"])[1:]
    norms = np.linalg.norm(motion.contact_forces, axis=2)
    assert drawn == pytest.approx(1e-4 * norms.sum(axis=0), rel=1e-9)


def test_a_viewer_refuses_several_nonsmooth_motions_and_those_of_others():
    chain, q0 = block_on_slope(0.0, 0.3)
    batch = chain.rollout(np.zeros((2, 3, 0)), q0, np.zeros(6), 1e-3, nonsmooth=True)
    with pytest.raises(sst_pin.errors.InputError, match=r"single\(0\)"):
        chain.show(batch, open_browser=False)
    assert chain.show(batch.single(1), open_browser=False)._panel["t"] == [0, 1e-3, 2e-3, 3e-3]
    with pytest.raises(sst_pin.errors.InputError, match="another robot"):
        robots.four_bar().show(batch.single(0), open_browser=False)
    with pytest.raises(sst_pin.errors.InputError, match="reactions"):
        chain.show(batch.single(0), open_browser=False, reactions=True)


def test_show_takes_the_keywords_of_the_viewer():
    robot = robots.four_bar()
    viewer = robot.show(open_browser=False, frame="coupler_pin", axes=True, frames=True)
    assert viewer._scene.point.name == "coupler_pin"
    assert viewer._panel["layers"]["axes"]
    with pytest.raises(sst_pin.UnknownNameError):
        robot.show(open_browser=False, frame="nothing")


def test_an_arrow_is_seen_beside_one_that_is_a_hundred_times_longer():
    robot = robots.delta()
    viewer = Viewer(robot, pin.GeometryModel())
    arrows = viewer._scene.arrows
    small, _, large = (
        np.linalg.norm(arrow.placement(np.array([0.01, 0.0, 1.0]))[:3, 0]) for arrow in arrows
    )
    assert small == pytest.approx(0.1 * large)


@pytest.mark.parametrize("name", ["four_bar", "five_bar"])
def test_a_planar_robot_is_seen_face_on_without_ellipsoids(name):
    """Along the axes of its hinges; spatial robots are not planar."""
    robot = getattr(robots, name)()
    viewer = Viewer(robot, pin.GeometryModel())
    data = robot.model.createData()
    J = pin.computeJointJacobians(robot.model, data, robot.home)
    turning = J[3:, np.linalg.norm(J[3:], axis=0) > 0.5]
    face = np.array(viewer._panel["face"])
    assert np.abs(np.cross(turning.T, face)).max() < 1e-3
    assert not viewer._panel["layers"]["inertia"]
    assert Viewer(robots.delta())._panel["face"] is None


@pytest.mark.parametrize("reactions", ["yes", 1, None, {"crank": [1, 2]}])
def test_what_is_no_switch_and_no_stiffness_is_refused(reactions):
    with pytest.raises(sst_pin.InputError, match="stiffness"):
        Viewer(robots.four_bar(), reactions=reactions)


def test_a_motion_under_other_loads_and_an_open_loop_have_no_arrows_in_silence():
    robot = robots.five_bar()
    motion = robot.simulate([0, 0], robot.home, [0, 0], [0, 0.1, 0.2])
    heavy = robot.trajectory(motion.t, motion.q, motion.va, motion.aa, motion.tau + 1)
    viewer = Viewer(robot, reactions=True)
    with pytest.raises(sst_pin.InputError, match="other forces than its torques"):
        viewer.play(heavy)
    viewer.show(np.add(robot.home, [0, 0.1, 0, 0]))
    assert "No reactions: " in viewer.html


def test_the_command_shows_reactions(tmp_path):
    page = tmp_path / "delta.html"
    assert main(["show", "--robot", "delta", "--reactions", "--html", str(page)]) == 0
    assert "Dark arrows" in page.read_text()


def leg():
    """A four-bar whose coupler ends in a foot, a link behind a fixed joint, far from all else."""
    chain = sst_pin.robots.four_bar()
    model = chain.model.copy()
    model.addFrame(pin.Frame("foot", 2, pin.SE3(np.eye(3), FOOT), pin.FrameType.BODY))
    twin = sst_pin.ClosedChain(model, chain.closures, chain.motor_names)
    t = np.linspace(0, 0.5, 11)
    return twin, sst_pin.coordinate_motion(twin, t, twin.home[:1] + t[:, None])


def test_a_skeleton_reaches_to_the_foot():
    chain, _ = leg()
    scene = Scene(chain, pin.GeometryModel())
    bones = [s.mesh.vertices for s in scene.shapes if s.node.startswith("2/skeleton/bone")]
    assert min(np.linalg.norm(v - FOOT, axis=1).min() for v in bones) < 0.05 * scene.size


def test_the_view_frames_the_path_of_the_frame_that_is_asked_for():
    """No sample of the path lies beyond the outermost points, in any of many directions."""
    chain, motion = leg()
    viewer = Viewer(chain, frame="foot")
    viewer.play(motion)
    reach = np.array(viewer._panel["reach"])
    data, path = chain.model.createData(), []
    for q in motion.q:
        pin.forwardKinematics(chain.model, data, q)
        path.append(data.oMi[2].act(FOOT))
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    # The outermost points are known in 150 directions, within 8 degrees of any other.
    slack = 0.02 * np.ptp(reach, axis=0).max()
    assert ((np.array(path) @ directions.T).max(0) < (reach @ directions.T).max(0) + slack).all()
    assert [x["text"] for x in viewer._panel["labels"] if x["layer"] == "trail"] == ["foot"]
    viewer.show(motion.q[0])  # and the path is gone
    assert not any("trail" in path for _, path, _ in viewer._drawing.buffer.commands)
    with pytest.raises(sst_pin.UnknownNameError, match="frame 'hand'"):
        Viewer(chain, frame="hand")


def test_notes_of_forces_are_about_moving_bodies_and_say_when_there_are_no_forces():
    """A ball of 1 kg; what is fixed to the world has a mass too."""
    model = tree(("z", pin.JointModelPZ(), 1.0, 0.1))
    frame(model, "ball", "z", (0, 0, 0))
    model.inertias[0] = pin.Inertia(1e3, np.zeros(3), np.eye(3))
    ball = sst_pin.ClosedChain(model, [], ["z"], contacts=[Contact("ball", radius=0.1)])
    impact = contact_forces(ball, np.full((2, 1, 3), 1e3))
    assert "the longest is 19.6\xa0N or more" in impact.note  # twice the weight
    none = contact_forces(ball, np.zeros((2, 1, 3)))
    assert (none.note, none.shares.any()) == ("No forces on contacts.", False)
    model.gravity.linear = np.zeros(3)
    floating = sst_pin.ClosedChain(model, [], ["z"])
    zeros = np.zeros((2, 1))
    assert reaction_forces(floating, zeros, zeros, zeros, None, None).note == "No forces in joints."


@pytest.mark.parametrize("signs", [(1, 1, 1), (1, -1, 1), (-1, 1, 1), (-1, -1, 1)])
def test_the_camera_sees_an_arrow_in_any_direction(signs):
    robot = robots.delta()
    scene = Scene(robot, None, reactions=True)
    q = scene.start
    effort = np.zeros(scene.layout.contact(0))
    first = scene.layout.reaction(0)
    effort[first : first + 3] = np.array(signs) / np.sqrt(3)
    arrow = next(a for a in scene.arrows if getattr(a, "first", None) == first)
    points = transform(arrow.shape.mesh.vertices, arrow.placement(effort))
    points = transform(points, scene.poses(q)[arrow.shape.mover])
    reach = scene.outermost_points(q[None], effort[None])
    slack = 0.02 * np.ptp(reach, axis=0).max()  # as above
    for direction in (points - reach.mean(axis=0)) / scene.size:
        assert (points @ direction).max() < (reach @ direction).max() + slack
