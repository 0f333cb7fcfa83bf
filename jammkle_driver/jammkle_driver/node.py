"""The driver as a lifecycle node: topics, services and /diagnostics around the core, nothing decided here."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from std_msgs.msg import Bool, Float32
from std_srvs.srv import SetBool, Trigger

from jammkle_common.diagnostics import DiagnosticsPublisher, Liveness
from jammkle_common.lockstep import LockstepNode
from jammkle_common.messages import Health, Level
from jammkle_common.names import (
    CHANNEL_JAMS,
    CHANNELS,
    CLEAR_FAULT,
    DRIVER_NODE,
    EMERGENCY_STOP,
    JAM,
    JAM_ALL,
    JAM_COMMAND,
    JAM_STATE,
    PUMP_DUTY,
    SIM_HARDWARE,
    SOLENOIDS,
    UNJAM,
    UNJAM_ALL,
)
from jammkle_common.parameters import declare, on_change
from jammkle_common.qos import MessageInfo, publisher_qos, subscribe_to_any
from jammkle_driver.conversions import jam_state_message, seconds, set_points
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import MANIFOLD, LinkState
from jammkle_driver.core.requests import Publication, RequestError
from jammkle_driver.core.watch import Instant, link_numbers
from jammkle_driver.hardware import HardwareContext, checked_hardware
from jammkle_driver.parameters import TICK_PERIOD_S, DriverParameters
from jammkle_msgs.msg import JamCommand, JamState
from jammkle_msgs.srv import Jam, Unjam

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lifecycle_msgs.srv import ChangeState
    from rclpy.node import Node

    from jammkle_common.names import Service, Topic
    from jammkle_driver.core.air import Atmosphere
    from jammkle_driver.core.ankle import Ankle
    from jammkle_driver.core.bank import Estimate
    from jammkle_driver.core.channel import Channel
    from jammkle_driver.core.driver import Trouble
    from jammkle_driver.core.hardware import ActuatorCommand, Hardware, LinkStatus, PressureSample


STATE_PERIOD_S = 1.0
"""jam_state is repeated this often, s."""

_DELIVERY_TIMEOUT_S = 0.5


class DriverNode(LockstepNode, LifecycleNode):
    """Pump and solenoids of one ankle as topics and services."""

    def __init__(self, **node_options: Any) -> None:
        """Declare the parameters; topics and services come with `on_configure`. Options are those of rclpy's node.

        Raises:
            ParameterError: a parameter is unknown or out of range.
        """
        super().__init__(DRIVER_NODE, **node_options)
        refuse_bad_transitions(self)
        self._values = declare(self, DriverParameters)
        self._make_hardware = checked_hardware(self._values)
        on_change(self, DriverParameters, self._take_parameters)
        if self._values.hardware != SIM_HARDWARE:
            self.live_on_steady_clock()
        self._driver = Driver(CHANNELS, self._values)
        self._was_in_step = False
        self._outputs: Outputs | None = None
        self._hardware: Hardware | None = None
        self._liveness = Liveness(self)
        self._closers: list[Callable[[], object]] = []
        self._refused_command = ""
        self._reported: object = None
        self._faults: tuple[str, ...] = ()
        self._logged_link: LinkStatus | None = None
        self._diagnostics = DiagnosticsPublisher(self, self._values.hardware, self._health)

    def start(self) -> None:
        """Configure and activate, where the parameter `autostart` says so."""
        if self._values.autostart and self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def shut_down(self) -> None:
        """Release everything, see to it that this gets out, and close; possible in every lifecycle state."""
        self._close()
        self._diagnostics.farewell()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create topics and services; everything stays released, and requests are answered but refused."""
        self._outputs, self._reported = Outputs(self), None
        self._closers.append(self._outputs.close)
        context = HardwareContext(
            self, self._on_sample, self._driver.take_driven, self._values, self._declared_ambient_pa
        )
        self._hardware = self._make_hardware(context)
        self._logged_link = self._hardware.link
        self._create_subscriptions()
        self._create_services()
        for period_s, callback in ((TICK_PERIOD_S, self._on_tick), (STATE_PERIOD_S, self._repeat_state)):
            self._closers.append(self.every(period_s, callback))
        self._settle()
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Follow requests from now on."""
        now = self._now()
        self._driver.activate(now)
        self._settle(now)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything and refuse requests."""
        self._driver.deactivate()
        self._settle()
        return super().on_deactivate(state)

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything and destroy topics and services."""
        self._close()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up, and say that there is no way back; not called where the process ends."""
        self.get_logger().warning("finalized: released, and drives nothing any more; start the process anew")
        return self.on_cleanup(state)

    def on_error(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything and be unconfigured again."""
        self.get_logger().error("a lifecycle transition failed; the driver is unconfigured again")
        self._close()
        return TransitionCallbackReturn.SUCCESS

    def _close(self) -> None:
        self._driver.reset()
        self._refused_command = ""
        if self._outputs is not None and self._hardware is not None:
            self._hardware.apply(self._driver.command)
            self._outputs.repeat_command(self._driver.command)
            self._outputs.repeat_state(self._driver, self._refused_command)
            # The hardware first: rclpy keeps Python's lock while it waits for a subscriber, and a killed one never
            # answers.
            self._hardware.close()
            self._outputs.deliver()
        for close in reversed(self._closers):
            close()
        self._closers.clear()
        self._hardware = None
        self._outputs = None

    def _create_subscriptions(self) -> None:
        for kind, topic, callback in (
            (JamCommand, JAM_COMMAND, self._on_jam_command),
            (Bool, EMERGENCY_STOP, self._on_emergency_stop),
        ):
            for subscription in subscribe_to_any(self, kind, topic, callback):
                self._closers.append(partial(self.destroy_subscription, subscription))

    def _create_services(self) -> None:
        answers: list[tuple[type, Service, Callable[[Any], str]]] = [
            (Jam, JAM, lambda request: self._driver.jam(request.channels, request.vacuum_pa, JAM.name)),
            (Unjam, UNJAM, lambda request: self._unjam(request.channels, UNJAM.name)),
            (Trigger, JAM_ALL, lambda _request: self._driver.jam((), 0.0, JAM_ALL.name)),
            (Trigger, UNJAM_ALL, lambda _request: self._unjam((), UNJAM_ALL.name)),
            (Trigger, CLEAR_FAULT, lambda _request: self._clear_fault()),
        ]
        answers += [(SetBool, service, partial(self._switch, channel)) for channel, service in CHANNEL_JAMS.items()]
        for kind, service, answer in answers:
            server = self.create_service(kind, service.name, partial(self._serve, answer))
            self._closers.append(partial(self.destroy_service, server))

    def _switch(self, channel: str, request: SetBool.Request) -> str:
        asked_by = CHANNEL_JAMS[channel].name
        if request.data:
            return self._driver.jam((channel,), 0.0, asked_by)
        return self._unjam((channel,), asked_by)

    def _serve(self, answer: Callable[[Any], str], request: Any, response: Any) -> Any:
        try:
            response.message = answer(request)
            response.success = True
        except RequestError as error:
            response.message = str(error)
            response.success = False
        self._settle()
        return response

    def _unjam(self, channels: Sequence[str], asked_by: str) -> str:
        answer = self._driver.unjam(channels, asked_by)
        link = None if self._hardware is None else self._hardware.link
        self._driver.check_carried_out(channels, link)
        return answer

    def _on_sample(self, sample: PressureSample) -> None:
        now = self._now()
        if self._hardware is not None:
            self._look_at_link(self._hardware, now)  # first: with the first sample a set point that waits may jam
        self._driver.measure(sample, now)
        self._settle(now)

    def _on_jam_command(self, message: JamCommand, info: MessageInfo) -> None:
        now, publication = self._now(), self._publication(JAM_COMMAND, info)
        try:
            points = set_points(message)
            if not self._driver.follow(points, now, JAM_COMMAND.name, anew=message.anew, publication=publication):
                return
            refused = ""
        except RequestError as error:
            refused = f"refused: {error}"
        if refused != self._refused_command:
            self._refused_command = refused
            if refused:
                self.get_logger().warning(f"{JAM_COMMAND.name} {refused}")
            self._diagnostics.check()
        self._settle(now)

    def _on_emergency_stop(self, message: Bool, info: MessageInfo) -> None:
        now = self._now()
        self._driver.emergency_stop(stop=message.data, now=now, publication=self._publication(EMERGENCY_STOP, info))
        self._settle(now)

    def _publication(self, topic: Topic, info: MessageInfo) -> Publication:
        return Publication(info.number, info.sent_ns, self._count_publishers(topic))

    def _count_publishers(self, topic: Topic) -> int:
        return self.count_publishers(self.resolve_topic_name(topic.name))  # which does not ask how it is remapped

    def _clear_fault(self) -> str:
        cleared = self._driver.clear_fault(self._now())
        if self._hardware is not None:
            self._hardware.acknowledge()
        return cleared

    def _look_at_link(self, hardware: Hardware, now: Instant) -> None:
        if self._driver.look_at_link(hardware.link, now):
            hardware.acknowledge()

    def _on_tick(self) -> None:
        now = self._now()
        self._driver.tick(now, self._count_publishers(EMERGENCY_STOP))
        if self._hardware is not None:
            self._look_at_link(self._hardware, now)
            self._driver.link_watch.count(self._hardware.link, now.steady_s)
            self._log_link(self._hardware.link)
        if self._outputs is not None and self._hardware is not None:
            self._hardware.apply(self._driver.command)
            self._outputs.repeat_command(self._driver.command)
        self._settle(now)

    def _log_link(self, link: LinkStatus) -> None:
        """Log why the hardware cannot be reached when that changes: on the terminal nothing else says it."""
        before, self._logged_link = self._logged_link, link
        if before is None or (before.state, _reason(before)) == (link.state, _reason(link)):
            return
        if link.state is not LinkState.CONNECTED:
            self.get_logger().warning(link.detail)
        elif before.state is not LinkState.CONNECTED:
            self.get_logger().info(link.detail)

    def _repeat_state(self) -> None:
        if self._outputs is not None:
            self._outputs.repeat_state(self._driver, self._refused_command)

    def _settle(self, now: Instant | None = None) -> None:
        """Let everybody know what has changed; called after everything that may change something."""
        if self._outputs is None or self._hardware is None:
            return
        command = self._driver.command
        self._hardware.apply(command)
        self._driver.ankle.note_command(now or self._now())
        self._outputs.update_command(command)
        reported = (self._driver.standing, self._refused_command)
        if reported != self._reported:
            self._reported = reported
            self._outputs.repeat_state(self._driver, self._refused_command)
            self._diagnostics.check()
            faults = tuple(dict.fromkeys(channel.why.text for channel in self._driver.ankle.faulty))
            for fault in faults:
                if fault not in self._faults:
                    self.get_logger().error(fault)
            self._faults = faults

    def _take_parameters(self, parameters: DriverParameters) -> None:
        self._values = parameters
        self._driver.parameters = parameters
        if parameters.ambient_pressure_pa != self._declared_ambient_pa():
            self._driver.ankle.declare_atmosphere(parameters.ambient_pressure_pa, self._now())
        self._settle()

    def _declared_ambient_pa(self) -> float:
        return self._driver.ankle.atmosphere.declared_pa

    def _health(self) -> tuple[Health, ...]:
        _identifier, label = self._state_machine.current_state
        link = None if self._hardware is None else self._hardware.link
        names = sorted(each.node_name for each in self.get_publishers_info_by_topic(JAM_COMMAND.name))
        return (*health_lines(self._driver, label, self._refused_command, link, names), self._liveness.health())

    def _now(self) -> Instant:
        if self._values.hardware != SIM_HARDWARE:
            return Instant(self.now_s(), self.now_s())
        # the graph's time, which the simulation's stamps are in, also where nobody makes that
        graph_s = seconds(self.get_clock().now())
        if self.in_step is not self._was_in_step:
            self._was_in_step = self.in_step
            self._driver.follow_another_clock()
        return Instant(graph_s if self.in_step else time.monotonic(), graph_s)


def _reason(link: LinkStatus) -> str:
    """Return what is said of a link, without how often it is tried again."""
    return link.detail.partition(";")[0]


class Outputs:
    """The driver's publishers.

    They are plain publishers, not lifecycle ones: the command that releases everything must get out while the node
    is already inactive.
    """

    def __init__(self, node: Node) -> None:
        """Create the publishers; nothing is published yet."""
        self._node = node
        self._duty = node.create_publisher(Float32, PUMP_DUTY.name, publisher_qos(PUMP_DUTY))
        self._solenoids = {
            channel: node.create_publisher(Bool, topic.name, publisher_qos(topic))
            for channel, topic in SOLENOIDS.items()
        }
        self._state = node.create_publisher(JamState, JAM_STATE.name, publisher_qos(JAM_STATE))
        self._command: ActuatorCommand | None = None

    def repeat_command(self, command: ActuatorCommand) -> None:
        """Publish the whole command."""
        self._command = None
        self.update_command(command)

    def update_command(self, command: ActuatorCommand) -> None:
        """Publish what differs from the last command; solenoids first, since they decide whether a tendon vents."""
        last = self._command
        if command is last:
            return
        self._command = command
        for channel, energised in command.solenoids.items():
            if last is None or last.solenoids[channel] != energised:
                self._solenoids[channel].publish(Bool(data=energised))
        if last is None or last.pump_duty != command.pump_duty:
            self._duty.publish(Float32(data=command.pump_duty))

    def repeat_state(self, driver: Driver, refused_command: str) -> None:
        """Publish the state, and why the last jam_command was refused (empty: it was not)."""
        self._state.publish(jam_state_message(driver, self._node.get_clock().now().to_msg(), refused_command))

    def deliver(self) -> None:
        """Wait until all subscribers have got what was published, at most half a second in all."""
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        deadline = clock.now() + Duration(seconds=_DELIVERY_TIMEOUT_S)
        for publisher in (*self._solenoids.values(), self._duty, self._state):
            left = max(deadline - clock.now(), Duration(), key=lambda duration: duration.nanoseconds)
            publisher.wait_for_all_acked(left)

    def close(self) -> None:
        """Destroy the publishers."""
        for publisher in (*self._solenoids.values(), self._duty, self._state):
            self._node.destroy_publisher(publisher)


def refuse_bad_transitions(node: LifecycleNode) -> None:
    """Answer false to a transition that is not allowed now.

    rclpy lets it escape from the executor, which would end the driver: anybody who activates twice would drop the leg.
    """
    change_state = node._service_change_state.callback  # noqa: SLF001 - there is no other way in

    def answer(request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
        try:
            return change_state(request, response)
        except RuntimeError as error:
            node.get_logger().warning(f"transition {request.transition.id} refused: {error}")
            response.success = False
            return response

    node._service_change_state.callback = answer  # noqa: SLF001 - as above


_LEVELS = {ChannelState.UNKNOWN: Level.WARN, ChannelState.FAULT: Level.ERROR}
_LATE = f"{Reason.EXECUTOR_OVERLOADED.name}: work comes late, or stood still"
_LINK_LEVELS = {LinkState.CONNECTED: Level.OK, LinkState.SEARCHING: Level.WARN, LinkState.LOST: Level.ERROR}


def health_lines(
    driver: Driver,
    lifecycle_state: str,
    refused_command: str,
    link: LinkStatus | None = None,
    commanders: Sequence[str] = (),
) -> tuple[Health, ...]:
    """Return one line each for driver, link, jam_command, manifold, channels, and for what is made of them.

    Args:
        driver: The driver.
        lifecycle_state: Label of the node's lifecycle state.
        refused_command: Why the last jam_command was refused; empty if it was taken, or none came.
        link: What is known of the hardware's other end; None where the driver is not configured.
        commanders: Names of the nodes that publish jam_command.

    """
    ankle, estimate = driver.ankle, driver.ankle.diagnosis.estimate
    return (
        _driver_line(driver, lifecycle_state),
        *(() if link is None else (_link_line(link, driver),)),
        _command_line(driver, refused_command, commanders),
        _manifold_line(ankle.manifold_vacuum_pa),
        *map(_channel_line, ankle.channels.values()),
        _fault_line(driver.trouble, Level.ERROR if ankle.faulty else Level.WARN),
        _atmosphere_line(ankle.atmosphere),
        _pump_line(ankle, estimate),
        *_leak_lines(ankle, estimate),
        _line("executor", _LATE if driver.own_pace.overloaded else "", driver.own_pace.values),
    )


def _fault_line(trouble: Trouble, level: Level) -> Health:
    why, action = trouble
    said = f"{why.reason.name}: {why.text}; action: {action}" if why.text else "none"
    values = {"action": action or "none", **why.values}
    return Health("fault", Level.OK if why.reason is Reason.NONE else level, said, values)


def _line(about: str, warning: str, values: Mapping[str, str]) -> Health:
    """Return a line that is well where there is nothing to warn of."""
    return Health(about, Level.WARN if warning else Level.OK, warning, values)


def _atmosphere_line(air: Atmosphere) -> Health:
    warning = (
        f"ambient_pressure_pa is {air.declared_pa:.0f}, and vented channels read {air.pressure_pa:.0f} Pa: "
        "what they read is used; correct the parameter"
    )
    values = {
        "atmosphere (Pa)": f"{air.pressure_pa:.0f}",
        "ambient_pressure_pa (Pa)": f"{air.declared_pa:.0f}",
        "measured by vented channels": "yes" if air.measured else "not yet",
    }
    return _line("atmosphere", warning if air.doubtful else "", values)


def _pump_line(ankle: Ankle, estimate: Estimate) -> Health:
    load = ankle.load
    values = {
        "mean duty (1)": f"{load.mean_duty:.2f}",
        "flow (share of declared)": f"{estimate.pump_share:.2f} +- {estimate.pump_deviation:.2f}",
        "ultimate vacuum (share of declared)": f"{estimate.pump_end_share:.2f}",
        "resting": "yes" if ankle.regulator.resting else "no",
        "stored vacuum wanted (Pa)": f"{ankle.parameters.reservoir_vacuum_pa:.0f}",
    }
    return _line("pump", "spared: its mean duty is at pump_rated_duty; look for a leak" if load.limited else "", values)


def _leak_lines(ankle: Ankle, estimate: Estimate) -> tuple[Health, ...]:
    latest, alone = ankle.leaks.latest, ankle.leaks.alone
    lines = []
    for index, name in enumerate((MANIFOLD, *ankle.channels)):
        values = {
            "leak conductance by the law of the air (m^3/(s Pa))": (
                f"{estimate.leaks_m3_s_pa[index]:.1e} +- {estimate.leak_deviations_m3_s_pa[index]:.1e}"
            )
        }
        rate, said = latest if name == MANIFOLD else alone.get(name), ""
        if rate is not None:
            values["decay while the pump rests (Pa/s)"] = f"{rate.rate_pa_s:.0f}"
            values["leak conductance by decay, manifold included (m^3/(s Pa))"] = f"{rate.conductance_m3_s_pa:.1e}"
            values["connected"] = ", ".join(sorted(rate.connected))
        elif name == MANIFOLD or latest is None:
            said = "no rest of the pump seen yet"
        else:
            said = "no rest of it alone seen yet: it decays with all that is connected, see manifold leak"
        lines.append(Health(f"{name} leak", Level.OK, said, values))
    return tuple(lines)


def _driver_line(driver: Driver, lifecycle_state: str) -> Health:
    values = {
        "publishers of emergency_stop": str(driver.stop.publishers),
        "of these say true": str(driver.stop.asked_by),
    }
    if driver.stop.reason:
        held = "; solenoids kept, pump off" if driver.ankle.held else ""
        text = f"emergency stop: {driver.stop.reason}; {driver.stop.way_out}{held}"
        return Health("driver", Level.ERROR, text, values)
    return Health("driver", Level.OK if driver.active else Level.WARN, lifecycle_state, values)


def _command_line(driver: Driver, refused_command: str, commanders: Sequence[str]) -> Health:
    values = {"publishers": ", ".join(commanders) or "none"}
    if driver.streams.speaking > 1:
        text = (
            f"{driver.streams.speaking} publishers at once ({values['publishers']}): each channel follows the one that "
            "changed last; to command alone stop the others, the controller by controller/set_auto with false"
        )
        refused_command = f"{refused_command}; {text}" if refused_command else text
    return _line("jam_command", refused_command, values)


def _link_line(link: LinkStatus, driver: Driver) -> Health:
    level, message = _LINK_LEVELS[link.state], f"{link.state.value}: {link.detail}"
    if link.state is not LinkState.CONNECTED:
        pass  # what the board said before is old
    elif link.latched:
        level = Level.ERROR
        message = f"safe state latched: {', '.join(sorted(cause.value for cause in link.latched))}"
    elif link.paused:
        level, message = Level.WARN, "the simulation is paused or runs a rig; what is asked for happens when it goes on"
    elif warning := driver.link_watch.noise or driver.link_watch.restarted:
        level, message = Level.WARN, f"{warning.reason.name}: {warning.text}"
    elif link.faults:
        level = Level.WARN
        message = ", ".join(sorted(fault.value for fault in link.faults))
    reset = "unknown" if link.reset_cause is None else link.reset_cause.value
    return Health("link", level, message, {"last reset": reset, **link_numbers(link)})


def _manifold_line(vacuum_pa: float | None) -> Health:
    if vacuum_pa is None:
        return Health("manifold", Level.WARN, "no pressure measured; the pump is regulated by the channels alone")
    return Health("manifold", Level.OK, "", {"vacuum (Pa)": f"{vacuum_pa:.0f}"})


def _channel_line(channel: Channel) -> Health:
    why, name = channel.why, channel.state.name
    values = {
        "fault": why.reason.name,
        "commanded vacuum (Pa)": f"{channel.set_point_pa:.0f}",
        "measured vacuum (Pa)": "not measured" if channel.vacuum_pa is None else f"{channel.vacuum_pa:.0f}",
        **why.values,
    }
    level = _LEVELS.get(channel.state, Level.OK)
    return Health(channel.name, level, f"{name}: {why.text}" if why.text else name, values)
