# SPDX-License-Identifier: BSD-2-Clause
"""urdf-loader of three.js, in a headless browser; the page is web/index.html."""

import json
import shutil
import sys
from importlib import util
from pathlib import Path

import numpy as np

from . import Array, Tool

WEB = Path(__file__).with_name("web")
#: Requests to it never leave the process: they are answered from the disk.
_SITE = "http://sst.invalid"


class ThreeUrdfLoader(Tool):
    name = "three.js urdf-loader"

    def __init__(self, folder: Path) -> None:
        from playwright.sync_api import Route, sync_playwright

        def answer(route: Route) -> None:
            path = route.request.url.removeprefix(_SITE)
            inside = path.removeprefix("/urdf/")
            file = folder / inside if inside != path else WEB / path.lstrip("/")
            route.fulfill(path=file) if file.is_file() else route.fulfill(status=404)

        self._driver = sync_playwright().start()
        browser = self._driver.chromium.launch(
            executable_path=_chromium(), args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        self._page = page = browser.new_page()
        page.on("console", lambda message: sys.stderr.write(f"{message.text}\n"))
        page.on("pageerror", lambda error: sys.stderr.write(f"{error}\n"))
        page.route("**/*", answer)
        page.goto(f"{_SITE}/index.html")
        page.wait_for_function("window.ready")
        self.joints = page.evaluate("joints")
        self.visuals = page.evaluate("visuals")

    def close(self) -> None:
        self._page.context.browser.close()
        self._driver.stop()

    @classmethod
    def missing(cls) -> str:
        if not util.find_spec("playwright"):
            return "playwright is not installed"
        if not _chromium():
            return "no Chromium"
        if not (WEB / "node_modules").is_dir():
            return f"no npm packages; run npm install in {WEB.name}/"
        return ""

    @classmethod
    def version(cls) -> str:
        package = WEB / "node_modules" / "urdf-loader" / "package.json"
        return json.loads(package.read_text(encoding="utf-8"))["version"]

    def frame_poses(self, q: Array) -> dict[str, Array]:
        angles = dict(zip(self.joints, q.tolist(), strict=True))
        poses = self._page.evaluate("framePoses", angles)
        return {name: np.reshape(elements, (4, 4)).T for name, elements in poses.items()}


def _chromium() -> str | None:
    return shutil.which("chromium") or shutil.which("google-chrome")
