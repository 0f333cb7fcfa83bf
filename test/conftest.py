"""Fixtures of the whole-graph tests: each test has a ROS domain of its own, on this machine only."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest
from processes import Processes

from board_bench import BoardBench
from board_client import Client
from boards import board_command
from domains import own_domain
from graph import Probe, Up

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path


@pytest.fixture(autouse=True)
def _localhost_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


@pytest.fixture
def domain_id() -> Iterator[int]:
    """Reserve a ROS domain for one test."""
    with own_domain() as number:
        yield number


@pytest.fixture
def make_probe(domain_id: int) -> Iterator[Callable[..., Probe]]:
    """Make nodes that look on, in the test's domain."""
    probes: list[Probe] = []

    def make(namespace: str = "") -> Probe:
        probes.append(Probe(domain_id, namespace))
        return probes[-1]

    yield make
    for probe in probes:
        probe.close()


@pytest.fixture
def start(domain_id: int, tmp_path: Path) -> Iterator[Callable[..., Up]]:
    """Start `jammkle` with arguments in the test's domain; whatever still runs at the end is stopped.

    What they said is printed, so that pytest shows it for a test that failed.
    """
    started: list[Up] = []

    def begin(*arguments: str) -> Up:
        folder = tmp_path / f"process_{len(started)}"
        folder.mkdir()
        started.append(Up(domain_id, folder, *arguments))
        return started[-1]

    yield begin
    for process in started:
        exit_code = process.stop()
        sys.stdout.write(f"{process.arguments} ended with {exit_code}\n{process.text()}\n")


@pytest.fixture
def processes(domain_id: int, tmp_path: Path) -> Iterator[Processes]:
    """Start nodes one by one, in the test's domain."""
    folder = tmp_path / "processes"
    folder.mkdir()
    running = Processes(domain_id, folder)
    yield running
    running.end()


@pytest.fixture(scope="session")
def left_alone(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Options of `jammkle up` for an ankle that hangs in its rig while the controller decides nothing."""
    path = tmp_path_factory.mktemp("left_alone") / "left_alone.yaml"
    path.write_text(
        "/**/sim:\n  ros__parameters:\n    release_time_s: 3600.0\n"
        "/**/controller:\n  ros__parameters:\n    auto_at_start: false\n"
    )
    return ("--params", str(path))


@pytest.fixture(scope="session")
def command(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Build the board's firmware; what runs it."""
    return board_command(tmp_path_factory.mktemp("firmware"))


@pytest.fixture
def bench(command: list[str], tmp_path: Path) -> Iterator[BoardBench]:
    """Run the firmware with a plant behind its pins."""
    with BoardBench(command, tmp_path / "board", store=tmp_path / "store") as made:
        yield made


@pytest.fixture
def client(bench: BoardBench, tmp_path: Path) -> Iterator[Client]:  # noqa: ARG001 - to be there first
    """Connect to that board."""
    made = Client(tmp_path / "board")
    made.patient_inputs(0, 1)
    yield made
    made.modbus.close()
