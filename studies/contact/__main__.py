"""`make contact`: the trial and its page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from jammkle_common.command.errors import InputError
from jammkle_common.command.main import run as run_command
from jammkle_common.command.options import JsonOption
from jammkle_common.command.results import check_writable, console, make_folder, progress_bar, write_json
from studies.contact.benefit import benefit
from studies.contact.page import page, results
from studies.contact.real_foot import draw_real_foot, real_figures, real_foot
from studies.contact.trial import best_settings, run_trial

LEAST_STEPS = 40


app = typer.Typer(add_completion=False, context_settings={"help_option_names": ["-h", "--help"]})


@app.command()
def contact(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of contact.html and contact.json.", metavar="DIR")
    ] = Path("runs/contact"),
    steps: Annotated[int, typer.Option(help="Touch-downs and slides in all, half of them held out.")] = 400,
    seed: Annotated[int, typer.Option(help="Everything is drawn from it.")] = 0,
    runs: Annotated[int, typer.Option(help="Held-out landings of each robot and way for the benefit; 0: none.")] = 4,
    jobs: Annotated[int, typer.Option(help="Processes, each for one run.")] = 1,
    real: Annotated[
        Path | None, typer.Option(help="Folder of recordings of a real foot beside a force, as tables.", metavar="DIR")
    ] = None,
    json: JsonOption = None,
) -> int:
    """Try the detectors on randomised steps, slips and landings, and write a page with every figure."""
    check_writable(json)
    for name, value, least in (("steps", steps, LEAST_STEPS), ("runs", runs, 0), ("jobs", jobs, 1)):
        if value < least:
            msg = f"--{name} is {value}; it must be {least} or more"
            raise InputError(msg)
    make_folder(output)
    recordings = [] if real is None else sorted(real.glob("*.csv"))
    if real is not None and not recordings:
        msg = f"--real {real} holds no .csv; it must be a folder of tables: force, acceleration, rate"
        raise InputError(msg)
    with progress_bar("contact") as update:
        outcome = run_trial(seed, steps, jobs, update)
        rows = benefit(seed, runs, jobs, update) if runs else []
    feet = [real_foot(path, best_settings(outcome)) for path in recordings]
    figures = results(outcome, rows) | {"real": [real_figures(foot) for foot in feet]}
    for foot in feet:
        draw_real_foot(foot, output / f"{foot.name}.png")
    path = output / "contact.html"
    path.write_text(page(outcome, figures, seed), encoding="utf-8")
    write_json(output / "contact.json", figures)
    write_json(json, figures)
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


if __name__ == "__main__":
    sys.exit(run_command(app))
