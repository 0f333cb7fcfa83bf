"""Start and end of the graph: signals, dead nodes, a namespace that is taken."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from typing import TYPE_CHECKING

import psutil
import pytest

from graph import COMMAND, REAL_TIMEOUT_S, environment
from jammkle_bringup.graph_client import DISCOVERY_S
from jammkle_common.names import CHANNELS, CLOCK, JAM, JAM_STATE, PUMP_DUTY, SOLENOIDS
from jammkle_msgs.msg import ChannelJamState
from readme_tables import EXAMPLES

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from graph import Probe, Up


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
    said, _ = session.communicate(timeout=2 * REAL_TIMEOUT_S)
    assert session.returncode == 0, said
    for words in (*CHANNELS, "automatic jamming is off", "unjamming", "achilles at 45000 Pa"):
        assert words in said, said
    assert said.rpartition("achilles at 45000 Pa")[2].count("asked by ~/jam") == len(CHANNELS), said
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


def test_up_says_which_node_died(graph: tuple[Up, Probe]) -> None:
    """When a node is killed, `up` names it, takes the rest down and exits with an error."""
    up, _ = graph
    children = up.children()
    os.kill(up.child("jammkle_driver").pid, signal.SIGKILL)
    assert up.wait() not in {0, 2}
    assert "driver" in up.text()
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
    probe.spin_until(lambda: "jammkle: up\n" in up.text(), "it says so")
    assert up.stop() == 0


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
    deadline_s = time.monotonic() + REAL_TIMEOUT_S
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
    gone, alive = psutil.wait_procs(children, timeout=REAL_TIMEOUT_S)
    assert len(gone) == len(children)
    assert not alive


@pytest.mark.parametrize("namespaces", [("/", "/"), ("lf_ankle", "rf_ankle")], ids=["same names", "two clocks"])
def test_graphs_started_together_do_not_both_go_on(
    start: Callable[..., Up], make_probe: Callable[..., Probe], namespaces: tuple[str, str]
) -> None:
    """As of two users: nodes of one name, or two /clock, never stay beside each other."""
    both = [start("up", "--namespace", namespace) for namespace in namespaces]
    probe = make_probe()
    probe.spin_until(
        lambda: all(up.process.poll() is not None or "jammkle: up" in up.text() for up in both),
        "both have refused or are up",
    )
    until_s = time.monotonic() + DISCOVERY_S

    def settled() -> bool:
        clocks = len(probe.node.get_publishers_info_by_topic(CLOCK.name))
        # what is up looks on for as long: a clock of the other, or its second node, may come up that late
        one_clock = time.monotonic() > until_s and clocks == 1 and namespaces[0] != namespaces[1]
        return one_clock or any(up.process.poll() is not None for up in both)

    probe.spin_until(settled, "one has given way, or lives in the time of the other")
    for up in (up for up in both if up.process.poll() is not None):
        assert up.wait() == 2
        assert "already up" in up.text() or "/clock comes from" in up.text()
