# SPDX-License-Identifier: BSD-2-Clause
"""Who may ask the pages' servers, and where they can listen."""

import http.client
import socket
from urllib.parse import urlsplit

import pytest

from sst_pin.errors import ServerError
from sst_pin.viewer import Viewer
from sst_pin.viewer.server import is_ours, url_of


@pytest.fixture(scope="module")
def served(robot):
    with Viewer(robot) as viewer:
        yield viewer.serve()


def status(served, path="/", **headers):
    """What a request with some headers is answered with."""
    address = urlsplit(served)
    connection = http.client.HTTPConnection(address.hostname, address.port, timeout=10)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in ({"Host": address.netloc} | headers).items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    answer = connection.getresponse().status
    connection.close()
    return answer


def upgrade(served, **headers):
    """What a WebSocket's opening is answered with; 101 is yes."""
    opening = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec_WebSocket_Version": "13",
        "Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    return status(served, "/socket", **opening, **headers)


def test_a_browser_on_this_machine_is_answered(served):
    port = urlsplit(served).port
    for host in (f"127.0.0.1:{port}", f"localhost:{port}", f"[::1]:{port}"):
        assert status(served, Host=host) == 200
        assert upgrade(served, Host=host, Origin=f"http://{host}") == 101
    assert upgrade(served) == 101  # a program that is no browser


def test_a_site_that_calls_itself_this_machine_is_not_answered(served):
    """DNS rebinding: the browser asks 127.0.0.1 under the site's name."""
    host = f"rebound.example:{urlsplit(served).port}"
    assert status(served, Host=host) == 403
    assert upgrade(served, Host=host, Origin=f"http://{host}") == 403


@pytest.mark.parametrize("origin", ["http://foreign.example", "http://127.0.0.1:1", "null"])
def test_a_websocket_of_another_page_is_refused(served, origin):
    assert upgrade(served, Origin=origin) == 403


def test_the_name_that_was_asked_for_is_ours_and_so_is_the_machines():
    name = socket.gethostname()
    assert is_ours("robot.lab", "Robot.lab:8080", None)
    assert is_ours("0.0.0.0", f"{name}:8080", f"http://{name}:8080")
    assert not is_ours("0.0.0.0", "foreign.example:8080", None)
    for nonsense in (None, "", "[", "127.0.0.1.foreign.example"):
        assert not is_ours("127.0.0.1", nonsense, None)


def test_an_address_of_version_six_is_written_in_brackets():
    assert url_of("::1", 80) == "http://[::1]:80/"
    assert url_of("127.0.0.1", 80) == "http://127.0.0.1:80/"


@pytest.mark.parametrize(
    ("host", "port"),
    [("203.0.113.7", 0), ("256.1.1.1", 0), ("", 0), (300 * "x", 0), ("127.0.0.1", 99999)],
)
def test_an_address_that_cannot_be_listened_on_is_told(robot, host, port):
    with pytest.raises(ServerError, match="cannot listen on"):
        Viewer(robot).serve(host, port)
