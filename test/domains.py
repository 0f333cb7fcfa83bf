"""A ROS domain of one's own, and waiting for what must come."""

from __future__ import annotations

import contextlib
import gc
import secrets
import time
from typing import TYPE_CHECKING

import psutil
import pytest
from domain_coordinator import domain_id

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

DOMAINS = 100
"""Domains 1 to 100 are handed out, as domain_coordinator does by itself."""

_FIRST_PORT = 7400
_PORTS_PER_DOMAIN = 250
"""Port numbers of a domain's participants: the DDS-RTPS specification, 2.5, section 9.6.2.3."""


def wait_until(predicate: Callable[[], bool], what: str, timeout_s: float = 30.0) -> None:
    """Wait until something holds; fail with what was waited for."""
    end_s = time.monotonic() + timeout_s
    while not predicate():
        if time.monotonic() > end_s:
            pytest.fail(f"not within {timeout_s} s: {what}")
        time.sleep(0.01)


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """Reserve a ROS domain that nobody on this machine is in, and hand over its number.

    domain_coordinator knows of tests alone; a graph that somebody started by hand is seen by its UDP ports.

    Raises:
        RuntimeError: this process is still in the domain afterwards: something made in it was not destroyed, goes on
            talking, and would disturb another test.

    """
    with domain_id(_draw) as number:
        yield number
        gc.collect()  # nodes and executors refer to each other
        if number in _domains(connection.laddr.port for connection in psutil.Process().net_connections("udp")):
            msg = f"this process is still in ROS domain {number}: destroy nodes, action clients and servers"
            raise RuntimeError(msg)


def _draw() -> int:
    taken = _domains(connection.laddr.port for connection in psutil.net_connections("udp"))
    return secrets.choice([number for number in range(1, DOMAINS + 1) if number not in taken])


def _domains(ports: Iterable[int]) -> set[int]:
    return {(port - _FIRST_PORT) // _PORTS_PER_DOMAIN for port in ports}
