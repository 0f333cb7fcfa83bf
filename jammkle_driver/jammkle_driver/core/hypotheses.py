"""Hypotheses of what may have failed, and what each changes in the law of the air."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_driver.core.faults import Reason

if TYPE_CHECKING:
    from jammkle_driver.core.air import AirSettings


HEALTHY_OFFSET_PA = (-1000.0, 1000.0)
"""Offset of a good sensor, Pa: 1 % of an atmosphere, as cheap data sheets say over temperature."""

HEALTHY_PUMP = (0.55, 2.0)
HEALTHY_END = (0.8, 1.25)
HEALTHY_LINE = (0.4, 2.5)
HEALTHY_LEAK = (0.0, 0.03)
"""Shares of what was declared that still count as built so: a pump at half of its flow or a line at a third jams an
ankle in twice the time. A pump may end at 80 to 125 % of the declared vacuum: pumps of one type differ, and a membrane
pump ends at a ratio of pressures: 10 % less vacuum where the atmosphere is 10 % lower. A healthy leak takes less than a
tenth of the pump's flow at 50 kPa."""

WEAK_PUMP = (0.08, 0.45)
DEAD_PUMP = (0.0, 0.05)
BLOCKED_LINE = (0.0, 0.3)
SMALL_LEAK = (0.04, 0.3)
LARGE_LEAK = (0.2, 1.5)
"""Shares that are faults; what lies between goes to the nearer one. Leaks in two, for the range spans 1 to 40."""

JUMP_PA = 50e3
"""How far a sensor's reading may jump at once, Pa."""

DRIFT_PA_S = 2e3
"""Standard deviation of the rate at which a drifting offset moves, Pa/s: 0.3 to 5 kPa/s are found."""

DRIFT_TIME_S = 5.0
"""For how long a drift keeps its rate, s: about what the slowest of them takes to be off by what counts."""

_RANGE_SPREAD = 0.4
"""Standard deviation of a share within its range, over the range's width: about that of a uniform one."""

_RANGE_WANDER = 0.1
"""How a share may wander within its range, over its width, 1/sqrt(s)."""


@dataclass(frozen=True)
class Spread:
    """How far healthy ankles are from what was declared: standard deviations, and how slowly that changes.

    Attributes:
        noise_pa: Of one reading, Pa.
        timing_s: Of the time at which it was made, s: a cycle of the line, or as much delay in a host that is busy.
        offset_pa: Of a sensor's offset, Pa.
        pump: Of the pump's share of its declared flow, 1.
        end: Of the declared ultimate vacuum over the pump's own, 1.
        line: Of a line's share of its declared conductance, 1.
        leak: Of a leak, as a share of a valve's conductance, 1.
        flow: Of each flow beyond that, relative: what the law leaves out, 1.
        flow_time_s: For how long such an error lasts, s.
        change_time_s: In which what is built changes within its spread, s.

    """

    noise_pa: float = 60.0
    timing_s: float = 0.008
    offset_pa: float = 250.0
    pump: float = 0.2
    end: float = 0.1
    line: float = 0.2
    leak: float = 0.003
    flow: float = 0.05
    flow_time_s: float = 0.05
    change_time_s: float = 100.0


@dataclass(frozen=True)
class Hypothesis:
    """One thing that may have failed.

    Attributes:
        reason: What; NONE is the healthy ankle.
        place: Index of the volume that it is at: 0 the manifold, then the channels.
        sudden: The one of two of the same reason and place that is large at once: a large leak, an offset that jumps.

    """

    reason: Reason
    place: int
    sudden: bool = False


class Layout:
    """Where each quantity stands in a state of `volumes` volumes."""

    def __init__(self, volumes: int) -> None:
        """Lay out a state."""
        self.volumes = volumes
        self.size = 4 * volumes + 2
        self.pressures = slice(0, volumes)
        self.offsets = slice(volumes, 2 * volumes)
        self.pump = 2 * volumes
        self.lines = slice(2 * volumes + 1, 3 * volumes)
        self.leaks = slice(3 * volumes, 4 * volumes)
        self.drift = 4 * volumes
        self.end = 4 * volumes + 1


def all_hypotheses(volumes: int) -> tuple[Hypothesis, ...]:
    """Return the healthy ankle, and then everything that may have failed."""
    places, channels = range(volumes), range(1, volumes)
    return (
        Hypothesis(Reason.NONE, 0),
        *(Hypothesis(Reason.LEAK, place, sudden) for sudden in (False, True) for place in places),
        *(Hypothesis(Reason.BLOCKED_LINE, place) for place in channels),
        *(Hypothesis(Reason.VALVE_STUCK_OPEN, place) for place in channels),
        *(Hypothesis(Reason.VALVE_STUCK_CLOSED, place) for place in channels),
        Hypothesis(Reason.PUMP_WEAK, 0),
        Hypothesis(Reason.PUMP_DEAD, 0),
        *(Hypothesis(Reason.SENSOR_STUCK, place) for place in places),
        *(Hypothesis(Reason.SENSOR_DRIFTING, place, sudden) for sudden in (False, True) for place in places),
    )


class Tables:
    """Ranges and spreads of every hypothesis, one row each, and what is stuck in it."""

    def __init__(self, air: AirSettings, spread: Spread) -> None:
        """Write the tables of an ankle."""
        self.layout = layout = Layout(len(air.volumes_m3))
        self.hypotheses = all_hypotheses(layout.volumes)
        shape = (len(self.hypotheses), layout.size)
        self.mean = np.zeros(shape)
        self.deviation = np.zeros(shape)
        self.time_s = np.full(shape, spread.change_time_s)
        self.wander = np.zeros(shape)  # variance per s
        self.jump = np.zeros(shape)
        self.least = np.full(shape, -np.inf)
        self.most = np.full(shape, np.inf)
        self.moved = np.zeros(shape, dtype=bool)
        for where, mean, deviation, bounds in (
            (layout.offsets, 0.0, spread.offset_pa, HEALTHY_OFFSET_PA),
            (layout.pump, 1.0, spread.pump, HEALTHY_PUMP),
            (layout.end, 1.0, spread.end, HEALTHY_END),
            (layout.lines, 1.0, spread.line, HEALTHY_LINE),
            (layout.leaks, air.leak_conductance_m3_s_pa / air.valve_conductance_m3_s_pa, spread.leak, HEALTHY_LEAK),
        ):
            self.mean[:, where] = mean
            self.deviation[:, where] = deviation
            self.least[:, where], self.most[:, where] = bounds
        channels = layout.volumes - 1
        self.opened = np.zeros((len(self.hypotheses), channels), dtype=bool)
        self.closed = np.zeros((len(self.hypotheses), channels), dtype=bool)
        self.stuck = np.zeros((len(self.hypotheses), layout.volumes), dtype=bool)
        self.drifting: list[tuple[int, int]] = []
        for model, hypothesis in enumerate(self.hypotheses):
            self._write(model, hypothesis)
        self.built = self.moved[:, layout.pump : layout.drift].any(axis=1)
        """Hypotheses of a part that is built otherwise: pump, lines, leaks."""
        self.begins_again = np.arange(len(self.hypotheses)) > 0
        """Hypotheses that cannot follow the truth before their fault has begun: until then the healthy one leads."""

    def _write(self, model: int, hypothesis: Hypothesis) -> None:
        place, reason, layout = hypothesis.place, hypothesis.reason, self.layout
        ranges = {
            Reason.LEAK: (layout.leaks.start + place, LARGE_LEAK if hypothesis.sudden else SMALL_LEAK),
            Reason.BLOCKED_LINE: (layout.lines.start + place - 1, BLOCKED_LINE),
            Reason.PUMP_WEAK: (layout.pump, WEAK_PUMP),
            Reason.PUMP_DEAD: (layout.pump, DEAD_PUMP),
        }
        if reason in ranges:
            self._move(model, *ranges[reason])
        elif reason is Reason.SENSOR_DRIFTING:
            offset = layout.offsets.start + place
            self.least[model, offset], self.most[model, offset] = -np.inf, np.inf
            if hypothesis.sudden:
                self.jump[model, offset] = JUMP_PA
            else:
                self.time_s[model, offset] = np.inf
                self.deviation[model, layout.drift] = DRIFT_PA_S
                self.time_s[model, layout.drift] = DRIFT_TIME_S
                self.moved[model, layout.drift] = True
                self.drifting.append((model, offset))
        elif reason is not Reason.NONE:
            stuck = {
                Reason.VALVE_STUCK_OPEN: (self.opened, place - 1),
                Reason.VALVE_STUCK_CLOSED: (self.closed, place - 1),
                Reason.SENSOR_STUCK: (self.stuck, place),
            }
            table, index = stuck[reason]
            table[model, index] = True

    def _move(self, model: int, index: int, bounds: tuple[float, float]) -> None:
        """Take one thing to another range."""
        low, high = bounds
        self.least[model, index], self.most[model, index] = low, high
        self.mean[model, index] = 0.5 * (low + high)
        self.deviation[model, index] = _RANGE_SPREAD * (high - low)
        self.wander[model, index] = (_RANGE_WANDER * (high - low)) ** 2
        self.time_s[model, index] = np.inf
        self.moved[model, index] = True
