"""Health of a node on /diagnostics: on change, and at 1 Hz of the graph's time and of the machine's steady clock.

Of both, since others count a node's silence in the time that they live in, and people look on while that stands still.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration

from jammkle_common.health import Health, Level, diagnostic_array
from jammkle_common.lockstep import LockstepNode
from jammkle_common.names import DIAGNOSTICS
from jammkle_common.qos import publisher_qos

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from builtin_interfaces.msg import Time
    from rclpy.node import Node

PERIOD_S = 1.0
_OVERDUE_S = 1.5 * PERIOD_S
"""Age of the last report from which on `check` does not wait for the timer. Chosen: well before others call it silence,
and later than any timer that is on time."""

_MOSTLY = 0.9
"""Share of the period since the last report from which the timer reports again; it need not come when another has."""

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
        stamp: Callable[[], Time] | None = None,
    ) -> None:
        """Start publishing for `node`.

        Args:
            node: Whose health it is.
            hardware_id: What the health is about, as in diagnostic_msgs.
            report: Gives the health; called on every tick and by `check`.
            stamp: Gives the graph's time; None takes the node's clock, which a node that makes the time lacks.

        """
        self._node = node
        self._stamp = stamp if stamp is not None else lambda: node.get_clock().now().to_msg()
        self._hardware_id = hardware_id
        self._report = report
        self._last: tuple[tuple[str, Level, str], ...] = ()
        self._sent_s = time.monotonic()
        self._due_s = PERIOD_S
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS.name, publisher_qos(DIAGNOSTICS))
        # A timer on simulated time stands still when /clock does, and so would the report that says so.
        self._timer = node.create_timer(PERIOD_S, self._publish_if_due, clock=Clock(clock_type=ClockType.STEADY_TIME))
        if isinstance(node, LockstepNode) and node.lives_in_simulated_time:
            node.every(PERIOD_S, self.publish)

    def check(self) -> None:
        """Publish now if a level or a message has changed since the last report, or if the timer is overdue.

        On a node that does not keep up, the timer's callback waits behind those of all messages before it.
        """
        health = self._report()
        if _signature(health) != self._last or time.monotonic() - self._sent_s >= _OVERDUE_S:
            self._send(health)

    def at(self, time_s: float) -> None:
        """Publish once in each second of a time that the node makes itself."""
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
        self._last, self._sent_s = _signature(health), time.monotonic()
        name = self._node.get_fully_qualified_name()
        self._publisher.publish(diagnostic_array(self._stamp(), name, self._hardware_id, health))


def _signature(health: Sequence[Health]) -> tuple[tuple[str, Level, str], ...]:
    return tuple((line.about, line.level, line.message) for line in health)
