"""Recordings from bags of anybody: what is read, how it is run again, and what is refused."""

from __future__ import annotations

import dataclasses
import itertools
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.signal import lfilter  # type: ignore[import-untyped]  # carries no types

from jammkle_graph import names
from jammkle_sim.gap.ankle.bag import Bag, Samples
from jammkle_sim.gap.ankle.effects import ankle_library
from jammkle_sim.gap.ankle.loading import load_recording, recording_of
from jammkle_sim.gap.ankle.runs import bag_of_run
from jammkle_sim.gap.ankle.simulator import AnkleSimulator
from jammkle_sim.gap.recording import BadRecordingError
from jammkle_sim.rigs.catalogue import RIGS, run_rig

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from jammkle_sim.gap.recording import Recording, Signal
    from jammkle_sim.rigs.run import RigRun

STORE = get_typestore(Stores.ROS2_JAZZY)
SIMULATOR = AnkleSimulator(ankle_library())
SLOW = {"line_restriction_achilles.conductance_scale": 0.3}
ACHILLES = names.PRESSURES[names.ACHILLES].name


@lru_cache(maxsize=8)
def run(rig: str, **options: object) -> RigRun:
    """Run a rig once."""
    return run_rig(rig, RIGS[rig].options(**options), lambda _: None, lambda: False)


def bag() -> Bag:
    """Jam and vent an ankle once."""
    return bag_of_run(run("pressure", cycles=1))


def unbiased(signal: Signal, simulated: np.ndarray) -> np.ndarray:
    """Measured less simulated, less what the sensor may be off by throughout."""
    residual = signal.values - simulated
    return residual - np.clip(residual.mean(), -3.0 * signal.bias, 3.0 * signal.bias)


def worst_gap(recording: Recording) -> float:
    """Largest difference of measured and nominal over the signals, root mean square in noise."""
    simulated = SIMULATOR(recording, {})
    assert set(simulated) == {signal.name for signal in recording.signals}
    return max(
        float(np.sqrt(np.mean((unbiased(each, simulated[each.name]) / each.noise) ** 2))) for each in recording.signals
    )


@pytest.mark.parametrize(
    ("rig", "options"),
    [
        ("tensile", {"vacuum_pa": 50e3, "speed_m_s": 0.02}),
        ("pressure", {"cycles": 2}),
        ("drop", {"foot": "jammed"}),
        ("drop", {"foot": "squash_ball"}),
        ("drop", {"foot": "rigid_ankle"}),
        ("slip", {"foot": "jammed", "speed_m_s": 0.05}),
        ("slip", {"foot": "unjammed", "speed_m_s": 0.05}),
        ("landing", {}),
        ("landing", {"jam": "never"}),
    ],
)
def test_a_nominal_run_lies_at_its_noise(rig: str, options: dict[str, object]) -> None:
    """Played back, commands of every rig give its measurements again, but for the noise of the instruments."""
    assert 0.5 < worst_gap(recording_of(bag_of_run(run(rig, **options)))) < 1.5


@pytest.mark.parametrize(
    ("rig", "options"),
    [
        ("tensile", {"vacuum_pa": 50e3, "speed_m_s": 0.02}),
        ("drop", {"foot": "unjammed"}),
        ("slip", {"foot": "unjammed", "speed_m_s": 0.05}),
        ("landing", {}),
    ],
)
def test_the_start_of_a_foreign_run_is_found(rig: str, options: dict[str, object]) -> None:
    """Where nobody tells when the rig started, the slide does, well enough for an impact to lie at its noise."""
    given = bag_of_run(run(rig, **options))
    later = {
        name: Samples(each.log_s + 1.7e9, each.stamp_s + 1.7e9, each.columns) for name, each in given.topics.items()
    }
    recording = recording_of(Bag("foreign", later, None, None), rig, options)
    assert any("told by when its slide moved off" in note for note in recording.notes)
    assert worst_gap(recording) < 1.5


def test_samples_written_in_another_order_are_put_back() -> None:
    """A recorder with several threads swaps neighbours: nothing is lost by it."""
    given = bag_of_run(run("drop", foot="unjammed"))
    swapped = np.arange(len(given.topics["load_cell/wrench"].stamp_s))
    swapped[10:-1:20], swapped[11::20] = swapped[11::20].copy(), swapped[10:-1:20].copy()
    cell = given.topics["load_cell/wrench"]
    columns = {name: values[swapped] for name, values in cell.columns.items()}
    topics = {**given.topics, "load_cell/wrench": Samples(cell.log_s, cell.stamp_s[swapped], columns)}
    put_back = recording_of(dataclasses.replace(given, topics=topics)).signal("load_cell/force_z")
    assert np.array_equal(put_back.values, recording_of(given).signal("load_cell/force_z").values)


def test_the_replay_is_the_simulation_itself() -> None:
    """Joints and tendons, which have no noise, come out the same to the last bit."""
    recording = recording_of(bag_of_run(run("landing")))
    simulated = SIMULATOR(recording, {})
    for name in ("carriage/position", "ankle_pitch/position", "achilles_left/extension", "achilles_left/tension"):
        assert np.array_equal(recording.signal(name).values, simulated[name])


def test_phases_follow_commands_and_motion() -> None:
    """Air is evacuated, held and vented; a pull loads, turns and unloads; a leg falls, strikes, rebounds and rests."""

    def found(rig: str, signal: str, **options: object) -> list[str]:
        recording = recording_of(bag_of_run(run(rig, **options)))
        return [phase.name for phase in recording.phases if not phase.signals or signal in phase.signals]

    assert found("pressure", ACHILLES, cycles=1) == ["still", "evacuating", "holding", "venting", "still"]
    pull = found("tensile", "load_cell/force_z", vacuum_pa=50e3, speed_m_s=0.02)
    assert pull == ["still", "loading", "reversal", "unloading", "still"]
    assert found("landing", "imu/specific_force_z") == ["still", "falling", "impact", "rebound", "still"]
    assert "sliding" in found("slip", "load_cell/force_z", foot="unjammed", speed_m_s=0.05)


@pytest.mark.parametrize(("rig", "options"), [("landing", {}), ("tensile", {"vacuum_pa": 50e3, "speed_m_s": 0.02})])
def test_phases_do_not_overlap(rig: str, options: dict[str, object]) -> None:
    """Each signal is in one phase at a time, throughout."""
    recording = recording_of(bag_of_run(run(rig, **options)))
    for signal in recording.signals:
        own = sorted(
            (phase for phase in recording.phases if not phase.signals or signal.name in phase.signals),
            key=lambda phase: phase.start_s,
        )
        assert own
        assert all(one.end_s == two.start_s for one, two in itertools.pairwise(own))
        assert own[0].start_s <= signal.time_s[0]
        assert own[-1].end_s > signal.time_s[-1]


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
    """Standard types, wall clock, another namespace, no description: with --rig it is run again to its noise."""
    write_foreign(tmp_path / "bag", run("landing"), 0.37, "/lf_ankle")
    recording = load_recording(tmp_path / "bag", "landing")
    assert worst_gap(recording) < 3.0
    assert any("imu/data" in note and "tendon_states" in note for note in recording.notes)
    assert any("defaults" in note for note in recording.notes)
    with pytest.raises(BadRecordingError, match="name it with --rig, one of: tensile, pressure"):
        load_recording(tmp_path / "bag")
    with pytest.raises(BadRecordingError, match="lf_ankle"):
        load_recording(tmp_path / "bag", "landing", namespace="/rf_ankle")


def test_commands_of_a_live_graph_are_put_where_they_arrived() -> None:
    """A recorder that hears commands some milliseconds before the valves do makes no gap; a slow line still is one."""
    given, early_s = bag_of_run(run("pressure", cycles=3)), iter([0.0, 0.003, 0.008, 0.0, 0.005, 0.002, 0.006])
    solenoids = {topic.name for topic in names.SOLENOIDS.values()}
    shifts = dict(zip(given.topics[names.SOLENOIDS[names.ACHILLES].name].log_s.tolist(), early_s, strict=False))

    def heard(name: str, each: Samples) -> Samples:
        if name == names.PUMP_DUTY.name:
            return each
        if name not in solenoids:
            return dataclasses.replace(each, log_s=each.log_s - 0.002)
        shift_s = np.array([shifts.get(time_s, 0.0) * (time_s > 0.0) for time_s in each.log_s.tolist()])
        times_s = np.maximum.accumulate(each.log_s - shift_s)
        return Samples(times_s, times_s, each.columns)

    live = dataclasses.replace(given, topics={name: heard(name, each) for name, each in given.topics.items()})
    recording = recording_of(live)
    assert any("switched up to 8 ms later" in note for note in recording.notes)
    assert worst_gap(recording) < 1.5
    signal = recording.signal(ACHILLES)
    slow = SIMULATOR(recording, SLOW)
    residual = unbiased(signal, slow[ACHILLES])
    assert float(np.sqrt(np.mean((residual / signal.noise) ** 2))) > 5.0


def heard_early(early_s: float, slow_s: float = 0.0) -> Recording:
    """Return a run of three cycles whose recorder hears commands early, and whose Achilles line may answer slowly."""
    given = bag_of_run(run("pressure", cycles=3))
    solenoids = {topic.name for topic in names.SOLENOIDS.values()}
    topics = dict(given.topics)
    for name in solenoids:
        times_s = topics[name].log_s - early_s * (topics[name].log_s > 0.0)
        topics[name] = Samples(times_s, times_s, topics[name].columns)
    for name in set(topics) - solenoids - {names.PUMP_DUTY.name}:
        topics[name] = dataclasses.replace(topics[name], log_s=topics[name].log_s + 0.001)
    line = topics[names.PRESSURES[names.ACHILLES].name]
    (column, pressure_pa), *_ = line.columns.items()
    if slow_s:
        keep = float(np.exp(-np.median(np.diff(line.stamp_s)) / slow_s))
        slow_pa = lfilter([1.0 - keep], [1.0, -keep], pressure_pa - pressure_pa[0]) + pressure_pa[0]
        topics[names.PRESSURES[names.ACHILLES].name] = dataclasses.replace(line, columns={column: slow_pa})
    return recording_of(dataclasses.replace(given, topics=topics))


def test_what_all_commands_are_late_by_is_left_in() -> None:
    """A few milliseconds are the recorder's; more is late valves, or a late command, and shows."""
    assert worst_gap(heard_early(0.003)) < 1.5
    late = heard_early(0.014)
    assert any("14 ms late throughout" in note for note in late.notes)
    assert worst_gap(late) > 5.0


def test_one_slow_line_moves_no_command_of_the_others() -> None:
    """Three lines switch at once: the two that answer in time tell when."""
    sound, slow = heard_early(0.002), heard_early(0.002, slow_s=0.03)
    for channel, line in sound.inputs.commands.solenoids.items():
        assert np.abs(slow.inputs.commands.solenoids[channel].time_s - line.time_s).max() < 0.0015


def test_commands_stay_where_they_were_heard_if_no_pressure_answers() -> None:
    """One line switches, and its pressure was not recorded."""
    given = bag_of_run(run("pressure", cycles=1, channel=names.ACHILLES))
    late = {name: dataclasses.replace(each, log_s=each.log_s + 0.001) for name, each in given.topics.items()}
    del late[names.PRESSURES[names.ACHILLES].name]
    recording = recording_of(dataclasses.replace(given, topics=late))
    for line in recording.inputs.commands.solenoids.values():
        assert np.isfinite(line.time_s).all()


def test_commands_count_as_the_hardware_acknowledged_them() -> None:
    """However late the recorder heard them, a recording with acknowledgements is the exact one; late valves show."""
    given = bag_of_run(run("pressure", cycles=2))
    commands = [names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values())]
    time_s = np.unique(np.concatenate([np.arange(0.0, 5.0, 0.01), *(given.topics[each].log_s for each in commands)]))
    held = {each: given.topics[each] for each in commands}
    columns = {
        name: each.columns["data"][np.searchsorted(each.log_s, time_s, side="right") - 1] for name, each in held.items()
    }
    late = {
        name: Samples(each.log_s + 0.03, each.stamp_s + 0.03 * (name in commands), each.columns)
        for name, each in given.topics.items()
    }
    late[names.ACTUATOR_STATES.name] = Samples(time_s + 0.01, time_s, columns)
    recording = recording_of(dataclasses.replace(given, topics=late))
    exact = recording_of(given)
    assert not any("commands" in note for note in recording.notes)
    for signal in exact.signals:
        assert np.array_equal(SIMULATOR(recording, {})[signal.name], SIMULATOR(exact, {})[signal.name])
    late_valves = SIMULATOR(recording, {"valve_dead_time.extra_s": 0.005})[ACHILLES]
    residual = unbiased(recording.signal(ACHILLES), late_valves)
    assert float(np.sqrt(np.mean((residual / recording.signal(ACHILLES).noise) ** 2))) > 3.0


def test_the_weather_is_taken_from_a_foreign_bag() -> None:
    """Vented channels at another atmosphere are no gap where nobody says what it was."""
    given = bag()
    mountain = {
        name: dataclasses.replace(each, columns={"pressure": each.columns["pressure"] - 8000.0})
        if "pressure" in each.columns
        else each
        for name, each in given.topics.items()
    }
    recording = recording_of(Bag("mountain", mountain, None, None), "pressure", {"cycles": 1})
    assert recording.inputs.ambient_pa == pytest.approx(93_325.0, abs=300.0)


def test_a_recording_may_begin_evacuated() -> None:
    """Where the first pressures are low, the simulation begins from them, and says so."""
    late = recording_of(cut(bag_of_run(run("pressure", cycles=1, jam_time_s=1.5)), 0.7), "pressure")
    assert any("not vented at the start" in note for note in late.notes)
    simulated = SIMULATOR(late, {})[ACHILLES]
    assert abs(simulated[0] - late.signal(ACHILLES).values[0]) < 3.0 * late.signal(ACHILLES).bias


def cut(bag: Bag, from_s: float) -> Bag:
    """Leave out what came before a time; commands as a latched topic gives them, and no description."""
    topics = {}
    for name, each in bag.topics.items():
        kept = each.stamp_s >= from_s
        if name not in (names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values())):
            topics[name] = Samples(each.log_s[kept], each.stamp_s[kept], {k: v[kept] for k, v in each.columns.items()})
            continue
        kept[max(int(np.searchsorted(each.log_s, from_s, side="right")) - 1, 0)] = True
        times = np.maximum(each.log_s[kept], from_s)
        topics[name] = Samples(times, times, {key: values[kept] for key, values in each.columns.items()})
    return Bag(bag.name, topics, None, None)


def changed(topic: str, change: Callable[[Samples], Samples]) -> Callable[[Bag], Bag]:
    """Return what changes one topic of a bag."""
    return lambda bag: dataclasses.replace(bag, topics={**bag.topics, topic: change(bag.topics[topic])})


def column(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Samples], Samples]:
    """Return what changes one column."""
    return lambda each: dataclasses.replace(each, columns={**each.columns, name: change(each.columns[name])})


def without(*topics: str) -> Callable[[Bag], Bag]:
    """Return what takes topics out of a bag."""
    return lambda bag: dataclasses.replace(bag, topics={k: v for k, v in bag.topics.items() if k not in topics})


def with_gap(values: np.ndarray) -> np.ndarray:
    """Return values with one that is not a number."""
    values = values.copy()
    values[10] = np.nan
    return values


def between(bag: Bag, from_s: float, to_s: float, *topics: str) -> Bag:
    """Leave out a stretch of some topics, by default of all."""
    left = {}
    for name, each in bag.topics.items():
        kept = (each.log_s < from_s) | (each.log_s > to_s) | bool(topics and name not in topics)
        left[name] = Samples(each.log_s[kept], each.stamp_s[kept], {k: v[kept] for k, v in each.columns.items()})
    return dataclasses.replace(bag, topics=left)


def test_joints_of_other_names_are_named() -> None:
    """Joints that no ankle has are left out, and the reader is told; joint states without any are missing."""
    given = bag()
    joints = given.topics[names.JOINT_STATES.name]
    strange = dataclasses.replace(joints, columns={f"hip_{name}": each for name, each in joints.columns.items()})
    found = recording_of(dataclasses.replace(given, topics={**given.topics, names.JOINT_STATES.name: strange}))
    assert any("hip_ankle_pitch" in note for note in found.notes)
    empty = dataclasses.replace(joints, columns={})
    found = recording_of(dataclasses.replace(given, topics={**given.topics, names.JOINT_STATES.name: empty}))
    assert any("not recorded: joint_states" in note for note in found.notes)


def short(bag: Bag) -> Bag:
    """Return the first half second."""
    topics = {
        name: Samples(*(x[each.log_s < 0.5] for x in (each.log_s, each.stamp_s)),
                      {k: v[each.log_s < 0.5] for k, v in each.columns.items()})
        for name, each in bag.topics.items()
    }  # fmt: skip
    return dataclasses.replace(bag, topics=topics)


BAD: dict[str, tuple[Callable[[Bag], Bag], str, str]] = {
    "no duty": (without(names.PUMP_DUTY.name), "holds no commands: pump/duty", "record them too"),
    "no solenoids": (without(*(t.name for t in names.SOLENOIDS.values())), "holds no commands", "record them too"),
    "commands alone": (
        lambda bag: dataclasses.replace(
            bag, topics={name: each for name, each in bag.topics.items() if "data" in each.columns}
        ),
        "holds commands alone",
        "record pressures",
    ),
    "gauge": (changed(ACHILLES, column("pressure", lambda p: p - 101_325.0)), "looks like gauge", "record absolute"),
    "vacuum": (changed(ACHILLES, column("pressure", lambda p: 101_325.0 - p)), "looks like gauge", "record absolute"),
    "kPa": (changed(ACHILLES, column("pressure", lambda p: p / 1000.0)), "looks like kPa", "record absolute"),
    "degrees": (
        changed(names.JOINT_STATES.name, column("ankle_pitch/position", lambda a: np.degrees(a) + 5.0)),
        "looks like degrees",
        "record rad",
    ),
    "mbar": (changed(ACHILLES, column("pressure", lambda p: p / 100.0)), "looks like mbar", "record absolute"),
    "psi": (changed(ACHILLES, column("pressure", lambda p: p / 6894.76)), "looks like psi", "record absolute"),
    "duty in percent": (
        changed(names.PUMP_DUTY.name, column("data", lambda d: 100.0 * d)),
        "pump/duty in bag pressure is 100",
        "a number from 0 to 1",
    ),
    "duty not a number": (changed(names.PUMP_DUTY.name, column("data", lambda d: d * np.nan)), "is nan at", "0 to 1"),
    "no time in headers": (
        changed(ACHILLES, lambda each: dataclasses.replace(each, stamp_s=0.0 * each.stamp_s)),
        "carries no time",
        "header.stamp set",
    ),
    "a pause": (lambda bag: between(bag, 0.9, 1.6), "holds nothing between", "without a pause"),
    "commands too late": (
        lambda bag: between(bag, 0.0, 0.9, *(topic for topic, each in bag.topics.items() if "data" in each.columns)),
        "before the first at",
        "from before the first one is given",
    ),
    "one solenoid": (without(names.SOLENOIDS[names.ACHILLES].name), "without any achilles/solenoid", "record the comm"),
    "nan": (changed(ACHILLES, column("pressure", with_gap)), "is not a number at 1 of", "leave such samples out"),
    "constant": (
        changed(ACHILLES, column("pressure", lambda p: np.full_like(p, 101_325.0))),
        "101325 Pa throughout while its solenoid switches",
        "check that sensor",
    ),
    "clock apart": (
        changed(ACHILLES, lambda each: dataclasses.replace(each, log_s=each.log_s + 7.0)),
        "clocks disagree",
        "record with one clock",
    ),
    "clock drifts": (
        changed(ACHILLES, lambda each: dataclasses.replace(each, log_s=each.log_s * 1.2)),
        "clocks drift apart",
        "synchronise",
    ),
    "time runs back": (
        changed(ACHILLES, lambda each: dataclasses.replace(each, stamp_s=each.stamp_s % 1.0)),
        "run backwards",
        "without a reset",
    ),
    "short": (short, "too short to hold anything out", "record at least"),
    "no yaml": (lambda bag: dataclasses.replace(bag, description="a: b: c"), "not YAML", "YAML"),
    "no such rig": (lambda bag: dataclasses.replace(bag, description="rig: catapult"), "catapult", "known are"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_recording_is_refused_with_what_to_record_instead(case: str) -> None:
    """One line that names what is wrong and the way out."""
    change, wrong, way_out = BAD[case]
    with pytest.raises(BadRecordingError) as error:
        recording_of(change(bag()))
    assert wrong in str(error.value)
    assert way_out in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("rig", "said"), [("tensile", "no tendon"), ("drop", "slide starts at"), ("slip", "slide starts at")]
)
def test_a_rig_that_does_not_match_is_refused(rig: str, said: str) -> None:
    """A foreign bag cannot be from a rig with other tendons or another start; a told rig is not overruled."""
    foreign = dataclasses.replace(bag(), description=None)
    with pytest.raises(BadRecordingError, match=said):
        recording_of(foreign, rig)
    with pytest.raises(BadRecordingError, match=f"recorded on rig 'pressure', not '{rig}'"):
        recording_of(bag(), rig)


@pytest.mark.parametrize("name", ["missing", "empty"])
def test_what_is_no_bag_is_refused(tmp_path: Path, name: str) -> None:
    """A path without a bag is named."""
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadRecordingError, match=name):
        load_recording(tmp_path / name)
