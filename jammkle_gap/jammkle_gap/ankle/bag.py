"""What a bag of one ankle holds: every topic that the diagnosis uses, as plain arrays with both clocks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_common.bags.reading import name_of, namespaces_in, opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.command.errors import InputError
from jammkle_gap.core.data import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

_S_PER_NS = 1e-9


@dataclass(frozen=True)
class Samples:
    """Messages of one topic."""

    log_s: NDArray[np.float64]
    """When each was written, s, by the recorder's clock, shape (n,)."""
    stamp_s: NDArray[np.float64]
    """When each was measured, s, by its header; as `log_s` where the type has none, shape (n,)."""
    columns: dict[str, NDArray[np.float64]]
    """Each of shape (n,), SI, as in the message."""
    lacking: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    """By column, of those that not every message has: where it is missing, shape (n,); two publishers of joint_states
    may each know joints of their own."""

    def readings(self, column: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return stamps, s, and values of one column, from the messages that have it, both of shape (n,)."""
        values = self.columns[column]
        if column not in self.lacking:
            return self.stamp_s, values
        there = ~self.lacking[column]
        return self.stamp_s[there], values[there]

    def chosen(self, which: NDArray[Any]) -> Samples:
        """Return some of the messages, by index or by mask."""
        columns = {name: values[which] for name, values in self.columns.items()}
        lacking = {name: missing[which] for name, missing in self.lacking.items()}
        return Samples(self.log_s[which], self.stamp_s[which], columns, lacking)


@dataclass(frozen=True)
class Bag:
    """One ankle's share of a bag."""

    name: str
    topics: dict[str, Samples]
    """By relative name."""
    description: str | None
    """What was simulated, as YAML, where the bag tells."""
    clock: Samples | None
    """/clock, column `clock_s`."""
    acknowledged: bool = False
    """Whether commands have the times at which the hardware took them, by the clock of the measurements."""


def read_bag(path: Path, namespace: str | None = None) -> Bag:
    """Read one ankle's topics.

    Args:
        path: The bag.
        namespace: Such as `/lf_ankle`; None takes the only one that is there.

    Raises:
        BadRecordingError: unreadable, empty, no topic of an ankle, or several ankles and no namespace.

    """
    try:
        tables, texts = _tables(path, namespace)
    except InputError as error:
        raise BadRecordingError(str(error)) from error
    clock = tables.pop(names.CLOCK.name, None)
    return Bag(
        name=name_of(path),
        topics={name: table.samples() for name, table in tables.items()},
        description=texts[-1] if texts else None,
        clock=None if clock is None else clock.samples(),
    )


def _tables(path: Path, namespace: str | None) -> tuple[dict[str, _Table], list[str]]:
    with opened(path) as reader:
        found = namespaces_in(set(reader.topics))
        if not found:
            msg = f"bag {path} holds no topic of an ankle, such as {names.JOINT_STATES.name}"
            msg += "; record the topics that `jammkle record` takes"
            raise BadRecordingError(msg)
        chosen = namespace or found[0]
        if chosen not in found or (namespace is None and len(found) > 1):
            msg = f"bag {path} holds the namespaces {', '.join(found)}"
            msg += f"; choose one of them, not '{namespace or 'none'}'"
            raise BadRecordingError(msg)
        takers = {f"{chosen.rstrip('/')}/{name}": (name, take) for name, take in TAKERS.items()}
        takers[names.CLOCK.name] = (names.CLOCK.name, _take_clock)
        tables: dict[str, _Table] = {}
        texts: list[str] = []
        parameters = f"{chosen.rstrip('/')}/{names.SIM_PARAMETERS.name}"
        times = BagTimes(reader)
        for topic in times.doubts.keys() & takers.keys():
            why = times.doubts[topic].partition(":")[0]
            msg = f"clocks disagree in bag {path}: {why}; record with one clock, and header.stamp set"
            raise BadRecordingError(msg)
        for connection, _, log_ns, data in times.messages(reader.on([*takers, parameters])):
            message: Any = reader.deserialize(data, connection.msgtype)
            if connection.topic == parameters:
                texts.append(str(message.data))
                continue
            name, take = takers[connection.topic]
            tables.setdefault(name, _Table()).add(log_ns, message, take(message))
    return tables, texts


class _Table:
    """Collects the messages of one topic."""

    def __init__(self) -> None:
        self._log_ns: list[int] = []
        self._stamp_ns: list[int] = []
        self._rows: list[dict[str, float]] = []
        self._places: dict[int, int] = {}

    def add(self, log_ns: int, message: Any, row: dict[str, float]) -> None:
        header = getattr(message, "header", None)
        stamp_ns = 0 if header is None else int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
        if header is not None:
            # Two publishers that know one half of the joints each may stamp alike.
            place = self._places.setdefault(stamp_ns, len(self._rows))
            if place < len(self._rows) and row and self._rows[place].keys().isdisjoint(row):
                self._rows[place].update(row)
                return
        self._log_ns.append(log_ns)
        self._stamp_ns.append(log_ns if header is None else stamp_ns)
        self._rows.append(row)

    def samples(self) -> Samples:
        names_ = dict.fromkeys(name for row in self._rows for name in row)
        columns = {name: np.array([row.get(name, np.nan) for row in self._rows]) for name in names_}
        lacking = {name: np.array([name not in row for row in self._rows]) for name in names_}
        return Samples(
            np.array(self._log_ns, dtype=np.float64) * _S_PER_NS,
            np.array(self._stamp_ns, dtype=np.float64) * _S_PER_NS,
            columns,
            {name: missing for name, missing in lacking.items() if missing.any()},
        )


def _take_clock(message: Any) -> dict[str, float]:
    return {"clock_s": message.clock.sec + message.clock.nanosec * _S_PER_NS}


def _take_data(message: Any) -> dict[str, float]:
    return {"data": float(message.data)}


def _take_actuators(message: Any) -> dict[str, float]:
    row = {names.PUMP_DUTY.name: float(message.pump_duty)}
    solenoids = zip(message.channels, message.energised, strict=False)
    return row | {names.solenoid_topic(channel).name: float(energised) for channel, energised in solenoids}


def _take_pressure(message: Any) -> dict[str, float]:
    return {"pressure": float(message.fluid_pressure)}


def _take_imu(message: Any) -> dict[str, float]:
    force, rate = message.linear_acceleration, message.angular_velocity
    row = {f"specific_force_{axis}": float(getattr(force, axis)) for axis in "xyz"}
    return row | {f"angular_velocity_{axis}": float(getattr(rate, axis)) for axis in "xyz"}


def _take_load_cell(message: Any) -> dict[str, float]:
    return {f"force_{axis}": float(getattr(message.wrench.force, axis)) for axis in "xyz"}


def _take_joints(message: Any) -> dict[str, float]:
    row = {f"{name}/position": float(value) for name, value in zip(message.name, message.position, strict=False)}
    velocities = zip(message.name, message.velocity, strict=False)
    return row | {f"{name}/velocity": float(value) for name, value in velocities}


def _take_tendons(message: Any) -> dict[str, float]:
    row: dict[str, float] = {}
    for tendon in message.tendons:
        row[f"{tendon.name}/extension"] = float(tendon.extension_m)
        row[f"{tendon.name}/tension"] = float(tendon.tension_n)
    return row


TAKERS: dict[str, Callable[[Any], dict[str, float]]] = {
    names.PUMP_DUTY.name: _take_data,
    **{topic.name: _take_data for topic in names.SOLENOIDS.values()},
    names.ACTUATOR_STATES.name: _take_actuators,
    **{topic.name: _take_pressure for topic in (names.MANIFOLD_PRESSURE, *names.PRESSURES.values())},
    names.IMU.name: _take_imu,
    names.LOAD_CELL.name: _take_load_cell,
    names.JOINT_STATES.name: _take_joints,
    names.TENDON_STATES.name: _take_tendons,
}
"""What is kept of each topic's messages: values by column."""
