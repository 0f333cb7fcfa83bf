"""Whether the foot is off the ground, from an IMU on the foot or the shank: a filter over two states."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_controller.core.density_ratio import LARGEST_LOG_ODDS, DensityRatio, probability_of

if TYPE_CHECKING:
    from collections.abc import Sequence

EVIDENCE_TIME_S = 0.02
"""Features are low-passed over 10 to 30 ms: looks closer than this tell the same thing again, and count once."""
DWELL_TIME_S = 0.25
"""Mean time in swing and in stance, s: the prior of the filter. Assumed: half a stride of 0.5 s."""


@dataclass(frozen=True)
class SwingSettings:
    """Probability of swing above which the foot has left the ground, and below which it stands."""

    swing_probability: float
    stance_probability: float


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
        """Start on the ground."""
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
