# SPDX-License-Identifier: BSD-2-Clause
"""One page and what is sent after it, on a port of this machine: a thread, no process."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

import tornado.web
import tornado.websocket
from tornado.httpserver import HTTPServer

from .hosts import is_ours, listen, url_of

Message = bytes | str


class Server:
    """A server for the page; it runs until it is closed.

    Args:
        page: Gives the page.
        state: Gives what a new page has to be told.
        host: Address to listen on.
        port: 0 for any that is free.

    Attributes:
        url: Address of the page.
        visited: Set once a page has come to listen.
    """

    def __init__(
        self,
        page: Callable[[], str],
        state: Callable[[], Iterable[Message]],
        host: str,
        port: int,
    ) -> None:
        sockets = listen(host, port)
        self.url = url_of(host, sockets[0].getsockname()[1])
        self.visited = threading.Event()
        self._pages: set[tornado.websocket.WebSocketHandler] = set()
        server = self

        class Ours(tornado.web.RequestHandler):
            def prepare(self) -> None:
                headers = self.request.headers
                if not is_ours(host, headers.get("Host"), headers.get("Origin")):
                    raise tornado.web.HTTPError(403)

        class Page(Ours):
            def get(self) -> None:
                self.set_header("Cache-Control", "no-store")
                self.write(page())

        class Socket(Ours, tornado.websocket.WebSocketHandler):
            def open(self, *_: str, **__: str) -> None:
                server._pages.add(self)
                for message in state():
                    _write(self, message)
                server.visited.set()

            def on_close(self) -> None:
                server._pages.discard(self)

        self._loop = asyncio.new_event_loop()
        self._done = asyncio.Event()

        async def run() -> None:
            http = HTTPServer(tornado.web.Application([("/", Page), ("/socket", Socket)]))
            http.add_sockets(sockets)
            await self._done.wait()
            http.stop()
            for listener in tuple(self._pages):
                listener.close()
            await http.close_all_connections()

        self._thread = threading.Thread(
            target=lambda: self._loop.run_until_complete(run()), name=self.url, daemon=True
        )
        self._thread.start()

    def send(self, message: Message) -> None:
        """Tell every page that listens."""

        def tell() -> None:
            for page in tuple(self._pages):
                _write(page, message)

        self._loop.call_soon_threadsafe(tell)

    def close(self) -> None:
        """Stop listening and wait until it has stopped."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._done.set)
            self._thread.join()
            self._loop.close()


def _write(page: Any, message: Message) -> None:
    with suppress(tornado.websocket.WebSocketClosedError):  # it has gone; `on_close` follows
        page.write_message(message, binary=isinstance(message, bytes))
