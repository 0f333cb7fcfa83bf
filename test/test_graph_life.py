"""Start and end of the graph: signals, dead nodes, a namespace that is taken, input that is wrong."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from typing import TYPE_CHECKING

import psutil
import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState

from graph import COMMAND, TIMEOUT_S, environment
from jammkle_bringup.graph_client import DISCOVERY_S
from jammkle_common.command.main import main
from jammkle_common.names import CHANNELS, CLOCK, JAM, JAM_STATE, PUMP_DUTY, SOLENOIDS, STEP
from jammkle_msgs.msg import ChannelJamState
from readme_tables import EXAMPLES

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from graph import Probe, Up

GOOD_VACUUM_PA = 50e3
STATUS_CALLS = 6
"""As many as it once took to miss a node."""


@pytest.fixture
def graph(start: Callable[..., Up], make_probe: Callable[..., Probe], left_alone: tuple[str, str]) -> tuple[Up, Probe]:
    """Bring up one ankle that the controller leaves alone, with a node that looks on."""
    up = start("up", *left_alone)
    probe = make_probe()
    probe.listen(JAM_STATE, PUMP_DUTY, *SOLENOIDS.values())
    probe.wait_until_up()
    return up, probe


def test_the_first_session(domain_id: int, make_probe: Callable[..., Probe], tmp_path: Path) -> None:
    """What the README shows, pasted: every command is answered, and Ctrl-C ends it with every solenoid released."""
    (tmp_path / ".venv").symlink_to(COMMAND.parents[1])
    probe = make_probe()
    probe.listen(PUMP_DUTY, *SOLENOIDS.values())
    session = subprocess.Popen(
        ["/usr/bin/env", "bash", "-m", EXAMPLES / "first_session.sh"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=tmp_path,
        env=environment(domain_id),
    )
    said, _ = session.communicate(timeout=2 * TIMEOUT_S)
    assert session.returncode == 0, said
    for words in (*CHANNELS, "unjamming", "achilles at 45000 Pa"):
        assert words in said, said
    assert (tmp_path / "up.log").read_text().endswith("jammkle: stopped\n")
    probe.spin_until(
        lambda: all(probe.received[topic.name] for topic in SOLENOIDS.values()), "the solenoids are received"
    )
    probe.spin_until(lambda: not any(probe.last(topic).data for topic in SOLENOIDS.values()), "all solenoids released")
    probe.spin_until(lambda: probe.last(PUMP_DUTY).data == 0.0, "the pump is off")


def test_up_stops_cleanly(graph: tuple[Up, Probe]) -> None:
    """After SIGTERM: exit code 0, no traceback, no process left, every solenoid released, pump off."""
    up, probe = graph
    probe.call(JAM)
    probe.wait_until_jammed()
    children = up.children()
    assert len(children) >= 3
    assert up.stop(signal.SIGTERM) == 0
    assert not any(child.is_running() and child.status() != psutil.STATUS_ZOMBIE for child in children)
    assert "Traceback" not in up.text()
    probe.spin_until(lambda: not any(probe.last(topic).data for topic in SOLENOIDS.values()), "all solenoids released")
    probe.spin_until(lambda: probe.last(PUMP_DUTY).data == 0.0, "the pump is off")


@pytest.mark.parametrize("package", ["jammkle_driver", "jammkle_controller", "jammkle_sim"])
def test_up_says_which_node_died(graph: tuple[Up, Probe], package: str) -> None:
    """When a node is killed, `up` names it, takes the rest down and exits with an error."""
    up, _ = graph
    children = up.children()
    os.kill(up.child(package).pid, signal.SIGKILL)
    assert up.wait() not in {0, 2}
    assert package.removeprefix("jammkle_") in up.text()
    assert "SIGKILL" in up.text()
    assert "Traceback" not in up.text()
    assert not any(child.is_running() and child.status() != psutil.STATUS_ZOMBIE for child in children)


def test_up_detects_its_landing(start: Callable[..., Up], make_probe: Callable[..., Probe]) -> None:
    """The ankle falls only once the graph is connected: the controller, that feels it land, gets everything jammed."""
    up = start("up")
    probe = make_probe()
    probe.listen(JAM_STATE)
    probe.wait_for_channels(ChannelJamState.JAMMED)
    assert {channel.reason for channel in probe.last(JAM_STATE).channels} == {"asked by jam_command"}
    assert up.stop() == 0
    assert "jammkle: up\n" in up.text()


def test_up_stays_paused_if_a_file_says_so(
    start: Callable[..., Up], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """A user's own start_paused wins: simulated time stands until ~/step or ~/set_paused, and `up` says so."""
    path = tmp_path / "paused.yaml"
    path.write_text("/**/sim:\n  ros__parameters:\n    start_paused: true\n")
    up = start("up", "--params", str(path))
    probe = make_probe()
    probe.spin_until(lambda: "jammkle: up; paused" in up.text(), "it is up")
    answer = probe.call(STEP, steps=10)
    assert answer.success, answer.message
    assert answer.simulated_time_s == pytest.approx(10 * 0.0005)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_up_can_be_stopped_while_it_waits(start: Callable[..., Up], number: signal.Signals) -> None:
    """A signal before the graph is connected: exit code 0, no traceback, no process left."""
    up = start("up")
    wait_for_children(up)
    children = up.children()
    assert up.stop(number) == 0, up.text()
    assert "jammkle: up" not in up.text()
    assert "Traceback" not in up.text()
    assert not any(child.is_running() and child.status() != psutil.STATUS_ZOMBIE for child in children)


def test_a_node_that_dies_while_up_waits_is_named(start: Callable[..., Up]) -> None:
    """Before the graph is connected, a death ends it as later."""
    up = start("up")
    wait_for_children(up)
    os.kill(up.child("jammkle_sim").pid, signal.SIGKILL)
    assert up.wait() == 1
    assert up.text().count("sim died with signal SIGKILL") == 1
    assert "Traceback" not in up.text()


PACKAGES = {"jammkle_sim", "jammkle_controller", "jammkle_driver"}


def wait_for_children(up: Up) -> None:
    """Wait until `up` has started all of its processes."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while not {word for child in up.children() for word in child.cmdline()} >= PACKAGES:
        assert time.monotonic() < deadline_s, up.text()
        assert up.process.poll() is None, up.text()
        time.sleep(0.02)


def test_a_killed_up_leaves_no_process(graph: tuple[Up, Probe]) -> None:
    """Even `kill -9` of the parent ends every node."""
    up, _ = graph
    children = up.children()
    os.kill(up.process.pid, signal.SIGKILL)
    up.wait()
    gone, alive = psutil.wait_procs(children, timeout=30)
    assert len(gone) == len(children)
    assert not alive


@pytest.mark.parametrize("namespaces", [("/", "/"), ("lf_ankle", "rf_ankle")], ids=["same names", "two clocks"])
def test_graphs_started_together_do_not_both_go_on(
    start: Callable[..., Up],
    make_probe: Callable[..., Probe],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    namespaces: tuple[str, str],
) -> None:
    """Where no lock parts them, as of two users: nodes of one name, or two /clock, never stay beside each other."""
    both = []
    for number, namespace in enumerate(namespaces):
        (tmp_path / str(number)).mkdir()
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / str(number)))  # where the lock is
        both.append(start("up", "--namespace", namespace))
    probe = make_probe()
    probe.spin_until(
        lambda: all(up.process.poll() is not None or "jammkle: up" in up.text() for up in both),
        "both have refused or are up",
    )
    until_s = time.monotonic() + DISCOVERY_S
    # what is up looks on for as long: a clock of the other, or its second node, may come up that late
    probe.spin_until(
        lambda: time.monotonic() > until_s or any(up.process.poll() is not None for up in both), "they had their time"
    )
    ended = [up for up in both if up.process.poll() is not None]
    clocks = len(probe.node.get_publishers_info_by_topic(CLOCK.name))
    assert ended or (clocks == 1 and namespaces[0] != namespaces[1])
    for up in ended:
        assert up.wait() == 2
        assert "already up" in up.text() or "/clock comes from" in up.text()


def test_a_jam_request_while_inactive_is_refused(graph: tuple[Up, Probe]) -> None:
    """A deactivated driver answers success=false, says how to activate it, and jams again once it is active."""
    _, probe = graph
    client = probe.node.create_client(ChangeState, "driver/change_state")
    for transition, accepted in ((Transition.TRANSITION_DEACTIVATE, False), (Transition.TRANSITION_ACTIVATE, True)):
        future = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
        probe.spin_until(future.done, "the driver changes its state")
        assert future.result().success
        answer = probe.call(JAM)
        assert answer.success is accepted, answer.message
        if not accepted:
            assert "active" in answer.message


def bad_yaml(folder: Path) -> str:
    """Parameter file with a typing error in it."""
    path = folder / "parameters.yaml"
    path.write_text("driver:\n  ros__parameters:\n    defualt_vacuum_pa: 40000.0\n")
    return str(path)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("jam", "soleus"), ("soleus", "achilles")),
        (("jam", "--vacuum-kpa", "nan"), ("nan",)),
        (("up", "--params", "{bad_yaml}"), ("defualt_vacuum_pa",)),
        (("up", "--params", "{missing}"), ("missing",)),
        (("up", "--speed", "-1"), ("-1",)),
        (("up", "--namespace", "no good"), ("no good",)),
        (("record", "-o", "{existing}"), ("existing",)),
        (("info", "{existing}"), ("existing",)),
        (("info", "{missing}"), ("missing",)),
    ],
)
def test_bad_input_gets_one_clear_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    """Exit code 2 and one line that names the value; what is there already stays as it is."""
    existing = tmp_path / "existing"
    existing.mkdir()
    (existing / "metadata.yaml").write_text("not a bag")
    places = {"bad_yaml": bad_yaml(tmp_path), "missing": str(tmp_path / "missing"), "existing": str(existing)}
    assert main([argument.format(**places) for argument in arguments]) == 2
    lines = "".join(capsys.readouterr()).strip().splitlines()
    assert len(lines) == 1, lines
    assert all(word in lines[0] for word in words), lines[0]
    assert (existing / "metadata.yaml").read_text() == "not a bag"


def test_without_a_graph_a_client_says_so(start: Callable[..., Up]) -> None:
    """`jammkle jam` and `status` end with an error and one line that says what to start."""
    for process in [start(name) for name in ("jam", "unjam", "status")]:
        assert process.wait() == 1
        assert "jammkle up" in process.text()
        assert "Traceback" not in process.text()
