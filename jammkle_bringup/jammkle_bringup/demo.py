"""`jammkle demo`: land the simulated ankle on a slope, record it, and say what happened."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rich.console import Console
from std_srvs.srv import SetBool

from jammkle_bringup.core.errors import GraphError
from jammkle_bringup.core.namespace import resolved
from jammkle_bringup.core.namespace_lock import NamespaceLock, default_folder, ros_domain
from jammkle_bringup.core.run_series import read_run
from jammkle_bringup.core.run_summary import summary_of
from jammkle_bringup.core.supervisor import Supervisor
from jammkle_bringup.graph_client import GraphClient
from jammkle_bringup.up import RECORDER, GraphOptions, beside_others, child_specs, say, say_how_it_ended
from jammkle_graph.names import (
    CHANNELS,
    CONTACT_EVENTS,
    CONTROLLER_NODE,
    DRIVER_NODE,
    IMU,
    JAM_STATE,
    SET_PAUSED,
    SIM_NODE,
    SOLENOIDS,
)
from jammkle_graph.qos import subscriber_qos
from jammkle_msgs.msg import ChannelJamState, ContactEvent, JamState

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import TextIO

    from jammkle_bringup.core.node_table import ParameterValue
    from jammkle_bringup.core.run_summary import RunSummary
    from jammkle_bringup.core.supervisor import Death

READY_TIMEOUT_S = 30.0
"""Until all nodes are there. Assumed; a first start compiles the simulation's laws, which takes some seconds."""

LANDING_TIMEOUT_S = 20.0
"""From letting go until everything is jammed. Assumed; in real time it takes about 3 s."""

_SETTLE_TIMEOUT_S = 3.0
_AFTER_S = 0.5


@dataclass(frozen=True)
class DemoResult:
    """What a demo left behind."""

    summary: RunSummary
    picture: Path
    exit_code: int


@dataclass
class _Heard:
    """What the graph has said so far."""

    events: list[int] = field(default_factory=list)
    jammed: frozenset[str] = frozenset()

    def take_event(self, event: ContactEvent) -> None:
        self.events.append(event.type)

    def take_state(self, state: JamState) -> None:
        self.jammed = frozenset(each.channel for each in state.channels if each.state == ChannelJamState.JAMMED)


def demo(make_folder: Callable[[], Path], namespace: str, asked_to_stop: Callable[[], bool]) -> DemoResult:
    """Run the demo.

    Args:
        make_folder: Makes the run's folder; called once it is known that the demo can start.
        namespace: Normalised namespace.
        asked_to_stop: Ends the demo early once it returns True.

    Raises:
        InputError: a graph is already up in the namespace, or the folder cannot be made.
        GraphError: the graph did not start, or a node died.
        Interrupted: the command was asked to stop; everything was stopped in order.

    """
    values: dict[str, dict[str, ParameterValue]] = {SIM_NODE: {"start_paused": True}}
    with NamespaceLock(namespace, ros_domain(), default_folder()):
        options = beside_others(GraphOptions(namespace, values=values), asked_to_stop)
        folder = make_folder()
        bag = folder / "bag"
        with (folder / "graph.log").open("w", encoding="utf-8") as log:
            bad = _land(replace(options, bag=bag), log, asked_to_stop)
    if say_how_it_ended(None, bad):
        msg = f"the graph did not stop well; its output is in {folder / 'graph.log'}"
        raise GraphError(msg)
    run = read_run(bag, namespace)
    summary = summary_of(run, str(bag))
    picture = folder / "run.png"
    from jammkle_bringup.core.picture import draw  # noqa: PLC0415 - half a second that only the end of the demo needs

    draw(run, summary, picture)
    return DemoResult(summary, picture, say_verdict(summary))


def say_verdict(summary: RunSummary) -> int:
    """Say what a landing should have had and had not; return the exit code."""
    failures = []
    if summary.detected_s is None:
        failures.append("the impact was not detected")
    failures += [
        f"{channel.channel} did not reach its vacuum" for channel in summary.channels if channel.reached_s is None
    ]
    if failures:
        say(f"the landing failed: {'; '.join(failures)}")
    return 1 if failures else 0


def _land(options: GraphOptions, log: TextIO, asked_to_stop: Callable[[], bool]) -> tuple[Death, ...]:
    """Run the graph through one landing and stop it; return what did not end well."""
    lock = threading.Lock()

    def keep(name: str, line: str) -> None:
        with lock:
            log.write(f"[{name}] {line}\n")

    screen = Console(stderr=True)
    with Supervisor(child_specs(options), keep) as supervisor:
        with GraphClient(options.namespace, asked_to_stop) as client, screen.status("starting the graph") as progress:
            heard = _Heard()
            client.subscribe(ContactEvent, CONTACT_EVENTS, heard.take_event, subscriber_qos(CONTACT_EVENTS))
            client.subscribe(JamState, JAM_STATE, heard.take_state, subscriber_qos(JAM_STATE))
            _wait_until_ready(client, supervisor, log.name)
            say("simulation, controller, driver and recorder are there")
            progress.update("landing")
            answer = client.call(SET_PAUSED, SetBool, SetBool.Request(data=False))
            if not answer.success:
                msg = f"the simulation did not start: {answer.message}"
                raise GraphError(msg)
            _watch_landing(client, supervisor, heard, log.name)
            progress.update("stopping")
        return supervisor.stop()


def _wait_until_ready(client: GraphClient, supervisor: Supervisor, log: str) -> None:
    """Wait until the nodes are connected to each other and the driver is active."""
    _wait(client, supervisor, lambda: not _not_connected(client), READY_TIMEOUT_S, log)
    missing = _not_connected(client)
    if missing:
        msg = f"not ready after {READY_TIMEOUT_S:g} s, missing: {', '.join(missing)}; the output is in {log}"
        raise GraphError(msg)
    state = State.PRIMARY_STATE_UNKNOWN

    def active() -> bool:
        nonlocal state
        answer = client.call_path(f"{DRIVER_NODE}/get_state", GetState, GetState.Request())
        state = answer.current_state.id
        return bool(state == State.PRIMARY_STATE_ACTIVE)

    if not _wait(client, supervisor, active, READY_TIMEOUT_S, log):
        msg = f"the driver is not active after {READY_TIMEOUT_S:g} s (lifecycle state {state}); the output is in {log}"
        raise GraphError(msg)


def _not_connected(client: GraphClient) -> list[str]:
    """Return which pairs of publisher and subscriber are not there yet."""
    wanted = [
        (IMU.name, SIM_NODE, (CONTROLLER_NODE, RECORDER)),
        (CONTACT_EVENTS.name, CONTROLLER_NODE, (RECORDER,)),
        *((SOLENOIDS[channel].name, DRIVER_NODE, (SIM_NODE, RECORDER)) for channel in CHANNELS),
    ]
    missing = []
    for topic, publisher, subscribers in wanted:
        name = resolved(client.namespace, topic)
        publishing = {info.node_name for info in client.node.get_publishers_info_by_topic(name)}
        listening = {info.node_name for info in client.node.get_subscriptions_info_by_topic(name)}
        if publisher not in publishing:
            missing.append(f"{publisher} ({topic})")
        missing += [f"{subscriber} ({topic})" for subscriber in subscribers if subscriber not in listening]
    return missing


def _watch_landing(client: GraphClient, supervisor: Supervisor, heard: _Heard, log: str) -> None:
    """Wait until the impact was felt, all channels are jammed and the body is at rest, as far as that comes."""
    if _wait(client, supervisor, lambda: ContactEvent.IMPACT in heard.events, LANDING_TIMEOUT_S, log):
        say("impact detected")
        if _wait(client, supervisor, lambda: heard.jammed == frozenset(CHANNELS), LANDING_TIMEOUT_S, log):
            say("all channels are jammed")
            _wait(client, supervisor, lambda: ContactEvent.SETTLED in heard.events, _SETTLE_TIMEOUT_S, log)
            _wait(client, supervisor, lambda: False, _AFTER_S, log)


def _wait(
    client: GraphClient, supervisor: Supervisor, predicate: Callable[[], bool], timeout_s: float, log: str
) -> bool:
    """Wait for something on the graph, and notice when a process dies meanwhile."""
    deaths: list[Death] = []

    def done() -> bool:
        death = supervisor.first_death()
        if death is not None:
            deaths.append(death)
        return bool(deaths) or predicate()

    held = client.wait_until(done, timeout_s)
    if deaths:
        msg = f"{deaths[0].text()}; the output is in {log}"
        raise GraphError(msg)
    return held
