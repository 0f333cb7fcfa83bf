"""What has failed, found from what was measured and what was driven meanwhile, by the hardware's own times.

A busy host hands readings and acknowledgements over late, in any order, or not at all. `Evidence` puts them in order by
their stamps, and a set of readings counts only once the hardware has said what it drove up to then. Where it has not,
the pressures begin anew; so a pause of the host can hide a fault for a moment, and never make one. `Diagnosis` decides
between the hypotheses of the bank.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_driver.core.air import HeatMeter
from jammkle_driver.core.bank import FilterBank, Freshness, Step
from jammkle_driver.core.faults import Finding, Reason, finding
from jammkle_driver.core.hardware import MANIFOLD

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from jammkle_driver.core.air import AirSettings, Atmosphere
    from jammkle_driver.core.bank import Estimate
    from jammkle_driver.core.hardware import ActuatorCommand


LONGEST_UNKNOWN_S = 0.1
"""Time from one acknowledgement to the next, s, beyond which nobody knows what was driven in between: two of the
periods at which hardware repeats it (20 Hz, jammkle_msgs/ActuatorStates)."""

LATE_SETS = 5
"""Sets of readings after which one that is missing a place is taken without it."""

_KEPT_S = 2.5
"""How long what was driven is remembered, s: longer than readings may be missing until all begins anew."""

_MOST_WAITING = 200
"""Sets that wait for an acknowledgement at the most: two seconds; older ones count for nothing."""

_SET_BACK_S = 1.0
"""By how much a stamp must be before the last one, s, to be of a clock that was set back, and not merely late."""


@dataclass(frozen=True)
class Moment:
    """Readings of one moment, and what led to them.

    Attributes:
        stamp_s: When they were made, s.
        readings_pa: Pa absolute, by place; one that is missing was not read.
        since_s: When the moment before was, s; of the first one, when itself was.
        driven: What the hardware drove over the last few seconds, each with the stamp since when, s; oldest first.
        known: Whether all of that is known ever since the moment before.

    """

    stamp_s: float
    readings_pa: Mapping[str, float]
    since_s: float
    driven: tuple[tuple[float, ActuatorCommand], ...]
    known: bool

    @property
    def elapsed_s(self) -> float:
        """Time since the moment before, s; 0 of the first one."""
        return self.stamp_s - self.since_s

    @property
    def stood(self) -> list[ActuatorCommand]:
        """Every command that stood since the moment before, however briefly; `driven` may end with later ones."""
        return _since(self.driven, self.since_s, self.stamp_s)


class Evidence:
    """Puts readings and what was driven in order."""

    def __init__(self, places: Sequence[str]) -> None:
        """Expect readings of `places`."""
        self._places = tuple(places)
        self._acknowledged = False
        self.clear()

    def clear(self) -> None:
        """Forget all readings and commands; what comes now begins anew."""
        self._driven: deque[tuple[float, ActuatorCommand]] = deque()
        self.acknowledged_s = -math.inf
        """Stamp up to which the hardware has said what it drove, s; minus infinity if it has said nothing."""
        self._holes: deque[tuple[float, float]] = deque()
        self._waiting: dict[float, dict[str, float]] = {}
        self._last_s = -math.inf
        self._silent_sets = dict.fromkeys(self._places, 0)

    def command(self, command: ActuatorCommand, stamp_s: float) -> None:
        """Note what the hardware is commanded from `stamp_s` on, s; counts only where it acknowledges nothing."""
        if not self._acknowledged:
            self._drive(command, stamp_s)

    def acknowledge(self, command: ActuatorCommand, stamp_s: float) -> None:
        """Note what the hardware says that it drives, from `stamp_s` on or still then, s."""
        if not self._acknowledged or stamp_s < self.acknowledged_s:  # its first one, or a clock that was set back
            self._acknowledged = True
            self.clear()
        elif stamp_s - self.acknowledged_s > LONGEST_UNKNOWN_S:
            self._holes.append((self.acknowledged_s, stamp_s))
        self.acknowledged_s = stamp_s
        self._drive(command, stamp_s)

    def read(self, place: str, pressure_pa: float, stamp_s: float) -> None:
        """Take one reading, Pa absolute."""
        if stamp_s < self._last_s - _SET_BACK_S:
            self.clear()
        if stamp_s > self._last_s:
            self._waiting.setdefault(stamp_s, {})[place] = pressure_pa
            while len(self._waiting) > _MOST_WAITING:
                del self._waiting[min(self._waiting)]

    def due(self) -> Iterator[Moment]:
        """Yield, in order, the moments that are complete, and for which it is known what was driven."""
        while self._waiting:
            oldest_s = min(self._waiting)
            if self._acknowledged and oldest_s > self.acknowledged_s:
                return
            expected = sum(1 for silent in self._silent_sets.values() if silent <= 2 * LATE_SETS)
            if len(self._waiting[oldest_s]) < expected and len(self._waiting) <= LATE_SETS:
                return
            readings_pa = self._waiting.pop(oldest_s)
            holes = [(begin_s, end_s) for begin_s, end_s in self._holes if begin_s < oldest_s and end_s > self._last_s]
            if not self._driven or oldest_s < self._driven[0][0] or any(oldest_s < end_s for _, end_s in holes):
                continue  # nobody knows what led to it
            for place in self._places:
                self._silent_sets[place] = 0 if place in readings_pa else self._silent_sets[place] + 1
            since_s = self._last_s if math.isfinite(self._last_s) else oldest_s
            self._last_s = oldest_s
            self._holes = deque(hole for hole in self._holes if hole[1] > oldest_s)
            while len(self._driven) > 1 and self._driven[1][0] < oldest_s - _KEPT_S:
                self._driven.popleft()
            yield Moment(oldest_s, readings_pa, since_s, tuple(self._driven), known=not holes)

    def _drive(self, command: ActuatorCommand, stamp_s: float) -> None:
        if not self._driven or command != self._driven[-1][1]:
            self._driven.append((stamp_s, command))
        while len(self._driven) > 1 and self._driven[1][0] < stamp_s - _LONGEST_KEPT_S:  # nobody may ask what is due
            self._driven.popleft()


_LONGEST_KEPT_S = 10.0
"""How long what was driven is kept at the most, s: readings that come later are no evidence."""


THRESHOLD = 45.0
"""Log-likelihood that a fault must have gained, nats. A cumulative sum crosses h by chance after exp(h) steps at the
least (Lorden 1971): exp(20) are 1500 hours of 30 hypotheses at 100 Hz. The rest is for what the law leaves out: healthy
ankles whose parts are off by 10 to 20 % came to 35 in hours of jamming."""

LEAD = 15.0
"""How far the best hypothesis must lead any other to be reported at once, nats: odds of three million to one."""

STEADY_S = 0.25
"""How long a hypothesis must lead, s: five of the time constants in which a channel fills."""

PATIENCE_S = 1.0
"""How long two hypotheses are waited for to separate, one of them perhaps a stuck sensor; then the better one is
reported, s."""

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


class Diagnosis:
    """Takes readings of one ankle with what was driven, and says what has failed."""

    def __init__(self, channels: Sequence[str], air: AirSettings, ambient_pa: float) -> None:
        """Begin with a vented ankle."""
        self._channels = tuple(channels)
        self._places = (MANIFOLD, *self._channels)
        self._air = air
        self._bank = FilterBank(air, ambient_pa)
        self._heat = HeatMeter(len(self._places))
        self._freshness = Freshness()
        self.clear(ambient_pa)

    @property
    def estimate(self) -> Estimate:
        """What the healthy hypothesis makes of the ankle: leaks, pump, lines, offsets."""
        return self._bank.estimate()

    def clear(self, ambient_pa: float) -> None:
        """Forget everything, faults included, and begin anew from the next readings."""
        self._known: dict[str, Reason] = {}
        self._begin(ambient_pa)
        self._last_s = -math.inf
        self._thawed = (-math.inf, -math.inf)
        self._strange = dict.fromkeys(self._places, 0)

    def go_on_without(self, found: Finding, ambient_pa: float) -> None:
        """Look for a second fault beside one of a channel, which stays vented; counted from the next readings.

        Nothing more is made of that channel or its sensor; one whose valve stays open is still part of the vacuum.
        """
        self._known[found.place] = found.reason
        self._begin(ambient_pa)

    def _begin(self, ambient_pa: float) -> None:
        self._bank.leave_out([self._places.index(place) for place in self._known])
        self._bank.reset(ambient_pa)
        self._heat.reset()
        self._leading_s = 0.0

    def check_range(self, place: str, pressure_pa: float, air: Atmosphere) -> Finding | None:
        """Take one reading, Pa absolute, finite; return what has failed: what no pressure can be needs no time."""
        if place in self._known:
            return None
        ambient_pa = air.pressure_pa
        least_pa = ambient_pa - self._air.pump_ultimate_vacuum_pa - OUT_OF_RANGE_PA
        most_pa = ambient_pa + OUT_OF_RANGE_PA
        inside = least_pa <= pressure_pa <= most_pa
        self._strange[place] = 0 if inside else self._strange[place] + 1
        if self._strange[place] < LATE_SETS:
            return None
        values = {
            "reading (Pa)": f"{pressure_pa:.0f}",
            "least that can be (Pa)": f"{least_pa:.0f}",
            "most that can be (Pa)": f"{most_pa:.0f}",
        }
        seen = f"reads {pressure_pa:.0f} Pa absolute, and only {least_pa:.0f} to {most_pa:.0f} Pa can be"
        if not air.measured:
            seen += " if ambient_pressure_pa is right, which no vented channel has confirmed yet"
        return finding(Reason.SENSOR_OUT_OF_RANGE, place, seen, values)

    def take(self, moment: Moment, ambient_pa: float) -> Finding | None:
        """Take the next moment, and the atmosphere as measured, Pa; return what has failed, if that is clear now."""
        stamp_s, readings_pa = moment.stamp_s, moment.readings_pa
        duration_s = stamp_s - self._last_s
        stood_still = self._freshness.stood_still
        if self._freshness.take(readings_pa) and duration_s < LONGEST_STILL_S:
            return None
        if self._freshness.stood_still:
            return self._all_stand_still(duration_s, readings_pa, ambient_pa)
        if stood_still:  # it went on just now: with what it was commanded long ago, and from who knows where
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
        seen = f"and all other sensors repeat one reading to the digit for {duration_s:.1f} s"
        return finding(Reason.SENSOR_STUCK, MANIFOLD, seen, {"repeated sets (1)": str(self._freshness.run)})

    def _step(self, moment: Moment, duration_s: float, ambient_pa: float) -> Step:
        stamp_s, driven = moment.stamp_s, moment.driven
        acts_s = stamp_s - self._air.valve_dead_time_s - 0.5 * duration_s
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
        # A reading that does not follow speaks for the line or the valve at once, for its own sensor by repeats alone.
        may_be_stuck = chosen.reason is not Reason.SENSOR_STUCK and bank.repeats_as_never[chosen.place]
        if self._leading_s < (STEADY_S if lead > LEAD and not may_be_stuck else PATIENCE_S):
            return None
        close = (best, *(model for model in rivals if counted[best] - counted[model] <= LEAD))
        if not any(self._is_small_drift(model) for model in close):
            return self._describe(best)
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

    def _describe(self, model: int) -> Finding:
        """Return what has failed by a hypothesis."""
        hypothesis, estimate = self._bank.hypotheses[model], self._bank.estimate(model)
        reason, index, place = hypothesis.reason, hypothesis.place, self._places[hypothesis.place]
        values = {"log-likelihood gained (nats)": f"{self._bank.scores[model]:.0f}"}
        if reason is Reason.LEAK:
            leak = estimate.leaks_m3_s_pa[index]
            values["leak conductance (m^3/(s Pa))"] = f"{leak:.2e}"
            return finding(reason, place, f"leaks with a conductance of {leak * 1e8:.3f} dm^3/(s bar)", values)
        if reason is Reason.BLOCKED_LINE:
            share = estimate.line_shares[index - 1]
            values["line conductance (share of declared)"] = f"{share:.3f}"
            return finding(reason, place, f"line lets through {100.0 * share:.0f} % of what it should", values)
        if reason in {Reason.PUMP_WEAK, Reason.PUMP_DEAD}:
            share = estimate.pump_share
            values["pump flow (share of declared)"] = f"{share:.2f}"
            return finding(reason, MANIFOLD, f"pump draws {100.0 * share:.0f} % of its flow", values)
        if reason is Reason.SENSOR_DRIFTING:
            offset_pa = estimate.offsets_pa[index]
            values["sensor offset (Pa)"] = f"{offset_pa:.0f}"
            return finding(reason, place, f"sensor reads {offset_pa:+.0f} Pa off", values)
        must_pa, manifold_pa = estimate.pressures_pa[index], estimate.pressures_pa[0]
        values["pressure that must be (Pa)"] = f"{must_pa:.0f}"
        if reason is Reason.SENSOR_STUCK:
            seen = f"sensor's reading stands still where the pressure must be {must_pa:.0f} Pa absolute"
            return finding(reason, place, seen, values)
        values["pressure of the manifold (Pa)"] = f"{manifold_pa:.0f}"
        stays = "at the manifold" if reason is Reason.VALVE_STUCK_OPEN else "at the vent, or its line is shut"
        seen = f"valve stays {stays}: {must_pa:.0f} Pa absolute, the manifold {manifold_pa:.0f}"
        return finding(reason, place, seen, values)


def _since(driven: Sequence[tuple[float, ActuatorCommand]], begin_s: float, end_s: float) -> list[ActuatorCommand]:
    """Return the command that stood at `begin_s`, and those that came until `end_s`; the first one if none had."""
    before = [command for since_s, command in driven if since_s < begin_s]
    within = [command for since_s, command in driven if begin_s <= since_s <= end_s]
    return [*before[-1:], *within] or [driven[0][1]]
