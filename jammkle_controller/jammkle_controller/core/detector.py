"""All detectors on one IMU stream, and the phase of contact they agree on."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from jammkle_controller.core.events import M_S2, ContactEvent, ContactKind
from jammkle_controller.core.impact import ImpactDetector, ImpactSettings
from jammkle_controller.core.imu import IGNORED, Admission, ImuGate, ImuSample
from jammkle_controller.core.liftoff import LiftoffDetector, LiftoffSettings
from jammkle_controller.core.settled import RestDetector, SettledSettings
from jammkle_controller.core.slip import SlipDetector, SlipSettings


class Phase(enum.Enum):
    """What the foot does, as far as the IMU tells."""

    GROUND = "on the ground, moving"
    """Something carries the body. So it is assumed at the start."""
    PLANTED = "on the ground, at rest"
    """The body has come to rest; slip is watched for."""
    FLIGHT = "in flight"
    """Nothing carries the body."""


@dataclass(frozen=True)
class DetectorSettings:
    """Settings of every detector, and the longest gap in the stream, s."""

    impact: ImpactSettings
    liftoff: LiftoffSettings
    settled: SettledSettings
    slip: SlipSettings
    max_gap_s: float


_NOTHING: tuple[ContactEvent, ...] = ()


class ContactDetector:
    """Turns IMU samples into contact events, one sample at a time.

    Only |specific force|, differences of specific force and stamps are used, so the tilt in which the IMU is mounted
    and the origin of the clock do not matter. A flight always ends with an IMPACT, and only a flight allows the next
    LIFTOFF: a listener that vents on LIFTOFF always hears of the landing.
    """

    def __init__(self, settings: DetectorSettings) -> None:
        """Make a detector that stands on the ground and has seen nothing."""
        self.phase = Phase.GROUND
        self.gate = ImuGate(settings.max_gap_s)
        self._impact = ImpactDetector(settings.impact)
        self._liftoff = LiftoffDetector(settings.liftoff)
        self._rest = RestDetector(settings.settled)
        self._slip = SlipDetector(settings.slip)
        self._unsettled = False

    def configure(self, settings: DetectorSettings) -> None:
        """Take new settings and go on from the present state."""
        self.gate.max_gap_s = settings.max_gap_s
        self._impact.settings = settings.impact
        self._liftoff.settings = settings.liftoff
        self._rest.settings = settings.settled
        self._slip.settings = settings.slip

    def update(self, sample: ImuSample) -> tuple[ContactEvent, ...]:
        """Take the next sample and return what it decided, oldest first; samples the gate ignores decide nothing."""
        admission = self.gate.admit(sample)
        if admission in IGNORED:
            return _NOTHING
        time_ns, x, y, z, _, _, _ = sample
        force = math.sqrt(x * x + y * y + z * z)
        if admission is Admission.USABLE:
            self._impact.follow(time_ns, self.gate.interval_s, force)
        else:
            self._begin_anew(admission, force)
        if self.phase is Phase.FLIGHT:
            return self._fly(time_ns, force)
        return self._stand(sample, force)

    def _begin_anew(self, admission: Admission, force: float) -> None:
        """Forget what cannot be compared with the next sample; a flight goes on, its landing may lie in the gap."""
        self._impact.restart(force)
        self._liftoff.restart()
        self._rest.restart()
        if admission is Admission.RESTARTED:
            self._impact.forget_impacts()
            self._unsettled = False
            self.phase = Phase.GROUND
        elif self.phase is Phase.PLANTED:
            self.phase = Phase.GROUND

    def _fly(self, time_ns: int, force: float) -> tuple[ContactEvent, ...]:
        impact = self._impact.in_flight(time_ns, force)
        return _NOTHING if impact is None else self._land(impact)

    def _stand(self, sample: ImuSample, force: float) -> tuple[ContactEvent, ...]:
        time_ns = sample.time_ns
        liftoff = self._liftoff.on_ground(time_ns, force)
        if liftoff is not None:
            self.phase = Phase.FLIGHT
            self._unsettled = False
            self._rest.restart()
            return (liftoff,)
        impact = self._impact.on_ground(time_ns, force)
        if impact is not None:
            return self._land(impact)
        if self.phase is Phase.PLANTED:
            slip = self._slip.planted(sample, self.gate.interval_s, force)
            if slip is None:
                return _NOTHING
            self.phase = Phase.GROUND
            self._rest.restart()
            return (slip,)
        return self._come_to_rest(sample, force)

    def _land(self, impact: ContactEvent) -> tuple[ContactEvent, ...]:
        self.phase = Phase.GROUND
        self._unsettled = True
        self._liftoff.restart()
        self._rest.restart()
        return (impact,)

    def _come_to_rest(self, sample: ImuSample, force: float) -> tuple[ContactEvent, ...]:
        time_ns, _, _, _, x, y, z = sample
        rest = self._rest.on_ground(time_ns, force, x * x + y * y + z * z)
        if rest is None:
            return _NOTHING
        self.phase = Phase.PLANTED
        self._slip.plant(sample)
        if not self._unsettled:
            return _NOTHING
        self._unsettled = False
        return (ContactEvent(ContactKind.SETTLED, time_ns, rest.rms_m_s2, M_S2, rest.lasted_s),)
