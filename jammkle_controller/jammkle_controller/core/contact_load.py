"""Whether a foot stands, from the load on it: a likelihood ratio of a stance over a swing."""

from __future__ import annotations

import math
from dataclasses import dataclass

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.density_ratio import probability_of

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
"""A foot that never bears more is not told from one that swings."""


@dataclass(frozen=True)
class LoadChange:
    """A foot has begun or ceased to stand."""

    stands: bool
    load_n: float
    delay_s: float
    """Since the load first said so, more likely than not."""
    probability: float
    """That it is so."""


class LoadContact:
    """Tells from each load whether the foot stands.

    A swing's load is Gaussian about 0 with SPREAD_N; a stance's may be anything up to twice the usual load W, which is
    its mean. The logarithm of the ratio of their densities at F > 0 is

        l = log(SPREAD_N sqrt(2 pi) / (2 W)) + F^2 / (2 SPREAD_N^2)

    and what it says is taken anew at each reading: errors of a model do not average out within a step.
    """

    def __init__(self) -> None:
        """Have felt nothing: whether it stands is not known before a load says so."""
        self.stands: bool | None = None
        self._usual_n = 0.0
        self._time_ns: int | None = None
        self._side = True
        self._side_ns = 0

    def update(self, load_n: float, time_ns: int) -> LoadChange | None:
        """Take the load, N, at a time; return whether the foot stands, if that has changed since it was first known."""
        elapsed_s = 0.0 if self._time_ns is None else max(0.0, (time_ns - self._time_ns) / NANOSECONDS_PER_SECOND)
        if self._time_ns is None:
            self._usual_n = load_n
        self._time_ns = time_ns
        if self.stands is not False:
            self._usual_n += (load_n - self._usual_n) * elapsed_s / (elapsed_s + USUAL_TIME_S)
        probability = self._probability(load_n)
        if (probability > 0.5) is not self._side:  # noqa: PLR2004 - more likely than not
            self._side, self._side_ns = not self._side, time_ns
        if LEFT_PROBABILITY < probability < STANDS_PROBABILITY or (probability >= STANDS_PROBABILITY) is self.stands:
            return None
        known, self.stands = self.stands is not None, probability >= STANDS_PROBABILITY
        if not known:
            return None
        delay_s = (time_ns - self._side_ns) / NANOSECONDS_PER_SECOND if self._side is self.stands else 0.0
        return LoadChange(self.stands, load_n, delay_s, probability if self.stands else 1.0 - probability)

    def _probability(self, load_n: float) -> float:
        """Return the probability that the foot stands."""
        usual_n = max(LEAST_USUAL_N, self._usual_n)
        spreads = min(MOST_SPREADS, max(0.0, load_n / SPREAD_N))
        return probability_of(math.log(SPREAD_N * math.sqrt(2.0 * math.pi) / (2.0 * usual_n)) + spreads**2 / 2.0)
