# SPDX-License-Identifier: BSD-2-Clause
"""A real Firefox for the tests of pages, by its own protocol, WebDriver BiDi."""

import base64
import itertools
import json
import os
import re
import shutil
import subprocess
import tempfile
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

NAMES = ("firefox-esr", "firefox")
#: Firefox without a window has no WebGL, so it gets a screen in memory.
MISSING = [
    what
    for what, found in {
        "Firefox": any(map(shutil.which, NAMES)),
        "Xvfb": shutil.which("Xvfb"),
    }.items()
    if not found
]

needs_firefox = pytest.mark.skipif(
    bool(MISSING), reason=f"no {', no '.join(MISSING)}; run: apt install firefox-esr xvfb"
)

_SETTINGS = """\
user_pref("gfx.webrender.software", true);
user_pref("webgl.force-enabled", true);
user_pref("ui.prefersReducedMotion", 1);
"""


class Firefox:
    """One page of a Firefox."""

    def __init__(self, socket):
        self._socket, self._numbers = socket, itertools.count()
        self._call("session.new", capabilities={})
        tree = self._call("browsingContext.getTree")
        self._page = {"context": tree["contexts"][0]["context"]}

    def visit(self, url, width, height):
        """Load a page in a window of some size."""
        viewport = {"width": width, "height": height}
        self._call("browsingContext.setViewport", **self._page, viewport=viewport)
        self._call("browsingContext.navigate", **self._page, url=url, wait="complete")

    def evaluate(self, script):
        """What an expression is, or promises, as `JSON.stringify` has it."""
        answer = self._call(
            "script.evaluate",
            expression=f"Promise.resolve({script}).then(JSON.stringify)",
            target=self._page,
            awaitPromise=True,
        )
        assert answer["type"] == "success", answer
        return json.loads(answer["result"].get("value", "null"))

    def drag(self, x, y, way):
        """Press the mouse, move it to the right and release it."""
        steps = [{"type": "pointerMove", "x": round(x), "y": round(y)}]
        steps.append({"type": "pointerDown", "button": 0})
        for share in (0.5, 1.0):
            steps.append({"type": "pointerMove", "x": round(x + share * way), "y": round(y)})
            steps.append({"type": "pause", "duration": 500})
        steps.append({"type": "pointerUp", "button": 0})
        actions = [{"type": "pointer", "id": "mouse", "actions": steps}]
        self._call("input.performActions", **self._page, actions=actions)

    def screenshot(self):
        """The picture, a PNG."""
        return base64.b64decode(
            self._call("browsingContext.captureScreenshot", **self._page)["data"]
        )

    def _call(self, method, **parameters):
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=120))
            if answer.get("id") == number:
                assert answer["type"] == "success", answer
                return answer["result"]


@contextmanager
def firefox():
    """Started, with an empty profile; ended afterwards."""
    from websockets.sync.client import connect

    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        Path(folder, "user.js").write_text(_SETTINGS)
        reading, writing = os.pipe()
        screen = [shutil.which("Xvfb"), "-screen", "0", "1440x900x24", "-displayfd", str(writing)]
        _started(stack, screen, pass_fds=(writing,), stderr=subprocess.DEVNULL)
        os.close(writing)
        with os.fdopen(reading) as pipe:
            display = f":{pipe.readline().strip()}"
        program = next(path for path in map(shutil.which, NAMES) if path)
        browser = _started(
            stack,
            [program, "--remote-debugging-port", "0", "--no-remote", "--profile", folder],
            env=os.environ | {"DISPLAY": display, "HOME": folder, "LIBGL_ALWAYS_SOFTWARE": "1"},
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
        )
        lines = iter(browser.stderr.readline, "")
        listening = (re.search(r"BiDi listening on (ws://\S+)", line) for line in lines)
        address = next(found[1] for found in listening if found)
        socket = stack.enter_context(connect(f"{address}/session", max_size=None))
        yield Firefox(socket)


def _started(stack, command, **options):
    """A process that ends with the stack."""
    process = stack.enter_context(subprocess.Popen(command, **options))
    stack.callback(process.terminate)
    return process
