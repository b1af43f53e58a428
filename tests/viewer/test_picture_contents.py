# SPDX-License-Identifier: BSD-2-Clause
"""What a picture must show: the foot of a leg, the whole path, words as they are."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from browser import chromium, needs_browser, visit  # noqa: F401
from sst_pin.viewer import Viewer
from sst_pin.viewer.robot_scene import Scene

FOOT = np.array((0.3, 0.0, -0.4))


def leg():
    """A four-bar whose coupler ends in a foot, a link behind a fixed joint, far from all else."""
    chain = sst_pin.robots.four_bar()
    model = chain.model.copy()
    model.addFrame(pin.Frame("foot", 2, pin.SE3(np.eye(3), FOOT), pin.FrameType.BODY))
    twin = sst_pin.ClosedChain(model, chain.closures, chain.motor_names)
    q, h = [chain.home], 0.05
    for _ in range(10):
        q.append(twin.assemble(q[-1] + h * twin.joint_rates(q[-1], [1.0])))
    ones = np.ones((11, 1))
    return twin, twin.trajectory(h * np.arange(11), q, ones, 0 * ones)


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
    with pytest.raises(sst_pin.UnknownNameError, match="frame 'hand'"):
        Viewer(chain, frame="hand")


@needs_browser
def test_digits_and_single_letters_alone_are_subscripts(chromium, tmp_path):  # noqa: F811
    """gamma_1 and e_x have an index; left_knee and rod_1a are names."""
    path = tmp_path / "page.html"
    Viewer(sst_pin.robots.four_bar()).save(path)
    with visit(chromium, path.as_uri()) as seen:
        told = seen.page.evaluate("['gamma_12', 'e_x', 'left_knee', 'rod_1a'].map(subscript)")
    assert told == ["gamma<sub>12</sub>", "e<sub>x</sub>", "left_knee", "rod_1a"]


@pytest.mark.slow
@needs_browser
def test_a_low_chart_has_two_numbers_on_its_axis(chromium, tmp_path, robot):  # noqa: F811
    t, path = np.linspace(0, 0.5, 40), tmp_path / "page.html"
    viewer = Viewer(robot)
    viewer.play(robot.trajectory(t, *robot.joint_motion(*sst_pin.paper_circle(t))))
    viewer.save(path)
    with visit(chromium, path.as_uri(), width=390, height=844) as seen:
        numbers = "#chart text[text-anchor=end]"
        assert seen.page.locator(numbers).count() >= 2
