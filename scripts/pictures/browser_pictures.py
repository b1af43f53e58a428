# SPDX-License-Identifier: BSD-2-Clause
"""Pictures that a browser or MuJoCo takes: the viewer's page on screens, reactions, the scene."""

import io
import tempfile
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from PIL import Image, ImageDraw, ImageFont

from sst_pin import SST, ClosedChain, GravityPD, Trajectory, frame_motion, robots
from sst_pin.sst import PACKAGE_PATH
from sst_pin.sst.paper import PERIOD, example_1
from sst_pin.viewer import Viewer, pictures

ROOT = Path(__file__).resolve().parents[2]


#: Style of a page that shows nothing but the robot.
_ROBOT_ALONE = """\
aside, #views, #labels { display: none !important; }
#view { flex: 1 0 100% !important; } #pane { top: 0 !important; }
"""


def sway(robot: ClosedChain, q: np.ndarray, size: float) -> Trajectory:
    """A motion from a configuration and back, each coordinate a sine of its own phase."""
    n = robot.degrees_of_freedom
    w = np.pi
    h = 1 / 30
    t = np.arange(61) * h
    phase = np.arange(n)
    va = size * np.sin(w * t[:, None] + phase)
    configurations = [q]
    for middle in t[:-1] + h / 2:
        v = robot.joint_rates(configurations[-1], size * np.sin(w * middle + phase))
        configurations.append(robot.assemble(pin.integrate(robot.model, configurations[-1], h * v)))
    return robot.trajectory(t, configurations, va, size * w * np.cos(w * t[:, None] + phase))


def circle(samples: int, axes: bool = False) -> Viewer:
    """The paper's robot on its circle, with its torques."""
    robot = SST()
    viewer = Viewer(robot, axes=axes)
    viewer.play(example_1(robot, np.linspace(0, PERIOD, samples)), title="Example 1: the circle")
    return viewer


def screen(
    viewer: Viewer, width: int, height: int, scheme: str = "light", then: str = "panel.still(0.3)"
) -> Image.Image:
    """The page on a screen, after a line of JavaScript."""
    with tempfile.TemporaryDirectory() as folder, pictures.browser() as chromium:
        file = Path(folder, "page.html")
        file.write_text(viewer.html, encoding="utf-8")
        context = chromium.new_context(
            viewport={"width": width, "height": height},
            color_scheme=scheme,
            reduced_motion="reduce",
            has_touch=width < 1000,
            is_mobile=width < 1000,
        )
        page = context.new_page()
        page.goto(file.as_uri())
        page.evaluate(then)
        page.wait_for_timeout(1000)
        return Image.open(io.BytesIO(page.screenshot()))


def screens_phone() -> Image.Image:
    """The paper's circle on a phone."""
    return screen(circle(121), 390, 844)


def screens_tablet() -> Image.Image:
    """A Gough-Stewart platform on a tablet in dark mode."""
    robot = robots.stewart()
    viewer = Viewer(robot)
    viewer.play(sway(robot, robot.home, 0.07), title="Sway")
    return screen(viewer, 820, 1180, "dark")


def screens_desk() -> Image.Image:
    """The delta of the examples, drawn as a skeleton."""
    robot = ClosedChain.from_urdf(ROOT / "examples" / "delta.urdf")
    viewer = Viewer(robot)
    viewer.play(sway(robot, robot.home, 0.6), title="A delta, bare")
    return screen(viewer, 1440, 900)


def screens_ghost() -> Image.Image:
    """A delta that carries 0.6 kg and does not know it, with the planned motion as a ghost."""
    model = robots.delta()
    robot = robots.delta(platform_mass=0.75)
    t = np.linspace(0, 1, 61)
    turn = 2 * np.pi * t
    way = np.column_stack([0.12 * np.sin(turn), 0.08 * np.cos(turn), 0 * t - 0.25])
    planned = frame_motion(model, t, "platform", way)
    control = GravityPD(model, planned, kp=3.0, kd=0.2)
    viewer = Viewer(robot)
    motion = robot.simulate(control.torque, planned.q[0], planned.va[0], t)
    viewer.play(motion, ghost=planned, title="With a payload")
    return screen(viewer, 1000, 700)


def live_phone() -> Image.Image:
    """The live page of an SST on a phone, moved by hand."""
    moved = "live.robot.move([-0.3, 0.4, 0.2]); live.refresh()"
    return screen(Viewer(SST(), live=True), 390, 844, then=moved)


def reactions() -> Image.Image:
    """The delta at rest, the unique forces in its joints as arrows."""
    viewer = robots.delta().show(reactions=True, open_browser=False)
    return Image.open(io.BytesIO(pictures.png(viewer.html))).reduce(2)


def robots_at_home() -> Image.Image:
    """The robots of the gallery and the SST, which has two cells, at home."""
    names = ["sst", *(name for name in robots.__all__ if name.islower())]
    columns = 5
    width = 300
    height = 280
    edge = 34
    rows = -(-(len(names) + 1) // columns)
    picture = Image.new("RGB", (columns * width, rows * height), "white")
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(24)
    with pictures.browser() as chromium:
        for k, name in enumerate(names):
            cells = 2 if k == 0 else 1
            row, column = divmod(k + (k > 0), columns)
            robot = SST() if name == "sst" else getattr(robots, name)()
            page = chromium.new_page(
                viewport={"width": cells * width, "height": height - edge}, color_scheme="light"
            )
            page.set_content(Viewer(robot).html)
            page.add_style_tag(content=_ROBOT_ALONE)
            page.evaluate("stage.showLayer('floor', false); stage.resize()")
            page.wait_for_timeout(400)
            shot = Image.open(io.BytesIO(page.screenshot()))
            page.close()
            picture.paste(shot, (column * width, row * height + edge))
            middle = column * width + cells * width / 2
            draw.text((middle, row * height + 6), name, "black", font, anchor="ma")
    return picture


def scene() -> Image.Image:
    """The MJCF of the package; without a screen set MUJOCO_GL=egl."""
    model = mujoco.MjModel.from_xml_path(f"{PACKAGE_PATH}/scene.xml")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 1200, 1600) as renderer:
        renderer.update_scene(data, "front")
        return Image.fromarray(renderer.render()).reduce(2)  # softens the edges


PICTURES = {
    **{f.__name__: f for f in (screens_phone, screens_tablet, screens_desk, screens_ghost)},
    **{f.__name__: f for f in (live_phone, reactions, scene)},
    "robots": robots_at_home,
}
