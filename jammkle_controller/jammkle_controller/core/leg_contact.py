"""Contact felt with the leg itself: by the angles of its ankle, and by the efforts of hip and knee.

A foot that hangs toe-down is a sensor: the ground turns it. What a foot does that swings is known but for noise: it
hangs as the tendons let it, lags behind a shank that is turned, and creeps back to where it hung. So boosted trees that
were learned on simulated steps tell a stance from a swing at every reading, by it and by those of the last fifth of a
second.
"""

from __future__ import annotations

import functools
import json
import math
from collections import deque
from importlib import resources
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_controller.core.events import CHANGES, NEWTON, RADIAN, ContactEvent, Source
from jammkle_controller.core.stepping import AS_LIKELY, between_s, probability_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_controller.core.leg import Leg

LAGS_S = (0.0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2)
"""How long ago the readings are that are looked at together, s: a touch-down stops a toe in 10 ms, what a swing's own
inertia does takes 50, and a foot creeps back for a tenth of a second and more after a lift-off. Of readings that come
less often, one is looked at several times."""
ROLLS = 3
"""Of so many of them the rate of roll is looked at."""
_ROUNDING_S = 0.001
LONGEST_GAP_S = 0.1
"""After readings were missing for so long those of before say nothing."""
STANDS_FROM, LEFT_FROM = 0.95, 0.8
"""Probability from which on a foot stands, and probability of swing from which on it has left."""
SOON_S = 0.06
STANDS_SOON_FROM, LEFT_SOON_FROM = 0.99, 0.95
"""The same within SOON_S of the change before: so soon most feet graze or rebound."""
TREES_FILE = "ankle.json"

Tree: TypeAlias = "float | list[Any]"
"""What a tree adds to the log-odds; or a feature's index, a threshold, and the trees for what is not above it and what
is."""


class AnkleReading(NamedTuple):
    """Angles, rad, and rates, rad/s, of the ankle, and rates of hip and knee above it, as in joint_states."""

    pitch_rad: float
    roll_rad: float
    pitch_rad_s: float
    roll_rad_s: float
    hip_rad_s: float
    knee_rad_s: float


class AnkleMotion:
    """What is looked at of the ankle's readings, one after the other."""

    def __init__(self, hang_pitch_rad: float) -> None:
        """Have read nothing, and know where the soft foot hangs."""
        self._hang_pitch_rad = hang_pitch_rad
        self._readings: deque[tuple[int, AnkleReading]] = deque()

    def follow(self, reading: AnkleReading, time_ns: int) -> list[float] | None:
        """Take the next reading; return what is looked at.

        Returns:
            Of each of LAGS_S the angle from where the foot hangs, rad, and the rates of pitch, hip and knee, rad/s; the
            sizes of the latest rates of roll, rad/s, and of its angle, rad. None: there is nothing to compare it with.

        """
        readings = self._readings
        if readings and readings[-1][0] == time_ns:
            return None
        if readings and not 0.0 < between_s(readings[-1][0], time_ns) <= LONGEST_GAP_S:
            readings.clear()
        readings.append((time_ns, reading))
        while len(readings) > 1 and between_s(readings[1][0], time_ns) > LAGS_S[-1] - _ROUNDING_S:
            readings.popleft()
        if len(readings) == 1:
            return None
        looked = self._lagged(time_ns)
        features = [
            value
            for each in looked
            for value in (self._hang_pitch_rad - each.pitch_rad, each.pitch_rad_s, each.hip_rad_s, each.knee_rad_s)
        ]
        return [*features, *(abs(each.roll_rad_s) for each in looked[:ROLLS]), abs(reading.roll_rad)]

    def _lagged(self, time_ns: int) -> list[AnkleReading]:
        """Return the youngest readings that are as old as LAGS_S, or the oldest that there is."""
        lagged: list[AnkleReading] = []
        for at_ns, reading in reversed(self._readings):
            while len(lagged) < len(LAGS_S) and between_s(at_ns, time_ns) > LAGS_S[len(lagged)] - _ROUNDING_S:
                lagged.append(reading)
        oldest = self._readings[0][1]
        return lagged + [oldest] * (len(LAGS_S) - len(lagged))


class StanceTrees:
    """Log-odds that a foot stands, of what `AnkleMotion` looks at, by boosted trees.

    Friedman, "Greedy Function Approximation: A Gradient Boosting Machine", Annals of Statistics 29 (2001): every tree
    adds what corrects the sum of those before it.
    """

    def __init__(self, constant: float, trees: Sequence[Tree]) -> None:
        """Take the log-odds of nothing known, and the trees."""
        self._constant = constant
        self._trees = trees

    def log_odds(self, features: Sequence[float]) -> float:
        """Return the logarithm of the odds of a stance to a swing."""
        total = self._constant
        for tree in self._trees:
            while isinstance(tree, list):
                index, threshold, lower, upper = tree
                tree = lower if features[index] <= threshold else upper  # noqa: PLW2901 - down one tree
            total += tree
        return total


@functools.cache
def learned_stance() -> StanceTrees:
    """Return the trees that were learned on simulated steps (`studies.contact.relearn`)."""
    return StanceTrees(**json.loads(resources.files(__package__).joinpath(TREES_FILE).read_text(encoding="utf-8")))


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
        return between_s(self._likely_ns, time_ns) if likely is stands else 0.0


class AnkleContact(_Decision):
    """Decides from each reading whether the foot stands."""

    def __init__(self, hang_pitch_rad: float) -> None:
        """Have felt nothing, and know where the soft foot hangs."""
        super().__init__()
        self._motion = AnkleMotion(hang_pitch_rad)
        self._trees = learned_stance()
        self._changed_ns: int | None = None

    def update(self, reading: AnkleReading, time_ns: int) -> ContactEvent | None:
        """Take a reading; return a change of contact since it was first known."""
        looked = self._motion.follow(reading, time_ns) if math.isfinite(sum(reading)) else None
        if looked is None:
            return None
        stance = probability_of(self._trees.log_odds(looked))
        stands = self._decided(stance, time_ns)
        delay_s = self._delay_s(stands=stands, likely=stance > AS_LIKELY, time_ns=time_ns)
        if stands is None or delay_s is None:
            return None
        self._changed_ns = time_ns
        probability = stance if stands else 1.0 - stance
        return ContactEvent(CHANGES[stands], time_ns, abs(looked[0]), RADIAN, delay_s, probability, Source.ANKLE)

    def _decided(self, stance: float, time_ns: int) -> bool | None:
        """Return whether the foot stands, by the probability that it does; None: that is not said now."""
        soon = self._changed_ns is not None and 0.0 <= between_s(self._changed_ns, time_ns) < SOON_S
        stands_from, left_from = (STANDS_SOON_FROM, LEFT_SOON_FROM) if soon else (STANDS_FROM, LEFT_FROM)
        if stance > stands_from:
            return True
        return False if 1.0 - stance > left_from else None


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
        elapsed_s = between_s(before[0], time_ns)
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
        elapsed_s = 0.0 if self._time_ns is None else max(0.0, between_s(self._time_ns, time_ns))
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
