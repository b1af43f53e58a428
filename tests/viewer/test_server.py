# SPDX-License-Identifier: BSD-2-Clause
"""The server of a page: pages that lag, stay silent, talk or go do no harm."""

import asyncio
import logging
import socket
import time
from contextlib import ExitStack
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest
from tornado.websocket import websocket_connect

from sst_pin.viewer import server as module
from sst_pin.viewer.server import Server

STATE = [b"scene", "panel"]


@pytest.fixture
def server():
    server = Server(lambda: "page", lambda: STATE, "127.0.0.1", 0)
    yield server
    server.close()


def address(server):
    return server.url.replace("http", "ws") + "socket"


def silent_reader(server):
    """A page that connects and never reads."""
    parts = urlsplit(server.url)
    page = socket.create_connection((parts.hostname, parts.port))
    page.sendall(
        b"GET /socket HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
        b"Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        b"Sec-WebSocket-Version: 13\r\n\r\n"
    )
    return page


def test_frames_for_a_page_that_lags_are_dropped_and_it_gets_the_state_later(server, monkeypatch):
    """Of all that is sent to a page that does not read, less than 1.5 MB wait for it."""
    monkeypatch.setattr(module, "_MOST_UNREAD", 1_000_000)
    with silent_reader(server) as page:
        assert server.visited.wait(10)
        (reader,) = server._pages.values()
        frame, sent, stuck = bytes(400_000), 0, 0
        while stuck < 50:  # until the buffers of the system are full too
            server.send(frame)
            sent += len(frame)
            time.sleep(0.002)
            stuck = stuck + 1 if reader._has_dropped else 0
            assert sent < 400_000_000
            assert reader._unread < 1_500_000
        server.send(b"last")
        page.settimeout(10)
        received, total = b"", 0
        while reader._has_dropped or reader._unread or not received.endswith(b"panel"):
            part = page.recv(1 << 16)
            received, total = received[-100:] + part, total + len(part)
        assert b"scene" in received
        assert b"last" not in received  # the state contains it
        assert total < sent


def test_unread_texts_are_counted_in_bytes():
    async def unread():
        future = asyncio.get_running_loop().create_future()
        page = SimpleNamespace(write_message=lambda *_, **__: future)
        sender = module.PageSender(page, lambda: STATE)
        sender.send("µm")
        return sender._unread

    assert asyncio.run(unread()) == 3


def test_a_message_after_the_end_is_for_no_page(server):
    """Another thread may close the server while a motion plays."""
    server.close()
    server.send(b"frame")


def test_pages_that_close_or_talk_leave_no_traceback(server, caplog):
    caplog.set_level(logging.WARNING)

    async def visit():
        pages = [await websocket_connect(address(server)) for _ in range(10)]
        for page in pages:
            assert await page.read_message() == b"scene"
            await page.write_message("hello")
        for page in pages:
            page.close()
        for _ in range(20):
            server.send(bytes(1000))
            await asyncio.sleep(0.01)
        for page in pages:  # until the server has closed the connection too
            while await page.read_message() is not None:
                pass

    asyncio.run(visit())
    server.close()
    assert not caplog.records


def test_pages_that_vanish_leave_no_traceback(server, caplog):
    with ExitStack() as pages:
        for _ in range(10):
            pages.enter_context(silent_reader(server))
        assert server.visited.wait(10)
        for _ in range(50):
            server.send(bytes(100_000))
    server.send(b"after they have gone")
    server.close()
    assert not caplog.records


def test_clients_that_say_nothing_do_not_delay_the_end(server):
    parts = urlsplit(server.url)
    with ExitStack() as clients:
        for k in range(60):
            if k % 2:
                clients.enter_context(socket.create_connection((parts.hostname, parts.port)))
            else:
                clients.enter_context(silent_reader(server))
        deadline = time.monotonic() + 10
        while len(server._pages) < 30:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        began = time.monotonic()
        server.close()
        assert time.monotonic() - began < 5
