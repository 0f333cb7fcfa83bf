"""When commands arrived, told by pressures that answer them or by acknowledgements."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.ankle.bag import Samples
from jammkle_gap.ankle.loading import recording_of
from jammkle_gap.ankle.november import for_november
from jammkle_gap.ankle.runs import bag_of_run
from jammkle_graph import names
from recorded import ACHILLES, SIMULATOR, run, unbiased, worst_gap

if TYPE_CHECKING:
    from jammkle_gap.november.recording import Recording


SLOW = {"line_restriction_achilles.conductance_scale": 0.3}


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
    recording = for_november(recording_of(live))
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
    return for_november(recording_of(dataclasses.replace(given, topics=topics)))


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
    recording = for_november(recording_of(dataclasses.replace(given, topics=late)))
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
