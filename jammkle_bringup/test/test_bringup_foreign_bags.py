"""Bags as other people's recorders and tools leave them: one way to read them, for every verb."""

from __future__ import annotations

import csv
import json
import os
import sqlite3
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pytest
import yaml
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

from jammkle_bringup.core.export import export
from jammkle_common.bags.reading import messages, opened
from jammkle_common.bags.storage import zstd
from jammkle_common.command.errors import Interrupted
from jammkle_common.command.main import main
from jammkle_common.names import JAM_STATE, published
from jammkle_gap.ankle.bag import read_bag
from jammkle_gap.core.data import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

STORE = get_typestore(Stores.ROS2_JAZZY)
START_NS = 1_700_000_000 * 10**9
IMU, PRESSURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/FluidPressure"
NO_TIMES = "".join(
    f"  {name}: {{{{sec: 0, nsec: 0}}}}\n" for name in ("deadline", "lifespan", "liveliness_lease_duration")
)
QOS = "- history: 1\n  depth: 10\n  reliability: {}\n  durability: 2\n  liveliness: 1\n" + NO_TIMES
QOS += "  avoid_ros_namespace_conventions: false\n"


class Row(NamedTuple):
    """A message of a bag, and the definition of its type."""

    topic: str
    kind: str
    log_ns: int
    data: bytes
    encoding: str = "cdr"
    language: str = "ros2msg"
    definition: bytes | None = None
    publishers: int = 1
    publisher: str = ""
    """Whose channel it is in, where each has one of its own."""

    @property
    def text(self) -> bytes:
        return (
            STORE.generate_msgdef(self.kind, ros_version=2)[0].encode() if self.definition is None else self.definition
        )


def header(time_ns: int) -> Any:
    stamp = STORE.types["builtin_interfaces/msg/Time"](*divmod(time_ns, 10**9))
    return STORE.types["std_msgs/msg/Header"](stamp, "foot")


def imu(time_ns: int, stamp_ns: int | None = None, topic: str = "/imu/data", lift_m_s2: float = 0.0) -> Row:
    vector, quaternion = (STORE.types[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Quaternion"))
    still, shaken_m_s2 = np.zeros(9), 0.001 * (time_ns // 10**7 % 7)
    stamp = header(time_ns if stamp_ns is None else stamp_ns)
    message = STORE.types[IMU](
        stamp, quaternion(0.0, 0.0, 0.0, 1.0), still, vector(0.0, 0.0, 0.0), still,
        vector(shaken_m_s2, 0.0, 9.81 + lift_m_s2), still,
    )  # fmt: skip
    return Row(topic, IMU, time_ns, bytes(STORE.serialize_cdr(message, IMU)))


def pressure(time_ns: int, stamp_ns: int | None = None) -> Row:
    message = STORE.types[PRESSURE](header(time_ns if stamp_ns is None else stamp_ns), 101_325.0, 0.0)
    return Row("/achilles/pressure", PRESSURE, time_ns, bytes(STORE.serialize_cdr(message, PRESSURE)))


def duty(time_ns: int) -> Row:
    kind = "std_msgs/msg/Float32"
    return Row("/pump/duty", kind, time_ns, bytes(STORE.serialize_cdr(STORE.types[kind](0.5), kind)))


ROWS = [
    make(START_NS + step * 10**7 + place * 10**5)
    for step in range(30)
    for place, make in enumerate((imu, pressure, duty))
]
"""0.3 s of an ankle."""


def write_mcap(path: Path, rows: Sequence[Row], packed: Callable[[bytes], bytes] = bytes, **options: Any) -> None:
    path.parent.mkdir(exist_ok=True)
    with path.open("wb") as stream:
        writer = Writer(stream, **{"chunk_size": 2000, **options})
        writer.start(profile="", library="other")
        schemas: dict[tuple[str, bytes], int] = {}
        channels: dict[tuple[str, int, str], int] = {}
        for row in rows:
            kind = (row.kind, row.text)
            if kind not in schemas:
                schemas[kind] = writer.register_schema(row.kind, row.language, row.text)
            key = (row.topic, schemas[kind], row.publisher)
            if key not in channels:
                hints = {"offered_qos_profiles": row.publishers * QOS.format(1)}
                channels[key] = writer.register_channel(row.topic, row.encoding, schemas[kind], hints)
            writer.add_message(channels[key], row.log_ns, packed(row.data), row.log_ns)
        writer.finish()


def write_sqlite(path: Path, rows: Sequence[Row], packed: Callable[[bytes], bytes] = bytes, *, old: bool) -> None:
    path.parent.mkdir(exist_ok=True)
    base = sqlite3.connect(path)
    base.executescript("""
        CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,
            offered_qos_profiles TEXT);
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
    """)
    if not old:
        base.execute(
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT,"
            " encoded_message_definition TEXT, type_description_hash TEXT)"
        )
    topics = {row.topic: row for row in rows}
    for number, (topic, row) in enumerate(topics.items()):
        base.execute("INSERT INTO topics VALUES(?,?,?,?,?)", (number, topic, row.kind, "cdr", ""))
        if not old:
            base.execute(
                "INSERT INTO message_definitions VALUES(?,?,?,?,?)",
                (number, row.kind, "ros2msg", row.text.decode(), ""),
            )
    for row in rows:
        message = (list(topics).index(row.topic), row.log_ns, packed(row.data))
        base.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?,?,?)", message)
    base.commit()
    base.close()


def write_metadata(folder: Path, files: Sequence[str], rows: Sequence[Row], mode: str = "", qos: Any = "") -> None:
    """Write metadata as of Humble: without hashes of the types, and QoS as text."""
    topics = [
        {
            "topic_metadata": {
                "name": topic, "type": kind, "serialization_format": "cdr", "offered_qos_profiles": qos,
            },
            "message_count": sum(row.topic == topic for row in rows),
        }
        for topic, kind in {row.topic: row.kind for row in rows}.items()
    ]  # fmt: skip
    start_ns = min((row.log_ns for row in rows), default=0)
    span = {
        "starting_time": {"nanoseconds_since_epoch": start_ns},
        "duration": {"nanoseconds": max((row.log_ns for row in rows), default=0) - start_ns},
    }
    content = {
        "version": 5,
        "storage_identifier": "sqlite3" if ".db3" in files[0] else "mcap",
        **span,
        "message_count": len(rows),
        "topics_with_message_count": topics,
        "compression_format": "zstd" if mode else "",
        "compression_mode": mode,
        "relative_file_paths": list(files),
        "files": [{"path": name, **span, "message_count": 0} for name in files],
    }
    folder.mkdir(exist_ok=True)
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": content}))


def zipped(path: Path) -> None:
    path.with_name(f"{path.name}.zstd").write_bytes(zstd.compress(path.read_bytes()))
    path.unlink()


def split(bag: Path, rows: Sequence[Row] = tuple(ROWS)) -> list[str]:
    """Write a bag in three files, and its metadata."""
    thirds = [rows[place * len(rows) // 3 : (place + 1) * len(rows) // 3] for place in range(3)]
    names = [f"bag_{number}.mcap" for number in (0, 2, 10)]
    for name, part in zip(names, thirds, strict=True):
        write_mcap(bag / name, part)
    write_metadata(bag, names, rows)
    return names


def _one_file(**form: Any) -> Callable[[Path], Path]:
    """Return what makes a bag of one MCAP file, in a form; with `mode` or `qos` it has metadata that say so."""
    metadata = {key: form.pop(key) for key in ("mode", "qos") if key in form}

    def make(bag: Path) -> Path:
        write_mcap(bag / "a.mcap", ROWS, **form)
        if metadata:
            write_metadata(bag, ["a.mcap"], ROWS, **metadata)
        return bag

    return make


def _bare(bag: Path) -> Path:
    write_mcap(bag.with_suffix(".mcap"), ROWS)
    return bag.with_suffix(".mcap")


def _file_compressed(bag: Path) -> Path:
    names = split(bag)
    for name in names:
        zipped(bag / name)
    write_metadata(bag, [f"{name}.zstd" for name in names], ROWS, "FILE")
    return bag


def _sqlite(bag: Path) -> Path:
    write_sqlite(bag / "a.db3", ROWS, old=False)
    write_metadata(bag, ["a.db3"], ROWS)
    return bag


def _old_sqlite_compressed(bag: Path) -> Path:
    write_sqlite(bag / "a.db3", ROWS, zstd.compress, old=True)
    return bag


def _split_without_metadata(bag: Path) -> Path:
    split(bag)
    (bag / "metadata.yaml").unlink()
    return bag


def _file_of_another_name(bag: Path) -> Path:
    write_mcap(bag / "mine.mcap", ROWS)
    write_metadata(bag, ["rosbag2_2026_0.mcap"], ROWS)
    return bag


def _file_named_twice(bag: Path) -> Path:
    write_mcap(bag / "a.mcap", ROWS)
    write_metadata(bag, ["a.mcap", "a.mcap"], ROWS)
    return bag


def _broken_metadata(bag: Path) -> Path:
    write_mcap(bag / "a.mcap", ROWS)
    (bag / "metadata.yaml").write_bytes(b"{{: \xff")
    return bag


def _ros1(bag: Path, *, relative: bool = False, odd: Sequence[str] = (), rows: Sequence[Row] = tuple(ROWS)) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    path = bag.with_suffix(".bag")
    with Ros1Writer(path) as writer:
        connections = {
            (row.topic, row.publisher): writer.add_connection(
                row.topic[relative:], row.kind, typestore=store, callerid=row.publisher or None
            )
            for row in {(row.topic, row.publisher): row for row in rows}.values()
        }
        for row in rows:
            message: Any = STORE.deserialize_cdr(row.data, row.kind)
            if hasattr(message, "header"):
                stamp = store.types["builtin_interfaces/msg/Time"](*divmod(row.log_ns, 10**9))
                message.header = store.types["std_msgs/msg/Header"](7, stamp, "foot")
            writer.write(connections[row.topic, row.publisher], row.log_ns, store.serialize_ros1(message, row.kind))
        for place, definition in enumerate(odd):
            connection = writer.add_connection(f"/odd_{place}", "lab_msgs/msg/Odd", msgdef=definition, md5sum="0" * 32)
            writer.write(connection, START_NS, bytes(8))
    return path


FORMS: dict[str, Callable[[Path], Path]] = {
    "of Humble": _one_file(qos=QOS.format(1)),
    "a bare file": _bare,
    "without chunks": _one_file(use_chunking=False),
    "without index": _one_file(index_types=IndexType.NONE, use_statistics=False),
    "without message index": _one_file(index_types=IndexType.CHUNK, compression=CompressionType.LZ4),
    "compressed files": _file_compressed,
    "compressed messages": _one_file(packed=zstd.compress, mode="MESSAGE"),
    "compressed messages, no metadata": _one_file(packed=zstd.compress),
    "SQLite": _sqlite,
    "old SQLite, compressed": _old_sqlite_compressed,
    "split, no metadata": _split_without_metadata,
    "a file of another name": _file_of_another_name,
    "a file named twice": _file_named_twice,
    "other QoS": _one_file(qos=QOS.format(2)),
    "broken QoS": _one_file(qos=[{"reliability": "whatever"}]),
    "broken metadata": _broken_metadata,
    "ROS 1": _ros1,
    "ROS 1, relative names": partial(_ros1, relative=True),
    "without channels in the summary": _one_file(repeat_channels=False, repeat_schemas=False),
}


@pytest.mark.parametrize("make", FORMS.values(), ids=FORMS)
def test_whoever_recorded_a_bag_its_messages_are_the_same(make: Callable[[Path], Path], tmp_path: Path) -> None:
    """They are read, counted in their own time, and written under another name."""
    bag = make(tmp_path / "bag")
    with opened(bag) as reader:
        assert [(each.topic, log_ns, bytes(data)) for each, log_ns, data in messages(reader, bag)] == [
            (row.topic, row.log_ns, row.data) for row in ROWS
        ]
    assert main(["info", str(bag), "--json", str(tmp_path / "info.json")]) == 0
    said = json.loads((tmp_path / "info.json").read_text())
    assert [topic["count"] for topic in said["topics"]] == [30, 30, 30]
    assert said["data_duration_s"] == pytest.approx(0.29, abs=1e-3)
    assert main(["rename", str(bag), "-o", str(tmp_path / "new"), "--topic", "/imu/data=/foot/imu"]) == 0
    with opened(tmp_path / "new") as reader:
        assert [(each.topic, data) for each, _, data in messages(reader, tmp_path / "new")] == [
            (row.topic.replace("/imu/data", "/foot/imu"), row.data) for row in ROWS
        ]


def _middle_missing(bag: Path) -> None:
    (bag / split(bag)[1]).unlink()


def _middle_empty(bag: Path) -> None:
    (bag / split(bag)[1]).write_bytes(bytes(1000))


def _middle_torn(bag: Path) -> None:
    path = bag / split(bag)[1]
    path.write_bytes(path.read_bytes()[:800])


def _fewer_than_counted(bag: Path) -> None:
    write_mcap(bag / "a.mcap", ROWS[:60])
    write_metadata(bag, ["a.mcap"], ROWS)


@pytest.mark.parametrize("make", [_middle_missing, _middle_empty, _middle_torn, _fewer_than_counted])
def test_a_bag_that_lacks_messages_is_never_called_whole(
    make: Callable[[Path], None], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every verb refuses it and names the way out; what is left is a bag after that, which knows what it lacks."""
    bag = tmp_path / "bag"
    make(bag)
    for verb in (["info"], ["export", "-o", str(tmp_path / "out")], ["plot", "-o", str(tmp_path / "out")]):
        assert main([verb[0], str(bag), *verb[1:]]) == 2
        assert f"`jammkle recover {bag}`" in capsys.readouterr().err
    assert main(["recover", str(bag), "--json", str(tmp_path / "done.json")]) == 0
    assert "whole" not in capsys.readouterr().out
    done = json.loads((tmp_path / "done.json").read_text())
    assert done["messages"] + done["lacking"] == len(ROWS)
    assert done["lacking"] >= 20
    assert main(["info", str(bag)]) == 0
    if done["missing"]:
        assert main(["recover", str(bag)]) == 0
        assert "bag_2.mcap is lost" in capsys.readouterr().out


def test_what_nobody_can_recover_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All files missing, a torn archive, a torn database."""
    write_metadata(tmp_path / "gone", ["a.mcap"], ROWS)
    write_mcap(tmp_path / "zip" / "a.mcap", ROWS)
    zipped(tmp_path / "zip" / "a.mcap")
    write_sqlite(tmp_path / "base" / "a.db3", ROWS, old=True)
    for name in ("zip/a.mcap.zstd", "base/a.db3"):
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: len(data) // 2])
    for name in ("gone", "zip", "base"):
        for verb in ("info", "recover"):
            assert main([verb, str(tmp_path / name)]) == 2
            (line,) = capsys.readouterr().err.splitlines()
            assert line.startswith("jammkle: ")


def _foreign(kind: str, definition: bytes, data: bytes = bytes(8), encoding: str = "cdr", language: str = "") -> Row:
    return Row("/other", kind, START_NS, data, encoding, language or "ros2msg", definition)


DEEP = b"lab_msgs/One x\n" + b"=" * 80 + b"\nMSG: lab_msgs/One\nlab_msgs/Zero y"
FOREIGN = {
    "no definition": _foreign("lab_msgs/msg/Secret", b""),
    "a part is missing": _foreign("lab_msgs/msg/Two", b"lab_msgs/One x"),
    "a part of a part is missing": _foreign("lab_msgs/msg/Two", DEEP),
    "no text": _foreign("lab_msgs/msg/Odd", b"int32 % $ \xff"),
    "JSON": _foreign("foxglove.Log", b"{}", b'{"a": 1}', "json", "jsonschema"),
    "our type, otherwise": _foreign(IMU, b"float64 x", bytes(12)),
}


@pytest.mark.parametrize("kind", FOREIGN)
@pytest.mark.parametrize("place", [0, len(ROWS)])
def test_one_topic_that_nobody_can_decode_spoils_no_bag(
    kind: str, place: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is left out and named; `rename` keeps it as it is."""
    bag = tmp_path / "bag"
    write_mcap(bag / "a.mcap", [*ROWS[:place], FOREIGN[kind], *ROWS[place:]])
    out = tmp_path / "out"
    assert main(["export", str(bag), "-o", str(out)]) == 0
    assert "/other is left out: " in capsys.readouterr().err
    assert {path.name for path in out.iterdir()} >= {"imu_data.csv", "achilles_pressure.csv", "pump_duty.csv"}
    assert main(["rename", str(bag), "-o", str(tmp_path / "new"), "--topic", "/pump/duty=/duty"]) == 0
    with opened(tmp_path / "new", quietly=True) as reader:
        assert [each.topic for each in reader.left_out] == ["/other"]
        assert reader.message_count == len(ROWS)


def test_ros_1_may_define_a_type_twice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The second topic of that type is left out, and the rest is read."""
    bag = _ros1(tmp_path / "bag", odd=("float64 x", "int64 y"))
    with opened(bag) as reader:
        assert reader.message_count == len(ROWS) + 1
    assert "/odd_1 is left out: type lab_msgs/msg/Odd in it is defined otherwise" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["plot", "detect"])
def test_a_standard_type_without_its_fields_is_left_out(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A bag may define a type as another distribution or a fork has it: nothing is read of what lacks a field."""
    bag = tmp_path / "bag"
    others = [row for row in ROWS if row.kind != IMU]
    write_mcap(bag / "a.mcap", [*others, FOREIGN["our type, otherwise"]._replace(topic="/imu/data")])
    out = {"plot": tmp_path / "run.png", "detect": tmp_path / "out"}[verb]
    status = main([verb, str(bag), "-o", str(out)])
    assert status == {"plot": 0, "detect": 2}[verb]
    said = capsys.readouterr().err
    assert "/imu/data is left out: sensor_msgs/msg/Imu has no field 'header'" in said
    assert "Traceback" not in said


def test_bags_of_older_releases_lack_fields_of_ours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They are read as far as they go."""
    definition = b"std_msgs/Header header\nbool emergency_stopped\n" + b"=" * 80
    definition += b"\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    old = _foreign(JAM_STATE.message_type, definition)._replace(topic="/jam_state")
    write_mcap(tmp_path / "bag" / "a.mcap", [*ROWS, old])
    with opened(tmp_path / "bag") as reader:
        assert [each.topic for each in reader.on(["/jam_state"])] == ["/jam_state"]
    assert "left out" not in capsys.readouterr().err


YEAR_NS = 365 * 86_400 * 10**9


def _stamped(change: Callable[[int, int], int]) -> list[Row]:
    """Give the IMU of a bag other stamps, by the number of the row and its log time, ns."""
    return [imu(row.log_ns, change(place, row.log_ns)) if row.kind == IMU else row for place, row in enumerate(ROWS)]


ODD_TIMES = {
    "zero stamps": (_stamped(lambda _, log_ns: 0 * log_ns), "/imu/data are zero"),
    "stamps that stand still": (_stamped(lambda _, log_ns: START_NS + 0 * log_ns), "/imu/data stand still"),
    "a clock since boot": (_stamped(lambda _, log_ns: log_ns - START_NS + 10**9), "shifted onto it"),
    "a clock of the future": (_stamped(lambda _, log_ns: log_ns + 12 * YEAR_NS), "shifted onto it"),
    "one stamp of the future": (_stamped(lambda place, log_ns: log_ns + (place == 42) * YEAR_NS), "1 of /imu/data"),
    "one stamp of the past": (_stamped(lambda place, log_ns: log_ns - (place == 42) * YEAR_NS), "1 of /imu/data"),
    "log times of zero at the start": (
        [row._replace(log_ns=0) if place < 4 else row for place, row in enumerate(ROWS)],
        "log times at its start",
    ),
    "the log on another clock": ([row._replace(log_ns=row.log_ns + YEAR_NS) for row in ROWS], ""),
    "a log four times as slow": (
        [row._replace(log_ns=YEAR_NS + START_NS + (row.log_ns - START_NS) * 4) for row in ROWS],
        "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", ODD_TIMES)
def test_a_topic_or_a_stamp_that_lies_apart_is_named_and_bounded(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All verbs see the 0.29 s that were recorded, with all samples of the IMU in their places."""
    rows, said = ODD_TIMES[kind]
    bag = tmp_path / "bag"
    write_mcap(bag / "a.mcap", rows)
    assert main(["export", str(bag), "-o", str(tmp_path / "out"), "--rate-hz", "100"]) == 0
    assert said in capsys.readouterr().err
    with (tmp_path / "out" / "run.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert 29 <= len(table) <= 31
    assert sum(bool(row["imu_data_linear_acceleration_z_m_s2"]) for row in table) >= 28
    assert sum(bool(row["pump_duty"]) for row in table) >= 28
    assert main(["info", str(bag), "--json", str(tmp_path / "info.json")]) == 0
    assert json.loads((tmp_path / "info.json").read_text())["data_duration_s"] == pytest.approx(0.29, abs=0.011)
    assert main(["detect", str(bag), "-o", str(tmp_path), "--json", str(tmp_path / "events.json")]) == 0
    assert json.loads((tmp_path / "events.json").read_text())["samples"]["usable"] >= 28


def test_stamps_from_before_the_first_step_of_a_simulation_are_as_right_as_its_clock(
    bag_maker: Callable[[str], Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Many at the clock's zero, as every node reports before the first step: no note. Zeros that stay are named."""
    maker = bag_maker("bag")
    for step in range(130):
        now_s = max(0.0, (step - 30) * 0.01)
        maker.write("/clock", now_s, maker.clock(now_s))
        maker.write("/stamped", now_s, maker.pressure(now_s, 1e5))
        maker.write("/unset", now_s, maker.pressure(0.0, 1e5))
    assert main(["info", str(maker.close()), "--json", str(tmp_path / "info.json")]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "/unset are zero" in line
    found = {each["name"]: each["rate_by"] for each in json.loads((tmp_path / "info.json").read_text())["topics"]}
    assert found == {"/clock": "stamp", "/stamped": "stamp", "/unset": "/clock"}


def test_a_clock_that_was_set_makes_no_rows_of_years(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The hole is named; the rows before and after it are there."""
    rows = [*ROWS, *(make(row.log_ns + 3 * YEAR_NS) for row in ROWS for make in (imu, pressure))]
    write_mcap(tmp_path / "bag" / "a.mcap", rows)
    assert main(["export", str(tmp_path / "bag"), "-o", str(tmp_path / "out"), "--rate-hz", "100"]) == 0
    said = capsys.readouterr().err
    assert "step of 1095.0 days" in said
    assert "there are no rows of it" in said
    with (tmp_path / "out" / "run.csv").open(newline="") as file:
        times_s = [float(row["time_s"]) for row in csv.DictReader(file)]
    assert len(times_s) == pytest.approx(60, abs=3)
    assert times_s[-1] == pytest.approx(3 * YEAR_NS * 1e-9 + 0.29, abs=0.02)


SET_BACK: dict[str, Callable[[Path, list[Row]], object]] = {
    "MCAP": lambda bag, rows: write_mcap(bag / "a.mcap", rows),
    "MCAP without message index": lambda bag, rows: write_mcap(bag / "a.mcap", rows, index_types=IndexType.CHUNK),
    "MCAP without chunks": lambda bag, rows: write_mcap(bag / "a.mcap", rows, use_chunking=False),
    "SQLite": lambda bag, rows: write_sqlite(bag / "a.db3", rows, old=False),
    "ROS 1": lambda bag, rows: _ros1(bag, rows=rows),
    "split": lambda bag, rows: [
        write_mcap(bag / name, part) for name, part in (("b.mcap", rows[:600]), ("a.mcap", rows[600:]))
    ],
}


@pytest.mark.parametrize("kind", SET_BACK)
@pytest.mark.parametrize("by_s", [3.0, 0.5])
def test_a_clock_that_was_set_back_is_noticed(
    kind: str, by_s: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Log and stamps go back while it is recorded, by less than that lasts: in one order by log nothing shows it."""
    rows = [
        make(START_NS + step * 10**7 - (step >= 300) * round(by_s * 1e9)) for step in range(600) for make in (imu, duty)
    ]
    SET_BACK[kind](tmp_path / "bag", rows)
    bag = tmp_path / ("bag.bag" if kind == "ROS 1" else "bag")
    back = f"goes back by {by_s - 0.01:.3f} s in the order in which it was written"
    assert main(["info", str(bag)]) == 0
    assert back in capsys.readouterr().err
    assert main(["export", str(bag), "-o", str(tmp_path / "out"), "--rate-hz", "100"]) == 2
    assert back in capsys.readouterr().err
    with pytest.raises(BadRecordingError, match=back):
        read_bag(bag)


def test_two_publishers_with_clocks_of_their_own_are_no_clock_that_was_set_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a recorder that logs when each message was published, by the clock of the machine that it came from."""
    rows = [*ROWS]
    for place in range(10):
        late_ns = START_NS + place * 10**7 - 10**9 * (place % 2)
        rows.append(imu(late_ns, topic="/both"))
    write_mcap(tmp_path / "bag" / "a.mcap", rows)
    assert main(["export", str(tmp_path / "bag"), "-o", str(tmp_path / "out"), "--rate-hz", "100"]) == 0
    assert "goes back" not in capsys.readouterr().err


def test_two_recorders_of_one_time_need_no_clock_that_was_set_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Their files were put into one folder: what is said of them is true of both cases."""
    for name, rows in (("a.mcap", ROWS), ("b.mcap", [row._replace(log_ns=row.log_ns + 10**8) for row in ROWS])):
        write_mcap(tmp_path / "bag" / name, rows)
    assert main(["info", str(tmp_path / "bag")]) == 0
    said = capsys.readouterr().err
    assert "goes back by 0.190 s" in said
    assert "or two recordings of one time were put into one bag" in said


@pytest.mark.parametrize("kind", ["MCAP", "ROS 1"])
def test_channels_of_several_publishers_are_no_clock_that_was_set_back(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """ROS 1, and what is converted from it, has a channel for each publisher of a topic, with an index of its own."""
    rows = [
        imu(START_NS + step * 10**7 + place * 10**6)._replace(publisher=who)
        for step in range(60)
        for place, who in enumerate(("/front", "/back"))
    ]
    if kind == "MCAP":
        write_mcap(tmp_path / "bag" / "a.mcap", rows, chunk_size=10**6)
    bag = _ros1(tmp_path / "bag", rows=rows) if kind == "ROS 1" else tmp_path / "bag"
    assert main(["info", str(bag)]) == 0
    assert "goes back" not in capsys.readouterr().err


def test_two_runs_of_the_same_times_are_not_put_into_one_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recording that was played twice, and recorded again."""
    twice = [imu(START_NS + 10**7 * place, START_NS + 10**7 * (place % 300)) for place in range(600)]
    write_mcap(tmp_path / "bag" / "a.mcap", twice)
    assert main(["export", str(tmp_path / "bag"), "-o", str(tmp_path / "out"), "--rate-hz", "100"]) == 2
    assert "goes back by 2.990 s" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main(["export", str(tmp_path / "bag"), "-o", str(tmp_path / "out")]) == 0


def test_several_publishers_of_a_topic_are_not_taken_for_two_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Reports of nodes, one of which knows no time yet, and readings of two publishers, one of which is late."""
    kind = "diagnostic_msgs/msg/DiagnosticArray"
    late_ns = [time_ns - 5 * 10**9 * (place % 2) for place, time_ns in enumerate(range(START_NS, START_NS + 30, 3))]
    rows = [*ROWS]
    for place, time_ns in enumerate(late_ns):
        log_ns = START_NS + 10**7 * place
        report = STORE.types[kind](header(time_ns), [])
        rows.append(Row("/diagnostics", kind, log_ns, bytes(STORE.serialize_cdr(report, kind))))
        rows.append(imu(log_ns, time_ns, topic="/both")._replace(publishers=2))
    write_mcap(tmp_path / "bag" / "a.mcap", sorted(rows, key=lambda row: row.log_ns))
    assert main(["export", str(tmp_path / "bag"), "-o", str(tmp_path / "out"), "--rate-hz", "100"]) == 0
    assert "goes back" not in capsys.readouterr().err


def test_a_clock_that_goes_back_is_that_of_two_runs(
    bag_maker: Callable[[str], Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A simulation that was reset."""
    maker = bag_maker("bag")
    for step in range(1000):
        now_s = step % 500 * 0.01
        maker.write("/clock", step * 0.01, maker.clock(now_s))
        maker.write("/achilles/pressure", step * 0.01, maker.pressure(now_s, 1e5))
    assert main(["export", str(maker.close()), "-o", str(tmp_path / "out"), "--rate-hz", "100"]) == 2
    assert "the time of /clock goes back by 4.990 s" in capsys.readouterr().err


@pytest.mark.parametrize("has_clock", [True, False])
def test_what_is_latched_from_before_a_bag_has_the_time_of_its_begin(
    bag_maker: Callable[[str], Any], tmp_path: Path, capsys: pytest.CaptureFixture[str], *, has_clock: bool
) -> None:
    """As rosbag2 logs it, when it comes; its stamp counts neither for the duration, nor is it odd."""
    maker = bag_maker("bag")
    maker.write("/jam_state", 100.0, maker.jam_state(20.0, 1, 0.0, "achilles"), published(JAM_STATE))
    for step in range(301):
        now_s = 100.0 + step * 0.01
        if has_clock:
            maker.write("/clock", now_s, maker.clock(now_s))
        maker.write("/achilles/pressure", now_s, maker.pressure(now_s, 1e5))
    maker.write("/jam_state", 103.0, maker.jam_state(103.0, 1, 0.0, "achilles"))
    bag, said = maker.close(), tmp_path / "info.json"
    assert main(["info", str(bag), "--json", str(said)]) == 0
    info = json.loads(said.read_text())
    assert (info["start_s"], info["duration_s"]) == (100.0, 3.0)
    assert info["data_duration_s"] == pytest.approx(3.0)
    assert main(["export", str(bag), "-o", str(tmp_path / "out"), "--rate-hz", "100"]) == 0
    with (tmp_path / "out" / "run.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == 301
    assert not capsys.readouterr().err


def test_an_export_ends_when_it_is_asked_to(tmp_path: Path) -> None:
    """Also where a single message makes many rows."""
    write_mcap(tmp_path / "bag" / "a.mcap", [imu(START_NS), imu(START_NS + 500 * 10**9)])
    asked = iter([False])
    (tmp_path / "out").mkdir()
    with pytest.raises(Interrupted):
        export(tmp_path / "bag", tmp_path / "out", "csv", 10_000.0, lambda _: None, lambda: next(asked, True))


@pytest.mark.parametrize("rate", [(), ("--rate-hz", "100")])
def test_topics_of_one_name_in_a_table_keep_apart(rate: tuple[str, ...], tmp_path: Path) -> None:
    """`/imu/data` and `/imu_data`; a field of one topic, and a topic below it."""
    rows = [*ROWS, *(imu(row.log_ns + 1, topic="/imu_data", lift_m_s2=1000.0) for row in ROWS)]
    kind = "geometry_msgs/msg/Point"
    point = bytes(STORE.serialize_cdr(STORE.types[kind](5.0, 5.0, 5.0), kind))
    rows += [Row("/imu_data/linear_acceleration", kind, row.log_ns, point) for row in ROWS]
    write_mcap(tmp_path / "bag" / "a.mcap", rows)
    assert main(["export", str(tmp_path / "bag"), "-o", str(tmp_path / "out"), *rate]) == 0
    found: dict[str, set[float]] = {}
    for path in (tmp_path / "out").glob("*.csv"):
        with path.open(newline="") as file:
            for row in csv.DictReader(file):
                for column, text in row.items():
                    if "acceleration_z" in column or column == "z":
                        found.setdefault(f"{path.stem}/{column}", set()).update([float(text)] if text else [])
    assert sorted(values for each in found.values() for values in each) == [5.0, 9.81, 1009.81]


def test_a_message_that_is_cut_is_left_out_and_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A topic that nobody asked for does not spoil the tables of the others."""
    cut = [Row("/other", PRESSURE, row.log_ns, row.data[:9]) for row in ROWS[:5]]
    write_mcap(tmp_path / "bag" / "a.mcap", [*ROWS, *cut])
    assert main(["export", str(tmp_path / "bag"), "-o", str(tmp_path / "out")]) == 0
    assert "5 messages of /other cannot be decoded" in capsys.readouterr().err


def test_a_folder_may_have_a_name_that_is_no_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Bytes that are none in UTF-8, as of an old disk: every verb reads such a bag and writes into such a folder."""
    bag, out = (tmp_path / os.fsdecode(name) for name in (b"bag\xff", b"out\xfe"))
    write_mcap(bag / "a.mcap", ROWS)
    for verb in (["info"], ["recover"], ["export", "-o", f"{out}_export"], ["export", "-o", f"{out}_p", "--parquet"]):
        assert main([verb[0], str(bag), *verb[1:]]) == 0
    assert main(["detect", str(bag), "-o", f"{out}_detect"]) == 0
    assert main(["plot", str(bag), "-o", f"{out}_plot", "--json", f"{out}.json"]) == 0
    assert main(["rename", str(bag), "-o", f"{out}_new", "--topic", "/pump/duty=/duty"]) == 0
    assert main(["info", f"{out}_new"]) == 0
    assert main(["info", f"{out}_none"]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_bag_without_a_run_sheet_gets_a_template(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is printed is the file to be written; once it is there, nothing more is asked for."""
    write_mcap(tmp_path / "bag" / "bag_0.mcap", ROWS)
    write_metadata(tmp_path / "bag", ["bag_0.mcap"], ROWS)
    assert main(["info", str(tmp_path / "bag")]) == 0
    printed = capsys.readouterr().out
    template = printed[printed.index("# run.yaml") :]
    assert yaml.safe_load(template)["rig"] == "drop"
    (tmp_path / "bag" / "run.yaml").write_text(template)
    assert main(["info", str(tmp_path / "bag")]) == 0
    assert "run.yaml" not in capsys.readouterr().out
