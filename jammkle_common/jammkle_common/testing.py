"""For tests: a ROS domain of one's own, the same random examples; needs test packages."""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import secrets
import signal
import time
from typing import TYPE_CHECKING

import psutil
import pytest
from domain_coordinator import domain_id
from hypothesis import settings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

DOMAINS = 100
"""Domains 1 to 100 are handed out, as domain_coordinator does by itself."""

_PACKAGES = (
    "jammkle_msgs",
    "jammkle_driver",
    "jammkle_controller",
    "jammkle_sim",
    "jammkle_gap",
    "jammkle_view",
    "jammkle_bringup",
)

for _library in ("OPENBLAS", "OMP", "MKL"):  # read as they are loaded, also by every process that a test starts
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
"""Linear algebra in one thread: where others want the cores too, threads wait for one another."""

_FIRST_PORT = 7400
_PORTS_PER_DOMAIN = 250
"""Port numbers of a domain's participants: the DDS-RTPS specification, 2.5, section 9.6.2.3."""


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests() -> None:
    """Import the packages before any test; pytest calls this, see pyproject.toml.

    Else its importlib mode takes the folder of the same name around a package instead. What is not built is left out:
    `colcon test` may see no more than one package and what that depends on.
    """
    for package in _PACKAGES:
        with contextlib.suppress(ModuleNotFoundError):
            importlib.import_module(package)


@pytest.hookimpl(tryfirst=True)
def pytest_configure() -> None:
    """Let hypothesis draw the same examples in every run, and count no time: pytest calls this, see pyproject.toml.

    A run that fails then fails again; whoever wants others gives `--hypothesis-profile=default`.
    """
    settings.register_profile("jammkle", derandomize=True, database=None, deadline=None)
    settings.load_profile("jammkle")


@pytest.fixture(autouse=True)
def _environment() -> Iterator[None]:
    """Give every test environment and handlers of signals back: a process of ours chooses its own when it starts."""
    before = dict(os.environ)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    os.environ.clear()
    os.environ.update(before)
    for number, handler in handlers.items():
        if signal.getsignal(number) is not handler:
            signal.signal(number, handler)


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
