"""The supervisor, with toy processes."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import subprocess
import sys
import textwrap
import time
from typing import TYPE_CHECKING

import pytest

from domains import wait_until
from jammkle_bringup.core import supervisor as supervisor_module
from jammkle_bringup.core.supervisor import ChildSpec, Supervisor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

TIMEOUT_S = 30.0

OBEDIENT = """
import signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
print("ready", flush=True)
while True:
    time.sleep(0.05)
"""
LEAVING = OBEDIENT.replace("sys.exit(0)", "(print('leaving', flush=True), sys.exit(0))")
STUBBORN = """
import signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
signal.signal(signal.SIGABRT, signal.SIG_IGN)
print("ready", flush=True)
while True:
    time.sleep(0.05)
"""
HUNG = """
import faulthandler, signal, time
faulthandler.enable()
signal.signal(signal.SIGTERM, signal.SIG_IGN)
def hang_here():
    print("ready", flush=True)
    time.sleep(600)
hang_here()
"""
DYING = """
import sys
sys.stderr.write("the pump is on fire\\n")
sys.exit(3)
"""


def spec(name: str, code: str) -> ChildSpec:
    return ChildSpec(name, (sys.executable, "-c", code))


def runs(process_id: int) -> bool:
    """Return True while a process runs; one that ended and is not collected yet does not."""
    try:
        with open(f"/proc/{process_id}/stat", encoding="ascii") as file:  # noqa: PTH123 - may vanish any time
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


STARVED_TIMEOUT_S = 0.2
STARVED = """
import os, signal, subprocess, sys, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
others = [subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) for _ in range(2)]
def end(*_):
    os.nice(19)  # 15 of 2063 parts of a core
    begun_s = time.process_time()
    while time.process_time() < begun_s + 0.02:
        pass
    for each in others:
        each.kill()
    os._exit(0)
signal.signal(signal.SIGTERM, end)
print("ready", flush=True)
while True:
    signal.pause()
"""


class Lines:
    """Collects what processes say."""

    def __init__(self) -> None:
        self.all: list[tuple[str, str]] = []

    def take(self, name: str, line: str) -> None:
        self.all.append((name, line))

    def ready(self, *names: str) -> bool:
        return all((name, "ready") in self.all for name in names)


@contextlib.contextmanager
def supervised(
    *specs: ChildSpec, take: Callable[[str, str], object] = lambda *_: None
) -> Iterator[tuple[Supervisor, Lines]]:
    """Start processes and wait until each has said that it is ready."""
    lines = Lines()

    def both(name: str, line: str) -> None:
        take(name, line)
        lines.take(name, line)

    with Supervisor(specs, both) as supervisor:
        wait_until(lambda: lines.ready(*(each.name for each in specs)), "all are ready")
        yield supervisor, lines


def test_a_process_that_dies_is_named_with_its_exit_code_and_last_words() -> None:
    """The first death carries name, exit code and the end of the output, and the others can still be stopped."""
    lines = Lines()
    with Supervisor([spec("sim", OBEDIENT), spec("driver", DYING)], lines.take) as supervisor:
        end_s = time.monotonic() + TIMEOUT_S
        death = supervisor.watch(lambda: time.monotonic() > end_s)
        wait_until(lambda: lines.ready("sim"), "sim is ready")
        others = [bad for bad in supervisor.stop() if bad.name != "driver"]
    assert death is not None
    assert (death.name, death.exit_code) == ("driver", 3)
    assert death.text() == "driver died with exit code 3; it said: the pump is on fire"
    assert others == []


def test_a_killed_process_is_named_with_its_signal() -> None:
    """A death by signal is reported with the signal's name."""
    with supervised(spec("sim", OBEDIENT)) as (supervisor, _):
        os.kill(supervisor.process_ids()["sim"], signal.SIGKILL)
        wait_until(lambda: supervisor.first_death() is not None, "the death is seen")
        death = supervisor.first_death()
    assert death is not None
    assert "SIGKILL" in death.text()


def test_a_death_does_not_quote_what_was_said_long_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """An error that was cleared an hour ago is not why a process was killed."""
    passed_s = [0.0]
    steady_s = time.monotonic
    monkeypatch.setattr(supervisor_module.time, "monotonic", lambda: steady_s() + passed_s[0])
    with supervised(spec("driver", OBEDIENT)) as (supervisor, _):
        passed_s[0] = 3600.0
        os.kill(supervisor.process_ids()["driver"], signal.SIGKILL)
        death = None
        while death is None:
            death = supervisor.first_death()
    assert death.text() == "driver died with signal SIGKILL"


WAITING_FOR = """
import pathlib, signal, sys, time
def end(*_):
    pathlib.Path({mine!r}).touch()
    while not pathlib.Path({others!r}).exists():
        time.sleep(0.01)
    sys.exit(0)
signal.signal(signal.SIGTERM, end)
print("ready", flush=True)
while True:
    time.sleep(0.05)
"""


def test_those_of_one_kind_are_stopped_together(tmp_path: Path) -> None:
    """Each of two drivers ends once the other was asked to: one ankle is not let go after the other."""
    left, right = str(tmp_path / "left"), str(tmp_path / "right")
    drivers = [
        dataclasses.replace(spec(name, WAITING_FOR.format(mine=mine, others=others)), kind="driver")
        for name, mine, others in (("left/driver", left, right), ("right/driver", right, left))
    ]
    with supervised(spec("sim", OBEDIENT), *drivers) as (supervisor, _):
        supervisor.loaded()
        assert supervisor.stop() == ()


def test_processes_stop_one_after_the_other_in_reverse_order() -> None:
    """What starts first ends last, so that a recorder sees how the others end."""
    with supervised(*(spec(name, LEAVING) for name in ("recorder", "sim", "driver"))) as (supervisor, lines):
        assert supervisor.stop() == ()
    assert [name for name, line in lines.all if line == "leaving"] == ["driver", "sim", "recorder"]


def test_what_a_process_says_last_is_handed_on() -> None:
    """Who reads it may be slow: nothing is lost as it ends."""
    with supervised(spec("sim", LEAVING), take=lambda *_: time.sleep(0.2)) as (supervisor, lines):
        assert supervisor.stop() == ()
        assert ("sim", "leaving") in lines.all


def test_a_stubborn_process_is_killed_and_named() -> None:
    """A process that ignores SIGTERM is killed after the timeout and counts as a bad end."""
    with supervised(dataclasses.replace(spec("stubborn", STUBBORN), stop_timeout_s=0.2)) as (supervisor, _):
        process_id = supervisor.process_ids()["stubborn"]
        (bad,) = supervisor.stop()
    assert (bad.name, bad.exit_code) == ("stubborn", -signal.SIGKILL)
    assert not runs(process_id)


def test_a_process_that_hangs_says_where() -> None:
    """Python's stacks are handed on before it is killed, if it has asked for them."""
    with supervised(dataclasses.replace(spec("hung", HUNG), stop_timeout_s=0.2)) as (supervisor, lines):
        (bad,) = supervisor.stop()
    assert (bad.name, bad.exit_code) == ("hung", -signal.SIGABRT)
    assert bad.text() == "hung died with signal SIGABRT; where it was stands above"
    assert any("in hang_here" in line for _, line in lines.all)


def test_a_process_that_waits_for_a_core_is_waited_for() -> None:
    """On a busy machine a process that gets a hundredth of a core is not killed for it; it counts its own time."""
    with supervised(dataclasses.replace(spec("starved", STARVED), stop_timeout_s=STARVED_TIMEOUT_S)) as (supervisor, _):
        asked_s = time.monotonic()
        assert supervisor.stop() == ()
        assert time.monotonic() - asked_s > 2.0 * STARVED_TIMEOUT_S  # so that it would have been killed


@pytest.mark.parametrize("loaded", [False, True])
def test_only_a_process_that_still_loads_may_end_by_the_signal(*, loaded: bool) -> None:
    """Before it has installed handlers that is no failure; later it has not done its last duty, such as a release."""
    with supervised(spec("driver", "import time\nprint('ready', flush=True)\ntime.sleep(600)")) as (supervisor, _):
        if loaded:
            supervisor.loaded()
        bad = [(each.name, each.exit_code) for each in supervisor.stop()]
    assert bad == ([("driver", -signal.SIGTERM)] if loaded else [])


def test_an_exception_stops_everything() -> None:
    """Leaving the context by an exception leaves no process."""
    process_ids: list[int] = []

    def fail() -> None:
        with supervised(spec("a", OBEDIENT), spec("b", OBEDIENT)) as (supervisor, _):
            process_ids.extend(supervisor.process_ids().values())
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert len(process_ids) == 2
    assert not any(runs(process_id) for process_id in process_ids)


PARENT = textwrap.dedent(
    """
    import sys
    from jammkle_common.command.errors import StopRequest
    from jammkle_bringup.core.supervisor import ChildSpec, Supervisor

    stop = StopRequest()
    specs = [ChildSpec(name, (sys.executable, "-c", sys.argv[1])) for name in ("a", "b")]

    def say(name, line):
        print(name, line, flush=True)

    with Supervisor(specs, say) as supervisor:
        print("children", *supervisor.process_ids().values(), flush=True)
        death = supervisor.watch(stop)
        bad = supervisor.stop()
    sys.exit(1 if death or bad else 0)
    """
)


def start_parent(tmp_path: Path) -> tuple[subprocess.Popen[str], list[int]]:
    """Start a process that supervises two others; return it and their process ids once they are ready."""
    output = tmp_path / "parent.txt"
    with output.open("w") as file:
        parent = subprocess.Popen([sys.executable, "-c", PARENT, OBEDIENT], stdout=file, stderr=file, text=True)
    wait_until(lambda: output.read_text().count("ready") == 2, "both children are ready")
    line = next(line for line in output.read_text().splitlines() if line.startswith("children"))
    return parent, [int(part) for part in line.split()[1:]]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_parent_and_children_well(tmp_path: Path, number: signal.Signals) -> None:
    """On SIGINT, SIGTERM and SIGHUP the parent stops its children, exits 0 and prints no traceback."""
    parent, children = start_parent(tmp_path)
    parent.send_signal(number)
    assert parent.wait(TIMEOUT_S) == 0
    assert not any(runs(child) for child in children)
    assert "Traceback" not in (tmp_path / "parent.txt").read_text()


def test_no_child_outlives_a_killed_parent(tmp_path: Path) -> None:
    """When the parent is killed, which it cannot notice, its children end too."""
    parent, children = start_parent(tmp_path)
    assert all(runs(child) for child in children)
    parent.kill()
    parent.wait(TIMEOUT_S)
    wait_until(lambda: not any(runs(child) for child in children), "the children have ended")


def test_a_child_has_a_session_of_its_own(tmp_path: Path) -> None:
    """Ctrl-C in a terminal reaches the foreground process group; the children are not in it."""
    parent, children = start_parent(tmp_path)
    try:
        assert all(os.getsid(child) == child for child in children)
        assert os.getsid(parent.pid) not in children
    finally:
        parent.terminate()
        parent.wait(TIMEOUT_S)


def test_what_only_looks_on_may_die() -> None:
    """It is reported once, and the others run on; before all was loaded its death counts as any other."""
    lost = []
    watcher = dataclasses.replace(spec("viewer", DYING), looks_on=True)
    with Supervisor([spec("driver", OBEDIENT), watcher], lambda *_: None, on_loss=lost.append) as supervisor:
        wait_until(lambda: supervisor.first_death() is not None, "the viewer has died")
        assert not lost
        supervisor.loaded()
        assert supervisor.first_death() is None
        assert supervisor.first_death() is None
        (death,) = lost
        assert death.text() == "viewer died with exit code 3; it said: the pump is on fire"
        assert set(supervisor.process_ids()) == {"driver"}
    assert not supervisor.process_ids()
