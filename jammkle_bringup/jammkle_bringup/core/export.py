"""A bag as tables: one for each topic, or the sampled ones on one time base. In constant memory, however long it is."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, BinaryIO

import pyarrow as pa  # type: ignore[import-untyped]  # carries no types
import pyarrow.csv  # type: ignore[import-untyped]  # carries no types
import pyarrow.parquet  # type: ignore[import-untyped]  # carries no types
from rich.table import Table
from rosbags.interfaces import Nodetype

from jammkle_common.bags.reading import opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.command.errors import InputError, Interrupted
from jammkle_common.command.results import note
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import (
    CARRIAGE_JOINT,
    CARRIAGE_X_JOINT,
    CLOCK,
    DIAGNOSTICS,
    GAIT_PHASE,
    ROBOT_DESCRIPTION,
    SIM_PARAMETERS,
    TOPICS,
    TopicKind,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from jammkle_common.bags.reading import BagReader
    from jammkle_common.bags.storage import Connection

TIME = "time_s"
RUN = "run"
"""Name of the table of all signals on one time base."""

_PROGRESS_MESSAGES = 5_000
_MEASURED = tuple(topic.name for topic in TOPICS if topic.kind is TopicKind.SENSOR and "actuator" not in topic.name)
_OURS = tuple(topic.name for topic in TOPICS)
_TEXTS = (DIAGNOSTICS.name, SIM_PARAMETERS.name, ROBOT_DESCRIPTION.name)
_APART = (*_TEXTS, *(topic.name for topic in TOPICS if topic.kind is TopicKind.EVENT))


@dataclass(frozen=True)
class ExportedTable:
    """A table that was written: its file, the topics in it, its columns and how many rows it has."""

    file: str
    topics: tuple[str, ...]
    columns: tuple[str, ...]
    rows: int


@dataclass(frozen=True)
class Exported:
    """What was written. `start_s` is the ROS time from which `time_s` counts."""

    bag: str
    start_s: float
    tables: tuple[ExportedTable, ...]


def export(
    bag: Path,
    folder: Path,
    form: str,
    rate_hz: float | None,
    on_progress: Callable[[float], None],
    stop: Callable[[], bool],
) -> Exported:
    """Write the tables of a bag.

    Args:
        bag: The bag.
        folder: Where the tables go; it must be there.
        form: `csv` or `parquet`, which is also the end of the files' names.
        rate_hz: Rows per second of one table of all signals; None: each topic by itself.
        on_progress: Called now and then with the share that is done, 0 to 1.
        stop: Asked now and then; True ends it.

    Returns:
        What was written.

    Raises:
        InputError: the bag cannot be read.
        Interrupted: it was stopped.
        OSError: a table cannot be written.

    """
    known: dict[str, dict[str, Any]] = {}
    with opened(bag) as reader:
        if not reader.message_count:
            msg = f"bag {bag} holds no messages"
            raise InputError(msg)
        while True:

            def begun(name: str) -> TableFile:
                return TableFile(folder / f"{name}.{form}", known.get(name, {TIME: None}))

            try:
                return _Export(reader, begun, rate_hz, stop).run(on_progress)
            except NewColumnError as late:  # the table begins anew with it
                known[late.table] = late.columns


class _Export:
    def __init__(
        self,
        reader: BagReader,
        begun: Callable[[str], TableFile],
        rate_hz: float | None,
        stop: Callable[[], bool],
    ) -> None:
        self._reader, self._begun, self._stop = reader, begun, stop
        self._tables: dict[str, TableFile] = {}
        self._topics: dict[str, list[str]] = {}
        self._times = BagTimes(reader)
        self._wanted = [each for each in reader.connections if each.topic != CLOCK.name]
        self._names = table_names(self._wanted)
        self._makers = {
            each.id: RowMaker(each.topic, each.msgtype, reader.typestore.fielddefs) for each in self._wanted
        }
        self._columns: dict[tuple[int, str], str] = {}
        self._grid = None if rate_hz is None else TimeGrid(rate_hz)
        self._broken: Counter[str] = Counter()
        self._start_ns: int | None = None

    def run(self, on_progress: Callable[[float], None]) -> Exported:
        try:
            for number, (connection, time_ns, _, data) in enumerate(self._times.messages(self._wanted)):
                self._take(connection, time_ns, data)
                if number % _PROGRESS_MESSAGES == 0:
                    on_progress(number / self._reader.message_count)
                    self._end_if_asked_to()
            if self._grid is not None:
                self._write_run(self._grid.rest())
            for table in self._tables.values():
                table.close()
        finally:
            for table in self._tables.values():
                table.abandon()
        self._say_what_is_not_in_them()
        return Exported(
            bag=str(self._reader.path),
            start_s=(self._start_ns or 0) / NANOSECONDS_PER_SECOND,
            tables=tuple(
                ExportedTable(table.path.name, tuple(self._topics[name]), tuple(table.columns), table.rows)
                for name, table in sorted(self._tables.items())
            ),
        )

    def _end_if_asked_to(self) -> None:
        if self._stop():
            raise Interrupted

    def _take(self, connection: Connection, time_ns: int, data: bytes) -> None:
        if self._start_ns is None:
            self._start_ns = time_ns
        since_ns = time_ns - self._start_ns
        topic = connection.topic
        try:
            message = self._reader.deserialize(data, connection.msgtype)
        except InputError:
            self._broken[topic] += 1
            return
        if self._grid is not None and self._times.rewound:
            msg = f"bag {self._reader.path} cannot be put on one time base: {self._times.rewound}; leave --rate-hz out"
            raise InputError(msg)
        for row in self._makers[connection.id].rows(message):
            apart = self._grid is None or topic.endswith(_APART)
            name = self._names[connection.id] if apart else RUN
            topics = self._topics.setdefault(name, [])
            if topic not in topics:
                topics.append(topic)
            if self._grid is None or apart:
                own = {f"{key}_of_message" if key == TIME else key: value for key, value in row.items()}
                self._write(name, {TIME: since_ns / NANOSECONDS_PER_SECOND, **own})
                continue
            is_measured = topic.endswith(_MEASURED) and not topic.endswith(GAIT_PHASE.name)  # which jumps from 1 to 0
            for column, value in row.items():
                name = self._column(connection, column)
                self._grid.add(since_ns, name, value, is_measured=is_measured and isinstance(value, float))
        if self._grid is not None:
            self._write_run(self._grid.ready())

    def _column(self, connection: Connection, column: str) -> str:
        """Return the name of a column in the table of all signals, which no other has."""
        key = (connection.id, column)
        if key not in self._columns:
            plain = _joined(self._names[connection.id], column)
            self._columns[key] = _not_taken(plain, {TIME, *self._columns.values()})
        return self._columns[key]

    def _say_what_is_not_in_them(self) -> None:
        for topic, count in self._broken.items():
            note(f"bag {self._reader.path}: {count} messages of {topic} cannot be decoded and are left out")
        for begin_ns, end_ns in () if self._grid is None else self._grid.holes:
            begin_s, end_s = begin_ns / NANOSECONDS_PER_SECOND, end_ns / NANOSECONDS_PER_SECOND
            note(f"bag {self._reader.path} holds nothing from {begin_s:.3f} to {end_s:.3f} s: there are no rows of it")

    def _write_run(self, rows: Iterator[dict[str, Any]]) -> None:
        for number, row in enumerate(rows, 1):
            self._write(RUN, row)
            if number % _PROGRESS_MESSAGES == 0:
                self._end_if_asked_to()

    def _write(self, name: str, row: dict[str, Any]) -> None:
        if name not in self._tables:
            self._tables[name] = self._begun(name)
        self._tables[name].add(row)


def table_names(connections: Sequence[Connection]) -> dict[int, str]:
    """Return the name of each topic's table: `imu_data` of `/imu/data`, and `imu_data_2` of `/imu_data` beside it."""
    names: dict[int, str] = {}
    for each in sorted(connections, key=lambda each: (not each.topic.endswith(_OURS), each.topic, each.id)):
        names[each.id] = _not_taken(each.topic.strip("/").replace("/", "_"), {RUN, *names.values()})
    return names


def _not_taken(name: str, taken: set[str]) -> str:
    return next(
        each for each in itertools.chain([name], (f"{name}_{n}" for n in itertools.count(2))) if each not in taken
    )


def _joined(table: str, column: str) -> str:
    """Return a column's name beside those of other topics, without saying a word twice: `pump_duty` of `duty`."""
    last = table.rpartition("_")[2]
    return table + column.removeprefix(last) if f"{column}_".startswith(f"{last}_") else f"{table}_{column}"


PART_ROWS = 16_384
"""Rows that are held before they are written."""


class NewColumnError(Exception):
    """A column came up after the head of a table was written; `columns` are all that are known, with a value each."""

    def __init__(self, table: str, columns: dict[str, Any]) -> None:
        """Keep the name of the table, and its columns."""
        super().__init__(table, columns)
        self.table, self.columns = table, columns


class TableFile:
    """One table that is being written. Columns are those of the rows before the first part is written."""

    def __init__(self, path: Path, columns: Mapping[str, Any]) -> None:
        """Begin a table, CSV or Parquet by its suffix, with these columns; the file is made with its first part."""
        self.path = path
        self.rows = 0
        self.columns = dict(columns)
        """By name, in order, a value that shows the type of one that comes late; None: not known."""
        self._held: list[dict[str, Any]] = []
        self._schema: Any = None
        self._writer: Any = None
        self._file: BinaryIO | None = None

    def add(self, row: dict[str, Any]) -> None:
        """Take a row; what it lacks is empty.

        Raises:
            NewColumnError: it has a column that the head of the table lacks.
            OSError: it cannot be written.

        """
        if not row.keys() <= self.columns.keys():
            self.columns |= {name: row[name] for name in row if name not in self.columns}
            if self._schema is not None:
                raise NewColumnError(self.path.stem, self.columns)
        self._held.append(row)
        if len(self._held) >= PART_ROWS:
            self._write()

    def close(self) -> None:
        """Write what is held, and end the file.

        Raises:
            OSError: it cannot be written.

        """
        if self._held or self._writer is None:
            self._write()
        self._end()

    def abandon(self) -> None:
        """End the file as it is."""
        self._held.clear()
        self._end()

    def _end(self) -> None:
        with contextlib.ExitStack() as stack:
            if self._file is not None:
                stack.callback(self._file.close)
            if self._writer is not None:
                self._writer.close()

    def _write(self) -> None:
        if self._schema is None:
            arrays = [pa.array([shown, *(row.get(name) for row in self._held)]) for name, shown in self.columns.items()]
            self._schema = pa.schema(
                [
                    pa.field(name, pa.float64() if pa.types.is_null(array.type) else array.type)
                    for name, array in zip(self.columns, arrays, strict=True)
                ]
            )
            self._file = self.path.open("wb")  # Arrow takes no name whose bytes are none in UTF-8
            if self.path.suffix == ".parquet":
                self._writer = pyarrow.parquet.ParquetWriter(self._file, self._schema, compression="zstd")
            else:
                options = pyarrow.csv.WriteOptions(quoting_style="needed")
                self._writer = pyarrow.csv.CSVWriter(self._file, self._schema, write_options=options)
        self._writer.write_table(pa.Table.from_pylist(self._held, schema=self._schema))
        self.rows += len(self._held)
        self._held.clear()


LATENESS_NS = 2 * NANOSECONDS_PER_SECOND
"""How long a moment waits for late samples. Assumed: a recorder's queues hold two seconds (`recorder.QUEUE_DEPTH`)."""

HOLE_NS = NANOSECONDS_PER_SECOND
"""Time without samples from which on a measurement is empty instead of a straight line. Assumed: well above the period
of what is measured here, 10 ms at most."""

EMPTY_NS = 600 * NANOSECONDS_PER_SECOND
"""Time without samples of any kind from which on there are no rows. Assumed: no sensor of a robot that runs is silent
for as long; a clock that was set makes years."""


@dataclass
class _Signal:
    """Samples of one column that are still needed. `is_measured`: straight lines between them."""

    is_measured: bool
    samples: deque[tuple[int, Any]] = field(default_factory=deque)

    def at(self, time_ns: int) -> Any:
        """Return the value at a time; None where there is none. Times must not decrease from call to call."""
        samples = self.samples
        while len(samples) > 1 and samples[1][0] <= time_ns:
            samples.popleft()
        if not samples or samples[0][0] > time_ns:
            return None
        begin_ns, value = samples[0]
        if not self.is_measured or begin_ns == time_ns:
            return value
        if len(samples) == 1 or samples[1][0] - begin_ns > HOLE_NS:
            return None
        end_ns, end = samples[1]
        return value + (end - value) * (time_ns - begin_ns) / (end_ns - begin_ns)


class TimeGrid:
    """Rows at equal distances in time, each as soon as nothing can change it any more."""

    def __init__(self, rate_hz: float) -> None:
        """Begin at time zero, with this many rows per second."""
        self._rate_hz = rate_hz
        self._next = 0
        self._now_ns = -1
        self._signals: dict[str, _Signal] = {}
        self.holes: list[tuple[int, int]] = []
        """Begin and end of the times without rows, ns."""
        self._passed = 0

    def add(self, time_ns: int, name: str, value: Any, *, is_measured: bool) -> None:
        """Take a sample; one that is older than its predecessor is put where it belongs."""
        samples = self._signals.setdefault(name, _Signal(is_measured)).samples
        later = []
        while samples and samples[-1][0] > time_ns:
            later.append(samples.pop())
        samples.append((time_ns, value))
        samples.extend(reversed(later))
        if self._now_ns >= 0 and time_ns - self._now_ns > EMPTY_NS:
            self.holes.append((self._now_ns, time_ns))
        self._now_ns = max(self._now_ns, time_ns)

    def ready(self) -> Iterator[dict[str, Any]]:
        """Return the rows that are ready, with `time_s`."""
        return self._until(self._now_ns - LATENESS_NS)

    def rest(self) -> Iterator[dict[str, Any]]:
        """Return the rows up to the last sample: nothing else comes."""
        return self._until(self._now_ns)

    def _until(self, end_ns: int) -> Iterator[dict[str, Any]]:
        while (time_ns := round(self._next * NANOSECONDS_PER_SECOND / self._rate_hz)) <= end_ns:
            if self._passed < len(self.holes) and time_ns > self.holes[self._passed][0]:
                end_ns = self.holes[self._passed][1]
                self._next = max(self._next, math.ceil(end_ns * self._rate_hz / NANOSECONDS_PER_SECOND))
                self._passed += 1
                continue
            self._next += 1
            row = {"time_s": time_ns / NANOSECONDS_PER_SECOND}
            for name, signal in self._signals.items():
                value = signal.at(time_ns)
                if value is not None:
                    row[name] = value
            yield row


def exported_table(done: Exported) -> Table:
    """Return for people what was written."""
    shown = Table("table")
    for heading in ("rows", "columns"):
        shown.add_column(heading, justify="right")
    for table in done.tables:
        shown.add_row(table.file, str(table.rows), str(len(table.columns)))
    return shown


Cell = bool | int | float | str
Row = dict[str, Cell]

_VALUE = "data"
"""The one field of std_msgs/Float32, Bool and the like."""
_HEADER = "std_msgs/msg/Header"
_DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
_JOINTS = "sensor_msgs/msg/JointState"
_KEYS = ("name", "channel", "child_frame_id", "joint_name", "header.frame_id")
"""Fields that name an entry of a list."""
_NOT_MEASURED = -1.0
"""First element of a covariance whose measurement is none (sensor_msgs/Imu)."""
_LONGEST_ARRAY = 16
"""Most numbers of an array without names that get columns; longer ones are pictures or point clouds."""

_FLUID = "fluid_pressure"
_UNITS = {
    ("sensor_msgs/msg/FluidPressure", _FLUID): "pa",
    ("sensor_msgs/msg/Temperature", "temperature"): "degc",
    ("sensor_msgs/msg/BatteryState", "voltage"): "v",
    ("sensor_msgs/msg/BatteryState", "current"): "a",
    ("sensor_msgs/msg/Imu", "angular_velocity"): "rad_s",
    ("sensor_msgs/msg/Imu", "linear_acceleration"): "m_s2",
    ("geometry_msgs/msg/Wrench", "force"): "n",
    ("geometry_msgs/msg/Wrench", "torque"): "n_m",
    ("geometry_msgs/msg/Twist", "linear"): "m_s",
    ("geometry_msgs/msg/Twist", "angular"): "rad_s",
    ("geometry_msgs/msg/Accel", "linear"): "m_s2",
    ("geometry_msgs/msg/Accel", "angular"): "rad_s2",
    ("geometry_msgs/msg/Pose", "position"): "m",
    ("geometry_msgs/msg/Transform", "translation"): "m",
}
"""Units of fields of standard messages, as their definitions give them; those of this project end in theirs."""

_JOINT_UNITS = {"position": ("rad", "m"), "velocity": ("rad_s", "m_s"), "effort": ("n_m", "n")}
"""Of a joint that turns and of one that slides. The message does not tell which it is: `carriage` alone slides here."""


_FAULT = "jammkle_msgs/msg/Fault"
"""Its 0, UNKNOWN, says that no fault is known: an empty cell, as its text is, and no fault that nobody knows."""
_WORDS_ELSEWHERE = {("jammkle_msgs/msg/ChannelJamState", "fault"): _FAULT}
"""Fields whose constants another message has."""


class RowMaker:
    """Makes rows of the messages of one type, as the definitions in a bag describe it.

    A message is one row, its fields are columns whose names end in their units. Fields of fields are joined by `_`.
    Where a message lists named things (joints, tendons, channels), each has columns of its own that begin with its
    name. Constants of a definition stand as their words. Headers are left out, as their stamp is the time of the row,
    and so are variances; so is a measurement whose covariance of -1 says that it is none.
    """

    def __init__(self, topic: str, message_type: str, definitions: Mapping[str, Any]) -> None:
        """Prepare.

        Args:
            topic: Its last part names the value of a message that has no more than that.
            message_type: `package/msg/Name`.
            definitions: Of the bag's types (`typestore.fielddefs` of the bag library).

        """
        self._definitions = definitions
        self._leaf = topic.rpartition("/")[2]
        self.rows: Callable[[Any], Iterator[Row]] = (
            _diagnostic_rows if message_type == _DIAGNOSTICS else self._single(self._fields(message_type))
        )
        """Makes the rows of a message: one, and of /diagnostics one per line."""

    def _single(self, fill: Callable[[Any, str, Row], None]) -> Callable[[Any], Iterator[Row]]:
        def rows(message: Any) -> Iterator[Row]:
            row: Row = {}
            fill(message, "", row)
            yield {self._leaf: row[_VALUE]} if row.keys() == {_VALUE} else row

        return rows

    def _fields(self, message_type: str) -> Callable[[Any, str, Row], None]:
        """Return what puts the fields of a message into a row, their names behind a prefix."""
        fields = self._definitions[message_type][1]
        words = self._words(message_type)
        named = _names_field(fields)
        parts: list[Callable[[Any, str, Row], None]] = []
        for name, (node, inner) in fields:
            if (
                name.endswith(("covariance", "variance"))
                or (node is Nodetype.NAME and inner == _HEADER)
                or name == named
            ):
                continue
            unit = _UNITS.get((message_type, name), "")
            elsewhere = _WORDS_ELSEWHERE.get((message_type, name), "")
            if elsewhere in self._definitions:
                parts.append(_worded(name, self._words(elsewhere)))
            elif node is Nodetype.BASE:
                kind = inner[0]
                parts.append(_worded(name, words) if words and kind in {"uint8", "byte"} else _plain(name, unit))
                words = {} if kind in {"uint8", "byte"} else words  # constants are those of the first such field
            elif node is Nodetype.NAME:
                covariance = f"{name}_covariance" if f"{name}_covariance" in dict(fields) else ""
                parts.append(_nested(name, unit, covariance, self._fields(inner)))
            elif named:
                parts.append(_parallel(name, named, _JOINT_UNITS.get(name) if message_type == _JOINTS else None))
            elif inner[0][0] is Nodetype.NAME:
                parts.append(_listed(name, self._fields(inner[0][1])))
            else:
                parts.append(_array(name, unit))

        def fill(message: Any, prefix: str, row: Row) -> None:
            for part in parts:
                part(message, prefix, row)

        return fill

    def _words(self, message_type: str) -> dict[Any, str]:
        constants = self._definitions[message_type][0]
        words = {value: name for name, kind, value in constants if kind in {"uint8", "byte"}}
        return {**words, 0: ""} if message_type == _FAULT else words


def _names_field(fields: Any) -> str:
    """Return the field that names the entries of the lists beside it, as `name` of JointState; empty if none does."""
    texts = [name for name, (node, inner) in fields if node is Nodetype.SEQUENCE and inner[0][1] == ("string", 0)]
    lists = [name for name, (node, _) in fields if node is Nodetype.SEQUENCE]
    return texts[0] if len(texts) == 1 and len(lists) > 1 else ""


def _plain(name: str, unit: str) -> Callable[[Any, str, Row], None]:
    end = f"{name.removeprefix('fluid_')}_{unit}" if unit else name  # of FluidPressure: pressure_pa

    def fill(message: Any, prefix: str, row: Row) -> None:
        row[prefix + end] = getattr(message, name)

    return fill


def _worded(name: str, words: Mapping[Any, str]) -> Callable[[Any, str, Row], None]:
    def fill(message: Any, prefix: str, row: Row) -> None:
        value = getattr(message, name)
        row[prefix + name] = words.get(value, str(value))

    return fill


def _nested(
    name: str, unit: str, covariance: str, inner: Callable[[Any, str, Row], None]
) -> Callable[[Any, str, Row], None]:
    def fill(message: Any, prefix: str, row: Row) -> None:
        if covariance and getattr(message, covariance)[0] == _NOT_MEASURED:
            return
        if not unit:
            inner(getattr(message, name), f"{prefix}{name}_", row)
            return
        own: Row = {}
        inner(getattr(message, name), f"{prefix}{name}_", own)
        row.update((f"{key}_{unit}", value) for key, value in own.items())

    return fill


_SLIDES = (CARRIAGE_JOINT, CARRIAGE_X_JOINT)


def _parallel(name: str, names: str, units: tuple[str, str] | None) -> Callable[[Any, str, Row], None]:
    def fill(message: Any, prefix: str, row: Row) -> None:
        for entry, value in zip(getattr(message, names), getattr(message, name), strict=False):
            unit = f"_{units[entry in _SLIDES]}" if units else ""
            row[f"{prefix}{entry}_{name}{unit}"] = value.item() if hasattr(value, "item") else value

    return fill


def _listed(name: str, inner: Callable[[Any, str, Row], None]) -> Callable[[Any, str, Row], None]:
    def fill(message: Any, prefix: str, row: Row) -> None:
        for number, entry in enumerate(getattr(message, name)):
            own: Row = {}
            inner(entry, "", own)
            key = next((str(own.pop(each)) for each in _KEYS if each in own), f"{name}_{number}")
            row.update((f"{prefix}{key}_{end}", value) for end, value in own.items())

    return fill


def _array(name: str, unit: str) -> Callable[[Any, str, Row], None]:
    def fill(message: Any, prefix: str, row: Row) -> None:
        values = getattr(message, name)
        if len(values) <= _LONGEST_ARRAY:
            end = f"_{unit}" if unit else ""
            for number, value in enumerate(values):
                row[f"{prefix}{name}_{number}{end}"] = value.item() if hasattr(value, "item") else value

    return fill


_LEVELS = ("OK", "WARN", "ERROR", "STALE")


def _diagnostic_rows(message: Any) -> Iterator[Row]:
    """Make a row of each line: its values differ from node to node, so that they stand in one cell, as JSON."""
    for line in message.status:
        level = int(line.level)
        yield {
            "name": line.name,
            "level": _LEVELS[level] if level < len(_LEVELS) else str(level),
            "message": line.message,
            "values": json.dumps({each.key: each.value for each in line.values}),
        }
