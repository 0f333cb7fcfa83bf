"""Detectors, inputs and policy as one: samples in, contact events and set points for the tendons out."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_controller.core.detector import ContactDetector
from jammkle_controller.core.events import (
    Contact,
    ContactEvent,
    ContactKind,
    ContactReport,
    Detection,
    Phase,
    Source,
    is_felt,
)
from jammkle_controller.core.imu import Admission, ImuSample, ImuTrouble
from jammkle_controller.core.inputs import AnkleAngles, ContactInputs, Input, Rhythm
from jammkle_controller.core.leg_contact import LegReading
from jammkle_controller.core.motion import PUT_DOWN_S
from jammkle_controller.core.policy import JammingPolicy, PolicyState, Trigger
from jammkle_controller.core.reading import DriverReport
from jammkle_controller.core.slip import BodyTwist, LegPose

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_controller.core.leg import Leg
    from jammkle_controller.core.reading import Received
    from jammkle_controller.core.stepping import StepRatios
    from jammkle_controller.parameters import ControllerParameters

FALLING = 0.5
"""Load on the IMU, in units of gravity, below which it falls: efforts that hold a leg up then look like a load."""
LEANING_RAD = 0.035
"""Roll of the ankle from which on it says which side yields in a slip, rad: 2 deg, beyond its play."""
HELD_REST_S = PUT_DOWN_S
"""At rest for so long, and with nothing that shows it hanging, the ankle is held, s: no hand is as still."""
DEFLECTED_RAD = 0.05
"""Angle of a soft ankle at rest beyond which the ground must be bending it, rad: 2 deg of play and 0.9 deg of a joint's
zero. The foot's own weight, 0.03 N m, bends ours by 0.015 rad at 2 N m/rad."""
_CONTACT_OF = {
    ContactKind.IMPACT: Contact.CONTACT,
    ContactKind.SLIP: Contact.CONTACT,
    ContactKind.LIFTOFF: Contact.NO_CONTACT,
    ContactKind.SWING: Contact.NO_CONTACT,
}


class Reaction(NamedTuple):
    """What one sample led to: its events, oldest first, and whether the set points changed."""

    events: tuple[ContactEvent, ...]
    changed: bool


_NOTHING = Reaction((), changed=False)


class AnkleController:
    """The controller of one ankle without any middleware.

    Of each change of contact the first report counts: by the IMU, a switch, the load, or the gait's plan. A sensor of
    contact that says otherwise overrules the IMU; a plan says which blows on the body are this foot's.

    Attributes:
        contact: What was known of contact at the latest sample or input.
        inputs: What is received beside the IMU.
        detector: What the IMU shows; its gate and its watch say how the samples are.
        policy: What is wanted, and what was chosen for the latest landing.

    """

    def __init__(
        self, parameters: ControllerParameters, ratios: StepRatios | None = None, leg: Leg | None = None
    ) -> None:
        """Start on the ground and soft.

        Args:
            parameters: Of the node.
            ratios: Density ratios of a foot or shank; None: those that come with it.
            leg: What the leg is; None: not known yet, and efforts and odometry are not used before `know`.

        """
        self.inputs = ContactInputs(parameters)
        self.mount = parameters.mount
        self.detector = ContactDetector(parameters, ratios)
        self.gate, self.watch = self.detector.gate, self.detector.watch
        self.policy = JammingPolicy(parameters)
        self._rhythm = Rhythm()
        self._time_ns = 0
        self._stance_held = self._driver_known = False
        self._believed_before = False
        self._felt, self._felt_by = Contact.UNKNOWN, ""
        self._by_hand: bool | None = None
        self.contact = ContactReport(Contact.UNKNOWN, "", at_rest=False, since_ns=0)
        if leg is not None:
            self.know(leg)

    def know(self, leg: Leg) -> None:
        """Take what the leg is."""
        self.inputs.know(leg)
        self.detector.set_lever(leg.lever_m)

    def set_contact(self, *, stands: bool) -> str:
        """Take from a person that the foot stands, or that it does not, until something else is felt.

        Returns:
            Why it is refused: a sensor of contact says otherwise; empty: it is taken.

        """
        now_ns = self._time_ns
        sensor = self.inputs.contact_sensor(now_ns)
        if sensor is not None and self.inputs.measured_contact(now_ns) is not stands:
            return f"{sensor.value} shows that the foot {'does not stand' if stands else 'stands'}"
        self._by_hand, self._stance_held = stands, False
        if stands:
            self.detector.correct(lifted=False, time_ns=now_ns)
            self.policy.take_up(Trigger.SHOWN)
        else:
            self.policy.let_go()
        self.detector.jolt(now_ns)
        self._note_contact(now_ns)
        return ""

    def forget_hand(self) -> None:
        """Go by what is felt again, and not by what a person said of contact."""
        if self._by_hand is not None:
            self._felt, self._felt_by = (Contact.CONTACT if self._by_hand else Contact.UNKNOWN), "said by ~/set_contact"
            self._by_hand = None
            self._note_contact(self._time_ns)

    def configure(self, parameters: ControllerParameters) -> None:
        """Take new parameters and go on from the present state."""
        self.detector.configure(parameters)
        self.inputs.configure(parameters)
        self.policy.parameters = parameters

    def on_driver(self, report: DriverReport) -> bool:
        """Take what the driver reports; return whether a stance is taken over, which the first report alone tells.

        A controller before this one held the ankle: it is held on, once the body is seen at rest. A robot stood there,
        and a controller that was started anew has seen no landing. Any contact event ends the wait: from then on this
        controller knows by itself.
        """
        self.policy.stored = report.stored
        takes_over = report.by_stream and not self._driver_known
        self._driver_known = True
        self._stance_held = self._stance_held or takes_over
        return takes_over

    def update(self, sample: ImuSample) -> Reaction:
        """Take the next sample of the IMU."""
        gate, before_pa = self.detector.gate, self.policy.set_points_pa
        stamp_before_ns, restarts = gate.last_ns, gate.count(Admission.RESTARTED)
        self.detector.bear(self.inputs.leg_contact(sample.time_ns), sample.time_ns)
        event = self.detector.update(sample, stands=self.contact.contact is Contact.CONTACT)
        if gate.count(Admission.RESTARTED) != restarts:
            self._rhythm.forget()
            self.inputs.forget()
            self._forget_contact()
        if gate.last_ns != stamp_before_ns:
            self._time_ns = sample.time_ns
            self.policy.advance(sample.time_ns)
        self._look_at_imu(sample.time_ns)
        reported = () if event is None or not self._counts(event) else (event,)
        for each in reported:
            self._react(each)
        if self.detector.phase is Phase.FLIGHT:
            self.policy.borne_kg = self.inputs.usual_load_n / STANDARD_GRAVITY_M_S2
            self.policy.fall(self.detector.flight_began_ns)
        if self._stance_held and (reported or self.detector.phase is Phase.PLANTED):
            self._stance_held = False
            if not reported:
                self.policy.take_up(Trigger.INHERITED)
        self._take_up_what_stands(sample.time_ns)
        planned_ns = self.inputs.gait.touchdown_ns(sample.time_ns)
        foreseen_ns = self._rhythm.touchdown_ns if planned_ns is None else planned_ns
        if foreseen_ns is not None:
            self.policy.foresee(foreseen_ns)
        return self._reaction(reported, before_pa, sample.time_ns)

    def go_on(self, time_ns: int) -> Reaction:
        """Take the time, ns, in place of an IMU that is silent: what else shows contact is followed."""
        self._time_ns = time_ns
        if not self.inputs.shows_contact(time_ns):
            return _NOTHING
        before_pa = self.policy.set_points_pa
        self.policy.advance(time_ns)
        self._look_at_imu(time_ns)
        self._take_up_what_stands(time_ns)
        return self._reaction((), before_pa, time_ns)

    def take(self, received: Received) -> Reaction:
        """Take whatever is received, by the time at which it came: an odometry's own stamp is earlier."""
        time_ns, what, value = received
        inputs, available = self.inputs, self.detector.available
        if isinstance(what, ImuSample):
            return self.update(what)
        self._time_ns = time_ns
        if isinstance(what, DriverReport):
            self.on_driver(what)
            return _NOTHING
        if isinstance(what, LegPose):
            return self._slip(inputs.on_pose(what, time_ns, stands=self._stands(time_ns)), time_ns)
        if isinstance(what, BodyTwist):
            return self._slip(inputs.on_odometry(what, time_ns), time_ns)
        event = None
        if isinstance(what, Input):
            event = inputs.on_input(what, value, time_ns)
        elif isinstance(what, AnkleAngles):
            inputs.on_angles(what, time_ns)
        elif isinstance(what, LegReading):
            event = inputs.on_leg(what, time_ns, falls=available and self.detector.motion.load < FALLING)
        else:
            event = inputs.on_ankle(what, time_ns)
            if self.detector.phase is Phase.FLIGHT and available:
                # In free fall a foot moves as in no swing, and the end of the fall is felt sooner on the IMU.
                inputs.fly()
                event = None
        return self._take_event(event, time_ns)

    def _stands(self, time_ns: int) -> bool | None:
        """Whether the foot stands: by a sensor of contact, or by an IMU that feels its steps; None: not known."""
        contact = self.inputs.measured_contact(time_ns)
        if contact is None and self.detector.available and self.feels(Detection.STEP):
            return self.detector.phase not in (Phase.FLIGHT, Phase.SWING)
        return contact

    def _slip(self, event: ContactEvent | None, time_ns: int) -> Reaction:
        """React to a slip by odometry."""
        if event is None or self.detector.phase is Phase.FLIGHT:
            return _NOTHING
        before_pa = self.policy.set_points_pa
        self.detector.slide()
        self._react(event)
        return self._reaction((event,), before_pa, time_ns)

    def _take_event(self, event: ContactEvent | None, time_ns: int) -> Reaction:
        if event is None:
            return _NOTHING
        lifted = event.kind is ContactKind.LIFTOFF
        before_pa = self.policy.set_points_pa
        off_ground = self.detector.phase in (Phase.FLIGHT, Phase.SWING)
        plan_only = event.source is Source.GAIT
        # A foot that touches down as planned is felt on foot and shank, where it does, and often not on the body; its
        # ankle's angles and the efforts of its leg feel it wherever the IMU is.
        feels = self.detector.available and self.feels(Detection.STEP)
        feels = feels or self.inputs.leg_contact(time_ns) is not None
        if off_ground is lifted or (plan_only and not lifted and feels):
            return _NOTHING
        if plan_only and lifted and self.inputs.measured_contact(time_ns):
            return _NOTHING
        self.detector.correct(lifted=lifted, time_ns=time_ns)
        self._react(event)
        self._note_contact(time_ns)
        return self._reaction((event,), before_pa, time_ns)

    def _take_up_what_stands(self, time_ns: int) -> None:
        """Hold a stance whose beginning was not felt, and what rests unless something shows that it hangs."""
        self._note_contact(time_ns)
        report = self.contact
        if self.policy.state is not PolicyState.SWING or not report.bears:
            return
        shown = report.contact is Contact.CONTACT
        if shown and self._felt is not Contact.CONTACT:
            self._felt, self._felt_by = report.contact, report.shown_by
        self.detector.correct(lifted=False, time_ns=time_ns)
        self.policy.take_up(Trigger.SHOWN if shown else Trigger.RESTED)

    def _note_contact(self, time_ns: int) -> None:
        at_rest = self.detector.rested_s >= HELD_REST_S
        contact, shown_by = self._known_contact(time_ns, at_rest=at_rest)
        before = self.contact
        since_ns = before.since_ns if before.contact is contact and before.since_ns <= time_ns else time_ns
        self.contact = ContactReport(contact, shown_by, at_rest=at_rest, since_ns=since_ns)

    def _known_contact(self, time_ns: int, *, at_rest: bool) -> tuple[Contact, str]:
        """Return whether the foot stands and what shows it, the surest first."""
        sensor = self.inputs.contact_sensor(time_ns)
        if sensor is not None:
            stands = self.inputs.measured_contact(time_ns)
            return (Contact.CONTACT if stands else Contact.NO_CONTACT), sensor.value
        if self._by_hand is not None:
            return (Contact.CONTACT if self._by_hand else Contact.NO_CONTACT), "said by ~/set_contact"
        return self._shown_at_rest(time_ns) if at_rest else (self._felt, self._felt_by)

    def _shown_at_rest(self, time_ns: int) -> tuple[Contact, str]:
        """Return what shows whether what rests stands or hangs; a plan and an angle say nothing of what moves."""
        hangs = self.inputs.hangs(time_ns)
        if hangs is not None:
            return (Contact.NO_CONTACT if hangs else Contact.CONTACT), "the load cell's sign at rest"
        planned = self.inputs.planned_contact(time_ns)
        if planned is not None:
            return (Contact.CONTACT if planned else Contact.NO_CONTACT), "the gait's plan, at rest"
        if self._felt is Contact.CONTACT:
            return self._felt, self._felt_by
        if not any(self.policy.set_points_pa.values()) and self.inputs.shows_angles(time_ns):
            if self.inputs.deflection_rad(time_ns) > DEFLECTED_RAD:
                return Contact.CONTACT, "the angle of the soft ankle, at rest"
            if self.policy.parameters.takes_blows:  # the least load presses toes up
                return Contact.NO_CONTACT, "the angle of the soft ankle, at rest as it hangs"
        return Contact.UNKNOWN, ""

    def _forget_contact(self) -> None:
        self._felt, self._felt_by = Contact.UNKNOWN, ""

    def _reaction(self, events: tuple[ContactEvent, ...], before_pa: Mapping[str, float], time_ns: int) -> Reaction:
        changed = self.policy.set_points_pa != before_pa
        if changed:
            self.detector.jolt(time_ns)
        return Reaction(events, changed)

    def _counts(self, event: ContactEvent) -> bool:
        """Whether an event of the IMU stands against what else is known; the detector is set right if it does not."""
        touches = event.kind is ContactKind.IMPACT
        contact = self.inputs.measured_contact(event.time_ns)
        if event.kind is ContactKind.SLIP and (contact is False or self.inputs.shows_slips(event.time_ns)):
            return False  # what does not stand does not slide
        if event.kind is ContactKind.LIFTOFF and self.detector.phase is Phase.FLIGHT:
            self.inputs.fly()
            contact = self.inputs.measured_contact(event.time_ns)
        if event.kind in (ContactKind.LIFTOFF, ContactKind.SWING) and contact:
            self.detector.correct(lifted=False, time_ns=event.time_ns)
            return False
        if (
            touches
            and not self.feels(Detection.STEP)
            and contact is None
            and self.inputs.is_another_foots(event.time_ns)
        ):
            if self.policy.state in (PolicyState.SWING, PolicyState.PREPARING):
                self.detector.correct(lifted=True, time_ns=event.time_ns)
            return False
        return True

    def _react(self, event: ContactEvent) -> None:
        roll_rad = (self.inputs.roll_rad or 0.0) if self.inputs.shows_angles(event.time_ns) else 0.0
        if event.kind is ContactKind.SLIP and abs(roll_rad) >= LEANING_RAD:
            # A foot rolled onto its left edge is turned about -x, and stretches the left tendon.
            event = dataclasses.replace(event, direction=(0.0, -1.0 if roll_rad > 0.0 else 1.0, 0.0))
        self.policy.react(event)
        contact = _CONTACT_OF.get(event.kind)
        if contact is not None:
            self._by_hand = None
            self._felt = contact if event.is_felt else Contact.UNKNOWN
            self._felt_by = f"{event.kind.value}, {event.source.value}" if event.is_felt else ""
        if event.kind is ContactKind.LIFTOFF:
            self._rhythm.lift(event.time_ns)
        elif event.kind is ContactKind.IMPACT:
            self._rhythm.land(event.time_ns)
            if event.source is not Source.GAIT:
                self.inputs.gait.feel(event.time_ns)

    def _look_at_imu(self, time_ns: int) -> None:
        """Fall back where nothing shows contact, and come back where something does."""
        trouble = self.detector.watch.trouble
        believed = trouble is None
        looked_at = trouble is ImuTrouble.CHECKING and not self._believed_before
        self._believed_before = self._believed_before or believed
        known = believed or looked_at or self.inputs.shows_contact(time_ns)
        if known and self.policy.state is PolicyState.FAULT:
            self.policy.regain()
        elif not known and self.policy.state is not PolicyState.FAULT:
            self._rhythm.forget()
            if self._stance_held:  # nobody can see any more that it stands: it was held, and is held on
                self._stance_held = False
                self.policy.take_up(Trigger.INHERITED)
            self.policy.lose()
            self._forget_contact()

    def feels(self, detection: Detection) -> bool:
        """Whether the IMU, where it is mounted, is used to detect it."""
        return is_felt(self.mount, detection)

    @property
    def set_points_pa(self) -> Mapping[str, float]:
        """Vacuum wanted per channel, Pa, gauge, positive; 0 is vented."""
        return self.policy.set_points_pa

    @property
    def vacuum_pa(self) -> float:
        """Largest vacuum wanted in any channel, Pa."""
        return max(self.policy.set_points_pa.values())
