"""A bag of one ankle as the page plays it back: everything by time, counted from the first stamp."""

from __future__ import annotations

import bisect
import dataclasses
import math
from array import array
from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from jammkle_common import names
from jammkle_common.bags.reading import name_of, namespaces_in, opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.command.errors import InputError
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_view.core.ankle import FORCE, RATE, AnkleState
from jammkle_view.core.samples import (
    TAKERS,
    Base,
    Channel,
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
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_view.core.samples import Sample

Timed = TypeVar("Timed", JamReport, Event, Landing)

IMU_SIGNALS = (*FORCE.signals.values(), *RATE.signals.values())

_LEAST_VACUUM_PA = 0.1 * STANDARD_ATMOSPHERE_PA
"""From which on a channel is taken to be jammed, where no driver says more."""
_HIGHEST_PA = 70e3
"""Largest reading from which on a channel counts as vented once: the atmosphere at 3000 m. Below it has been jammed all
the time, and is counted from the standard atmosphere."""
_HELD_S = 0.5
"""For how long a pressure holds after its last reading, s. Chosen: fifty readings, as not all topics end at once."""
_SHORTEST_S = 1e-3
"""Duration of a bag that holds one sample."""


@dataclass(frozen=True)
class Track:
    """Signals over time."""

    time_s: NDArray[np.float64]
    """Rising, shape (n,), s."""
    columns: Mapping[str, NDArray[np.float64]]
    """By name, each of shape (n,)."""

    def at(self, time_s: float) -> dict[str, float]:
        """Return every signal at a time, between samples on a straight line; nothing of an empty track."""
        if not len(self.time_s):
            return {}
        return {name: float(np.interp(time_s, self.time_s, values)) for name, values in self.columns.items()}

    def covers(self, time_s: float) -> bool:
        """Return whether a time lies between the first and the last sample."""
        return bool(len(self.time_s)) and bool(self.time_s[0] <= time_s <= self.time_s[-1])

    def apart(self, names: Iterable[str]) -> dict[str, Track]:
        """Return a track for each of some signals that it has, by name."""
        return {name: Track(self.time_s, {name: self.columns[name]}) for name in names if name in self.columns}


NOTHING = Track(np.zeros(0), {})

Curve = tuple["NDArray[np.float64]", "NDArray[np.float64]"]
"""Times, rising, s, and values, both of shape (n,)."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What an ankle did and what its sensors read, measured or simulated. Times count from the recording's start."""

    joints: Track
    tensions_n: Track
    readings: Mapping[str, Track]
    """By signal, as the diagnosis names it; each track has one column of the same name."""
    base: Track = NOTHING
    """Of the whole robot: columns x, y, z, m, and the quaternion qw, qx, qy, qz; empty where nothing says."""

    @cached_property
    def signals(self) -> dict[str, Curve]:
        """Everything that is compared or drawn, SI, by the names of the diagnosis."""
        found = {name: (track.time_s, track.columns[name]) for name, track in self.readings.items()}
        for track, what in ((self.joints, "position"), (self.tensions_n, "tension")):
            found |= {f"{name}/{what}": (track.time_s, values) for name, values in track.columns.items()}
        return found

    def base_at(self, time_s: float) -> Base | None:
        """Return where the robot is at a time, s; None where nothing says."""
        at = self.base.at(time_s)
        if not at:
            return None
        return Base(time_s, (at["x"], at["y"], at["z"]), (at["qw"], at["qx"], at["qy"], at["qz"]))


@dataclass(frozen=True, kw_only=True)
class Recorded(Motion):
    """What a bag holds of one ankle. Times count from `start_s`."""

    name: str
    namespace: str
    start_s: float
    """First stamp of a measurement, s."""
    duration_s: float
    others: Mapping[str, Track]
    """Joints of the robot's other ankles, by their names below its namespace."""
    broken: Mapping[str, float]
    """When a tendon was first seen broken, s, by name."""
    extensions_m: Track
    """Of tendons, beyond the free length."""
    landings: Sequence[Landing]
    reports: Sequence[JamReport]
    events: Sequence[Event]
    description: str

    def state_at(self, time_s: float) -> AnkleState:
        """Return what the ankle looked like at a time, s; where no driver reported, channels are by their pressure."""
        report = _latest(self.reports, time_s)
        channels = {channel: self._by_pressure(channel, time_s) for channel in names.CHANNELS}
        return AnkleState(
            joints=self.joints.at(time_s),
            tensions_n=self.tensions_n.at(time_s),
            broken=frozenset(tendon for tendon, broken_s in self.broken.items() if broken_s <= time_s),
            channels={**channels, **(report.channels if report is not None else {})},
            base=self.base_at(time_s),
            extensions_m=self.extensions_m.at(time_s),
            landing=_latest(self.landings, time_s),
        )

    def _by_pressure(self, channel: str, time_s: float) -> Channel:
        topic = names.PRESSURES[channel].name
        track = self.readings.get(topic)
        if track is None or not (track.covers(time_s) or track.covers(time_s - _HELD_S)):
            return Channel(ChannelState.UNKNOWN, math.nan, math.nan, "nobody measured its pressure")
        # No reading is above the atmosphere: of a channel that was ever vented the largest one is it.
        largest_pa = float(np.nanmax(track.columns[topic]))
        is_in_mountains = _HIGHEST_PA <= largest_pa < STANDARD_ATMOSPHERE_PA
        vacuum_pa = (largest_pa if is_in_mountains else STANDARD_ATMOSPHERE_PA) - track.at(time_s)[topic]
        jams = vacuum_pa > _LEAST_VACUUM_PA
        return Channel(
            ChannelState.JAMMED if jams else ChannelState.UNJAMMED, math.nan, max(vacuum_pa, 0.0), "by its pressure"
        )


def _latest(samples: Sequence[Timed], time_s: float) -> Timed | None:
    """Return the last sample up to a time, s, of those in rising time."""
    place = bisect.bisect_right(samples, time_s, key=lambda each: each.time_s)
    return samples[place - 1] if place else None


def read_recorded(path: Path, namespace: str | None, on_progress: Callable[[float], None]) -> Recorded:
    """Read what a bag holds of the ankle in a namespace; None: of the only one. Tell the share that was read, 0 to 1.

    Raises:
        InputError: no bag, no ankle in it, several ankles and no namespace, or nothing that was measured.

    """
    collected = Collected()
    with opened(path) as reader:
        chosen = reader.chosen_namespace(namespace)
        takers = _takers(collected, chosen, reader.topics)
        wanted = reader.on(takers)
        total = max(sum(each.msgcount for each in wanted), 1)
        for count, (connection, _, _, data) in enumerate(BagTimes(reader).messages(wanted)):
            takers[connection.topic](reader.deserialize(data, connection.msgtype))
            if count % 1000 == 0:
                on_progress(count / total)
    return collected.recorded(name_of(path), chosen)


def _takers(collected: Collected, chosen: str, present: Collection[str]) -> dict[str, Callable[[Any], None]]:
    """Return what takes the messages of each topic: the ankle's own, its robot's, and the joints of its others."""
    above = chosen.rpartition("/")[0]
    takers: dict[str, Callable[[Any], None]] = {}
    for other in namespaces_in(present):
        parent, _, ankle = other.rpartition("/")
        if parent == above and ankle and other != chosen:
            takers[f"{other}/{names.JOINT_STATES.name}"] = partial(collected.take_other, ankle)
    own = chosen.rstrip("/")
    of_ankle = {f"{own}/{name}": take for name, take in TAKERS.items()}
    of_robot = {
        f"{above}/{topic.name}": TAKERS[topic.name]
        for topic in names.OF_THE_WHOLE
        if topic.name in TAKERS and f"{own}/{topic.name}" not in present
    }
    for topic, make in {**of_robot, **of_ankle}.items():
        takers[topic] = lambda message, make=make: collected.take(make(message))  # type: ignore[misc]
    return takers


class Rows:
    """Samples of some signals as they come, eight bytes a number: a recording may be long."""

    def __init__(self) -> None:
        """Begin without a sample."""
        self.time_s = array("d")
        self._columns: dict[str, array[float]] = {}
        self._latest: dict[str, tuple[float, float]] = {}

    def append(self, time_s: float, row: Mapping[str, float]) -> None:
        """Add a sample; a signal that a row does not have is not a number there."""
        for name in row.keys() - self._columns.keys():
            self._columns[name] = array("d", [math.nan]) * len(self.time_s)
        self.time_s.append(time_s)
        for name, values in self._columns.items():
            values.append(row.get(name, math.nan))

    def append_part(self, time_s: float, row: Mapping[str, float]) -> None:
        """Add a sample of one of several publishers: what it lacks is as the others have just said."""
        lately = {name: value for name, (at_s, value) in self._latest.items() if 0.0 <= time_s - at_s < _HELD_S}
        self.append(time_s, {**lately, **row})
        self._latest |= {name: (time_s, value) for name, value in row.items()}

    def last(self) -> dict[str, float] | None:
        """Return the latest row; None where there is none."""
        return {name: values[-1] for name, values in self._columns.items()} if self.time_s else None

    def track(self, start_s: float) -> Track:
        """Return the samples in rising time since a start, the last of those of one time."""
        if not self.time_s:
            return NOTHING
        time_s, from_end = np.unique(np.asarray(self.time_s)[::-1] - start_s, return_index=True)
        order = len(self.time_s) - 1 - from_end
        return Track(time_s, {name: np.asarray(values)[order] for name, values in sorted(self._columns.items())})


class Collected:
    """Collects samples of one ankle and its robot, recorded or simulated."""

    def __init__(self) -> None:
        """Begin without a sample."""
        self._joints, self._base, self._imu = Rows(), Rows(), Rows()
        self._tensions_n, self._extensions_m = Rows(), Rows()
        self._pressures_pa: dict[str, Rows] = defaultdict(Rows)
        self._others: dict[str, Rows] = defaultdict(Rows)
        self._broken: dict[str, float] = {}
        self._landings: list[Landing] = []
        self._reports: list[JamReport] = []
        self._events: list[Event] = []
        self._description = ""

    def take_other(self, ankle: str, message: Any) -> None:
        """Take joints of another ankle of the robot."""
        sample = TAKERS[names.JOINT_STATES.name](message)
        if isinstance(sample, Joints):
            self._others[ankle].append_part(sample.time_s, sample.positions)

    def take(self, sample: Sample) -> None:
        """Take a sample of the ankle, or of its robot."""
        match sample:
            case Base():
                self._base.append(sample.time_s, _base_row(sample, self._base.last()))
            case Joints():
                self._joints.append_part(sample.time_s, sample.positions)
            case Tendons():
                self._tensions_n.append(sample.time_s, sample.tensions_n)
                self._extensions_m.append(sample.time_s, sample.extensions_m)
                self._broken = {**dict.fromkeys(sample.broken, sample.time_s), **self._broken}
            case Pressure():
                self._pressures_pa[sample.topic].append(sample.time_s, {sample.topic: sample.pressure_pa})
            case Imu():
                values = (*sample.specific_force_m_s2, *sample.angular_velocity_rad_s)
                self._imu.append(sample.time_s, dict(zip(IMU_SIGNALS, values, strict=True)))
            case JamReport():
                self._reports.append(sample)
            case Event():
                self._events.append(sample)
            case Landing():
                self._landings.append(sample)
            case Description():
                self._description = sample.text

    def motion(self, start_s: float) -> dict[str, Any]:
        """Return the fields of a Motion whose times count from a start, s."""
        readings = {topic: rows.track(start_s) for topic, rows in self._pressures_pa.items()}
        return {
            "joints": self._joints.track(start_s),
            "tensions_n": self._tensions_n.track(start_s),
            "readings": readings | self._imu.track(start_s).apart(IMU_SIGNALS),
            "base": self._base.track(start_s),
        }

    def recorded(self, name: str, namespace: str) -> Recorded:
        """Put all of it in order.

        Raises:
            InputError: nothing was measured.

        """
        measured = (self._joints, self._tensions_n, self._imu, *self._pressures_pa.values())
        times_s = [np.asarray(rows.time_s) for rows in measured if rows.time_s]
        if not times_s:
            msg = f"bag {name} holds nothing that was measured in namespace {namespace}"
            raise InputError(msg)
        start_s, end_s = min(float(each.min()) for each in times_s), max(float(each.max()) for each in times_s)
        return Recorded(
            name=name,
            namespace=namespace,
            start_s=start_s,
            duration_s=max(end_s - start_s, _SHORTEST_S),
            **self.motion(start_s),
            others={ankle: rows.track(start_s) for ankle, rows in self._others.items()},
            broken={tendon: time_s - start_s for tendon, time_s in self._broken.items()},
            extensions_m=self._extensions_m.track(start_s),
            landings=_since(start_s, self._landings),
            reports=_since(start_s, self._reports),
            events=_since(start_s, self._events),
            description=self._description,
        )


def _since(start_s: float, samples: Sequence[Timed]) -> list[Timed]:
    """Return samples with times that count from a start, in rising time."""
    moved = (dataclasses.replace(each, time_s=each.time_s - start_s) for each in samples)
    return sorted(moved, key=lambda each: each.time_s)


def _base_row(base: Base, before: Mapping[str, float] | None) -> dict[str, float]:
    """Return a row of the track; of the two quaternions of a turn the one that is next to the row before."""
    turn = dict(zip(("qw", "qx", "qy", "qz"), base.rotation, strict=True))
    if before is not None and sum(before[name] * value for name, value in turn.items()) < 0.0:
        turn = {name: -value for name, value in turn.items()}
    return {**dict(zip("xyz", base.position_m, strict=True)), **turn}
