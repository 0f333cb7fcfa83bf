"""Bags of other recorders: standard types, other clocks and names, begun before or in the middle of a run."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from jammkle_common import names
from jammkle_gap.ankle.bag import Bag, Samples, read_bag
from jammkle_gap.ankle.recording import bag_of_run, load_recording, recording_of, signals_of
from jammkle_gap.core.data import BadRecordingError
from recorded import ACHILLES, SIMULATOR, bag, bias_of, run, unbiased

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_sim.rigs.run import RigRun


STORE = get_typestore(Stores.ROS2_JAZZY)


class ForeignBag:
    """Writes a bag as any recorder does: standard types, wall clock, no jammkle messages."""

    START_NS = 1_700_000_000_000_000_000

    def __init__(self, path: Path) -> None:
        self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._connections: dict[str, object] = {}
        self._rows: list[tuple[int, str, str, object]] = []

    def add(self, topic: str, kind: str, time_s: float, message: object) -> None:
        self._rows.append((self.START_NS + round(time_s * 1e9), topic, kind, message))

    def stamp(self, time_s: float) -> object:
        seconds, nanoseconds = divmod(self.START_NS + round(time_s * 1e9), 1_000_000_000)
        time = STORE.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id="")

    def write(self) -> None:
        with self._writer as writer:
            for time_ns, topic, kind, message in sorted(self._rows, key=lambda row: row[0]):
                if topic not in self._connections:
                    self._connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
                writer.write(self._connections[topic], time_ns, STORE.serialize_cdr(message, kind))


def write_foreign(path: Path, run: RigRun, offset_s: float, namespace: str = "") -> None:
    """Write commands, pressures and joints of a run, begun some time before the rig."""
    bag = ForeignBag(path)
    types = STORE.types
    for topic in (names.MANIFOLD_PRESSURE, *names.PRESSURES.values()):
        series = run.topics[topic.name]
        for time_s, (value,) in zip(series.time_s + offset_s, series.values.tolist(), strict=True):
            message = types[topic.message_type](header=bag.stamp(time_s), fluid_pressure=value, variance=0.0)
            bag.add(f"{namespace}/{topic.name}", topic.message_type, time_s, message)
    for topic in (names.PUMP_DUTY, *names.SOLENOIDS.values()):
        series = run.topics[topic.name]
        for time_s, (value,) in zip(series.time_s + offset_s, series.values.tolist(), strict=True):
            data = value if topic is names.PUMP_DUTY else value > 0.0
            bag.add(f"{namespace}/{topic.name}", topic.message_type, time_s, types[topic.message_type](data=data))
    series = run.topics[names.JOINT_STATES.name]
    joints = [column.partition(".")[0] for column in series.columns if column.endswith(".position")]
    for time_s, row in zip(series.time_s + offset_s, series.values, strict=True):
        message = types["sensor_msgs/msg/JointState"](
            header=bag.stamp(time_s), name=joints, position=row[: len(joints)], velocity=row[len(joints) :],
            effort=np.zeros(0),
        )  # fmt: skip
        bag.add(f"{namespace}/{names.JOINT_STATES.name}", names.JOINT_STATES.message_type, time_s, message)
    bag.write()


def test_a_bag_of_somebody_elses_recorder_is_enough(tmp_path: Path) -> None:
    """Standard types, wall clock, another namespace, no run sheet: with --rig it is run again."""
    write_foreign(tmp_path / "bag", run("landing"), 0.37, "/lf_ankle")
    recording = load_recording(tmp_path / "bag", "landing")
    residual = unbiased(recording.signal(ACHILLES), SIMULATOR(recording, {})[ACHILLES])
    assert np.sqrt(np.mean(residual**2)) < 2.0 * recording.signal(ACHILLES).noise
    assert any("imu/data" in note and "tendon_states" not in note for note in recording.notes)
    assert any("by default; write run.yaml" in note for note in recording.notes)
    with pytest.raises(BadRecordingError, match="name it with --rig, one of: tensile, pressure"):
        load_recording(tmp_path / "bag")
    with pytest.raises(BadRecordingError, match="lf_ankle"):
        load_recording(tmp_path / "bag", "landing", namespace="/rf_ankle")


@pytest.mark.parametrize(("apart_s", "behind_s"), [(0.0, 0.0), (0.0004, 0.0), (0.0, 1.0), (0.0004, 1.0)])
def test_joint_states_may_come_from_two_publishers(tmp_path: Path, apart_s: float, behind_s: float) -> None:
    """One knows the carriage, the other the ankle, at the same stamps or at others: nothing is lost or not a number.

    A recorder that was held up may have taken one of them behind the other.
    """
    series = run("landing").topics[names.JOINT_STATES.name]
    both = ForeignBag(tmp_path / "bag")
    kind, types = names.JOINT_STATES.message_type, STORE.types
    for time_s, row in zip(series.time_s, series.values, strict=True):
        for late_s, logged_s, joints in (
            (0.0, 0.0, names.ANKLE_JOINTS),
            (apart_s, behind_s, (names.CARRIAGE_JOINT,)),
        ):
            position = np.array([row[series.columns.index(f"{joint}.position")] for joint in joints])
            message = types[kind](
                header=both.stamp(time_s + late_s), name=list(joints), position=position,
                velocity=np.zeros(0), effort=np.zeros(0),
            )  # fmt: skip
            both.add(f"/{names.JOINT_STATES.name}", kind, time_s + late_s + logged_s, message)
    both.write()
    joints = read_bag(tmp_path / "bag").topics[names.JOINT_STATES.name]
    assert np.all(np.diff(joints.stamp_s) > 0.0)
    for name in ("ankle_pitch", "carriage"):
        stamp_s, values = joints.readings(f"{name}/position")
        assert np.array_equal(values, series.column(f"{name}.position"))
        assert stamp_s - stamp_s[0] == pytest.approx(series.time_s - series.time_s[0], abs=1e-6)
    signals = {each.name: each for each in signals_of("bag", {names.JOINT_STATES.name: joints}, 0.0, np.inf)}
    assert set(signals) == {*(f"{joint}/position" for joint in names.ANKLE_JOINTS), "carriage/position"}


def test_the_weather_is_taken_from_a_foreign_bag() -> None:
    """Vented channels at another atmosphere are no gap where nobody says what it was."""
    given = bag()
    mountain = {
        name: dataclasses.replace(each, columns={"pressure": each.columns["pressure"] - 8000.0})
        if "pressure" in each.columns
        else each
        for name, each in given.topics.items()
    }
    for simulated in (False, True):
        recording = recording_of(Bag("mountain", mountain, given.sheet, None, simulated))
        assert recording.inputs.ambient_pa == pytest.approx(93_325.0, abs=300.0)
        assert any("atmosphere taken from the vented pressures" in note for note in recording.notes)
    assert recording_of(given).inputs.ambient_pa is None


def test_the_weather_of_a_foreign_bag_is_that_of_its_vented_channels() -> None:
    """To the noise of a mean, whatever one bad sensor says, and from channels that are not drawn alone."""
    given = bag_of_run(run("pressure", cycles=1))
    bad = given.topics[ACHILLES]
    low = dataclasses.replace(bad, columns={"pressure": bad.columns["pressure"] - 4e3})
    found = [recording_of(Bag("here", {**given.topics, ACHILLES: each}), "pressure").inputs for each in (bad, low)]
    first_pa = [float(np.mean(given.topics[topic.name].columns["pressure"][:15])) for topic in names.PRESSURES.values()]
    assert found[0].ambient_pa == pytest.approx(np.median(first_pa), abs=30.0)
    assert found[1].ambient_pa == pytest.approx(found[0].ambient_pa, abs=500.0)
    assert found[1].start_pa is None


def cut(bag: Bag, from_s: float) -> Bag:
    """Leave out what came before a time; commands as a latched topic gives them."""
    topics = {}
    for name, each in bag.topics.items():
        kept = each.stamp_s >= from_s
        if name not in (names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values())):
            topics[name] = Samples(each.log_s[kept], each.stamp_s[kept], {k: v[kept] for k, v in each.columns.items()})
            continue
        kept[max(int(np.searchsorted(each.log_s, from_s, side="right")) - 1, 0)] = True
        times = np.maximum(each.log_s[kept], from_s)
        topics[name] = Samples(times, times, {key: values[kept] for key, values in each.columns.items()})
    return Bag(bag.name, topics)


def test_a_recording_may_begin_evacuated() -> None:
    """Where the first pressures are low, the simulation begins from them, and says so."""
    late = recording_of(cut(bag_of_run(run("pressure", cycles=1, jam_time_s=1.5)), 0.7), "pressure")
    assert any("not vented at the start" in note for note in late.notes)
    simulated = SIMULATOR(late, {})[ACHILLES]
    assert abs(simulated[0] - late.signal(ACHILLES).values[0]) < 3.0 * bias_of(late.signal(ACHILLES))


def test_joints_of_other_names_are_named() -> None:
    """Joints that no ankle has are left out, and the notes say so; joint states without any are missing."""
    given = bag()
    joints = given.topics[names.JOINT_STATES.name]
    strange = dataclasses.replace(joints, columns={f"hip_{name}": each for name, each in joints.columns.items()})
    found = recording_of(dataclasses.replace(given, topics={**given.topics, names.JOINT_STATES.name: strange}))
    assert any("hip_ankle_pitch" in note for note in found.notes)
    empty = dataclasses.replace(joints, columns={})
    found = recording_of(dataclasses.replace(given, topics={**given.topics, names.JOINT_STATES.name: empty}))
    assert any("not recorded: joint_states" in note for note in found.notes)
