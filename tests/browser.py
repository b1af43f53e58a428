# SPDX-License-Identifier: BSD-2-Clause
"""A real Chromium for the tests of pages."""

from contextlib import contextmanager

import pytest

from sst_pin.errors import BrowserError
from sst_pin.viewer import pictures

try:
    _MISSING = not pictures.find_browser()
except BrowserError as error:
    _MISSING = str(error)

needs_browser = pytest.mark.skipif(bool(_MISSING), reason=str(_MISSING))


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


#: Without a graphics card a frame takes most of a second. Tests that do not look at its points
#: draw a sixteenth of them.
COARSE = "viewer.renderer.setPixelRatio(1 / 4)"


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

    def requests_elsewhere(self, *own):
        """What it asked for that does not start with one of its own addresses."""
        inside = (*own, "data:", "blob:", "about:")
        return [url for url in self.requests if not url.startswith(inside)]


@contextmanager
def visit(chromium, url, width=1280, height=720):
    """A page of its own, loaded."""
    page = chromium.new_page(viewport={"width": width, "height": height})
    visit = Visit(page)
    page.goto(url)
    yield visit
    page.close()


@pytest.fixture(scope="module")
def chromium():
    """Started once for a module."""
    with pictures.browser() as browser:
        yield browser
