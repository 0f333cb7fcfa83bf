"""`jammkle gap diagnose`: read bags, diagnose the gap to the simulator, write page, corrected simulator and JSON."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_bringup import report
from jammkle_bringup.core.errors import GraphError, InputError
from jammkle_bringup.core.gap import words
from jammkle_bringup.core.gap.backend import backend
from jammkle_bringup.core.gap.experiments import experiments
from jammkle_bringup.core.gap.page import Setting, page
from jammkle_bringup.core.signals import Interrupted, StopRequest
from jammkle_bringup.gap_report import show
from jammkle_bringup.progress import progress_bar
from jammkle_sim.gap.ankle.corrected import corrected_text
from jammkle_sim.gap.ankle.effects import ankle_library, try_changes
from jammkle_sim.gap.ankle.inputs import nominal_rig
from jammkle_sim.gap.ankle.loading import load_recording
from jammkle_sim.gap.ankle.simulator import AnkleSimulator
from jammkle_sim.gap.ankle.subsystems import subsystem_simulators
from jammkle_sim.gap.diagnosis import diagnose as diagnose_recordings
from jammkle_sim.gap.effect import BadEffectError, Library
from jammkle_sim.gap.recording import BadRecordingError
from jammkle_sim.gap.result import as_dict
from jammkle_sim.gap.runs import StoppedError
from jammkle_sim.gap.verdict import Verdict
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from jammkle_sim.gap.diagnosis import Diagnosis
    from jammkle_sim.gap.recording import Recording

PAGE_NAME = "gap.html"
CORRECTED_NAME = "corrected.yaml"


@dataclass(frozen=True)
class DiagnoseRequest:
    """One call of `jammkle gap diagnose`."""

    bags: Sequence[Path]
    references: Sequence[Path]
    rig: str | None
    settings: Sequence[str]
    """Options of the rig as NAME=VALUE."""
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


def diagnose(request: DiagnoseRequest) -> int:
    """Do everything and return the exit code; one that was stopped on the way is written too, and says so.

    Raises:
        InputError: a bag, an effect or an option cannot be used; the message says what would be right.
        GraphError: the simulator fails.
        Interrupted: stopped before anything was known.

    """
    options = _check(request)
    stop = StopRequest()
    library = library_of(request)
    recordings = recordings_of(request.bags, request, options, stop)
    references = recordings_of(request.references, request, options, stop)
    _try_changes(library, recordings)
    with backend(request.jobs, request.scheduler) as jobs:
        diagnosis = _diagnose(recordings, references, library, jobs, stop)
    setting = Setting(
        bags=[each.name for each in recordings],
        references=[each.name for each in references],
        rigs=list(dict.fromkeys(each.inputs.rig for each in recordings)),
        library="" if request.library is None else str(request.library),
        effects=len(library.effects),
        corrected=str(request.folder / CORRECTED_NAME),
    )
    (request.folder / CORRECTED_NAME).write_text(_corrected(diagnosis, library, request.library), encoding="utf-8")
    (request.folder / PAGE_NAME).write_text(page(diagnosis, setting), encoding="utf-8")
    report.write_json(request.json, _content(diagnosis, setting, request))
    show(diagnosis, setting, request.folder / PAGE_NAME)
    return 0


def _check(request: DiagnoseRequest) -> dict[str, Any]:
    """Refuse what cannot work before anything is read, and return the options of the rig."""
    if request.rig is not None and request.rig not in RIGS:
        msg = f"--rig '{request.rig}' does not exist; known are: {', '.join(RIGS)}"
        raise InputError(msg)
    if request.jobs is not None and request.jobs < 1:
        msg = f"--jobs {request.jobs} must be 1 or more"
        raise InputError(msg)
    given = [bag.resolve() for bag in (*request.bags, *request.references)]
    for place, bag in enumerate(given):
        if bag in given[:place]:
            known = "as a reference too" if place >= len(request.bags) else "twice"
            msg = f"bag {bag.name} is given {known}; a repeat and a reference must be runs of their own"
            raise InputError(msg)
    try:
        request.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"folder {request.folder} cannot be made: {error.strerror}"
        raise InputError(msg) from error
    report.check_writable(request.json)
    for name in (PAGE_NAME, CORRECTED_NAME):
        report.check_writable(request.folder / name, "--output")
    return rig_options(request)


def rig_options(request: DiagnoseRequest) -> dict[str, Any]:
    """Return how the rig is set, whatever the bags say.

    Raises:
        InputError: a setting that is none.

    """
    return dict(map(_setting, request.settings))


def _setting(text: str) -> tuple[str, Any]:
    name, sign, value = text.partition("=")
    if not name or not sign:
        msg = f"--set '{text}' must be NAME=VALUE, such as vacuum_pa=50000"
        raise InputError(msg)
    try:
        read = yaml.safe_load(value)
    except yaml.YAMLError as error:
        msg = f"--set '{text}' has a value that cannot be read; write a number or a word, such as vacuum_pa=50000"
        raise InputError(msg) from error
    try:
        return name.replace("-", "_"), float(read) if isinstance(read, str) else read
    except ValueError:  # a word, such as a foot
        return name.replace("-", "_"), read


def library_of(request: DiagnoseRequest) -> Library:
    """Return the effects on offer.

    Raises:
        InputError: one of them cannot be used.

    """
    try:
        library = ankle_library(request.library)
        if request.only:
            library = Library(tuple(library.effect(name) for name in dict.fromkeys(request.only)))
        for name in dict.fromkeys(request.without):
            library = library.without(library.effect(name).name)
    except BadEffectError as error:
        raise InputError(str(error)) from error
    if not library.effects:
        msg = "--without leaves no effect to offer; leave one in the library"
        raise InputError(msg)
    return library


def _try_changes(library: Library, recordings: Sequence[Recording]) -> None:
    rigs = {(each.inputs.rig, each.inputs.options): nominal_rig(each.inputs) for each in recordings}
    try:
        for rig in rigs.values():
            try_changes(library, rig)
    except BadEffectError as error:
        raise InputError(str(error)) from error


def recordings_of(
    bags: Sequence[Path], request: DiagnoseRequest, options: dict[str, Any], stop: Callable[[], bool]
) -> list[Recording]:
    """Read bags.

    Raises:
        InputError: one cannot be used.
        GraphError: the simulator fails on one.
        Interrupted: asked to stop.

    """
    found: list[Recording] = []
    with progress_bar("reading bags") as update:
        for place, bag in enumerate(bags):
            if stop():
                raise Interrupted
            update(place / len(bags), bag.name)
            try:
                recording = load_recording(bag, request.rig, options=options, namespace=request.namespace)
            except BadRecordingError as error:
                raise InputError(str(error)) from error
            except UnstableSimulationError as error:
                msg = f"bag {bag}: {error}"
                raise GraphError(msg) from error
            unknown = sorted(set(options) - {name for name, _ in recording.inputs.options})
            if unknown:
                known = ", ".join(name for name, _ in recording.inputs.options)
                msg = f"--set {unknown[0]} is no option of rig {recording.inputs.rig}; it has: {known}"
                raise InputError(msg)
            found.append(recording)
    names = [each.name for each in found]
    return [
        dataclasses.replace(each, name=str(bag)) if names.count(each.name) > 1 else each
        for each, bag in zip(found, bags, strict=True)
    ]


def _diagnose(
    recordings: Sequence[Recording],
    references: Sequence[Recording],
    library: Library,
    jobs: int | None,
    stop: Callable[[], bool],
) -> Diagnosis:
    with progress_bar("diagnosing") as update:
        furthest = 0.0

        def on_progress(stage: str, share: float, _left_s: float) -> None:
            nonlocal furthest
            furthest = max(furthest, share)
            update(furthest, stage)

        try:
            return diagnose_recordings(
                recordings,
                AnkleSimulator(library),
                library,
                references=references,
                subsystems=subsystem_simulators(library),
                experiments=experiments(),
                jobs=jobs,
                on_progress=on_progress,
                stop=stop,
            )
        except (BadRecordingError, BadEffectError) as error:
            raise InputError(str(error)) from error
        except UnstableSimulationError as error:
            raise GraphError(str(error)) from error
        except StoppedError as error:
            raise Interrupted from error


def _corrected(diagnosis: Diagnosis, library: Library, file: Path | None) -> str:
    """Return the effects file; without any where nothing is known to be the cause."""
    known = diagnosis.verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS}
    values = {
        f"{effect.name}.{parameter.name}": parameter.value
        for effect in (diagnosis.effects if known else ())
        for parameter in effect.parameters
    }
    said = [f"# {diagnosis.verdict.value}: {words.headline(diagnosis)}"]
    if not diagnosis.finished:
        said.append("# The diagnosis was stopped early: this is provisional.")
    return "\n".join([*said, corrected_text(library, values, file if values else None)])


def _content(diagnosis: Diagnosis, setting: Setting, request: DiagnoseRequest) -> dict[str, Any]:
    return {
        **as_dict(diagnosis),
        "summary": words.headline(diagnosis),
        "check": list(words.checks(diagnosis)),
        "bags": [str(bag) for bag in request.bags],
        "references": [str(bag) for bag in request.references],
        "rigs": list(setting.rigs),
        "library": {"effects": setting.effects, "file": setting.library or None},
        "page": str(request.folder / PAGE_NAME),
        "corrected": setting.corrected,
    }
