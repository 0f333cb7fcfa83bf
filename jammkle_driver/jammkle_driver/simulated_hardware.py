"""The simulated ankle as hardware: pressures come in by subscription."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import TYPE_CHECKING

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import FluidPressure

from jammkle_common import wire
from jammkle_common.names import ACTUATOR_STATES, MANIFOLD_PRESSURE, PRESSURES
from jammkle_common.qos import subscriber_qos
from jammkle_driver.conversions import measured_pressure, pressure_sample, seconds, stamp_seconds
from jammkle_driver.core.hardware import MANIFOLD, ActuatorCommand, LinkState, LinkStatus, SafeCause
from jammkle_msgs.msg import ActuatorStates

if TYPE_CHECKING:
    from jammkle_driver.hardware_choice import HardwareContext

_CONNECTED = LinkStatus(LinkState.CONNECTED, "topics of the simulation", simulated=True)


class SimulatedHardware:
    """Hands over the pressures that the simulation publishes. Implements `core.hardware.Hardware`."""

    def __init__(self, context: HardwareContext) -> None:
        """Subscribe to every pressure."""
        self._context = context
        topics = {**PRESSURES, MANIFOLD: MANIFOLD_PRESSURE}
        self._subscriptions = [
            context.node.create_subscription(
                FluidPressure,
                topic.name,
                partial(self._on_pressure, place),
                subscriber_qos(topic),
                raw=True,
            )
            for place, topic in topics.items()
        ]
        self._link = _CONNECTED
        self._subscriptions.append(
            context.node.create_subscription(
                ActuatorStates, ACTUATOR_STATES.name, self._on_taken, subscriber_qos(ACTUATOR_STATES)
            )
        )

    @property
    def link(self) -> LinkStatus:
        """Always connected: whether the simulation is there is seen by its pressures; it lets go as a board does."""
        return self._link

    def apply(self, command: ActuatorCommand) -> None:
        """Do nothing: the driver publishes its commands whatever the hardware, and the simulation listens to them."""

    def acknowledge(self) -> None:
        """Do nothing: the simulated board takes jams again once it was told to release everything."""

    def _on_taken(self, message: ActuatorStates) -> None:
        driven = ActuatorCommand(dict(zip(message.channels, message.energised, strict=False)), message.pump_duty)
        self._context.driven(driven, stamp_seconds(message.header.stamp))
        latched = frozenset({SafeCause.HOST_SILENT} if message.host_silent else ())
        link = dataclasses.replace(
            _CONNECTED, latched=latched, plant_restarts=message.plant_restarts, paused=message.plant_paused
        )
        if link != self._link:
            self._link = link

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
