"""What is driven: hardware by its name, and the hardware that lives in this process or on topics."""

from __future__ import annotations

import dataclasses
import math
import random
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import FluidPressure

from jammkle_common import wire
from jammkle_common.command import HARDWARE, entries
from jammkle_common.command.errors import InputError
from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_ATMOSPHERE_PA
from jammkle_common.names import ACTUATOR_STATES, MANIFOLD_PRESSURE, PRESSURES, frame
from jammkle_common.parameters import ParameterError
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_driver.conversions import (
    actuator_states_message,
    measured_pressure,
    pressure_message,
    pressure_sample,
    seconds,
    stamp_seconds,
)
from jammkle_driver.core.hardware import MANIFOLD, ActuatorCommand, LinkState, LinkStatus, PressureSample, SafeCause
from jammkle_driver.fake import STEP_S, WATCHDOG_S, FakeBoard, FakePlant, read_script
from jammkle_msgs.msg import ActuatorStates

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from collections.abc import Set as AbstractSet

    from rclpy.node import Node

    from jammkle_driver.core.hardware import Hardware
    from jammkle_driver.fake import ScriptedFault
    from jammkle_driver.parameters import DriverParameters


@dataclass(frozen=True)
class HardwareContext:
    """What an implementation of `Hardware` is made from.

    Attributes:
        node: The driver's node, for topics and the graph's clock.
        take: Takes one pressure sample; to be called from the node's own thread.
        driven: Takes what the hardware says that it drives, and since when, s, or that it still does then, on the clock
            of the samples; from the node's own thread, with every change and at least 20 times a second. Readings
            count as evidence of a fault for as long as that is known. Hardware that never calls it is taken to do
            what `Hardware.apply` is given the moment that it is.
        parameters: The driver's parameters as they were when it was configured; `port`, `board_file` and `safe_state`
            are for the hardware alone.
        ambient_pa: Returns what is declared of the atmosphere now, Pa; sensors of vacuum count from it, and it may
            change while the node runs.

    """

    node: Node
    take: Callable[[PressureSample], None]
    driven: Callable[[ActuatorCommand, float], None]
    parameters: DriverParameters
    ambient_pa: Callable[[], float]


def checked_hardware(parameters: DriverParameters) -> Callable[[HardwareContext], Hardware]:
    """Return what makes the hardware that the parameter `hardware` names.

    Raises:
        ParameterError: no installed package knows the name, or the hardware does not take these parameters.

    """
    name, known = parameters.hardware, entries(HARDWARE)
    if name not in known:
        msg = f"parameter 'hardware' is '{name}'; it must be one of {', '.join(known)} (entry points of {HARDWARE})"
        raise ParameterError(msg)
    make: Callable[[HardwareContext], Hardware] = known[name].load()
    check = getattr(make, "check", None)
    if check is not None:
        check(parameters)
    return make


_PRESSURE_TOPICS = {**PRESSURES, MANIFOLD: MANIFOLD_PRESSURE}


class Measured:
    """Pressures and what the outputs do, from hardware to driver and graph."""

    def __init__(self, context: HardwareContext, places: Iterable[str]) -> None:
        """Create the publishers; `places` are the channels, and the manifold, that have a pressure sensor."""
        self._context = context
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        node, topics = context.node, {place: _PRESSURE_TOPICS[place] for place in places}
        self._pressures = {
            place: node.create_publisher(FluidPressure, topic.name, publisher_qos(topic))
            for place, topic in topics.items()
        }
        self._taken = node.create_publisher(ActuatorStates, ACTUATOR_STATES.name, publisher_qos(ACTUATOR_STATES))
        self._closed = False

    def publish(
        self,
        pressures_pa: Mapping[str, float],
        taken: ActuatorCommand | None,
        counted: AbstractSet[str] = frozenset(),
        *,
        at_s: float | None = None,
        timely: bool = True,
    ) -> None:
        """Publish and hand over what was measured; to be called from the node's own thread. Once closed: nothing.

        Args:
            pressures_pa: Readings by place, Pa absolute; one that is not finite is not published.
            taken: What the outputs do; None: not known.
            counted: Places whose sensor measures vacuum, counted here from `HardwareContext.ambient_pa`.
            at_s: When that was, s of the steady clock, wherever it has waited since; None: just now.
            timely: Whether that is as sure as usual: else it is no evidence of a fault.

        """
        if self._closed:  # rclpy calls a timer that is destroyed once more, where it was due just then
            return
        node = self._context.node
        now, steady_s = node.get_clock().now(), seconds(self._steady.now())
        if at_s is not None:
            late_ns = round((steady_s - at_s) * NANOSECONDS_PER_SECOND)
            now, steady_s = now - Duration(nanoseconds=min(late_ns, now.nanoseconds)), at_s  # a clock may begin at zero
        if taken is not None:
            self._taken.publish(actuator_states_message(taken, now.to_msg()))
            if timely:
                self._context.driven(taken, steady_s)
        for place, pressure_pa in pressures_pa.items():
            if math.isfinite(pressure_pa):
                message = pressure_message(pressure_pa, now.to_msg(), frame(node.get_namespace(), place))
                self._pressures[place].publish(message)
            self._context.take(PressureSample(place, pressure_pa, steady_s, place in counted, timely))

    def close(self) -> None:
        """Destroy the publishers."""
        for publisher in (*self._pressures.values(), self._taken):
            self._context.node.destroy_publisher(publisher)
        self._closed = True


_CONNECTED = LinkStatus(LinkState.CONNECTED, "topics of the simulation")


class SimulatedHardware:
    """Hands over the pressures that the simulation publishes. Implements `core.hardware.Hardware`.

    Its link is always connected: whether the simulation is there is seen by its pressures; it lets go as a board does.
    """

    def __init__(self, context: HardwareContext) -> None:
        """Subscribe to every pressure, and to what the outputs do."""
        self._context = context
        self.link = _CONNECTED
        node = context.node
        self._subscriptions = []
        for place, topic in _PRESSURE_TOPICS.items():
            take, qos = partial(self._on_pressure, place), subscriber_qos(topic)
            self._subscriptions.append(node.create_subscription(FluidPressure, topic.name, take, qos, raw=True))
        taken, qos = ACTUATOR_STATES.name, subscriber_qos(ACTUATOR_STATES)
        self._subscriptions.append(node.create_subscription(ActuatorStates, taken, self._on_taken, qos))

    def apply(self, command: ActuatorCommand) -> None:
        """Do nothing: the driver publishes its commands whatever the hardware, and the simulation listens to them."""

    def acknowledge(self) -> None:
        """Do nothing: the simulated board takes jams again once it was commanded to release everything."""

    def _on_taken(self, message: ActuatorStates) -> None:
        driven = ActuatorCommand(dict(zip(message.channels, message.energised, strict=False)), message.pump_duty)
        self._context.driven(driven, stamp_seconds(message.header.stamp))
        self.link = dataclasses.replace(
            _CONNECTED,
            latched=frozenset({SafeCause.HOST_SILENT} if message.host_silent else ()),
            plant_restarts=message.plant_restarts,
            paused=message.plant_paused,
        )

    def close(self) -> None:
        """Unsubscribe."""
        for subscription in self._subscriptions:
            self._context.node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _on_pressure(self, place: str, serialized: bytes) -> None:
        measured = wire.read(serialized, wire.PRESSURE_DOUBLES)
        if measured is not None and measured.time_ns:
            self._context.take(measured_pressure(place, measured))
            return
        received_s = seconds(self._context.node.get_clock().now())
        self._context.take(pressure_sample(place, deserialize_message(serialized, FluidPressure), received_s))


_LONGEST_LAG_S = 0.5 * WATCHDOG_S
"""Most time that is made up for at once, s. Chosen: before the board lets go."""


class FakeHardware:
    """An ankle of plain numbers behind a board, which tests let fail. Implements `core.hardware.Hardware`."""

    def __init__(self, context: HardwareContext) -> None:
        """Start the plant, vented.

        Raises:
            ParameterError: the script of faults cannot be read.

        """
        self._context = context
        self._script = list(self.check(context.parameters))
        plant = FakePlant(context.parameters.air(), STANDARD_ATMOSPHERE_PA)
        self.board = FakeBoard(plant)
        self._draw = random.Random(0)  # noqa: S311 - which telegrams noise hits is no secret
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._last_s = seconds(self._steady.now())
        self._paused = False
        self._measured = Measured(context, plant.pressures_pa)
        self._timer = context.node.create_timer(STEP_S, self._exchange, clock=self._steady)

    @staticmethod
    def check(parameters: DriverParameters) -> tuple[ScriptedFault, ...]:
        """Return the faults to come.

        Raises:
            ParameterError: the script of faults cannot be read.

        """
        given = parameters.fake_faults
        try:
            text = Path(given).read_text(encoding="utf-8") if given and Path(given).is_file() else given
            return read_script(text)
        except (OSError, UnicodeDecodeError, InputError) as error:
            msg = f"parameter 'fake_faults': {error}"
            raise ParameterError(msg) from error

    @property
    def link(self) -> LinkStatus:
        """What is known of the board."""
        return dataclasses.replace(self.board.link, paused=self._paused)

    def apply(self, command: ActuatorCommand) -> None:
        """Hand the board a command, unless its cable is pulled."""
        self._catch_up()
        if self.board.link.state is LinkState.CONNECTED:
            self.board.take(command)

    def acknowledge(self) -> None:
        """Take jams again."""
        self.board.acknowledge()

    def close(self) -> None:
        """Stop the plant."""
        self._context.node.destroy_timer(self._timer)
        self._measured.close()

    def _catch_up(self) -> None:
        """Take board and plant on to now; what is not a whole step is left for the next time.

        They live in their host: where that gets no core for longer, on a busy machine, they were paused with it.
        """
        now_s = seconds(self._steady.now())
        if now_s - self._last_s > _LONGEST_LAG_S:
            self._last_s = now_s - _LONGEST_LAG_S
            self._paused = True
        passed_s = int((now_s - self._last_s) / STEP_S) * STEP_S
        self.board.advance(passed_s)
        self._last_s += passed_s

    def _exchange(self) -> None:
        """Let happen what the script says, and read all sensors, unless the line is in the way."""
        self._paused = False
        self._catch_up()
        while self._script and self._script[0].time_s <= self.board.plant.time_s:
            entry = self._script.pop(0)
            if entry.fault is None:
                self.board.heal()
            else:
                self.board.inject(entry.fault, entry.place, entry.size)
        if self.board.link.state is not LinkState.CONNECTED:
            return
        spoiled = self._draw.random() < self.board.noise_share
        self.board.count(int(not spoiled), int(spoiled))
        if not spoiled:
            self._measured.publish(self.board.plant.readings_pa(), self.board.driven)
