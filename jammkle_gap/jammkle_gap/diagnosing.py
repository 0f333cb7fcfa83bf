"""What the verbs of `jammkle gap` do: read bags, diagnose them, write what was found, and list the effects."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from joblib import Parallel, delayed  # type: ignore[import-untyped]  # carries no types
from rich.markup import escape
from rich.table import Table

from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, Interrupted, StopRequest
from jammkle_common.command.results import progress_bar
from jammkle_gap.ankle.corrected import corrected_text
from jammkle_gap.ankle.effects import ankle_library, machine_constants, try_changes
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.problem import ankle_problem, experiments
from jammkle_gap.ankle.recording import load_recordings
from jammkle_gap.ankle.repeats import difference, with_settings
from jammkle_gap.ankle.sensors import SensorSet, headline_set, selected
from jammkle_gap.backend import backend, check_jobs, in_stages
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.diagnose import diagnose as diagnose_recordings
from jammkle_gap.core.effects import BadEffectError, Library
from jammkle_gap.core.result import Verdict, as_dict
from jammkle_gap.core.simulate import SimulatorError, StoppedError
from jammkle_gap.report import words
from jammkle_gap.report.page import page
from jammkle_gap.report.screen import show
from jammkle_gap.report.words import Asked, constant_lines, first_answer
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.effects import Effect
    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.core.simulate import Problem

PAGE_NAME = "gap.html"
CORRECTED_NAME = "corrected.yaml"
_STAGES = {
    "signatures": (0.0, 0.3),
    "nominal": (0.3, 0.32),
    "calibrating": (0.32, 0.4),
    "constants of the machine": (0.4, 0.5),
    "fitting": (0.5, 0.7),
    "fitting pairs": (0.7, 0.78),
    "likely causes": (0.78, 0.94),
    "planning the next run": (0.94, 0.97),
    "shares of the gap": (0.97, 1.0),
}
"""From which share of a diagnosis to which each of its stages goes. Measured, on a machine that knows no signatures."""


@dataclass(frozen=True)
class DiagnoseRequest:
    """One call of `jammkle gap diagnose`."""

    bags: Sequence[Path]
    references: Sequence[Path]
    rig: str | None
    """What was recorded, where run sheets do not say."""
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


def diagnose(request: DiagnoseRequest) -> Diagnosis:
    """Diagnose, show and write it all; one that was stopped on the way is written too, and says so.

    Raises:
        InputError: a bag, an effect or an option cannot be used; the message says what would be right.
        GraphError: the simulator fails.
        Interrupted: stopped before anything was known.

    """
    with results.folder_made(request.folder):
        check(request)
        stop = StopRequest()
        library = library_of(request.library, request.only, request.without)
        given = (request.rig, request.namespace, request.sensors, stop, request.jobs)
        recordings, references = (recordings_of(bags, *given) for bags in (request.bags, request.references))
        _try_changes(library, recordings)
        recordings, references = in_settings(recordings, references)
        problem = ankle_problem(library)
        with backend(request.jobs, request.scheduler) as jobs:
            diagnosis = diagnosis_of(recordings, references, problem, jobs, stop)
        asked = write_page(diagnosis, recordings, references, problem, request.folder, request.library, request.sensors)
        results.write_json(request.json, _content(diagnosis, asked, request))
    show(diagnosis, asked, request.folder / PAGE_NAME)
    return diagnosis


def check(request: DiagnoseRequest) -> None:
    """Refuse what cannot work before anything is read; the folder of the results is there.

    Raises:
        InputError: an option cannot be used, or a bag is given twice.

    """
    check_jobs(request.jobs)
    if request.rig is not None and request.rig not in RIGS:
        msg = f"--rig '{request.rig}' does not exist; known are: {', '.join(RIGS)}"
        raise InputError(msg)
    given = [bag.resolve() for bag in (*request.bags, *request.references)]
    for place, bag in enumerate(given):
        if bag in given[:place]:
            known = "as a reference too" if place >= len(request.bags) else "twice"
            msg = f"bag {bag.name} is given {known}; a repeat and a reference must be runs of their own"
            raise InputError(msg)
    results.check_writable(request.json)
    for name in (PAGE_NAME, CORRECTED_NAME):
        results.check_writable(request.folder / name, "--output")


def _try_changes(library: Library, recordings: Sequence[Recording]) -> None:
    rigs = {(each.inputs.rig, each.inputs.options): nominal_rig(each.inputs) for each in recordings}
    with command_errors():
        for rig in rigs.values():
            try_changes(library, rig)


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


def library_of(file: Path | None, only: Sequence[str] = (), without: Sequence[str] = ()) -> Library:
    """Return the effects on offer.

    Args:
        file: Effects of a user's own, beside the built-in ones.
        only: Those on offer, and no others; empty: all.
        without: Those taken out.

    Raises:
        InputError: one of them cannot be used.

    """
    with command_errors():
        library = ankle_library(file)
        if only:
            library = Library(tuple(library.effect(name) for name in dict.fromkeys(only)))
        for name in dict.fromkeys(without):
            library = library.without(library.effect(name).name)
    if not library.effects:
        msg = "--without leaves no effect to offer; leave one in the library"
        raise InputError(msg)
    return library


def recordings_of(
    bags: Sequence[Path],
    rig: str | None,
    namespace: str | None,
    sensors: SensorSet | None,
    stop: Callable[[], bool],
    jobs: int | None = None,
) -> list[Recording]:
    """Read bags, several at a time: a recording for each run that they hold.

    Args:
        bags: To be read.
        rig: What they were recorded on, where their run sheets do not say.
        namespace: Of the ankle, if the bags hold several; None takes the only one.
        sensors: That are used; None: those of a robot, and the load cell where it was recorded.
        stop: Asked after each bag; True ends it.
        jobs: Bags at a time; None: one per core.

    Raises:
        InputError: one cannot be used.
        GraphError: the simulator fails on one.
        Interrupted: asked to stop.

    """
    found: list[tuple[Path, list[Recording]]] = []
    with progress_bar("reading bags") as update, command_errors(), backend(jobs, None) as processes:
        work = [delayed(_read)(bag, rig, namespace, sensors) for bag in bags]
        count = 1 if len(bags) == 1 else processes
        for bag, (runs, notes) in zip(bags, Parallel(n_jobs=count, return_as="generator")(work), strict=True):
            for line in notes:
                results.note(line)
            found.append((bag, runs))
            update(len(found) / len(bags), bag.name)
            if stop():
                raise Interrupted
    names = [each.name for _, runs in found for each in runs]
    return [
        dataclasses.replace(each, name=f"{bag}{each.name[len(bag.name) :]}") if names.count(each.name) > 1 else each
        for bag, runs in found
        for each in runs
    ]


def _read(
    bag: Path, rig: str | None, namespace: str | None, sensors: SensorSet | None
) -> tuple[list[Recording], list[str]]:
    """Return the recordings of a bag, and what is to be noted about it."""
    with results.notes_kept() as notes:
        runs = load_recordings(bag, rig, namespace=namespace)
        return [selected(each, sensors or headline_set(each)) for each in runs], notes


def in_settings(
    recordings: Sequence[Recording], references: Sequence[Recording]
) -> tuple[list[Recording], list[Recording]]:
    """Return recordings and references with their settings; those that are repeats of each other have the same.

    A reference that is no repeat of a recording is left out, and noted.

    Raises:
        InputError: no reference is a repeat of a recording; the message says how they differ.

    """
    every = with_settings([*recordings, *references])
    own, others = list(every[: len(recordings)]), every[len(recordings) :]
    settings = {each.setting for each in own}
    found = [each for each in others if each.setting in settings]
    strange = {each.name: difference(own[0], each) for each in others if each.setting not in settings}
    if others and not found:
        how_each = "; ".join(f"{name}: {how}" for name, how in strange.items())
        msg = f"no reference is a repeat of recording {own[0].name}: {how_each}"
        msg += "; record references that do the same, or leave them out"
        raise InputError(msg)
    notes = tuple(f"reference {name} is no repeat of it, and left out: {how}" for name, how in strange.items())
    own[0] = dataclasses.replace(own[0], notes=(*own[0].notes, *notes))
    return own, found


def diagnosis_of(
    recordings: Sequence[Recording],
    references: Sequence[Recording],
    problem: Problem,
    jobs: int,
    stop: Callable[[], bool],
) -> Diagnosis:
    """Diagnose recordings, with a first answer on stderr on the way; one that was stopped says so.

    Args:
        recordings: Of the machine in question, with their settings.
        references: Of the same machine while healthy, in the same settings.
        problem: Simulator and effects on offer.
        jobs: Runs at a time; -1: one per core.
        stop: True ends the search with what is known by then.

    Raises:
        InputError: a recording or an effect cannot be used.
        GraphError: the simulator fails.
        Interrupted: stopped before anything was known.

    """
    with progress_bar("diagnosing") as update, command_errors():
        return diagnose_recordings(
            recordings,
            problem,
            references=references,
            experiments=experiments(recordings),
            jobs=jobs,
            progress=in_stages(update, _STAGES),
            provisional=show_first_answer,
            stop=stop,
        )


def show_first_answer(shares: Sequence[tuple[str, float]]) -> None:
    """Say on stderr what comes first before any fit; a bar that is there moves down."""
    if shares:
        sys.stderr.write(f"{first_answer(shares)}\n")


@contextlib.contextmanager
def command_errors() -> Iterator[None]:
    """Have what fails in the block raised as the errors of a command.

    Raises:
        InputError: a recording or an effect cannot be used.
        GraphError: the simulator fails.
        Interrupted: asked to stop.

    """
    try:
        yield
    except (BadRecordingError, BadEffectError) as error:
        raise InputError(str(error)) from error
    except (SimulatorError, UnstableSimulationError) as error:
        raise GraphError(str(error)) from error
    except StoppedError as error:
        raise Interrupted from error


def corrected_file(diagnosis: Diagnosis, problem: Problem, library_file: Path | None) -> str:
    """Return the effects file; without any effect where nothing is known to be the cause.

    Args:
        diagnosis: What was found.
        problem: Library that the effects are of, and constants of the machine.
        library_file: Of the user's own effects, if the library has any.

    """
    known = diagnosis.verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS}
    values = {
        f"{effect.name}.{parameter.name}": parameter.value
        for effect in (diagnosis.effects if known else ())
        for parameter in effect.parameters
    }
    said = [f"# {diagnosis.verdict.value}: {words.headline(diagnosis)}"]
    if not diagnosis.finished:
        said.append("# The diagnosis was stopped early: this is provisional.")
    lines = [] if diagnosis.constants else constant_lines(diagnosis, problem.constants)
    if lines:
        said.append("# Calibrated to the references, and not loaded from here; standard deviations are of the prior:")
    said += [
        f"#   {line['name']}: {line['value']}, nominal {line['nominal']} ({line['deviations']} standard deviations)"
        for line in lines
    ]
    effects = corrected_text(problem.library, values, library_file if values else None)
    moved = {each.name: each.value for each in diagnosis.constants if each.value != each.nominal}
    # The header of the constants is that of the effects.
    constants = corrected_text(machine_constants(), moved).partition("\n")[2] if moved else ""
    return "\n".join([*said, effects + constants])


def list_effects(library: Path | None, json: Path | None) -> int:
    """List the library, and return the exit code.

    Args:
        library: Effects of the user's own (YAML), beside the built-in ones.
        json: Where the list is written too.

    Raises:
        InputError: the library or the file cannot be used.

    """
    results.check_writable(json)
    offered = library_of(library, (), ())
    results.console().print(_effects_table(offered))
    results.write_json(json, {"effects": [_effect_content(effect) for effect in offered]})
    return 0


def _effects_table(library: Library) -> Table:
    table = Table(title=f"{len(library.effects)} effects on offer", title_justify="left")
    table.add_column("effect", overflow="fold")
    table.add_column("subsystem", overflow="fold")
    table.add_column("parameter", overflow="fold")
    table.add_column("null", justify="right")
    table.add_column("fitted within", overflow="fold")
    for effect in sorted(library, key=lambda each: each.subsystem):
        for place, each in enumerate(effect.parameters):
            unit = "" if each.unit == "1" else f" {each.unit}"
            span = f"{each.minimum:g} to {each.maximum:g}{unit}"
            first = (effect.name, effect.subsystem) if place == 0 else ("", "")
            table.add_row(*(escape(cell) for cell in (*first, each.name, f"{each.null:g}", span)))
    return table


def _effect_content(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "subsystem": effect.subsystem,
        "check": effect.sentence,
        "parameters": {
            each.name: {
                "unit": each.unit,
                "null": each.null,
                "minimum": each.minimum,
                "maximum": each.maximum,
                "source": each.source,
            }
            for each in effect.parameters
        },
    }
