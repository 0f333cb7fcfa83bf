"""Takes the driver's commands, pump duty and solenoids, to the simulation; keeps the last good ones."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from std_msgs.msg import Bool, Float32

from jammkle_graph import names
from jammkle_graph.qos import subscriber_qos
from jammkle_sim.conversions import BadCommandError, duty_from

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from jammkle_sim.rigs.simulation import Simulation


class Commands:
    """Subscriptions of the simulated hardware."""

    def __init__(self, node: Node, simulation: Simulation, on_refused_change: Callable[[], None]) -> None:
        """Subscribe on `node`; `on_refused_change` is called when `refused` becomes something else."""
        self._simulation = simulation
        self._on_refused_change = on_refused_change
        self._refused = ""
        self._duty = 0.0
        self._energised = dict.fromkeys(names.CHANNELS, False)
        node.create_subscription(Float32, names.PUMP_DUTY.name, self._take_duty, subscriber_qos(names.PUMP_DUTY))
        for channel, topic in names.SOLENOIDS.items():
            node.create_subscription(Bool, topic.name, partial(self._take_solenoid, channel), subscriber_qos(topic))

    @property
    def refused(self) -> str:
        """Why the latest command was refused, in one line; empty when it was followed."""
        return self._refused

    def apply(self) -> None:
        """Command again what stands: a reset rig is still wired to the same driver."""
        self._simulation.set_pump_duty(self._duty)
        for channel, energised in self._energised.items():
            self._simulation.set_solenoid(channel, energised)

    def _take_duty(self, message: Float32) -> None:
        try:
            self._duty = duty_from(message)
        except BadCommandError as error:
            self._set_refused(str(error))
            return
        self._set_refused("")
        self._simulation.set_pump_duty(self._duty)

    def _take_solenoid(self, channel: str, message: Bool) -> None:
        self._energised[channel] = message.data
        self._simulation.set_solenoid(channel, message.data)

    def _set_refused(self, refused: str) -> None:
        if refused != self._refused:
            self._refused = refused
            self._on_refused_change()
