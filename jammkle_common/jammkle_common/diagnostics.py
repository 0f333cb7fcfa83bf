"""Health of the nodes on /diagnostics: each reports its own, and notices whose reports stop.

A report comes on change, and at 1 Hz of the graph's time and of the machine's steady clock.

Of both, since others count a node's silence in the time that they live in, and people look on while that stands still.
"""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.serialization import deserialize_message

from jammkle_common.lockstep import LockstepNode
from jammkle_common.messages import Health, Level, diagnostic_array
from jammkle_common.names import (
    CONTROLLER_NODE,
    DIAGNOSTICS,
    DRIVER_NODE,
    GAP_MONITOR_NODE,
    RECORDER_NODE,
    SIM_NODE,
)
from jammkle_common.qos import publisher_qos, subscriber_qos

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from rclpy.node import Node

PERIOD_S = 1.0
_OVERDUE_S = 1.5 * PERIOD_S
"""Age of the last report from which on `check` does not wait for the timer. Chosen: well before others call it silence,
and later than any timer that is on time."""

_MOSTLY = 0.9
"""Share of the period since the last report from which the timer reports again; it need not come when another has."""

_FIRST_TICK_WITHIN_S = 2.0 * PERIOD_S
"""How long a node that knows no time yet keeps its reports to itself, s of real time: who makes /clock repeats it twice
a second, and is discovered in 0.2 s as a rule. Without /clock the reports that say so must come."""

FAREWELL = ": stopped"
"""End of the name under which a node that is stopped in order reports for the last time."""

_FAREWELL_TIMEOUT_S = 0.2


class DiagnosticsPublisher:
    """Publishes what `report` returns, once a second and whenever a level or message changes."""

    def __init__(
        self,
        node: Node,
        hardware_id: str,
        report: Callable[[], Sequence[Health]],
        stamp: Callable[[], Time | None] | None = None,
    ) -> None:
        """Start publishing for `node`.

        Args:
            node: Whose health it is.
            hardware_id: What the health is about, as in diagnostic_msgs.
            report: Gives the health; called on every tick and by `check`.
            stamp: Gives the graph's time, or None as long as that is not known; without it the node's clock gives it,
                which a node that makes the time lacks.

        """
        self._node = node
        self._stamp = stamp if stamp is not None else partial(_time_of, node)
        self._hardware_id = hardware_id
        self._report = report
        self._last: tuple[tuple[str, Level, str], ...] = ()
        self._made_s = self._sent_s = time.monotonic()
        self._due_s = PERIOD_S
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS.name, publisher_qos(DIAGNOSTICS))
        # A timer on simulated time stands still when /clock does, and so would the report that says so.
        self._timer = node.create_timer(PERIOD_S, self._publish_if_due, clock=Clock(clock_type=ClockType.STEADY_TIME))
        if isinstance(node, LockstepNode) and node.lives_in_simulated_time:
            node.at_first_tick(self.publish)
            node.every(PERIOD_S, self.publish)

    def check(self) -> None:
        """Publish now if a level or a message has changed since the last report, or if the timer is overdue.

        On a node that does not keep up, the timer's callback waits behind those of all messages before it.
        """
        health = self._report()
        if _signature(health) != self._last or time.monotonic() - self._sent_s >= _OVERDUE_S:
            self._send(health)

    def at(self, time_s: float) -> None:
        """Publish once in each second of a time that the node makes itself, or that it follows by its ticks."""
        if not self._due_s - PERIOD_S <= time_s < self._due_s:
            self._due_s = (time_s // PERIOD_S + 1.0) * PERIOD_S
            self.publish()

    def _publish_if_due(self) -> None:
        if time.monotonic() - self._sent_s >= _MOSTLY * PERIOD_S:
            self.publish()

    def publish(self) -> None:
        """Publish now."""
        self._send(self._report())

    def farewell(self) -> None:
        """Say that this node is being stopped in order."""
        self._timer.cancel()
        self._send([Health(FAREWELL.removeprefix(": "), Level.STALE, "stopped in order")])
        self._publisher.wait_for_all_acked(Duration(seconds=_FAREWELL_TIMEOUT_S))

    def _send(self, health: Sequence[Health]) -> None:
        stamp, now_s = self._stamp(), time.monotonic()
        if stamp is None and now_s - self._made_s < _FIRST_TICK_WITHIN_S:
            return
        self._last, self._sent_s = _signature(health), now_s
        name = self._node.get_fully_qualified_name()
        self._publisher.publish(diagnostic_array(stamp or Time(), name, self._hardware_id, health))


def _time_of(node: Node) -> Time | None:
    is_known = not isinstance(node, LockstepNode) or node.knows_time
    return node.get_clock().now().to_msg() if is_known else None


def _signature(health: Sequence[Health]) -> tuple[tuple[str, Level, str], ...]:
    return tuple((line.about, line.level, line.message) for line in health)


CLOCK_MISSED_AFTER_S = 5.0
"""Silence of /clock, s of real time, after which its maker is reported missing.

A simulation that is paused, or waits for somebody, repeats it twice a second. Chosen so long that no busy machine comes
to it; nothing but this report hangs on it.
"""

MISSED_AFTER_S = 2.5 * PERIOD_S
"""Silence of a node after which it is missed, s: two reports that did not come."""

LIVENESS_LINE = ": nodes"
"""End of the name of the line that says whose reports a node receives."""

SILENT_FOR = ", silent for (s)"
"""End of each key of that line; before it stands the node's name."""

MEANING = {
    DRIVER_NODE: "nobody drives pump and solenoids; the board lets go 0.2 s after its last word, and the ankle is soft",
    CONTROLLER_NODE: "nobody decides on jamming; the driver lets go of what jam_command jammed after command_timeout_s",
    SIM_NODE: "there is no ankle any more; pressures and IMU are silent, and simulated time stands still",
    GAP_MONITOR_NODE: "nobody compares the robot with its simulator; the ankle is not affected",
    RECORDER_NODE: "nothing is recorded any more; the ankle is not affected",
}
"""What the death of each node means for the ankle."""

_ONLOOKERS = {GAP_MONITOR_NODE, RECORDER_NODE}
"""Nodes without which the ankle does all that it did."""


def reporting(line: str, values: Mapping[str, str]) -> dict[str, float]:
    """Return whose reports a node receives, by full name, with how long each has been silent, s.

    Args:
        line: Full name of its line `nodes`.
        values: What that line lists.

    """
    place = line.rpartition("/")[0]
    nodes = {key.removesuffix(SILENT_FOR): float(silent_s) for key, silent_s in values.items() if SILENT_FOR in key}
    return {node if node.startswith("/") else f"{place}/{node}": silent_s for node, silent_s in nodes.items()}


class Liveness:
    """Listens to the reports of all nodes that concern a node's own ankle, or the ankles that it simulates.

    Those are the nodes in its own namespace, and for an ankle of a simulated robot the simulation above it, which names
    each of its ankles in its report (`/sim: lf_ankle tendons`).
    """

    def __init__(
        self, node: Node, ankles: Collection[str] | None = (), now_s: Callable[[], float] | None = None
    ) -> None:
        """Listen for a node.

        Args:
            node: Whose line it is.
            ankles: Namespaces below the node's own of the ankles that it simulates; none: its own is the only one;
                None: all that there are.
            now_s: The time that the node lives in, s; None: it knows that itself, or it is the steady clock.

        """
        self._node = node if isinstance(node, LockstepNode) else None
        self._now_s = now_s or (time.monotonic if self._node is None else self._node.now_s)
        namespace = node.get_namespace().rstrip("/")
        self._prefix = f"{namespace}/"
        self._own = node.get_name()
        self._ankles = None if ankles is None else frozenset(ankles)
        above, _, ankle = namespace.rpartition("/")
        self._robot_sim = f"{above}/{SIM_NODE}" if ankle and self._own != SIM_NODE else ""
        self._of_this_ankle = f"{self._robot_sim}: {ankle} "
        self._marks = [mark.encode() for mark in (self._prefix, self._robot_sim) if mark]
        self._last_s: dict[str, float] = {}
        self._clock_missed = False
        self._looked_s = self._now_s()
        node.create_subscription(
            DiagnosticArray, DIAGNOSTICS.name, self._take_bytes, subscriber_qos(DIAGNOSTICS), raw=True
        )

    def health(self) -> Health:
        """Return one line: who is there, and who is missed."""
        about, now_s = LIVENESS_LINE.removeprefix(": "), self._now_s()
        silent_s = 0.0 if self._node is None else self._node.clock_silent_s
        if silent_s > CLOCK_MISSED_AFTER_S:
            text = f"/clock has not ticked for {silent_s:.0f} s of real time: who makes it is dead or hangs. "
            text += "Watchdogs, and simulations that follow it, stand still"
            if self._node is not None and self._node.knows_time and not self._clock_missed:
                self._node.get_logger().error(text)  # its maker may be of another command, whose terminal says it
                self._clock_missed = True
            return Health(about, Level.ERROR, text)
        self._clock_missed = False
        alive = self.alive()
        silent = {name: now_s - last_s for name, last_s in sorted(self._last_s.items())}
        missed = [name for name in silent if name not in alive]
        values = {f"{name}{SILENT_FOR}": f"{silence_s:.1f}" for name, silence_s in silent.items()}
        if not missed:
            return Health(about, Level.OK, f"all there: {', '.join(sorted([self._own, *silent]))}", values)
        kinds = {name: name.rpartition("/")[2] for name in missed}
        texts = [f"{name} is dead or hangs: {MEANING.get(kind, 'not one of ours')}" for name, kind in kinds.items()]
        level = Level.WARN if set(kinds.values()) <= _ONLOOKERS else Level.ERROR
        return Health(about, level, "; ".join(texts), values)

    def alive(self) -> frozenset[str]:
        """Return the nodes whose reports come in, by name without the own namespace; ask once a second or oftener."""
        now_s = self._now_s()
        # Who stood still itself has received nothing, and has nobody to blame for it.
        since_s = now_s - self._looked_s
        if since_s > 1.5 * PERIOD_S:
            self._last_s = {name: last_s + since_s for name, last_s in self._last_s.items()}
        elif since_s < 0.0:  # the clock was set back
            self._last_s = {name: min(last_s, now_s) for name, last_s in self._last_s.items()}
        self._looked_s = now_s
        return frozenset(name for name, last_s in self._last_s.items() if now_s - last_s <= MISSED_AFTER_S)

    def _take_bytes(self, serialized: bytes) -> None:
        """Read reports in which a name is found alone: to read one costs as much as ten samples of an IMU."""
        if any(mark in serialized for mark in self._marks):
            self._take(deserialize_message(serialized, DiagnosticArray))

    def _take(self, array: DiagnosticArray) -> None:
        for status in array.status:
            name = self._known_as(status.name)
            if not name:
                continue
            if status.name.endswith(FAREWELL):
                self._last_s.pop(name, None)
            else:
                self._last_s[name] = self._now_s()

    def _known_as(self, line: str) -> str:
        """Return what a line's node is called here, without the own namespace; empty where it does not concern us."""
        node = line.partition(":")[0]
        if self._robot_sim and node == self._robot_sim:
            return node if node in self._last_s or line.startswith(self._of_this_ankle) else ""
        if not node.startswith(self._prefix):
            return ""
        name = node.removeprefix(self._prefix)
        place = name.rpartition("/")[0]
        known = not place or self._ankles is None or place in self._ankles
        return name if known and name != self._own else ""
