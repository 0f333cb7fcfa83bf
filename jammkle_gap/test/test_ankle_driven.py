"""Bags of driven rigs: any course, speed and number of pulls, on any channel, with standard types alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jammkle_common import names
from jammkle_common.bags.run_sheet import RunSheet
from jammkle_gap.ankle.bag import Bag, Samples
from jammkle_gap.ankle.recording import bag_of_run, recording_of
from jammkle_gap.core.data import BadRecordingError
from jammkle_sim.rigs.catalogue import RIGS, run_rig
from jammkle_sim.rigs.replay import Course, following
from recorded import SIMULATOR, run, worst_gap

CHANNEL = names.PERONEAL_RIGHT
PULLS = Course(np.array([0.0, 1.2, 1.6, 1.9, 2.3, 2.9, 3.6]), np.array([0.0, 0.0, 0.016, 0.004, 0.012, 0.012, 0.0]))
"""Two pulls of different length and speed, a hold, and a slow way back."""


def foreign(bag: Bag, *, later_s: float = 1.7e9, noise_m: float = 0.0) -> Bag:
    """Return what another recorder makes of a run: standard types, wall clock, a scale with noise."""
    topics = {}
    for name, each in bag.topics.items():
        if name == names.TENDON_STATES.name:
            continue
        columns = dict(each.columns)
        if name == names.JOINT_STATES.name:
            draw = np.random.default_rng(1)
            slide = columns["carriage/position"]
            columns["carriage/position"] = slide + noise_m * draw.standard_normal(len(slide))
        topics[name] = Samples(each.log_s + later_s, each.stamp_s + later_s, columns)
    return Bag("foreign", topics, RunSheet("", {"channel": CHANNEL}) if bag.sheet.rig == "tensile" else RunSheet())


def pulled(course: Course, **options: object) -> Bag:
    """Pull a tendon along a course of its own; the rig's own programme lasts 4.1 s."""
    chosen = {"vacuum_pa": 50e3, "speed_m_s": 0.016, "channel": CHANNEL, **options}
    made = RIGS["tensile"].options(**chosen)
    return bag_of_run(
        run_rig("tensile", made, lambda _: None, lambda: False, lambda rig: following(rig, course)), "pull"
    )


@pytest.mark.parametrize("noise_m", [0.0, 5e-6])
def test_a_pull_of_any_course_is_run_again_to_its_noise(noise_m: float) -> None:
    """Several pulls in one bag, by somebody else's recorder, with nothing known of them but rig and channel."""
    recording = recording_of(foreign(pulled(PULLS), noise_m=noise_m), "tensile")
    assert worst_gap(recording) < 1.5
    assert "carriage/position" not in {each.name for each in recording.signals}
    force = recording.signal("load_cell/force_z")
    by_default = run("tensile", vacuum_pa=50e3, speed_m_s=0.016).topics["load_cell/wrench"]
    default_n = np.interp(force.time_s, by_default.time_s, by_default.column("force_z_n"))
    assert np.abs(default_n - force.values).max() > 20.0


def test_the_channel_that_the_tendon_hangs_on_is_that_of_the_run_sheet() -> None:
    """The simulated tendon stiffens with that channel, and with no other."""
    assert worst_gap(recording_of(foreign(pulled(PULLS)), "tensile", {"channel": CHANNEL})) < 1.5
    assert worst_gap(recording_of(foreign(pulled(PULLS)), "tensile", {"channel": names.ACHILLES})) > 20.0


@pytest.mark.parametrize("foot", ["jammed", "unjammed"])
def test_a_slip_test_follows_its_carriage(foot: str) -> None:
    """Another speed and way than the rig's own, unsaid: until it slides, bins of 50 ms lie at their noise."""
    bag = foreign(bag_of_run(run("slip", foot=foot, speed_m_s=0.03, descent_m=0.05)), noise_m=3e-6)
    recording = recording_of(bag, "slip", {"foot": foot})
    simulated = SIMULATOR(recording, {})
    for name in ("load_cell/force_z", "load_cell/force_x", "ankle_pitch/position"):
        signal = recording.signal(name)
        before = (signal.time_s > 1.2) & (signal.time_s < 2.3)
        residual = (signal.values - simulated[name])[before]
        bins = residual[: len(residual) // 10 * 10].reshape(-1, 10).mean(axis=1)
        assert np.sqrt(np.mean(bins**2)) < 2.0 * signal.deviation, name


def test_times_count_alike_however_early_a_recorder_was_switched_on() -> None:
    """The first motion comes when the rig's own programme has it: repeats lie over each other."""
    plain = recording_of(foreign(pulled(PULLS)), "tensile")
    bag = foreign(pulled(PULLS), later_s=5e8)
    early = {}
    for name, each in bag.topics.items():
        first = each.stamp_s[0] - 0.01 * np.arange(300, 0, -1)
        if name in {names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values())}:
            early[name] = each
            continue
        columns = {key: np.concatenate((np.full(300, values[0]), values)) for key, values in each.columns.items()}
        early[name] = Samples(np.concatenate((first, each.log_s)), np.concatenate((first, each.stamp_s)), columns)
    long = recording_of(Bag("long", early, bag.sheet), "tensile")
    moved_s = [float(np.interp(0.008, each.inputs.course.position_m[:4], each.inputs.course.time_s[:4]))
               for each in (plain, long)]  # fmt: skip
    assert moved_s[0] == pytest.approx(moved_s[1], abs=0.003)
    for channel, line in plain.inputs.commands.solenoids.items():
        assert long.inputs.commands.solenoids[channel].changes().time_s == pytest.approx(
            line.changes().time_s, abs=0.003
        )
    assert worst_gap(long) < 1.5


def test_a_recording_may_begin_in_the_middle_of_a_pull() -> None:
    """The crosshead starts where it was, with the pressures of then; what was before is said to be unknown."""
    bag = foreign(pulled(PULLS))
    late = {name: each.chosen(each.stamp_s > 1.7e9 + 1.5) if "data" not in each.columns else each
            for name, each in bag.topics.items()}  # fmt: skip
    recording = recording_of(Bag("late", late, bag.sheet), "tensile")
    assert recording.inputs.course.start_m == pytest.approx(PULLS.at(np.array([1.502]))[0], abs=1e-4)
    assert any("stretched by 12.1 mm as the recording begins" in note for note in recording.notes)
    simulated = SIMULATOR(recording, {})
    name = names.PRESSURES[CHANNEL].name
    assert np.abs(simulated[name] - recording.signal(name).values).max() < 500.0


def test_a_carriage_that_was_not_recorded_must_be_described() -> None:
    """Refused with the topic to record and the options that stand in for it."""
    bag = foreign(pulled(PULLS))
    blind = Bag("blind", {k: v for k, v in bag.topics.items() if k != names.JOINT_STATES.name})
    with pytest.raises(
        BadRecordingError, match=r"how the carriage of rig 'tensile' was driven; record 'carriage' .*run.yaml"
    ):
        recording_of(blind, "tensile")
    known = recording_of(blind, "tensile", {"extension_m": 0.01, "speed_m_s": 0.01})
    assert known.inputs.course is None


def test_a_crosshead_far_from_any_tendon_is_another_rig() -> None:
    """A slide 30 cm up was none; one line that names value, limit and way out."""
    bag = foreign(pulled(PULLS))
    joints = bag.topics[names.JOINT_STATES.name]
    columns = {"carriage/position": joints.columns["carriage/position"] + 0.3}
    high = {**bag.topics, names.JOINT_STATES.name: dataclasses.replace(joints, columns=columns)}
    with pytest.raises(BadRecordingError, match=r"within 0.2 m .* is at 0.316 m; name the rig .* with --rig"):
        recording_of(dataclasses.replace(bag, topics=high), "tensile")


def test_a_late_encoder_saw_the_pull_late() -> None:
    """Effects of the sensor that saw the motion change when it was: the force then comes sooner than it is read."""
    recording = recording_of(pulled(PULLS))
    nominal, late = SIMULATOR(recording, {}), SIMULATOR(recording, {"joint_delay.delay_s": 0.02})
    time_s = recording.signal("load_cell/force_z").time_s
    rising = (time_s > 1.25) & (time_s < 1.55)
    sooner = np.interp(time_s, time_s - 0.02, nominal["load_cell/force_z"])
    assert np.abs(late["load_cell/force_z"] - sooner)[rising].max() < 0.2
    assert np.array_equal(late["manifold/pressure"], nominal["manifold/pressure"])


def test_two_publishers_may_share_the_joint_states() -> None:
    """One knows the carriage, the other the ankle: what a message lacks is no missing number."""
    bag = bag_of_run(run("slip", foot="unjammed", speed_m_s=0.05))
    joints = bag.topics[names.JOINT_STATES.name]
    odd = np.arange(len(joints.stamp_s)) % 2 == 1
    lacking = {name: odd if name.startswith("carriage") else ~odd for name in joints.columns}
    shared = dataclasses.replace(joints, lacking=lacking)
    recording = recording_of(dataclasses.replace(bag, topics={**bag.topics, names.JOINT_STATES.name: shared}))
    assert recording.inputs.course is not None
    pitch = recording.signal("ankle_pitch/position")
    assert set(pitch.time_s) <= set(joints.stamp_s[odd])
