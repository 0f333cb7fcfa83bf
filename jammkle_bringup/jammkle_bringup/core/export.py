"""A bag as tables: one for each topic, or the sampled ones on one time base. In constant memory, however long it is."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from jammkle_bringup.core.columns import RowMaker
from jammkle_bringup.core.table_files import NewColumnError, TableFile, TableFormat
from jammkle_bringup.core.time_grid import TimeGrid
from jammkle_graph.bags.reading import messages, opened
from jammkle_graph.bags.times import BagTimes
from jammkle_graph.command.errors import InputError
from jammkle_graph.constants import NANOSECONDS_PER_SECOND
from jammkle_graph.names import CLOCK, DIAGNOSTICS, SIM_PARAMETERS, TOPICS, TopicKind

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from jammkle_graph.bags.reading import BagReader, Connection

TIME = "time_s"
RUN = "run"
"""Name of the table of all signals on one time base."""

_PROGRESS_MESSAGES = 5_000
_MEASURED = tuple(topic.name for topic in TOPICS if topic.kind is TopicKind.SENSOR and "actuator" not in topic.name)
_APART = (DIAGNOSTICS.name, SIM_PARAMETERS.name, *(topic.name for topic in TOPICS if topic.kind is TopicKind.EVENT))


@dataclass(frozen=True)
class ExportRequest:
    """What to export: a bag, into a folder, as what, and at how many rows per second (None: each topic by itself)."""

    bag: Path
    folder: Path
    form: TableFormat
    rate_hz: float | None = None


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

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON."""
        return asdict(self)


def export(request: ExportRequest, on_progress: Callable[[float], None], stop: Callable[[], bool]) -> Exported | None:
    """Write the tables of a bag.

    Args:
        request: What to write.
        on_progress: Called now and then with the share that is done, 0 to 1.
        stop: Asked now and then; True ends it.

    Returns:
        What was written; None if it was stopped.

    Raises:
        InputError: the bag cannot be read, or the folder not be made.
        OSError: a table cannot be written.

    """
    known: dict[str, list[str]] = {}
    with opened(request.bag) as reader:
        if not reader.message_count:
            msg = f"bag {request.bag} holds no messages"
            raise InputError(msg)
        while True:
            export_once = _Export(request, reader, known)
            try:
                return export_once.run(on_progress, stop)
            except _HeadIsWrittenError as late:  # a column that came up late: the table begins anew with it
                known[late.table] = late.columns


class _HeadIsWrittenError(Exception):
    """A table needs columns that its written head lacks."""

    def __init__(self, table: str, columns: list[str]) -> None:
        super().__init__(table)
        self.table, self.columns = table, columns


class _Export:
    """One passage through a bag."""

    def __init__(self, request: ExportRequest, reader: BagReader, known: Mapping[str, list[str]]) -> None:
        self._request, self._reader, self._known = request, reader, known
        self._times = BagTimes(reader)
        self._makers = {
            each.topic: RowMaker(each.topic, each.msgtype, reader.typestore.fielddefs) for each in reader.connections
        }
        self._grid = None if request.rate_hz is None else TimeGrid(request.rate_hz)
        self._tables: dict[str, TableFile] = {}
        self._topics: dict[str, list[str]] = {}
        self._start_ns: int | None = None

    def run(self, on_progress: Callable[[float], None], stop: Callable[[], bool]) -> Exported | None:
        try:
            for number, (connection, log_ns, data) in enumerate(messages(self._reader, self._request.bag)):
                time_ns = self._times.time_ns(connection, log_ns, data)
                if connection.topic != CLOCK.name:
                    self._take(connection, time_ns, data)
                if number % _PROGRESS_MESSAGES == 0:
                    on_progress(number / self._reader.message_count)
                    if stop():
                        return None
            if self._grid is not None:
                self._write_run(self._grid.rest())
            for table in self._tables.values():
                table.close()
        finally:
            for table in self._tables.values():
                table.abandon()
        return self._exported()

    def _take(self, connection: Connection, time_ns: int, data: bytes) -> None:
        if self._start_ns is None:
            self._start_ns = time_ns
        since_ns = time_ns - self._start_ns
        topic = connection.topic
        name = table_name(topic)
        for row in self._makers[topic].rows(self._reader.deserialize(data, connection.msgtype)):
            if self._grid is None or topic.endswith(_APART):
                self._write(name, topic, {TIME: since_ns / NANOSECONDS_PER_SECOND, **row})
                continue
            is_measured = topic.endswith(_MEASURED)
            self._topics.setdefault(RUN, [])
            if topic not in self._topics[RUN]:
                self._topics[RUN].append(topic)
            for column, value in row.items():
                self._grid.add(
                    since_ns, _joined(name, column), value, is_measured=is_measured and isinstance(value, float)
                )
        if self._grid is not None:
            self._write_run(self._grid.ready())

    def _write_run(self, rows: Iterator[dict[str, Any]]) -> None:
        for row in rows:
            self._write(RUN, "", row)

    def _write(self, name: str, topic: str, row: dict[str, Any]) -> None:
        table = self._tables.get(name)
        if table is None:
            path = self._request.folder / f"{name}.{self._request.form.value}"
            table = self._tables[name] = TableFile(path, self._request.form, self._known.get(name, [TIME]))
            if topic:
                self._topics[name] = [topic]
        try:
            table.add(row)
        except NewColumnError as error:
            raise _HeadIsWrittenError(name, error.columns) from error

    def _exported(self) -> Exported:
        return Exported(
            bag=str(self._request.bag),
            start_s=(self._start_ns or 0) / NANOSECONDS_PER_SECOND,
            tables=tuple(
                ExportedTable(table.path.name, tuple(self._topics[name]), tuple(table.columns), table.rows)
                for name, table in sorted(self._tables.items())
            ),
        )


def table_name(topic: str) -> str:
    """Return the name of a topic's table: `imu_data` of `/imu/data`."""
    return topic.strip("/").replace("/", "_")


def _joined(table: str, column: str) -> str:
    """Return a column's name beside those of other topics, without saying a word twice: `pump_duty` of `duty`."""
    last = table.rpartition("_")[2]
    return table + column.removeprefix(last) if f"{column}_".startswith(f"{last}_") else f"{table}_{column}"
