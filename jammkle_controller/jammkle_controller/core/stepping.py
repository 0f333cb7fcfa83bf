"""Steps felt on an IMU on the foot or the shank: lift-off, swing, touch-down and slip, by learned density ratios."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING, Any

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.events import M_S, M_S2, ContactEvent, ContactKind
from jammkle_controller.core.motion import ZERO, at_lever, dot, integrated, scaled

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_controller.core.imu import ImuSample
    from jammkle_controller.core.motion import Motion, Vector
    from jammkle_controller.parameters import ControllerParameters

WEIGHTS_FILE = "learned.json"
LARGEST_LOG_ODDS = 8.0
"""No single look is surer than 1 in 3000: outside of what was learned from, a polynomial says anything."""


@dataclass(frozen=True)
class DensityRatio:
    """Weights of the polynomial: constant, linear, and products of features i <= j row by row, on scaled features."""

    centre: Sequence[float]
    scale: Sequence[float]
    constant: float
    linear: Sequence[float]
    products: Sequence[Sequence[float]]
    """Row i holds the weights of the products with features i, i + 1, ..."""

    def log_odds(self, features: Sequence[float]) -> float:
        """Return the logarithm of the ratio at the features, within +-`LARGEST_LOG_ODDS`."""
        # Features far from all that was learned from are moved to its border: a square would dominate there.
        x = [
            min(3.5, max(-3.5, (value - centre) / scale))
            for value, centre, scale in zip(features, self.centre, self.scale, strict=True)
        ]
        total = self.constant
        for index, (value, weight, row) in enumerate(zip(x, self.linear, self.products, strict=True)):
            inner = weight
            for product, other in zip(row, x[index:], strict=True):
                inner += product * other
            total += value * inner
        return min(LARGEST_LOG_ODDS, max(-LARGEST_LOG_ODDS, total))


def between_s(begin_ns: int, end_ns: int) -> float:
    """Return the time between two stamps, s."""
    return (end_ns - begin_ns) / NANOSECONDS_PER_SECOND


def probability_of(log_odds: float) -> float:
    """Return the probability, 0 to 1, of odds given by their logarithm."""
    return 1.0 / (1.0 + math.exp(-log_odds))


@dataclass(frozen=True)
class StepRatios:
    """All ratios of one place of the IMU."""

    swing: DensityRatio
    touchdown: DensityRatio
    slide: DensityRatio


def learned(mount: str) -> StepRatios:
    """Return the ratios of a place of the IMU that were learned on simulated steps.

    Raises:
        KeyError: there are none for that place.

    """
    return ratios_of(json.loads(resources.files(__package__).joinpath(WEIGHTS_FILE).read_text()), mount)


def ratios_of(entries: Mapping[str, Mapping[str, Any]], mount: str) -> StepRatios:
    """Return the ratios of a place of the IMU from entries as `learned.json` has them.

    Raises:
        KeyError: there are none for that place.

    """
    fields = [each.name for each in dataclasses.fields(DensityRatio)]
    named = (entries[f"{what}_{mount}"] for what in ("swing", "touchdown", "slide"))
    return StepRatios(*(DensityRatio(*(entry[name] for name in fields)) for entry in named))


EVIDENCE_TIME_S = 0.02
"""Features are low-passed over 10 to 30 ms: looks closer than this say the same thing again, and count once."""
DWELL_TIME_S = 0.25
"""Mean time in swing and in stance, s: the prior of the filter. Assumed: half a stride of 0.5 s."""


class SwingFilter:
    """Forward filter of a hidden Markov model with the states swing and stance, in continuous time.

    With the log-odds L of swing, and the log density ratio l(x) of the features x (Rabiner, Proc. IEEE 77, 1989,
    eq. 20, for two states that change at the same rate 1 / DWELL_TIME_S):

        p <- p + (1 - 2 p) dt / DWELL_TIME_S        prediction
        L <- L + l(x) dt / EVIDENCE_TIME_S          correction

    Density estimates of accelerations and rates for contact on the foot: Maravgakis et al., "Probabilistic Contact
    State Estimation for Legged Robots using Inertial Information", ICRA 2023; there by kernels on a batch, here by a
    ratio.
    """

    def __init__(self, ratio: DensityRatio) -> None:
        """Start on the ground.

        Args:
            ratio: Of the densities of the features in a swing and in a stance.

        """
        self._ratio = ratio
        self._log_odds = -2.0

    @property
    def probability(self) -> float:
        """Probability that the foot is off the ground."""
        return probability_of(self._log_odds)

    def restart(self) -> None:
        """Know nothing."""
        self._log_odds = 0.0

    def land(self) -> None:
        """Take a touch-down for certain."""
        self._log_odds = -2.0

    def lift(self) -> None:
        """Take a lift-off for certain."""
        self._log_odds = 2.0

    def update(self, features: Sequence[float], interval_s: float) -> float:
        """Take the next features, `interval_s` after those before; return the probability of swing."""
        mixing = min(0.5, interval_s / DWELL_TIME_S)
        probability = self.probability
        predicted = probability + (1.0 - 2.0 * probability) * mixing
        gained = self._ratio.log_odds(features) * min(1.0, interval_s / EVIDENCE_TIME_S)
        odds = _log_odds(predicted) + gained
        self._log_odds = min(LARGEST_LOG_ODDS, max(-LARGEST_LOG_ODDS, odds))
        return self.probability


def _log_odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


LEAST_BLOW_M_S2 = 1.0
"""Sharp part from which on a sample is looked at, m/s^2: well above the noise, so that most of a swing is cheap."""
LEAST_RATIO = 1.5
ONSET_M_S2 = 0.5


class TouchdownDetector:
    """Judges every sharp sample of a swing by a learned density ratio of touch-downs over the swing's own jerks.

    Density ratios by probabilistic classification: Sugiyama, Suzuki, Kanamori 2012, chapter 4.
    """

    def __init__(self, ratio: DensityRatio) -> None:
        """Take the ratio of the densities of `Motion.blow_features` at touch-downs and in swings."""
        self._ratio = ratio
        self._onset_ns: int | None = None

    def restart(self) -> None:
        """Forget a blow that has begun."""
        self._onset_ns = None

    def in_swing(self, time_ns: int, motion: Motion, swung_s: float) -> ContactEvent | None:
        """Take the next sample of a swing that has lasted `swung_s`, s; return the touch-down if it is one."""
        if motion.sharp_m_s2 < ONSET_M_S2:
            self._onset_ns = None
        elif self._onset_ns is None:
            self._onset_ns = time_ns
        if motion.sharp_m_s2 < LEAST_BLOW_M_S2 or motion.sharp_ratio < LEAST_RATIO:
            return None
        probability = probability_of(self._ratio.log_odds(motion.blow_features(swung_s)))
        if probability < TOUCHDOWN_PROBABILITY:
            return None
        delay_s = 0.0 if self._onset_ns is None else between_s(self._onset_ns, time_ns)
        size, direction = motion.sharp_m_s2, scaled(1.0 / motion.sharp_m_s2, motion.sharp)
        return ContactEvent(ContactKind.IMPACT, time_ns, size, M_S2, delay_s, probability, direction=direction)


LEAK_TIME_S = 0.15
"""Time constant with which the speed is forgotten, s: shorter than a stance, longer than a slide of 60 to 100 ms."""
STRAIGHT_UP = 0.95
"""Upward share of its speed from which on a sole is being lifted, 1: 18 deg off the vertical."""
LEAST_ALONG_M_S = 0.04
"""Speed along the ground below which a sole that goes up is being lifted, m/s: a slide of 0.1 s is then of 4 mm, less
than which nobody need act on. With both, on 48 drawn walks that are in no trial, 62 of 120 slips were felt, without 63,
and 157 false ones reported, without 184; of 34 in a default walk of 10 s of the hind feet two were left."""
FORGOTTEN_S = 4.0 * LEAK_TIME_S
"""After which of 0.5 m/s at the start 0.01 are left, below any `slip_speed_m_s`, s."""
_SPEED_FLOOR_M_S = 0.003
"""Added before the logarithm, m/s: what noise and bias of a common sensor make over a stance."""
_LONGEST_S = 0.5


class SoleFilter:
    """Probability that a foot on the ground slides.

    The sole's speed is integrated from where the foot was last still, which resets it (zero-velocity update, as in
    Skog et al. 2010), turned with the gyro, and less what turning about the sole makes of it:

        v' = -w x v + (f - g) - v / LEAK_TIME_S,    v_sole = v + w x lever

    A forward filter over sliding and sticking, as `SwingFilter` is one over swing and stance, takes it together with
    the features of the motion and the probability of swing: a foot that is lifted gains speed upward and turns.
    """

    def __init__(self, ratio: DensityRatio, *, gives: bool = False) -> None:
        """Take the ratio of the densities of `features` while a foot slides, and while it stands or is being lifted.

        Args:
            ratio: That ratio.
            gives: Whether the ankle gives in a touch-down, so that what is above it moves on while the sole stands.

        """
        self._gives = gives
        self._filter = SwingFilter(ratio)
        self.lever_m = ZERO
        """From the IMU to the sole in the IMU's frame, m."""
        self._known_ns: int | None = None
        self._velocity: Vector = (0.0, 0.0, 0.0)
        self._landed_ns = 0
        self.direction: Vector = (0.0, 0.0, 0.0)
        self.speed_m_s = 0.0
        self.upward = 0.0

    @property
    def probability(self) -> float:
        """Probability that the foot slides."""
        return self._filter.probability

    @property
    def is_lifted(self) -> bool:
        """Whether the sole goes up and hardly along the ground: nothing slides so."""
        along_m_s = self.speed_m_s * math.sqrt(max(0.0, 1.0 - self.upward**2))
        return self.upward > STRAIGHT_UP or (self.upward > 0.0 and along_m_s < LEAST_ALONG_M_S)

    def knows_speed(self, time_ns: int) -> bool:
        """Whether the speed is that of the sole: integrated from a rest, or so long that its start is forgotten.

        Where the ankle gives, the IMU goes on as the sole touches down: at 0.5 m/s of a shank whose toe stands.
        """
        return not self._gives or (self._known_ns is not None and time_ns >= self._known_ns)

    def land(self, time_ns: int) -> None:
        """Begin anew: the foot has just hit the ground."""
        self._velocity = (0.0, 0.0, 0.0)
        self._landed_ns = time_ns
        self._known_ns = time_ns + round(FORGOTTEN_S * NANOSECONDS_PER_SECOND)
        self._filter.land()

    def follow(self, sample: ImuSample, interval_s: float, motion: Motion) -> None:
        """Take the next sample of a foot on the ground."""
        if motion.is_still:
            self._velocity = ZERO
            self._known_ns = sample.time_ns
        keep = LEAK_TIME_S / (interval_s + LEAK_TIME_S)
        self._velocity = scaled(keep, integrated(self._velocity, motion.gravity, sample, interval_s))
        sole = at_lever(self._velocity, self.lever_m, sample)
        self.speed_m_s = speed = math.sqrt(dot(sole, sole))
        self.direction = scaled(1.0 / (speed + 1e-9), sole)
        self.upward = dot(self.direction, motion.gravity) / (math.sqrt(dot(motion.gravity, motion.gravity)) or 1.0)

    def features(self, time_ns: int, motion: Motion, swing: float) -> tuple[float, ...]:
        """Return what the probability is made of."""
        unrest, turning, sharpness, load, long_unrest, _ = motion.features()
        return (
            unrest,
            turning,
            sharpness,
            load,
            long_unrest,
            math.log10(_SPEED_FLOOR_M_S + self.speed_m_s),
            self.upward,
            math.log(swing / (1.0 - swing)),
            min(_LONGEST_S, between_s(self._landed_ns, time_ns)),
        )

    def update(self, time_ns: int, interval_s: float, motion: Motion, swing: float) -> float:
        """Return the probability that the foot slides after `follow`."""
        return self._filter.update(self.features(time_ns, motion, swing), interval_s)


STANCE_PROBABILITY = 0.1
"""Probability of swing below which a foot stands, blow or none."""
TOUCHDOWN_PROBABILITY = 0.5
"""Probability from which on a blow in a swing is a touch-down."""
REBOUND_S = 0.08
"""After a touch-down a foot does not leave again so soon, s: what shakes it is the touch-down."""
AS_LIKELY = 0.5
SURE_SWING = 0.95
SURE_SWING_S = 0.06
"""Probability and time of a swing from which on it is reported: twice the longest window of the features."""


class SteppingFoot:
    """The detectors of one foot that steps, on one IMU that moves with it."""

    def __init__(self, parameters: ControllerParameters, ratios: StepRatios | None = None) -> None:
        """Start on the ground, with density ratios of one's own or those of `learned.json`."""
        self.parameters = parameters
        ratios = ratios or learned(parameters.imu_mount)
        self.swing = SwingFilter(ratios.swing)
        self.sole = SoleFilter(ratios.slide, gives=parameters.takes_blows)
        self._touchdown = TouchdownDetector(ratios.touchdown)
        self._interval_s = 0.0
        self._rising_since_ns: int | None = None
        self._swing_since_ns = 0
        self._swing_reported = False
        self._stood_on = False
        self._sliding = False
        self._slide_since_ns = 0

    def restart(self) -> None:
        """Forget what cannot be compared with the next sample."""
        self.swing.restart()
        self._interval_s = 0.0

    def suspend(self) -> None:
        """Forget a lift-off that has begun."""
        self._rising_since_ns = None

    def update(self, motion: Motion, interval_s: float) -> None:
        """Take the motion at the next sample, `interval_s` after the one before."""
        self._interval_s = interval_s
        self.swing.update(motion.features(), interval_s)

    def leaving(self, time_ns: int, landed_ns: int | None, motion: Motion) -> ContactEvent | None:
        """Return a lift-off when a swing becomes probable.

        Args:
            time_ns: Of the sample.
            landed_ns: When the foot hit the ground last; None: never.
            motion: Of the sample.

        """
        swing = self.swing.probability
        if swing < AS_LIKELY:
            self._rising_since_ns = None
        elif self._rising_since_ns is None:
            self._rising_since_ns = time_ns
        rebounds = landed_ns is not None and between_s(landed_ns, time_ns) < REBOUND_S
        if swing < self.parameters.swing_probability or rebounds:
            return None
        rising_s = 0.0 if self._rising_since_ns is None else between_s(self._rising_since_ns, time_ns)
        return ContactEvent(ContactKind.LIFTOFF, time_ns, motion.force_m_s2, M_S2, rising_s, swing)

    def leave(self, time_ns: int) -> None:
        """Take that the foot has left the ground.

        Where somebody else says so, as a gait that plans it, the foot may stand for some time more.
        """
        self._swing_since_ns = time_ns
        self._swing_reported = False
        self._stood_on = self.swing.probability < AS_LIKELY
        self._rising_since_ns = None
        self.swing.lift()
        self._touchdown.restart()

    def blow(self, time_ns: int, motion: Motion) -> ContactEvent | None:
        """Return the touch-down of a foot that swings when it is hit."""
        return self._touchdown.in_swing(time_ns, motion, between_s(self._swing_since_ns, time_ns))

    def stands(self, time_ns: int, motion: Motion) -> ContactEvent | None:
        """Return the touch-down of a foot that swung, reported late: it stands, though nothing hit it.

        Of one that stood as it was said to leave, and has not been seen to swing, that is no news: only after
        DWELL_TIME_S, a whole swing, is it taken not to have left.
        """
        swing = self.swing.probability
        waits = self._stood_on and not self._swing_reported and between_s(self._swing_since_ns, time_ns) < DWELL_TIME_S
        if swing >= STANCE_PROBABILITY or waits:
            return None
        return ContactEvent(ContactKind.IMPACT, time_ns, motion.sharp_m_s2, M_S2, 0.0, 1.0 - swing, is_felt=False)

    def swinging(self, time_ns: int, motion: Motion) -> ContactEvent | None:
        """Return once per swing that the foot swings freely."""
        swing, swung_s = self.swing.probability, between_s(self._swing_since_ns, time_ns)
        if self._swing_reported or swing < SURE_SWING or swung_s < SURE_SWING_S:
            return None
        self._swing_reported = True
        return ContactEvent(ContactKind.SWING, time_ns, motion.force_m_s2, M_S2, swung_s, swing)

    def land(self, time_ns: int) -> None:
        """Take that the foot has hit the ground."""
        self._rising_since_ns = None
        self._sliding = False
        self.sole.land(time_ns)
        self.swing.land()

    def sliding(self, sample: ImuSample, motion: Motion) -> ContactEvent | None:
        """Return a slip of a foot on the ground when it becomes probable; another only after it was improbable."""
        time_ns, sole, least = sample.time_ns, self.sole, self.parameters.slip_probability
        sole.follow(sample, self._interval_s, motion)
        before = sole.probability
        probability = sole.update(time_ns, self._interval_s, motion, self.swing.probability)
        if before < AS_LIKELY <= probability:
            self._slide_since_ns = time_ns
        # Outside of what it was learned from, such as at perfect rest, the posterior may say anything.
        unsure = sole.speed_m_s < self.parameters.slip_speed_m_s or not sole.knows_speed(time_ns)
        if self._sliding or unsure or sole.is_lifted or probability < least:
            self._sliding &= probability > 1.0 - least
            return None
        self._sliding = True
        slid_s = between_s(self._slide_since_ns, time_ns)
        return ContactEvent(
            ContactKind.SLIP, time_ns, sole.speed_m_s, M_S, slid_s, probability, direction=sole.direction
        )
