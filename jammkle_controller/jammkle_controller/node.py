"""The controller's node: IMU samples in, contact events and jam commands out, and what it says on /diagnostics."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Bool, Float32, String
from std_srvs.srv import SetBool

from jammkle_common import names, wire
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.diagnostics import DiagnosticsPublisher, Liveness
from jammkle_common.lockstep import LockstepNode
from jammkle_common.messages import AUTOMATIC, Health, Level
from jammkle_common.parameters import ParameterError, declare, on_change
from jammkle_common.qos import publisher_qos, subscribe_to_changes, subscriber_qos
from jammkle_controller.conversions import (
    DriverView,
    contact_event_message,
    contact_state_message,
    jam_command_message,
    landing_message,
)
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.events import Contact, Detection, Source, not_felt
from jammkle_controller.core.imu import Freshness, ImuTrouble
from jammkle_controller.core.inputs import Input
from jammkle_controller.core.leg import leg_of
from jammkle_controller.core.policy import PolicyState
from jammkle_controller.core.reading import Received, imu_sample_of, load_n_of, received_in
from jammkle_controller.parameters import ControllerParameters, PolicyMode
from jammkle_msgs.msg import ContactEvent, ContactState, JamCommand, JamState, Landing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.parameter import Parameter

    from jammkle_controller.core.controller import Reaction
    from jammkle_controller.core.events import ContactReport
    from jammkle_controller.core.leg import Leg

HARDWARE_ID = "ankle"

VACUUM_PARAMETERS = ("hold_vacuum_pa", "full_vacuum_pa", "landing_vacuum_pa")
"""Parameters beyond the driver's limits are refused. The last one is asked for with policy fixed alone."""

INPUT_TOPICS = {
    Input.CONTACT_SWITCH: names.FOOT_CONTACT.name,
    Input.LOAD: names.LOAD_CELL.name,
    Input.GAIT_PHASE: names.GAIT_PHASE.name,
    Input.PLANNED_CONTACT: names.PLANNED_CONTACT.name,
    Input.JOINTS: names.JOINT_STATES.name,
    Input.ANKLE: names.JOINT_STATES.name,
    Input.EFFORTS: names.JOINT_STATES.name,
    Input.ODOMETRY: names.ODOMETRY.name,
}
"""Where each of the optional inputs is received."""

CONTACT_PERIOD_S = 1.0
"""How often contact_state is published again, s."""
FOLLOW_S = 0.5
"""How long the driver may take to follow a new set point before that is reported, s: ten repeats of jam_command."""
STAMPS_OFF_S = 0.2
"""Stamps of the IMU so far from the node's clock are reported, s: what has no stamp is timed by that clock, and the
phase of a gait is not extrapolated by 0.3 s or more."""
LOOKED_AT_S = 2.0
"""How long contact may be unknown before that is a warning, s: rest is seen after 1 s."""
SAY_SO = f"{names.SET_CONTACT.path} says so"
SAFE_MODE = "the last set points are kept"
"""What is done where nothing shows contact: what is jammed stays jammed, what is soft stays soft."""


class ControllerNode(LockstepNode):
    """Detects contact on `imu/data` and commands jamming on `jam_command`.

    A change is published from within the callback of the sample that led to it, and repeated regularly, so that the
    driver knows that the controller is alive.
    """

    def __init__(self, **node_options: Any) -> None:
        """Make the node.

        Args:
            node_options: Passed on to rclpy (`parameter_overrides`, `namespace`, `context`).

        Raises:
            ParameterError: an unknown parameter was given, or a value is out of range.

        """
        super().__init__(names.CONTROLLER_NODE, **node_options)
        values = declare(self, ControllerParameters)
        self._auto = values.auto_at_start
        self._controller = AnkleController(values)
        self._freshness = Freshness(values.imu_timeout_s, self.now_s())
        self._on_clock_s = self.now_s()
        self._values = values
        self._leg: Leg | None = None
        self._description = ""
        self._body_frame = ""
        shared = f"{values.robot_namespace.rstrip('/')}/" if values.robot_namespace else ""
        self._inputs = {**INPUT_TOPICS, Input.ODOMETRY: shared + names.ODOMETRY.name}
        self._leg_trouble = ""
        self._driver = DriverView(JamState())
        self._driver_reported = False
        self._held_s = self._contact_reported_s = self.now_s()
        self._contact_reported: tuple[ContactReport, bool] | None = None
        self._landed_ns: int | None = None
        self._asked_pa = 0.0
        self._since_asked_s = self.now_s()
        self.add_on_set_parameters_callback(self._refuse_what_the_driver_refuses)
        on_change(self, ControllerParameters, self._configure)

        self._commands, self._events, self._contact, self._landings = (
            self.create_publisher(kind, topic.name, publisher_qos(topic))
            for kind, topic in (
                (JamCommand, names.JAM_COMMAND),
                (ContactEvent, names.CONTACT_EVENTS),
                (ContactState, names.CONTACT_STATE),
                (Landing, names.LANDING),
            )
        )
        self._diagnostics = DiagnosticsPublisher(self, HARDWARE_ID, self._health)
        self.create_service(SetBool, names.SET_AUTO.name, self._set_auto)
        self.create_service(SetBool, names.SET_CONTACT.name, self._set_contact)
        self.every(1.0 / values.command_rate_hz, self._repeat)
        self._liveness = Liveness(self)
        self.create_subscription(JamState, names.JAM_STATE.name, self._on_driver, subscriber_qos(names.JAM_STATE))
        self.create_subscription(Imu, names.IMU.name, self._on_imu, subscriber_qos(names.IMU), raw=True)
        for topic in (names.FOOT_CONTACT, names.PLANNED_CONTACT):
            subscribe_to_changes(self, Bool, topic, partial(self._on_input, topic))
        for kind, topic in ((Float32, names.GAIT_PHASE), (JointState, names.JOINT_STATES)):
            self._receive(kind, topic, topic.name)
        self.create_subscription(
            WrenchStamped, names.LOAD_CELL.name, self._on_load, subscriber_qos(names.LOAD_CELL), raw=True
        )
        if values.use_odometry:
            self._receive(Odometry, names.ODOMETRY, self._inputs[Input.ODOMETRY])
        if values.robot_description:
            self._know(leg_of(values.robot_description, values))
        elif values.needs_leg:
            topic = shared + names.ROBOT_DESCRIPTION.name
            self._leg_trouble = f"no robot_description on {self.resolve_topic_name(topic)}"
            self.create_subscription(String, topic, self._on_description, subscriber_qos(names.ROBOT_DESCRIPTION))

    def _receive(self, kind: type, topic: names.Topic, name: str) -> None:
        self.create_subscription(kind, name, partial(self._on_input, topic), subscriber_qos(topic))

    def _on_imu(self, serialized: bytes) -> None:
        measured = wire.read(serialized, wire.IMU_DOUBLES)
        if measured is None:
            self._on_input(names.IMU, deserialize_message(serialized, Imu))
            return
        self._take(self._controller.update(imu_sample_of(measured)), measured.frame_id)

    def _on_load(self, serialized: bytes) -> None:
        measured = wire.read(serialized, wire.WRENCH_DOUBLES)
        if measured is None:
            self._on_input(names.LOAD_CELL, deserialize_message(serialized, WrenchStamped))
            return
        load = Received(measured.time_ns, Input.LOAD, load_n_of(measured))
        self._take(self._controller.take(load), measured.frame_id)

    def _on_input(self, topic: names.Topic, message: Any) -> None:
        if topic is names.ODOMETRY:
            self._body_frame = message.child_frame_id
        frame_id = message.header.frame_id if hasattr(message, "header") else ""
        for each in received_in(message, topic, self.get_clock().now().nanoseconds, self._values, self._leg):
            self._take(self._controller.take(each), frame_id)

    def _on_description(self, message: String) -> None:
        if message.data == self._description:
            return
        self._description = message.data
        try:
            self._know(leg_of(message.data, self._values))
        except ParameterError as error:
            self._leg_trouble = str(error)

    def _know(self, leg: Leg) -> None:
        self._controller.know(leg)
        self._leg = leg
        self._leg_trouble = ""

    def _take(self, reaction: Reaction, frame_id: str) -> None:
        if reaction.changed and self._auto:
            self._command()
        for event in reaction.events:
            felt_in = self._body_frame if event.source is Source.ODOMETRY else frame_id
            self._events.publish(contact_event_message(event, felt_in))
        landing = self._controller.policy.landing
        if landing is not None and landing.time_ns != self._landed_ns:
            self._landed_ns = landing.time_ns
            self._landings.publish(landing_message(landing, self._values.landing_travel_m))

    def _command(self, *, anew: bool = False) -> None:
        self._commands.publish(
            jam_command_message(self._controller.set_points_pa, self.get_clock().now().to_msg(), anew=anew)
        )

    def _repeat(self) -> None:
        self._freshness.observe(self._controller.gate.counts, self.now_s())
        if self._freshness.stale:
            self._take(self._controller.go_on(self.get_clock().now().nanoseconds), "")
        if self._auto:
            self._command()
        self._publish_contact()
        self._diagnostics.check()

    def _publish_contact(self) -> None:
        """Publish what is known of contact when it has changed, and once a second."""
        now = (self._controller.contact, self._is_soft_in_stance())
        now_s = self.now_s()
        if now == self._contact_reported and now_s - self._contact_reported_s < CONTACT_PERIOD_S:
            return
        self._contact_reported, self._contact_reported_s = now, now_s
        report, soft = now
        health = contact_health(self._controller, self._driver.soft, is_soft_in_stance=soft)
        self._contact.publish(contact_state_message(report, health, self.get_clock().now().to_msg(), soft=soft))

    def _is_soft_in_stance(self) -> bool:
        """Whether it bears, and a channel has not been asked to jam for `FOLLOW_S`."""
        held = self._driver_reported and not self._driver.soft
        if held or not self._controller.contact.bears:
            self._held_s = self.now_s()
        return self.now_s() - self._held_s >= FOLLOW_S

    def _set_contact(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        refusal = self._controller.set_contact(stands=request.data)
        response.success = not refusal
        if refusal:
            response.message = f"refused: {refusal}; mend that sensor, or ~/set_auto with false and jam by service"
            return response
        if self._auto:
            self._command(anew=True)
        does = "stands, and is held" if request.data else "does not stand, and is soft"
        manual = "" if self._auto else f"; automatic jamming is off; {names.WAY_BACK}"
        response.message = f"the foot {does} until something else is felt{manual}"
        self._publish_contact()
        self._diagnostics.check()
        return response

    def _set_auto(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._auto = request.data
        response.success = True
        if self._auto:
            self._controller.forget_hand()
            self._command(anew=True)
            response.message = (
                f"automatic jamming is on ({self._controller.policy.state.value}): "
                f"{names.JAM_COMMAND.name} now asks for {self._controller.vacuum_pa:.0f} Pa in every channel"
            )
            trouble = self._driver.first_clear
            response.message += f"; {trouble}" if trouble else ""
        else:
            response.message = (
                f"automatic jamming is off: {names.JAM_COMMAND.name} stops, and the driver vents the channels that it "
                "jammed after its command_timeout_s; channels jammed by service stay as they are"
            )
        self._diagnostics.check()
        return response

    def shut_down(self) -> None:
        """Say that this node ends in order."""
        self._diagnostics.farewell()

    def _on_driver(self, message: JamState) -> None:
        self._driver = DriverView(message)
        self._driver_reported = True
        if self._controller.on_driver(self._driver.report):
            self.get_logger().info("the ankle was held by jam_command: it is held on once the body is at rest")
        self._diagnostics.check()

    def _refuse_what_the_driver_refuses(self, changes: list[Parameter]) -> SetParametersResult:
        for change in changes:
            if change.name in VACUUM_PARAMETERS and isinstance(change.value, float):
                objection = self._driver.objection(f"parameter '{change.name}'", change.value)
                if objection:
                    return SetParametersResult(successful=False, reason=objection)
        return SetParametersResult(successful=True)

    def _trouble_with_driver(self) -> str:
        is_fixed = self._values.mode is PolicyMode.FIXED
        for name in VACUUM_PARAMETERS if is_fixed else VACUUM_PARAMETERS[:-1]:
            objection = self._driver.objection(f"parameter '{name}'", getattr(self._values, name))
            if objection:
                return objection
        asked_pa = self._controller.vacuum_pa
        if asked_pa != self._asked_pa:
            self._asked_pa, self._since_asked_s = asked_pa, self.now_s()
        patient = self.now_s() - self._since_asked_s < FOLLOW_S
        return "" if patient or not self._driver_reported else self._driver.trouble(asked_pa)

    def _configure(self, values: ControllerParameters) -> None:
        self._values = values
        self._controller.configure(values)
        if self._auto:
            self._command()

    def _health(self) -> Sequence[Health]:
        contact = contact_health(self._controller, self._driver.soft, is_soft_in_stance=self._is_soft_in_stance())
        return [self._imu_health(), self._input_health(), contact, self._policy_health(), self._liveness.health()]

    def _imu_health(self) -> Health:
        """Say whether the IMU's samples come in and are fit for use."""
        controller, freshness = self._controller, self._freshness
        watch, counts, mount = controller.watch, controller.gate.counts, controller.mount
        freshness.observe(counts, self.now_s())
        values = {
            "rate (Hz)": f"{controller.gate.rate_hz:.0f}",
            "mean specific force (m/s^2)": f"{watch.level_m_s2:.2f}",
            "usable samples": str(counts.usable),
            "held": str(counts.held),
            "ignored, not finite": str(counts.not_finite),
            "ignored, out of range": str(counts.out_of_range),
            "ignored, repeated stamp": str(counts.repeated),
            "ignored, late": str(counts.late),
            "gaps": str(counts.gaps),
            "clock set back": str(counts.restarts),
            "clipped (%)": f"{100.0 * watch.clipped_share:.0f}",
            "silent for (s)": f"{freshness.silent_s:.2f}",
            "stamps behind the clock (s)": f"{self._behind_clock_s:.2f}",
            "detection": "available" if watch.trouble is None else "unavailable",
            **{f"not felt on the {mount.value}: {what}": why for what, why in not_felt(mount).items()},
        }
        seen = (
            f"{counts.not_finite} not finite, {counts.out_of_range} out of range, {counts.repeated} repeated, "
            f"{counts.late} late, {counts.gaps} gaps, {counts.restarts} restarts"
        )
        topic = self.resolve_topic_name(names.IMU.name)
        if freshness.stale:
            ignored = freshness.irregular and counts.ignored
            reason = f" ({counts.ignored} samples were ignored: {seen})" if ignored else ""
            # Whole seconds: a message is sent anew when its text changes.
            silent = f"no usable sample on {topic} for {freshness.silent_s:.0f} s"
            return Health("imu", Level.ERROR, f"{silent}{reason}; {SAFE_MODE}", values)
        if not counts.usable:
            return Health("imu", Level.OK, f"waiting for the first sample on {topic}", values)
        if watch.trouble is ImuTrouble.CHECKING:
            return Health("imu", Level.OK, "samples come in, and are looked at first", values)
        if watch.trouble is not None:
            return Health("imu", Level.ERROR, f"detection is unavailable: {watch.reason}; {SAFE_MODE}", values)
        off = self._stamps_off()
        if freshness.irregular or off:
            come = f"irregular samples: {seen}" if freshness.irregular else "samples come in"
            return Health("imu", Level.WARN, "; ".join(filter(None, (come, off))), values)
        return Health("imu", Level.OK, "samples come in", values)

    @property
    def _behind_clock_s(self) -> float:
        """How far the stamp of the latest sample lies behind the node's clock, s; 0 where either is not known."""
        last_ns = self._controller.gate.last_ns
        if last_ns is None or not self.knows_time:
            return 0.0
        return (self.get_clock().now().nanoseconds - last_ns) / NANOSECONDS_PER_SECOND

    def _stamps_off(self) -> str:
        """Say that the IMU's stamps have not been of the node's clock for `FOLLOW_S`; empty: they are."""
        behind_s, now_s = self._behind_clock_s, self.now_s()
        if abs(behind_s) < STAMPS_OFF_S + self._freshness.silent_s or now_s < self._on_clock_s:
            self._on_clock_s = now_s
        if now_s - self._on_clock_s < FOLLOW_S:
            return ""
        where = f"{STAMPS_OFF_S:g} s or more {'behind' if behind_s > 0.0 else 'ahead of'} the clock of this node"
        return f"stamps are {where}, which times what has no stamp, as {names.GAIT_PHASE.name}: set one clock"

    def _input_health(self) -> Health:
        """Name every input beside the IMU, and whether it is received; none is needed."""
        controller, topics = self._controller, self._inputs
        time_ns = max(self.get_clock().now().nanoseconds, controller.gate.last_ns or 0)
        received = controller.inputs.received(time_ns)
        values = {
            f"{each.value} ({topics[each]})": "received" if each in received else "not received" for each in Input
        }
        level, message = (
            Level.OK,
            f"beside the IMU: {', '.join(each.value for each in Input if each in received) or 'none'}",
        )
        if not controller.feels(Detection.STEP) and not controller.inputs.shows_contact(time_ns):
            message += f"; a step is not felt on the {controller.mount.value}"
            message += ": who walks needs gait, efforts, switch or load"
        if self._leg_trouble:
            level = Level.WARN
            message += f"; the leg is not known: {self._leg_trouble}"
        sole = controller.inputs.sole
        if sole is not None:
            for what, count in dataclasses.asdict(sole.counts).items():
                values[f"odometry, {what.replace('_', ' ')}"] = str(count)
            if Input.ODOMETRY not in received:
                level = Level.WARN
                message += f"; no odometry on {topics[Input.ODOMETRY]} that gives the speed of the sole"
                message += ": slips are the IMU's"
        return Health("inputs", level, message, values)

    def _policy_health(self) -> Health:
        """Say what the policy wants, and whether the driver follows."""
        policy, mode = self._controller.policy, self._values.mode
        values = {AUTOMATIC: str(self._auto).lower(), "contact": self._controller.detector.phase.value}
        values |= {"mode": mode.value, "state": policy.state.value}
        for channel, vacuum_pa in policy.set_points_pa.items():
            values[f"wanted vacuum, {channel} (Pa)"] = f"{vacuum_pa:.0f}"
        landing = policy.landing
        if landing is not None:
            values |= {
                "landing, expected speed (m/s)": f"{landing.speed_m_s:.2f}",
                "landing, vacuum chosen (Pa)": f"{landing.chosen_pa:.0f}",
                "landing, vacuum reached (Pa)": f"{landing.reached_pa:.0f}",
                "landing, why": landing.why,
            }
        trouble = self._trouble_with_driver()
        if not self._auto:
            return Health("policy", Level.OK, f"automatic jamming is off; {names.WAY_BACK}", values)
        if trouble:
            return Health("policy", Level.ERROR, f"automatic: {policy.state.value}, but {trouble}", values)
        if policy.state is PolicyState.FAULT:
            return Health("policy", Level.ERROR, f"fault: nothing shows contact; {SAFE_MODE}", values)
        what = (policy.state if mode is PolicyMode.AUTO else mode).value
        if self._driver.by_hand and self._controller.vacuum_pa > 0.0:
            what += f"; vented by a service: {', '.join(self._driver.by_hand)}, until the policy changes its set points"
            what += f"; {names.WAY_BACK}"
        return Health("policy", Level.OK, f"automatic: {what}", values)


def contact_health(controller: AnkleController, soft: Sequence[str], *, is_soft_in_stance: bool) -> Health:
    """Say what is known of contact; WARN where it is not known for `LOOKED_AT_S`, or the ankle is soft in stance.

    Args:
        controller: Whose knowledge it is.
        soft: Channels that are not asked to jam.
        is_soft_in_stance: Whether they should be, and were not for a while.

    """
    report = controller.contact
    values = {"shown by": report.shown_by or "nothing", "at rest": str(report.at_rest)}
    known = f"{report.contact.value} ({report.shown_by})" if report.shown_by else report.contact.value
    if is_soft_in_stance:
        what = f"soft in stance: {known}, and not asked to jam: {', '.join(soft) or 'no channel is reported'}"
        return Health("contact", Level.WARN, f"{what}; {names.WAY_BACK}", values)
    time_ns = controller.gate.last_ns
    if time_ns is None or report.contact is not Contact.UNKNOWN:
        return Health("contact", Level.OK, "waiting for the first sample" if time_ns is None else known, values)
    if time_ns - report.since_ns < LOOKED_AT_S * NANOSECONDS_PER_SECOND:
        return Health("contact", Level.OK, "unknown: looked at first", values)
    does = "at rest, so held" if report.at_rest else "it moves, so it is left as it is"
    return Health("contact", Level.WARN, f"unknown: nothing shows whether it stands or hangs; {does}; {SAY_SO}", values)
