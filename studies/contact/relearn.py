"""Learn the density ratios anew, and say whether they are better: `python -m studies.contact.relearn [--write]`.

New ones are judged by cross-validation, each fold by ratios that were learned on the others; those in use may have seen
all of it, which is in their favour. Nothing held out and no recording is in it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jammkle_controller.core
from jammkle_controller.core.stepping import WEIGHTS_FILE, ratios_of
from jammkle_controller.parameters import Mount
from studies.contact.learn import ANKLE_RUNS, RUNS, ankle_runs, learn, learn_ankle, runs_of
from studies.contact.trial import KINDS, Score, detected_by_ours, harmonic_mean, scored

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from jammkle_controller.core.stepping import StepRatios
    from studies.contact.labelled import LabelledRecording

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
        "--what", nargs="+", choices=("imu", "ankle"), default=["imu", "ankle"], help="ratios to learn: none: all"
    )
    wanted = parser.parse_args()
    if wanted.runs < FOLDS:
        parser.error(f"--runs is {wanted.runs}; it must be {FOLDS} or more, one for each fold")
    made: dict[str, Any] = learn_ankle(ankle_runs(ANKLE_RUNS)) if "ankle" in wanted.what else {}
    for what, entry in made.items():
        sys.stdout.write(f"{what}: {entry['learned_from']}\n")
    for mount in (Mount.FOOT.value, Mount.SHANK.value) if "imu" in wanted.what else ():
        runs = runs_of(mount, wanted.runs)
        recordings = [recording for run in runs for recording in run]
        old, new = scores(recordings, None), cross_validated(mount, runs)
        for kind in KINDS:
            sys.stdout.write(f"{mount} {kind}: in use {_reported(old[kind])}; new {_reported(new[kind])}\n")
            sys.stdout.flush()
        made |= learn(mount, recordings)
    if wanted.write:
        path = Path(jammkle_controller.core.__file__).with_name(WEIGHTS_FILE)
        others = json.loads(path.read_text(encoding="utf-8"))
        path.write_text(json.dumps(others | made, indent=1) + "\n", encoding="utf-8")
    return 0


def _reported(score: Score) -> str:
    return f"recall {score.recall[0]:.3f}, precision {score.precision[0]:.3f}, mean {harmonic_mean(score):.3f}"


if __name__ == "__main__":
    sys.exit(main())
