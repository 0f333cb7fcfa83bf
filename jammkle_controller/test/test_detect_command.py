"""`jammkle detect` as a user calls it: a table in g and deg/s, and input that is wrong."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.reading import namespaces_in
from jammkle_common.command.errors import InputError
from jammkle_common.names import ACHILLES, CHANNELS, JAM_STATE
from jammkle_controller.core.events import Source
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.reading import Received
from jammkle_controller.detect import doubt_of
from jammkle_controller.parameters import ControllerParameters
from jammkle_controller.recordings import Recording, TableFormat, read_bag, read_table, replay
from jammkle_msgs.msg import ChannelJamState, Fault, JamState

if TYPE_CHECKING:
    from collections.abc import Sequence

    from conftest import Streams

COMMAND = Path(sys.executable).with_name("jammkle")


def table(path: Path) -> Path:
    """Write a fall of 0.1 s from rest, at 500 Hz, in g and deg/s, behind a column of force."""
    chance = np.random.default_rng(1)
    force = np.ones(1000)
    force[500:550] = 0.0
    force[550:560] = 4.0
    rows = np.column_stack([100.0 * force, np.zeros((1000, 2)), force, np.zeros((1000, 3))])
    rows[:, 1:] += chance.normal(0.0, 0.003, (1000, 6))
    np.savetxt(path, rows, delimiter=",")
    with path.open("a") as file:
        file.write("100.0,,,,,,\n")  # the force goes on where the IMU has ended
    return path


def at_rest(count: int) -> list[ImuSample]:
    """Return samples of an IMU that lies still, at 500 Hz."""
    rows = np.random.default_rng(1).normal((0.0, 0.0, 9.80665, 0.0, 0.0, 0.0), 0.02, (count, 6))
    return [ImuSample(2_000_000 * index, *row) for index, row in enumerate(rows.tolist())]


def detect(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([COMMAND, "detect", *map(str, arguments)], capture_output=True, text=True, check=False)


def test_a_table_in_g_is_read_and_its_fall_is_reported(tmp_path: Path) -> None:
    """With columns and units given, the fall is a lift-off and an impact at the right time; a picture is left."""
    path = table(tmp_path / "fall.csv")
    units = ("--force", "2,3,4", "--rate", "5,6,7", "--force-unit", "g", "--rate-unit", "deg/s", "--rate-hz", 500)
    answer = detect(path, *units, "--contact-force", 1, "-o", tmp_path / "out")
    assert answer.returncode == 0, answer.stderr
    found = json.loads((tmp_path / "out" / "events.json").read_text())
    assert [event["kind"] for event in found["events"]][:2] == ["lift-off", "impact"]
    assert found["events"][1]["time_s"] == pytest.approx(1.1, abs=0.003)
    assert found["decisions"][-1]["state"] == "stance"
    assert (tmp_path / "out" / "detect.png").read_bytes().startswith(b"\x89PNG")


def bag_of(
    path: Path,
    samples: Sequence[ImuSample],
    namespaces: Sequence[str] = ("",),
    opens_ns: int = 0,
    driver: JamState | None = None,
) -> Path:
    """Write samples as a bag with an IMU per namespace, whatever their units; its switch opens at a time, ns.

    What the driver reports, in no namespace, comes first.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    vector, turn = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Quaternion"]
    stamp, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    nine = np.zeros(9)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            (namespace, name): writer.add_connection(f"{namespace}/{name}", kind, typestore=store)
            for namespace in namespaces
            for name, kind in (("imu/data", "sensor_msgs/msg/Imu"), ("foot_contact", "std_msgs/msg/Bool"))
        }
        if driver is not None:
            kind = JAM_STATE.message_type
            known = get_types_from_msg(MessageDefinitions(share_folders()).find(kind).text, kind)
            store.register({name: fields for name, fields in known.items() if name not in store.types})
            reports = writer.add_connection(f"/{JAM_STATE.name}", kind, typestore=store)
            writer.write(reports, samples[0].time_ns, serialize_message(driver))
        for time_ns, *force_and_rate in samples:
            at = header(stamp(*divmod(time_ns, 10**9)), "imu")
            rate, force = vector(*force_and_rate[3:]), vector(*force_and_rate[:3])
            for (_, name), topic in topics.items():
                make = store.types[topic.msgtype]
                message = make(at, turn(0.0, 0.0, 0.0, 1.0), nine, rate, nine, force, nine) if "imu" in name else None
                if message is None and opens_ns:
                    message = make(time_ns < opens_ns)
                if message is not None:
                    writer.write(topic, time_ns, store.serialize_cdr(message, topic.msgtype))
    return path


def test_of_a_bag_with_one_ankle_the_namespace_need_not_be_given(tmp_path: Path) -> None:
    """Its switch is found, and of several ankles one is asked for, or chosen by the topic of the IMU."""
    samples = [each._replace(time_ns=each.time_ns + 10**9) for each in at_rest(500)]
    one = bag_of(tmp_path / "one", samples, ("/lf_ankle",), opens_ns=15 * 10**8)
    several = bag_of(tmp_path / "several", samples, ("/lf_ankle", "/rf_ankle"), opens_ns=15 * 10**8)
    parameters = ControllerParameters()
    for bag, topic in ((one, ""), (several, "/rf_ankle/imu/data")):
        made = replay(read_bag(bag, topic, None, parameters).received, parameters)
        assert [each.source for each in made.events] == [Source.CONTACT_SWITCH]
    with pytest.raises(InputError, match="/lf_ankle, /rf_ankle; choose one with --namespace"):
        read_bag(several, "", None, parameters)
    assert namespaces_in(["/imu/data", "/lf_ankle/manifold/pressure"]) == ("/lf_ankle",)  # a robot's own IMU is none
    answer = detect(one, "-o", tmp_path / "out")
    assert answer.returncode == 0, answer.stderr
    (event,) = json.loads((tmp_path / "out" / "events.json").read_text())["events"]
    assert event["source"] == "contact switch"


@pytest.mark.parametrize("reservoir_m3", [0.0, 1e-4])
def test_a_recording_lands_with_the_vacuum_that_its_driver_had(
    tmp_path: Path, streams: Streams, reservoir_m3: float
) -> None:
    """As in the graph: with vacuum in store the Achilles pair alone is evacuated for a fall, else all channels are."""
    parameters = ControllerParameters(hang_pitch_deg=30.0)
    samples = streams.sense(streams.drop(150.0, 0.5, 0.2)[0], 500)
    driver = JamState(manifold_vacuum_pa=60e3, reservoir_volume_m3=reservoir_m3)
    driver.header.stamp.nanosec = samples[1].time_ns
    made = replay(
        read_bag(bag_of(tmp_path / "bag", samples[1:], driver=driver), "", None, parameters).received, parameters
    )
    first = next(each.vacuum_pa for each in made.decisions if any(each.vacuum_pa.values()))
    assert {name for name, vacuum_pa in first.items() if vacuum_pa} == ({ACHILLES} if reservoir_m3 else {*CHANNELS})


@pytest.mark.parametrize(
    ("reason", "fault", "held"),
    [("asked by jam_command", 0, True), ("asked by driver/jam", 0, False), ("let go", Fault.COMMANDS_STALE, True)],
)
def test_a_stance_from_before_the_recording_is_held_on(tmp_path: Path, reason: str, fault: int, *, held: bool) -> None:
    """As a controller that is started anew holds it: by what the driver reports first, once the body is at rest."""
    samples = [each._replace(time_ns=each.time_ns + 10**9) for each in at_rest(400)]
    channel = ChannelJamState(channel=ACHILLES, commanded_vacuum_pa=0.0 if fault else 40e3, reason=reason, fault=fault)
    driver = JamState(channels=[channel])
    driver.header.stamp.sec = 1
    parameters = ControllerParameters()
    bag = bag_of(tmp_path / "bag", samples, driver=driver)
    made = replay(read_bag(bag, "", None, parameters).received, parameters)
    assert [each.state for each in made.decisions][1:] == ["stance"] * held


def test_a_bag_in_g_is_read_by_its_units_and_columns_are_refused(tmp_path: Path) -> None:
    """As a table: the fall is reported once the units are said, and what a bag does not have is refused by name."""
    path = table(tmp_path / "fall.csv")
    layout = TableFormat(("2", "3", "4"), ("5", "6", "7"), rate_hz=500.0)
    samples = [each._replace(time_ns=each.time_ns + 10**9) for each in read_table(path, layout).samples]
    bag = bag_of(tmp_path / "bag", samples)
    answer = detect(bag, "--force-unit", "g", "--rate-unit", "deg/s", "-o", tmp_path / "out")
    assert answer.returncode == 0, answer.stderr
    found = json.loads((tmp_path / "out" / "events.json").read_text())
    assert [event["kind"] for event in found["events"]][:2] == ["lift-off", "impact"]
    answer = detect(bag, "--rate-hz", 7, "-o", tmp_path / "out")
    assert answer.returncode == 2
    assert "--force-unit and --rate-unit alone" in answer.stderr
    answer = detect(path, "--rate-hz", 500, "--topic", "/imu", "-o", tmp_path / "out")
    assert "--topic /imu is of bags" in answer.stderr
    answer = detect(tmp_path / "none.csv", "-o", tmp_path / "out")
    assert "none.csv is not there" in answer.stderr


@pytest.mark.parametrize("delimiter", [",", ", ", ";", "\t", " ", "  "])
@pytest.mark.parametrize("head", ["", "ax ay az p/(rad/s;x) q r"])
def test_columns_stand_between_whatever_separates_them(tmp_path: Path, delimiter: str, head: str) -> None:
    path = tmp_path / "walk.txt"
    rows = [head.split(), *[map(str, row) for row in np.eye(6)]] if head else np.eye(6).astype(str)
    path.write_text("\n".join(delimiter.join(row) + delimiter for row in rows))  # many programs end a row so
    force = ("ax", "ay", "az") if head else ("1", "2", "3")
    samples = read_table(path, TableFormat(force, ("4", "5", "6"), rate_hz=100.0)).samples
    assert [(each.force_x, each.force_y) for each in samples[:3]] == [(1.0, 0.0), (0.0, 1.0), (0.0, 0.0)]


@pytest.mark.parametrize("head", ["time,ax,ay,az\n", ""])
def test_a_table_of_a_spreadsheet_is_read_from_its_first_cell_on(tmp_path: Path, head: str) -> None:
    """A byte order mark is no part of the first column's name, and its row is no head."""
    path = tmp_path / "walk.csv"
    path.write_text(f"{head}0.5,1,2,9\n0.6,1,2,9\n", encoding="utf-8-sig")
    layout = TableFormat(("2", "3", "4"), (), time="time" if head else "1")
    assert [each.time_ns for each in read_table(path, layout).samples] == [500_000_000, 600_000_000]


@pytest.mark.parametrize(
    ("mount", "shaken_m_s2", "doubted"), [("foot", 2.0, True), ("foot", 0.1, False), ("body", 2.0, False)]
)
def test_a_foot_that_moves_without_a_step_is_doubted(
    tmp_path: Path, mount: str, shaken_m_s2: float, *, doubted: bool
) -> None:
    """A foot that goes up and down and does not turn gives no event; it is said that steps may be missing, and why."""
    time_s = np.arange(0.0, 5.0, 0.002)
    rows = np.zeros((len(time_s), 6))
    rows[:, 2] = 9.81 + shaken_m_s2 * np.sin(2.0 * np.pi * 2.0 * time_s) * (time_s > 1.0)
    rows += np.random.default_rng(1).normal(0.0, 0.02, rows.shape)
    np.savetxt(tmp_path / "foot.csv", rows, delimiter=",")
    answer = detect(tmp_path / "foot.csv", "--rate-hz", 500, "--mount", mount, "-o", tmp_path / "out")
    assert answer.returncode == 0, answer.stderr
    found = json.loads((tmp_path / "out" / "events.json").read_text())
    assert [event["kind"] for event in found["events"] if event["kind"] in {"impact", "lift-off"}] == []
    assert bool(found["doubt"]) is doubted
    assert ("doubt: " in answer.stdout + answer.stderr) is doubted


@pytest.mark.parametrize("shift_s", [-50.0, 1.7e9])
def test_a_foot_is_doubted_whatever_its_clock_was_set_to(shift_s: float) -> None:
    """Stamps that go back below the first one, or begin before a clock is found, change nothing of the doubt."""
    time_s = np.arange(0.0, 5.0, 0.002)
    rows = np.random.default_rng(1).normal(0.0, 0.02, (len(time_s), 6))
    rows[:, 2] += 9.81 + 2.0 * np.sin(2.0 * np.pi * 2.0 * time_s)
    stamps_ns = np.rint(1e9 * (time_s + shift_s * (time_s > 0.0))).astype(int) + 10**11
    samples = [ImuSample(at_ns, *row) for at_ns, row in zip(stamps_ns.tolist(), rows.tolist(), strict=True)]
    recording = Recording("foot", [Received(each.time_ns, each) for each in samples])
    parameters = ControllerParameters(imu_mount="foot")
    assert "shaken for 5 s" in doubt_of(recording, replay(recording.received, parameters), parameters)


@pytest.mark.parametrize(("rate_hz", "refused"), [(250, False), (2000, True)])
def test_a_rate_that_is_refused_is_named_with_the_one_that_was_measured(
    tmp_path: Path, rate_hz: int, *, refused: bool
) -> None:
    """Rows at 250 Hz that repeat each reading three times are 250 Hz as configured; else both rates are said."""
    rows = np.repeat([[0.0, 0.0, 9.81, 0.0, 0.0, 0.0]] * 250, 3, axis=0)
    rows += np.repeat(np.random.default_rng(1).normal(0.0, 0.02, (250, 6)), 3, axis=0)
    np.savetxt(tmp_path / "foot.csv", rows, delimiter=",")
    answer = detect(tmp_path / "foot.csv", "--rate-hz", 250, "--set", f"imu_rate_hz={rate_hz}", "-o", tmp_path / "out")
    said = " ".join((answer.stdout + answer.stderr).split())
    assert ("detection was unavailable" in said) is refused
    assert all(f"{each} Hz" in said for each in (83, 250, 2000)) is refused


@pytest.mark.parametrize(
    ("extra", "named"),
    [
        (("--rate-hz", 500, "--force-unit", "kg"), "m/s^2, g"),
        ((), "--rate-hz"),
        (("--rate-hz", 500, "--force", "7,8,9"), "row 1"),
        (("--rate-hz", 500, "--contact-force", 77), "it has 7 columns"),
        (("--rate-hz", 1e-308), "0.1 to 1e+06 Hz"),
        (("--rate-hz", "nan"), "0.1 to 1e+06 Hz"),
        (("--rate-hz", 500, "--set", "jam_dely_s=1"), "jam_dely_s"),
        (("--rate-hz", 500, "--mount", "head"), "foot, shank, body"),
    ],
)
def test_wrong_input_is_one_line(tmp_path: Path, extra: tuple[object, ...], named: str) -> None:
    """Whatever is wrong, the exit code is 2 and one line names the value and what would be right."""
    answer = detect(table(tmp_path / "fall.csv"), *extra, "-o", tmp_path / "out")
    assert answer.returncode == 2
    (line,) = answer.stderr.splitlines()
    assert named in line
