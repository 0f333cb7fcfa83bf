"""The simulated ankle as hardware: pressures come in by subscription."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sensor_msgs.msg import FluidPressure

from jammkle_driver.conversions import pressure_sample, seconds
from jammkle_driver.core.hardware import MANIFOLD, LinkState, LinkStatus, SafeCause
from jammkle_graph.names import ACTUATOR_STATES, MANIFOLD_PRESSURE, PRESSURES
from jammkle_graph.qos import subscriber_qos
from jammkle_msgs.msg import ActuatorStates

if TYPE_CHECKING:
    from jammkle_driver.core.hardware import ActuatorCommand
    from jammkle_driver.hardware_choice import HardwareContext


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
                lambda message, place=place: self._on_pressure(place, message),
                subscriber_qos(topic),
            )
            for place, topic in topics.items()
        ]
        self._silent = False
        self._subscriptions.append(
            context.node.create_subscription(
                ActuatorStates, ACTUATOR_STATES.name, self._on_taken, subscriber_qos(ACTUATOR_STATES)
            )
        )

    @property
    def link(self) -> LinkStatus:
        """Always connected: whether the simulation is there is seen by its pressures; it lets go as a board does."""
        latched = frozenset({SafeCause.HOST_SILENT}) if self._silent else frozenset()
        return LinkStatus(LinkState.CONNECTED, "topics of the simulation", latched=latched, simulated=True)

    def apply(self, command: ActuatorCommand) -> None:
        """Do nothing: the driver publishes its commands whatever the hardware, and the simulation listens to them."""

    def acknowledge(self) -> None:
        """Do nothing: the simulated board takes jams again once it was told to release everything."""

    def _on_taken(self, message: ActuatorStates) -> None:
        self._silent = message.host_silent

    def close(self) -> None:
        """Unsubscribe."""
        for subscription in self._subscriptions:
            self._context.node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _on_pressure(self, place: str, message: FluidPressure) -> None:
        received_s = seconds(self._context.node.get_clock().now())
        self._context.take(pressure_sample(place, message, received_s))
