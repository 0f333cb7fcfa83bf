"""Which runs are repeats, and which share signatures."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common import names
from jammkle_gap.ankle.bag import Bag
from jammkle_gap.ankle.recording import bag_of_run, recording_of, recording_of_run
from jammkle_gap.ankle.repeats import difference, group_of, held_vacuum, setting_text, with_settings
from jammkle_sim.rigs.catalogue import RIGS, run_rig, scattered
from jammkle_sim.rigs.replay import Course, Timeline

if TYPE_CHECKING:
    from jammkle_gap.core.data import Recording

SHORT = {
    "tensile": {"vacuum_pa": 50e3, "speed_m_s": 0.02, "extension_m": 0.01},
    "pressure": {"cycles": 2, "jam_time_s": 0.6, "vent_time_s": 0.4},
    "drop": {"foot": "jammed"},
    "slip": {"foot": "unjammed", "speed_m_s": 0.05, "descent_m": 0.02},
    "landing": {},
}


@lru_cache(maxsize=32)
def bag(rig: str, repeat: int | None = None, **changed: object) -> Bag:
    """Run a rig, scattered if a repeat is given."""
    options = RIGS[rig].options(**{**SHORT[rig], **changed})
    chosen = options if repeat is None else scattered(rig, options, repeat)
    return bag_of_run(run_rig(rig, chosen, lambda _: None, lambda: False), f"{rig} {repeat}")


def recorded(rig: str, repeat: int | None = None, **changed: object) -> Recording:
    """Return the recording of a described bag."""
    return recording_of(bag(rig, repeat, **changed))


def foreign(rig: str, repeat: int | None = None, **changed: object) -> Recording:
    """Return the recording of a bag of somebody else's recorder, on whose run sheet only some is."""
    given = bag(rig, repeat, **changed)
    topics = {name: each for name, each in given.topics.items() if name != names.TENDON_STATES.name}
    options = dataclasses.asdict(RIGS[rig].options(**{**SHORT[rig], **changed}))
    known = {name: options[name] for name in ("channel", "foot", "drop_height_m", "pitch_deg") if name in options}
    return recording_of(Bag(given.name, topics), rig, known)


def moved(recording: Recording, late_s: float, channel: str = names.ACHILLES) -> Recording:
    """Return a recording in which all commands of one solenoid come a little later."""
    commands = recording.inputs.commands
    solenoids = {**commands.solenoids, channel: commands.solenoids[channel].later(late_s)}
    inputs = dataclasses.replace(recording.inputs, commands=dataclasses.replace(commands, solenoids=solenoids))
    return dataclasses.replace(recording, inputs=inputs)


@pytest.mark.parametrize("rig", SHORT)
@pytest.mark.parametrize("make", [recorded, foreign])
def test_scattered_runs_are_repeats(rig: str, make: type) -> None:
    """What a rig cannot set the same twice, and another seed, make no other setting; described or not."""
    runs = [make(rig, repeat) for repeat in range(3)]
    assert [difference(runs[0], each) for each in runs] == ["", "", ""]
    assert len({each.setting for each in with_settings(runs)}) == 1


@pytest.mark.parametrize(
    ("rig", "changed", "said"),
    [
        ("tensile", {"extension_m": 0.0105}, "goes 10.0 mm, not 10.5"),
        ("tensile", {"extension_m": 0.02}, "goes 10.0 mm"),
        ("tensile", {"speed_m_s": 0.022}, "elsewhere at"),
        ("tensile", {"vacuum_pa": 30e3}, "kPa held"),
        ("tensile", {"channel": names.ACHILLES}, "channel "),
        ("pressure", {"cycles": 1}, "switches 4 times, not 2"),
        ("pressure", {"jam_time_s": 0.9}, "switches at 0.80 s, not 1.10 s"),
        ("pressure", {"vacuum_pa": 30e3}, "kPa held"),
        ("pressure", {"channel": names.ACHILLES}, "peroneal_left switches 4 times, not 0"),
        ("drop", {"foot": "unjammed"}, ""),
        ("drop", {"drop_height_m": 0.07}, "drop_height_m 0.0"),
        ("drop", {"pitch_deg": 30.0}, "pitch_deg "),
        ("landing", {"jam": "before"}, "switches at"),
        ("slip", {"speed_m_s": 0.03}, "elsewhere at"),
    ],
)
@pytest.mark.parametrize("make", [recorded, foreign])
def test_what_was_done_otherwise_is_another_setting(
    rig: str, changed: dict[str, object], said: str, make: type
) -> None:
    """Whether the bags tell or not: inputs and measured starts show it."""
    one, other = make(rig), make(rig, **changed)
    found = difference(one, other)
    assert found
    assert said in found or "vacuum_pa" in found
    first, second = with_settings([one, other])
    assert first.setting != second.setting


def test_what_only_options_tell_counts_where_they_are_known() -> None:
    """Other fibres, another slope; and nothing that merely says how the rig would move by itself."""
    assert "material multi, not a85" in difference(recorded("tensile"), recorded("tensile", material="a85"))
    assert "slope_deg 40, not 30" in difference(recorded("landing"), recorded("landing", slope_deg=30.0))
    one = recorded("pressure")
    changed = tuple((name, 99 if name == "cycles" else value) for name, value in one.inputs.options)
    assert difference(one, dataclasses.replace(one, inputs=dataclasses.replace(one.inputs, options=changed))) == ""


def test_unknown_options_make_no_runs_equal() -> None:
    """One bag tells of its fibres, the other does not: the default may be right or not."""
    known, unknown = recorded("tensile"), foreign("tensile")
    assert "is known of one alone" in difference(known, unknown)
    first, second = with_settings([known, unknown])
    assert first.setting != second.setting


def test_a_regulators_and_a_persons_jitter_is_none() -> None:
    """A quarter of a second either way, the pump's duty however it likes."""
    one = recorded("pressure")
    assert difference(one, moved(one, 0.2)) == ""
    assert "achilles switches at" in difference(one, moved(one, 0.3))
    half = Timeline(one.inputs.commands.duty.time_s, 0.5 * one.inputs.commands.duty.values)
    inputs = dataclasses.replace(one.inputs, commands=dataclasses.replace(one.inputs.commands, duty=half))
    assert difference(one, dataclasses.replace(one, inputs=inputs)) == ""


def test_a_pump_that_no_longer_gets_there_was_told_the_same() -> None:
    """At full duty the held vacuum says little; a machine with a fault stays comparable to its references."""
    one = recorded("pressure")
    held_pa, regulated = held_vacuum(one)
    assert held_pa == pytest.approx(50e3, abs=3e3)
    assert regulated
    signals = tuple(
        dataclasses.replace(each, values=101_325.0 - 0.7 * (101_325.0 - each.values))
        if each.name.endswith("/pressure")
        else each
        for each in one.signals
    )
    weak = dataclasses.replace(one, signals=signals)
    assert "kPa held" in difference(one, weak)
    full = Timeline(np.zeros(1), np.ones(1))
    inputs = dataclasses.replace(one.inputs, commands=dataclasses.replace(one.inputs.commands, duty=full))
    assert difference(one, dataclasses.replace(weak, inputs=inputs)) == ""


def test_a_command_as_one_recorder_is_switched_off_does_not_count() -> None:
    """The shorter recording ends just before the last switching, which the longer one has."""
    one = recorded("pressure")
    end_s = float(one.inputs.commands.solenoids[names.ACHILLES].changes().time_s[-1])
    signals = tuple(
        dataclasses.replace(each, time_s=each.time_s[each.time_s < end_s - 0.05],
                            values=each.values[each.time_s < end_s - 0.05])
        for each in one.signals
    )  # fmt: skip
    short = dataclasses.replace(one, signals=signals)
    assert difference(one, short) == ""
    assert difference(short, one) == ""


@pytest.mark.parametrize(("scale", "is_repeat"), [(1.01, True), (1.03, False), (0.5, False)])
def test_pulls_of_other_length_are_no_repeats(scale: float, is_repeat: bool) -> None:  # noqa: FBT001 - a table
    """Two per cent of the range is what a drive's speed makes of a way; more is another pull."""
    one = foreign("tensile")
    course = one.inputs.course
    longer = Course(course.time_s, scale * course.position_m)
    other = dataclasses.replace(one, inputs=dataclasses.replace(one.inputs, course=longer))
    assert (difference(one, other) == "") is is_repeat


def test_settings_of_many_bags_have_texts_of_their_own() -> None:
    """Short, telling, and no two settings with the same, whatever the order."""
    runs = [
        recorded("tensile", 0),
        recorded("pressure"),
        foreign("tensile"),
        recorded("tensile", 1),
        recorded("landing"),
    ]
    found = with_settings(runs)
    texts = [each.setting for each in found]
    assert texts[0] == texts[3] == "tensile, 50 kPa, 10.0 mm at 20 mm/s"
    assert texts[2] == "tensile, 50 kPa, 10.0 mm at 20 mm/s (2)"
    assert texts[1] == "pressure, 50 kPa"
    assert texts[4] == "landing, 50 kPa, 50 mm"
    assert [each.name for each in found] == [each.name for each in runs]


SHORT_RUNS = {
    "tensile": {"vacuum_pa": 50e3, "speed_m_s": 0.05, "extension_m": 0.01},
    "pressure": {"cycles": 1, "jam_time_s": 0.6, "vent_time_s": 0.4},
    "drop": {"foot": "jammed"},
    "slip": {"foot": "unjammed", "speed_m_s": 0.05, "descent_m": 0.02},
    "landing": {},
}


def described(rig: str, repeat: int | None = None, **changed: object) -> Recording:
    """Run a rig, scattered if a repeat is given."""
    options = RIGS[rig].options(**{**SHORT_RUNS[rig], **changed})
    chosen = options if repeat is None else scattered(rig, options, repeat)
    return recording_of_run(run_rig(rig, chosen, lambda _: None, lambda: False), f"{rig} {repeat}")


@pytest.mark.parametrize("rig", SHORT_RUNS)
def test_scattered_runs_share_their_signatures(rig: str) -> None:
    """What a rig cannot set the same twice makes no group of its own."""
    assert len({group_of(described(rig, repeat)) for repeat in range(4)}) == 1


@pytest.mark.parametrize(
    ("rig", "changed"),
    [
        ("tensile", {"vacuum_pa": 30e3}),
        ("tensile", {"speed_m_s": 0.03}),
        ("tensile", {"channel": names.ACHILLES}),
        ("pressure", {"jam_time_s": 0.9}),
        ("pressure", {"cycles": 2}),
        ("pressure", {"channel": names.ACHILLES}),
        ("drop", {"drop_height_m": 0.07}),
        ("landing", {"slope_deg": 30.0}),
        ("landing", {"jam": "before"}),
    ],
)
def test_what_was_done_otherwise_has_signatures_of_its_own(rig: str, changed: dict[str, object]) -> None:
    """Whether the setting's short text tells of it or not."""
    assert group_of(described(rig)) != group_of(described(rig, **changed))


def test_the_short_text_of_a_setting_is_no_group() -> None:
    """Two programmes of the pressure rig read the same, and jam at other times."""
    one, other = described("pressure"), described("pressure", jam_time_s=0.9)
    assert setting_text(one) == setting_text(other)
    assert group_of(one) != group_of(other)


def test_what_two_recordings_measure_a_little_otherwise_is_one_group() -> None:
    """A vacuum that reads 0.8 kPa more, a carriage that reads half a per cent more."""
    one = described("tensile")
    course = one.inputs.course
    assert course is not None
    inputs = dataclasses.replace(one.inputs, course=dataclasses.replace(course, position_m=1.005 * course.position_m))
    signals = tuple(
        dataclasses.replace(each, values=each.values - 800.0) if each.name.endswith("/pressure") else each
        for each in one.signals
    )
    assert group_of(dataclasses.replace(one, inputs=inputs, signals=signals)) == group_of(one)
