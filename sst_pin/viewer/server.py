# SPDX-License-Identifier: BSD-2-Clause
"""A server for one page and its updates, on a port of this machine, in a thread.

A page of another site can make a browser ask 127.0.0.1 under that site's name (DNS rebinding), and
open WebSockets to any address. Requests must therefore name this machine, and come from our page.
"""

import asyncio
import socket
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

import tornado.web
import tornado.websocket
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets

from ..errors import ServerError

Message = bytes | str


class Server:
    """Serves the result of `page` until `close`; each new page is sent the messages of `state`."""

    def __init__(
        self, page: Callable[[], str], state: Callable[[], Iterable[Message]], host: str, port: int
    ) -> None:
        sockets = listen(host, port)
        self.url = url_of(host, sockets[0].getsockname()[1])
        self.visited = threading.Event()  #: Set when a page has connected.
        self._pages: set[tornado.websocket.WebSocketHandler] = set()
        self._loop = asyncio.new_event_loop()
        self._done = asyncio.Event()

        async def run() -> None:
            http = HTTPServer(self._application(page, state, host))
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

    def _application(
        self, page: Callable[[], str], state: Callable[[], Iterable[Message]], host: str
    ) -> tornado.web.Application:
        server = self

        class Ours(tornado.web.RequestHandler):
            def prepare(self) -> None:
                if not is_ours(host, self.request.headers.get("Host")):
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

        return tornado.web.Application([("/", Page), ("/socket", Socket)])

    def send(self, message: Message) -> None:
        """Send a message to every connected page."""

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
    with suppress(tornado.websocket.WebSocketClosedError):  # the page has closed
        page.write_message(message, binary=isinstance(message, bytes))


def listen(host: str, port: int) -> list[socket.socket]:
    """Sockets that listen on an address; port 0 is any free port. Raises a ServerError."""
    try:
        if not isinstance(host, str) or not isinstance(port, int):
            raise OSError("an address is a text, a port a whole number")
        if not host:
            raise OSError("an empty address would mean every network")
        if not 0 <= port <= 65535:  # else getaddrinfo takes the remainder
            raise OSError("ports end at 65535")
        return bind_sockets(port, host)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ServerError(f"cannot listen on {host}, port {port}: {reason}") from None


def url_of(host: str, port: int) -> str:
    """The address of a page."""
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def is_ours(host: str, asked: str | None) -> bool:
    """Whether a request names this machine or an IP address; `asked` is the header `Host`.

    Tornado itself refuses sockets of pages from elsewhere, by the header `Origin`.
    """
    try:
        name = urlsplit(f"//{asked or ''}").hostname or ""
        if name in ("localhost", host.lower(), socket.gethostname().lower()):
            return True
        return bool(ip_address(name))
    except ValueError:  # no address in numbers, or no host at all
        return False
