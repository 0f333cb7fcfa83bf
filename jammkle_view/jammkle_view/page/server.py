"""The server of the page: where it listens, whom it lets in, how it looks.

None but our own page may speak to it, or any web page could jam an ankle. A browser says with each WebSocket which
page opens it (Origin, RFC 6455, 10.2), and by which name it has reached the server (Host). A page of another site has
another origin. A site that lets its own name lead to this machine (DNS rebinding) has the origin that fits, but a name
that is not this machine's.
"""

from __future__ import annotations

import contextlib
import io
import ipaddress
import socket
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import viser

from jammkle_common.command.errors import InputError
from jammkle_view.parameters import ANY_PORT, FIRST_PORT, LOCAL_HOST

if TYPE_CHECKING:
    from collections.abc import Sequence

_PORTS_TRIED = 100
_POLICY_VIOLATION = 1008
"""Status of a WebSocket that is closed for what it is (RFC 6455, 7.4.1)."""
_NEAREST_M = 0.27
"""How much around a robot is seen at least, m: an ankle, its shank and its slope."""
_BRAND: tuple[int, int, int] = (25, 110, 235)


def serve(host: str, port: int, title: str) -> viser.ViserServer:
    """Start the server and return it; it runs in a thread of its own. Port ANY_PORT takes the first free one.

    Raises:
        InputError: the address is not this machine's, or the port is taken.

    """
    taken = port if port != ANY_PORT else _first_free(host)
    _check_free(host, taken)
    with contextlib.redirect_stdout(io.StringIO()):  # it would draw a frame around its address
        server = viser.ViserServer(host=host, port=taken, label=title, verbose=False)
    _refuse_foreign_pages(server)
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=_BRAND)
    return server


def _refuse_foreign_pages(server: viser.ViserServer) -> None:
    """Let nobody in whose page is not our own; viser has no option for it.

    Its callbacks for new clients run before anything is sent to them or read from them, and the connection that the
    request came by is kept beside them: attributes of the version that is pinned, and a test fails without them.
    """
    websockets, names = server._websock_server, own_names()  # noqa: SLF001 - as above

    async def check(client: Any) -> None:
        connection = websockets._live_connections[client.client_id]  # noqa: SLF001 - as above
        headers = connection.request.headers if connection.request is not None else {}
        if not is_own_page(headers.get("Origin"), headers.get("Host"), names):
            await connection.close(_POLICY_VIOLATION, "this page is not the server's own")

    websockets.on_client_connect(check)


def address_of(server: viser.ViserServer) -> str:
    """Return what to type into a browser on this machine."""
    host = server.get_host()
    shown = "localhost" if host in ("0.0.0.0", "::", LOCAL_HOST) else host  # noqa: S104 - a comparison
    return f"http://{shown}:{server.get_port()}"


def is_watched(server: viser.ViserServer) -> bool:
    """Return whether any browser has the page open."""
    return bool(server.get_clients())


def look_at(server: viser.ViserServer, centre_m: Sequence[float], size_m: float = 0.0) -> None:
    """Let cameras of browsers that open the page look at a robot from the front right.

    They aim above its middle, as the foot is heavy with bodies; of an ankle alone much more is seen than its bodies.
    """
    reach_m = max(_NEAREST_M, 1.15 * size_m)
    x, y, z = centre_m[0] - 0.07 * reach_m, centre_m[1], centre_m[2] + 0.33 * reach_m
    camera = server.initial_camera
    camera.look_at = (x, y, z)
    camera.position = (x + 1.3 * reach_m, y - 1.5 * reach_m, z + 0.5 * reach_m)
    camera.near = 0.005


def _first_free(host: str) -> int:
    _check_free(host, 0)  # or else the address is to blame
    for port in range(FIRST_PORT, FIRST_PORT + _PORTS_TRIED):
        with contextlib.suppress(InputError):
            _check_free(host, port)
            return port
    msg = f"ports {FIRST_PORT} to {FIRST_PORT + _PORTS_TRIED - 1} of {host} are all taken: name a free one"
    raise InputError(msg)


def _check_free(host: str, port: int) -> None:
    if not 0 <= port <= _LARGEST_PORT:
        msg = f"the page cannot listen on port {port}: it must be 1 to {_LARGEST_PORT}"
        raise InputError(msg)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except OSError as error:
        where = f"{host} port {port}" if port else host
        msg = f"the page cannot listen on {where}: {error.strerror}; choose another port or address"
        raise InputError(msg) from error


_LOCAL = "localhost"
_LARGEST_PORT = 65535


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
