"""`make blind`: the standard trial from one end to the other, each step gone on with where it was stopped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.command import results
from jammkle_common.command.errors import InputError
from studies.blind.files import TRIAL_NAME
from studies.blind.make import MakeRequest, make
from studies.blind.regimes import STANDARD_CASES, STANDARD_LIVE, STANDARD_SEED
from studies.blind.run import RunRequest, run
from studies.blind.score import ScoreRequest, score

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True)
class StandardRequest:
    """One call of `python -m studies.blind standard`."""

    folder: Path
    jobs: int | None
    scheduler: str | None
    json: Path | None
    real: Path | None = None
    """Folder of real recordings, if they are to be diagnosed beside the trial."""


def standard(request: StandardRequest) -> int:
    """Do what is left to do, and return the exit code.

    Raises:
        InputError: something cannot be as asked for.
        GraphError: a diagnosis failed in a way that says nothing of its case.
        Interrupted: asked to stop; what is done stays.

    """
    trial, key = request.folder / "trial", request.folder / "key.json"
    try:
        request.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"folder {request.folder} cannot be made: {error.strerror}"
        raise InputError(msg) from error
    results.check_writable(request.json)
    if not (trial / TRIAL_NAME).exists():
        make(MakeRequest(STANDARD_SEED, STANDARD_CASES, trial, key, request.jobs, live=STANDARD_LIVE))
    run(RunRequest(trial, key, request.jobs, request.scheduler))
    return score(ScoreRequest(trial, key, request.folder, request.json, request.real))
