"""Follows a robot with a simulated twin, subsystem by subsystem, in portions that its caller asks for."""

from __future__ import annotations

import enum
import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.inputs import FALLING_RIGS, AnkleInputs, nominal_rig
from jammkle_gap.monitor.followers import (
    AirFollower,
    BodyFollower,
    SensingFollower,
    Stretch,
    TendonFollower,
    Track,
    Tracks,
)
from jammkle_sim.rigs.replay import CommandTrack, Timeline, timestep_s
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_gap.ankle.inputs import Options
    from jammkle_gap.monitor.followers import Follower
    from jammkle_gap.monitor.parameters import GapMonitorParameters


@dataclass(frozen=True)
class Worst:
    """The signal that is off most."""

    signal: str
    gap: float
    """Root mean square of measured less simulated over the window, noise units."""
    phase: str
    """In which most of its squares lie."""


STRETCH_S = 0.1
"""How long the bodies go on from a measured state, and what is simulated at a time. Assumed: a wrong mass or friction
shows within; noise has not grown yet."""
_LATE_S = 0.05
"""How far the twin stays behind the newest sample, so that slower topics and commands have come. Assumed: five samples
of a pressure."""
_MEMORY_S = 1.0
"""How much is kept before the stretch that is simulated: commands that act late, and speeds."""
_COMMANDS = (names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values()))


class GapState(enum.Enum):
    """What is known of the gap of a subsystem."""

    WAITING = "waiting"
    """Its inputs come in, and nothing could be compared yet."""
    CLOSE = "close"
    """Robot and simulator agree."""
    WIDE = "wide"
    """The robot has left its simulator."""
    STALE = "stale"
    """Inputs are missing."""


@dataclass(frozen=True)
class SubsystemReport:
    """One subsystem now."""

    name: str
    state: GapState
    worst: Worst | None
    """None before anything was compared, and without inputs."""
    gaps: Mapping[str, float] = field(default_factory=dict)
    """By signal, noise units."""
    missing: tuple[str, ...] = ()
    """Topics without which it cannot be followed."""


class GapMonitor:
    """The twin of one robot. Samples in at any time; `advance` simulates what is due."""

    def __init__(self, rig: str, options: Options, parameters: GapMonitorParameters) -> None:
        """Build the twin.

        Args:
            rig: What the robot stands in: a name of `rigs.catalogue`.
            options: How it is set; see `inputs.known_options`.
            parameters: How the gap is judged; its `rig` does not count.

        Raises:
            BadRecordingError: there is no such rig.

        """
        nothing = Timeline(np.zeros(0), np.zeros(0))
        built = nominal_rig(AnkleInputs(rig, options, CommandTrack(nothing, {})))
        self._step_s = timestep_s(built)
        self._parameters = parameters
        self._tracks: Tracks = Tracks(Track)
        self._received_s: dict[str, float] = {}
        self._acknowledged = False
        self._air = AirFollower(built, parameters.command_jitter_s)
        followers: list[Follower] = [self._air, TendonFollower(built)]
        if rig in FALLING_RIGS:
            followers.append(BodyFollower(built))
        followers.append(SensingFollower(built))
        self._parts = [_Part(each, parameters) for each in followers]

    def take(self, topic: str, time_s: float, values: Mapping[str, float], now_s: float) -> None:
        """Take a sample; a command is left out once the hardware tells of its commands by itself.

        Args:
            topic: Its relative name.
            time_s: When it was measured or commanded, on the robot's clock.
            values: By column, as in the diagnosis of recordings.
            now_s: Now: simulated time, or the machine's steady clock.

        """
        if not (self._acknowledged and topic in _COMMANDS):
            self._take(topic, time_s, values, now_s)

    def take_acknowledged(self, time_s: float, commands: Mapping[str, float], now_s: float) -> None:
        """Take the commands that the hardware has acknowledged.

        Args:
            time_s: Since when, or until when at least, on the robot's clock.
            commands: By the topic of the command; all of them.
            now_s: As above.

        """
        if not self._acknowledged:
            self._acknowledged = True
            self._air.trust_commands()
            self._forget()
        for topic, value in commands.items():
            self._take(topic, time_s, {"data": value}, now_s)

    def _take(self, topic: str, time_s: float, values: Mapping[str, float], now_s: float) -> None:
        self._received_s[topic] = now_s
        if time_s < self._tracks[topic].last_s - _MEMORY_S:  # the clock was set back: a new run
            self._forget()
        self._tracks[topic].add(time_s, values)

    def advance(self, now_s: float) -> bool:
        """Simulate one stretch of one subsystem, the one that is furthest behind.

        Returns:
            Whether there was one to simulate.

        """
        for part in self._parts:
            if part.started and self._missing(part, now_s):
                part.stop()
        due = [part for part in self._parts if not self._missing(part, now_s) and self._is_due(part)]
        if not due:
            return False
        part = min(due, key=lambda each: each.time_s if each.started else -float("inf"))
        newest_s = self._newest_s(part)
        # A part that has fallen behind by more than the window begins anew: old news help nobody.
        if not part.started or part.time_s < newest_s - self._parameters.window_s - STRETCH_S:
            part.start(self._tracks, newest_s)
            return True
        stretch = Stretch(part.time_s, part.time_s + round(STRETCH_S / self._step_s) * self._step_s)
        part.follow(self._tracks, stretch)
        oldest_s = min(each.time_s for each in self._parts if each.started) - _MEMORY_S
        for track in self._tracks.values():
            track.forget_before(oldest_s)
        return True

    def reports(self, now_s: float) -> list[SubsystemReport]:
        """Return what is known of every subsystem."""
        return [self._report(part, now_s) for part in self._parts]

    def _report(self, part: _Part, now_s: float) -> SubsystemReport:
        name, missing = part.follower.subsystem, self._missing(part, now_s)
        if missing:
            return SubsystemReport(name, GapState.STALE, None, missing=missing)
        worst = part.worst()
        if worst is None:
            return SubsystemReport(name, GapState.WAITING, None)
        state = GapState.WIDE if part.wide_s >= self._parameters.hold_s else GapState.CLOSE
        return SubsystemReport(name, state, worst, part.gaps())

    def _missing(self, part: _Part, now_s: float) -> tuple[str, ...]:
        """Return the topics of which nothing came lately; a command that is not repeated holds until the next one."""
        return tuple(
            topic
            for topic in part.follower.inputs
            if topic not in self._received_s
            or (self._is_stream(topic) and self._received_s[topic] < now_s - self._parameters.input_timeout_s)
        )

    def _newest_s(self, part: _Part) -> float:
        streams = [topic for topic in part.follower.inputs if self._is_stream(topic)]
        return min(self._tracks[topic].last_s for topic in streams) - _LATE_S

    def _is_stream(self, topic: str) -> bool:
        """Tell whether a topic says by its silence that something is wrong."""
        return self._acknowledged or topic not in _COMMANDS

    def _is_due(self, part: _Part) -> bool:
        newest_s = self._newest_s(part)
        if part.started:
            return newest_s >= part.time_s + STRETCH_S
        return newest_s >= max(self._tracks[topic].first_s for topic in part.follower.inputs)

    def _forget(self) -> None:
        self._tracks = Tracks(Track)
        for part in self._parts:
            part.stop()


class _Part:
    """One subsystem: how far it has been followed, and the squares of its residuals in the window until then."""

    def __init__(self, follower: Follower, parameters: GapMonitorParameters) -> None:
        self.follower = follower
        self._parameters = parameters
        self.started = False
        self.time_s = 0.0
        self._close_s = 0.0
        self._squares: deque[tuple[float, str, str, float, int]] = deque()
        """By stretch and signal: end of the stretch, s, signal, phase, sum of the squares, and of how many samples."""

    @property
    def wide_s(self) -> float:
        """For how long the gap has been above the limit, s."""
        return self.time_s - self._close_s if self.started else 0.0

    def start(self, tracks: Tracks, time_s: float) -> None:
        self.stop()
        self.started, self.time_s, self._close_s = True, time_s, time_s
        self.follower.begin(tracks, time_s)

    def stop(self) -> None:
        self.started = False
        self._squares.clear()

    def follow(self, tracks: Tracks, stretch: Stretch) -> None:
        try:
            residuals = self.follower.follow(tracks, stretch)
        except UnstableSimulationError:  # from a state that is none; the next one may be
            residuals = []
        self.time_s = stretch.end_s
        for each in residuals:
            squares = float(np.sum(each.scaled**2))
            self._squares.append((self.time_s, each.signal, each.phase, squares, len(each.scaled)))
        while self._squares and self._squares[0][0] <= self.time_s - self._parameters.window_s:
            self._squares.popleft()
        worst = self.worst()
        if worst is None or worst.gap <= self._parameters.limit:
            self._close_s = self.time_s

    def gaps(self) -> dict[str, float]:
        """Return the gap of every signal that was compared, noise units."""
        sums: dict[str, tuple[float, int]] = {}
        for _, signal, _, squares, count in self._squares:
            before = sums.get(signal, (0.0, 0))
            sums[signal] = (before[0] + squares, before[1] + count)
        return {signal: math.sqrt(squares / count) for signal, (squares, count) in sums.items()}

    def worst(self) -> Worst | None:
        """Return the signal that is off most; None if nothing was compared."""
        gaps = self.gaps()
        if not gaps:
            return None
        name = max(gaps, key=lambda signal: gaps[signal])
        phases: dict[str, float] = {}
        for _, signal, phase, squares, _ in self._squares:
            if signal == name:
                phases[phase] = phases.get(phase, 0.0) + squares
        return Worst(name, gaps[name], max(phases, key=lambda phase: phases[phase]))
