# SPDX-License-Identifier: BSD-2-Clause
"""Addresses for pages, and checks of requests.

A page of another site can make a browser ask 127.0.0.1 under that site's name (DNS rebinding), and
open WebSockets to any address. Requests must therefore name this machine, and come from our page.
"""

from __future__ import annotations

import socket
from ipaddress import ip_address
from urllib.parse import urlsplit

from tornado.netutil import bind_sockets

from ..errors import ServerError


def listen(host: str, port: int) -> list[socket.socket]:
    """Sockets that listen on an address; port 0 takes any that is free.

    Raises:
        ServerError: When nothing can listen there.
    """
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


def is_ours(host: str, asked: str | None, origin: str | None) -> bool:
    """Whether a request asks this machine by its own name, and comes from its own page.

    `asked` is the header `Host`; addresses in numbers pass: no site has their name. `origin` is the
    header `Origin`; programs that are no browser send none.
    """
    try:
        name = urlsplit(f"//{asked or ''}").hostname or ""
        if origin is not None and urlsplit(origin).netloc != asked:
            return False
        if name in ("localhost", host.lower(), socket.gethostname().lower()):
            return True
        return bool(ip_address(name))
    except ValueError:  # no address in numbers, or no host at all
        return False
