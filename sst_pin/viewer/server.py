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
#: A page that has not read so much yet gets no further messages, [byte].
_MOST_WAITING = 2**22
#: Time for clients to close their connections, [s].
_GOODBYE = 1.0


class Server:
    """Serves the result of `page` until `close`; each new page is sent the messages of `state`."""

    def __init__(
        self, page: Callable[[], str], state: Callable[[], Iterable[Message]], host: str, port: int
    ) -> None:
        sockets = listen(host, port)
        self.url = url_of(host, sockets[0].getsockname()[1])
        self.visited = threading.Event()  #: Set when a page has connected.
        self._pages = dict[tornado.websocket.WebSocketHandler, Reader]()
        self._loop = asyncio.new_event_loop()
        self._done = asyncio.Event()

        async def run() -> None:
            http = HTTPServer(self._application(page, state, host))
            http.add_sockets(sockets)
            await self._done.wait()
            http.stop()
            for listener in tuple(self._pages):
                listener.close()
            # A client that does not answer would hold the server for seconds.
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(http.close_all_connections(), _GOODBYE)
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

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
                self.reader = Reader(self, state)
                server._pages[self] = self.reader
                self.reader.send_state()
                server.visited.set()

            def on_message(self, message: Message) -> None:
                """Pages have nothing to say."""

            def on_close(self) -> None:
                server._pages.pop(self, None)

        return tornado.web.Application([("/", Page), ("/socket", Socket)])

    def send(self, message: Message) -> None:
        """Send a message to every connected page."""

        def tell() -> None:
            for reader in tuple(self._pages.values()):
                reader.send(message)

        self._loop.call_soon_threadsafe(tell)

    def close(self) -> None:
        """Stop listening and wait until it has stopped."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._done.set)
            self._thread.join()
            self._loop.close()


class Reader:
    """Sends messages to one page, no more than it reads.

    While the page lags, as in a suspended tab, messages are dropped. When it has read what it was
    sent, it gets the whole state.
    """

    def __init__(
        self, page: tornado.websocket.WebSocketHandler, state: Callable[[], Iterable[Message]]
    ) -> None:
        self._page = page
        self._state = state
        self._waiting = 0
        self._lags = False

    def send(self, message: Message) -> None:
        """Send a message, or drop it if the page lags."""
        if self._waiting > _MOST_WAITING:
            self._lags = True
        else:
            self._write(message)

    def send_state(self) -> None:
        """Send all that the page shows."""
        self._lags = False
        for message in self._state():
            self._write(message)

    def _write(self, message: Message) -> None:
        size = len(message)
        try:
            future = self._page.write_message(message, binary=isinstance(message, bytes))
        except tornado.websocket.WebSocketClosedError:  # the page has closed
            return
        self._waiting += size

        def read(done: Any) -> None:
            self._waiting -= size
            failed = done.cancelled() or done.exception() is not None  # the page has closed
            if self._lags and not self._waiting and not failed:
                self.send_state()

        asyncio.ensure_future(future).add_done_callback(read)


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
