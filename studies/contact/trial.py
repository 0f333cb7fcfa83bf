"""The trial of the detectors: cases, baselines, and what is counted as found.

The baselines are a threshold on the magnitude and a cumulative sum, on the same samples; ruptures and statsmodels find
changes in a whole recording, so that a cumulative sum that is asked at every sample stands here. Events and truth are
paired one to one, for recall, precision and delay with their intervals.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import joblib  # type: ignore[import-untyped]  # carries no types
import numpy as np

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.events import ContactKind
from jammkle_controller.core.reading import Received
from jammkle_controller.parameters import ControllerParameters
from jammkle_sim.robots.options import RobotOptions
from studies.contact.labelled import CLOCK_START_S, walk
from studies.contact.robots import robot_recordings

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jammkle_controller.core.imu import ImuSample
    from jammkle_controller.core.stepping import StepRatios
    from studies.contact.labelled import LabelledRecording, Slide

REFRACTORY_S = 0.15
"""As of the detectors: after an alarm no other for so long, s."""
_SPREAD_TIME_S = 1.0

THRESHOLDS_M_S2 = (2.0, 4.0, 8.0, 12.0, 20.0, 30.0, 40.0)
LIMITS = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0, 1280.0)
"""Settings that are tried on the tuning part; the best by the harmonic mean of recall and precision is taken."""


def magnitude(samples: Sequence[ImuSample], threshold_m_s2: float) -> list[float]:
    """Return when | |f| - g | exceeds a threshold, s."""
    reported: list[float] = []
    for sample in samples:
        force = math.hypot(sample.force_x, sample.force_y, sample.force_z)
        if abs(force - STANDARD_GRAVITY_M_S2) > threshold_m_s2:
            _tell(reported, sample)
    return reported


def cusum(samples: Sequence[ImuSample], limit: float) -> list[float]:
    """Return when a cumulative sum of the normalised deviation exceeds a limit, s (Page, Biometrika 41, 1954).

    S <- max(0, S + (d / s)^2 - 2), with d the deviation of |f| from its mean of 20 ms and s its spread over a second:
    a mean square of one is drift, of more is change.
    """
    reported: list[float] = []
    mean, spread, total, before = STANDARD_GRAVITY_M_S2, 1.0, 0.0, None
    for sample in samples:
        force = math.hypot(sample.force_x, sample.force_y, sample.force_z)
        elapsed_s = 0.0 if before is None else max(0.0, (sample.time_ns - before) / NANOSECONDS_PER_SECOND)
        before = sample.time_ns
        deviation = force - mean
        mean += deviation * elapsed_s / (elapsed_s + 0.02)
        total = max(0.0, total + deviation * deviation / (spread + 1e-4) - 2.0)
        spread += (min(deviation * deviation, 9.0 * spread + 0.01) - spread) * elapsed_s / (elapsed_s + _SPREAD_TIME_S)
        if total > limit:
            total = 0.0
            _tell(reported, sample)
    return reported


def always(samples: Sequence[ImuSample], period_s: float) -> list[float]:
    """Return a time every `period_s`, s."""
    reported: list[float] = []
    for sample in samples:
        _tell(reported, sample, period_s)
    return reported


def _tell(reported: list[float], sample: ImuSample, refractory_s: float = REFRACTORY_S) -> None:
    time_s = sample.time_ns / NANOSECONDS_PER_SECOND
    if not reported or time_s - reported[-1] >= refractory_s:
        reported.append(time_s)


WAYS: dict[str, tuple[Callable[[Sequence[ImuSample], float], list[float]], tuple[float, ...]]] = {
    "magnitude": (magnitude, THRESHOLDS_M_S2),
    "cumulative sum": (cusum, LIMITS),
    "always": (always, (0.1,)),
}
"""By name: the way, and the settings to choose from. Never has a recall of 0."""


Z_95 = 1.959964
"""Quantile of the normal distribution for intervals of 95 %."""
_RESAMPLES = 1000

WINDOWS_S = {"impact": (-0.02, 0.06), "lift-off": (-0.06, 0.15), "slip": (-0.005, 0.05)}
"""From how long before to how long after the truth an event counts as it, s. For a slip the
second counts from the slide's end, at most to `LATEST_SLIP_S`. A lift-off counts from the unloading on and for half of
a short swing."""

UNCLEAR_S = WINDOWS_S["impact"]
"""The same for what need not be reported, whether a touch or its loss: a foot that rebounds is back after 60 ms, s."""

LATEST_SLIP_S = 0.2
"""So long after a slide's start its slip must be reported, s: as slides within a step last. Who slides down a slope
for a second is hit by something, and what reports of that has not felt the slip."""


@dataclass
class Score:
    """Counts of one kind of event, pooled over recordings."""

    hits: int = 0
    missed: int = 0
    false: int = 0
    delays_s: list[float] = field(default_factory=list)
    ways_m: list[float] = field(default_factory=list)
    """How far the foot had slid when the slip was reported, m."""

    def add(self, other: Score) -> None:
        """Pool another one into this."""
        self.hits += other.hits
        self.missed += other.missed
        self.false += other.false
        self.delays_s += other.delays_s
        self.ways_m += other.ways_m

    @property
    def recall(self) -> tuple[float, float, float]:
        """Share of the true events that were reported, with its interval."""
        return wilson(self.hits, self.hits + self.missed)

    @property
    def precision(self) -> tuple[float, float, float]:
        """Share of the reported events that are true, with its interval."""
        return wilson(self.hits, self.hits + self.false)

    def figures(self) -> dict[str, Any]:
        """Return counts, recall and precision for machines."""
        return {
            "true": self.hits + self.missed,
            "reported": self.hits + self.false,
            "recall": finite(self.recall),
            "precision": finite(self.precision),
        }


def finite(values: Sequence[float]) -> list[float] | None:
    """Return figures for machines, rounded; None where one is not a number."""
    return None if any(map(math.isnan, values)) else [round(value, 4) for value in values]


def wilson(hits: int, of: int) -> tuple[float, float, float]:
    """Return a share and its 95 % interval (Wilson, J. Am. Stat. Assoc. 22, 1927); NaN of nothing."""
    if of == 0:
        return (math.nan, math.nan, math.nan)
    share = hits / of
    centre = (share + Z_95**2 / (2 * of)) / (1 + Z_95**2 / of)
    half = Z_95 * math.sqrt(share * (1 - share) / of + Z_95**2 / (4 * of**2)) / (1 + Z_95**2 / of)
    return (share, max(0.0, centre - half), min(1.0, centre + half))


def median_with_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Return the median and its 95 % bootstrap interval (Efron 1979); NaN of nothing."""
    if not values:
        return (math.nan, math.nan, math.nan)
    array = np.array(values)
    chance = np.random.default_rng(1)
    medians = np.median(chance.choice(array, (_RESAMPLES, len(array))), axis=1)
    low, high = np.percentile(medians, (2.5, 97.5))
    return (float(np.median(array)), float(low), float(high))


def score_times(
    truth_s: Sequence[float], reported_s: Sequence[float], kind: str, unclear_s: Sequence[float] = ()
) -> Score:
    """Match reported times to true ones in order, each at most once.

    Args:
        truth_s: What must be reported, s.
        reported_s: What was reported, s.
        kind: Of the events: a key of `WINDOWS_S`.
        unclear_s: What may be reported and need not: a rebound, or the graze of a foot in swing. Within `UNCLEAR_S` of
            it an event is neither right nor wrong.

    """
    before_s, after_s = WINDOWS_S[kind]
    score = Score()
    free = sorted(reported_s)
    for true_s in sorted(truth_s):
        inside = [at_s for at_s in free if true_s + before_s <= at_s <= true_s + after_s]
        if inside:
            score.hits += 1
            score.delays_s.append(inside[0] - true_s)
            free.remove(inside[0])
        else:
            score.missed += 1
    before_s, after_s = UNCLEAR_S
    score.false = sum(not any(at + before_s <= reported <= at + after_s for at in unclear_s) for reported in free)
    return score


def score_slides(slides: Sequence[Slide], reported_s: Sequence[float]) -> Score:
    """Match slips to slides: the first within one counts, if it comes in time; more are neither right nor wrong."""
    before_s, after_s = WINDOWS_S["slip"]
    score = Score()
    free = sorted(reported_s)
    for slide in slides:
        inside = [at_s for at_s in free if slide.begin_s + before_s <= at_s <= slide.end_s + after_s]
        free = [at_s for at_s in free if at_s not in inside]
        if not inside or inside[0] > slide.begin_s + LATEST_SLIP_S:
            score.missed += 1
            continue
        score.hits += 1
        score.delays_s.append(inside[0] - slide.begin_s)
        score.ways_m.append(slide.way_at_m(inside[0]))
    score.false = len(free)
    return score


FIRST_TRIAL_SEED = 100_000
"""Those of what was learned from are below."""
TUNING, HELD_OUT = "tuning", "held out"
STRIDES = 8
SOURCES = {
    TUNING: (("walk", "foot"), ("walk", "shank"), ("leg", "foot"), ("leg", "shank"), ("leg", "body")),
    HELD_OUT: (
        ("walk", "foot"),
        ("walk", "shank"),
        ("quadruped", "foot"),
        ("quadruped", "shank"),
        ("quadruped", "body"),
    ),
}
"""Source of recordings and place of the IMU, by part: the robot held out is in none that is learned from."""


@dataclass(frozen=True)
class Case:
    """One run: everything else is drawn from its seed."""

    part: str
    source: str
    mount: str
    seed: int

    def recordings(self) -> list[LabelledRecording]:
        """Make its recordings: one, or one per ankle; none where the simulation blew up."""
        wide = self.part == HELD_OUT
        if self.source == "walk":
            return [walk(self.seed, self.mount, STRIDES, wide=wide)]
        return robot_recordings(self.source, self.seed, self.mount, wide=wide)


def cases_from(part: str, seed: int, count: int) -> list[Case]:
    """Return `count` cases of a part, its sources in turn.

    Args:
        part: One of SOURCES.
        seed: Of the trial, whose cases begin at 10,000 times it above `FIRST_TRIAL_SEED`.
        count: How many.

    """
    sources = SOURCES[part]
    return [Case(part, *sources[i % len(sources)], FIRST_TRIAL_SEED + 10_000 * seed + i) for i in range(count)]


OURS, WITH_ANKLE, WITH_EFFORTS = "ours", "ours, with the ankle", "ours, with efforts"
WITH_ODOMETRY = "ours, with the ankle, efforts and odometry"
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
    """Make the recordings of a case, and score every way on them."""
    outcome = Outcome()
    recordings = case.recordings()
    outcome.empty = int(not recordings)
    for recording in recordings:
        outcome.steps[case.part] += sum(scored(recording, kind, ()).missed for kind in ("impact", "slip"))
        reported, believed = detected_by_ours(recording)
        outcome.unavailable += not believed
        for kind, times_s in reported.items():
            outcome.scores[case.part, case.source, case.mount, kind, OURS].add(scored(recording, kind, times_s))
        for foot in recording.feet or (recording,):
            if foot.legs:
                for ours, found in (
                    (WITH_ANKLE, detected_by_ours(foot, ankle=True)[0]),
                    (WITH_EFFORTS, detected_by_ours(foot, efforts=True)[0]),
                ):
                    for kind, times_s in found.items():
                        outcome.scores[case.part, case.source, case.mount, kind, ours].add(scored(foot, kind, times_s))
                times_s = detected_by_ours(foot, ankle=True, efforts=True, odometry=True)[0]["slip"]
                key = (case.part, case.source, case.mount, "slip", WITH_ODOMETRY)
                outcome.scores[key].add(scored(foot, "slip", times_s))
        for name, (way, settings) in WAYS.items():
            for setting in settings:
                times_s = way(recording.samples, setting)
                for kind in KINDS:
                    key = (case.part, case.source, case.mount, kind, f"{name} {setting:g}")
                    outcome.scores[key].add(scored(recording, kind, times_s))
    return outcome


def detected_by_ours(
    recording: LabelledRecording,
    ratios: StepRatios | None = None,
    *,
    ankle: bool = False,
    efforts: bool = False,
    odometry: bool = False,
) -> tuple[dict[str, list[float]], bool]:
    """Return the times, s, that a controller reports by kind, and whether it believes the IMU at the end.

    Args:
        recording: What it receives.
        ratios: Density ratios; None: those that come with it.
        ankle: Whether it receives the ankle's angles as well.
        efforts: Whether it receives the leg's drives as well.
        odometry: Whether it receives the body's speed, and all joints.

    """
    parameters = ControllerParameters(
        imu_mount=recording.mount,
        hang_pitch_deg=RobotOptions().hang_pitch_deg,
        use_efforts=efforts,
        use_odometry=odometry,
    )
    controller = AnkleController(parameters, ratios, recording.leg)
    reported: dict[str, list[float]] = {kind: [] for kind in KINDS}
    names = {each: kind for kind, each in KINDS.items()}
    received = [Received(sample.time_ns, sample) for sample in recording.samples]
    if odometry:
        received = [
            *(Received(*each) for each in recording.poses),
            *(Received(*each) for each in recording.twists),
            *received,
        ]
    if ankle or efforts:  # of one time the leg comes first, as on the graph
        legs = [Received(*each) for each in recording.legs] if efforts else []
        ankles = [Received(*each) for each in recording.ankle_readings()] if ankle else []
        received = sorted([*ankles, *legs, *received], key=lambda each: each.time_ns)
    for each in received:
        for event in controller.take(each).events:
            if event.kind in names:
                reported[names[event.kind]].append(event.time_ns / NANOSECONDS_PER_SECOND)
    return reported, controller.watch.trouble is None


def scored(recording: LabelledRecording, kind: str, times_s: Sequence[float]) -> Score:
    """Score times of a kind on a recording, from `SEEN_S` after its start until the robot falls over."""
    begin_s, end_s = CLOCK_START_S + SEEN_S, recording.fell_s

    def counted(all_s: Sequence[float]) -> list[float]:
        return [at_s for at_s in all_s if begin_s <= at_s < end_s]

    if kind == "slip":
        slides = [slide for slide in recording.slides if begin_s <= slide.begin_s < end_s]
        return score_slides(slides, counted(times_s))
    truth_s = recording.touchdowns_s if kind == "impact" else recording.liftoffs_s
    unclear_s = recording.touches_s if kind == "impact" else recording.leaves_s
    return score_times(counted(truth_s), counted(times_s), kind, unclear_s)


def run_trial(seed: int, steps: int, jobs: int, on_progress: Callable[[float, str], None]) -> Outcome:
    """Run cases of both parts until each has half of the steps.

    Args:
        seed: Of the trial.
        steps: Touch-downs and slides in all, at least.
        jobs: Processes.
        on_progress: Called with the share done and what is being done.

    """
    whole = Outcome()
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
