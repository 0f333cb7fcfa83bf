"""One Kalman filter per hypothesis of what has failed, on one law of the air, and how much better each explains.

Multiple-model estimation (Magill 1965, "Optimal adaptive estimation of sampled stochastic processes"): each hypothesis
is an extended Kalman filter on the mass balance of `core.air`, and gains or loses by the likelihood of the pressures
that come next. What it has gained over the healthy one since it was last no better than that is Page's cumulative sum
(Page 1954, "Continuous inspection schemes"), so that a fault may begin at any time.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_driver.core.freshness import KNOWN_AFTER
from jammkle_driver.core.hypotheses import Spread, Tables
from jammkle_driver.core.prediction import Predictor, Step
from jammkle_driver.core.scoring import Scoring

if TYPE_CHECKING:
    from collections.abc import Collection

    from numpy.typing import NDArray

    from jammkle_driver.core.air import AirSettings, Array
    from jammkle_driver.core.hypotheses import Hypothesis

    Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Estimate:
    """What one hypothesis makes of the ankle; the manifold first, then the channels.

    Attributes:
        pressures_pa: True pressures, Pa absolute.
        offsets_pa: How much each sensor reads too high, Pa.
        pump_share: Flow of the pump over the declared one, 1.
        pump_end_share: Ultimate vacuum of the pump over the declared one, 1.
        line_shares: Conductance of each channel's line over the declared one, 1.
        leaks_m3_s_pa: Sonic conductance of each volume's leak, m^3/(s Pa).
        leak_deviations_m3_s_pa: Standard deviations of those.
        pump_deviation: Standard deviation of the pump's share.

    """

    pressures_pa: tuple[float, ...]
    offsets_pa: tuple[float, ...]
    pump_share: float
    pump_end_share: float
    line_shares: tuple[float, ...]
    leaks_m3_s_pa: tuple[float, ...]
    leak_deviations_m3_s_pa: tuple[float, ...]
    pump_deviation: float


class FilterBank:
    """Filters of all hypotheses about one ankle, advanced together."""

    def __init__(
        self, air: AirSettings, ambient_pa: float, spread: Spread | None = None, scoring: Scoring | None = None
    ) -> None:
        """Begin vented, with every hypothesis as good as the healthy one."""
        self._air = air
        self._scoring = scoring or Scoring()
        self._spread = spread or Spread()
        self._tables = Tables(air, self._spread)
        self._layout = self._tables.layout
        self._predictor = Predictor(air, self._spread, self._tables)
        self._every = np.arange(self._layout.size)
        self.leave_out(())
        self.reset(ambient_pa)

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """The healthy ankle, and then everything that may have failed."""
        return self._tables.hypotheses

    @property
    def scoring(self) -> Scoring:
        """How readings count."""
        return self._scoring

    @property
    def scores(self) -> Array:
        """What each hypothesis has gained over the healthy ankle, nats."""
        return self._scores

    @property
    def changes_while_stuck(self) -> Array:
        """How often the reading has changed that a hypothesis takes for stuck, since it last began."""
        return self._changes_while_stuck

    def reset(self, ambient_pa: float) -> None:
        """Begin anew, vented at `ambient_pa`, Pa, or at what the first readings say."""
        models, size = self._tables.mean.shape
        volumes = self._layout.volumes
        self._state = self._tables.mean.copy()
        self._state[:, :volumes] = ambient_pa
        self._covariance = np.zeros((models, size, size))
        self._covariance[:, self._every, self._every] = self._tables.deviation**2
        self._scores = np.zeros(models)
        self._held_pa = np.full((models, volumes), ambient_pa)
        self._held_variance = np.full((models, volumes), self._spread.noise_pa**2)
        self._last_pa = np.full(volumes, np.nan)
        self._lately: deque[tuple[float, Array]] = deque(maxlen=self._scoring.lately)
        self._run = np.zeros(volumes)
        self._longest_run = np.zeros(volumes)
        self._changes = np.zeros(volumes)
        self._changes_while_stuck = np.zeros(models)
        self._bridging = False
        self._fresh = True
        self._grace_s = 0.0

    def leave_out(self, places: Collection[int]) -> None:
        """Weigh no hypothesis of these volumes any more, by index: what is at them is known."""
        self._known = np.array([hypothesis.place in places for hypothesis in self.hypotheses])

    def bridge(self) -> None:
        """Forget where the pressures are, and nothing else: readings of a while are missing."""
        index = self._every[: self._layout.volumes]
        self._covariance[:, index, index] += self._scoring.unknown_pa**2
        self._bridging = True

    def adopt(self, model: int) -> None:
        """Take what a hypothesis says for the healthy ankle, and let every fault begin from there."""
        self._state[0] = np.clip(self._state[model], self._tables.least[0], self._tables.most[0])
        self._covariance[0] = self._covariance[model]
        self._scores[:] = 0.0
        self._begin_again()

    def estimate(self, model: int = 0) -> Estimate:
        """Return what a hypothesis makes of the ankle; the first is the healthy one."""
        state, layout = self._state[model], self._layout
        deviation = np.sqrt(np.maximum(np.diagonal(self._covariance[model]), 0.0))
        unit = self._air.valve_conductance_m3_s_pa
        return Estimate(
            pressures_pa=tuple(state[layout.pressures].tolist()),
            offsets_pa=tuple(state[layout.offsets].tolist()),
            pump_share=float(state[layout.pump]),
            pump_end_share=float(1.0 / state[layout.end]),
            line_shares=tuple(state[layout.lines].tolist()),
            leaks_m3_s_pa=tuple((state[layout.leaks] * unit).tolist()),
            leak_deviations_m3_s_pa=tuple((deviation[layout.leaks] * unit).tolist()),
            pump_deviation=float(deviation[layout.pump]),
        )

    def advance(self, step: Step) -> None:
        """Take what was commanded and what was read at the end of `step.duration_s`."""
        readings_pa = np.array(step.readings_pa)
        if self._fresh:
            self._begin(readings_pa, step.ambient_pa)
        self._predictor.advance(self._state, self._covariance, step)
        likelihood = self._weigh(step.readings_pa, self._late_pa(readings_pa, step.duration_s))
        repeats, beyond_doubt = self._repeats(readings_pa, step.ambient_pa)
        likelihood += self._scoring.repeat_nats * repeats
        if self._bridging:
            self._bridging = False
            return
        gain = likelihood - likelihood[0] - self._scoring.allowance_nats
        # While a valve may or may not have moved yet, what predicts sharply is not the likelier for it: then
        # hypotheses may lose, but not gain, and none begins anew.
        if any(step.switching):
            self._grace_s = self._scoring.grace_s
            gain = np.minimum(gain, 0.0)
        least = np.where(self._tables.built, self._scoring.debt_nats if self._grace_s > 0.0 else 0.0, 0.0)
        self._scores = np.maximum(self._scores + gain, least)
        if any(step.switching):
            return
        self._grace_s -= step.duration_s
        tells_nothing = self._nothing_changes() & ~beyond_doubt
        self._scores = np.where(tells_nothing, np.minimum(self._scores, 0.0), self._scores)
        self._scores[0] = 0.0
        self._scores[self._known] = 0.0
        self._begin_again()

    def _late_pa(self, readings_pa: Array, duration_s: float) -> Array:
        """Return how far each reading may be off as nobody knows to the millisecond when it was made, Pa.

        From the readings alone, and so the same for all: a hypothesis gains nothing by being vague in time.
        """
        self._lately.append((duration_s, readings_pa))
        known = np.array([readings for _, readings in self._lately])
        known = np.where(np.isfinite(known), known, readings_pa)  # one that is missing has not moved
        span_s = sum(duration for duration, _ in self._lately)
        late_pa: Array = self._spread.timing_s * np.nan_to_num(np.ptp(known, axis=0)) / span_s
        return late_pa

    def _repeats(self, readings_pa: Array, ambient_pa: float) -> tuple[Flags, Flags]:
        """Return which hypotheses of a stuck sensor see it repeat as it never did, and which of them in vacuum.

        At the atmosphere a converter may be at the end of its range, and a healthy reading then repeats, too.
        """
        heard = np.isfinite(readings_pa)
        same = heard & (readings_pa == self._last_pa)
        changed = heard & ~same
        self._longest_run = np.where(changed, np.maximum(self._longest_run, self._run), self._longest_run)
        self._changes += changed
        self._changes_while_stuck += (self._tables.stuck & changed).any(axis=1)
        self._run = np.where(changed, 0.0, self._run + same)
        self._last_pa = np.where(heard, readings_pa, self._last_pa)
        news = (
            same
            & (self._changes >= KNOWN_AFTER)
            & (self._run > self._scoring.longer_run * self._longest_run + self._scoring.more_repeats)
        )
        repeats: Flags = (self._tables.stuck & news).any(axis=1)
        evacuated = np.nan_to_num(ambient_pa - readings_pa) > self._scoring.evacuated_pa
        return repeats, (self._tables.stuck & news & evacuated).any(axis=1)

    def _nothing_changes(self) -> Flags:
        """Hypotheses of a stuck sensor whose pressure is still what that reads."""
        layout, stuck = self._layout, self._tables.stuck
        seen_pa = self._state[:, layout.pressures] + self._state[:, layout.offsets]
        still: Flags = (stuck & (np.abs(seen_pa - self._held_pa) < self._scoring.still_pa)).any(axis=1)
        return still

    def _begin(self, readings_pa: Array, ambient_pa: float) -> None:
        volumes = self._layout.volumes
        heard = np.isfinite(readings_pa)
        self._state[:, :volumes] = np.where(heard, readings_pa, ambient_pa)
        self._held_pa[:] = self._state[:, :volumes]
        index = self._every[:volumes]
        self._covariance[:, index, index] = np.where(heard, self._spread.offset_pa, self._scoring.unknown_pa) ** 2
        self._fresh = False

    def _begin_again(self) -> None:
        """Let hypotheses that have gained nothing start from where the healthy one is, their fault beginning now."""
        tables, every = self._tables, self._every
        again = tables.begins_again & (self._scores == 0.0)
        self._state[again] = self._state[0]
        self._covariance[again] = self._covariance[0]
        moved = again[:, None] & tables.moved
        self._state[moved] = tables.mean[moved]
        self._covariance[moved] = 0.0
        self._covariance.transpose(0, 2, 1)[moved] = 0.0
        self._covariance[:, every, every] += np.where(moved, tables.deviation**2, 0.0)
        self._covariance[:, every, every] += np.where(again[:, None], tables.jump**2, 0.0)
        expected_pa = self._state[0, self._layout.pressures] + self._state[0, self._layout.offsets]
        self._held_pa[again] = np.where(self._run > 0, self._last_pa, expected_pa)  # what repeats may have jumped there
        self._held_variance[again] = self._spread.noise_pa**2
        self._changes_while_stuck[again] = 0.0

    def _weigh(self, readings_pa: tuple[float, ...], late_pa: Array) -> Array:
        """Take the readings one after the other into every filter; return the log-likelihood of each."""
        state, covariance, tables = self._state, self._covariance, self._tables
        total = np.zeros(len(state))
        for place, reading_pa in enumerate(readings_pa):
            if not math.isfinite(reading_pa):
                continue
            noise = self._spread.noise_pa**2 + float(late_pa[place]) ** 2
            offset, stuck = self._layout.offset(place), tables.stuck[:, place]
            row = covariance[:, place, :] + covariance[:, offset, :]
            held = self._held_variance[:, place]
            seen_pa = np.where(stuck, self._held_pa[:, place], state[:, place] + state[:, offset])
            error = reading_pa - seen_pa
            expected = np.where(stuck, held, row[:, place] + row[:, offset]) + noise
            squared = error * error / expected
            total -= 0.5 * (np.minimum(squared, self._scoring.cap) + np.log(expected))
            share = held / (held + noise)
            self._held_pa[:, place] += np.where(stuck, share * error, 0.0)
            self._held_variance[:, place] = share * noise
            # Beyond the cap a reading pulls no harder than at it (Huber 1964).
            # But where the pressures begin anew, they begin with what is read, however far that is.
            beyond = 1.0 if self._bridging else np.maximum(1.0, squared / self._scoring.cap)
            gain = row * np.where(stuck, 0.0, 1.0 / (expected * beyond))[:, None]
            state += gain * error[:, None]
            covariance -= gain[:, :, None] * row[:, None, :]
        np.clip(state, tables.least, tables.most, out=state)
        return total
