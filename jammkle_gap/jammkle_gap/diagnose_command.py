"""`jammkle gap diagnose`: read bags, diagnose the gap to the simulator, write page, corrected simulator and JSON."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_common.command import results
from jammkle_common.command.errors import InputError, StopRequest
from jammkle_gap.ankle.effects import try_changes
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.problem import ankle_problem
from jammkle_gap.ankle.sensor_sets import SensorSet, headline_set
from jammkle_gap.backend import backend
from jammkle_gap.core.as_json import as_dict
from jammkle_gap.core.effects import BadEffectError
from jammkle_gap.corrected_file import corrected_file
from jammkle_gap.diagnosing import diagnosis_of
from jammkle_gap.inputs import asked_of, in_settings, library_of, recordings_of
from jammkle_gap.report import words
from jammkle_gap.report.asked import Asked
from jammkle_gap.report.page import page
from jammkle_gap.report.screen import show

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from jammkle_gap.ankle.per_bag import BagRequest
    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.effects import Library
    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.core.simulate import Problem

PAGE_NAME = "gap.html"
CORRECTED_NAME = "corrected.yaml"


@dataclass(frozen=True)
class DiagnoseRequest:
    """One call of `jammkle gap diagnose`."""

    bags: Sequence[Path]
    references: Sequence[Path]
    rigs: Sequence[str]
    """What was recorded, as RIG or BAG=RIG, where bags do not tell."""
    settings: Sequence[str]
    """Options of the rig as NAME=VALUE or BAG:NAME=VALUE."""
    namespace: str | None
    library: Path | None
    folder: Path
    json: Path | None
    jobs: int | None
    scheduler: str | None
    without: Sequence[str] = ()
    """Effects taken out of the library: what is said if the true cause is not on offer?"""
    only: Sequence[str] = ()
    """Effects that are on offer, and no others; empty: all."""
    sensors: SensorSet | None = None
    """None: those of a robot, and the load cell where it was recorded."""


def diagnose(request: DiagnoseRequest) -> int:
    """Do everything and return the exit code; one that was stopped on the way is written too, and says so.

    Raises:
        InputError: a bag, an effect or an option cannot be used; the message says what would be right.
        GraphError: the simulator fails.
        Interrupted: stopped before anything was known.

    """
    of_bags, of_references = _check(request)
    stop = StopRequest()
    library = library_of(request.library, request.only, request.without)
    recordings = recordings_of(request.bags, of_bags, stop, request.namespace, request.sensors)
    references = recordings_of(request.references, of_references, stop, request.namespace, request.sensors)
    _try_changes(library, recordings)
    recordings, references = in_settings(recordings, references)
    problem = ankle_problem(library)
    with backend(request.jobs, request.scheduler) as jobs:
        diagnosis = diagnosis_of(recordings, references, problem, jobs, stop)
    asked = write_page(diagnosis, recordings, references, problem, request.folder, request.library, request.sensors)
    results.write_json(request.json, _content(diagnosis, asked, request))
    show(diagnosis, asked, request.folder / PAGE_NAME)
    return 0


def _check(request: DiagnoseRequest) -> tuple[tuple[BagRequest, ...], tuple[BagRequest, ...]]:
    """Refuse what cannot work before anything is read, and return what is said of bags and references."""
    if request.jobs is not None and request.jobs < 1:
        msg = f"--jobs {request.jobs} must be 1 or more"
        raise InputError(msg)
    said = asked_of(request.bags, request.references, request.rigs, request.settings)
    try:
        request.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"folder {request.folder} cannot be made: {error.strerror}"
        raise InputError(msg) from error
    results.check_writable(request.json)
    for name in (PAGE_NAME, CORRECTED_NAME):
        results.check_writable(request.folder / name, "--output")
    return said


def _try_changes(library: Library, recordings: Sequence[Recording]) -> None:
    rigs = {(each.inputs.rig, each.inputs.options): nominal_rig(each.inputs) for each in recordings}
    try:
        for rig in rigs.values():
            try_changes(library, rig)
    except BadEffectError as error:
        raise InputError(str(error)) from error


def write_page(
    diagnosis: Diagnosis,
    recordings: Sequence[Recording],
    references: Sequence[Recording],
    problem: Problem,
    folder: Path,
    library: Path | None = None,
    sensors: SensorSet | None = None,
) -> Asked:
    """Write the page and the corrected simulator into a folder; return what the page says was asked.

    Args:
        diagnosis: What was found.
        recordings: What was diagnosed.
        references: Of the healthy machine.
        problem: Simulator and effects on offer.
        folder: Where `gap.html` and `corrected.yaml` go; it exists.
        library: File of the user's own effects.
        sensors: Those that were used; None: those of a robot, and the load cell where it was recorded.

    """
    used = {(sensors or headline_set(each)).value for each in recordings}
    asked = Asked(
        bags=[each.name for each in recordings],
        references=[each.name for each in references],
        rigs=list(dict.fromkeys(each.inputs.rig for each in recordings)),
        sensors=", ".join(each.value for each in SensorSet if each.value in used),
        library="" if library is None else str(library),
        sentences={effect.name: effect.sentence for effect in problem.library},
        corrected=str(folder / CORRECTED_NAME),
        origin=results.origin(),
        constants=problem.constants,
    )
    (folder / CORRECTED_NAME).write_text(
        corrected_file(diagnosis, problem, library), encoding="utf-8", errors="backslashreplace"
    )
    (folder / PAGE_NAME).write_text(page(diagnosis, asked), encoding="utf-8", errors="backslashreplace")
    return asked


def _content(diagnosis: Diagnosis, asked: Asked, request: DiagnoseRequest) -> dict[str, Any]:
    return {
        **as_dict(diagnosis),
        "made": dataclasses.asdict(asked.origin),
        "answers": {
            each.question.lower().replace(" ", "_"): f"{each.short}. {each.more}" for each in words.answers(diagnosis)
        },
        "summary": words.headline(diagnosis),
        "check": list(words.checks(diagnosis, asked.sentences)),
        "bags": [str(bag) for bag in request.bags],
        "references": [str(bag) for bag in request.references],
        "rigs": list(asked.rigs),
        "sensors": asked.sensors,
        "library": {"effects": len(asked.sentences), "file": asked.library or None},
        "page": str(request.folder / PAGE_NAME),
        "corrected": asked.corrected,
    }
