"""What a bag of one ankle holds: every topic that the diagnosis uses, as plain arrays in order, on one clock."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import linprog  # type: ignore[import-untyped]  # carries no types

from jammkle_common import names
from jammkle_common.bags.reading import name_of, opened
from jammkle_common.bags.run_sheet import RunSheet, read_sheet
from jammkle_common.bags.times import BagTimes
from jammkle_common.command.errors import InputError
from jammkle_gap.core.data import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

_S_PER_NS = 1e-9
COMMANDS = (names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values()))
"""Topics that tell the hardware what to do."""
CARRIAGE = f"{names.CARRIAGE_JOINT}/position"
"""Signal and column of a rig's slide."""


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
    sheet: RunSheet = field(default_factory=RunSheet)
    """What was done to the machine."""
    clock: Samples | None = None
    """/clock, column `clock_s`."""
    simulated: bool = False
    """Whether a simulation of this project made it, and says so: its times are those of its programme."""
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
        sheet = read_sheet(path, texts[-1] if texts else None, name_of(path))
    except InputError as error:
        raise BadRecordingError(str(error)) from error
    clock = tables.pop(names.CLOCK.name, None)
    return Bag(
        name=name_of(path),
        topics={name: table.samples() for name, table in tables.items()},
        sheet=sheet,
        clock=None if clock is None else clock.samples(),
        simulated=bool(texts),
    )


def _tables(path: Path, namespace: str | None) -> tuple[dict[str, _Table], list[str]]:
    with opened(path) as reader:
        chosen = reader.chosen_namespace(namespace)
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
        if times.rewound:
            msg = f"bag {path} cannot be put in order: {times.rewound}; record it anew"
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
        self._last_ns: dict[frozenset[str], int] = {}
        self._each_in_order = True

    def add(self, log_ns: int, message: Any, row: dict[str, float]) -> None:
        header = getattr(message, "header", None)
        stamp_ns = 0 if header is None else int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
        if header is not None:
            half = frozenset(row)
            self._each_in_order &= stamp_ns >= self._last_ns.get(half, stamp_ns)
            self._last_ns[half] = stamp_ns
            # Two publishers that know one half of the joints each may stamp alike.
            place = self._places.setdefault(stamp_ns, len(self._rows))
            if place < len(self._rows) and row and self._rows[place].keys().isdisjoint(row):
                self._rows[place].update(row)
                return
        self._log_ns.append(log_ns)
        self._stamp_ns.append(log_ns if header is None else stamp_ns)
        self._rows.append(row)

    def samples(self) -> Samples:
        if len(self._last_ns) > 1 and self._each_in_order:
            # A recorder takes from one publisher what it has, and then from the other.
            order = sorted(range(len(self._rows)), key=self._stamp_ns.__getitem__)
            self._log_ns, self._stamp_ns = ([times[i] for i in order] for times in (self._log_ns, self._stamp_ns))
            self._rows = [self._rows[i] for i in order]
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


_EXACT_S = 1e-6
"""Difference of log time and stamp up to which a recorder receives all at once, as one in a simulation does."""


def on_one_clock(bag: Bag) -> Bag:
    """Put log times on the clock of the stamps, where the bag holds /clock and was logged by another."""
    if bag.clock is None:
        return bag
    ticks = bag.clock
    if abs(float(np.median(ticks.log_s - ticks.columns["clock_s"]))) < 1.0:
        return bag
    topics = {}
    for name, samples in bag.topics.items():
        log_s = np.interp(samples.log_s, ticks.log_s, ticks.columns["clock_s"])
        topics[name] = dataclasses.replace(samples, log_s=log_s, stamp_s=log_s if name in COMMANDS else samples.stamp_s)
    return dataclasses.replace(bag, topics=topics)


def with_acknowledgements(bag: Bag) -> Bag:
    """Return the bag with the commands as the hardware acknowledged them, where it did."""
    topics = dict(bag.topics)
    taken = topics.pop(names.ACTUATOR_STATES.name, None)
    if taken is None:
        return bag
    order = np.argsort(taken.stamp_s, kind="stable")
    for topic, column in taken.columns.items():
        values = column[order]
        changed = np.concatenate(([True], values[1:] != values[:-1]))
        time_s = taken.stamp_s[order][changed]
        topics[topic] = Samples(time_s, time_s, {"data": values[changed]})
    return dataclasses.replace(bag, topics=topics, acknowledged=True)


def is_exact(bag: Bag) -> bool:
    """Tell whether commands have the times of the measurements' clock at which they were taken."""
    if bag.acknowledged:
        return True
    return all(float(np.abs(each.log_s - each.stamp_s).max()) <= _EXACT_S for each in bag.topics.values())


_LARGEST_OFFSET_S = 0.5
"""Largest offset between the clocks of log and stamps, s, where commands are placed by the log. Assumed: the quickest
of all messages takes no longer."""
_LARGEST_LATENCY_S = 2.0
"""Largest latency of a topic beyond the quickest one's, s. Assumed: what is later has stamps of another clock."""
_LARGEST_DRIFT = 0.03
"""Largest relative drift between the two; beyond it one of the clocks does not count seconds."""
_DRIFT_FLOOR_S = 0.05
"""Drift that is never minded, s."""
_FELL_BEHIND_S = 0.1
"""From which delay on it is noted that a recorder fell behind, s."""
_REORDERED_S = 0.1
"""How far neighbours may be out of order in the bag and are put back. Assumed: no queue of a recorder holds longer."""
_STEPS_BACK = 0.01
"""Share of samples that may be further out of order, or double."""


def check_commands(bag: Bag) -> None:
    """Refuse a bag without commands.

    Raises:
        BadRecordingError: pump or all solenoids are missing.

    """
    solenoids = [topic.name for topic in names.SOLENOIDS.values()]
    missing = [] if names.PUMP_DUTY.name in bag.topics else [names.PUMP_DUTY.name]
    missing += [] if any(name in bag.topics for name in solenoids) else ["any of " + ", ".join(solenoids)]
    if missing:
        msg = f"bag {bag.name} holds no commands: {' nor '.join(missing)}"
        msg += "; record them too, from before the first one is given"
        raise BadRecordingError(msg)


def checked_topics(bag: Bag) -> dict[str, Samples]:
    """Return the topics of a bag, samples in order.

    Raises:
        BadRecordingError: a command or a clock that cannot be right, or commands alone.

    """
    topics: dict[str, Samples] = {}
    for topic, samples in bag.topics.items():
        if topic in COMMANDS:
            _check_command_values(bag.name, topic, samples)
            topics[topic] = samples
            continue
        topics[topic] = _in_order(bag.name, topic, samples)
    if not set(topics) - set(COMMANDS):
        msg = f"bag {bag.name} holds commands alone"
        msg += f"; record pressures, {names.JOINT_STATES.name} and {names.IMU.name} too"
        raise BadRecordingError(msg)
    return topics


def _check_command_values(bag: str, topic: str, samples: Samples) -> None:
    """Refuse commands that are no share from 0 to 1, such as a duty in percent.

    Raises:
        BadRecordingError: as said.

    """
    values = samples.columns["data"]
    wrong = ~((values >= 0.0) & (values <= 1.0))
    if wrong.any():
        msg = (
            f"{topic} in bag {bag} is {values[int(np.argmax(wrong))]:g} at {int(wrong.sum())} of {len(values)} samples"
        )
        msg += "; record the command as applied, a number from 0 to 1"
        raise BadRecordingError(msg)


def checked_clocks(bag: Bag, topics: Mapping[str, Samples]) -> tuple[str, ...]:
    """Check that commands can be placed among measurements; return what the reader should know of the recorder.

    Only commands without a stamp have nothing but their log time. Where the hardware has acknowledged them with a
    stamp, or a simulation has made /clock, log times say nothing of the machine.

    Args:
        bag: The bag.
        topics: Its topics, samples in order.

    Raises:
        BadRecordingError: commands are placed by the log, and its clock is not that of the stamps.

    """
    measured = {topic: each for topic, each in topics.items() if topic not in COMMANDS}
    if not bag.acknowledged and bag.clock is None:
        _check_one_clock(bag.name, measured)
    behind_s = max(float(np.ptp(each.log_s - each.stamp_s)) for each in measured.values())
    if behind_s <= _FELL_BEHIND_S:
        return ()
    return (f"its recorder fell behind by up to {behind_s:.1f} s; measurements have their stamps, and are not moved",)


def _check_one_clock(bag: str, measured: Mapping[str, Samples]) -> None:
    """Refuse stamps of another clock than the log's.

    Raises:
        BadRecordingError: they are far apart, or drift apart.

    """
    lags = {topic: _least_lag(each) for topic, each in measured.items()}
    quickest_s = min((lag_s for lag_s, _, _ in lags.values()), key=abs)
    for topic, (lag_s, drift_s, duration_s) in lags.items():
        apart_s = lag_s if abs(quickest_s) > _LARGEST_OFFSET_S else lag_s - quickest_s
        largest_s = _LARGEST_OFFSET_S if abs(quickest_s) > _LARGEST_OFFSET_S else _LARGEST_LATENCY_S
        if not -_LARGEST_OFFSET_S <= apart_s <= largest_s:
            msg = f"clocks disagree in bag {bag}: {topic} is logged {apart_s:.3g} s after its header's stamp"
            msg += f", at most {largest_s:g} s; record with one clock (or with /clock)"
            raise BadRecordingError(msg)
        limit_s = max(_DRIFT_FLOOR_S, _LARGEST_DRIFT * duration_s)
        if abs(drift_s) > limit_s:
            msg = f"clocks drift apart in bag {bag}: {topic}'s log time and header time part by {drift_s:.3g} s"
            msg += f", at most {limit_s:.2g} s, as of two clocks or a recorder that falls behind"
            msg += "; synchronise the clocks, or record fewer topics, and record again"
            raise BadRecordingError(msg)


def _least_lag(samples: Samples) -> tuple[float, float, float]:
    """Return offset and drift between log and stamps, s, and the duration, s, by the quickest messages alone.

    A message is only ever late, so that the clocks lie on the line under all points that is nearest to them: the linear
    programme of Moon, Skelly and Towsley, Estimation and removal of clock skew from network delay measurements (1999).
    """
    lag_s = samples.log_s - samples.stamp_s
    time_s = samples.log_s - samples.log_s[0]
    duration_s = float(time_s.max())
    if duration_s == 0.0:
        return float(lag_s.min()), 0.0, 0.0
    line = linprog(
        [-1.0, -float(time_s.mean())],
        A_ub=np.column_stack((np.ones_like(time_s), time_s)),
        b_ub=lag_s,
        bounds=[(None, None), (None, None)],
    )
    offset_s, slope = line.x
    return float(offset_s + slope * time_s.mean()), float(slope * duration_s), duration_s


def _in_order(bag: str, topic: str, samples: Samples) -> Samples:
    """Return the samples by rising stamps. A recorder with several threads may write neighbours in another order.

    Raises:
        BadRecordingError: more than a few are far out of order, or double.

    """
    late = samples.stamp_s < np.maximum.accumulate(samples.stamp_s) - _REORDERED_S
    order = np.flatnonzero(~late)[np.argsort(samples.stamp_s[~late], kind="stable")]
    kept = order[np.concatenate(([True], np.diff(samples.stamp_s[order]) > 0.0))]
    lost = 1.0 - len(kept) / len(samples.stamp_s)
    if not samples.stamp_s.any():
        msg = f"{topic} in bag {bag} carries no time in its headers; record it with header.stamp set"
        raise BadRecordingError(msg)
    if lost > _STEPS_BACK:
        msg = f"stamps of {topic} in bag {bag} run backwards or stand still at {100.0 * lost:.0f} % of its samples"
        msg += "; record one publisher with a steady clock, without a reset of the simulation"
        raise BadRecordingError(msg)
    return samples.chosen(kept)
