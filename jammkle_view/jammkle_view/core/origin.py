"""Whose page a browser shows: none but our own may speak to the server, or any web page could jam an ankle.

A browser says with each WebSocket which page opens it (Origin, RFC 6455, 10.2), and by which name it has reached the
server (Host). A page of another site has another origin. A site that lets its own name lead to this machine (DNS
rebinding) has the origin that fits, but a name that is not this machine's.
"""

from __future__ import annotations

import ipaddress
import socket
from urllib.parse import urlsplit

_LOCAL = "localhost"


def is_own_page(origin: str | None, host: str | None, names: frozenset[str]) -> bool:
    """Return whether a WebSocket may be opened.

    Args:
        origin: What the request says of the page; None: it is no browser that asks, and no page can make it.
        host: By which name and port the server was reached, as the request says.
        names: Names of this machine, lower case; addresses and `localhost` are always its own.

    """
    if origin is None:
        return True
    if not host:
        return False
    try:
        page, server = urlsplit(origin), urlsplit(f"//{host}")
        same = page.scheme in {"http", "https"} and page.netloc.lower() == host.lower()
        name = server.hostname or ""
    except ValueError:  # what is no address at all
        return False
    return same and (_is_address(name) or name == _LOCAL or name in names)


def own_names() -> frozenset[str]:
    """Return the names by which this machine may be reached from others."""
    name = socket.gethostname().lower()
    short = name.partition(".")[0]
    return frozenset({name, short, f"{short}.local", socket.getfqdn().lower()} - {""})


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
