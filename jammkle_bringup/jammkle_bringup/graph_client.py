"""A short-lived node of the command: looks at the graph, subscribes, and calls services.

It also finds other graphs. Each new participant of DDS finds every other one by itself, most within 0.2 s, some only
with the next announcement, 3 s later. In 80 looks at a running graph by three participants or four, on a machine with
four times as much work as cores, one had not found any of its three nodes after a second, and three lacked one of them.
So several look together for a second, and look on after the own nodes were started, until DISCOVERY_S have passed.
"""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from jammkle_common.command.errors import GraphError, InputError, Interrupted
from jammkle_common.messages import COMMANDS_LINE
from jammkle_common.names import (
    CLOCK,
    CONTROLLER_NODE,
    DIAGNOSTICS,
    DRIVER_NODE,
    PUMP_DUTY,
    SIM_NODE,
    relative,
    resolved,
)
from jammkle_common.qos import node_at, subscriber_qos

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence
    from types import TracebackType

    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.topic_endpoint_info import TopicEndpointInfo
    from typing_extensions import Self

    from jammkle_common.names import Topic

ANSWER_TIMEOUT_S = 5.0
"""How long the command waits for the graph. Assumed; discovery on one machine takes about 0.3 s."""

_AGAIN_AFTER_S = 1.0
"""When a request is repeated that nobody answered. A service that has found a client's requests, but not yet its end
for answers, drops an answer after 0.1 s (rmw_fastrtps, issue 842); what discovery lost is repeated within some 3 s."""

_SPIN_S = 0.05
_MOST_AT_ONCE = 100
"""Callbacks that are served of what has been received; more than a fraction of a second of events and states."""

DISCOVERY_S = 3.5
"""How long to look for other nodes. They are seen after 0.15 s as a rule, but at times only with their next
announcement, which the DDS of ROS 2 (Fast DDS) sends every 3 s."""


COMMAND_NODE = "jammkle_command"
"""Begin of the names of nodes of the command."""


class GraphClient:
    """Context manager around a node without parameters or services of its own."""

    def __init__(self, namespace: str, asked_to_stop: Callable[[], bool], lookers: int = 1) -> None:
        """Prepare.

        Args:
            namespace: Normalised namespace that relative names are put into.
            asked_to_stop: Ends every wait with `Interrupted` once it returns True.
            lookers: Participants that look at the graph, each of which finds others by itself.

        """
        self.namespace = namespace
        self._asked_to_stop = asked_to_stop
        self._more = max(0, lookers - 1)

    def __enter__(self) -> Self:
        """Join the graph."""
        name = f"{COMMAND_NODE}_{os.getpid()}"
        self.node = self._joined(name)
        self._lookers = [self.node, *(self._joined(f"{name}_{number}") for number in range(self._more))]
        self._executor = SingleThreadedExecutor(context=self.node.context)
        self._executor.add_node(self.node)
        return self

    def _joined(self, name: str) -> Node:
        context = rclpy.Context()
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        return rclpy.create_node(
            name,
            context=context,
            namespace=self.namespace,
            enable_rosout=False,
            start_parameter_services=False,
        )

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        for node in self._lookers:
            node.destroy_node()
            rclpy.try_shutdown(context=node.context)

    def subscribe(self, kind: type[Any], topic: Topic, take: Callable[[Any], None], qos: QoSProfile) -> None:
        """Call `take` with every message of a topic while waiting for something."""
        self.node.create_subscription(kind, resolved(self.namespace, topic.name), take, qos)

    def wait_until(self, predicate: Callable[[], bool], timeout_s: float) -> bool:
        """Serve callbacks until `predicate` holds (True) or the time is up (False).

        Raises:
            Interrupted: the command was asked to stop.

        """
        end_s = time.monotonic() + timeout_s
        while not predicate():
            if self._asked_to_stop():
                raise Interrupted
            left_s = end_s - time.monotonic()
            if left_s <= 0:
                return False
            self._executor.spin_once(timeout_sec=min(_SPIN_S, left_s))
        return True

    def take_what_came(self) -> None:
        """Serve callbacks of all that has been received already."""
        for _ in range(_MOST_AT_ONCE):
            self._executor.spin_once(timeout_sec=0.0)

    def call(self, path: str, kind: type[Any], request: Any, timeout_s: float = ANSWER_TIMEOUT_S) -> Any:
        """Call a service by its name relative to the namespace, and return its answer.

        A request that is not answered is repeated each second: it must be one that does no more when it is made twice.

        Raises:
            GraphError: the service is not there, or does not answer.
            Interrupted: the command was asked to stop.

        """
        name = resolved(self.namespace, path)
        client = self.node.create_client(kind, name)
        try:
            if not self.wait_until(client.service_is_ready, timeout_s):
                raise GraphError(self.no_answer(name, timeout_s))
            end_s = time.monotonic() + timeout_s
            futures: list[Any] = []
            while (left_s := end_s - time.monotonic()) > 0:
                futures.append(client.call_async(request))
                if self.wait_until(lambda: any(each.done() for each in futures), min(_AGAIN_AFTER_S, left_s)):
                    return next(each.result() for each in futures if each.done())
            msg = f"{name} did not answer within {timeout_s:g} s"
            raise GraphError(msg)
        finally:
            self.node.destroy_client(client)

    def call_each(self, ankles: Sequence[str], path: str, kind: type[Any], request: Any) -> dict[str, Any]:
        """Call a service of every ankle, though one does not answer, and return the answers by ankle.

        Raises:
            GraphError: one did not answer, once all others were asked.
            Interrupted: the command was asked to stop.

        """
        answers, silent = {}, []
        for ankle in ankles:
            try:
                answers[ankle] = self.call(below(ankle, path), kind, request)
            except GraphError as error:  # noqa: PERF203 - each by itself
                silent.append(str(error))
        if silent:
            raise GraphError("; ".join(silent))
        return answers

    def ankles(self, on_seen: Callable[[str], None] = lambda _: None) -> tuple[str, ...]:
        """Return the namespaces, below the client's own, of the ankles that there are; the one in that is empty.

        A robot's ankles are one level below. None may be missed, so as long as it is looked as discovery takes, or
        until those are seen that the robot's simulation names, all in one message, on /diagnostics.

        Args:
            on_seen: Called once for each namespace when it is first seen, while others are still looked for.

        Raises:
            GraphError: none is seen.
            Interrupted: the command was asked to stop.

        """
        known: set[str] = set()

        def seen() -> set[str]:
            ankles = self._ankles()
            for ankle in sorted(ankles - known):
                known.add(ankle)
                on_seen(ankle)
            return ankles

        if not self.wait_until(lambda: bool(seen()), ANSWER_TIMEOUT_S):
            raise GraphError(self.no_answer(DRIVER_NODE))
        simulation = resolved(self.namespace, SIM_NODE)
        simulated: set[str] = set()

        def on_health(array: DiagnosticArray) -> None:
            for line in array.status:
                node, _, what = line.name.partition(": ")
                if node == simulation and what.endswith(COMMANDS_LINE):
                    simulated.add(what.removesuffix(COMMANDS_LINE))

        subscription = self.node.create_subscription(
            DiagnosticArray, DIAGNOSTICS.name, on_health, subscriber_qos(DIAGNOSTICS)
        )
        self.wait_until(lambda: "" in seen() or (bool(simulated) and simulated <= known), DISCOVERY_S)
        self.node.destroy_subscription(subscription)
        ankles = seen()
        return ("",) if "" in ankles else tuple(sorted(ankles))

    def no_answer(self, what: str, timeout_s: float = ANSWER_TIMEOUT_S) -> str:
        """Return the line for a node, a topic or a service that is not there, with what is there instead."""
        text = f"nothing answers on {what} within {timeout_s:g} s "
        text += f"(namespace {self.namespace}, ROS domain {ros_domain()}): "
        there = sorted(name for name in self.nodes() if relative(self.namespace, name) is not None)
        drivers = [name for name in there if name.endswith(f"/{DRIVER_NODE}")]
        if drivers:
            text += f"{drivers[0]} is on the graph, but was killed, or is not configured: start it anew, or "
            return f"{text}`ros2 lifecycle set {drivers[0]} configure` and `activate`"
        others = [name for name in there if name.endswith((f"/{CONTROLLER_NODE}", f"/{SIM_NODE}"))]
        if others:
            return f"{text}{' and '.join(others)} run without a driver: start one, or all with `jammkle up`"
        return f"{text}start the graph with `jammkle up`, or give its --namespace or ROS_DOMAIN_ID"

    def _ankles(self) -> set[str]:
        """Return what is seen so far: every ankle has a pump, which a driver commands and a simulation may follow."""
        found = set()
        for name, _ in self.node.get_topic_names_and_types():
            inside = relative(self.namespace, name) or ""
            place = inside.removesuffix(PUMP_DUTY.name).rstrip("/")
            if not inside.endswith(PUMP_DUTY.name) or "/" in place:
                continue
            publishers = {end.node_name for end in self.node.get_publishers_info_by_topic(name)}
            subscribers = {end.node_name for end in self.node.get_subscriptions_info_by_topic(name)}
            if DRIVER_NODE in publishers or SIM_NODE in subscribers:
                found.add(place)
        return found

    def nodes(self) -> set[str]:
        """Return the full names of all nodes seen so far."""
        return set().union(*self._seen())

    def count(self, full_name: str) -> int:
        """Return how many nodes of a full name are seen."""
        return max(names.count(full_name) for names in self._seen())

    def _seen(self) -> list[list[str]]:
        return [
            [resolved(namespace, name) for name, namespace in node.get_node_names_and_namespaces()]
            for node in self._lookers
        ]

    def publishers(self, topic: str) -> list[TopicEndpointInfo]:
        """Return the publishers of a topic, by its absolute name, as that participant knows them that sees most."""
        return max((node.get_publishers_info_by_topic(topic) for node in self._lookers), key=len)

    def subscriptions(self, topic: str) -> list[TopicEndpointInfo]:
        """Return the subscriptions of a topic, as `publishers` does."""
        return max((node.get_subscriptions_info_by_topic(topic) for node in self._lookers), key=len)


def below(ankle: str, path: str) -> str:
    """Return a name of an ankle as seen from the graph's namespace, where that of the ankle may be the same: empty."""
    return f"{ankle}/{path}" if ankle else path


def ros_domain() -> str:
    """Return the ROS domain of this process, as text."""
    return os.environ.get("ROS_DOMAIN_ID") or "0"


LOOKERS = 3
"""Participants that look together."""

LOOK_S = 1.0
"""How long they look before nodes of a simulation are started."""


def refuse_if_there(client: GraphClient, names: Collection[str], look_s: float) -> str:
    """Look for nodes of these names, for so long, and for a /clock; return who publishes that, empty if nobody does.

    Raises:
        InputError: one of the nodes is there already.
        Interrupted: the command was asked to stop.

    """
    client.wait_until(lambda: any(client.count(name) for name in names), look_s)
    there = sorted(name for name in names if client.count(name))
    if there:
        who = f"node {', '.join(there)}; one that was killed is seen for 20 s more"
        raise InputError(_already_up(client.namespace, who))
    clocks = client.publishers(CLOCK.name)
    return (node_at(clocks[0]) or _NOT_KNOWN) if clocks else ""


_NOT_KNOWN = "a node that is not known yet"


def refuse_if_doubled(client: GraphClient, names: Collection[str], *, makes_clock: bool) -> None:
    """Refuse to go on beside nodes of the same name, or another /clock, that came up late or were started together.

    Raises:
        InputError: as said.

    """
    doubled = sorted(name for name in names if client.count(name) > 1)
    if doubled:
        raise InputError(_already_up(client.namespace, f"a second node {', '.join(doubled)}"))
    clocks = [node_at(each) or _NOT_KNOWN for each in client.publishers(CLOCK.name)]
    if makes_clock and len(clocks) > 1:
        msg = f"{CLOCK.name} comes from {' and '.join(sorted(clocks))}, which were started together: start one graph "
        msg += "after the other, so that the second takes the time of the first"
        raise InputError(msg)


def _already_up(namespace: str, who: str) -> str:
    return (
        f"a graph is already up in namespace {namespace} of ROS domain {ros_domain()} ({who}): "
        "stop it first, or choose another --namespace or ROS_DOMAIN_ID"
    )
