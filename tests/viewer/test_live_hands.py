# SPDX-License-Identifier: BSD-2-Clause
"""The live page in hands: sliders, dragging, letting go, pushing, holding, resetting."""

import numpy as np
import pytest

from sst_pin.viewer import Viewer
from tests.support.browser import DESK, LATER, PHONE, TABLET, opened, with_slow
from tests.support.named_robots import robot_named

pytestmark = pytest.mark.slow

#: Where a body, the last that is met, is seen in the window.
FOUND = """() => {
  const { left, top, width, height } = document.getElementById("pane").getBoundingClientRect();
  let found = [0, 0, 0];
  for (let i = 4; i < 60; i += 2) for (let j = 4; j < 60; j += 2) {
    const x = left + width * i / 64, y = top + height * j / 64, hit = stage.hit(x, y);
    if (hit && Number(hit.mover) > found[2]) found = [x, y, Number(hit.mover)];
  }
  return found;
}"""
#: Counts pushes.
COUNT = """() => {
  const push = live.robot.push;
  window.pushes = 0;
  live.robot.push = (ray) => { pushes += 1; push(ray); };
}"""


def fingers(page, x, y, way, steps=5):
    """A finger, or a mouse, put down, moved and taken away."""
    events = page.context.new_cdp_session(page)
    for k in range(steps + 1):
        point = {"x": x + way[0] * k / steps, "y": y + way[1] * k / steps}
        kind = "touchStart" if k == 0 else "touchMove"
        events.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [point]})
        page.wait_for_timeout(60)
    events.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def mouse(page, x, y, way, steps=5):
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(1, steps + 1):
        page.mouse.move(x + way[0] * k / steps, y + way[1] * k / steps)
        page.wait_for_timeout(60)
    page.mouse.up()


MORE = {
    "sst": [DESK],
    "delta": [PHONE],
    "stewart": [TABLET],
    "five_bar": [TABLET],
    "cassie": [PHONE],
}


@pytest.mark.parametrize(("name", "size"), with_slow(("four_bar", PHONE), **MORE))
def test_the_robot_is_dragged_let_go_pushed_held_and_reset(chromium, tmp_path, name, size):
    chain = robot_named(name)
    viewer = Viewer(chain, live=True)
    with opened(chromium, viewer, tmp_path / "page.html", size) as page:
        state = lambda what: np.array(page.evaluate(f"Array.from(live.robot.{what})"))  # noqa: E731
        start, hand = state("q"), fingers if size[0] < 1000 else mouse
        camera = page.evaluate("viewer.camera.position.toArray()")
        x, y, _ = page.evaluate(FOUND)
        hand(page, x, y, (25, -25))
        dragged = state("q")
        assert np.abs(dragged - start).max() > 1e-3
        assert np.abs(chain.residual(dragged)).max() < 1e-6
        seen_from = page.evaluate("viewer.camera.position.toArray()")
        assert seen_from == pytest.approx(camera)
        page.locator("#again").click()
        assert np.abs(state("q") - start).max() < 1e-12
        slider = page.locator("#sliders input").first
        before = float(slider.input_value())
        move = "(e, v) => { e.value = v; e.dispatchEvent(new Event('input')) }"
        slider.evaluate(move, before + 0.02)
        assert np.abs(state("q") - start).max() > 1e-4
        page.locator("#again").click()
        page.locator("#go").click()
        page.evaluate(LATER, 0.03)
        energy = page.locator("#energy").inner_text()
        assert energy.startswith("energy: kinetic")
        page.locator("#again").click()
        assert not page.evaluate("live.running")
        if page.evaluate("live.robot.holds"):
            page.locator("#control").select_option("hold")
            page.locator("#go").click()
            page.evaluate(COUNT)
            x, y, _ = page.evaluate(FOUND)
            (page.touchscreen.tap if size[0] < 1000 else page.mouse.click)(x, y)
            page.evaluate(LATER, 0.1)
            assert page.evaluate("pushes") == 1
            page.evaluate("live.robot.grip = null")
            away = [np.inf]
            while away[-1] > 1e-3 and len(away) < 4:  # six seconds to come to rest
                page.evaluate("for (let k = 0; k < 120; k++) live.robot.advance(1 / 60)")
                away.append(np.abs(state("q") - start).max())
            assert away[-1] < 1e-3, away
        across = "document.documentElement.scrollWidth <= innerWidth"
        assert page.evaluate(across)


@pytest.mark.slow
def test_a_motion_is_beside_the_live_robot(chromium, tmp_path):
    """The player is as before; Live takes the robot from the motion's first state."""
    chain = robot_named("four_bar")
    motion = chain.simulate([0.0], chain.home, [1.0], np.linspace(0, 0.2, 11))
    viewer = chain.show(motion, live=True, open_browser=False)
    with opened(chromium, viewer, tmp_path / "page.html", (600, 400)) as page:
        assert page.locator("#chart").is_visible()
        assert not page.locator("#live").is_visible()
        page.get_by_role("button", name="Live").click()
        assert page.locator("#live").is_visible()
        assert page.evaluate("live.robot.va") == [1.0]
        assert page.locator("#energy").inner_text().startswith("energy: kinetic 0.00")  # it is held
        assert not page.locator("#clock").is_visible()  # the clock of the player
        page.get_by_role("button", name="Motion").click()
        assert page.locator("#chart").is_visible()
        assert page.locator("#clock").is_visible()
        assert not page.evaluate("live.running")


def test_a_long_name_breaks_behind_an_underscore(chromium, tmp_path):
    """Beside its slider, where "shoulder_1" would break within a word."""
    viewer = robot_named("five_bar").show(live=True, open_browser=False)
    with opened(chromium, viewer, tmp_path / "page.html", (600, 400)) as page:
        name = page.locator("#sliders span").first
        assert name.inner_html() == "shoulder_<wbr>1"
        assert name.inner_text() == "shoulder_1"


def test_a_drag_in_a_simulation_moves_no_pose_by_hand(chromium, tmp_path):
    """In a frame without simulated time, as the first one, the robot stays where it is."""
    viewer = robot_named("four_bar").show(live=True, open_browser=False)
    with opened(chromium, viewer, tmp_path / "page.html", (600, 400)) as page:
        before, after = page.evaluate("""() => {
          const { robot } = live, before = Array.from(robot.q);
          live.run(true);
          robot.gripped({ body: 2, at: [0, 0, 0] });
          robot.grip.target = robot.point(robot.grip).map((x) => x + 0.1);
          live.frame(performance.now());
          return [before, Array.from(robot.q)];
        }""")
        assert after == before
