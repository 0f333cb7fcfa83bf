"""What is known of one ankle: the latest of everything, and the last seconds of what is plotted."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from jammkle_common import names
from jammkle_view.core.samples import (
    Base,
    ChannelState,
    Description,
    Event,
    Imu,
    JamReport,
    Joints,
    Pressure,
    Tendons,
)
from jammkle_view.core.trace import Trace

if TYPE_CHECKING:
    from jammkle_view.core.samples import Channel, Sample

SPAN_S = 10.0
"""Time that a plot shows."""
_FASTEST_HZ = 1000.0
_EVENTS = 50

PRESSURE_LINES: tuple[str, ...] = (*names.CHANNELS, "manifold")
IMU_LINES: tuple[str, ...] = ("x", "y", "z")
TENSION_LINES: tuple[str, ...] = names.TENDONS
_PRESSURE_TOPICS = (*(names.PRESSURES[channel].name for channel in names.CHANNELS), names.MANIFOLD_PRESSURE.name)
_CHANNEL_OF_TENDON = {tendon: channel for channel, tendons in names.TENDONS_OF_CHANNEL.items() for tendon in tendons}


class Ankle:
    """One ankle as heard so far. `take` gives it whatever comes."""

    def __init__(self) -> None:
        """Know nothing."""
        capacity = round(SPAN_S * _FASTEST_HZ)
        self.time_s = math.nan
        """Latest stamp of a measurement, s."""
        self.joints: dict[str, float] = {}
        self.base: Base | None = None
        """Where the robot is, if somebody tells."""
        self.tensions_n: dict[str, float] = {}
        self.broken: frozenset[str] = frozenset()
        self.channels: dict[str, Channel] = {}
        self.emergency_stopped = False
        self.description = ""
        self.events: deque[Event] = deque(maxlen=_EVENTS)
        self.pressures_pa = Trace(len(PRESSURE_LINES), capacity)
        self.forces_m_s2 = Trace(len(IMU_LINES), capacity)
        self.rates_rad_s = Trace(len(IMU_LINES), capacity)
        self.pulls_n = Trace(len(TENSION_LINES), capacity)
        self._latest_pa = [math.nan] * len(PRESSURE_LINES)
        self._pressures_at_s = math.nan

    def take(self, sample: Sample) -> None:
        """Remember a sample."""
        match sample:
            case Joints():
                self._measured_at(sample.time_s)
                self.joints.update(sample.positions)
            case Tendons():
                self._measured_at(sample.time_s)
                self.tensions_n, self.broken = dict(sample.tensions_n), sample.broken
                self.pulls_n.append(sample.time_s, [self.tensions_n.get(name, math.nan) for name in TENSION_LINES])
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
            case Description():
                self.description = sample.text

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

    def _measured_at(self, time_s: float) -> None:
        if not time_s <= self.time_s or time_s < self.time_s - SPAN_S:  # the robot's time may begin anew
            self.time_s = time_s

    def _take_pressure(self, sample: Pressure) -> None:
        if sample.topic not in _PRESSURE_TOPICS:
            return
        # Whole sets are shown, each once the next one begins: which sensors there are, nobody tells.
        if sample.time_s != self._pressures_at_s:
            if math.isfinite(self._pressures_at_s):
                self.pressures_pa.append(self._pressures_at_s, self._latest_pa)
            self._pressures_at_s = sample.time_s
        self._latest_pa[_PRESSURE_TOPICS.index(sample.topic)] = sample.pressure_pa
