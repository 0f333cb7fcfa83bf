"""Learn the density ratios of the detectors on synthetic walks and a simulated leg: `python -m jammkle_contact.learn`.

Seeds of learning are below `FIRST_TRIAL_SEED`, those of every trial above.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from sklearn.linear_model import LogisticRegression  # type: ignore[import-untyped]  # carries no types

import jammkle_controller.core
from jammkle_contact.drawing_robots import robot_stories
from jammkle_contact.synthetic import walk
from jammkle_controller.core.density_ratio import BORDER, WEIGHTS_FILE
from jammkle_controller.core.detector import ContactDetector
from jammkle_controller.core.detector_settings import Phase
from jammkle_controller.core.imu import IGNORED, Admission, ImuGate
from jammkle_controller.core.motion import Motion
from jammkle_controller.core.scales import Scales
from jammkle_controller.core.sole import SoleFilter
from jammkle_controller.core.touchdown import LEAST_SWING_S, SwingSoFar
from jammkle_controller.parameters import ControllerParameters, detector_settings
from jammkle_graph.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from jammkle_contact.story import Story

FIRST_TRIAL_SEED = 100_000
WALKS = 60
STRIDES = 12
SEEN_S = 0.3
"""A simulated robot is set down in the first moment of a story."""
UNSURE_S = 0.02
"""Samples so near to a change of contact say nothing clear of either side."""
CALM_S = 0.04
"""For so long after a touch-down its samples tell of it: two thirds of the time in which it shall be told, s."""
NEAR_S = 0.15
FAR_WEIGHT = 0.5
"""Of samples of a swing that is not near its end: the longest swings would outweigh all others."""
EARLY_S = 0.003
"""So shortly before a touch-down nothing is called a swing, s: stamps jitter, and filters of sensors are causal."""
LIFT_JITTER_S = (-0.02, 0.03)
"""Within this of the true lift-off a detector finds it, s: a swing is learned from there."""


def stories(mount: str, walks: int = WALKS) -> Iterator[Story]:
    """Make what is learned from: synthetic walks, and a leg that walks, slips and is dropped."""
    for seed in range(walks):
        yield walk(seed, mount, STRIDES)
        yield from robot_stories("leg", seed, mount)


def learn(mount: str, walks: int = WALKS) -> dict[str, dict[str, Any]]:
    """Learn the ratios of swing and touch-down of a mount; return them by name."""
    swing, blows = Rows(), Rows()
    chance = np.random.default_rng(walks)
    for story in stories(mount, walks):
        _collect(story, swing, blows, chance)
    return {
        f"swing_{mount}": swing.fitted(),
        f"touchdown_{mount}": blows.fitted(),
        f"slide_{mount}": _nothing(len(swing.features[0]) + len(SoleFilter.EXTRA)),
    }


def learn_slides(mount: str, walks: int = WALKS) -> dict[str, dict[str, Any]]:
    """Learn the ratio of sliding of a mount, on what a detector with the other two takes for the ground."""
    rows = Rows()
    settings = detector_settings(ControllerParameters(imu_mount=mount))
    for story in stories(mount, walks):
        detector = ContactDetector(settings)
        foot = detector.foot
        if foot is None:
            continue
        for sample in story.samples:
            detector.update(sample)
            on_ground = detector.phase in (Phase.GROUND, Phase.PLANTED)
            if not on_ground or not detector.available or detector.gate.last_ns != sample.time_ns:
                continue
            time_s = sample.time_ns / NANOSECONDS_PER_SECOND
            slides = any(slide.begin_s <= time_s <= slide.end_s for slide in story.slides)
            near = any(abs(time_s - at_s) < UNSURE_S for each in story.slides for at_s in (each.begin_s, each.end_s))
            if not near:
                swing = min(0.9999, max(0.0001, detector.swing_probability))
                motion_features = foot.scales.features(detector.motion)
                rows.add(foot.sole.features(sample.time_ns, motion_features, swing), is_so=slides)
    return {f"slide_{mount}": rows.fitted()}


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


def _collect(story: Story, swing: Rows, blows: Rows, chance: np.random.Generator) -> None:
    """Take the samples of a story: which of them swing, and which of a swing's come after its end."""
    lifts, lands = np.array(story.liftoffs_s), np.array(story.touchdowns_s)
    times_s = np.array([sample.time_ns / NANOSECONDS_PER_SECOND for sample in story.samples])
    stands = story.in_contact(times_s).tolist()
    begin_s = times_s[0] + SEEN_S
    if min(story.touchdowns_s, default=np.inf) < min(story.liftoffs_s, default=np.inf):
        begin_s = max(begin_s, story.touchdowns_s[0])  # it hung at rest before, which an IMU cannot tell from standing
    steps = _steps(story, chance)
    gate, motion, scales, record = ImuGate(0.1), Motion(), Scales((0.0, 0.0, 0.0)), None
    for index, (sample, time_s, on_ground) in enumerate(zip(story.samples, times_s.tolist(), stands, strict=True)):
        admission = gate.admit(sample)
        if admission in IGNORED:
            continue
        if admission is not Admission.USABLE:
            force = (sample.force_x, sample.force_y, sample.force_z)
            motion, scales, record = Motion(force), Scales(force), None
            continue
        motion.update(sample, gate.interval_s)
        scales.update(sample, motion, gate.interval_s)
        clear = _nearest_s(lifts, time_s) > UNSURE_S and _nearest_s(lands, time_s) > EARLY_S
        if clear and time_s > begin_s and index % 3 == 0:
            swing.add(scales.features(motion), is_so=not on_ground)
        while steps and time_s > steps[0].land_s + CALM_S:
            steps, record = steps[1:], None
        if not steps or time_s < steps[0].from_s:
            continue
        record = record or SwingSoFar()
        record.update(scales, gate.interval_s)
        step = steps[0]
        if record.lasted_s > LEAST_SWING_S and not step.land_s - EARLY_S < time_s < step.land_s:
            far = time_s < step.land_s - NEAR_S
            blows.add(record.features(scales, motion), is_so=time_s >= step.land_s, weight=FAR_WEIGHT if far else 1.0)


def _nearest_s(times_s: NDArray[np.float64], time_s: float) -> float:
    return float(np.abs(times_s - time_s).min()) if len(times_s) else np.inf


@dataclass(frozen=True)
class _Step:
    """One swing: from when a detector may take it for one, to its end, s."""

    from_s: float
    land_s: float


def _steps(story: Story, chance: np.random.Generator) -> list[_Step]:
    steps = []
    for lift_s in sorted(story.liftoffs_s):
        land_s = min((at_s for at_s in story.touchdowns_s if at_s > lift_s), default=None)
        if land_s is not None:
            steps.append(_Step(lift_s + chance.uniform(*LIFT_JITTER_S), land_s))
    return steps


@dataclass
class Rows:
    """Samples of two densities: features, whether they are of the first, and weights."""

    features: list[tuple[float, ...]] = field(default_factory=list)
    labels: list[bool] = field(default_factory=list)
    weights: list[float] = field(default_factory=list)

    def add(self, features: tuple[float, ...], *, is_so: bool, weight: float = 1.0) -> None:
        """Add a sample."""
        self.features.append(features)
        self.labels.append(is_so)
        self.weights.append(weight)

    def fitted(self) -> dict[str, Any]:
        """Return the ratio of the densities, both as likely beforehand."""
        x, y, weights = np.array(self.features), np.array(self.labels), np.array(self.weights)
        weights[y] *= weights[~y].sum() / weights[y].sum()
        centre, scale = x.mean(axis=0), x.std(axis=0) + 1e-9
        z = np.clip((x - centre) / scale, -BORDER, BORDER)
        pairs = [(i, j) for i in range(z.shape[1]) for j in range(i, z.shape[1])]
        full = np.hstack([z, np.column_stack([z[:, i] * z[:, j] for i, j in pairs])])
        model = LogisticRegression(C=0.1, max_iter=500).fit(full, y, weights)
        learned = model.coef_[0].round(4).tolist()
        width = z.shape[1]
        products = iter(learned[width:])
        return {
            "centre": centre.round(4).tolist(),
            "scale": scale.round(4).tolist(),
            "constant": round(float(model.intercept_[0]), 4),
            "linear": learned[:width],
            "products": [[next(products) for _ in range(width - i)] for i in range(width)],
            "learned_from": {
                "samples": len(y),
                "positive": int(y.sum()),
                "accuracy": round(model.score(full, y, weights), 4),
            },
        }


def main() -> int:
    """Learn all and write the controller's file."""
    path = Path(jammkle_controller.core.__file__).with_name(WEIGHTS_FILE)
    made: dict[str, Any] = {}
    for learner in (learn, learn_slides):
        for mount in ("foot", "shank"):
            made |= learner(mount)
            path.write_text(json.dumps(made, indent=1) + "\n")
    for name, entry in made.items():
        sys.stdout.write(f"{name}: {entry['learned_from']}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
