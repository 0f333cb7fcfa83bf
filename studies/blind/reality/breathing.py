"""A run of the air: the firmware reads pressures and commands, pump and solenoids obey, tendons empty and fill."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from studies.blind.reality.air import AMBIENT, LINES, NODES, STEP_S, advance_air, air_law, fill_again, vented
from studies.blind.reality.faults import Era, era_at
from studies.blind.reality.machine import Machine, stream
from studies.blind.reality.record import Track
from studies.blind.reality.regulator import PERIOD_S, Memory, Orders, decide, wanted_pa
from studies.blind.reality.sampling import coloured, skewed_s

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.regulator import SetPoint

HISTORY_S = 5e-4
"""Between two rows of the history."""
_EVERY = round(HISTORY_S / STEP_S)
_DECIDES_S = 0.0003
"""From reading the pressures to commanding. Assumed."""
_TARE = 8
"""Readings of which the firmware takes the mean as atmosphere when it starts."""
_SENSED = (0, *(2 + 2 * i for i in range(LINES)))
"""Nodes with a pressure sensor: manifold, then the tendons of each line."""
_KEPT = 16
"""Runs of the air kept per process, as the same day is run with one fault after the other; each takes 0.5 MB."""


@dataclass(frozen=True)
class AirRun:
    """What the air did and what was recorded of it. Runs share it: nothing in it may be changed."""

    time_s: NDArray[np.float64]
    """Every HISTORY_S from 0, shape (n,)."""
    pressure_pa: NDArray[np.float64]
    """Absolute, of every node, shape (n, NODES)."""
    vacuum_pa: NDArray[np.float64]
    """In the tendons of each channel, shape (n, channels)."""
    topics: Mapping[str, Track]
    """Pressures and commands."""


def breathe(periods: Sequence[Era], schedule: Sequence[SetPoint], duration_s: float, seed: int) -> AirRun:
    """Run the air, vented at the start.

    Args:
        periods: The machine over time.
        schedule: Set points.
        duration_s: A whole number of hundredths of a second.
        seed: Of the run.

    """
    return _breathed(_of_the_air(periods), tuple(schedule), duration_s, seed)


def _of_the_air(periods: Sequence[Era]) -> tuple[Era, ...]:
    """Return the machine over time with all at its default that the air knows nothing of."""
    found: list[Era] = []
    for period in periods:
        real, plain = period.machine, Machine()
        sensors = dataclasses.replace(plain.sensors, pressure=real.sensors.pressure, clock=real.sensors.clock)
        machine = dataclasses.replace(plain, air=real.air, regulator=real.regulator, sensors=sensors)
        if not found or machine != found[-1].machine:
            found.append(Era(period.start_s, machine))
    return tuple(found)


@lru_cache(maxsize=_KEPT)
def _breathed(periods: tuple[Era, ...], schedule: tuple[SetPoint, ...], duration_s: float, seed: int) -> AirRun:
    """Run the air, or return what it did before: a fault of a tendon, of a body or of an IMU leaves it as it is."""
    return _Breathing(periods, schedule, duration_s, seed).run()


class _Breathing:
    """State of one such run."""

    def __init__(self, periods: Sequence[Era], schedule: Sequence[SetPoint], duration_s: float, seed: int) -> None:
        self._periods = periods
        self._schedule = schedule
        self._ticks = round(duration_s / PERIOD_S)
        self._machine = periods[0].machine
        self._law = air_law(self._machine.air)
        self._state = vented(self._law)
        self._steps = 0
        self._history_pa = np.zeros((round(self._ticks * PERIOD_S / HISTORY_S) + 1, NODES))
        self._history_pa[0] = self._machine.air.ambient_pa
        self._switching = stream(seed, "switching")
        sensors = self._machine.sensors.pressure
        self._noise_pa = np.column_stack(
            [coloured(stream(seed, f"pressure {i}"), sensor, PERIOD_S, self._ticks) for i, sensor in enumerate(sensors)]
        )
        self._clock = stream(seed, "moments of pressures")
        self._commands: dict[str, list[tuple[float, float]]] = {}
        self._due: list[tuple[int, Orders]] = []
        self._latest = Orders(0.0, (False,) * LINES)

    def run(self) -> AirRun:
        """Take the air through the run."""
        memory, read = Memory(), np.zeros((self._ticks, len(_SENSED)))
        clock = self._machine.sensors.clock
        jitter_s = np.clip(
            clock.sample_jitter_s * np.abs(self._clock.standard_normal(self._ticks)), 0.0, PERIOD_S / 4.0
        )
        taken_s = PERIOD_S * np.arange(self._ticks) + np.round(jitter_s / STEP_S) * STEP_S
        for tick in range(self._ticks):
            self._advance_to(float(taken_s[tick]))
            read[tick] = self._read(tick, float(taken_s[tick]))
            atmosphere_pa = read[: min(tick + 1, _TARE)].mean(axis=0)
            vacuum_pa = (atmosphere_pa - read[tick]).tolist()
            regulator = self._machine.regulator
            wanted = wanted_pa(self._schedule, float(taken_s[tick]))
            orders, memory = decide(regulator, memory, wanted, vacuum_pa[1:], vacuum_pa[0])
            self._order(float(taken_s[tick]) + _DECIDES_S, orders)
        self._advance_to(self._ticks * PERIOD_S)
        time_s = HISTORY_S * np.arange(len(self._history_pa), dtype=np.float64)
        ambient_pa = self._law.scalars[AMBIENT]
        vacuum = np.maximum(ambient_pa - self._history_pa[:, list(_SENSED[1:])], 0.0)
        return AirRun(time_s, self._history_pa, vacuum, {**self._pressures(taken_s, read), **self._command_tracks()})

    def _advance_to(self, time_s: float) -> None:
        """Go on, stopping wherever an order arrives or the machine changes."""
        end = round(time_s / STEP_S)
        while self._steps < end:
            stops = [step for step, _ in self._due] + [round(each.start_s / STEP_S) for each in self._periods[1:]]
            goal = min([end, *(step for step in stops if step > self._steps)])
            advance_air(self._law, self._state, self._steps, goal - self._steps, _EVERY, self._history_pa)
            self._steps = goal
            self._change()
            for step, orders in [each for each in self._due if each[0] <= goal]:
                self._obey(orders)
                self._due.remove((step, orders))

    def _change(self) -> None:
        """Take over the machine as it is from now on."""
        current = era_at(self._periods, self._steps * STEP_S + STEP_S / 2.0)
        if current is not self._machine:
            before, self._machine, self._law = self._law, current, air_law(current.air)
            fill_again(self._law, before, self._state)

    def _order(self, time_s: float, orders: Orders) -> None:
        """Record what is commanded, and let it arrive."""
        values = {names.PUMP_DUTY.name: orders.duty}
        values |= {
            names.SOLENOIDS[channel].name: float(coil)
            for channel, coil in zip(names.CHANNELS, orders.coils, strict=True)
        }
        for topic, value in values.items():
            kept = self._commands.setdefault(topic, [])
            if not kept or kept[-1][1] != value:
                kept.append((time_s, value))
        arrives_s = time_s + self._machine.sensors.clock.command_delay_s
        self._due.append((max(round(arrives_s / STEP_S), self._steps + 1), orders))

    def _obey(self, orders: Orders) -> None:
        """Let pump and armatures follow."""
        self._state.more[0] = orders.duty
        for i, (new, old) in enumerate(zip(orders.coils, self._latest.coils, strict=True)):
            if new != old:
                line = self._machine.air.lines[i]
                late, sticks = self._switching.standard_normal(), self._switching.random()
                stuck_s = line.stick_s if sticks < line.stick_share else 0.0
                self._state.goal[i] = float(new)
                self._state.wait_s[i] = max(line.dead_s + line.dead_jitter_s * late, 0.0) + stuck_s
        self._latest = orders

    def _read(self, tick: int, time_s: float) -> NDArray[np.float64]:
        """Return what the pressure sensors give now: the past, smoothed by their lag."""
        found = np.zeros(len(_SENSED))
        for i, (node, sensor) in enumerate(zip(_SENSED, self._machine.sensors.pressure, strict=True)):
            place = (time_s - sensor.delay_s) / HISTORY_S
            weights, total = 0.0, 0.0
            for back in range(8):
                at = min(max(int(place) - back, 0), len(self._history_pa) - 1)
                weight = float(np.exp(-back * HISTORY_S / max(sensor.lag_s, 1e-6)))
                weights += weight
                total += weight * float(self._history_pa[at, node])
            raw = sensor.gain * total / weights + sensor.offset + self._noise_pa[tick, i]
            found[i] = round(raw / sensor.step) * sensor.step
        return found

    def _pressures(self, taken_s: NDArray[np.float64], read: NDArray[np.float64]) -> dict[str, Track]:
        clock, draw = self._periods[0].machine.sensors.clock, self._clock
        stamp_s = skewed_s(self._periods, taken_s) + clock.stamp_jitter_s * draw.standard_normal(taken_s.size)
        topics = (names.MANIFOLD_PRESSURE, *(names.PRESSURES[channel] for channel in names.CHANNELS))
        found = {}
        for i, topic in enumerate(topics):
            kept = draw.random(taken_s.size) >= clock.dropped
            kept[0] = True
            log_s = np.maximum.accumulate(
                taken_s + clock.log_s + clock.log_jitter_s * draw.exponential(size=taken_s.size)
            )
            log_s += 1e-9 * np.arange(taken_s.size)
            stamps_s = np.maximum.accumulate(np.maximum(stamp_s, 0.0))
            found[topic.name] = Track(("fluid_pressure_pa",), stamps_s[kept], log_s[kept], read[kept, i : i + 1])
        return found

    def _command_tracks(self) -> dict[str, Track]:
        found = {}
        for topic, changes in self._commands.items():
            table = np.array(changes)
            found[topic] = Track(("data",), table[:, 0], table[:, 0], table[:, 1:])
        return found
