# SPDX-License-Identifier: BSD-2-Clause
"""Pages in a real Chromium, which is the fixture `chromium`."""

import io
from contextlib import contextmanager

import numpy as np
import pytest
from PIL import Image

from sst_pin.errors import BrowserError
from sst_pin.viewer import pictures

#: What the lack of a browser is called, "" where there is one.
MISSING = ""
try:
    pictures.find_browser()
except BrowserError as error:
    MISSING = str(error)

needs_browser = pytest.mark.skipif(bool(MISSING), reason=MISSING)
#: Windows, width and height in [px].
PHONE, TABLET, DESK, LYING = (390, 844), (820, 1180), (1440, 900), (844, 390)

#: Once so much time is simulated on a live page, or the simulation has ended.
LATER = """t => new Promise((done) => {
  const look = () => live.robot.time >= t || !live.running
    ? done(live.robot.time) : requestAnimationFrame(look);
  look();
})"""
#: Least and largest coordinate of all vertices that are seen, in the picture's own -1 to 1.
EXTENT = """([view, share]) => {
  if (view) stage.look(view);
  if (share !== undefined) panel.seek(share * Number(document.getElementById("time").max));
  const low = [9, 9], high = [-9, -9];
  viewer.scene.updateMatrixWorld(true);
  viewer.camera.updateMatrixWorld(true);
  viewer.scene_tree.find(["meshcat", "robot"]).object.traverse((object) => {
    for (let o = object; o; o = o.parent) if (!o.visible) return;
    if (!object.isMesh) return;
    const vertices = object.geometry.attributes.position;
    for (let i = 0; i < vertices.count; i++) {
      const p = viewer.camera.position.clone().fromBufferAttribute(vertices, i);
      p.applyMatrix4(object.matrixWorld).project(viewer.camera);
      [p.x, p.y].forEach((x, k) => {
        low[k] = Math.min(low[k], x);
        high[k] = Math.max(high[k], x);
      });
    }
  });
  return [low, high];
}"""


#: Without a graphics card a frame takes most of a second: draw a sixteenth of the points.
_COARSE = {"device_scale_factor": 1 / 4}


class Visit:
    """A page in Chromium, what went wrong on it and what it asked for."""

    def __init__(self, page):
        self.page, self.errors, self.requests = page, [], []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("websocket", lambda socket: self.requests.append(socket.url))
        page.on(
            "console",
            lambda message: message.type == "error" and self.errors.append(message.text),
        )

    def requests_elsewhere(self, *addresses):
        """What it asked for that does not start with one of its own addresses."""
        inside = (*addresses, "data:", "blob:", "about:")
        return [url for url in self.requests if not url.startswith(inside)]


@contextmanager
def visit(chromium, url, width=1280, height=720):
    """A page of its own, loaded."""
    page = chromium.new_page(viewport={"width": width, "height": height}, **_COARSE)
    visit = Visit(page)
    page.goto(url)
    yield visit
    page.close()


@contextmanager
def opened(chromium, viewer, path, size, **options):
    """The page as a file, standing still, in a window; a narrow one is for fingers."""
    touch = size[0] < 1000
    context = chromium.new_context(
        viewport=dict(zip(("width", "height"), size, strict=True)),
        has_touch=touch,
        is_mobile=touch,
        **{"reduced_motion": "reduce"} | _COARSE | options,
    )
    path.write_text(viewer.html, encoding="utf-8")
    page = context.new_page()
    result = Visit(page)
    page.goto(path.as_uri())
    yield page
    assert result.errors == []
    assert result.requests_elsewhere(path.as_uri()) == []
    context.close()


def pixels(png):
    """Colours of a picture, shape (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int)


def with_slow(first, **others):
    """Cases of a test: one for the quick run, then names with values that take longer."""
    slow = [(name, value) for name, values in others.items() for value in values]
    return [first, *(pytest.param(*case, marks=pytest.mark.slow) for case in slow)]
