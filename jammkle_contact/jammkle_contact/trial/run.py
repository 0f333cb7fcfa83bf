"""Run the cases of a trial, and pool their scores by part, place of the IMU, kind of event and way."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import joblib  # type: ignore[import-untyped]  # carries no types

from jammkle_contact.recording import Heard
from jammkle_contact.replay import hear, new_controller
from jammkle_contact.sensing import CLOCK_START_S
from jammkle_contact.trial.baselines import WAYS
from jammkle_contact.trial.cases import HELD_OUT, TUNING, Case, cases_from
from jammkle_contact.trial.scoring import Score, score_slides, score_times
from jammkle_controller.core.events import ContactKind
from jammkle_controller.parameters import ControllerParameters
from jammkle_graph.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jammkle_contact.story import Story
    from jammkle_controller.core.density_ratio import StepRatios

OURS, WITH_EFFORTS = "ours", "ours, with efforts"
WITH_ODOMETRY = "ours, with efforts and odometry"
KINDS = {"impact": ContactKind.IMPACT, "lift-off": ContactKind.LIFTOFF, "slip": ContactKind.SLIP}
SEEN_S = 0.3
"""What happens in so short a time after a begin is not scored, s: a simulated robot is set down there, while an IMU is
still looked at, and without a swing before it."""
Key = tuple[str, str, str, str, str]
"""Part, source, place of the IMU, kind of event, way (with its setting, for a baseline)."""


@dataclass
class Outcome:
    """What came of some cases."""

    scores: dict[Key, Score] = field(default_factory=lambda: defaultdict(Score))
    steps: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    """Touch-downs and slides, by part."""
    unavailable: int = 0
    """Stories at whose end the IMU was not believed, though it was in order."""
    empty: int = 0
    """Cases whose simulation blew up."""

    def add(self, other: Outcome) -> None:
        """Pool another one into this."""
        for key, score in other.scores.items():
            self.scores[key].add(score)
        for part, count in other.steps.items():
            self.steps[part] += count
        self.unavailable += other.unavailable
        self.empty += other.empty


def run_case(case: Case) -> Outcome:
    """Make the stories of a case, and score every way on them."""
    outcome = Outcome(defaultdict(Score), defaultdict(int))
    stories = case.stories()
    outcome.empty = int(not stories)
    for story in stories:
        outcome.steps[case.part] += sum(scored(story, kind, ()).missed for kind in ("impact", "slip"))
        told, believed = told_by_ours(story)
        outcome.unavailable += not believed
        for kind, times_s in told.items():
            outcome.scores[case.part, case.source, case.mount, kind, OURS].add(scored(story, kind, times_s))
        for foot in story.feet or (story,):
            if foot.legs:
                for kind, times_s in told_by_ours(foot, efforts=True)[0].items():
                    key = (case.part, case.source, case.mount, kind, WITH_EFFORTS)
                    outcome.scores[key].add(scored(foot, kind, times_s))
                times_s = told_by_ours(foot, efforts=True, odometry=True)[0]["slip"]
                key = (case.part, case.source, case.mount, "slip", WITH_ODOMETRY)
                outcome.scores[key].add(scored(foot, "slip", times_s))
        for name, (way, settings) in WAYS.items():
            for setting in settings:
                times_s = way(story.samples, setting)
                for kind in KINDS:
                    key = (case.part, case.source, case.mount, kind, f"{name} {setting:g}")
                    outcome.scores[key].add(scored(story, kind, times_s))
    return outcome


def told_by_ours(
    story: Story, ratios: StepRatios | None = None, *, efforts: bool = False, odometry: bool = False
) -> tuple[dict[str, list[float]], bool]:
    """Return the times, s, that a controller tells by kind, and whether it believes the IMU at the end.

    Args:
        story: What it hears.
        ratios: Density ratios; None: those that come with it.
        efforts: Whether it hears the leg's drives as well.
        odometry: Whether it hears the body's speed, and all joints.

    """
    place: dict[str, Any] = dict(story.place) if odometry else {}
    parameters = ControllerParameters(imu_mount=story.mount, use_efforts=efforts, use_odometry=odometry, **place)
    controller = new_controller(parameters, ratios)
    told: dict[str, list[float]] = {kind: [] for kind in KINDS}
    names = {each: kind for kind, each in KINDS.items()}
    heard = [Heard(sample.time_ns, sample) for sample in story.samples]
    if odometry:
        heard = [*(Heard(*each) for each in story.poses), *(Heard(*each) for each in story.twists), *heard]
    if efforts:  # of one time the leg comes first, as on the graph
        legs = [Heard(*each) for each in story.legs]
        heard = sorted([*legs, *heard], key=lambda each: each.time_ns)
    for each in heard:
        for event in hear(controller, each).events:
            if event.kind in names:
                told[names[event.kind]].append(event.time_ns / NANOSECONDS_PER_SECOND)
    return told, controller.watch.trouble is None


def scored(story: Story, kind: str, times_s: Sequence[float]) -> Score:
    """Score times of a kind on a story, from `SEEN_S` after its begin."""
    begin_s = CLOCK_START_S + SEEN_S
    told_s = [at_s for at_s in times_s if at_s >= begin_s]
    if kind == "slip":
        return score_slides([slide for slide in story.slides if slide.begin_s >= begin_s], told_s)
    truth_s = story.touchdowns_s if kind == "impact" else story.liftoffs_s
    unclear_s = story.touches_s if kind == "impact" else story.leaves_s
    return score_times([at_s for at_s in truth_s if at_s >= begin_s], told_s, kind, unclear_s)


def run_trial(seed: int, steps: int, jobs: int, on_progress: Callable[[float, str], None]) -> Outcome:
    """Run cases of both parts until each has half of the steps.

    Args:
        seed: Of the trial.
        steps: Touch-downs and slides in all, at least.
        jobs: Processes.
        on_progress: Called with the share done and what is being done.

    """
    whole = Outcome(defaultdict(Score), defaultdict(int))
    batch = 10
    for part in (TUNING, HELD_OUT):
        done = 0
        while whole.steps[part] * 2 < steps:
            cases = cases_from(part, seed, done + batch)[done:]
            for outcome in joblib.Parallel(n_jobs=jobs)(joblib.delayed(run_case)(case) for case in cases):
                whole.add(outcome)
            done += batch
            on_progress(min(1.0, sum(whole.steps.values()) / steps), part)
    return whole


def best_settings(outcome: Outcome, mount: str = "") -> dict[tuple[str, str], str]:
    """Return the way with its best setting on the tuning part, by kind and name of the baseline.

    Args:
        outcome: Of a trial.
        mount: Where the IMU is; empty: one setting for all places.

    """
    best: dict[tuple[str, str], str] = {}
    for kind in KINDS:
        for name, (_, settings) in WAYS.items():
            ways = [f"{name} {setting:g}" for setting in settings]
            marks = {way: harmonic_mean(pooled(outcome, TUNING, kind, way, mount)) for way in ways}
            best[kind, name] = max(marks, key=marks.__getitem__)
    return best


def pooled(outcome: Outcome, part: str, kind: str, way: str, mount: str = "", source: str = "") -> Score:
    """Return the score of a way over all places of the IMU and sources, or some."""
    total = Score()
    for (its_part, its_source, its_mount, its_kind, its_way), score in outcome.scores.items():
        fits = (its_part, its_kind, its_way) == (part, kind, way)
        if fits and mount in ("", its_mount) and source in ("", its_source):
            total.add(score)
    return total


def harmonic_mean(score: Score) -> float:
    """Return the harmonic mean of recall and precision."""
    return 2 * score.hits / max(1, 2 * score.hits + score.missed + score.false)
