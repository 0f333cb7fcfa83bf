"""Stories, scores, and what the detectors make of them."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.events import ContactKind
from jammkle_controller.core.leg_contact import AnkleMotion, StanceTrees
from jammkle_controller.core.stepping import learned, ratios_of
from jammkle_controller.parameters import ControllerParameters
from studies.contact.labelled import LabelledRecording, Slide, draw_imu, walk
from studies.contact.real_foot import real_foot
from studies.contact.relearn import cross_validated, held_still, learn, learn_ankle
from studies.contact.robots import Traces, contact_changes, of_the_body, recording_of, robot_recordings
from studies.contact.trial import Case, Score, run_case, score_slides, score_times, scored, wilson

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("mount", ["foot", "shank"])
def test_a_foot_that_steps_is_felt_without_free_fall(mount: str) -> None:
    """Most steps of synthetic walks are reported as a lift-off and an impact each, in turn, with probabilities."""
    lifts, lands = Score(), Score()
    for seed in (200_000, 200_001, 200_002):
        recording = walk(seed, mount, 6)
        controller = AnkleController(ControllerParameters(imu_mount=mount))
        events = [event for sample in recording.samples for event in controller.update(sample).events]
        reported = {kind: [e.time_ns * 1e-9 for e in events if e.kind is kind] for kind in ContactKind}
        lifts.add(score_times(recording.liftoffs_s, reported[ContactKind.LIFTOFF], "lift-off"))
        lands.add(score_times(recording.touchdowns_s, reported[ContactKind.IMPACT], "impact"))
        changes = [e.kind for e in events if e.kind in (ContactKind.LIFTOFF, ContactKind.IMPACT)]
        assert all(one is not other for one, other in itertools.pairwise(changes))
        assert all(0.0 < event.probability <= 1.0 for event in events)
    assert lifts.hits >= 15
    assert lands.hits >= 13


def test_a_story_is_the_same_every_time_and_its_truth_alternates() -> None:
    """One seed makes one recording, sample by sample; lift-offs and touch-downs take turns."""
    one, other = walk(7, "foot", 3), walk(7, "foot", 3)
    assert one.samples == other.samples
    assert len(one.touchdowns_s) == len(one.liftoffs_s) == 3
    assert all(lift < land for lift, land in zip(one.liftoffs_s, one.touchdowns_s, strict=True))


def test_chatter_is_no_step() -> None:
    """Touch that is lost for 10 or 50 ms is not a lift-off; that of 200 ms is one, and its end a touch-down.

    A graze of 30 ms in that swing is neither.
    """
    stands = np.ones(1000, dtype=bool)
    stands[100:110] = stands[200:250] = stands[400:600] = False
    stands[480:510] = True
    assert contact_changes(stands) == ([600], [400])


def test_scores_count_each_truth_and_each_event_once() -> None:
    """Two events near one truth are a hit and a false alarm; a slide's later events are neither."""
    score = score_times([1.0, 2.0], [1.001, 1.002, 3.0], "impact")
    assert (score.hits, score.missed, score.false) == (1, 1, 2)
    assert score.delays_s == [pytest.approx(0.001)]
    grazed = score_times([1.0], [0.5, 1.0], "impact", unclear_s=[0.5])
    assert (grazed.hits, grazed.missed, grazed.false) == (1, 0, 0)
    slide = Slide(1.0, 1.2, np.array([1.0, 1.2]), np.array([0.0, 0.02]))
    score = score_slides([slide], [1.1, 1.15, 2.0])
    assert (score.hits, score.missed, score.false) == (1, 0, 1)
    assert score.ways_m == [pytest.approx(0.01)]
    share, low, high = wilson(9, 10)
    assert low < 0.6 < share == 0.9 < high < 1.0


def test_a_body_is_carried_while_any_foot_stands_and_slides_as_they_do_on_average() -> None:
    """Of two feet of which one slides the body slides half as fast, and it lifts off when both have."""
    still, slides = np.zeros(100), np.full(100, 0.2)
    one, other = np.ones(100, dtype=bool), np.ones(100, dtype=bool)
    one[50:], other[80:] = False, False
    imu = np.zeros((100, 6))
    body = of_the_body([Traces(imu, one, still, still, imu), Traces(imu, other, slides, still, imu)])
    assert body.stands.tolist() == [True] * 80 + [False] * 20
    assert body.sliding_m_s[[0, 60, 90]].tolist() == pytest.approx([0.1, 0.2, 0.0])


def test_two_clocks_of_a_real_foot_are_put_together(tmp_path: Path) -> None:
    """A foot that turns while the force is gone gives away that its IMU runs 5 % slow and began 0.3 s late."""
    force_s, imu_s = np.arange(4000) / 500.0, np.arange(1800) / 250.0
    chance = np.random.default_rng(3)
    begins = 0.5 + np.cumsum(chance.uniform(0.6, 0.9, 9))

    def swings(time_s: np.ndarray) -> np.ndarray:
        return np.array([any(begin <= at < begin + 0.25 for begin in begins) for at in time_s])

    rate = np.where(swings(0.95 * imu_s + 0.3), 300.0, 10.0) + chance.normal(0.0, 5.0, len(imu_s))
    path = tmp_path / "walk.csv"
    with path.open("w") as file:
        for index, force in enumerate(np.where(swings(force_s), 20.0, 400.0)):
            row = f"0,{-1 + 0.01 * chance.normal()},0,{rate[index]},0,0" if index < len(imu_s) else ",,,,,"
            file.write(f"{force},{row}\n")
    foot = real_foot(path, {("impact", "always"): "always 0.1"})
    assert foot.fit.clock == pytest.approx(0.95, abs=0.006)
    assert foot.fit.shift_s == pytest.approx(0.3, abs=0.04)
    assert foot.touchdowns_s == pytest.approx([begin + 0.25 for begin in begins if begin + 0.25 < 7.1], abs=0.003)
    assert foot.score("impact", "always 0.1").hits >= len(foot.touchdowns_s) - 2


def test_a_foot_that_rebounds_may_be_said_to_have_left() -> None:
    """Its lift-off is neither right nor wrong, as its touch-down; one without any loss of touch is wrong."""
    assert score_times([], [1.03], "lift-off", unclear_s=[1.0]).false == 0
    assert score_times([], [1.03], "lift-off").false == 1
    assert score_times([], [1.08], "lift-off", unclear_s=[1.0]).false == 1
    stands = np.ones(1000, dtype=bool)
    stands[200:240] = stands[600:900] = False
    zeros, chance = np.zeros((1000, 6)), np.random.default_rng(1)
    recording = recording_of(
        "shank", Traces(zeros, stands, zeros[:, 0], zeros[:, 0], zeros), draw_imu(chance), 0.1, chance
    )
    assert recording.liftoffs_s == pytest.approx([1.6])
    assert recording.leaves_s == pytest.approx([1.2, 1.6])


def test_a_case_of_a_trial_is_repeatable_and_of_its_own_kind() -> None:
    """One case of a robot comes out the same twice, counts steps, and scores every way on all kinds of events."""
    case = Case("tuning", "leg", "foot", 100_002)
    one, other = run_case(case), run_case(case)
    assert {key: vars(score) for key, score in one.scores.items()} == {
        key: vars(score) for key, score in other.scores.items()
    }
    assert one.steps["tuning"] >= 1
    assert {kind for _, _, _, kind, _ in one.scores} == {"impact", "lift-off", "slip"}


def test_ratios_are_judged_on_runs_that_they_have_not_seen() -> None:
    """Every true event of every run is scored once, and most swings of walks not learned from are reported."""
    runs = [[walk(seed, "foot", 6)] for seed in range(4)]
    judged = cross_validated("foot", runs, folds=2)
    for kind, score in judged.items():
        assert score.hits + score.missed == sum(scored(recording, kind, ()).missed for run in runs for recording in run)
    assert judged["lift-off"].recall[0] > 0.7
    assert set(learned("foot").swing.centre) != set(ratios_of(learn("foot", runs[0]), "foot").swing.centre)


def test_nothing_counts_once_a_robot_has_fallen_over() -> None:
    """Neither what its feet do on its back, nor what is reported of that."""
    recording = LabelledRecording("shank", [], (2.0, 4.0), (), (), fell_s=3.0)
    score = scored(recording, "impact", [2.01, 3.5])
    assert (score.hits, score.missed, score.false) == (1, 0, 0)


def test_trees_tell_a_stance_from_a_swing_also_of_a_leg_that_is_held_still() -> None:
    """What is learned on one leg holds on the readings of another run of it."""
    hang_rad = ControllerParameters(hang_pitch_deg=30.0).hang_pitch_rad
    recordings = robot_recordings("leg", 1, "shank")
    chance = np.random.default_rng(1)
    trees = StanceTrees(**learn_ankle([(hang_rad, [*recordings, held_still(recordings[0], chance)])]))
    (other,) = robot_recordings("leg", 4, "shank")
    for recording in (other, held_still(other, chance)):
        motion, right = AnkleMotion(hang_rad), []
        for at_ns, reading in recording.ankle_readings():
            features, at_s = motion.follow(reading, at_ns), np.array([at_ns * 1e-9])
            if features is not None and at_s > min(recording.touches_s):
                right.append((trees.log_odds(features) > 0.0) == recording.in_contact(at_s)[0])
        assert np.mean(right) > 0.9
