"""What `jammkle gap diagnose --model` does: it reads, diagnoses, and writes page, JSON and corrected model."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, Interrupted, StopRequest
from jammkle_common.yaml_text import read_file
from jammkle_gap.backend import backend, check_jobs, in_stages
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.effects import BadEffectError
from jammkle_gap.core.result import as_dict
from jammkle_gap.core.simulate import InfeasibleError, SimulatorError, StoppedError
from jammkle_gap.mujoco import diagnosing
from jammkle_gap.mujoco.diagnosing import CORRECTED_NAME, RobotDiagnosis, diagnose_mujoco
from jammkle_gap.mujoco.runs import BadRobotError
from jammkle_gap.report import words
from jammkle_gap.report.page import page
from jammkle_gap.report.screen import show
from jammkle_gap.report.words import Asked

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

_PAGE_NAME = "gap.html"
_MODEL = "model"
_STAGES = {"screening": (0.0, 0.2), "signatures": (0.2, 0.4), "fitting": (0.4, 0.6), "fitting pairs": (0.6, 0.8)}
"""From which share of the work to which its long stages go. Measured on an arm with seven joints."""


@dataclass(frozen=True)
class RobotRequest:
    """One call of `jammkle gap diagnose --model`."""

    model: Path
    """MJCF or URDF; or a map (YAML) with the key `model` beside its own."""
    bags: Sequence[Path]
    since: Sequence[Path]
    folder: Path
    json: Path | None
    jobs: int | None
    only: Sequence[str] = ()
    without: Sequence[str] = ()
    held_out: Sequence[Path] = ()


def diagnose_robot(request: RobotRequest) -> int:
    """Do everything and return the exit code.

    Raises:
        InputError: model, map or a bag cannot be used; the message says what would be right.
        GraphError: the simulator fails.
        Interrupted: stopped before anything was known.

    """
    check_jobs(request.jobs)
    model, joints = _model_of(request.model)
    with results.folder_made(request.folder):
        return _diagnose(request, model, joints)


def _diagnose(request: RobotRequest, model: Path, joints: Mapping[str, Any] | None) -> int:
    results.check_writable(request.json)
    for name in (_PAGE_NAME, CORRECTED_NAME):
        results.check_writable(request.folder / name, "--output")
    stop = StopRequest()
    try:
        with (
            _decisions_shown(),
            results.progress_bar("diagnosing") as update,
            backend(request.jobs, None) as jobs,
        ):
            found = diagnose_mujoco(
                model,
                request.bags,
                joints,
                since=request.since,
                held_out=request.held_out,
                only=request.only,
                without=request.without,
                folder=request.folder,
                jobs=jobs,
                progress=in_stages(update, _STAGES),
                stop=stop,
            )
    except (BadRobotError, BadRecordingError, BadEffectError) as error:
        raise InputError(str(error)) from error
    except (SimulatorError, InfeasibleError) as error:
        raise GraphError(str(error)) from error
    except StoppedError as error:
        raise Interrupted from error
    asked = Asked(
        bags=[str(bag) for bag in request.bags],
        references=[str(bag) for bag in request.since],
        rigs=[model.name],
        sensors="joint states",
        library="",
        sentences={effect.name: effect.sentence for effect in found.problem.library},
        corrected=str(request.folder / CORRECTED_NAME),
        origin=results.origin(),
        constants=found.problem.constants,
    )
    (request.folder / _PAGE_NAME).write_text(page(found.diagnosis, asked), encoding="utf-8", errors="backslashreplace")
    results.write_json(request.json, _content(found, asked, request))
    show(found.diagnosis, asked, request.folder / _PAGE_NAME)
    return 0


@contextlib.contextmanager
def _decisions_shown() -> Iterator[None]:
    """Show on stderr what is decided for want of a word in the map, before minutes are spent on it."""
    log, handler = logging.getLogger(diagnosing.__name__), _ToScreen()
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)


class _ToScreen(logging.Handler):
    """Writes notes where a progress bar may be at work."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one."""
        typer.echo(f"note: {record.getMessage()}", err=True)


def _model_of(file: Path) -> tuple[Path, Mapping[str, Any] | None]:
    """Return the model, and the map that names it, if one does."""
    if not file.is_file():
        msg = f"--model {file} is no file; give an MJCF, a URDF, or a map that names one (model: robot.xml)"
        raise InputError(msg)
    if file.suffix not in {".yaml", ".yml"}:
        return file, None
    table = read_file(file, f"--model {file}") or {}
    if not isinstance(table, dict) or _MODEL not in table:
        held = ", ".join(map(str, table)) if isinstance(table, dict) else repr(table)
        msg = f"--model {file} names no model, but holds: {held or 'nothing'}; write 'model: robot.xml' into it"
        raise InputError(msg)
    model = file.parent / str(table[_MODEL])
    if not model.is_file():
        msg = f"--model {file} names model {model}, which is no file; give its path from the map's folder"
        raise InputError(msg)
    return model, table


def _content(found: RobotDiagnosis, asked: Asked, request: RobotRequest) -> dict[str, Any]:
    diagnosis = found.diagnosis
    return {
        **as_dict(diagnosis),
        "made": dataclasses.asdict(asked.origin),
        "summary": words.headline(diagnosis),
        "check": list(words.checks(diagnosis, asked.sentences)),
        "model": str(request.model),
        "bags": list(asked.bags),
        "references": list(asked.references),
        "page": str(request.folder / _PAGE_NAME),
        "corrected": {
            "file": asked.corrected,
            "values": dict(found.corrected.values),
            "rest": dict(found.corrected.rest),
            "gains": {joint: dataclasses.asdict(each) for joint, each in found.corrected.gains.items()},
            "closing": [dataclasses.asdict(each) for each in found.closing],
        },
    }
