"""Recordings that are refused, and what their errors say."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common import names
from jammkle_common.bags.run_sheet import RunSheet
from jammkle_gap.ankle.bag import Bag, Samples
from jammkle_gap.ankle.recording import bag_of_run, load_recording, recording_of
from jammkle_gap.core.data import BadRecordingError
from recorded import ACHILLES, bag, run

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def changed(topic: str, change: Callable[[Samples], Samples]) -> Callable[[Bag], Bag]:
    """Return what changes one topic of a bag."""
    return lambda bag: dataclasses.replace(bag, topics={**bag.topics, topic: change(bag.topics[topic])})


def by_the_log(topic: str, change: Callable[[Samples], Samples]) -> Callable[[Bag], Bag]:
    """Return what makes a robot's bag, whose commands have log times alone, and changes one topic of it."""

    def robots(bag: Bag) -> Bag:
        others = {name: each for name, each in bag.topics.items() if name != names.ACTUATOR_STATES.name}
        return dataclasses.replace(bag, topics=others, clock=None)

    return lambda bag: changed(topic, change)(robots(bag))


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
        by_the_log(ACHILLES, lambda each: dataclasses.replace(each, log_s=each.log_s + 7.0)),
        "clocks disagree",
        "record with one clock",
    ),
    "clock drifts": (
        by_the_log(ACHILLES, lambda each: dataclasses.replace(each, log_s=each.log_s * 1.2)),
        "clocks drift apart",
        "synchronise",
    ),
    "time runs back": (
        changed(ACHILLES, lambda each: dataclasses.replace(each, stamp_s=each.stamp_s % 1.0)),
        "run backwards",
        "without a reset",
    ),
    "short": (short, "too short to hold anything out", "record at least"),
    "no such rig": (lambda bag: dataclasses.replace(bag, sheet=RunSheet("catapult")), "catapult", "known are"),
    "no such option": (
        lambda bag: dataclasses.replace(bag, sheet=RunSheet("pressure", {"colour": "red"}), simulated=False),
        "colour is no option of rig pressure",
        "it has: channel",
    ),
    "no such value": (
        lambda bag: dataclasses.replace(bag, sheet=RunSheet("pressure", {"vacuum_pa": -5.0})),
        "'vacuum_pa' is -5",
        "it must be 6000 to",
    ),
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


@pytest.mark.parametrize("at", [0.0, 0.4, 0.9])
def test_a_recorder_that_was_held_up_has_no_drifting_clock(at: float) -> None:
    """For an eighth of a bag all samples wait and are logged together."""

    def held_up(each: Samples) -> Samples:
        begin_s, duration_s = each.log_s[0], float(np.ptp(each.log_s))
        waiting = (each.log_s >= begin_s + at * duration_s) & (each.log_s < begin_s + (at + 0.125) * duration_s)
        end_s = begin_s + (at + 0.125) * duration_s
        return dataclasses.replace(each, log_s=np.where(waiting, end_s, each.log_s))

    assert recording_of(by_the_log(ACHILLES, held_up)(bag())) is not None


def test_a_topic_that_comes_late_is_no_other_clock() -> None:
    """Latency of messages that carry a stamp is no reason to refuse: the quickest ones show the log's clock."""
    late = by_the_log(names.JOINT_STATES.name, lambda each: dataclasses.replace(each, log_s=each.log_s + 0.6))
    assert recording_of(late(bag())) is not None


def test_log_times_of_a_simulation_say_nothing() -> None:
    """With /clock, or commands that the hardware has acknowledged, a recorder may fall behind as far as it will."""

    def late(each: Samples) -> Samples:
        return dataclasses.replace(each, log_s=each.log_s + np.linspace(0.0, 1.8, len(each.log_s)))

    stamps_s = bag().topics[ACHILLES].stamp_s
    simulated = dataclasses.replace(bag(), clock=Samples(stamps_s, stamps_s, {"clock_s": stamps_s}))
    recording = recording_of(changed(ACHILLES, late)(simulated))
    assert any("fell behind by up to 1.8 s" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("rig", "said"), [("tensile", "no tendon"), ("drop", "slide starts at"), ("slip", "slide starts at")]
)
def test_a_rig_that_does_not_match_is_refused(rig: str, said: str) -> None:
    """A foreign bag cannot be from a rig with other tendons or another start; a rig that is known is not overruled."""
    foreign = dataclasses.replace(bag(), sheet=RunSheet(), simulated=False)
    with pytest.raises(BadRecordingError, match=said):
        recording_of(foreign, rig)
    with pytest.raises(BadRecordingError, match=f"recorded on rig 'pressure', not '{rig}'"):
        recording_of(bag(), rig)


def test_a_recording_that_begins_after_the_release_is_said_to() -> None:
    """The bag itself names its rig, so that the rig is no question; another recorder's bag may be of any."""
    landed_s = 1.5
    fallen = bag_of_run(run("landing"))
    topics = {}
    for name, each in fallen.topics.items():
        kept = each.log_s >= landed_s
        kept[max(np.count_nonzero(~kept) - 1, 0)] |= "data" in each.columns  # commands are latched
        times_s = (np.maximum(time_s[kept], landed_s) for time_s in (each.log_s, each.stamp_s))
        topics[name] = Samples(*times_s, {k: v[kept] for k, v in each.columns.items()})
    late = dataclasses.replace(fallen, topics=topics)
    with pytest.raises(BadRecordingError, match=r"begins after the release.*jammkle up --record") as refused:
        recording_of(late)
    assert "--rig" not in str(refused.value)
    with pytest.raises(BadRecordingError, match="--rig"):
        recording_of(dataclasses.replace(late, sheet=RunSheet(), simulated=False), "landing")


@pytest.mark.parametrize("name", ["missing", "empty"])
def test_what_is_no_bag_is_refused(tmp_path: Path, name: str) -> None:
    """A path without a bag is named."""
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadRecordingError, match=name):
        load_recording(tmp_path / name)
