"""A recorded landing: its bag as time series, and what happened in it in numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jammkle_common.bags.reading import namespaces_in, opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.command.errors import InputError
from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_ATMOSPHERE_PA, STANDARD_GRAVITY_M_S2
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

REACHED_FRACTION = 0.95
"""A channel has reached its vacuum at this part of the command. Chosen: the driver's tolerance is of that order."""

TOUCH_DOWN_FORCE_N = 2.0
"""Push on the load cell that counts as touch-down: 40 times the noise of 0.05 N rms that the simulated
cell has (SensorParameters of jammkle_sim). Chosen."""

PEAK_DEFINITION = (
    f"largest linear_acceleration.z of the IMU minus {STANDARD_GRAVITY_M_S2} m/s^2 (net, upward) from touch-down on"
)


@dataclass(frozen=True)
class ChannelSummary:
    """One channel. Times are s after the start of the bag; None: did not happen, or is not in the bag.

    Attributes:
        channel: Its name.
        energised_s: First time its solenoid was energised.
        commanded_vacuum_pa: Largest vacuum asked for, gauge, positive.
        reached_s: First time the measured vacuum was 95 % of that, after the solenoid was energised.
        greatest_vacuum_pa: Largest vacuum measured, gauge, positive.

    """

    channel: str
    energised_s: float | None
    commanded_vacuum_pa: float | None
    reached_s: float | None
    greatest_vacuum_pa: float | None


@dataclass(frozen=True)
class RunSummary:
    """A landing in numbers. Times are s after the start of the bag; None: did not happen, or is not in the bag.

    Attributes:
        bag: Path of the bag.
        namespace: Where its ankle stood.
        duration_s: Length of the bag.
        touch_down_s: First push on the load cell beyond 2 N after it did not push.
        detected_s: Stamp of the IMU sample with which the controller detected the impact.
        detection_delay_s: Between the first sample of the impact and that one, as the controller says.
        peak_deceleration_m_s2: See PEAK_DEFINITION.
        channels: One entry per channel.
        missing: What the bag does not hold, and what could not be said for that.

    """

    bag: str
    namespace: str
    duration_s: float
    touch_down_s: float | None
    detected_s: float | None
    detection_delay_s: float | None
    peak_deceleration_m_s2: float | None
    channels: tuple[ChannelSummary, ...]
    missing: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON."""
        return {**asdict(self), "peak_deceleration_definition": PEAK_DEFINITION}


def summarise(path: Path, namespace: str | None = None) -> RunSummary:
    """Read a bag and say what happened.

    Raises:
        InputError: the bag cannot be read, or holds nothing of an ankle.

    """
    return summary_of(read_run(path, namespace), str(path))


def summary_of(run: RunSeries, bag: str) -> RunSummary:
    """Say what happened in a run that was read before."""
    missing: list[str] = []
    touch_down_s = None
    if run.load_cell_z is None:
        missing.append(f"{LOAD_CELL.name}: no touch-down")
    else:
        pushes = run.load_cell_z.values < -TOUCH_DOWN_FORCE_N
        touch_down_s = _first_time(run.load_cell_z, pushes & np.maximum.accumulate(~pushes))
    impact = next((event for event in run.events if event.name == "IMPACT"), None)
    if not run.events:
        missing.append(f"{CONTACT_EVENTS.name}: no detection")
    peak = None
    if run.imu_z is None:
        missing.append(f"{IMU.name}: no peak deceleration")
    else:
        after = run.imu_z.values[run.imu_z.time_s >= (touch_down_s if touch_down_s is not None else -np.inf)]
        peak = float(after.max()) - STANDARD_GRAVITY_M_S2 if len(after) else None
    return RunSummary(
        bag=bag,
        namespace=run.namespace,
        duration_s=run.duration_s,
        touch_down_s=touch_down_s,
        detected_s=impact.time_s if impact else None,
        detection_delay_s=impact.detection_delay_s if impact else None,
        peak_deceleration_m_s2=peak,
        channels=tuple(_channel(run, channel, missing) for channel in CHANNELS),
        missing=tuple(missing),
    )


def ambient_pressure_pa(run: RunSeries, channel: str) -> float | None:
    """Return the ambient pressure that a channel's own sensor shows: its median before it is first evacuated.

    None if the channel has no samples before that; a sensor's offset drops out of the vacuum in this way.
    """
    pressure = run.pressures.get(channel)
    if pressure is None:
        return None
    energised_s = _energised_s(run, channel)
    before = pressure.values if energised_s is None else pressure.values[pressure.time_s < energised_s]
    return float(np.median(before)) if len(before) else None


def vacuum_pa(run: RunSeries, channel: str) -> Array | None:
    """Return a channel's measured vacuum over the times of its pressure, gauge, positive, or None if not measured."""
    pressure = run.pressures.get(channel)
    if pressure is None:
        return None
    ambient = ambient_pressure_pa(run, channel)
    vacuum: Array = (STANDARD_ATMOSPHERE_PA if ambient is None else ambient) - pressure.values
    return vacuum


def _channel(run: RunSeries, channel: str, missing: list[str]) -> ChannelSummary:
    if channel not in run.solenoids:
        missing.append(f"{SOLENOIDS[channel].name}: not known when it was energised")
    commanded = run.commanded_vacuum.get(channel)
    if commanded is None:
        missing.append(f"vacuum commanded of {channel} (neither jam_state nor jam_command): no time of reaching it")
    vacuum = vacuum_pa(run, channel)
    if vacuum is None:
        missing.append(f"{PRESSURES[channel].name}: not known when it reached its vacuum")
    elif ambient_pressure_pa(run, channel) is None:
        missing.append(
            f"{PRESSURES[channel].name} before the channel was evacuated: "
            f"ambient taken as {STANDARD_ATMOSPHERE_PA:.0f} Pa"
        )
    energised_s = _energised_s(run, channel)
    wanted_pa = float(commanded.values.max()) if commanded is not None else None
    reached_s = None
    if vacuum is not None and wanted_pa:
        series = run.pressures[channel]
        reached = vacuum >= REACHED_FRACTION * wanted_pa
        if energised_s is not None:
            reached &= series.time_s >= energised_s
        reached_s = _first_time(series, reached)
    return ChannelSummary(
        channel=channel,
        energised_s=energised_s,
        commanded_vacuum_pa=wanted_pa,
        reached_s=reached_s,
        greatest_vacuum_pa=float(vacuum.max()) if vacuum is not None else None,
    )


def _energised_s(run: RunSeries, channel: str) -> float | None:
    solenoid = run.solenoids.get(channel)
    return None if solenoid is None else _first_time(solenoid, solenoid.values > 0)


def _first_time(series: Series, condition: np.ndarray[Any, np.dtype[np.bool_]]) -> float | None:
    """Return the time of the first sample that meets a condition."""
    where = np.flatnonzero(condition)
    return float(series.time_s[where[0]]) if len(where) else None


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
        # jam_state says what the driver took as its command; without it, the controller's request is the next best.
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
