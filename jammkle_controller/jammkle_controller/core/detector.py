"""All detectors on one IMU stream, and the phase of contact they agree on."""

from __future__ import annotations

from jammkle_controller.core.density_ratio import learned
from jammkle_controller.core.detector_settings import DetectorSettings, Mount, Phase
from jammkle_controller.core.events import M_S, M_S2, ContactEvent, ContactKind
from jammkle_controller.core.impact import ImpactDetector
from jammkle_controller.core.imu import IGNORED, Admission, ImuGate, ImuSample
from jammkle_controller.core.liftoff import LiftoffDetector
from jammkle_controller.core.motion import Motion
from jammkle_controller.core.settled import RestDetector
from jammkle_controller.core.slip import SlipDetector
from jammkle_controller.core.sole import SoleFilter
from jammkle_controller.core.swing import SwingFilter
from jammkle_controller.core.touchdown import TouchdownDetector
from jammkle_controller.core.unloading import UnloadingDetector
from jammkle_controller.core.watch import ImuWatch
from jammkle_graph.constants import NANOSECONDS_PER_SECOND

LONG_GAP_S = 1.0
"""After a silence as long as this a stream is looked at anew: a sensor may have been set up anew, s."""
JOLT_S = 0.1
"""How long the ankle jolts its IMU when jammed or vented, s: valves move after 20 ms, fibres grip at 44 ms."""
REBOUND_S = 0.08
"""After a touch-down a foot does not leave again so soon, s: what shakes it is the touch-down."""
UNLOADED_RISE_M_S2 = 5.0
"""Jump of |specific force| that ends the unloading of a walking body, m/s^2: half of its weight within 20 ms."""
RELOADED = 1.05
"""Load, in units of gravity, at which an unloaded body is carried again, blow or none."""
AS_LIKELY = 0.5
SURE_SWING = 0.95
SURE_SWING_S = 0.06
"""Probability and time of a swing from which on it is told: twice the longest window of the features."""


_NOTHING: tuple[ContactEvent, ...] = ()
_FREE_FALL_PROBABILITY = 0.99
_UNLOADED_PROBABILITY = 0.8


class ContactDetector:
    """Turns IMU samples into contact events, one sample at a time, with constant memory.

    Only |specific force|, differences of specific force and stamps are used, so the tilt in which the IMU is mounted
    and the origin of the clock do not matter. A flight or swing always ends with an IMPACT, and only they allow the
    next LIFTOFF: a listener that vents on LIFTOFF always hears of the landing. While the IMU is not believed, nothing
    is told.
    """

    def __init__(self, settings: DetectorSettings) -> None:
        """Make a detector that stands on the ground and has seen nothing."""
        self.phase = Phase.GROUND
        self.gate = ImuGate(settings.max_gap_s)
        self.watch = ImuWatch(settings.watch)
        self.motion = Motion()
        self._settings = settings
        self._impact = ImpactDetector(settings.impact)
        self._liftoff = LiftoffDetector(settings.liftoff)
        self._rest = RestDetector(settings.settled)
        self._slip = SlipDetector(settings.slip)
        self._unloading = UnloadingDetector(settings.unloading)
        self._swing: SwingFilter | None = None
        self._touchdown: TouchdownDetector | None = None
        self.sole: SoleFilter | None = None
        if settings.mount is not Mount.BODY:
            self._swing = SwingFilter(learned(f"swing_{settings.mount.value}"))
            self._touchdown = TouchdownDetector(
                learned(f"touchdown_{settings.mount.value}"), settings.touchdown_probability
            )
            self.sole = SoleFilter(learned(f"slide_{settings.mount.value}"), settings.slip.lever_m)
        self._unsettled = False
        self._swing_since_ns = 0
        self._swing_told = False
        self._rising_since_ns: int | None = None
        self._jolted_until_ns = 0
        self._sliding = False
        self._slide_since_ns = 0

    def configure(self, settings: DetectorSettings) -> None:
        """Take new settings and go on from the present state; the mount stays."""
        self._settings = settings
        self.gate.max_gap_s = settings.max_gap_s
        self.watch.settings = settings.watch
        self._impact.settings = settings.impact
        self._liftoff.settings = settings.liftoff
        self._rest.settings = settings.settled
        self._slip.settings = settings.slip
        self._unloading.settings = settings.unloading

    @property
    def available(self) -> bool:
        """Whether the IMU is believed."""
        return self.watch.trouble is None

    @property
    def swing_probability(self) -> float:
        """Probability that the foot is off the ground."""
        if self._swing is not None:
            return self._swing.probability
        return _FREE_FALL_PROBABILITY if self.phase in (Phase.FLIGHT, Phase.SWING) else 1.0 - _FREE_FALL_PROBABILITY

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

    def update(self, sample: ImuSample) -> tuple[ContactEvent, ...]:
        """Take the next sample and return what it decided, oldest first; samples the gate ignores decide nothing."""
        admission = self.gate.admit(sample)
        if admission is Admission.RESTARTED or (admission is Admission.AFTER_GAP and self.gate.interval_s > LONG_GAP_S):
            self.watch.begin_anew()
        believed = self.watch.observe(sample, admission, self.gate.rate_hz)
        if admission in IGNORED:
            return _NOTHING
        interval_s = self.gate.interval_s
        if admission is Admission.USABLE:
            self.motion.update(sample, interval_s)
            self._impact.follow(sample.time_ns, interval_s, self.motion.force_m_s2)
        else:
            self._begin_anew(sample, admission)
            interval_s = 0.0
        swing = self._swing.update(self.motion.features(), interval_s) if self._swing is not None else None
        if not believed:
            self._suspend(sample)
            return _NOTHING
        if self.phase is Phase.FLIGHT and swing is None:
            return self._fly(sample.time_ns)
        if self.phase in (Phase.FLIGHT, Phase.SWING):
            return self._swing_on(sample.time_ns, swing)
        return self._stand(sample, interval_s, swing)

    def _begin_anew(self, sample: ImuSample, admission: Admission) -> None:
        """Forget what cannot be compared with the next sample; a flight goes on, its landing may lie in the gap."""
        self.motion = Motion((sample.force_x, sample.force_y, sample.force_z))
        self._impact.restart(self.motion.force_m_s2)
        self._liftoff.restart()
        self._rest.restart()
        self._slip.release()
        self._unloading.restart()
        if self._swing is not None:
            self._swing.restart()
        if admission is Admission.RESTARTED:
            self._impact.forget_impacts()
            self._unloading.forget()
            self._unsettled = False
            self._rising_since_ns = None
            self._jolted_until_ns = 0
            self.phase = Phase.GROUND
        elif self.phase is Phase.PLANTED:
            self.phase = Phase.GROUND

    def _suspend(self, sample: ImuSample) -> None:
        """Forget what was felt on an IMU that is not believed."""
        self._liftoff.restart()
        self._rest.restart()
        self._slip.release()
        self._unloading.restart()
        self._impact.restart(self.motion.force_m_s2)
        self._rising_since_ns = None
        self._unsettled = False
        self.phase = Phase.GROUND
        self._impact.note(sample.time_ns)

    def _fly(self, time_ns: int) -> tuple[ContactEvent, ...]:
        impact = self._impact.in_flight(time_ns, self.motion.force_m_s2)
        if impact is None:
            return _NOTHING
        self._land(time_ns)
        return (impact,)

    def _swing_on(self, time_ns: int, swing: float | None) -> tuple[ContactEvent, ...]:
        impact = self._end_of_swing(time_ns, swing)
        if impact is not None:
            self._impact.note(time_ns)
            self._land(time_ns)
            return (impact,)
        swung_s = (time_ns - self._swing_since_ns) / NANOSECONDS_PER_SECOND
        if self._swing_told or swing is None or swing < SURE_SWING or swung_s < SURE_SWING_S:
            return _NOTHING
        self._swing_told = True
        return (ContactEvent(ContactKind.SWING, time_ns, self.motion.force_m_s2, M_S2, swung_s, swing),)

    def _end_of_swing(self, time_ns: int, swing: float | None) -> ContactEvent | None:
        motion = self.motion
        if swing is None or self._touchdown is None:
            impact = self._impact.unloaded(time_ns, motion.force_m_s2, UNLOADED_RISE_M_S2)
            stands = motion.load > RELOADED
        else:
            swung_s = (time_ns - self._swing_since_ns) / NANOSECONDS_PER_SECOND
            impact = self._touchdown.in_swing(time_ns, motion, swung_s)
            stands = swing < self._settings.swing.stance_probability
        if impact is None and stands:
            # No blow was felt, and yet the foot stands: a soft touch-down, told late.
            late_s = 0.0 if swing is None else self._since(time_ns)
            impact = ContactEvent(ContactKind.IMPACT, time_ns, motion.sharp_m_s2, M_S2, late_s, 1.0 - (swing or 0.2))
        return impact

    def _since(self, time_ns: int) -> float:
        return 0.0 if self._rising_since_ns is None else (time_ns - self._rising_since_ns) / NANOSECONDS_PER_SECOND

    def _stand(self, sample: ImuSample, interval_s: float, swing: float | None) -> tuple[ContactEvent, ...]:
        time_ns, force = sample.time_ns, self.motion.force_m_s2
        liftoff = self._leaving(time_ns, swing)
        if liftoff is not None:
            return (liftoff,)
        jolted = time_ns < self._jolted_until_ns
        # A foot or shank jumps by itself as it is lifted: there only a swing ends in an impact.
        impact = self._impact.on_ground(time_ns, force) if swing is None else None
        if impact is not None and not (jolted and impact.magnitude < 2.0 * self._settings.impact.impact_jump_m_s2):
            self._land(time_ns)
            return (impact,)
        if self.sole is None or swing is None:
            slip = self._slip.on_ground(sample, interval_s, self.motion, disturbed=jolted)
        else:
            slip = self._sliding_sole(self.sole, sample, interval_s, swing)
        if slip is not None:
            self.phase = Phase.GROUND
            self._rest.restart()
            return (slip,)
        return self._come_to_rest(sample, swing)

    def _sliding_sole(
        self, sole: SoleFilter, sample: ImuSample, interval_s: float, swing: float
    ) -> ContactEvent | None:
        """Return a slip of a foot or shank when it becomes probable; another only after it was improbable."""
        time_ns = sample.time_ns
        sole.follow(sample, interval_s, self.motion)
        before = sole.probability
        probability = sole.update(time_ns, interval_s, self.motion, swing)
        if before < AS_LIKELY <= probability:
            self._slide_since_ns = time_ns
        if self._sliding or probability < self._settings.slip.probability:
            self._sliding &= probability > 1.0 - self._settings.slip.probability
            return None
        self._sliding = True
        since_s = (time_ns - self._slide_since_ns) / NANOSECONDS_PER_SECOND
        return ContactEvent(
            ContactKind.SLIP, time_ns, sole.speed_m_s, M_S, since_s, probability, direction=sole.direction
        )

    def _leaving(self, time_ns: int, swing: float | None) -> ContactEvent | None:
        """Return a lift-off: by free fall, by unloading, or by the probability of a swing."""
        force = self.motion.force_m_s2
        liftoff = self._liftoff.on_ground(time_ns, force)
        if liftoff is not None:
            self._leave(Phase.FLIGHT, time_ns)
            return liftoff
        if swing is None:
            unloaded_s = self._unloading.on_ground(time_ns, self.motion.load)
            if unloaded_s is None or self.phase is Phase.PLANTED:
                return None
            self._leave(Phase.SWING, time_ns)
            return ContactEvent(ContactKind.LIFTOFF, time_ns, force, M_S2, unloaded_s, _UNLOADED_PROBABILITY)
        if swing < AS_LIKELY:
            self._rising_since_ns = None
        elif self._rising_since_ns is None:
            self._rising_since_ns = time_ns
        last_ns = self._impact.last_ns
        rebounds = last_ns is not None and (time_ns - last_ns) / NANOSECONDS_PER_SECOND < REBOUND_S
        if swing < self._settings.swing.swing_probability or rebounds:
            return None
        rising_s = self._since(time_ns)
        self._leave(Phase.SWING, time_ns)
        return ContactEvent(ContactKind.LIFTOFF, time_ns, force, M_S2, rising_s, swing)

    def _leave(self, phase: Phase, time_ns: int) -> None:
        self.phase = phase
        self._swing_since_ns = time_ns
        self._swing_told = False
        self._rising_since_ns = None
        self._unsettled = False
        self._rest.restart()
        self._slip.release()
        self._unloading.restart()
        if self._swing is not None:
            self._swing.lift()
        if self._touchdown is not None:
            self._touchdown.restart()

    def _land(self, time_ns: int) -> None:
        flew = self.phase is Phase.FLIGHT
        self.phase = Phase.GROUND
        self._unsettled = True
        self._rising_since_ns = None
        self._liftoff.restart()
        self._rest.restart()
        self._unloading.restart()
        self._unloading.hit(time_ns, flew=flew)
        self._slip.land(time_ns)
        self._sliding = False
        if self.sole is not None:
            self.sole.land(time_ns)
        if self._swing is not None:
            self._swing.land()

    def _come_to_rest(self, sample: ImuSample, swing: float | None) -> tuple[ContactEvent, ...]:
        time_ns, _, _, _, x, y, z = sample
        if self.phase is Phase.PLANTED and not self._slip.watching:
            self.phase = Phase.GROUND
        if swing is not None and self.phase is Phase.GROUND and self.motion.is_still and not self._slip.watching:
            self._slip.plant(sample)
        if self.phase is Phase.PLANTED:
            return _NOTHING
        rest = self._rest.on_ground(time_ns, self.motion.force_m_s2, x * x + y * y + z * z)
        if rest is None:
            return _NOTHING
        self.phase = Phase.PLANTED
        if not self._slip.watching:
            self._slip.plant(sample)
        if not self._unsettled:
            return _NOTHING
        self._unsettled = False
        return (ContactEvent(ContactKind.SETTLED, time_ns, rest.rms_m_s2, M_S2, rest.lasted_s),)
