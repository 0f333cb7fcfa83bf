"""`python -m studies.blind score`: open the key, compare, write page and JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.table import Table

from jammkle_common.command import results
from jammkle_common.command.errors import InputError
from jammkle_gap.ankle.effects import ankle_library
from studies.blind import apart, files
from studies.blind import real as real_cases
from studies.blind.aims import AIMS, OTHERS
from studies.blind.key import check_apart, read_key
from studies.blind.page import figure_text, page
from studies.blind.result import as_dict, result_of
from studies.blind.tasks import seal

if TYPE_CHECKING:
    from pathlib import Path

    from studies.blind.result import Result

PAGE_NAME = "blind.html"


@dataclass(frozen=True)
class ScoreRequest:
    """One call of `python -m studies.blind score`."""

    trial: Path
    key: Path
    folder: Path
    json: Path | None
    real: Path | None = None
    """Folder of real recordings, if they are to be diagnosed beside the trial."""


def score(request: ScoreRequest) -> int:
    """Compare answers with the key, write the page, and return the exit code.

    Raises:
        InputError: trial or key cannot be used, or answers are missing.

    """
    facts = files.read_trial(request.trial)
    check_apart(request.key, request.trial)
    results.check_writable(request.json)
    try:
        request.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"folder {request.folder} cannot be made: {error.strerror}"
        raise InputError(msg) from error
    results.check_writable(request.folder / PAGE_NAME, "--output")
    key = read_key(request.key, facts.key_sha256)
    sealed = seal(request.trial)
    library = ankle_library()
    parameters = {effect.key(each): each for effect in library for each in effect.parameters}
    result = result_of(request.trial, facts, key, sealed, parameters)
    pairs = apart.not_apart(result.ways[0].cases, result.ways[-1].cases)
    real = []
    if request.real is not None:
        from studies.blind.diagnose_real import diagnose_real  # noqa: PLC0415 - brings all examples

        real = diagnose_real(request.real)
    (request.folder / PAGE_NAME).write_text(page(result, pairs, real), encoding="utf-8")
    beside = {"equivalent": apart.as_rows(pairs), "real": real_cases.as_rows(real)}
    results.write_json(request.json, {**as_dict(result), **beside})
    _show(result, request.folder / PAGE_NAME)
    return 0


def _show(result: Result, file: Path) -> None:
    console = results.console()
    shown = (result.ways[0], *(result.ceiling or ())[:1])
    table = Table(title="Blind trial", title_justify="left")
    table.add_column("figure", max_width=40, overflow="fold")
    table.add_column("aim", justify="right")
    for way in shown:
        table.add_column(way.name, justify="right", overflow="fold")
    for aim in (*AIMS, *OTHERS):
        if any(aim.figure in way.figures for way in shown):
            cells = (figure_text(aim, way.figures.get(aim.figure)) for way in shown)
            table.add_row(aim.text, aim.aim, *cells)
    console.print(table)
    console.print(f"hash of the key: {result.facts.key_sha256}", markup=False)
    console.print(f"page: {file}", markup=False)
