"""Takes the driver's commands, pump duty and solenoids, to the simulation; keeps the last good ones, says when."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from std_msgs.msg import Bool, Float32

from jammkle_graph import names
from jammkle_graph.qos import publisher_qos, subscriber_qos
from jammkle_msgs.msg import ActuatorStates
from jammkle_sim.conversions import BadCommandError, actuator_states, duty_from

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from jammkle_sim.rigs.simulation import Simulation


class Commands:
    """Subscriptions of the simulated hardware, and its acknowledgement."""

    def __init__(self, node: Node, simulation: Simulation, on_refused_change: Callable[[], None]) -> None:
        """Subscribe on `node`; `on_refused_change` is called when `refused` becomes something else."""
        self._simulation = simulation
        self._on_refused_change = on_refused_change
        self._refused = ""
        self._duty = 0.0
        self._energised = dict.fromkeys(names.CHANNELS, False)
        self._is_new = True
        self._told_lately = False
        qos = publisher_qos(names.ACTUATOR_STATES)
        self._acknowledged = node.create_publisher(ActuatorStates, names.ACTUATOR_STATES.name, qos)
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

    def acknowledge(self, time_ns: int) -> None:
        """Say what has changed; to be called before each step, with the simulated time, ns, at which that begins."""
        if self._is_new:
            self._tell(time_ns)

    def repeat(self, time_ns: int) -> None:
        """Say it once more if nothing was said since the last call, so that silence never lasts."""
        if not self._told_lately:
            self._tell(time_ns)
        self._told_lately = False

    def _tell(self, time_ns: int) -> None:
        self._acknowledged.publish(actuator_states(time_ns, self._duty, self._energised))
        self._is_new = False
        self._told_lately = True

    def _take_duty(self, message: Float32) -> None:
        try:
            duty = duty_from(message)
        except BadCommandError as error:
            self._set_refused(str(error))
            return
        self._set_refused("")
        self._is_new |= duty != self._duty
        self._duty = duty
        self._simulation.set_pump_duty(self._duty)

    def _take_solenoid(self, channel: str, message: Bool) -> None:
        self._is_new |= message.data != self._energised[channel]
        self._energised[channel] = message.data
        self._simulation.set_solenoid(channel, message.data)

    def _set_refused(self, refused: str) -> None:
        if refused != self._refused:
            self._refused = refused
            self._on_refused_change()
