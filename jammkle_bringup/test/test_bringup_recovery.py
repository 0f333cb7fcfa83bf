"""What is left of a bag whose recorder was killed or found no room, and how it is made whole."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.highlevel import AnyReader

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.recovery import recover, scanned
from jammkle_common.bags.writing import BagLog
from jammkle_common.command.main import main

if TYPE_CHECKING:
    from pathlib import Path

FILL_THE_DISK = """
import subprocess, sys
from pathlib import Path
from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.writing import BagLog
from jammkle_common.command.errors import GraphError
from rosbags.highlevel import AnyReader

disk = Path(sys.argv[1])
subprocess.run(["mount", "-t", "tmpfs", "-o", "size=400k", "none", str(disk)], check=True)
log = BagLog(disk / "bag", MessageDefinitions(share_folders()))
log.add_topic("/chatter", "std_msgs/msg/String", lambda: [])
written = 0
try:
    while True:
        log.write("/chatter", bytes(int(sys.argv[2])), written)
        written += 1
        if written % 10 == 0:
            log.flush()
except OSError:
    pass
try:
    log.close()
except GraphError as error:
    print(error)
assert (disk / "bag" / "metadata.yaml").is_file()
with AnyReader([disk / "bag"]) as reader:
    assert len(list(reader.messages())) == reader.message_count
    print(written, reader.message_count)
"""


def contents(bag: Path) -> list[tuple[str, int, bytes]]:
    """Topic, log time and data of every message."""
    with AnyReader([bag]) as reader:
        return [(connection.topic, log_ns, bytes(data)) for connection, log_ns, data in reader.messages()]


@pytest.fixture
def torn(tmp_path: Path) -> Path:
    """Make the bag of a recorder that died after 60 messages of two topics in six chunks."""
    log = BagLog(tmp_path / "torn", MessageDefinitions(share_folders()))
    for topic in ("/left", "/right"):
        log.add_topic(topic, "std_msgs/msg/Float32", list)
    log.set_custom_data("sim_parameters", "rig: drop")
    for number in range(30):
        for topic in ("/left", "/right"):
            log.write(topic, b"\0\1\0\0" + bytes([number, 0, 0, 0]), number * 10**7)
        if number % 5 == 4:
            log.flush()
    shutil.copytree(tmp_path / "torn", tmp_path / "dead")
    log.close()
    return tmp_path / "dead"


def write_numbers(path: Path, count: int, **options: Any) -> tuple[int, list[tuple[int, bytes]]]:
    """Write an MCAP file of one topic with mcap's own writer; return its channel, log times, ns, and data."""
    whole = [(10**18 + number, b"\0\1\0\0" + struct.pack("<d", 1.5 + number)) for number in range(count)]
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/level", "cdr", schema)
        for log_ns, data in whole:
            writer.add_message(channel, log_ns, data, log_ns)
        writer.finish()
    return channel, whole


def test_what_was_flushed_is_whole_after_recovery(torn: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`info` names `recover`; then all is there for three readers, custom data, counts and hashes included."""
    assert main(["info", str(torn)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"`jammkle recover {torn}`" in line
    assert main(["recover", str(torn)]) == 0
    assert "60 messages in 0.290 s; it is whole now" in capsys.readouterr().out
    assert contents(torn) == contents(torn.with_name("torn"))
    with (torn / "torn.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == 60
        summary = reader.get_summary()
        assert summary is not None
        assert (summary.statistics.message_count, len(summary.chunk_indexes)) == (60, 6)
    infos = {}
    for name in ("dead", "torn"):
        assert main(["info", str(torn.with_name(name)), "--json", str(torn.with_name("info.json"))]) == 0
        infos[name] = json.loads(torn.with_name("info.json").read_text())
        del infos[name]["bag"]
    assert infos["dead"] == infos["torn"]
    assert infos["dead"]["custom_data"] == {"sim_parameters": "rig: drop"}
    capsys.readouterr()
    before = (torn / "torn.mcap").read_bytes()
    assert main(["recover", str(torn)]) == 0
    assert "nothing was to be done" in capsys.readouterr().out
    assert (torn / "torn.mcap").read_bytes() == before


def test_wherever_a_bag_is_cut_it_is_recovered_up_to_there(torn: Path) -> None:
    """Cut inside a head, a chunk, an index, the ending: a beginning of the messages is there, all that were whole."""
    whole, file = contents(torn.with_name("torn")), torn / "torn.mcap"
    data = (torn.with_name("torn") / "torn.mcap").read_bytes()
    first = data.index(b"/left")
    counts = []
    for length in range(first - 400, len(data), 97):
        file.write_bytes(data[:length] + bytes(length % 20 if length % 3 == 0 else 0))  # zeros: power was lost
        (torn / "metadata.yaml").unlink(missing_ok=True)
        done = recover(torn, lambda _: None)
        found = contents(torn) if done.messages else []
        assert found == whole[: len(found)]
        assert len(found) == done.messages
        counts.append(len(found))
    assert (counts[0], counts[-1]) == (0, 60)
    assert 0 <= np.diff(counts).min() <= np.diff(counts).max() <= 3  # as many messages as 97 bytes hold


def test_a_torn_file_without_chunks_is_recovered_up_to_there(tmp_path: Path) -> None:
    """As `ros2 bag record --storage-preset-profile fastwrite` leaves it: wherever it was cut, whole messages stay."""
    path = tmp_path / "bag.mcap"
    channel, whole = write_numbers(path, 30, use_chunking=False)
    data = path.read_bytes()
    each, end = 43, data.index(b"\x0f" + struct.pack("<Q", 4))  # kind and length, four numbers, data; end of the data
    begin = end - each * len(whole)
    for cut in range(begin + each, end + 20, 13):
        path.write_bytes(data[:cut])
        done = recover(path, lambda _: None)
        count = min((cut - begin) // each, len(whole))
        assert (done.messages, done.torn_bytes) == (count, cut - begin - count * each if cut < end else cut - end)
        with path.open("rb") as stream:
            reader = make_reader(stream)
            assert [(message.log_time, message.data) for _, _, message in reader.iter_messages()] == whole[:count]
            summary = reader.get_summary()
            assert summary is not None
            counted = summary.statistics
            assert (counted.message_count, counted.channel_message_counts) == (count, {channel: count})
            assert (counted.message_start_time, counted.message_end_time) == (whole[0][0], whole[count - 1][0])


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
def test_zeros_of_a_file_system_are_no_part_of_a_message(tmp_path: Path, compression: CompressionType) -> None:
    """Wherever a crash left zeros in place of what was not written, no message is made up of them."""
    path = tmp_path / "bag.mcap"
    _, whole = write_numbers(path, 40, compression=compression, chunk_size=500)
    data = path.read_bytes()
    for cut in range(900, 1600, 7):
        path.write_bytes(data[:cut] + bytes(4096))
        recover(path, lambda _: None)
        found = [(log_ns, message) for _, log_ns, message in contents(path)]
        assert 0 < len(found) <= len(whole)
        assert found == whole[: len(found)]


@pytest.mark.parametrize("index_types", [IndexType.ALL, IndexType.CHUNK], ids=["", "without message index"])
def test_attachments_and_metadata_of_a_torn_file_are_still_found(tmp_path: Path, index_types: IndexType) -> None:
    """What other recorders put beside the messages, before, between and after the chunks; cut where it was torn."""
    path, ends = tmp_path / "bag.mcap", []
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=100, index_types=index_types)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/level", "cdr", schema)
        for number in range(4):
            writer.add_attachment(number, number, f"map {number}", "text/plain", b"grey" * (1 + number))
            writer.add_metadata(f"robot {number}", {"serial": str(number)})
            ends.append(stream.tell())
            for step in range(10):
                writer.add_message(channel, 10 * number + step, b"\0\1\0\0" + bytes(8), 0)
        writer.add_attachment(4, 4, "map 4", "text/plain", b"grey" * 5)
        writer.add_metadata("robot 4", {"serial": "4"})
        ends.append(stream.tell())
        writer.finish()
    data = path.read_bytes()
    cuts = [(end - 3, count + 1, count) for count, end in enumerate(ends)]  # in the middle of metadata
    cuts += [(end, count, count) for count, end in enumerate(ends, 1)] + [(len(data) - 9, 5, 5)]
    for cut, attachments, metadata in cuts:
        path.write_bytes(data[:cut])
        recover(path, lambda _: None)
        with path.open("rb") as stream:
            reader = make_reader(stream)
            assert [(each.name, each.data) for each in reader.iter_attachments()] == [
                (f"map {number}", b"grey" * (1 + number)) for number in range(attachments)
            ]
            assert [(each.name, each.metadata) for each in reader.iter_metadata()] == [
                (f"robot {number}", {"serial": str(number)}) for number in range(metadata)
            ]
            summary = reader.get_summary()
            assert summary is not None
            counted = summary.statistics
            assert (counted.attachment_count, counted.metadata_count) == (attachments, metadata)


def test_a_torn_chunk_that_is_compressed_is_left_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a message that could be read nothing is cut off, also of a copy: others may still get something out."""
    file = tmp_path / "copied.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start()
        channel = writer.register_channel(
            "/noise", "cdr", writer.register_schema("std_msgs/msg/Float32", "ros2msg", b"")
        )
        for number, data in enumerate(
            np.random.default_rng(1).bytes(8 * 500)[place : place + 8] for place in range(500)
        ):
            writer.add_message(channel, number * 10**6, data, number * 10**6)
        writer.finish()
    whole = file.read_bytes()
    torn = whole[:1000]
    file.write_bytes(torn)
    for place in ([], ["-o", str(tmp_path / "copy")]):
        assert main(["recover", str(file), *place]) == 2
        assert f"{file} cannot be recovered" in (said := capsys.readouterr().err)
        assert "its only chunk is compressed" in said
    assert file.read_bytes() == torn
    assert not (tmp_path / "copy").exists()
    (tmp_path / "split").mkdir()
    for place, data in enumerate((whole, torn)):  # the other file of a bag is worth having
        (tmp_path / "split" / f"split_{place}.mcap").write_bytes(data)
    assert main(["recover", str(tmp_path / "split")]) == 0
    assert "500 messages" in capsys.readouterr().out


def pressures(log: BagLog, topic: str, log_ns: int, stamp_ns: int) -> None:
    """Write a pressure that was logged at one time and stamped with another."""
    stamp = struct.pack("<iI", *divmod(stamp_ns, 10**9))
    log.write(topic, b"\0\1\0\0" + stamp + struct.pack("<I", 1) + bytes(4) + struct.pack("<dd", 1e5, 0.0), log_ns)


DAY_NS, SECOND_NS = 24 * 3600 * 10**9, 10**9
ODD_TIMES = {  # which messages of 100, 0.1 s apart; shifts of log and stamps, ns; what is said; span of the data, s
    "the log is zero for 2 s": (range(20), -20_000 * DAY_NS, 0, "log times at its start lie 20000.0 days before", 9.9),
    "the log is zero for 3 s": (range(30), -20_000 * DAY_NS, 0, "log times at its start lie 20000.0 days before", 9.9),
    "the log is zero for two messages": (range(2), -20_000 * DAY_NS, 0, "log times at its start lie 20000.0 days", 9.9),
    "the log was set, stamps were not": (range(80, 100), 3 * DAY_NS, 0, "log times after its step 1 lie 3.0 days", 9.9),
    "the clock was set": (range(80, 100), 3 * DAY_NS, 3 * DAY_NS, "its log makes a step of 3.0 days", 259_209.9),
}


@pytest.mark.parametrize("boot", [False, True], ids=["", "beside a topic on its boot clock"])
@pytest.mark.parametrize("case", ODD_TIMES)
def test_recover_judges_times_as_info_does(
    *,
    case: str,
    boot: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a log that lies apart, both name what does, and say how long the data themselves are."""
    moved, log_shift_ns, stamp_shift_ns, named, span_s = ODD_TIMES[case]
    log = BagLog(tmp_path / "bag", MessageDefinitions(share_folders()))
    for topic in ("/pressure", "/boot"):
        log.add_topic(topic, "sensor_msgs/msg/FluidPressure", list)
    for number in range(100):
        now_ns = 20_000 * DAY_NS + number * SECOND_NS // 10
        log_ns = now_ns + (number in moved) * log_shift_ns
        pressures(log, "/pressure", log_ns, now_ns + (number in moved) * stamp_shift_ns)
        if boot:
            pressures(log, "/boot", log_ns, now_ns + (number in moved) * stamp_shift_ns - 20_000 * DAY_NS + 1)
    log.close()
    for verb in ("info", "recover"):
        monkeypatch.setattr("jammkle_common.command.results._said", set())
        assert main([verb, str(tmp_path / "bag"), "--json", str(tmp_path / f"{verb}.json")]) == 0
        said = capsys.readouterr().err
        assert named in said
        assert ("the stamps of /boot lie" in said) == boot
        assert len(said.splitlines()) == 1 + boot
        found = json.loads((tmp_path / f"{verb}.json").read_text())
        assert found["data_duration_s"] == pytest.approx(span_s)


def test_a_log_of_zeros_without_any_stamp_is_no_span_of_years(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What has no stamp and was logged before a clock was found counts as the start."""
    log = BagLog(tmp_path / "bag", MessageDefinitions(share_folders()))
    log.add_topic("/duty", "std_msgs/msg/Float32", list)
    for number in range(50):
        log.write("/duty", b"\0\1\0\0" + bytes(4), 0 if number < 10 else 20_000 * DAY_NS + number * SECOND_NS)
    log.close()
    assert main(["recover", str(tmp_path / "bag")]) == 0
    said = capsys.readouterr()
    assert "its data span 39.000 s by their own clock" in said.out
    assert "log times at its start lie 20000.0 days before the rest" in said.err


def test_recover_names_a_topic_on_another_clock(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One topic on its boot clock is named with how far it lies apart, while the rest agrees with the log."""
    log = BagLog(tmp_path / "bag", MessageDefinitions(share_folders()))
    for topic in ("/a", "/b", "/boot"):
        log.add_topic(topic, "sensor_msgs/msg/FluidPressure", list)
    for number in range(30):
        now_ns = 20_000 * DAY_NS + number * SECOND_NS // 10
        for topic in ("/a", "/b", "/boot"):
            pressures(log, topic, now_ns, now_ns - (20_000 * DAY_NS - SECOND_NS) * (topic == "/boot"))
    log.close()
    assert main(["recover", str(tmp_path / "bag")]) == 0
    assert "the stamps of /boot lie 1727999999.000 s before the rest" in capsys.readouterr().err


def test_the_torn_bag_stays_where_another_folder_is_asked_for(torn: Path, tmp_path: Path) -> None:
    """With -o the whole bag goes there, and what was torn is as it was."""
    before = {path.name: path.read_bytes() for path in torn.iterdir()}
    assert main(["recover", str(torn), "-o", str(tmp_path / "whole")]) == 0
    assert {path.name: path.read_bytes() for path in torn.iterdir()} == before
    assert len(contents(tmp_path / "whole")) == 60
    assert main(["recover", str(torn), "-o", str(tmp_path / "whole")]) == 2


def test_what_cannot_be_recovered_is_refused(torn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No bag, no MCAP, a bag that is being recorded, damage before the end: one line, and nothing is changed."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mcap").write_text("just text")
    with (torn / "torn.mcap").open("r+b") as stream:
        begin = scanned(stream, lambda _: None).chunks[2].index.chunk_start_offset
        stream.seek(begin)
        stream.write(b"\x70")
    log = BagLog(tmp_path / "running", MessageDefinitions(share_folders()))
    refused = {
        "none": "does not exist",
        "empty": "no file *.mcap",
        "text.mcap": "no file of it begins as MCAP or SQLite does",
        "running": "being recorded",
        "dead": f"damaged at byte {begin}",
    }
    before = (torn / "torn.mcap").read_bytes()
    for name, said in refused.items():
        assert main(["recover", str(tmp_path / name)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line
    for output, said in ((tmp_path / "new", "is damaged"), (tmp_path / "text.mcap" / "new", "--output")):
        assert main(["recover", str(torn), "-o", str(output)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line
        assert not output.exists()
    assert (torn / "torn.mcap").read_bytes() == before
    assert main(["info", str(tmp_path / "running")]) == 2
    assert "still being recorded" in capsys.readouterr().err
    log.close()


@pytest.mark.parametrize("size", [200, 9000])
def test_a_full_disk_leaves_a_whole_bag(tmp_path: Path, size: int) -> None:
    """On a real file system without room, the bag is ended where writing failed; what that costs is said."""
    enter = ["unshare", "--map-root-user", "--mount"]
    if subprocess.run(
        [*enter, "mount", "-t", "tmpfs", "none", str(tmp_path)], check=False, capture_output=True
    ).returncode:
        pytest.skip("no file system can be mounted here")
    script = [*enter, sys.executable, "-c", FILL_THE_DISK, str(tmp_path), str(size)]
    done = subprocess.run(script, check=True, capture_output=True, text=True)
    line, counts = done.stdout.splitlines()
    written, there = map(int, counts.split())
    assert "No space left on device; it is whole up to there" in line
    assert f"with {there} messages" in line
    assert 0 < there <= written
    room_of_an_ending, unflushed = 64 * 1024, 10
    assert (written - there - unflushed) * size < room_of_an_ending
