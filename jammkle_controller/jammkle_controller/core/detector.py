"""All detectors on one IMU stream, and the phase of contact they agree on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.detector_settings import DetectorSettings, Phase
from jammkle_controller.core.events import M_S2, ContactEvent, ContactKind
from jammkle_controller.core.impact import ImpactDetector
from jammkle_controller.core.imu import IGNORED, Admission, ImuGate, ImuSample
from jammkle_controller.core.liftoff import LiftoffDetector
from jammkle_controller.core.motion import Motion
from jammkle_controller.core.offered import Detection, is_felt
from jammkle_controller.core.raised import RaiseDetector
from jammkle_controller.core.settled import RestDetector
from jammkle_controller.core.slip import SlipDetector
from jammkle_controller.core.stepping import SteppingFoot
from jammkle_controller.core.watch import ImuWatch

if TYPE_CHECKING:
    from jammkle_controller.core.density_ratio import StepRatios

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

_NOTHING: tuple[ContactEvent, ...] = ()
_FREE_FALL_PROBABILITY = 0.99
_RELOADED_PROBABILITY = 0.8


class ContactDetector:
    """Turns IMU samples into contact events, one sample at a time, with constant memory.

    Only |specific force|, differences of specific force and stamps are used, so the tilt in which the IMU is mounted
    and the origin of the clock do not matter. A flight or swing always ends with an IMPACT, and only they allow the
    next LIFTOFF: a listener that vents on LIFTOFF always hears of the landing. While the IMU is not believed, nothing
    is told.
    """

    def __init__(self, settings: DetectorSettings, ratios: StepRatios | None = None) -> None:
        """Make a detector that stands on the ground and has seen nothing.

        Args:
            settings: Of every part.
            ratios: Density ratios of a foot or shank; None: those that come with it.

        """
        self.phase = Phase.GROUND
        self._borne: bool | None = None
        self.gate = ImuGate(settings.max_gap_s)
        self.watch = ImuWatch(settings.watch)
        self.motion = Motion()
        self._settings = settings
        self._impact = ImpactDetector(settings.impact)
        self._liftoff = LiftoffDetector(settings.liftoff)
        self._raise = RaiseDetector(settings.raised, settings.slip.lever_m)
        self._rest = RestDetector(settings.settled)
        self._slip = SlipDetector(settings.slip)
        self.foot = SteppingFoot(settings, ratios) if is_felt(settings.mount, Detection.STEP) else None
        self._unsettled = False
        self._jolted_until_ns = 0
        self._stepped_ns: int | None = None

    def configure(self, settings: DetectorSettings) -> None:
        """Take new settings and go on from the present state; the mount stays."""
        self._settings = settings
        self.gate.max_gap_s = settings.max_gap_s
        self.watch.settings = settings.watch
        self._impact.settings = settings.impact
        self._liftoff.settings = settings.liftoff
        self._raise.settings = settings.raised
        self._rest.settings = settings.settled
        self._slip.settings = settings.slip
        if self.foot is not None:
            self.foot.settings = settings

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
            self._impact.note(time_ns)
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
        hit = hit_ns is not None and time_ns - hit_ns < SEEN_S * NANOSECONDS_PER_SECOND
        if borne is False and self.phase in (Phase.GROUND, Phase.PLANTED) and not hit:
            self.correct(lifted=True, time_ns=time_ns)
        elif borne and self.phase is Phase.SWING:
            self.correct(lifted=False, time_ns=time_ns)

    def update(self, sample: ImuSample, *, stands: bool = False) -> tuple[ContactEvent, ...]:
        """Take the next sample and return what it decided, oldest first; samples the gate ignores decide nothing.

        Args:
            sample: The sample.
            stands: Whether the foot is known to stand.

        """
        admission = self.gate.admit(sample)
        if admission is Admission.RESTARTED or (admission is Admission.AFTER_GAP and self.gate.interval_s > LONG_GAP_S):
            self.watch.begin_anew()
        believed = self.watch.observe(sample, admission, self.gate.rate_hz, self.gate.published_hz, stands=stands)
        if admission in IGNORED:
            return _NOTHING
        if admission is Admission.USABLE:
            self._follow(sample, self.gate.interval_s)
        else:
            self._begin_anew(sample, admission)
        if not believed:
            self._suspend(sample)
            return _NOTHING
        if self.phase is Phase.FLIGHT and self.foot is None:
            return self._fly(sample.time_ns)
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
        self._impact.restart(self.motion.force_m_s2)
        self._liftoff.restart()
        self._raise.restart()
        self._rest.restart()
        self._slip.release()
        if self.foot is not None:
            self.foot.restart()
        if admission is Admission.RESTARTED:
            self._impact.forget_impacts()
            self._unsettled = False
            self._jolted_until_ns = 0
            self._stepped_ns = None
            self.phase = Phase.GROUND
        elif self.phase is Phase.PLANTED:
            self.phase = Phase.GROUND

    def _suspend(self, sample: ImuSample) -> None:
        """Forget what was felt on an IMU that is not believed."""
        self._liftoff.restart()
        self._raise.restart()
        self._rest.restart()
        self._slip.release()
        self._impact.restart(self.motion.force_m_s2)
        if self.foot is not None:
            self.foot.suspend()
        self._unsettled = False
        self.phase = Phase.GROUND
        self._impact.note(sample.time_ns)

    def _fly(self, time_ns: int) -> tuple[ContactEvent, ...]:
        impact = self._impact.in_flight(time_ns, self.motion.force_m_s2)
        if impact is None:
            return _NOTHING
        self._land(time_ns)
        return (impact,)

    def _swing_on(self, time_ns: int) -> tuple[ContactEvent, ...]:
        impact = self._end_of_swing(time_ns)
        if impact is not None:
            self._impact.note(time_ns)
            self._land(time_ns)
            return (impact,)
        swings = None if self.foot is None else self.foot.swinging(time_ns, self.motion)
        return _NOTHING if swings is None else (swings,)

    def _end_of_swing(self, time_ns: int) -> ContactEvent | None:
        """Return an impact when what was in the air is hit, or, reported late, stands."""
        if self._borne is not None and self.phase is Phase.SWING:
            # A body that is held up falls when it is let go; the shank of a leg that swings is at times as light.
            if self.foot is None and self._liftoff.on_ground(time_ns, self.motion.force_m_s2) is not None:
                self.phase = Phase.FLIGHT
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

    def _stand(self, sample: ImuSample, interval_s: float) -> tuple[ContactEvent, ...]:
        time_ns, force = sample.time_ns, self.motion.force_m_s2
        liftoff = self._leaving(time_ns)
        if liftoff is not None:
            return (liftoff,)
        jolted = time_ns < self._jolted_until_ns
        # A foot or shank jumps by itself as it is lifted: there only a swing ends in an impact.
        steps_felt = self.foot is None and self._borne is None
        impact = self._impact.on_ground(time_ns, force, disturbed=jolted) if steps_felt else None
        if impact is not None:
            self._land(time_ns)
            return (impact,)
        if self.foot is None:
            slip = self._slip.on_ground(sample, interval_s, self.motion, disturbed=jolted)
        else:
            slip = self.foot.sliding(sample, self.motion)
        if slip is not None:
            self.phase = Phase.GROUND
            self._rest.restart()
            return (slip,)
        return self._come_to_rest(sample)

    def _leaving(self, time_ns: int) -> ContactEvent | None:
        """Return a lift-off: by free fall, of a foot or shank by the probability of a swing, or by a slow rise."""
        if self._borne is False:  # it has left already
            return None
        force = self.motion.force_m_s2
        liftoff = self._liftoff.on_ground(time_ns, force)
        if liftoff is not None:
            self._leave(Phase.FLIGHT, time_ns)
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
            self._raise.raise_it()
        return liftoff

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

    def _come_to_rest(self, sample: ImuSample) -> tuple[ContactEvent, ...]:
        time_ns, _, _, _, x, y, z = sample
        if self.phase is Phase.PLANTED and self.foot is None and not self._slip.watching and not self._walks(time_ns):
            self.phase = Phase.GROUND
        if self.phase is Phase.PLANTED:
            return _NOTHING
        rest = self._rest.on_ground(time_ns, self.motion.force_m_s2, x * x + y * y + z * z)
        if rest is None:
            return _NOTHING
        self.phase = Phase.PLANTED
        if not self._slip.watching and not self._walks(time_ns):
            self._slip.plant(sample)
        if not self._unsettled:
            return _NOTHING
        self._unsettled = False
        return (ContactEvent(ContactKind.SETTLED, time_ns, rest.rms_m_s2, M_S2, rest.lasted_s),)

    def _walks(self, time_ns: int) -> bool:
        """Whether it was hit lately without having flown, so that it may be stepping, and slips are not felt in it."""
        if is_felt(self._settings.mount, Detection.SLIP_STEPPING):
            return False
        return self._stepped_ns is not None and time_ns - self._stepped_ns < STEPPING_S * NANOSECONDS_PER_SECOND
