"""The gap monitor's node: measurements and commands in, gap per subsystem out."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.node import Node
from std_msgs.msg import String

from jammkle_common import names
from jammkle_common.diagnostics import DiagnosticsPublisher
from jammkle_common.messages import Health, Level, message_class
from jammkle_common.parameters import declare
from jammkle_common.qos import patient_qos, publisher_qos, subscriber_qos
from jammkle_gap.ankle.bag import TAKERS
from jammkle_gap.ankle.inputs import known_options
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.monitor.conversions import (
    rig_of,
    sentence,
    simulator_gap_message,
    stamp_s,
    subsystem_health,
)
from jammkle_gap.monitor.parameters import FROM_THE_GRAPH, GapMonitorParameters
from jammkle_gap.monitor.twin import GapMonitor
from jammkle_msgs.msg import ActuatorStates, SimulatorGap

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from jammkle_common.runner import StopFlag

HARDWARE_ID = "ankle"
_NS = 1e-9
_COMMANDS = (names.PUMP_DUTY, *names.SOLENOIDS.values())
_MEASUREMENTS = (
    names.MANIFOLD_PRESSURE,
    *names.PRESSURES.values(),
    names.IMU,
    names.JOINT_STATES,
    names.TENDON_STATES,
)
_SERVE_S = 0.02
"""Real time for which callbacks are served where nothing is due."""
_SERVED_PER_SIMULATED = 1.0
"""Real time for which callbacks are served after a stretch, per time that it took. Chosen: the twin gets half of what
the machine gives at most, and falls behind before its inputs do; then it begins anew at the newest of them."""
_REPORT_PERIOD_S = 0.2
"""Real time between two messages on simulator_gap."""


class GapMonitorNode(Node):
    """Follows the robot of its namespace. `drive` drives it: callbacks only keep what they receive."""

    def __init__(self) -> None:
        """Make the node.

        Raises:
            ParameterError: an unknown parameter was given, or a value is out of range.

        """
        super().__init__(names.GAP_MONITOR_NODE, automatically_declare_parameters_from_overrides=True)
        self._values = declare(self, GapMonitorParameters)
        self._monitor: GapMonitor | None = None
        self._commands: dict[str, tuple[float, Any]] = {}
        self._acknowledged: ActuatorStates | None = None
        """What the hardware has last said that it drives; what the driver asks for then does not count."""
        self._newest_s = 0.0
        """Stamp of the measurement received last, s."""
        is_given = self._values.rig != FROM_THE_GRAPH
        self._wanted: tuple[str, dict[str, Any]] | None = (self._values.rig, {}) if is_given else None
        self._described: tuple[str, dict[str, Any]] | None = None
        self._trouble = f"no {names.SIM_PARAMETERS.name}: name what the robot stands in with the parameter rig"
        self._gap = self.create_publisher(SimulatorGap, names.SIMULATOR_GAP.name, publisher_qos(names.SIMULATOR_GAP))
        self._diagnostics = DiagnosticsPublisher(self, HARDWARE_ID, self._health)
        for topic in _COMMANDS:
            command = partial(self._take_command, topic.name)
            self.create_subscription(message_class(topic.message_type), topic.name, command, subscriber_qos(topic))
        for topic in _MEASUREMENTS:
            measured = partial(self._take_measurement, topic.name)
            self.create_subscription(message_class(topic.message_type), topic.name, measured, patient_qos(topic))
        self.create_subscription(
            ActuatorStates,
            names.ACTUATOR_STATES.name,
            self._take_acknowledgement,
            publisher_qos(names.ACTUATOR_STATES),  # reliable: one that is lost leaves the air wrong until the next vent
        )
        if not is_given:
            self.create_subscription(
                String, names.SIM_PARAMETERS.name, self._take_description, subscriber_qos(names.SIM_PARAMETERS)
            )

    def drive(self, executor: Executor, stop: StopFlag) -> None:
        """Run until asked to stop: one stretch of one subsystem, a few milliseconds, then callbacks.

        Reports are made here and not by a timer, whose callback would wait behind every message that came before it.
        """
        report_s = time.monotonic()
        while not stop:
            begin_s = time.monotonic()
            simulated = self._advance()
            end_s = time.monotonic()
            end_s += (end_s - begin_s) * _SERVED_PER_SIMULATED if simulated else _SERVE_S
            executor.spin_once(timeout_sec=0.0)
            while not stop and (left_s := end_s - time.monotonic()) > 0.0:
                executor.spin_once(timeout_sec=left_s)
            if (now_s := time.monotonic()) >= report_s:
                report_s = max(report_s + _REPORT_PERIOD_S, now_s)  # those that were missed are not made up for
                self._report()

    def shut_down(self) -> None:
        """Say that this node ends in order."""
        self._diagnostics.farewell()

    def _advance(self) -> bool:
        """Do the next portion of work, if there is one."""
        if self._wanted is not None:
            self._described, self._wanted = self._wanted, None
            self._build(*self._described)
        return self._monitor is not None and self._monitor.advance(self._now_s())

    def _now_s(self) -> float:
        """Return the time by which measurements are missed, s: simulated, or of the machine's steady clock."""
        clock = self.get_clock()
        return float(clock.now().nanoseconds) * _NS if clock.ros_time_is_active else time.monotonic()

    def _build(self, rig: str, options: dict[str, Any]) -> None:
        """Make the twin anew: part of a second, between two callbacks, whenever the rig changes."""
        try:
            self._monitor = GapMonitor(rig, known_options(rig, options), self._values)
        except BadRecordingError as error:
            self._monitor, self._trouble = None, str(error)
            self.get_logger().error(self._trouble)
        # A driver that speaks up on changes alone has said long ago what still holds.
        for topic, (time_s, message) in self._commands.items():
            self._forward(topic, time_s, message)
        if self._acknowledged is not None:
            self._take_acknowledgement(self._acknowledged)

    def _take_command(self, topic: str, message: Any) -> None:
        # Messages come in the order in which they were sent. The time at which a callback is served is later by all
        # that is done meanwhile, and would take several commands for one.
        if self._acknowledged is not None:
            return
        time_s = self._newest_s
        self._commands[topic] = (time_s, message)
        self._forward(topic, time_s, message)

    def _take_acknowledgement(self, message: ActuatorStates) -> None:
        last, self._acknowledged = self._acknowledged or message, message
        self._commands.clear()
        if (last.plant_restarts, last.plant_paused) != (message.plant_restarts, message.plant_paused):
            self._wanted = self._wanted or self._described  # a simulated robot has jumped, or was left out of time
        if self._monitor is not None:
            commands = TAKERS[names.ACTUATOR_STATES.name](message)
            self._monitor.take_acknowledged(stamp_s(message), commands, self._now_s())

    def _take_measurement(self, topic: str, message: Any) -> None:
        self._newest_s = stamp_s(message)
        self._forward(topic, self._newest_s, message)

    def _forward(self, topic: str, time_s: float, message: Any) -> None:
        if self._monitor is not None:
            self._monitor.take(topic, time_s, TAKERS[topic](message), self._now_s())

    def _take_description(self, message: String) -> None:
        rig, options = rig_of(message.data)
        if rig:
            self._wanted = (rig, options)
        else:
            self._trouble = f"{names.SIM_PARAMETERS.name} names no rig: set the parameter rig"

    def _report(self) -> None:
        reports = [] if self._monitor is None else self._monitor.reports(self._now_s())
        texts = [sentence(each) for each in reports]
        stamp = self.get_clock().now().to_msg()
        self._gap.publish(simulator_gap_message(stamp, self._values.limit, reports, texts))
        self._diagnostics.check()

    def _health(self) -> list[Health]:
        if self._monitor is None:
            return [Health("twin", Level.STALE, self._trouble)]
        reports = self._monitor.reports(self._now_s())
        return [subsystem_health(each, self._values.limit) for each in reports]
