"""Readings of hardware in the driver's own process: as samples for the driver, and as the topics of a simulation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from sensor_msgs.msg import FluidPressure

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import ACTUATOR_STATES, MANIFOLD_PRESSURE, PRESSURES, frame
from jammkle_common.qos import publisher_qos
from jammkle_driver.conversions import actuator_states_message, pressure_message, seconds
from jammkle_driver.core.hardware import MANIFOLD, PressureSample
from jammkle_msgs.msg import ActuatorStates

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from collections.abc import Set as AbstractSet

    from jammkle_driver.core.hardware import ActuatorCommand
    from jammkle_driver.hardware_choice import HardwareContext


class Measured:
    """Pressures and what the outputs do, from hardware to driver and graph."""

    def __init__(self, context: HardwareContext, places: Iterable[str]) -> None:
        """Create the publishers.

        Args:
            context: Of the hardware.
            places: Channels, and the manifold, that have a pressure sensor.

        """
        self._context = context
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        topics = {**PRESSURES, MANIFOLD: MANIFOLD_PRESSURE}
        node = context.node
        self._pressures = {
            place: node.create_publisher(FluidPressure, topics[place].name, publisher_qos(topics[place]))
            for place in places
        }
        self._taken = node.create_publisher(ActuatorStates, ACTUATOR_STATES.name, publisher_qos(ACTUATOR_STATES))

    def publish(
        self,
        pressures_pa: Mapping[str, float],
        taken: ActuatorCommand | None,
        counted: AbstractSet[str] = frozenset(),
        *,
        at_s: float | None = None,
        timely: bool = True,
    ) -> None:
        """Publish and hand over what was measured; to be called from the node's own thread.

        Args:
            pressures_pa: Readings by place, Pa absolute; one that is not finite is not published.
            taken: What the outputs do; None: not known.
            counted: Places whose sensor measures vacuum, counted here from `HardwareContext.ambient_pa`.
            at_s: When that was, s of the steady clock, wherever it has waited since; None: just now.
            timely: Whether that is as sure as usual: else it is no evidence of a fault.

        """
        node = self._context.node
        now, steady_s = node.get_clock().now(), seconds(self._steady.now())
        if at_s is not None:
            now, steady_s = now - Duration(nanoseconds=round((steady_s - at_s) * NANOSECONDS_PER_SECOND)), at_s
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
        self._pressures.clear()
