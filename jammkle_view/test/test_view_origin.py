"""Whose page may speak to the server: a foreign one must not be able to jam an ankle."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from jammkle_common.command.errors import InputError
from jammkle_view.page.server import is_own_page, own_names, serve

if TYPE_CHECKING:
    from collections.abc import Iterator

NAMES = frozenset({"robot", "robot.local"})


@pytest.mark.parametrize(
    ("origin", "host", "allowed"),
    [
        (None, "localhost:8080", True),  # no browser
        ("http://localhost:8080", "localhost:8080", True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("http://[::1]:8080", "[::1]:8080", True),
        ("http://localhost:9000", "localhost:9000", True),  # a tunnel with another port at this end
        ("http://Robot.local:8080", "robot.local:8080", True),
        ("http://192.168.1.7:8080", "192.168.1.7:8080", True),
        ("https://evil.example", "localhost:8080", False),
        ("http://localhost:3000", "localhost:8080", False),  # another server on this machine
        ("http://evil.example:8080", "evil.example:8080", False),  # its name leads to this machine
        ("null", "localhost:8080", False),  # a file, or a page without an origin
        ("http://localhost:8080", None, False),
        ("http://[::1", "[::1", False),
        ("", "localhost:8080", False),
    ],
)
def test_only_the_own_page_of_an_own_name_is_let_in(origin: str | None, host: str | None, allowed: bool) -> None:  # noqa: FBT001
    assert is_own_page(origin, host, NAMES) is allowed


def test_this_machine_has_a_name() -> None:
    assert own_names()


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    made = serve("127.0.0.1", 0, "Test")
    yield made
    made.stop()


def test_a_foreign_page_is_sent_away_before_it_is_served(server: viser.ViserServer) -> None:
    """It is closed before it gets a message; a page of our own, and a client without a page, are served."""
    address = f"ws://localhost:{server.get_port()}"
    protocol = [f"viser-v{viser.__version__}"]
    with connect(address, origin="https://evil.example", subprotocols=protocol) as foreign:
        with pytest.raises(ConnectionClosed) as closed:
            foreign.recv(timeout=20.0)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1008
    for origin in (f"http://localhost:{server.get_port()}", None):
        with connect(address, origin=origin, subprotocols=protocol, max_size=None) as own:
            assert own.recv(timeout=20.0)
    end_s = time.monotonic() + 20.0
    while server.get_clients() and time.monotonic() < end_s:
        time.sleep(0.05)
    assert not server.get_clients()


def test_a_port_that_cannot_be_is_refused() -> None:
    """By its limits, and not by an error of the socket's."""
    with pytest.raises(InputError, match="port 99999: it must be 1 to 65535"):
        serve("127.0.0.1", 99999, "Test")
