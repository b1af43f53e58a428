# SPDX-License-Identifier: BSD-2-Clause
"""The page in a real browser: what it shows is what Pinocchio computes."""

import numpy as np
import pinocchio as pin
import pytest

from sst_pin.sst import paper
from sst_pin.viewer import Viewer
from tests.support.browser import pixels, visit

#: From three.js, where y is up, to the base, where z is.
UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])

#: Nodes of the SST's extras: e_k of the joints in their order, {0k}..{3k} leg after leg, arrows.
AXES = [f"robot/{j if j % 3 else 0}/axes/e_{j // 3 + 3 * (j % 3) + 1}_{j}" for j in range(9)]
PLACES = [(3 * k + i if i else 0, f"{{{i}{k + 1}}}") for k in range(3) for i in range(4)]
FRAMES = [f"robot/{joint}/frames/{frame}_{a}" for joint, frame in PLACES for a in "xyz"]
TORQUES = [f"robot/0/torques/{k}_gamma_{k}" for k in (1, 2, 3)]

POSES = """() => {
  const found = {};
  viewer.scene.updateMatrixWorld(true);
  viewer.scene.traverse((object) => {
    let path = [];
    for (let o = object; o !== viewer.scene; o = o.parent) path.unshift(o.name);
    let visible = true;
    for (let o = object; o; o = o.parent) visible = visible && o.visible;
    const mesh = object.children.find((child) => child.isMesh);
    if (path[0] === "meshcat")
      found[path.slice(1).join("/")] = { matrix: object.matrixWorld.toArray(), visible,
        mesh: !!mesh, drawn: mesh?.geometry.drawRange.count, indices: mesh?.geometry.index?.count };
  });
  return found;
}"""


@pytest.fixture(scope="module")
def motion(robot):
    return paper.example_1(robot, np.linspace(0, paper.PERIOD, 61))


@pytest.fixture(scope="module")
def shown(chromium, robot, motion, tmp_path_factory):
    """Example 1 as a file, opened."""
    viewer = Viewer(robot, axes=True)
    viewer.play(motion, speed=0.25, title="Example 1")
    path = tmp_path_factory.mktemp("page") / "motion.html"
    viewer.save(path)
    with visit(chromium, path.as_uri()) as page:
        yield page


@pytest.fixture
def page(shown):
    """Example 1 standing at its beginning."""
    shown.page.evaluate("panel.still(0)")
    return shown.page


def poses(page):
    """Homogeneous matrices in base axes, by node."""
    result = page.evaluate(POSES)
    return {n: UP @ np.reshape(x["matrix"], (4, 4)).T for n, x in result.items()}, result


def bodies(robot, q):
    """Homogeneous matrices of the visual bodies by Pinocchio, by node."""
    visual = robot.visual_model
    data, placed = robot.model.createData(), visual.createData()
    pin.forwardKinematics(robot.model, data, q)
    pin.updateGeometryPlacements(robot.model, data, visual, placed)
    return {
        f"robot/{body.parentJoint}/bodies/{body.name}": where.homogeneous
        for body, where in zip(visual.geometryObjects, placed.oMg, strict=True)
    }


def test_the_page_asks_for_nothing_and_nothing_fails(shown, page):
    page.evaluate("panel.play(true)")
    page.wait_for_timeout(300)
    assert shown.requests_elsewhere() == [shown.page.url]
    assert shown.errors == []


@pytest.mark.parametrize("sample", [13, 60])
def test_bodies_are_where_pinocchio_has_them_and_so_are_extras(page, robot, motion, sample):
    """To 1e-6 (single precision): world poses, positions and rotations.

    e_k lie along the noc's joint axes, {E} is turned as the star, arrows are as large as torques.
    """
    page.evaluate("t => panel.seek(t)", motion.t[sample])
    drawn, result = poses(page)
    q, tau = motion.q[sample], motion.tau[sample]
    for node, wanted in bodies(robot, q).items():
        assert np.abs(drawn[node] - wanted).max() < 1e-6, node
    lines = ["robot/0/trail/path", "robot/0/trail/passed"]
    for node in (*bodies(robot, q), *FRAMES, *AXES, *TORQUES, *lines):
        assert result[node]["mesh"], node
    assert result[AXES[0]]["visible"]
    assert not result[FRAMES[0]]["visible"]
    E = drawn["robot/3/frames/{E}_x"][:3, :3]
    assert np.abs(E - robot.platform_orientation(q)).max() < 1e-6
    data = robot.model.createData()
    pin.computeJointJacobians(robot.model, data, q)
    for joint, node in enumerate(AXES):
        axis = drawn[node][:3, 2]
        assert np.abs(axis - data.J[3:, joint]).max() < 1e-6
    sizes = []
    for k in range(3):
        arrow = drawn[TORQUES[k]][:3, :3]
        sizes.append(np.linalg.norm(arrow[:, 0]))
        if abs(tau[k]) > 0.1:  # mirrored where the torque is negative
            assert np.sign(np.linalg.det(arrow)) == np.sign(tau[k])
    shares = np.abs(tau) / np.abs(motion.tau).max()
    assert sizes == pytest.approx(0.45 * 0.4 * np.sqrt(shares), abs=2e-3)
    ends = 2 * 8 * 3  # of the trail, an eight-sided tube
    passed = result["robot/0/trail/passed"]
    assert passed["drawn"] == sample / 60 * (passed["indices"] - ends)


def test_the_canvas_shows_the_robot_and_it_moves(page):
    pictures = []
    for share in (0.1, 0.6):
        page.evaluate("share => panel.still(share)", share)
        page.evaluate("viewer.renderer.setPixelRatio(1); viewer.render()")
        pictures.append(pixels(page.locator("#pane").screenshot()))
    first, second = pictures
    ink = (first < 235).any(axis=-1)
    assert 0.03 < ink.mean() < 0.6
    red, green, blue = np.moveaxis(first, -1, 0)
    for leg in (blue - red > 60, red - blue > 60, green - red > 60):
        assert leg.mean() > 0.002
    assert (np.abs(first - second).max(axis=-1) > 60).mean() > 0.02


@pytest.mark.parametrize("share", [0.31, 1.0])
def test_the_cursor_stands_at_the_time_and_on_the_curves(page, motion, share):
    """Read off the labels of the axes as a person would: time, torques, and the clock."""
    page.evaluate("share => panel.still(share)", share)
    t = motion.t[0] + share * (motion.t[-1] - motion.t[0])
    chart = page.evaluate("""() => {
      const number = (text) => Number(text.textContent.replace("\\u2212", "-"));
      const all = (tag) => [...document.querySelectorAll("#chart " + tag)];
      const texts = all("text").filter((x) => isFinite(number(x)));
      const read = (anchor, at) => texts.filter((x) => x.getAttribute("text-anchor") === anchor)
        .map((x) => [Number(x.getAttribute(at)), number(x)]);
      const line = document.querySelector("#chart .cursor");
      return { x: read("middle", "x"), y: read("end", "y"), cursor: Number(line.getAttribute("x1")),
        dots: all("circle").map((c) => Number(c.getAttribute("cy"))) };
    }""")
    time_at = np.polynomial.Polynomial.fit(*np.transpose(chart["x"]), 1)
    assert time_at(chart["cursor"]) == pytest.approx(t, abs=1e-9)
    labels, values = np.transpose(chart["y"])
    torque_at = np.polynomial.Polynomial.fit(labels - 4, values, 1)  # text stands 4 px lower
    wanted = [np.interp(t, motion.t, motion.tau[:, k]) for k in range(3)]
    assert torque_at(np.array(chart["dots"])) == pytest.approx(wanted, abs=1e-6)
    assert page.locator("#clock").inner_text() == f"t = {t:.3f} s"
    shown = [float(x.replace("\u2212", "-")) for x in page.locator(".value").all_inner_texts()]
    assert shown == pytest.approx(wanted, abs=0.0051)


@pytest.mark.slow
def test_a_person_plays_steps_drags_and_hides(page, motion):
    page.locator("#title").click()
    page.keyboard.press("Space")
    assert page.evaluate("panel.playing")
    assert page.locator("#play").inner_text() == "Pause"
    page.keyboard.press("Space")
    assert not page.evaluate("panel.playing")
    page.evaluate("panel.still(0.5)")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("panel.time") == pytest.approx(0.51 * motion.t[-1])
    page.locator("#time").fill(str(motion.t[-1] / 4))
    assert page.evaluate("panel.time") == pytest.approx(motion.t[-1] / 4, rel=1e-6)
    box = page.locator("#chart").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.up()
    assert 0.4 < page.evaluate("panel.time") / motion.t[-1] < 0.6
    page.locator("[data-layer=torques]").uncheck()
    assert not poses(page)[1][TORQUES[0]]["visible"]
    page.locator("[data-layer=torques]").check()
    assert poses(page)[1][TORQUES[0]]["visible"]
    assert not page.locator(".dg.main").is_visible()  # Meshcat's own controls
    # Digits and single letters alone are subscripts.
    labels = page.evaluate("['gamma_12', 'e_x', 'left_knee', 'rod_1a'].map(subscript)")
    assert labels == ["gamma<sub>12</sub>", "e<sub>x</sub>", "left_knee", "rod_1a"]
