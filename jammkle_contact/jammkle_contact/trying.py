"""`jammkle contact`: the trial and its page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_contact.trial.benefit import benefit
from jammkle_contact.trial.page import page, results
from jammkle_contact.trial.real_foot import real_foot
from jammkle_contact.trial.real_page import draw_real_foot, real_figures
from jammkle_contact.trial.run import best_settings, run_trial
from jammkle_graph.command.errors import InputError
from jammkle_graph.command.progress import progress_bar
from jammkle_graph.command.results import check_writable, console, write_json

if TYPE_CHECKING:
    from pathlib import Path

LEAST_STEPS = 40


@dataclass(frozen=True)
class ContactRequest:
    """What was asked for on the command line."""

    output: Path
    steps: int
    seed: int
    runs: int
    jobs: int
    json: Path | None
    real: Path | None = None
    """Folder of recordings of a real foot."""


def contact(request: ContactRequest) -> int:
    """Run the trial and write its page; return the exit code.

    Raises:
        InputError: an option out of range, or a file that cannot be written.

    """
    check_writable(request.json)
    for name, value, least in (
        ("steps", request.steps, LEAST_STEPS),
        ("runs", request.runs, 0),
        ("jobs", request.jobs, 1),
    ):
        if value < least:
            msg = f"--{name} is {value}; it must be {least} or more"
            raise InputError(msg)
    try:
        request.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"-o {request.output} cannot be written: {error.strerror}"
        raise InputError(msg) from error
    recordings = [] if request.real is None else sorted(request.real.glob("*.csv"))
    if request.real is not None and not recordings:
        msg = f"--real {request.real} holds no .csv; it must be a folder of tables: force, acceleration, rate"
        raise InputError(msg)
    with progress_bar("contact") as update:
        outcome = run_trial(request.seed, request.steps, request.jobs, update)
        rows = benefit(request.seed, request.runs, update) if request.runs else []
    feet = [real_foot(path, best_settings(outcome)) for path in recordings]
    figures = results(outcome, rows) | {"real": [real_figures(foot) for foot in feet]}
    for foot in feet:
        draw_real_foot(foot, request.output / f"{foot.name}.png")
    path = request.output / "contact.html"
    path.write_text(page(outcome, figures, request.seed), encoding="utf-8")
    write_json(request.output / "contact.json", figures)
    write_json(request.json, figures)
    screen = console()
    for row in figures["rows"]:
        if row["source"] == "all" and row["mount"] == "all":
            screen.print(
                f"{row['part']:9} {row['kind']:9} {row['way']:20} recall {_share(row['recall'])}  "
                f"precision {_share(row['precision'])}  delay {_share(row['delay_ms'], 1)} ms"
            )
    for foot in figures["real"]:
        for row in foot["rows"]:
            screen.print(
                f"{foot['name']:24} {row['kind']:9} {row['way']:20} recall {_share(row['recall'])}  "
                f"precision {_share(row['precision'])}"
            )
    screen.print(f"page: {path}")
    return 0


def _share(values: list[float] | None, digits: int = 3) -> str:
    return "-" if values is None else f"{values[0]:.{digits}f}"
