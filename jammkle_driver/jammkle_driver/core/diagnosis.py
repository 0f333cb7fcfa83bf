"""What has failed, from what was commanded and what the pressure sensors read: one verdict, with its numbers.

The readings of a moment are handed to the filters of `core.bank`; a fault is told once the hypothesis of it has gained
`THRESHOLD` over the healthy ankle and leads all others. A sensor that reads what no pressure can be is
told without a model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_driver.core.bank import FilterBank
from jammkle_driver.core.description import describe, describe_out_of_range, describe_stand_still
from jammkle_driver.core.evidence import LATE_SETS
from jammkle_driver.core.faults import Finding, Reason
from jammkle_driver.core.freshness import Freshness
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_driver.core.heat import HeatMeter
from jammkle_driver.core.prediction import Step

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_driver.core.air import AirSettings
    from jammkle_driver.core.atmosphere import AtmosphereStatus
    from jammkle_driver.core.bank import Estimate
    from jammkle_driver.core.evidence import Moment
    from jammkle_driver.core.hardware import ActuatorCommand

THRESHOLD = 45.0
"""Log-likelihood that a fault must have gained, nats. A cumulative sum crosses h by chance after exp(h) steps at the
least (Lorden 1971): exp(20) are 1500 hours of 30 hypotheses at 100 Hz. The rest is for what the law leaves out: healthy
ankles whose parts are off by 10 to 20 % came to 35 in hours of jamming."""

LEAD = 15.0
"""How far the best hypothesis must lead any other to be told at once, nats: odds of three million to one."""

STEADY_S = 0.25
"""How long a hypothesis must lead, s: five of the time constants in which a channel fills."""

PATIENCE_S = 1.0
"""How long two hypotheses are waited for to separate; then the better one is told, s."""

LEVEL_COST = 15.0
"""What a stuck sensor must gain more than other faults, nats: its level is fitted to the very readings."""

CHANGES_COST = THRESHOLD
"""What it must gain more at the most, nats, if its reading goes on changing, as that of a vented channel does: each
change counts against it as each repeat counts for it, and all of them as much as any fault must gain. The air alone
does not part it from a valve that stays closed: a weak pump draws two channels as a declared one draws three."""

SWITCHING_S = 0.08
"""For how long after a command a valve may be moving or not, s: four dead times of a small solenoid."""

DUTY_DOUBT_S = 0.06
"""In which time a new duty comes to act, s. Assumed: the way to the board, and the pump's motor."""

OUT_OF_RANGE_PA = 3e3
"""How far beyond what can be a reading must be, Pa: above the atmosphere, or below what is left at the pump's end."""

_DRIFT_PA = 1200.0
"""Offset from which a sensor counts as drifting, Pa: five deviations of a good sensor's."""

_LONGEST_STEP_S = 0.1
"""Time between two sets of readings beyond which the law says nothing of the pressures, s: a channel fills in it."""

LONGEST_STILL_S = 1.5
"""How long hardware may stand still, s, before its sensors are blamed: what a busy host was seen to take is 1 s."""

_LONGEST_GAP_S = 2.0
"""Time without readings beyond which the filters begin anew, s."""


@dataclass(frozen=True)
class DiagnosisSettings:
    """What the diagnosis goes by.

    Attributes:
        air: The ankle as built.

    """

    air: AirSettings


class Diagnosis:
    """Takes readings of one ankle with what was driven, and says what has failed."""

    def __init__(self, channels: Sequence[str], settings: DiagnosisSettings, ambient_pa: float) -> None:
        """Begin with a vented ankle."""
        self._channels = tuple(channels)
        self._places = (MANIFOLD, *self._channels)
        self._settings = settings
        self._bank = FilterBank(settings.air, ambient_pa)
        self._heat = HeatMeter(len(self._places))
        self._freshness = Freshness()
        self.clear(ambient_pa)

    @property
    def estimate(self) -> Estimate:
        """What the healthy hypothesis makes of the ankle: leaks, pump, lines, offsets."""
        return self._bank.estimate()

    @property
    def scores(self) -> dict[str, float]:
        """What each kind of fault has gained over the healthy ankle, nats, by `reason place`."""
        table: dict[str, float] = {}
        for hypothesis, score in zip(self._bank.hypotheses, self._bank.scores, strict=True):
            if hypothesis.reason is not Reason.NONE:
                name = f"{hypothesis.reason.name} {self._places[hypothesis.place]}"
                table[name] = max(float(score), table.get(name, 0.0))
        return table

    def clear(self, ambient_pa: float) -> None:
        """Forget everything, faults included, and begin anew from the next readings."""
        self._known: dict[str, Reason] = {}
        self._bank.leave_out(())
        self._bank.reset(ambient_pa)
        self._heat.reset()
        self._last_s = -math.inf
        self._leading_s = 0.0
        self._thawed = (-math.inf, -math.inf)
        self._strange = dict.fromkeys(self._places, 0)

    def go_on_without(self, found: Finding, ambient_pa: float) -> None:
        """Look for a second fault beside one of a channel, which stays vented; counted from the next readings.

        Nothing more is made of that channel or its sensor; one whose valve stays open is still part of the vacuum.
        """
        self._known[found.place] = found.reason
        self._bank.leave_out([self._places.index(place) for place in self._known])
        self._bank.reset(ambient_pa)
        self._heat.reset()
        self._leading_s = 0.0

    def check_range(self, place: str, pressure_pa: float, air: AtmosphereStatus) -> Finding | None:
        """Take one reading, Pa absolute, finite, at once: that it is none that any pressure can be needs no time.

        Returns:
            What has failed, if that is clear now.

        """
        if place in self._known:
            return None
        ambient_pa = air.pressure_pa
        least_pa = ambient_pa - self._settings.air.pump_ultimate_vacuum_pa - OUT_OF_RANGE_PA
        most_pa = ambient_pa + OUT_OF_RANGE_PA
        inside = least_pa <= pressure_pa <= most_pa
        self._strange[place] = 0 if inside else self._strange[place] + 1
        if self._strange[place] < LATE_SETS:
            return None
        return describe_out_of_range(place, pressure_pa, least_pa, most_pa, atmosphere_measured=air.measured)

    def take(self, moment: Moment, ambient_pa: float) -> Finding | None:
        """Take the readings of the next moment; return what has failed, if that is clear now.

        Args:
            moment: What was read, and what was driven until then.
            ambient_pa: Pressure of the atmosphere, as it was measured, Pa.

        """
        stamp_s, readings_pa = moment.stamp_s, moment.readings_pa
        duration_s = stamp_s - self._last_s
        stood_still = self._freshness.stood_still
        if self._freshness.take(readings_pa) and duration_s < LONGEST_STILL_S:
            return None
        if self._freshness.stood_still:
            return self._all_stand_still(duration_s, readings_pa, ambient_pa)
        if stood_still:  # it went on just now: with what it was told long ago, and from who knows where
            self._thawed = (self._last_s, stamp_s)
            self._bank.bridge()
        self._last_s = stamp_s
        if not 0.0 < duration_s < _LONGEST_GAP_S:  # also the first one, and a clock that was set back
            self._bank.reset(ambient_pa)
            self._heat.reset()
            return None
        if duration_s > _LONGEST_STEP_S or not moment.known:
            self._bank.bridge()
            duration_s = min(duration_s, _LONGEST_STEP_S)
        self._bank.advance(self._step(moment, duration_s, ambient_pa))
        return self._judge(duration_s)

    def _all_stand_still(
        self, duration_s: float, readings_pa: Mapping[str, float], ambient_pa: float
    ) -> Finding | None:
        """Blame the sensors for one reading that all repeat under vacuum; at the atmosphere it may be their end."""
        self._last_s += duration_s
        if ambient_pa - min(readings_pa.values()) < self._bank.scoring.evacuated_pa:
            self._freshness = Freshness()
            self._bank.bridge()
            return None
        return describe_stand_still(duration_s, self._freshness.run)

    def _step(self, moment: Moment, duration_s: float, ambient_pa: float) -> Step:
        stamp_s, driven = moment.stamp_s, moment.driven
        acts_s = stamp_s - self._settings.air.valve_dead_time_s - 0.5 * duration_s
        acting = ([command for since_s, command in driven if since_s <= acts_s] or [driven[0][1]])[-1]
        thawing_s, thawed_s = self._thawed
        lately_s = thawing_s if stamp_s < thawed_s + SWITCHING_S else stamp_s - SWITCHING_S
        lately = _since(driven, lately_s, stamp_s)
        switching = tuple(len({command.solenoids[name] for command in lately}) > 1 for name in self._channels)
        duties = [command.pump_duty for command in _since(driven, stamp_s - DUTY_DOUBT_S, stamp_s)]
        stays_open = [place for place, reason in self._known.items() if reason is Reason.VALVE_STUCK_OPEN]
        readings_pa = tuple(
            math.nan if place in self._known and place not in stays_open else moment.readings_pa.get(place, math.nan)
            for place in self._places
        )
        return Step(
            duration_s=duration_s,
            readings_pa=readings_pa,
            connected=tuple(acting.solenoids[name] or name in stays_open for name in self._channels),
            switching=switching,
            duty=0.5 * (max(duties) + min(duties)),
            duty_doubt=(max(duties) - min(duties)) / math.sqrt(12.0),
            ambient_pa=ambient_pa,
            heat_pa=self._heat.measure(readings_pa, duration_s),
        )

    def _judge(self, duration_s: float) -> Finding | None:
        bank = self._bank
        counted = [self._fair(model, float(score)) for model, score in enumerate(bank.scores)]
        best = max(range(len(counted)), key=counted.__getitem__)
        chosen = bank.hypotheses[best]
        rivals = [
            model
            for model, hypothesis in enumerate(bank.hypotheses)
            if not (hypothesis.reason is chosen.reason and hypothesis.place == chosen.place)
        ]
        lead = counted[best] - max(counted[model] for model in rivals)
        if chosen.reason is not Reason.VALVE_STUCK_CLOSED:  # what parts a sensor from a valve is no haste for others
            lead = min(lead, counted[best] - max(self._fair(m, float(bank.scores[m]), changes=0.0) for m in rivals))
        self._leading_s = self._leading_s + duration_s if counted[best] >= THRESHOLD else 0.0
        if self._leading_s < (STEADY_S if lead > LEAD else PATIENCE_S):
            return None
        close = (best, *(model for model in rivals if counted[best] - counted[model] <= LEAD))
        if not any(self._is_small_drift(model) for model in close):
            return describe(chosen, self._places, bank.estimate(best), float(bank.scores[best]))
        if lead > LEAD and chosen.sudden:
            bank.adopt(best)
            self._leading_s = 0.0
        return None

    def _fair(self, model: int, score: float, changes: float | None = None) -> float:
        """Return what a hypothesis counts for, nats; `changes` of its reading instead of those that were seen."""
        if self._bank.hypotheses[model].reason is not Reason.SENSOR_STUCK:
            return score
        if changes is None:
            changes = float(self._bank.changes_while_stuck[model])
        return score - LEVEL_COST - min(changes * self._bank.scoring.repeat_nats, CHANGES_COST)

    def _is_small_drift(self, model: int) -> bool:
        """Whether a sensor has moved, by this hypothesis, and is still as good as a healthy one."""
        hypothesis = self._bank.hypotheses[model]
        if hypothesis.reason is not Reason.SENSOR_DRIFTING:
            return False
        return abs(self._bank.estimate(model).offsets_pa[hypothesis.place]) <= _DRIFT_PA


def _since(driven: Sequence[tuple[float, ActuatorCommand]], begin_s: float, end_s: float) -> list[ActuatorCommand]:
    """Return the command that stood at `begin_s`, and those that came until `end_s`; the first one if none had."""
    before = [command for since_s, command in driven if since_s < begin_s]
    within = [command for since_s, command in driven if begin_s <= since_s <= end_s]
    return [*before[-1:], *within] or [driven[0][1]]
