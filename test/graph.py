"""A running graph for tests: `jammkle` as a child process, and a node in the test that looks on."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock

from domains import own_domain
from jammkle_common.names import CHANNELS, CLOCK, DIAGNOSTICS, JAM, JAM_STATE, STEP, Service, Topic
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_msgs.msg import ChannelJamState, Fault

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rclpy.node import Node

TIMEOUT_S = 60.0
"""How long a test waits for anything where somebody makes /clock, s of simulated time, which no busy machine makes
longer. Only a broken graph ever gets there."""
REAL_TIMEOUT_S = 300.0
"""How long it waits where nobody does, or the clock stands still, and for the end of a process, s of real time: a start
took a minute where twenty processes wanted two cores."""

ANSWERED_WITHIN_S = 5.0
"""When a request is made again, s of real time; DDS mends a loss within 3 s."""

COMMAND = Path(sys.executable).with_name("jammkle")


def interface(name: str) -> Any:
    """Class of an interface named as `package/msg/Name` or `package/srv/Name`."""
    package, folder, leaf = name.split("/")
    return getattr(import_module(f"{package}.{folder}"), leaf)


def environment(domain_id: int) -> dict[str, str]:
    """Environment in which a child sees only its own domain on this machine, and says where it was when aborted."""
    own = {"ROS_DOMAIN_ID": str(domain_id), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "PYTHONFAULTHANDLER": "1"}
    return {**os.environ, **own}


def cpu_s(process: psutil.Process) -> float:
    """Processor time that a process has taken, s."""
    times = process.cpu_times()
    return float(times.user + times.system)


@contextlib.contextmanager
def running(domain_id: int, *commands: Sequence[str]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Run Python with these arguments, a process each, while the block lasts."""
    processes = [subprocess.Popen([sys.executable, *each], env=environment(domain_id)) for each in commands]
    try:
        yield processes
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def messages_of(bag: Path, topic: str) -> list[Any]:
    """Every message of a topic of a bag, in order."""
    with AnyReader([bag]) as reader:
        connections = [each for each in reader.connections if each.topic == topic]
        if not connections:  # which the reader would take for all of them
            return []
        return [reader.deserialize(raw, each.msgtype) for each, _, raw in reader.messages(connections=connections)]


class Probe:
    """A node in the test process, in a context of its own, that subscribes to every topic of one namespace."""

    def __init__(self, domain_id: int, namespace: str = "") -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
        self.node: Node = rclpy.create_node("probe", namespace=namespace, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.received: dict[str, list[Any]] = defaultdict(list)
        self._clients: dict[str, Any] = {}
        self._ticked_s: float | None = None
        self.node.create_subscription(Clock, CLOCK.name, self._take_tick, subscriber_qos(CLOCK))

    def _take_tick(self, tick: Clock) -> None:
        self._ticked_s = tick.clock.sec + tick.clock.nanosec * 1e-9

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def listen(self, *topics: Topic) -> None:
        """Keep every message of these topics in `received`, by topic name."""
        for topic in topics:
            self.node.create_subscription(
                interface(topic.message_type),
                topic.name,
                self.received[topic.name].append,
                subscriber_qos(topic),
            )

    def publisher(self, topic: Topic) -> Any:
        """Publisher of `topic` with the project's own QoS."""
        return self.node.create_publisher(interface(topic.message_type), topic.name, publisher_qos(topic))

    def has(self, topic: Topic) -> bool:
        """Whether a message of `topic` was received."""
        return bool(self.received[topic.name])

    def last(self, topic: Topic) -> Any:
        """Latest message of `topic`; the first one is waited for."""
        self.spin_until(lambda: self.has(topic), f"{topic.name} is received")
        return self.received[topic.name][-1]

    def lines(self, name: str) -> list[DiagnosticStatus]:
        """Return every line on /diagnostics whose name ends so, in order."""
        received = (line for array in self.received[DIAGNOSTICS.name] for line in array.status)
        return [line for line in received if line.name.endswith(name)]

    def line(self, name: str) -> DiagnosticStatus:
        """Return the latest of them; an empty one where there is none."""
        return (self.lines(name) or [DiagnosticStatus()])[-1]

    def clock_s(self) -> float:
        """Simulated time of the latest tick of /clock that was listened to, s; the first one is waited for."""
        tick = self.last(CLOCK).clock
        return float(tick.sec + tick.nanosec * 1e-9)

    def spin_until(self, holds: Callable[[], bool], what: str, timeout_s: float = TIMEOUT_S) -> None:
        """Serve callbacks until `holds()`; fail with the last messages if it never does.

        Only the latest time that /clock has shown counts: two simulations that both make it must not add up.
        """
        waited_s, real_s = 0.0, time.monotonic()
        seen_s: float | None = None  # not what was shown before: time may have gone on while nobody looked
        latest_s: float | None = None
        while not holds():
            now_s, ticked_s = time.monotonic(), self._ticked_s
            if ticked_s is not None and ticked_s != seen_s:
                waited_s += 0.0 if latest_s is None else max(0.0, ticked_s - latest_s)
                latest_s = ticked_s if latest_s is None else max(ticked_s, latest_s)
                seen_s, real_s = ticked_s, now_s
            if waited_s > timeout_s or now_s - real_s > REAL_TIMEOUT_S:
                last = {name: messages[-1] for name, messages in self.received.items() if messages}
                msg = f"gave up waiting until {what}; last received: {last}"
                raise AssertionError(msg)
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, service: Service, **request: Any) -> Any:
        """Call a service and return its answer.

        What is not answered is asked for again, since a service drops an answer to a client that it has not quite found
        (rmw_fastrtps, issue 842); but for steps, which would be made twice.
        """
        kind = interface(service.service_type)
        if service.path not in self._clients:
            self._clients[service.path] = self.node.create_client(kind, service.path)
        client = self._clients[service.path]
        self.spin_until(client.service_is_ready, f"{service.path} is offered")
        asked_s, futures = time.monotonic(), [client.call_async(kind.Request(**request))]

        def answered() -> bool:
            nonlocal asked_s
            if service != STEP and time.monotonic() > asked_s + ANSWERED_WITHIN_S:
                asked_s = time.monotonic()
                futures.append(client.call_async(kind.Request(**request)))
            return any(each.done() for each in futures)

        self.spin_until(answered, f"{service.path} answers")
        return next(each.result() for each in futures if each.done())

    def channel_states(self) -> dict[str, int]:
        """State per channel as last received on jam_state; empty if none was received."""
        if not self.has(JAM_STATE):
            return {}
        return {channel.channel: channel.state for channel in self.last(JAM_STATE).channels}

    def wait_for_channels(self, state: int, *channels: str) -> None:
        """Wait until these channels (all, if none is named) report `state`."""
        wanted = channels or CHANNELS
        self.spin_until(
            lambda: all(self.channel_states().get(channel) == state for channel in wanted),
            f"{', '.join(wanted)} report state {state}",
        )

    def wait_until_jammed(self, also: Callable[[], bool] = lambda: True) -> None:
        """Wait until all is JAMMED, on a busy machine too, where the board lets go of a driver that is kept waiting.

        Args:
            also: What else must hold at that moment.

        """

        def jammed() -> bool:
            return set(self.channel_states().values()) == {ChannelJamState.JAMMED} and also()

        self.spin_jammed_until(jammed, "everything is jammed")

    def spin_jammed_until(self, holds: Callable[[], bool], what: str, *channels: str) -> None:
        """Spin until something holds, and jam these channels (all, if none is named) again whenever a board let go."""

        def holds_jammed() -> bool:
            if self.has(JAM_STATE) and self.last(JAM_STATE).fault.reason == Fault.BOARD_LET_GO:
                self.received[JAM_STATE.name].clear()
                self.call(JAM, channels=list(channels))
            return holds()

        self.spin_until(holds_jammed, what)

    def wait_until_up(self) -> None:
        """Wait until the driver has measured every channel."""
        self.spin_until(
            lambda: bool(self.channel_states()) and ChannelJamState.UNKNOWN not in self.channel_states().values(),
            "the driver knows every channel",
        )


class Up:
    """A `jammkle` process, with its output in files, so that a full pipe can never stop it."""

    def __init__(self, domain_id: int, folder: Path, *arguments: str) -> None:
        self.arguments = arguments
        self.output = folder / "stdout.txt"
        self.errors = folder / "stderr.txt"
        with self.output.open("w") as output, self.errors.open("w") as errors:
            self.process = subprocess.Popen(
                [COMMAND, *arguments], stdout=output, stderr=errors, cwd=folder, env=environment(domain_id)
            )

    def children(self) -> list[psutil.Process]:
        """Every process that it has started and that still runs."""
        return psutil.Process(self.process.pid).children(recursive=True)

    def child(self, package: str) -> psutil.Process:
        """The running process of one of the nodes, by its Python package."""
        return next(child for child in self.children() if package in child.cmdline())

    def stop(self, number: signal.Signals = signal.SIGINT) -> int:
        """Send a signal to it alone and return its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.wait()

    def wait(self, timeout_s: float = REAL_TIMEOUT_S) -> int:
        """Wait for its end and return the exit code; one that does not end says where it hangs."""
        try:
            return self.process.wait(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            self.process.send_signal(signal.SIGABRT)
            self.process.wait(timeout=timeout_s)
            msg = f"{self.arguments} did not end within {timeout_s:g} s: {self.text()}"
            raise AssertionError(msg) from None

    def text(self) -> str:
        """All it has printed so far."""
        return self.output.read_text() + self.errors.read_text()


@contextlib.contextmanager
def shared_graph(folder: Path, *arguments: str) -> Iterator[tuple[Up, Probe]]:
    """Bring a graph up in a domain of its own, and look on: for several tests that leave it as it is."""
    with pytest.MonkeyPatch.context() as patch, own_domain() as domain_id:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        up = Up(domain_id, folder, *arguments)
        probe = Probe(domain_id)
        try:
            probe.listen(JAM_STATE)
            probe.wait_until_up()
            yield up, probe
        finally:
            probe.close()
            exit_code = up.stop()
            sys.stdout.write(f"{up.arguments} ended with {exit_code}\n{up.text()}\n")
