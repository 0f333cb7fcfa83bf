"""Contact detection on one IMU stream: the phase of contact, and the detectors of impact and free fall."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_controller.core.events import M_S2, ContactEvent, ContactKind, Detection, Phase, is_felt
from jammkle_controller.core.imu import IGNORED, Admission, ImuGate, ImuSample, ImuWatch
from jammkle_controller.core.motion import Motion, RaiseDetector, RestDetector
from jammkle_controller.core.slip import SlipDetector
from jammkle_controller.core.stepping import SteppingFoot, between_s

if TYPE_CHECKING:
    from jammkle_controller.core.motion import Vector
    from jammkle_controller.core.stepping import StepRatios
    from jammkle_controller.parameters import ControllerParameters

LONG_GAP_S = 1.0
"""After a silence as long as this a stream is looked at anew: a sensor may have been set up anew, s."""
JOLT_S = 0.1
"""How long the ankle jolts its IMU when jammed or vented, s: valves move after 20 ms, fibres grip at 44 ms."""
SEEN_S = 0.05
"""So soon after a blow on the IMU the efforts need not know of it, s: their readings come 50 times a second or more."""
RELOADED = 1.05
"""Load, in units of gravity, at which a body whose foot was said to swing is carried again, blow or none."""
STEPPING_S = 1.5
"""So long after an impact on the ground a body may be walking, s: two strides of 0.7 s. It is not watched for slips."""

_RELOADED_PROBABILITY = 0.8


class ContactDetector:
    """Turns IMU samples into contact events, one sample at a time, with constant memory.

    Only |specific force|, differences of specific force and stamps are used, so the tilt in which the IMU is mounted
    and the origin of the clock do not matter. A flight or swing always ends with an IMPACT, and only they allow the
    next LIFTOFF: a subscriber that vents on LIFTOFF always learns of the landing. While the IMU is not believed,
    nothing is reported.
    """

    def __init__(self, parameters: ControllerParameters, ratios: StepRatios | None = None) -> None:
        """Make a detector that stands on the ground and has seen nothing.

        Args:
            parameters: Of the node.
            ratios: Density ratios of a foot or shank; None: those that come with it.

        """
        self.phase = Phase.GROUND
        self.flight_began_ns = 0
        """Stamp at which the latest free fall began, ns: earlier than it was certain."""
        self._borne: bool | None = None
        self.gate = ImuGate()
        self.watch = ImuWatch(parameters)
        self.motion = Motion()
        self._parameters = parameters
        self._impact = ImpactDetector(parameters)
        self._liftoff = LiftoffDetector(parameters)
        self._raise = RaiseDetector(parameters)
        self._rest = RestDetector()
        self._slip = SlipDetector(parameters)
        self.foot = SteppingFoot(parameters, ratios) if is_felt(parameters.mount, Detection.STEP) else None
        self._unsettled = False
        self._jolted_until_ns = 0
        self._stepped_ns: int | None = None

    def configure(self, parameters: ControllerParameters) -> None:
        """Take new parameters and go on from the present state; the mount stays."""
        self._parameters = parameters
        for part in (self.watch, self._impact, self._liftoff, self._raise, self._slip, self.foot):
            if part is not None:
                part.parameters = parameters

    def set_lever(self, lever_m: Vector) -> None:
        """Take where the sole is from the IMU, in its frame, m: turning about the sole is then no sliding."""
        self._raise.lever_m = self._slip.lever_m = lever_m
        if self.foot is not None:
            self.foot.sole.lever_m = lever_m

    @property
    def available(self) -> bool:
        """Whether the IMU is believed."""
        return self.watch.trouble is None

    @property
    def swing_probability(self) -> float:
        """Probability that the foot is off the ground."""
        if self.foot is not None:
            return self.foot.swing.probability
        return _FREE_FALL_PROBABILITY if self.phase in (Phase.FLIGHT, Phase.SWING) else 1.0 - _FREE_FALL_PROBABILITY

    @property
    def rested_s(self) -> float:
        """How long the IMU has been at rest, s; 0: it moves, or it is not believed."""
        return self._raise.rested_s if self.available else 0.0

    def jolt(self, time_ns: int) -> None:
        """Note that the ankle is jammed or vented now, which shakes the IMU."""
        self._jolted_until_ns = time_ns + round(JOLT_S * NANOSECONDS_PER_SECOND)

    def correct(self, *, lifted: bool, time_ns: int) -> None:
        """Take what another sensor says of the contact: it knows better."""
        if lifted and self.phase not in (Phase.FLIGHT, Phase.SWING):
            self._leave(Phase.SWING, time_ns)
        elif not lifted and self.phase in (Phase.FLIGHT, Phase.SWING):
            self._impact.last_ns = time_ns
            self._land(time_ns)

    def slide(self) -> None:
        """Take that the foot slides: it does not rest."""
        if self.phase is Phase.PLANTED:
            self.phase = Phase.GROUND
            self._rest.restart()

    def bear(self, borne: bool | None, time_ns: int) -> None:  # noqa: FBT001 - three things that it may be
        """Take whether the efforts of the leg say that the foot stands; None: they are not known.

        They know steps better: while they are known the IMU is asked for free fall, its end, and slips alone.
        """
        self._borne = borne
        hit_ns = self._impact.last_ns
        hit = hit_ns is not None and between_s(hit_ns, time_ns) < SEEN_S
        if borne is False and self.phase in (Phase.GROUND, Phase.PLANTED) and not hit:
            self.correct(lifted=True, time_ns=time_ns)
        elif borne and self.phase is Phase.SWING:
            self.correct(lifted=False, time_ns=time_ns)

    def update(self, sample: ImuSample, *, stands: bool = False) -> ContactEvent | None:
        """Take the next sample and return what it decided; samples the gate ignores decide nothing.

        Args:
            sample: The sample.
            stands: Whether the foot is known to stand.

        """
        admission = self.gate.admit(sample)
        if admission is Admission.RESTARTED or (admission is Admission.AFTER_GAP and self.gate.interval_s > LONG_GAP_S):
            self.watch.begin_anew()
        rates_hz = self.gate.rate_hz, self.gate.published_hz
        believed = self.watch.observe(sample, admission, rates_hz, stands=stands)
        if admission in IGNORED:
            return None
        if admission is Admission.USABLE:
            self._follow(sample, self.gate.interval_s)
        else:
            self._begin_anew(sample, admission)
        if not believed:
            self._suspend(sample)
            return None
        if self.phase in (Phase.FLIGHT, Phase.SWING):
            return self._swing_on(sample.time_ns)
        return self._stand(sample, self.gate.interval_s if admission is Admission.USABLE else 0.0)

    def _follow(self, sample: ImuSample, interval_s: float) -> None:
        self.motion.update(sample, interval_s)
        self._impact.follow(sample.time_ns, interval_s, self.motion.force_m_s2)
        self._raise.follow(sample, interval_s)
        if self.foot is not None:
            self.foot.update(self.motion, interval_s)

    def _begin_anew(self, sample: ImuSample, admission: Admission) -> None:
        """Forget what cannot be compared with the next sample; a flight goes on, its landing may lie in the gap."""
        self.motion = Motion((sample.force_x, sample.force_y, sample.force_z))
        self._forget_what_was_felt()
        if self.foot is not None:
            self.foot.restart()
        if admission is Admission.RESTARTED:
            self._impact.last_ns = None
            self._unsettled = False
            self._jolted_until_ns = 0
            self._stepped_ns = None
            self.phase = Phase.GROUND
        elif self.phase is Phase.PLANTED:
            self.phase = Phase.GROUND

    def _suspend(self, sample: ImuSample) -> None:
        """Forget what was felt on an IMU that is not believed."""
        self._forget_what_was_felt()
        if self.foot is not None:
            self.foot.suspend()
        self._unsettled = False
        self.phase = Phase.GROUND
        self._impact.last_ns = sample.time_ns

    def _forget_what_was_felt(self) -> None:
        self._impact.restart(self.motion.force_m_s2)
        self._liftoff.restart()
        self._raise.restart()
        self._rest.restart()
        self._slip.release()

    def _swing_on(self, time_ns: int) -> ContactEvent | None:
        flies = self.phase is Phase.FLIGHT and self.foot is None
        force = self.motion.force_m_s2
        impact = self._impact.in_flight(time_ns, force) if flies else self._end_of_swing(time_ns)
        if flies and impact is not None and self._borne is False and self._parameters.takes_blows:
            # A body is caught by the first of its feet: when this one stands its ankle says, some 5 ms later.
            self.phase = Phase.SWING
            return None
        if impact is not None:
            self._impact.last_ns = time_ns
            self._land(time_ns)
            return impact
        return None if self.foot is None else self.foot.swinging(time_ns, self.motion)

    def _end_of_swing(self, time_ns: int) -> ContactEvent | None:
        """Return an impact when what was in the air is hit, or, reported late, stands."""
        if self._borne is not None and self.phase is Phase.SWING:
            # A body that is held up falls when it is let go; the shank of a leg that swings is at times as light.
            dropped = self._liftoff.on_ground(time_ns, self.motion.force_m_s2) if self.foot is None else None
            if dropped is not None:
                self.phase = Phase.FLIGHT
                self._note_flight(dropped)
            return None
        force = self.motion.force_m_s2
        foot = self.foot
        impact = self._impact.on_ground(time_ns, force) if foot is None else foot.blow(time_ns, self.motion)
        if impact is not None:
            return impact
        if self._raise.is_raised:
            return self._raise.set_down(time_ns, force)
        if foot is not None:
            return foot.stands(time_ns, self.motion)
        if self.motion.load <= RELOADED:
            return None
        return ContactEvent(ContactKind.IMPACT, time_ns, force, M_S2, 0.0, _RELOADED_PROBABILITY)

    def _stand(self, sample: ImuSample, interval_s: float) -> ContactEvent | None:
        time_ns, force = sample.time_ns, self.motion.force_m_s2
        liftoff = self._leaving(time_ns)
        if liftoff is not None:
            return liftoff
        jolted = time_ns < self._jolted_until_ns
        # A foot or shank jumps by itself as it is lifted: there only a swing ends in an impact.
        steps_felt = self.foot is None and self._borne is None
        impact = self._impact.on_ground(time_ns, force, disturbed=jolted) if steps_felt else None
        if impact is not None:
            self._land(time_ns)
            return impact
        if self.foot is None:
            slip = self._slip.on_ground(sample, interval_s, self.motion, disturbed=jolted)
        else:
            slip = self.foot.sliding(sample, self.motion)
        if slip is not None:
            self.phase = Phase.GROUND
            self._rest.restart()
            return slip
        return self._come_to_rest(sample)

    def _leaving(self, time_ns: int) -> ContactEvent | None:
        """Return a lift-off: by free fall, of a foot or shank by the probability of a swing, or by a slow rise."""
        if self._borne is False:  # it has left already
            return None
        force = self.motion.force_m_s2
        liftoff = self._liftoff.on_ground(time_ns, force)
        if liftoff is not None:
            self._leave(Phase.FLIGHT, time_ns)
            self._note_flight(liftoff)
            return liftoff
        if self._borne is not None:
            return None
        if self.foot is not None:
            liftoff = self.foot.leaving(time_ns, self._impact.last_ns, self.motion)
            if liftoff is not None:
                self._leave(Phase.SWING, time_ns)
                return liftoff
        liftoff = self._raise.on_ground(time_ns)
        if liftoff is not None:
            self._leave(Phase.SWING, time_ns)
            self._raise.is_raised = True
        return liftoff

    def _note_flight(self, liftoff: ContactEvent) -> None:
        delay_ns = round(liftoff.detection_delay_s * NANOSECONDS_PER_SECOND)
        self.flight_began_ns = liftoff.time_ns - delay_ns

    def _leave(self, phase: Phase, time_ns: int) -> None:
        self.phase = phase
        self._raise.is_raised = False
        self._unsettled = False
        self._rest.restart()
        self._slip.release()
        if self.foot is not None:
            self.foot.leave(time_ns)

    def _land(self, time_ns: int) -> None:
        flew = self.phase is Phase.FLIGHT
        self.phase = Phase.GROUND
        self._unsettled = True
        self._liftoff.restart()
        self._raise.disarm()
        self._rest.restart()
        if flew:
            self._slip.land(time_ns)
        else:
            self._slip.release()
            self._stepped_ns = time_ns
        if self.foot is not None:
            self.foot.land(time_ns)

    def _come_to_rest(self, sample: ImuSample) -> ContactEvent | None:
        time_ns, _, _, _, x, y, z = sample
        if self.phase is Phase.PLANTED and self.foot is None and not self._slip.watches and not self._walks(time_ns):
            self.phase = Phase.GROUND
        if self.phase is Phase.PLANTED:
            return None
        rest = self._rest.on_ground(time_ns, self.motion.force_m_s2, x * x + y * y + z * z)
        if rest is None:
            return None
        self.phase = Phase.PLANTED
        if not self._slip.watches and not self._walks(time_ns):
            self._slip.plant(sample)
        unsettled, self._unsettled = self._unsettled, False
        return rest if unsettled else None

    def _walks(self, time_ns: int) -> bool:
        """Whether it was hit lately without having flown, so that it may be stepping, and slips are not felt in it."""
        if is_felt(self._parameters.mount, Detection.SLIP_STEPPING):
            return False
        return self._stepped_ns is not None and between_s(self._stepped_ns, time_ns) < STEPPING_S


FOLLOW_TIME_S = 0.02
"""Time constant with which the level before a hit follows a rise, s. Longer than the rise of a shock (5 to 15 ms for
a soft ankle), shorter than the heave of a walking body (100 ms and more)."""

ONSET_M_S2 = 1.0
"""Rise from which on a sample is said to carry the impact, m/s^2: 30 times the noise of the magnitude
(80 ug/sqrt(Hz) over 225 Hz is 0.015 m/s^2 per axis), so that noise never opens an impact."""

TOUCHDOWN_M_S2 = 4.0
"""|specific force| above which a flight has ended, m/s^2: above any `flight_threshold_m_s2`."""
REFRACTORY_S = 0.15
"""Time after an impact in which the ground gives no other, s; a new flight ends it early."""
_FLIGHT_PROBABILITY = 0.99
_GROUND_PROBABILITY = 0.7
"""Probability of an impact after free fall, and on the ground, where a blow may also come from another foot."""


class ImpactDetector:
    """Compares |specific force| with thresholds: in flight with nearly nothing, on the ground with the weight.

    A body whose |specific force| stays below g + `impact_threshold_m_s2` raises no alarm on the ground, and neither
    does one that is heaved slowly: the force must also rise above its level. That drops at once with the signal and
    follows a rise with `FOLLOW_TIME_S`, so that it is the lowest recent value at any rate; the size of an impact is
    measured from it.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        """Make a detector that has seen nothing."""
        self.parameters = parameters
        self._level = 0.0
        self._level_before = 0.0
        self._onset_ns: int | None = None
        self.last_ns: int | None = None
        """Stamp of the last impact, be it found here or elsewhere, ns."""

    def restart(self, force_m_s2: float) -> None:
        """Forget the level: the next rise is measured from `force_m_s2`."""
        self._level = force_m_s2
        self._onset_ns = None

    def follow(self, time_ns: int, interval_s: float, force_m_s2: float) -> None:
        """Take the next |specific force|. Call it once per sample, before `in_flight` or `on_ground`."""
        level = self._level
        if force_m_s2 <= level:
            self._level = force_m_s2
            self._onset_ns = None
            return
        rise = force_m_s2 - level
        if rise > ONSET_M_S2:
            if self._onset_ns is None:
                self._onset_ns = time_ns
                self._level_before = level
        else:
            self._onset_ns = None
        # Implicit Euler: stable for any interval.
        self._level = level + rise * interval_s / (interval_s + FOLLOW_TIME_S)

    def in_flight(self, time_ns: int, force_m_s2: float) -> ContactEvent | None:
        """Return an impact if the flight ended: the ground carries more than `TOUCHDOWN_M_S2`."""
        if force_m_s2 <= TOUCHDOWN_M_S2:
            return None
        return self._impact(time_ns, force_m_s2, _FLIGHT_PROBABILITY)

    def on_ground(self, time_ns: int, force_m_s2: float, *, disturbed: bool = False) -> ContactEvent | None:
        """Return an impact if the force is above weight and level by more than the threshold, unless one has just been.

        Args:
            time_ns: Of the sample.
            force_m_s2: Its |specific force|.
            disturbed: The ankle itself is jolting the IMU: only twice as much counts.

        """
        carried_m_s2 = max(STANDARD_GRAVITY_M_S2, self._level)
        if force_m_s2 - carried_m_s2 <= self.parameters.impact_threshold_m_s2 * (2.0 if disturbed else 1.0):
            return None
        if self.last_ns is not None and between_s(self.last_ns, time_ns) < REFRACTORY_S:
            return None
        return self._impact(time_ns, force_m_s2, _GROUND_PROBABILITY)

    def _impact(self, time_ns: int, force_m_s2: float, probability: float) -> ContactEvent:
        onset_ns = time_ns if self._onset_ns is None else self._onset_ns
        level = self._level if self._onset_ns is None else self._level_before
        self.last_ns = time_ns
        delay_s = between_s(onset_ns, time_ns)
        return ContactEvent(ContactKind.IMPACT, time_ns, force_m_s2 - level, M_S2, delay_s, probability)


FLIGHT_CONFIRM_S = 0.03
"""Time of free fall after which it is reported, s: a hop of 1 mm lasts as long, and is no reason to vent."""
LEAST_FLIGHT_SAMPLES = 3
"""A flight is seen by at least this many samples, so that a gap in the stream does not make one."""

_FREE_FALL_PROBABILITY = 0.99
"""Nothing but a flight is that light for that long."""


class LiftoffDetector:
    """Reports free fall once it has lasted `FLIGHT_CONFIRM_S`."""

    def __init__(self, parameters: ControllerParameters) -> None:
        """Make a detector that has seen nothing."""
        self.parameters = parameters
        self._since_ns: int | None = None
        self._samples = 0

    def restart(self) -> None:
        """Forget a flight that has begun."""
        self._since_ns = None

    def on_ground(self, time_ns: int, force_m_s2: float) -> ContactEvent | None:
        """Take the next |specific force| while on the ground; return a lift-off if it is certain now."""
        if force_m_s2 >= self.parameters.flight_threshold_m_s2:
            self._since_ns = None
            return None
        if self._since_ns is None:
            self._since_ns = time_ns
            self._samples = 0
        self._samples += 1
        lasted_s = between_s(self._since_ns, time_ns)
        if self._samples < LEAST_FLIGHT_SAMPLES or lasted_s < FLIGHT_CONFIRM_S:
            return None
        self._since_ns = None
        return ContactEvent(ContactKind.LIFTOFF, time_ns, force_m_s2, M_S2, lasted_s, _FREE_FALL_PROBABILITY)
