"""What a bag of one ankle holds, as time series: read once, for the summary and the picture."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jammkle_common.bags.reading import namespaces_in, opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.command.errors import InputError
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import (
    CARRIAGE_JOINT,
    CHANNELS,
    CONTACT_EVENTS,
    IMU,
    JAM_COMMAND,
    JAM_STATE,
    JOINT_STATES,
    LOAD_CELL,
    MANIFOLD_PRESSURE,
    PRESSURES,
    PUMP_DUTY,
    SOLENOIDS,
    TENDON_STATES,
    TENDONS,
    resolved,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Series:
    """Values over time: `time_s` of shape (n,), s after the start of the bag, increasing; `values` of shape (n,)."""

    time_s: Array
    values: Array

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.time_s)


@dataclass(frozen=True)
class Event:
    """A contact event: stamp of the sample that decided, s after the start of the bag, its name and its sizes."""

    time_s: float
    name: str
    magnitude: float
    unit: str
    detection_delay_s: float


@dataclass(frozen=True)
class RunSeries:
    """Everything a summary or a picture needs of one ankle; what the bag does not hold is missing from the mappings.

    Pressures are absolute, Pa; commanded vacuum is gauge, positive, Pa; heights m; specific force m/s^2; tension N.
    """

    namespace: str
    duration_s: float
    imu_z: Series | None = None
    load_cell_z: Series | None = None
    carriage: Series | None = None
    manifold_pressure: Series | None = None
    pump_duty: Series | None = None
    pressures: dict[str, Series] = field(default_factory=dict)
    solenoids: dict[str, Series] = field(default_factory=dict)
    commanded_vacuum: dict[str, Series] = field(default_factory=dict)
    tensions: dict[str, Series] = field(default_factory=dict)
    events: tuple[Event, ...] = ()


def read_run(path: Path, namespace: str | None = None) -> RunSeries:
    """Read a bag.

    Args:
        path: The bag.
        namespace: Normalised namespace; None takes the only one that is there.

    Raises:
        InputError: unreadable, empty, no topic of an ankle, or several ankles and no namespace.

    """
    with opened(path) as reader:
        if not reader.message_count:
            msg = f"bag {path} holds no messages"
            raise InputError(msg)
        found = namespaces_in(set(reader.topics))
        if namespace is None:
            if len(found) > 1:
                msg = f"bag {path} holds several namespaces ({', '.join(found)}): choose one with --namespace"
                raise InputError(msg)
            namespace = found[0] if found else "/"
        if namespace not in found:
            msg = (
                f"bag {path} holds no topic of an ankle in namespace {namespace}; it has: {', '.join(found) or 'none'}"
            )
            raise InputError(msg)
        times = BagTimes(reader)
        collector, end_ns = _Collector(namespace, times.start_ns), times.start_ns
        for connection, time_ns, _, data in times.messages(reader.on(collector.takers)):
            message: Any = reader.deserialize(data, connection.msgtype)
            collector.takers[connection.topic](message, time_ns)
            end_ns = max(end_ns, time_ns)
        return collector.run((end_ns - times.start_ns) / NANOSECONDS_PER_SECOND)


class _Collector:
    """Collects samples by topic, then sorts them into series."""

    def __init__(self, namespace: str, start_ns: int) -> None:
        self._namespace = namespace
        self._start_ns = start_ns
        self._samples: dict[str, list[tuple[float, float]]] = {}
        self._events: list[Event] = []
        self.takers: dict[str, Callable[[Any, int], None]] = {
            resolved(namespace, IMU.name): self._take_imu,
            resolved(namespace, LOAD_CELL.name): self._take_load_cell,
            resolved(namespace, JOINT_STATES.name): self._take_joints,
            resolved(namespace, MANIFOLD_PRESSURE.name): self._pressure_taker("manifold"),
            resolved(namespace, PUMP_DUTY.name): self._data_taker("duty"),
            resolved(namespace, TENDON_STATES.name): self._take_tendons,
            resolved(namespace, JAM_STATE.name): self._take_jam_state,
            resolved(namespace, JAM_COMMAND.name): self._take_jam_command,
            resolved(namespace, CONTACT_EVENTS.name): self._take_event,
        }
        for channel in CHANNELS:
            self.takers[resolved(namespace, PRESSURES[channel].name)] = self._pressure_taker(f"pressure {channel}")
            self.takers[resolved(namespace, SOLENOIDS[channel].name)] = self._data_taker(f"solenoid {channel}")

    def run(self, duration_s: float) -> RunSeries:
        """Return the series."""
        # jam_state says what the driver took as its command; without it, the controller's wish is the next best.
        commanded = {
            channel: self._series(f"state {channel}") or self._series(f"command {channel}") for channel in CHANNELS
        }
        return RunSeries(
            namespace=self._namespace,
            duration_s=duration_s,
            imu_z=self._series("imu"),
            load_cell_z=self._series("load cell"),
            carriage=self._series("carriage"),
            manifold_pressure=self._series("manifold"),
            pump_duty=self._series("duty"),
            pressures=self._present({channel: f"pressure {channel}" for channel in CHANNELS}),
            solenoids=self._present({channel: f"solenoid {channel}" for channel in CHANNELS}),
            commanded_vacuum={channel: series for channel, series in commanded.items() if series is not None},
            tensions=self._present({tendon: f"tension {tendon}" for tendon in TENDONS}),
            events=tuple(sorted(self._events, key=lambda event: event.time_s)),
        )

    def _present(self, keys: dict[str, str]) -> dict[str, Series]:
        found = {name: self._series(key) for name, key in keys.items()}
        return {name: series for name, series in found.items() if series is not None}

    def _series(self, key: str) -> Series | None:
        samples = self._samples.get(key)
        if not samples:
            return None
        table = np.array(samples, dtype=np.float64)
        table = table[np.argsort(table[:, 0], kind="stable")]
        return Series(table[:, 0], table[:, 1])

    def _add(self, key: str, time_s: float, value: float) -> None:
        self._samples.setdefault(key, []).append((time_s, value))

    def _time_s(self, time_ns: int) -> float:
        return (time_ns - self._start_ns) / NANOSECONDS_PER_SECOND

    def _take_imu(self, message: Any, time_ns: int) -> None:
        self._add("imu", self._time_s(time_ns), message.linear_acceleration.z)

    def _take_load_cell(self, message: Any, time_ns: int) -> None:
        self._add("load cell", self._time_s(time_ns), message.wrench.force.z)

    def _take_joints(self, message: Any, time_ns: int) -> None:
        names = list(message.name)
        if CARRIAGE_JOINT in names and len(message.position) == len(names):
            position = message.position[names.index(CARRIAGE_JOINT)]
            self._add("carriage", self._time_s(time_ns), float(position))

    def _take_tendons(self, message: Any, time_ns: int) -> None:
        for tendon in message.tendons:
            self._add(f"tension {tendon.name}", self._time_s(time_ns), tendon.tension_n)

    def _take_jam_state(self, message: Any, time_ns: int) -> None:
        for channel in message.channels:
            time_s = self._time_s(time_ns)
            self._add(f"state {channel.channel}", time_s, channel.commanded_vacuum_pa)

    def _take_jam_command(self, message: Any, time_ns: int) -> None:
        for channel in message.channels:
            self._add(f"command {channel.channel}", self._time_s(time_ns), channel.vacuum_pa)

    def _take_event(self, message: Any, time_ns: int) -> None:
        self._events.append(
            Event(
                self._time_s(time_ns),
                _constant_name(message, int(message.type)) or f"event {message.type}",
                float(message.magnitude),
                str(message.unit),
                float(message.detection_delay_s),
            )
        )

    def _pressure_taker(self, key: str) -> Callable[[Any, int], None]:
        def take(message: Any, time_ns: int) -> None:
            self._add(key, self._time_s(time_ns), message.fluid_pressure)

        return take

    def _data_taker(self, key: str) -> Callable[[Any, int], None]:
        def take(message: Any, time_ns: int) -> None:
            self._add(key, self._time_s(time_ns), float(message.data))

        return take


def _constant_name(message: Any, value: int) -> str:
    """Return the name that the definition in the bag gives a value, or nothing."""
    kind = type(message)
    return next((name for name in dir(kind) if name.isupper() and getattr(kind, name) == value), "")
