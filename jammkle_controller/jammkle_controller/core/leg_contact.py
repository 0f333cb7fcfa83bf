"""Contact felt with the leg itself: by the angles of its ankle, and by the efforts of hip and knee.

A foot that hangs toe-down is a sensor: the ground turns it. What a foot does that swings is known but for noise: it
hangs as the tendons let it, lags behind a shank that is turned, and creeps back to where it hung. So the likelihood of
angle and rates in a swing is compared with that in a stance at every reading, by a learned ratio, and a filter adds up
what looks in a row say.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_controller.core.events import CHANGES, NEWTON, RADIAN, ContactEvent, Source
from jammkle_controller.core.stepping import AS_LIKELY, SwingFilter, probability_of

if TYPE_CHECKING:
    from jammkle_controller.core.leg import Leg
    from jammkle_controller.core.stepping import DensityRatio

RATE_TIME_S = 0.1
"""Time over which the usual rate is a mean, s: a foot creeps back for a tenth of a second and more after a lift-off."""
SHORT_S, LONG_S = 0.01, 0.02
"""Over which a change of rate is looked at, s: a touch-down stops a toe in 10 ms, what a swing's own inertia does takes
50. On readings that come less often the change is that since the one before."""
_ROUNDING_S = 0.001
LEAST_TURN_RAD = 0.02
"""By which the ground must have turned a foot from where it came closest to its hanging in this swing, rad: one that
hangs still a few degrees off, as friction leaves it, does not stand for that. A tenth of what a stance turns it by."""
LONGEST_GAP_S = 0.1
"""After readings were missing for so long rates of before say nothing."""
EVIDENCE_TIME_S = 0.01
"""Looks closer than this count once: rates are those of encoders, and hardly filtered."""
SWINGS_FROM, SWINGS_BELOW = 0.9, 0.1
"""Probability of swing above and below which a foot has left and stands (Schmitt's trigger). The rates of errors were
the same at 0.97 and 0.03."""
CONFIRM_S = 0.02
"""So long a foot must have left before that is reported, s: a toe that is unloaded for a moment is not to be vented."""


class AnkleReading(NamedTuple):
    """Angles, rad, and rates, rad/s, of the ankle, as in joint_states, and how fast the shank turns above it."""

    pitch_rad: float
    roll_rad: float
    pitch_rad_s: float
    roll_rad_s: float
    shank_rad_s: float
    """Sum of the rates of hip and knee, toe-down positive: of a body that does not turn, the shank's pitch rate."""


class AnkleMotion:
    """What is looked at of the ankle's readings, one after the other."""

    def __init__(self, hang_pitch_rad: float) -> None:
        """Have read nothing, and know where the soft foot hangs."""
        self._hang_pitch_rad = hang_pitch_rad
        self._before: deque[tuple[int, AnkleReading]] = deque()
        self._usual_rad_s = 0.0

    def follow(self, reading: AnkleReading, time_ns: int) -> tuple[tuple[float, ...], float] | None:
        """Take the next reading; return what is looked at, and the time since the reading before, s.

        Returns:
            The angle from where it hangs; pitch rate, usual pitch rate, its change in 10 ms and in 20 ms; rate of the
            foot, change of the shank's rate in 20 ms, size of the change of the roll rate in 20 ms. None: it is the
            first, or cannot be compared with the one before.

        """
        before = self._before
        interval_s = (time_ns - before[-1][0]) / NANOSECONDS_PER_SECOND if before else 0.0
        if not 0.0 < interval_s <= LONGEST_GAP_S:
            if before and interval_s == 0.0:
                return None
            before.clear()
            before.append((time_ns, reading))
            self._usual_rad_s = reading.pitch_rad_s
            return None
        self._usual_rad_s += (reading.pitch_rad_s - self._usual_rad_s) * interval_s / (interval_s + RATE_TIME_S)
        short, long = self._ago(SHORT_S, time_ns), self._ago(LONG_S, time_ns)
        before.append((time_ns, reading))
        while (time_ns - before[1][0]) / NANOSECONDS_PER_SECOND > LONG_S - _ROUNDING_S:
            before.popleft()
            if len(before) == 1:
                break
        return (
            self._hang_pitch_rad - reading.pitch_rad,
            reading.pitch_rad_s,
            self._usual_rad_s,
            reading.pitch_rad_s - short.pitch_rad_s,
            reading.pitch_rad_s - long.pitch_rad_s,
            reading.pitch_rad_s + reading.shank_rad_s,
            reading.shank_rad_s - long.shank_rad_s,
            abs(reading.roll_rad_s - long.roll_rad_s),
        ), interval_s

    def _ago(self, ago_s: float, time_ns: int) -> AnkleReading:
        """Return the youngest reading that is so old, or the oldest that is kept."""
        for at_ns, reading in reversed(self._before):
            if (time_ns - at_ns) / NANOSECONDS_PER_SECOND > ago_s - _ROUNDING_S:
                return reading
        return self._before[0][1]


class _Decision:
    """Whether a foot stands, and since when that has been more likely than not."""

    def __init__(self) -> None:
        self.stands: bool | None = None
        """None: it is not known before something says so."""
        self._likely = True
        self._likely_ns = 0

    def _delay_s(self, *, stands: bool | None, likely: bool, time_ns: int) -> float | None:
        """Decide, or not where `stands` is None; return the delay of a change, s; None: none since it was known."""
        if likely is not self._likely:
            self._likely, self._likely_ns = likely, time_ns
        if stands is None or stands is self.stands:
            return None
        known, self.stands = self.stands is not None, stands
        if not known:
            return None
        return (time_ns - self._likely_ns) / NANOSECONDS_PER_SECOND if likely is stands else 0.0


class AnkleContact(_Decision):
    """Decides from each reading whether the foot stands, by the forward filter of `SwingFilter`."""

    def __init__(self, ratio: DensityRatio, hang_pitch_rad: float) -> None:
        """Have felt nothing.

        Args:
            ratio: Of the densities in a swing and in a stance of what `AnkleMotion` looks at.
            hang_pitch_rad: Where the soft foot hangs.

        """
        super().__init__()
        self._motion = AnkleMotion(hang_pitch_rad)
        self._swing = SwingFilter(ratio, EVIDENCE_TIME_S)
        self._swing.restart()
        self._least_rad = math.inf
        self._left_ns: int | None = None

    def lift(self) -> None:
        """Take that the foot does not stand: the body falls."""
        self.stands = False
        self._swing.lift()

    def update(self, reading: AnkleReading, time_ns: int) -> ContactEvent | None:
        """Take a reading; return a change of contact since it was first known."""
        looked = self._motion.follow(reading, time_ns) if math.isfinite(sum(reading)) else None
        if looked is None:
            return None
        (angle_rad, *_), interval_s = looked
        swing = self._swing.update(looked[0], interval_s)
        stands = self._decided(swing, angle_rad, time_ns)
        delay_s = self._delay_s(stands=stands, likely=swing < AS_LIKELY, time_ns=time_ns)
        if stands is None or delay_s is None:
            return None
        probability = 1.0 - swing if stands else swing
        return ContactEvent(CHANGES[stands], time_ns, abs(angle_rad), RADIAN, delay_s, probability, Source.ANKLE)

    def _decided(self, swing: float, angle_rad: float, time_ns: int) -> bool | None:
        """Return whether the foot stands, by the probability that it swings; None: that is not said now."""
        self._least_rad = min(self._least_rad, angle_rad) if self.stands is False else angle_rad
        if swing < SWINGS_FROM:
            self._left_ns = None
            turned = self.stands is not False or angle_rad - self._least_rad >= LEAST_TURN_RAD
            return True if swing <= SWINGS_BELOW and turned else None
        if self._left_ns is None:
            self._left_ns = time_ns
        left_s = (time_ns - self._left_ns) / NANOSECONDS_PER_SECOND
        return None if self.stands and left_s < CONFIRM_S - _ROUNDING_S else False


FOLLOW_TIME_S = 0.003
"""Time constant with which the load follows, s: two looks at 500 Hz, so that the noise of one rate does not count."""
LONGEST_S = 0.05
"""Readings further apart than this are not compared, s: a torque changes in between."""
LEAST_BEND = 0.1
"""Sine of the knee's angle below which a straight leg hides the load: torques do not show it there. Six degrees."""
_HIGHEST = 1e4
"""Angles, rates and efforts beyond it are none, rad, rad/s, N m."""


class LegReading(NamedTuple):
    """Angles, rad, rates, rad/s, and efforts, N m, of hip and knee: counted from straight down and from the thigh.

    An angle about y, to the left, turns what hangs down backward. An effort is that of the servo on the joint, in the
    mean since the last control step, as drives report it.
    """

    hip_rad: float
    knee_rad: float
    hip_rad_s: float
    knee_rad_s: float
    hip_n_m: float
    knee_n_m: float


class LegLoad:
    """Observes the force on a foot by the generalised momentum of its leg.

    With p = M(q) q' of a double pendulum, the torques that no servo makes are a first-order low-pass of
    p' - tau - C^T q' + g (De Luca, Albu-Schaeffer, Haddadin, Hirzinger, "Collision Detection and Safe Reaction with the
    DLR-III Lightweight Manipulator Arm", IROS 2006), here over the interval between two readings:

        r <- r + ((p1 - p0) / dt - mean(tau + C^T q' - g) - r) dt / (dt + FOLLOW_TIME_S),    r = J^T F

    The hip is taken as unaccelerated and upright, which leaves some newtons in a swing (`inputs.SPREAD_N`), and
    the force as acting at the ankle: what its tendons bear of a force at toe or heel is some newtons in a stance.
    """

    def __init__(self, leg: Leg, armature_kg_m2: float) -> None:
        """Know the leg, and the inertia of its motors behind their gears."""
        self._leg = leg
        self._armature_kg_m2 = armature_kg_m2
        rod = 4.0 / 3.0  # of a rod about its end, in units of its mass by its centre's distance squared
        self._coupling = leg.shank_kg * leg.thigh_m * leg.shank_centre_m
        self._shank = rod * leg.shank_kg * leg.shank_centre_m**2
        self._both = leg.thigh_m**2 * (leg.thigh_kg / 3.0 + leg.shank_kg) + self._shank + armature_kg_m2
        self._thigh_weight_n_m = STANDARD_GRAVITY_M_S2 * leg.thigh_m * (leg.thigh_kg / 2.0 + leg.shank_kg)
        self._shank_weight_n_m = STANDARD_GRAVITY_M_S2 * leg.shank_kg * leg.shank_centre_m
        self._before: tuple[int, float, float, float, float] | None = None
        self._hip_n_m = self._knee_n_m = 0.0

    def update(self, reading: LegReading, time_ns: int) -> float | None:
        """Return how hard the ground presses up on the foot, N, at a reading; None: it is not known now."""
        if not all(abs(value) < _HIGHEST for value in reading):  # a NaN is not less than anything
            return None
        hip, knee, hip_rate, knee_rate, hip_n_m, knee_n_m = reading
        sine, cosine = math.sin(knee), math.cos(knee)
        both = self._shank + self._coupling * cosine
        momentum = (self._both + 2.0 * self._coupling * cosine) * hip_rate + both * knee_rate
        knee_momentum = both * hip_rate + (self._shank + self._armature_kg_m2) * knee_rate
        weight_n_m = self._shank_weight_n_m * math.sin(hip + knee)
        pull = hip_n_m - self._thigh_weight_n_m * math.sin(hip) - weight_n_m
        knee_pull = knee_n_m - weight_n_m - self._coupling * sine * hip_rate * (hip_rate + knee_rate)
        before, self._before = self._before, (time_ns, momentum, knee_momentum, pull, knee_pull)
        if before is None:
            return None
        elapsed_s = (time_ns - before[0]) / NANOSECONDS_PER_SECOND
        if not 0.0 < elapsed_s <= LONGEST_S:
            return None
        share = elapsed_s / (elapsed_s + FOLLOW_TIME_S)
        unexplained = (momentum - before[1]) / elapsed_s - (pull + before[3]) / 2.0
        knee_unexplained = (knee_momentum - before[2]) / elapsed_s - (knee_pull + before[4]) / 2.0
        self._hip_n_m += (unexplained - self._hip_n_m) * share
        self._knee_n_m += (knee_unexplained - self._knee_n_m) * share
        # r = J^T F solved for the upward part, with both torques: what rubs along the ground does not count.
        if abs(sine) < LEAST_BEND:
            return None
        leg = self._leg
        shank_m = leg.shank_m * math.cos(hip + knee)
        both_m = leg.thigh_m * math.cos(hip) + shank_m
        return (both_m * self._knee_n_m - shank_m * self._hip_n_m) / (leg.thigh_m * leg.shank_m * sine)


SPREAD_N = 2.0
"""Standard deviation of the load of a foot that swings, N: what `LegLoad` leaves of a hip that is accelerated, and of
masses and efforts that are not quite those. Learned on swings of the simulated leg (-2.8 to 3.6 N is nine of ten)."""
STANDS_PROBABILITY = 0.9
LEFT_PROBABILITY = 0.3
"""Above and below which a foot stands and has left (Schmitt's trigger): 6 and 3 N at a usual load of 20 N. Light as it
is, no load makes a swing surer than 0.9, as a stance may be as light."""
USUAL_TIME_S = 2.0
"""Time constant of the usual load, s, in which only a foot that stands counts: some strides."""
MOST_SPREADS = 6.0
"""No load is surer than this many: a model errs in more ways than a Gaussian does."""
LEAST_USUAL_N = 4.0 * SPREAD_N
"""A foot that never bears more is not separated from one that swings."""


class LoadContact(_Decision):
    """Decides from each load whether the foot stands.

    A swing's load is Gaussian about 0 with SPREAD_N; a stance's may be anything up to twice the usual load W, which is
    its mean. The logarithm of the ratio of their densities at F > 0 is

        l = log(SPREAD_N sqrt(2 pi) / (2 W)) + F^2 / (2 SPREAD_N^2)

    and what it says is taken anew at each reading: errors of a model do not average out within a step.
    """

    def __init__(self) -> None:
        """Have felt nothing."""
        super().__init__()
        self.usual_n = 0.0
        """What it bears in a stance, N; 0 before the first load."""
        self._time_ns: int | None = None

    def update(self, load_n: float, time_ns: int, *, falls: bool = False) -> ContactEvent | None:
        """Take the load, N, of a body that falls or not; return a change of contact since it was first known."""
        borne_n = 0.0 if falls else load_n
        elapsed_s = 0.0 if self._time_ns is None else max(0.0, (time_ns - self._time_ns) / NANOSECONDS_PER_SECOND)
        if self._time_ns is None:
            self.usual_n = borne_n
        self._time_ns = time_ns
        if self.stands is not False:
            self.usual_n += (borne_n - self.usual_n) * elapsed_s / (elapsed_s + USUAL_TIME_S)
        probability = self._probability(borne_n)
        stands = None if LEFT_PROBABILITY < probability < STANDS_PROBABILITY else probability >= STANDS_PROBABILITY
        delay_s = self._delay_s(stands=stands, likely=probability > AS_LIKELY, time_ns=time_ns)
        if stands is None or delay_s is None:
            return None
        sure = probability if stands else 1.0 - probability
        return ContactEvent(CHANGES[stands], time_ns, load_n, NEWTON, delay_s, sure, Source.EFFORTS)

    def _probability(self, load_n: float) -> float:
        """Return the probability that the foot stands."""
        usual_n = max(LEAST_USUAL_N, self.usual_n)
        spreads = min(MOST_SPREADS, max(0.0, load_n / SPREAD_N))
        return probability_of(math.log(SPREAD_N * math.sqrt(2.0 * math.pi) / (2.0 * usual_n)) + spreads**2 / 2.0)
