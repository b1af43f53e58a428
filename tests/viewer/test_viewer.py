# SPDX-License-Identifier: BSD-2-Clause
"""The viewer without a browser: what it takes, writes, serves, to whom, and leaves behind."""

import contextlib
import io
import os
import signal
import socket
import subprocess
import sys
import urllib.request
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image, ImageSequence

from sst_pin import errors
from sst_pin.cli import main
from sst_pin.sst import paper
from sst_pin.viewer import Viewer, pictures
from tests.support.browser import needs_browser


@pytest.fixture(scope="module")
def motion(robot):
    return paper.example_1(robot, np.linspace(0, paper.PERIOD, 11))


def port_of(url):
    return int(url.rsplit(":", 1)[1].strip("/"))


def listens(host, port):
    with socket.socket() as knock:
        knock.settimeout(2)
        return knock.connect_ex((host, port)) == 0


def test_it_listens_on_this_machine_alone_and_only_when_asked(robot):
    with Viewer(robot) as viewer:
        assert "not served" in repr(viewer)
        url = viewer.serve()
        assert url == viewer.serve()
        assert url.startswith("http://127.0.0.1:")
        assert b"<title>sst_pin</title>" in urllib.request.urlopen(url).read()
        listening = Path("/proc/net/tcp")
        if listening.exists():
            rows = [line.split()[1] for line in listening.read_text().splitlines()[1:]]
            bound = dict(reversed(row.split(":")) for row in rows)
            assert bound[f"{port_of(url):04X}"] == "0100007F"
    assert not listens("127.0.0.1", port_of(url))
    viewer = Viewer(robot)
    port = port_of(viewer.serve())
    with pytest.raises(errors.InputError), viewer:
        viewer.show([0, 1, 2])
    assert not listens("127.0.0.1", port)
    viewer.close()  # once more does no harm


@pytest.mark.slow
@pytest.mark.parametrize("options", [(), ("--live",)])
def test_show_serves_until_interrupted_and_leaves_no_orphan(options):
    """`sst-pin show --no-open`: a URL, an answer, Ctrl-C, exit code 0, no process, no port."""
    # What a shell starts in the background ignores Ctrl-C, and so would this.
    code = (
        "import signal, sst_pin.cli; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "raise SystemExit(sst_pin.cli.main())"
    )
    command = [sys.executable, "-c", code, "show", "--no-open", *options]
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, start_new_session=True, **piped) as process:
        try:
            url = next(line for line in process.stdout if "Ctrl-C ends" in line).split()[0]
            assert urllib.request.urlopen(url).status == 200
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=20) == 0
            told = process.stderr.read()  # on a slow machine also that the equations take a while
            assert told in ("", "sst-pin: live page: writing its equations\n")
        finally:
            process.kill()
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)  # it had the session to itself
    assert not listens("127.0.0.1", port_of(url))


def test_robot_show_is_the_short_way(robot, motion, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    with robot.show(motion, speed=0.5) as viewer:
        assert len(opened) == 1
        assert listens("127.0.0.1", port_of(opened[0]))
        assert "motion" in repr(viewer)
    assert "configuration" in repr(robot.show(robot.home, open_browser=False))
    assert len(opened) == 1
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    assert "not served" in repr(robot.show(motion))  # the notebook displays it


def test_a_missing_extra_is_named(tmp_path):
    """The one line that installs it, and exit code 2."""
    code = "import sys; from sst_pin.cli import main; "
    code += "sys.modules |= dict.fromkeys(['meshcat', 'PIL', 'trimesh']); "
    command = [sys.executable, "-c", f"{code}sys.exit(main(['show', '--no-open']))"]
    result = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert result.returncode == 2
    told = f"meshcat, pillow, trimesh are not installed; run: {sys.executable} -m pip install"
    assert told in result.stderr
    assert "[viz]'" in result.stderr


def test_a_missing_browser_is_named(robot, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert main(["show", "--png", "x.png"]) == 2
    assert "no browser found (chromium, " in (err := capsys.readouterr().err)
    assert "apt install chromium" in err
    assert not list(tmp_path.iterdir())


def test_a_browser_without_a_message_is_named_also_on_windows(monkeypatch):
    from playwright import sync_api

    class Playwright:
        chromium = property(lambda self: self)

        def launch(self, **options):
            assert "--no-sandbox" not in options["args"]
            raise sync_api.Error("")

    monkeypatch.delattr(os, "geteuid")  # Windows has none
    monkeypatch.setattr(pictures, "find_browser", lambda: "chromium")
    monkeypatch.setattr(sync_api, "sync_playwright", lambda: contextlib.nullcontext(Playwright()))
    with pytest.raises(errors.BrowserError, match="chromium does not start"), pictures.browser():
        pass


def test_a_gif_without_frames_is_refused():
    with pytest.raises(errors.InputError, match="frames: 0, expected at least 1"):
        pictures.gif("", frames=0)


@pytest.mark.slow
@needs_browser
def test_pictures_are_taken_without_a_person(robot, motion):
    import asyncio

    viewer = Viewer(robot)
    viewer.play(motion)

    async def in_a_notebook():
        return pictures.gif(viewer.html, frames=3, seconds=0.3, size=(480, 240))

    with Image.open(io.BytesIO(asyncio.run(in_a_notebook()))) as gif:
        assert gif.n_frames == 3
        assert gif.size == (480, 240)
        shown = ImageSequence.Iterator(gif)
        frames = [np.asarray(frame.convert("RGB"), dtype=int) for frame in shown]
    assert ((frames[0] < 235).any(axis=-1)).mean() > 0.02
    for one, other in ((0, 1), (1, 2)):
        assert (np.abs(frames[one] - frames[other]).max(axis=-1) > 60).mean() > 0.01


def status(served, path="/", **headers):
    """The answer to a request with some headers."""
    address = urlsplit(served)
    connection = HTTPConnection(address.hostname, address.port, timeout=10)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in ({"Host": address.netloc} | headers).items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    answer = connection.getresponse().status
    connection.close()
    return answer


def upgrade(served, **headers):
    """The answer to the opening of a WebSocket; 101 is yes."""
    opening = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec_WebSocket_Version": "13",
        "Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    return status(served, "/socket", **opening, **headers)


def test_pages_of_this_machine_and_programs_alone_are_answered(robot):
    """Under DNS rebinding a browser asks 127.0.0.1 under the name of a site."""
    viewer = Viewer(robot)
    served = viewer.serve()
    port = urlsplit(served).port
    for host in (f"127.0.0.1:{port}", f"localhost:{port}", f"[::1]:{port}"):
        assert status(served, Host=host) == 200
        assert upgrade(served, Host=host, Origin=f"http://{host}") == 101
    assert upgrade(served) == 101  # a program that is no browser
    host = f"rebound.example:{port}"
    assert status(served, Host=host) == 403
    assert upgrade(served, Host=host, Origin=f"http://{host}") == 403
    for origin in ("http://foreign.example", "http://127.0.0.1:1", "null"):
        assert upgrade(served, Origin=origin) == 403
    viewer.close()


# Tornado leaves a socket that it cannot bind to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_address_that_cannot_be_listened_on_is_told(robot):
    impossible = [("203.0.113.7", 0), ("256.1.1.1", 0), ("", 0), (300 * "x", 0)]
    with socket.socket() as taken, Viewer(robot) as viewer:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        for address in [*impossible, ("127.0.0.1", 99999), taken.getsockname()]:
            with pytest.raises(errors.ServerError, match="cannot listen on"):
                viewer.serve(*address)
