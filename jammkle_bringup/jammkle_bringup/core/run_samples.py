"""What a picture needs of one ankle's bag, taken message by message in constant memory.

A signal keeps of each stretch of time the extremes, so that no peak is lost. There are never more stretches than a
fixed number: where a signal goes on, two neighbours become one.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import (
    CARRIAGE_JOINT,
    CHANNELS,
    CONTACT_EVENTS,
    IMU,
    JAM_STATE,
    JOINT_STATES,
    LOAD_CELL,
    MANIFOLD_PRESSURE,
    PRESSURES,
    PUMP_DUTY,
    SOLENOIDS,
    TENDON_STATES,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

STRETCHES = 2000
"""Most stretches of one signal: more than a screen has columns. A picture shows every extreme of it."""

Point = tuple[float, ...]


class Envelope:
    """Points of which the extremes of every coordinate but the first, the time, are kept, and the first and last."""

    def __init__(self, coordinates: int = 1) -> None:
        """Begin; `coordinates` is how many values a point has beside its time."""
        self._coordinates = coordinates
        self._kept: dict[int, list[Point]] = {}
        self._width_s = 1e-3
        self._first_s = 0.0

    def add(self, time_s: float, *values: float) -> None:
        """Take a point. Times come nearly in order."""
        number = self._number(time_s)
        point = (time_s, *values)
        held = self._kept.get(number)
        if held is None:
            self._kept[number] = [point] * (2 + 2 * self._coordinates)
            return
        held[1] = point
        for axis in range(1, self._coordinates + 1):
            low = 2 * axis
            if point[axis] < held[low][axis]:
                held[low] = point
            elif point[axis] > held[low + 1][axis]:
                held[low + 1] = point

    def points(self) -> list[Point]:
        """Return what is kept, in order of time."""
        return sorted({point for held in self._kept.values() for point in held})

    def __bool__(self) -> bool:
        """Return whether there is a point."""
        return bool(self._kept)

    def _number(self, time_s: float) -> int:
        """Return the stretch of a time, after making room for it."""
        if not self._kept:
            self._first_s = time_s
        number = int((time_s - self._first_s) // self._width_s)
        while len(self._kept) >= STRETCHES and number not in self._kept:
            old, self._kept, self._width_s = self._kept, {}, 2.0 * self._width_s
            for each, value in old.items():
                half = each // 2
                self._kept[half] = self._merged(self._kept[half], value) if half in self._kept else value
            number //= 2
        return number

    def _merged(self, first: list[Point], second: list[Point]) -> list[Point]:
        """Return first, last, and the extremes of two stretches."""
        found = [min(first[0], second[0]), max(first[1], second[1])]
        for axis in range(1, self._coordinates + 1):
            low = 2 * axis
            found.append(min(first[low], second[low], key=lambda point, axis=axis: point[axis]))  # type: ignore[misc]
            found.append(max(first[low + 1], second[low + 1], key=lambda point, axis=axis: point[axis]))  # type: ignore[misc]
        return found


MOST_CHANGES = 5000
"""Most changes of a state, and most events, that are kept: more would be no picture any more."""

MANIFOLD = "manifold"


@dataclass
class Changes:
    """Values of something that holds until it changes, each with the time from which it holds."""

    kept: list[tuple[float, Any]] = field(default_factory=list)
    is_cut: bool = False

    def add(self, time_s: float, value: Hashable) -> None:
        """Take a value."""
        if self.kept and self.kept[-1][1] == value:
            return
        if len(self.kept) < MOST_CHANGES:
            self.kept.append((time_s, value))
        else:
            self.is_cut = True


@dataclass
class Pressure:
    """Absolute pressure, Pa, and what its sensor reads at ambient pressure: its mean before it is first evacuated."""

    readings: Envelope = field(default_factory=Envelope)
    is_evacuated: bool = False
    _sum_pa: float = 0.0
    _count: int = 0

    def add(self, time_s: float, pressure_pa: float) -> None:
        """Take a reading."""
        self.readings.add(time_s, pressure_pa)
        if not self.is_evacuated:
            self._sum_pa += pressure_pa
            self._count += 1

    @property
    def ambient_pa(self) -> float:
        """Reading at ambient pressure; the standard atmosphere where it was evacuated from the start."""
        return self._sum_pa / self._count if self._count else STANDARD_ATMOSPHERE_PA


@dataclass
class Loop:
    """Force over length, and the work that the force did in all, N m."""

    path: Envelope = field(default_factory=lambda: Envelope(2))
    force: Envelope = field(default_factory=Envelope)
    work_j: float = 0.0
    _last: tuple[float, float] | None = None

    def add(self, time_s: float, length_m: float, force_n: float) -> None:
        """Take a pair."""
        if self._last is not None:
            self.work_j += (length_m - self._last[0]) * (force_n + self._last[1]) / 2.0
        self._last = (length_m, force_n)
        self.path.add(time_s, length_m, force_n)
        self.force.add(time_s, force_n)


class RunSamples:
    """Takes the messages of one ankle. Times are s since the start of the bag."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.pressures: dict[str, Pressure] = defaultdict(Pressure)
        self.set_points: dict[str, Changes] = defaultdict(Changes)
        self.states: dict[str, Changes] = defaultdict(Changes)
        self.solenoids: dict[str, Changes] = defaultdict(Changes)
        self.duty = Envelope()
        self.force: dict[str, Envelope] = defaultdict(Envelope)
        self.turning: dict[str, Envelope] = defaultdict(Envelope)
        self.tendons: dict[str, Loop] = defaultdict(Loop)
        self.cell = Loop()
        self.events = Changes()
        self._carriage_m: float | None = None
        self.takers: dict[str, Callable[[float, Any], None]] = {
            IMU.name: self._take_imu,
            PUMP_DUTY.name: self._take_duty,
            JAM_STATE.name: self._take_jam_state,
            TENDON_STATES.name: self._take_tendons,
            LOAD_CELL.name: self._take_cell,
            JOINT_STATES.name: self._take_joints,
            CONTACT_EVENTS.name: self._take_event,
            MANIFOLD_PRESSURE.name: self._pressure_taker(MANIFOLD),
            **{PRESSURES[channel].name: self._pressure_taker(channel) for channel in CHANNELS},
            **{SOLENOIDS[channel].name: self._solenoid_taker(channel) for channel in CHANNELS},
        }
        """By the relative name of the topic."""

    def _take_imu(self, time_s: float, message: Any) -> None:
        for axis in "xyz":
            self.force[axis].add(time_s, getattr(message.linear_acceleration, axis))
            self.turning[axis].add(time_s, getattr(message.angular_velocity, axis))

    def _take_duty(self, time_s: float, message: Any) -> None:
        self.duty.add(time_s, message.data)
        self.pressures[MANIFOLD].is_evacuated |= message.data > 0.0

    def _take_jam_state(self, time_s: float, message: Any) -> None:
        for channel in message.channels:
            self.states[channel.channel].add(time_s, _word(channel, channel.state))
            self.set_points[channel.channel].add(time_s, channel.commanded_vacuum_pa)

    def _take_tendons(self, time_s: float, message: Any) -> None:
        for tendon in message.tendons:
            self.tendons[tendon.name].add(time_s, tendon.extension_m, tendon.tension_n)

    def _take_cell(self, time_s: float, message: Any) -> None:
        if self._carriage_m is not None:
            self.cell.add(time_s, self._carriage_m, message.wrench.force.z)

    def _take_joints(self, _time_s: float, message: Any) -> None:
        if CARRIAGE_JOINT in message.name and len(message.position) == len(message.name):
            self._carriage_m = float(message.position[message.name.index(CARRIAGE_JOINT)])

    def _take_event(self, time_s: float, message: Any) -> None:
        self.events.add(time_s, (_word(message, message.type), time_s))

    def _pressure_taker(self, place: str) -> Callable[[float, Any], None]:
        def take(time_s: float, message: Any) -> None:
            if math.isfinite(message.fluid_pressure):
                self.pressures[place].add(time_s, message.fluid_pressure)

        return take

    def _solenoid_taker(self, channel: str) -> Callable[[float, Any], None]:
        def take(time_s: float, message: Any) -> None:
            self.solenoids[channel].add(time_s, bool(message.data))
            self.pressures[channel].is_evacuated |= bool(message.data)

        return take


def _word(message: Any, value: int) -> str:
    """Return the constant of a definition in the bag that has a value."""
    kind = type(message)
    return next((name for name in dir(kind) if name.isupper() and getattr(kind, name) == value), str(value))
