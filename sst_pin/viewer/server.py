# SPDX-License-Identifier: BSD-2-Clause
"""A server for one page and its updates, on a port of this machine, in a thread.

The server sends the HTML page on request, and updates through a WebSocket that the page opens. Its
event loop runs in a thread of its own, so that the robot's program continues. Methods that other
threads call only put work into this loop.

Pages of other sites must not use the server. Such a page can make a browser ask 127.0.0.1 under the
name of its own site (DNS rebinding), and can open WebSockets to any address. So the server answers
only requests that name this machine or an IP address, and WebSockets only of its own page.
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

#: An update of the page.
Message = bytes | str
#: Time for clients to close their connections, [s].
_CLOSING_TIME = 1.0
#: While a page has more unread bytes than this, it gets no further messages. The messages of many
#: frames of a motion fit into this size, and the memory of a computer holds it for many pages.
_MOST_UNREAD = 2**22


class Server:
    """Serves a page until `close`.

    Attributes:
        url: Address of the page.
        visited: Set when a page has connected.
    """

    def __init__(
        self, page: Callable[[], str], state: Callable[[], Iterable[Message]], host: str, port: int
    ) -> None:
        """Start the server.

        Args:
            page: Returns the HTML of the page. The thread of the server calls it.
            state: Returns all messages that bring a new page up to date. The thread of the server
                calls it.
            host: Address to listen on.
            port: Port to listen on; 0 for any free port.

        Raises:
            ServerError: If the address or port cannot be used.
        """
        sockets = listen(host, port)
        self.url = url_of(host, sockets[0].getsockname()[1])
        self.visited = threading.Event()
        #: Connected pages, each with the object that sends it messages.
        self._pages = dict[tornado.websocket.WebSocketHandler, PageSender]()
        self._loop = asyncio.new_event_loop()
        self._must_end = asyncio.Event()
        serve = self._serve(self._application(page, state, host), sockets)
        self._thread = threading.Thread(
            target=lambda: self._loop.run_until_complete(serve), name=self.url, daemon=True
        )
        self._thread.start()

    async def _serve(
        self, application: tornado.web.Application, sockets: list[socket.socket]
    ) -> None:
        """Answer requests until `close`, then end all connections."""
        http = HTTPServer(application)
        http.add_sockets(sockets)
        await self._must_end.wait()
        http.stop()
        for page in tuple(self._pages):
            page.close()
        # With a time limit: a client that does not answer would delay the end by seconds.
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(http.close_all_connections(), _CLOSING_TIME)
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    def _application(
        self, page: Callable[[], str], state: Callable[[], Iterable[Message]], host: str
    ) -> tornado.web.Application:
        """The two addresses of the server: `/` is the page, `/socket` its updates."""
        server = self

        class Guarded(tornado.web.RequestHandler):
            """Refuses requests that name another site."""

            def prepare(self) -> None:
                if not is_ours(host, self.request.headers.get("Host")):
                    raise tornado.web.HTTPError(403)

        class Page(Guarded):
            def get(self) -> None:
                self.set_header("Cache-Control", "no-store")
                self.write(page())

        class Socket(Guarded, tornado.websocket.WebSocketHandler):
            def open(self, *_: str, **__: str) -> None:
                """Bring a new page up to date."""
                sender = PageSender(self, state)
                server._pages[self] = sender
                sender.send_state()
                server.visited.set()

            def on_message(self, message: Message) -> None:
                """Ignore messages of pages."""

            def on_close(self) -> None:
                server._pages.pop(self, None)

        return tornado.web.Application([("/", Page), ("/socket", Socket)])

    def send(self, message: Message) -> None:
        """Send a message to every connected page.

        Any thread may call this. After `close` it does nothing.
        """

        def send_to_all() -> None:
            for sender in tuple(self._pages.values()):
                sender.send(message)

        with suppress(RuntimeError):  # raised if the loop is closed
            self._loop.call_soon_threadsafe(send_to_all)

    def close(self) -> None:
        """Stop the server, and wait until its thread has ended."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._must_end.set)
            self._thread.join()
            self._loop.close()


class PageSender:
    """Sends messages to one page, and drops messages that the page is too slow to read.

    A suspended tab, for instance, does not read. While too many bytes are unread, messages are
    dropped. When the page has read all that was sent, it gets the whole state, and so is up to date
    again.
    """

    def __init__(
        self, page: tornado.websocket.WebSocketHandler, state: Callable[[], Iterable[Message]]
    ) -> None:
        self._page = page
        self._state = state
        self._unread = 0  # bytes
        self._has_dropped = False

    def send(self, message: Message) -> None:
        """Send a message, or drop it if too much is unread."""
        if self._unread > _MOST_UNREAD:
            self._has_dropped = True
        else:
            self._write(message)

    def send_state(self) -> None:
        """Send all that the page shows."""
        self._has_dropped = False
        for message in self._state():
            self._write(message)

    def _write(self, message: Message) -> None:
        """Write a message and count it as unread until the page has read it."""
        size = len(message.encode() if isinstance(message, str) else message)
        try:
            future = self._page.write_message(message, binary=isinstance(message, bytes))
        except tornado.websocket.WebSocketClosedError:  # the page has closed
            return
        self._unread += size

        def when_done(result: Any) -> None:
            """Count the message as read; the page has read it, or has closed."""
            self._unread -= size
            has_closed = result.cancelled() or result.exception() is not None
            if self._has_dropped and not self._unread and not has_closed:
                self.send_state()

        asyncio.ensure_future(future).add_done_callback(when_done)


def listen(host: str, port: int) -> list[socket.socket]:
    """Sockets that listen on an address; port 0 is any free port.

    Raises:
        ServerError: If the address or port cannot be used.
    """
    try:
        if not isinstance(host, str) or not isinstance(port, int):
            raise OSError("an address is a text, a port a whole number")
        if not host:
            raise OSError("an empty address would mean every network")
        if not 0 <= port <= 65535:  # getaddrinfo would take the remainder modulo 65536
            raise OSError("ports end at 65535")
        return bind_sockets(port, host)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ServerError(f"cannot listen on {host}, port {port}: {reason}") from None


def url_of(host: str, port: int) -> str:
    """The address of a page."""
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def is_ours(host: str, header: str | None) -> bool:
    """Whether the header `Host` of a request names this machine or an IP address.

    Tornado refuses WebSockets of other pages by itself: it compares the header `Origin`.
    """
    try:
        name = urlsplit(f"//{header or ''}").hostname or ""
        if name in ("localhost", host.lower(), socket.gethostname().lower()):
            return True
        ip_address(name)
    except ValueError:  # no address in numbers, or no host at all
        return False
    return True
