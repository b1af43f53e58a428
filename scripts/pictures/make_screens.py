# SPDX-License-Identifier: BSD-2-Clause
"""Draw docs/screens_*.png: the viewer's page on screens, with a ghost; live_phone.png."""

import io
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from PIL import Image

from sst_pin import SST, ClosedChain, GravityPD, Trajectory, frame_motion, robots
from sst_pin.files import write_files
from sst_pin.sst.paper import PERIOD, example_1
from sst_pin.viewer import Viewer, pictures

ROOT = Path(__file__).resolve().parents[2]


class Screen(NamedTuple):
    """One screenshot."""

    width: int
    height: int
    scheme: str
    viewer: Viewer


def sway(robot: ClosedChain, q: np.ndarray, size: float) -> Trajectory:
    """A motion from a configuration and back, each coordinate a sine of its own phase."""
    n, w, h = robot.degrees_of_freedom, np.pi, 1 / 30
    t, phase = np.arange(61) * h, np.arange(n)
    va = size * np.sin(w * t[:, None] + phase)
    configurations = [q]
    for middle in t[:-1] + h / 2:
        v = robot.joint_rates(configurations[-1], size * np.sin(w * middle + phase))
        configurations.append(robot.assemble(pin.integrate(robot.model, configurations[-1], h * v)))
    return robot.trajectory(t, configurations, va, size * w * np.cos(w * t[:, None] + phase))


def shown(robot: ClosedChain, motion: Trajectory, title: str) -> Viewer:
    viewer = Viewer(robot)
    viewer.play(motion, title=title)
    return viewer


def loaded() -> Viewer:
    """A delta that carries 0.6 kg and does not know it, with the planned motion as a ghost."""
    model, robot = robots.delta(), robots.delta(platform_mass=0.75)
    t = np.linspace(0, 1, 61)
    turn = 2 * np.pi * t
    way = np.column_stack([0.12 * np.sin(turn), 0.08 * np.cos(turn), 0 * t - 0.25])
    planned = frame_motion(model, t, "platform", way)
    control = GravityPD(model, planned, kp=3.0, kd=0.2)
    motion = robot.simulate(control.torque, planned.q[0], planned.va[0], t)
    viewer = Viewer(robot)
    viewer.play(motion, ghost=planned, title="With a payload")
    return viewer


def screens() -> dict[str, Screen]:
    sst, stewart = SST(), robots.stewart()
    delta = ClosedChain.from_urdf(ROOT / "examples" / "delta.urdf")
    start = delta.assemble(pin.neutral(delta.model), fixed=())
    circle = example_1(sst, np.linspace(0, PERIOD, 121))
    return {
        "phone": Screen(390, 844, "light", shown(sst, circle, "Example 1: the circle")),
        "tablet": Screen(
            820, 1180, "dark", shown(stewart, sway(stewart, stewart.home, 0.15), "Sway")
        ),
        "live": Screen(390, 844, "light", Viewer(sst, live=True)),
        "ghost": Screen(1000, 700, "light", loaded()),
        "desk": Screen(1440, 900, "light", shown(delta, sway(delta, start, 0.6), "A delta, bare")),
    }


def small(png: bytes) -> Any:
    """A writer of a PNG of 256 colours."""
    image = Image.open(io.BytesIO(png)).convert("RGB")
    image = image.quantize(256, kmeans=1, dither=Image.Dither.NONE)
    return lambda file: image.save(file, "png", optimize=True)


def main() -> None:
    writers = {}
    with tempfile.TemporaryDirectory() as folder, pictures.browser() as chromium:
        for name, screen in screens().items():
            file = Path(folder, "page.html")
            file.write_text(screen.viewer.html, encoding="utf-8")
            touch = screen.width < 1000
            context = chromium.new_context(
                viewport={"width": screen.width, "height": screen.height},
                color_scheme=screen.scheme,
                reduced_motion="reduce",
                has_touch=touch,
                is_mobile=touch,
            )
            page = context.new_page()
            page.goto(file.as_uri())
            if name == "live":
                page.evaluate("live.robot.move([-0.3, 0.4, 0.2]); live.refresh()")
                page.wait_for_timeout(1000)
            else:
                page.evaluate("panel.still(0.3)")
            file_name = "live_phone.png" if name == "live" else f"screens_{name}.png"
            writers[ROOT / "docs" / file_name] = small(page.screenshot())
            context.close()
    write_files(writers, force=True)


if __name__ == "__main__":
    main()
