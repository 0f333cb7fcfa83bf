"""A recorded landing: its bag as time series, and what happened in it in numbers."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jammkle_bringup.core.bag_info import constant_name
from jammkle_common.bags.reading import opened
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
    from pathlib import Path

REACHED_FRACTION = 0.95
"""A channel has reached its vacuum at this part of the command. Chosen: the driver's tolerance is of that order."""

TOUCH_DOWN_FORCE_N = 2.0
"""Push on the load cell that counts as touch-down: 40 times the noise of 0.05 N rms that the simulated
cell has (SensorParameters of jammkle_sim). Chosen."""

PEAK_DEFINITION = (
    f"largest linear_acceleration.z of the IMU minus {STANDARD_GRAVITY_M_S2} m/s^2 (net, upward) from touch-down on"
)


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Series:
    """Values over time: `time_s` of shape (n,), s after the start of the bag, increasing; `values` of shape (n,)."""

    time_s: Array
    values: Array


@dataclass(frozen=True)
class Event:
    """A contact event. Its time is the stamp of the sample that decided, s after the start of the bag."""

    time_s: float
    name: str
    detection_delay_s: float


@dataclass(frozen=True)
class RunSeries:
    """Everything a summary or a picture needs of one ankle; what the bag does not hold is missing from the mappings.

    Pressures are absolute, Pa; commanded vacuum is gauge, positive, Pa; heights m; specific force m/s^2; tension N.
    """

    namespace: str
    duration_s: float
    imu_z: Series | None
    load_cell_z: Series | None
    carriage: Series | None
    manifold_pressure: Series | None
    pressures: dict[str, Series]
    solenoids: dict[str, Series]
    commanded_vacuum: dict[str, Series]
    tensions: dict[str, Series]
    events: tuple[Event, ...]


def read_run(path: Path, namespace: str | None = None) -> RunSeries:
    """Read what a bag holds of the ankle in a normalised namespace; None: of the only one.

    Raises:
        InputError: unreadable, empty, no topic of an ankle, or several ankles and no namespace.

    """
    samples: dict[str, list[tuple[float, float]]] = defaultdict(list)
    events, end_s = [], 0.0
    with opened(path) as reader:
        if not reader.message_count:
            msg = f"bag {path} holds no messages"
            raise InputError(msg)
        namespace = reader.chosen_namespace(namespace)
        topics = {resolved(namespace, name): name for name in (CONTACT_EVENTS.name, *_VALUES)}
        times = BagTimes(reader)
        for connection, time_ns, _, data in times.messages(reader.on(topics)):
            time_s, name = (time_ns - times.start_ns) / NANOSECONDS_PER_SECOND, topics[connection.topic]
            message: Any = reader.deserialize(data, connection.msgtype)
            if name == CONTACT_EVENTS.name:
                what = constant_name(message, int(message.type))
                events.append(Event(time_s, what, float(message.detection_delay_s)))
            else:
                for key, value in _VALUES[name](message):
                    samples[key].append((time_s, value))
            end_s = max(end_s, time_s)
    series = {key: _series(found) for key, found in samples.items()}

    def of_each(what: str, names: tuple[str, ...]) -> dict[str, Series]:
        return {name: series[f"{what} {name}"] for name in names if f"{what} {name}" in series}

    return RunSeries(
        namespace=namespace,
        duration_s=end_s,
        imu_z=series.get("imu"),
        load_cell_z=series.get("load cell"),
        carriage=series.get("carriage"),
        manifold_pressure=series.get("pressure manifold"),
        pressures=of_each("pressure", CHANNELS),
        solenoids=of_each("solenoid", CHANNELS),
        # jam_state says what the driver took as its command; without it, the controller's request is the next best
        commanded_vacuum={**of_each("command", CHANNELS), **of_each("state", CHANNELS)},
        tensions=of_each("tension", TENDONS),
        events=tuple(sorted(events, key=lambda event: event.time_s)),
    )


def _series(samples: list[tuple[float, float]]) -> Series:
    table = np.array(samples, dtype=np.float64)
    table = table[np.argsort(table[:, 0], kind="stable")]
    return Series(table[:, 0], table[:, 1])


Values = Iterable[tuple[str, float]]


def _of_joints(message: Any) -> Values:
    names = list(message.name)
    if CARRIAGE_JOINT in names and len(message.position) == len(names):
        yield "carriage", float(message.position[names.index(CARRIAGE_JOINT)])


def _of_pressure(place: str, message: Any) -> Values:
    yield f"pressure {place}", message.fluid_pressure


def _of_data(key: str, message: Any) -> Values:
    yield key, float(message.data)


_VALUES: dict[str, Callable[[Any], Values]] = {
    IMU.name: lambda message: [("imu", message.linear_acceleration.z)],
    LOAD_CELL.name: lambda message: [("load cell", message.wrench.force.z)],
    JOINT_STATES.name: _of_joints,
    TENDON_STATES.name: lambda message: ((f"tension {each.name}", each.tension_n) for each in message.tendons),
    JAM_STATE.name: lambda message: ((f"state {each.channel}", each.commanded_vacuum_pa) for each in message.channels),
    JAM_COMMAND.name: lambda message: ((f"command {each.channel}", each.vacuum_pa) for each in message.channels),
    MANIFOLD_PRESSURE.name: partial(_of_pressure, "manifold"),
    **{topic.name: partial(_of_pressure, channel) for channel, topic in PRESSURES.items()},
    **{topic.name: partial(_of_data, f"solenoid {channel}") for channel, topic in SOLENOIDS.items()},
    PUMP_DUTY.name: partial(_of_data, "duty"),  # for the duration alone
}
"""What is taken of the messages of a topic: series and value."""


@dataclass(frozen=True)
class ChannelSummary:
    """One channel. Times are s after the start of the bag; None: did not happen, or is not in the bag."""

    channel: str
    energised_s: float | None
    """First time its solenoid was energised."""
    commanded_vacuum_pa: float | None
    """Largest vacuum asked for, gauge, positive."""
    reached_s: float | None
    """First time the measured vacuum was 95 % of that, after the solenoid was energised."""
    greatest_vacuum_pa: float | None
    """Largest vacuum measured, gauge, positive."""


@dataclass(frozen=True)
class RunSummary:
    """A landing in numbers. Times are s after the start of the bag; None: did not happen, or is not in the bag."""

    bag: str
    namespace: str
    """Where its ankle stood."""
    duration_s: float
    touch_down_s: float | None
    """First push on the load cell beyond 2 N after it did not push."""
    detected_s: float | None
    """Stamp of the IMU sample with which the controller detected the impact."""
    detection_delay_s: float | None
    """Between the first sample of the impact and that one, as the controller says."""
    peak_deceleration_m_s2: float | None
    """See PEAK_DEFINITION."""
    channels: tuple[ChannelSummary, ...]
    missing: tuple[str, ...]
    """What the bag does not hold, and what could not be said for that."""

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON."""
        return {**asdict(self), "peak_deceleration_definition": PEAK_DEFINITION}


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
    where = np.flatnonzero(condition)
    return float(series.time_s[where[0]]) if len(where) else None
