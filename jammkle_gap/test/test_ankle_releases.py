"""Bags of legs that are let go: when, how far, and how often."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from jammkle_common import names
from jammkle_gap.ankle.alignment import TOUCH_DOWN, AnkleAlignment
from jammkle_gap.ankle.bag import Bag, Samples
from jammkle_gap.ankle.recording import bag_of_run, recording_of, recordings_of
from jammkle_gap.ankle.repeats import with_settings
from jammkle_gap.core.data import BadRecordingError, Recording
from recorded import SIMULATOR, run

COMMANDS = (names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values()))
LIFT_S = 1.0


@lru_cache(maxsize=8)
def one(rig: str, height_m: float, **options: object) -> Bag:
    """Return one run as somebody else's recorder has it: standard types, no run sheet."""
    bag = bag_of_run(run(rig, drop_height_m=height_m, **options))
    topics = {name: each for name, each in bag.topics.items() if name != names.TENDON_STATES.name}
    return Bag(rig, topics)


def in_a_row(bags: list[Bag], begin_s: float = 100.0) -> Bag:
    """Join runs to one bag: between two of them a hand lifts the leg back to where it hung."""
    topics: dict[str, list[Samples]] = {}
    for place, bag in enumerate(bags):
        end_s = max(float(each.stamp_s[-1]) for each in bag.topics.values())
        for name, each in bag.topics.items():
            parts = topics.setdefault(name, [])
            parts.append(Samples(each.log_s + begin_s, each.stamp_s + begin_s, each.columns))
            if name not in COMMANDS and place + 1 < len(bags):
                following = bags[place + 1].topics[name].columns
                count = round(LIFT_S * len(each.stamp_s) / end_s)
                time_s = begin_s + end_s + LIFT_S * (np.arange(count) + 0.5) / count
                ways = {key: np.linspace(values[-1], following[key][0], count) for key, values in each.columns.items()}
                parts.append(Samples(time_s, time_s, ways))
        begin_s += end_s + LIFT_S
    return Bag("row", {name: joined(parts) for name, parts in topics.items()})


def joined(parts: list[Samples]) -> Samples:
    """Return samples one after the other."""
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns}
    times = [np.concatenate([getattr(part, clock) for part in parts]) for clock in ("log_s", "stamp_s")]
    return Samples(*times, columns)


def without(bag: Bag, *topics: str) -> Bag:
    """Return a bag without some topics."""
    return dataclasses.replace(bag, topics={k: v for k, v in bag.topics.items() if k not in topics})


def apart(recording: Recording, name: str, from_s: float, to_s: float) -> float:
    """Largest difference of measured and simulated within a stretch, aligned at the touch-down."""
    alignment, simulated = AnkleAlignment(), SIMULATOR(recording, {})
    measured = {each.name: each.values for each in recording.signals}
    late_s = alignment.events(recording, simulated)[TOUCH_DOWN] - alignment.events(recording, measured)[TOUCH_DOWN]
    signal = recording.signal(name)
    inside = (signal.time_s > from_s) & (signal.time_s < to_s)
    return float(
        np.abs(np.interp(signal.time_s + late_s, signal.time_s, simulated[name]) - signal.values)[inside].max()
    )


@pytest.mark.parametrize("rig", ["drop", "landing"])
@pytest.mark.parametrize("left", [(), (names.IMU.name,), (names.JOINT_STATES.name, names.LOAD_CELL.name)])
def test_the_release_is_the_recordings_and_the_height_that_of_the_run_sheet(rig: str, left: tuple[str, ...]) -> None:
    """Whoever saw the release, carriage or IMU: to 2 ms."""
    recording = recording_of(without(one(rig, 0.08), *left), rig, {"drop_height_m": 0.08})
    assert recording.inputs.release_s == pytest.approx(1.0, abs=0.002)
    seen_by = names.IMU.name if names.JOINT_STATES.name in left else names.JOINT_STATES.name
    assert recording.inputs.release_seen_by == seen_by
    assert dict(recording.inputs.options)["drop_height_m"] == 0.08
    if not left:  # aligned at the touch-down, carriage and angle agree to a millimetre and 1.5 degrees
        assert apart(recording, "carriage/position", 0.0, 1.2) < 1e-3
        assert apart(recording, "ankle_pitch/position", 0.0, 1.2) < np.radians(1.5)


HEIGHTS_M = (0.05, 0.03, 0.08)


@pytest.mark.parametrize("left", [(), (names.IMU.name,), (names.JOINT_STATES.name,)])
def test_every_release_of_a_bag_is_a_recording(left: tuple[str, ...]) -> None:
    """Three drops in one bag, lifted by hand between: one recording each, with its own start."""
    row = without(in_a_row([one("drop", height_m) for height_m in HEIGHTS_M]), *left)
    found = recordings_of(row, "drop")
    assert [each.name for each in found] == ["row#1", "row#2", "row#3"]
    for recording in found:
        assert recording.inputs.release_s == pytest.approx(1.0, abs=0.002)
        end_s = max(float(each.time_s[-1]) for each in recording.signals)
        assert 2.0 < end_s < 2.5 + LIFT_S
        assert min(float(each.time_s[0]) for each in recording.signals) >= 0.0
    with pytest.raises(BadRecordingError, match="holds 3 runs"):
        recording_of(row, "drop")


def test_a_run_of_several_is_simulated_as_when_it_is_alone() -> None:
    """The hand that lifts the leg afterwards is no part of it; neither is what was before."""
    row = recordings_of(in_a_row([one("drop", 0.05), one("drop", 0.05)]), "drop")
    assert len({each.setting for each in with_settings(row)}) == 1
    for recording in row:
        assert apart(recording, "carriage/position", 0.0, 2.4) < 0.001
        slide = recording.signal("carriage/position")
        assert slide.values[-1] < slide.values[0] - 0.02


def test_a_jammed_run_after_another_begins_with_its_own_pressures() -> None:
    """Vacuum that stands as a run begins is measured; what was commanded before holds."""
    jammed = one("drop", 0.05, foot="jammed")
    late = {
        name: each.chosen(each.stamp_s > 0.6) if name not in COMMANDS else each for name, each in jammed.topics.items()
    }
    recording = recording_of(Bag("late", late), "drop")
    assert recording.inputs.start_pa is not None
    name = names.PRESSURES[names.ACHILLES].name
    assert apart(recording, name, 0.0, 2.5) < 2e3


def cut(bag: Bag, from_s: float, to_s: float) -> Bag:
    """Leave out what was measured before and after; commands stay."""
    topics = {
        name: each if name in COMMANDS else each.chosen((each.stamp_s >= from_s) & (each.stamp_s <= to_s))
        for name, each in bag.topics.items()
    }
    return dataclasses.replace(bag, topics=topics)


def test_runs_that_are_cut_short_are_left_out_and_said() -> None:
    """The others stay; if none is long enough the bag is refused."""
    short = cut(one("drop", 0.05), 0.0, 1.65)
    row = cut(in_a_row([short, one("drop", 0.05)]), 100.9, np.inf)
    (left,) = recordings_of(row, "drop")
    assert left.name == "row#2"
    assert "1 of 2 runs left out as too short" in left.notes
    with pytest.raises(BadRecordingError, match=r"lasts 0\.7 s, too short"):
        recordings_of(cut(one("drop", 0.05), 0.95, 1.65), "drop")


def test_a_bag_in_which_nothing_falls_is_refused() -> None:
    """One line that names what was looked for and the way out."""
    bag = one("drop", 0.05)
    held = {
        name: each.chosen(each.stamp_s < 0.99) if name not in COMMANDS else each for name, each in bag.topics.items()
    }
    longer = in_a_row([Bag("held", held)] * 2)
    with pytest.raises(
        BadRecordingError, match=r"holds no release: neither carriage nor imu/data .* or name another rig"
    ):
        recordings_of(longer, "drop")


def test_a_late_sensor_saw_the_release_late() -> None:
    """With its delay as an effect the leg is let go earlier, and other sensors see it so."""
    recording = recording_of(without(one("drop", 0.05), names.LOAD_CELL.name), "drop")
    nominal, late = (SIMULATOR(recording, values) for values in ({}, {"joint_delay.delay_s": 0.01}))
    alignment = AnkleAlignment()
    sooner_s = alignment.events(recording, nominal)[TOUCH_DOWN] - alignment.events(recording, late)[TOUCH_DOWN]
    assert sooner_s == pytest.approx(0.01, abs=2e-4)
    slide = recording.signal("carriage/position")
    falling = (slide.time_s > 1.0) & (slide.time_s < 1.1)
    assert np.abs(nominal[slide.name] - late[slide.name])[falling].max() < 1e-5


def test_a_start_that_scatters_moves_a_release_that_was_seen() -> None:
    """By as much, while commands and pressures stay where they were."""
    recording = recording_of(one("landing", 0.05), "landing")
    nominal, later = (SIMULATOR(recording, values) for values in ({}, {"run_start.late_s": 0.004}))
    alignment = AnkleAlignment()
    moved_s = alignment.events(recording, later)[TOUCH_DOWN] - alignment.events(recording, nominal)[TOUCH_DOWN]
    assert moved_s == pytest.approx(0.004, abs=2e-4)
    pressure = recording.signal("manifold/pressure")
    assert np.abs(later[pressure.name] - nominal[pressure.name]).max() < pressure.noise
