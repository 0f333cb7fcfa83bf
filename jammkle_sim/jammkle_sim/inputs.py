"""Takes the driver's commands, pump duty and solenoids, to the simulation; says when, and lets go when none come."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Protocol

from std_msgs.msg import Bool, Float32

from jammkle_common import names
from jammkle_common.names import below
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_msgs.msg import ActuatorStates
from jammkle_sim.conversions import BadCommandError, actuator_states, duty_from

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.node import Node


WATCHDOG_S = 0.2
"""Silence of the driver after which the simulated board lets go, s of simulated time: the firmware's default of
watchdog_ms."""


class AnkleHardware(Protocol):
    """What obeys: pump and solenoids of one simulated ankle."""

    def set_pump_duty(self, duty: float) -> None:
        """Set the pump's duty, 0 to 1."""

    def set_solenoid(self, channel: str, energised: bool) -> None:  # noqa: FBT001 - the state of a coil, as Bool is
        """Energise or release a channel's solenoid."""


class Commands:
    """Subscriptions of the simulated hardware, and its acknowledgement."""

    def __init__(
        self,
        node: Node,
        simulation: AnkleHardware,
        on_refused_change: Callable[[], None],
        time_s: Callable[[], float],
        within: str = "",
    ) -> None:
        """Subscribe on `node`.

        Args:
            node: The sim node.
            simulation: What obeys.
            on_refused_change: Called when `refused` or `let_go` becomes something else.
            time_s: Gives simulated time, s; the simulated board and its watchdog live in it.
            within: Namespace of the ankle below the node's own; empty: that.

        """
        self._time_s = time_s
        self._simulation = simulation
        self._on_refused_change = on_refused_change
        self._heard = 0
        self._refused = ""
        self._duty = 0.0
        self._energised = dict.fromkeys(names.CHANNELS, False)
        self._is_new = False
        self._restarts = 0
        self._paused = False
        self._told_lately = False
        self._received_s = time_s()
        self._let_go = False
        self._wanted_duty = 0.0
        self._wanted = dict.fromkeys(names.CHANNELS, False)
        qos = publisher_qos(names.ACTUATOR_STATES)
        self._acknowledged = node.create_publisher(ActuatorStates, below(within, names.ACTUATOR_STATES), qos)
        duty = names.PUMP_DUTY
        node.create_subscription(Float32, below(within, duty), self._take_duty, subscriber_qos(duty))
        for channel, topic in names.SOLENOIDS.items():
            take = partial(self._take_solenoid, channel)
            node.create_subscription(Bool, below(within, topic), take, subscriber_qos(topic))

    @property
    def heard(self) -> int:
        """How many messages of the driver have come."""
        return self._heard

    @property
    def refused(self) -> str:
        """Why the latest command was refused, in one line; empty when it was followed."""
        return self._refused

    @property
    def let_go(self) -> bool:
        """Whether the simulated board has let go as it did not hear the driver; until it is told to release all."""
        return self._let_go

    def apply(self) -> None:
        """Command again what stands: a reset rig is still wired to the same driver, which must know of the reset."""
        self._restarts += 1
        self._is_new = True
        self._simulation.set_pump_duty(self._duty)
        for channel, energised in self._energised.items():
            self._simulation.set_solenoid(channel, energised)

    def set_paused(self, time_ns: int, *, paused: bool) -> None:
        """Say whether the ankle stands still although the clock may go on; simulated time of now, ns.

        Its board's watchdog stands still, too.
        """
        if paused == self._paused:
            return
        self._paused = paused
        self._received_s = self._time_s()
        self._tell(time_ns)

    def begin(self) -> None:
        """Say what stands before the first step, when all are there who wait for it."""
        self._is_new = True

    def look_for_silence(self) -> None:
        """Let go if the driver has been silent for too long; to be called before each step."""
        now_s = self._time_s()
        self._received_s = min(self._received_s, now_s)  # time may be set back
        is_on = self._duty > 0.0 or any(self._energised.values())
        if is_on and not self._let_go and now_s - self._received_s > WATCHDOG_S:
            self._set_let_go(let_go=True)
            self._obey(0.0, dict.fromkeys(names.CHANNELS, False))

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
        states = actuator_states(
            time_ns, self._duty, self._energised, self._restarts, host_silent=self._let_go, paused=self._paused
        )
        self._acknowledged.publish(states)
        self._is_new = False
        self._told_lately = True

    def _take_duty(self, message: Float32) -> None:
        self._hear()
        try:
            duty = duty_from(message)
        except BadCommandError as error:
            self._set_refused(str(error))
            return
        self._set_refused("")
        self._wanted_duty = duty
        self._follow()

    def _take_solenoid(self, channel: str, message: Bool) -> None:
        self._hear()
        self._wanted[channel] = message.data
        self._follow()

    def _hear(self) -> None:
        self._heard += 1
        self._received_s = self._time_s()

    def _follow(self) -> None:
        """Do what is wanted, unless the board has let go and was not yet told to release everything."""
        if self._let_go and (self._wanted_duty > 0.0 or any(self._wanted.values())):
            return
        self._set_let_go(let_go=False)
        self._obey(self._wanted_duty, self._wanted)

    def _obey(self, duty: float, energised: Mapping[str, bool]) -> None:
        if duty != self._duty:
            self._is_new = True
            self._duty = duty
            self._simulation.set_pump_duty(duty)
        for channel, on in energised.items():
            if on != self._energised[channel]:
                self._is_new = True
                self._energised[channel] = on
                self._simulation.set_solenoid(channel, on)

    def _set_let_go(self, *, let_go: bool) -> None:
        if let_go != self._let_go:
            self._let_go = let_go
            self._is_new = True
            self._on_refused_change()

    def _set_refused(self, refused: str) -> None:
        if refused != self._refused:
            self._refused = refused
            self._on_refused_change()
