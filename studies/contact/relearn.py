"""Learn the density ratios of the detectors anew, and say whether they are better; learn the trees of the ankle.

    python -m studies.contact.relearn [--write]

They are learned on synthetic walks and a simulated leg, of seeds below the `FIRST_TRIAL_SEED` of every trial. New ones
are judged by cross-validation, each fold by ratios that were learned on the others; those in use may have seen all of
it, which is in their favour. Nothing held out and no recording is in it. The weights in `learned.json` are older than
the present truth of simulated steps (rebounds and grazes): learned anew they come out no better (README.md).

The trees that tell a stance from a swing by the ankle are learned on legs and quadrupeds of the tuning part's ranges.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier  # type: ignore[import-untyped]  # carries no types
from sklearn.linear_model import LogisticRegression  # type: ignore[import-untyped]  # carries no types

import jammkle_controller.core
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.detector import ContactDetector
from jammkle_controller.core.events import Phase
from jammkle_controller.core.imu import IGNORED, Admission, ImuGate
from jammkle_controller.core.leg_contact import TREES_FILE, AnkleMotion
from jammkle_controller.core.motion import Motion
from jammkle_controller.core.stepping import (
    LEAST_BLOW_M_S2,
    LEAST_RATIO,
    WEIGHTS_FILE,
    StepRatios,
    learned,
    ratios_of,
)
from jammkle_controller.parameters import ControllerParameters, Mount
from jammkle_sim.robots.options import ROBOTS
from studies.contact.labelled import ANGLE_RATE_NOISE_RAD_S, walk
from studies.contact.robots import robot_recordings
from studies.contact.trial import KINDS, Score, detected_by_ours, harmonic_mean, scored

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from studies.contact.labelled import LabelledRecording

RUNS = 60
STRIDES = 12
UNSURE_S = 0.02
"""Samples so near to a change of contact say nothing clear of either side."""
BLOW_S = 0.02
"""A touch-down's blow is over by then."""
EARLY_S = 0.003
"""So shortly before a touch-down nothing is called a swing: stamps jitter."""


def runs_of(mount: str, runs: int = RUNS) -> list[list[LabelledRecording]]:
    """Make what is learned from: of each seed a synthetic walk, and a leg that walks, slips or is dropped."""
    return [[walk(seed, mount, STRIDES), *robot_recordings("leg", seed, mount)] for seed in range(runs)]


def learn(mount: str, recordings: Sequence[LabelledRecording]) -> dict[str, dict[str, Any]]:
    """Learn the ratios of a place of the IMU; return them by name, as `learned.json` has them.

    That of sliding is learned last, on what a detector with the other two takes for the ground.
    """
    swing: list[tuple[tuple[float, ...], bool]] = []
    blows: list[tuple[tuple[float, ...], bool]] = []
    for recording in recordings:
        _collect(recording, swing, blows)
    made = {
        f"swing_{mount}": _fitted(swing, balanced=True),
        f"touchdown_{mount}": _fitted(blows, balanced=False),
        f"slide_{mount}": _nothing(len(learned(mount).slide.centre)),
    }
    return made | {f"slide_{mount}": _slides(mount, recordings, ratios_of(made, mount))}


ANKLE_RUNS = 200
"""Of each robot."""
LEAST_HANG_DEG, MOST_HANG_DEG = 20.0, 40.0
"""Pitches at which feet hang in what is learned from, so that the trees are those of every toe."""
TREES, LEAVES, LEARNING_RATE = 150, 31, 0.12


def ankle_runs(runs: int = ANKLE_RUNS) -> Iterator[tuple[float, list[LabelledRecording]]]:
    """Make what the ankle's trees are learned from: pitches at which feet hang, rad, and recordings of all feet."""
    for robot in ROBOTS:
        for seed in range(runs):
            chance = np.random.default_rng([seed, 81])
            hang_deg = float(chance.uniform(LEAST_HANG_DEG, MOST_HANG_DEG))
            recordings = robot_recordings(robot, seed, Mount.SHANK.value, hang_pitch_deg=hang_deg)
            if robot == "leg":
                recordings += [held_still(recording, chance) for recording in recordings]
            yield math.radians(hang_deg), recordings


def held_still(recording: LabelledRecording, chance: np.random.Generator) -> LabelledRecording:
    """Return the same with a hip and a knee that do not turn, as where a hand lifts a robot and puts it down."""
    noise = chance.normal(0.0, ANGLE_RATE_NOISE_RAD_S, (len(recording.poses), 2)).tolist()
    poses = [
        (at_ns, pose._replace(hip_rad_s=hip_rad_s, knee_rad_s=knee_rad_s))
        for (at_ns, pose), (hip_rad_s, knee_rad_s) in zip(recording.poses, noise, strict=True)
    ]
    return dataclasses.replace(recording, poses=poses)


def learn_ankle(runs: Iterable[tuple[float, list[LabelledRecording]]]) -> dict[str, Any]:
    """Learn to tell a stance from a swing by the ankle; return the trees, as `ankle.json` has them."""
    rows: list[NDArray[np.float32]] = []
    labels: list[bool] = []
    for hang_rad, recordings in runs:
        for recording in recordings:
            motion, readings = AnkleMotion(hang_rad), recording.ankle_readings()
            times_s = np.array([at_ns for at_ns, _ in readings]) / NANOSECONDS_PER_SECOND
            # what is dropped hangs before it first touches
            stands = recording.in_contact(times_s) & (times_s >= min(recording.touches_s, default=np.inf))
            for (at_ns, reading), on_ground in zip(readings, stands.tolist(), strict=True):
                features = motion.follow(reading, at_ns)
                if features is not None:
                    rows.append(np.array(features, dtype=np.float32))
                    labels.append(on_ground)
    model = HistGradientBoostingClassifier(
        max_iter=TREES, max_leaf_nodes=LEAVES, learning_rate=LEARNING_RATE, min_samples_leaf=40, early_stopping=False
    ).fit(np.vstack(rows), np.array(labels))
    # scikit-learn shows these trees nowhere else
    made = [_tree(each.nodes, 0) for (each,) in model._predictors]  # noqa: SLF001
    return {"constant": round(float(model._baseline_prediction.item()), 4), "trees": made}  # noqa: SLF001


def _tree(nodes: Any, index: int) -> float | list[Any]:
    """Return a tree from one of its nodes on, as `StanceTrees` has it."""
    node = nodes[index]
    if node["is_leaf"]:
        return round(float(node["value"]), 4)
    below, above = (_tree(nodes, int(node[side])) for side in ("left", "right"))
    return [int(node["feature_idx"]), round(float(node["num_threshold"]), 5), below, above]


def _slides(mount: str, recordings: Sequence[LabelledRecording], ratios: StepRatios) -> dict[str, Any]:
    rows: list[tuple[tuple[float, ...], bool]] = []
    for recording in recordings:
        detector = ContactDetector(ControllerParameters(imu_mount=mount), ratios)
        if detector.foot is None:
            continue
        sole = detector.foot.sole
        for sample in recording.samples:
            detector.update(sample)
            on_ground = detector.phase in (Phase.GROUND, Phase.PLANTED)
            if not on_ground or not detector.available or detector.gate.last_ns != sample.time_ns:
                continue
            time_s = sample.time_ns / NANOSECONDS_PER_SECOND
            slides = any(slide.begin_s <= time_s <= slide.end_s for slide in recording.slides)
            near = any(
                abs(time_s - at_s) < UNSURE_S for each in recording.slides for at_s in (each.begin_s, each.end_s)
            )
            if not near:
                swing = min(0.9999, max(0.0001, detector.swing_probability))
                rows.append((sole.features(sample.time_ns, detector.motion, swing), slides))
    return _fitted(rows, balanced=True)


def _nothing(width: int) -> dict[str, Any]:
    """Return a ratio that says nothing, for a detector that is learned from."""
    return {
        "centre": [0.0] * width,
        "scale": [1.0] * width,
        "constant": 0.0,
        "linear": [0.0] * width,
        "products": [[0.0] * (width - i) for i in range(width)],
        "learned_from": {},
    }


def _collect(
    recording: LabelledRecording,
    swing: list[tuple[tuple[float, ...], bool]],
    blows: list[tuple[tuple[float, ...], bool]],
) -> None:
    gate, motion = ImuGate(), Motion()
    lifts, lands = np.array(recording.liftoffs_s), np.array([*recording.touchdowns_s, np.inf])
    changes = np.sort(np.concatenate([lifts, lands]))
    stands = recording.in_contact(np.array([s.time_ns / NANOSECONDS_PER_SECOND for s in recording.samples]))
    for index, (sample, on_ground) in enumerate(zip(recording.samples, stands.tolist(), strict=True)):
        admission = gate.admit(sample)
        if admission in IGNORED:
            continue
        if admission is not Admission.USABLE:
            motion = Motion((sample.force_x, sample.force_y, sample.force_z))
            continue
        motion.update(sample, gate.interval_s)
        time_s = sample.time_ns / NANOSECONDS_PER_SECOND
        nearest_s = float(np.abs(changes - time_s).min())
        if nearest_s > UNSURE_S and index % 3 == 0:
            swing.append((motion.features(), not on_ground))
        _collect_blow(motion, time_s, lifts, lands, blows, on_ground=on_ground)


def _collect_blow(
    motion: Motion,
    time_s: float,
    lifts: NDArray[np.float64],
    lands: NDArray[np.float64],
    blows: list[tuple[tuple[float, ...], bool]],
    *,
    on_ground: bool,
) -> None:
    if motion.sharp_m_s2 < LEAST_BLOW_M_S2 or motion.sharp_ratio < LEAST_RATIO:
        return
    before = lifts[lifts <= time_s]
    if len(before) == 0:
        return
    swung_s = time_s - float(before[-1])
    since_land_s = time_s - float(lands[lands <= time_s][-1]) if (lands <= time_s).any() else np.inf
    if not on_ground:
        if lands[np.searchsorted(lands, time_s)] - time_s > EARLY_S:
            blows.append((motion.blow_features(swung_s), False))
    elif since_land_s < BLOW_S:
        blows.append((motion.blow_features(swung_s), True))


def _fitted(rows: list[tuple[tuple[float, ...], bool]], *, balanced: bool) -> dict[str, Any]:
    x, y = np.array([row for row, _ in rows]), np.array([label for _, label in rows])
    centre, scale = x.mean(axis=0), x.std(axis=0) + 1e-9
    z = np.clip((x - centre) / scale, -3.5, 3.5)
    pairs = [(i, j) for i in range(z.shape[1]) for j in range(i, z.shape[1])]
    full = np.hstack([z, np.column_stack([z[:, i] * z[:, j] for i, j in pairs])])
    model = LogisticRegression(C=1.0, max_iter=2000, class_weight="balanced" if balanced else None).fit(full, y)
    weights = model.coef_[0].round(4).tolist()
    width = z.shape[1]
    products = iter(weights[width:])
    return {
        "centre": centre.round(4).tolist(),
        "scale": scale.round(4).tolist(),
        "constant": round(float(model.intercept_[0]), 4),
        "linear": weights[:width],
        "products": [[next(products) for _ in range(width - i)] for i in range(width)],
        "learned_from": {"samples": len(y), "positive": int(y.sum()), "accuracy": round(model.score(full, y), 4)},
    }


FOLDS = 4


def scores(recordings: Iterable[LabelledRecording], ratios: StepRatios | None) -> dict[str, Score]:
    """Score a controller by kind of event, with its own ratios or with others."""
    made: dict[str, Score] = defaultdict(Score)
    for recording in recordings:
        reported, _ = detected_by_ours(recording, ratios)
        for kind in KINDS:
            made[kind].add(scored(recording, kind, reported[kind]))
    return made


def cross_validated(mount: str, runs: Sequence[Sequence[LabelledRecording]], folds: int = FOLDS) -> dict[str, Score]:
    """Score ratios that are learned on all other folds, by kind of event.

    Args:
        mount: Where the IMU is.
        runs: What is learned from; recordings of one run stay together.
        folds: How many parts.

    """
    made: dict[str, Score] = defaultdict(Score)
    for fold in range(folds):
        others = [recording for index, run in enumerate(runs) if index % folds != fold for recording in run]
        ratios = ratios_of(learn(mount, others), mount)
        left_out = [recording for index, run in enumerate(runs) if index % folds == fold for recording in run]
        for kind, score in scores(left_out, ratios).items():
            made[kind].add(score)
    return made


def main() -> int:
    """Compare, and write the new ratios where that is asked for."""
    parser = argparse.ArgumentParser(description="Learn the density ratios anew, and say whether they are better.")
    parser.add_argument("--write", action="store_true", help="put the new ones into the controller")
    parser.add_argument("--runs", type=int, default=RUNS, help=f"seeds to learn from, {FOLDS} or more")
    parser.add_argument(
        "--what", nargs="+", choices=("imu", "ankle"), default=["imu", "ankle"], help="what to learn; none: all"
    )
    wanted = parser.parse_args()
    if wanted.runs < FOLDS:
        parser.error(f"--runs is {wanted.runs}; it must be {FOLDS} or more, one for each fold")
    core = Path(jammkle_controller.core.__file__).parent
    if "ankle" in wanted.what:
        trees = learn_ankle(ankle_runs())
        sys.stdout.write(f"ankle: {len(trees['trees'])} trees\n")
        if wanted.write:
            (core / TREES_FILE).write_text(json.dumps(trees, separators=(",", ":")) + "\n", encoding="utf-8")
    made: dict[str, Any] = {}
    for mount in (Mount.FOOT.value, Mount.SHANK.value) if "imu" in wanted.what else ():
        runs = runs_of(mount, wanted.runs)
        recordings = [recording for run in runs for recording in run]
        old, new = scores(recordings, None), cross_validated(mount, runs)
        for kind in KINDS:
            sys.stdout.write(f"{mount} {kind}: in use {_reported(old[kind])}; new {_reported(new[kind])}\n")
            sys.stdout.flush()
        made |= learn(mount, recordings)
    if wanted.write and made:
        path = core / WEIGHTS_FILE
        others = json.loads(path.read_text(encoding="utf-8"))
        path.write_text(json.dumps(others | made, indent=1) + "\n", encoding="utf-8")
    return 0


def _reported(score: Score) -> str:
    return f"recall {score.recall[0]:.3f}, precision {score.precision[0]:.3f}, mean {harmonic_mean(score):.3f}"


if __name__ == "__main__":
    sys.exit(main())
