"""What is known of one ankle: the latest of everything, and the last seconds of what is plotted."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_sim.physics.constants import TendonParameters
from jammkle_view.core.samples import (
    Base,
    ChannelState,
    Description,
    Event,
    Imu,
    JamReport,
    Joints,
    Landing,
    Pressure,
    Tendons,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Window = tuple[NDArray[np.float64], NDArray[np.float64]]
    "Times, shape (n,), s, and values, shape (n, signals)."
    from jammkle_view.core.samples import Channel, Sample


class Trace:
    """A ring of samples in rising time. What comes from before the latest one starts it anew."""

    def __init__(self, signals: int, capacity: int) -> None:
        """Make an empty ring of samples with so many values each."""
        self._time_s = np.zeros(capacity)
        self._values = np.zeros((capacity, signals))
        self._next = 0
        self._count = 0

    def append(self, time_s: float, values: Sequence[float]) -> None:
        """Add a sample; one of the same time as the latest is left out."""
        if self._count:
            latest_s = self._time_s[self._next - 1]
            if time_s == latest_s:
                return
            if time_s < latest_s:
                self._next = self._count = 0
        self._time_s[self._next] = time_s
        self._values[self._next] = values
        self._next = (self._next + 1) % len(self._time_s)
        self._count = min(self._count + 1, len(self._time_s))

    def window(self, start_s: float, end_s: float) -> Window:
        """Return the samples from one time to another, both included."""
        order = np.arange(self._next - self._count, self._next)
        time_s, values = self._time_s[order], self._values[order]
        first, last = np.searchsorted(time_s, start_s), np.searchsorted(time_s, end_s, side="right")
        return time_s[first:last], values[first:last]


def thinned(time_s: NDArray[np.float64], values: NDArray[np.float64], bins: int) -> Window:
    """Return at most twice as many samples as there are bins; every peak stays.

    Args:
        time_s: Rising, shape (n,), s.
        values: Shape (n, signals).
        bins: Stretches of equally many samples, of each of which the smallest and the largest values are kept.

    """
    per_bin = len(time_s) // bins
    if per_bin <= 2:  # noqa: PLR2004 - nothing would be saved
        return time_s, values
    whole = len(time_s) // per_bin * per_bin
    parts = values[:whole].reshape(-1, per_bin, values.shape[1])
    extremes = np.stack((parts.min(axis=1), parts.max(axis=1)), axis=1).reshape(-1, values.shape[1])
    half = per_bin // 2
    ends_s = np.stack((time_s[:whole:per_bin], time_s[half:whole:per_bin]), axis=1).ravel()
    return np.concatenate((ends_s, time_s[whole:])), np.concatenate((extremes, values[whole:]))


SPAN_S = 10.0
"""Time that a plot shows."""
_FASTEST_HZ = 1000.0
_EVENTS = 50
_ANEW_S = 1.0
"""By how much stamps must fall for the robot's time to have begun anew, s. Chosen: above what messages come late."""
_SILENT_S = 0.5
"""Age from which a pressure is not shown as measured, s. Chosen: five readings of the slowest sensors, of 10 Hz."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """What one plot shows."""

    title: str
    """With the unit that it is shown in."""
    scale: float
    """What one SI unit is in that."""
    least: float
    """Least height of its scale, in that unit. Chosen: some ten times the noise of the sensor, and of what is simulated
    without noise as much as matters to an ankle."""
    signals: Mapping[str, str]
    """By label in the legend; named as the diagnosis names them."""


PRESSURE = Quantity(
    "Pressure, absolute [kPa]",
    1e-3,
    5.0,
    {**{channel: topic.name for channel, topic in names.PRESSURES.items()}, "manifold": names.MANIFOLD_PRESSURE.name},
)
FORCE = Quantity("Specific force [m/s²]", 1.0, 2.0, {axis: f"imu/specific_force_{axis}" for axis in "xyz"})
RATE = Quantity("Angular rate [rad/s]", 1.0, 0.2, {axis: f"imu/angular_velocity_{axis}" for axis in "xyz"})
PITCH = Quantity("Pitch of the foot, toe down [deg]", math.degrees(1.0), 1.0, {"pitch": "ankle_pitch/position"})
CARRIAGE = Quantity("Carriage [mm]", 1e3, 1.0, {"carriage": f"{names.CARRIAGE_JOINT}/position"})
TENSION = Quantity("Tension [N]", 1.0, 2.0, {tendon: f"{tendon}/tension" for tendon in names.TENDONS})

BREAK_M = TendonParameters().break_extension_m
_PRESSURE_TOPICS = tuple(PRESSURE.signals.values())
_CHANNEL_OF_TENDON = {tendon: channel for channel, tendons in names.TENDONS_OF_CHANNEL.items() for tendon in tendons}


@dataclass
class AnkleState:
    """What one ankle looks like at a time, live or recorded."""

    joints: Mapping[str, float] = field(default_factory=dict)
    """Positions by name, rad or m."""
    tensions_n: Mapping[str, float] = field(default_factory=dict)
    extensions_m: Mapping[str, float] = field(default_factory=dict)
    """Lengths of tendons beyond the free one."""
    broken: frozenset[str] = frozenset()
    """Tendons that are."""
    channels: Mapping[str, Channel] = field(default_factory=dict)
    base: Base | None = None
    """Where the robot is, if somebody publishes it."""
    landing: Landing | None = None
    """The latest."""

    def left_m(self, tendon: str) -> float:
        """Return by how much a tendon can still be stretched, m; NaN where nobody knows.

        What ends it: of the Achilles pair of a foot that hangs toe-down its sole, flat on level ground; else it tears.
        """
        travel_m = 0.0 if self.landing is None else self.landing.travel_m
        most_m = travel_m if travel_m > 0.0 and _CHANNEL_OF_TENDON.get(tendon) == names.ACHILLES else BREAK_M
        return max(most_m - max(self.extensions_m.get(tendon, math.nan), 0.0), 0.0)

    def state_of(self, tendon: str) -> ChannelState:
        """Return the state of the channel that a tendon hangs on."""
        channel = self.channels.get(_CHANNEL_OF_TENDON.get(tendon, ""))
        return ChannelState.UNKNOWN if channel is None else channel.state

    def vacuum_share(self, tendon: str) -> float:
        """Return how far a tendon's channel is evacuated, 0 to 1 of the whole atmosphere; 0 where nobody measures."""
        channel = self.channels.get(_CHANNEL_OF_TENDON.get(tendon, ""))
        if channel is None or math.isnan(channel.measured_vacuum_pa):
            return 0.0
        return min(max(channel.measured_vacuum_pa / 1e5, 0.0), 1.0)


class Ankle(AnkleState):
    """One ankle as received so far. `take` gives it whatever comes."""

    def __init__(self) -> None:
        """Know nothing."""
        super().__init__()
        capacity = round(SPAN_S * _FASTEST_HZ)
        self.time_s = math.nan
        """Latest stamp of a measurement, s."""
        self.emergency_stopped = False
        self.description = ""
        self.events: deque[Event] = deque(maxlen=_EVENTS)
        self.pressures_pa = Trace(len(PRESSURE.signals), capacity)
        self.forces_m_s2 = Trace(len(FORCE.signals), capacity)
        self.rates_rad_s = Trace(len(RATE.signals), capacity)
        self.pulls_n = Trace(len(TENSION.signals), capacity)
        self._latest_pa = [math.nan] * len(PRESSURE.signals)
        self._measured_s = [math.nan] * len(PRESSURE.signals)
        self._pressures_at_s = math.nan

    def take(self, sample: Sample) -> None:
        """Remember a sample."""
        match sample:
            case Joints():
                self._measured_at(sample.time_s)
                self.joints = {**self.joints, **sample.positions}
            case Tendons():
                self._measured_at(sample.time_s)
                self.tensions_n, self.broken = dict(sample.tensions_n), sample.broken
                self.extensions_m = dict(sample.extensions_m)
                self.pulls_n.append(sample.time_s, [self.tensions_n.get(name, math.nan) for name in TENSION.signals])
            case Pressure():
                self._measured_at(sample.time_s)
                self._take_pressure(sample)
            case Imu():
                self._measured_at(sample.time_s)
                self.forces_m_s2.append(sample.time_s, sample.specific_force_m_s2)
                self.rates_rad_s.append(sample.time_s, sample.angular_velocity_rad_s)
            case Base():
                self.base = sample
            case JamReport():
                self.channels, self.emergency_stopped = dict(sample.channels), sample.emergency_stopped
            case Event():
                self.events.append(sample)
            case Landing():
                self.landing = sample
            case Description():
                self.description = sample.text

    def lose_driver(self) -> None:
        """Forget what the driver said of the channels."""
        self.channels = {}

    def _measured_at(self, time_s: float) -> None:
        if not time_s <= self.time_s or time_s < self.time_s - _ANEW_S:  # the robot's time may begin anew
            self.time_s = time_s

    def _take_pressure(self, sample: Pressure) -> None:
        if sample.topic not in _PRESSURE_TOPICS:
            return
        # Whole sets are shown, each once the next one begins: which sensors there are is not known.
        if sample.time_s != self._pressures_at_s:
            if math.isfinite(self._pressures_at_s):
                silent = [abs(self._pressures_at_s - each) > _SILENT_S for each in self._measured_s]
                values = [math.nan if old else each for each, old in zip(self._latest_pa, silent, strict=True)]
                self.pressures_pa.append(self._pressures_at_s, values)
            self._pressures_at_s = sample.time_s
        place = _PRESSURE_TOPICS.index(sample.topic)
        self._latest_pa[place], self._measured_s[place] = sample.pressure_pa, sample.time_s
