"""Stories, scores, and what the detectors make of them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from jammkle_contact.replay import new_controller
from jammkle_contact.robot_stories import contact_changes
from jammkle_contact.story import Slide
from jammkle_contact.synthetic import walk
from jammkle_contact.trial.cases import Case
from jammkle_contact.trial.run import run_case
from jammkle_contact.trial.scoring import Score, score_slides, score_times, wilson
from jammkle_controller.core.events import ContactKind
from jammkle_controller.parameters import ControllerParameters


@pytest.mark.parametrize("mount", ["foot", "shank"])
def test_a_foot_that_steps_is_felt_without_free_fall(mount: str) -> None:
    """Most steps of synthetic walks are told as a lift-off and an impact each, in turn, with probabilities."""
    lifts, lands = Score(), Score()
    for seed in (200_000, 200_001, 200_002):
        story = walk(seed, mount, 6)
        controller = new_controller(ControllerParameters(imu_mount=mount))
        events = [event for sample in story.samples for event in controller.update(sample).events]
        told = {kind: [e.time_ns * 1e-9 for e in events if e.kind is kind] for kind in ContactKind}
        lifts.add(score_times(story.liftoffs_s, told[ContactKind.LIFTOFF], "lift-off"))
        lands.add(score_times(story.touchdowns_s, told[ContactKind.IMPACT], "impact"))
        changes = [e.kind for e in events if e.kind in (ContactKind.LIFTOFF, ContactKind.IMPACT)]
        assert all(one is not other for one, other in itertools.pairwise(changes))
        assert all(0.0 < event.probability <= 1.0 for event in events)
    assert lifts.hits >= 15
    assert lands.hits >= 13


def test_a_story_is_the_same_every_time_and_its_truth_alternates() -> None:
    """One seed makes one story, sample by sample; lift-offs and touch-downs take turns."""
    one, other = walk(7, "foot", 3), walk(7, "foot", 3)
    assert one.samples == other.samples
    assert len(one.touchdowns_s) == len(one.liftoffs_s) == 3
    assert all(lift < land for lift, land in zip(one.liftoffs_s, one.touchdowns_s, strict=True))


def test_chatter_is_no_step() -> None:
    """Touch that is lost for 10 ms is not a lift-off; that of 200 ms is one, and its end a touch-down."""
    stands = np.ones(1000, dtype=bool)
    stands[100:110] = False
    stands[400:600] = False
    assert contact_changes(stands) == ([600], [400])


def test_scores_count_each_truth_and_each_event_once() -> None:
    """Two events near one truth are a hit and a false alarm; a slide's later events are neither."""
    score = score_times([1.0, 2.0], [1.001, 1.002, 3.0], "impact")
    assert (score.hits, score.missed, score.false) == (1, 1, 2)
    assert score.delays_s == [pytest.approx(0.001)]
    slide = Slide(1.0, 1.2, np.array([1.0, 1.2]), np.array([0.0, 0.02]))
    score = score_slides([slide], [1.1, 1.15, 2.0])
    assert (score.hits, score.missed, score.false) == (1, 0, 1)
    assert score.ways_m == [pytest.approx(0.01)]
    share, low, high = wilson(9, 10)
    assert low < 0.6 < share == 0.9 < high < 1.0


def test_a_case_of_a_trial_is_repeatable_and_of_its_own_kind() -> None:
    """One case of a robot comes out the same twice, counts steps, and scores every way on all kinds of events."""
    case = Case("tuning", "leg", "foot", 100_002)
    one, other = run_case(case), run_case(case)
    assert {key: vars(score) for key, score in one.scores.items()} == {
        key: vars(score) for key, score in other.scores.items()
    }
    assert one.steps["tuning"] >= 1
    assert {kind for _, _, _, kind, _ in one.scores} == {"impact", "lift-off", "slip"}
