"""`make paper`: run everything the paper did, compare, and write one page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, Interrupted, StopRequest
from jammkle_common.command.main import run as run_command
from jammkle_common.command.options import JsonOption
from jammkle_common.command.results import progress_bar
from jammkle_common.constants import HELD_VACUUM_PA, MAX_REPEATS, MAX_SEED
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.constants import TENDON_SETS
from jammkle_sim.rigs.simulation import UnstableSimulationError
from studies.paper.comparison import Outcomes, compare_claims, compare_hanging, compare_rows, slip_statistics
from studies.paper.figures import SET_NAMES, deformation, pictures
from studies.paper.page import Findings, page
from studies.paper.reasons import REASONS
from studies.paper.refit import refit as fit_again
from studies.paper.runs import (
    CURVE_EXPERIMENTS,
    HANGING,
    PARAMETER_SETS,
    ROW_EXPERIMENTS,
    SLIP_EXPERIMENTS,
    Task,
    run_all,
)
from studies.paper.tables import ROWS

if TYPE_CHECKING:
    from collections.abc import Callable

    from studies.paper.comparison import ClaimComparison, HangingComparison, RowComparison
    from studies.paper.refit import FitResult
    from studies.paper.runs import Outcome

PAGE_NAME = "paper.html"


app = typer.Typer(add_completion=False, context_settings={"help_option_names": ["-h", "--help"]})


@app.command()
def paper(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the page, paper.html.", metavar="DIR")
    ] = Path("runs/paper"),
    repeats: Annotated[int, typer.Option(help=f"Scattered repeats of each test, 2 to {MAX_REPEATS}.")] = 5,
    seed: Annotated[int, typer.Option(help=f"Seed of scatter and noise, 0 to {MAX_SEED}.")] = 0,
    refit: Annotated[  # noqa: FBT002 - a switch of the command line
        bool, typer.Option("--refit", help="Fit the tendon's constants again first; exit 1 if others come out.")
    ] = False,
    json: JsonOption = None,
) -> int:
    """Run every test of the paper and write a page with its tables and figures beside the simulation."""
    _check(output, json, repeats, seed)
    stop = StopRequest()
    fit = _fit(stop) if refit else None
    outcomes = Outcomes(_run(tasks(repeats, seed), stop))
    rows, claims, slips = compare_rows(outcomes), compare_claims(outcomes), slip_statistics(outcomes)
    hanging = compare_hanging(outcomes)
    with results.console().status("drawing"):
        deformations = [deformation(TENDON_SETS["fitted"], vacuum_pa) for vacuum_pa in (0.0, HELD_VACUUM_PA)]
        drawn = pictures(outcomes, rows, deformations)
    reasons = {entry.identifier: entry.sentence for entry in REASONS}
    findings = Findings(seed, repeats, rows, claims, slips, hanging, drawn, reasons, outcomes.broken(), fit)
    target = output / PAGE_NAME
    target.write_text(page(findings), encoding="utf-8")
    content: dict[str, Any] = {
        "rows": [row.as_json() for row in rows],
        "claims": [claim.as_json() for claim in claims],
        "slip": [slip.as_json() for slip in slips],
        "slip_hanging": [each.as_json() for each in hanging],
        "repeats": repeats,
        "seed": seed,
        "page": str(target),
    }
    if fit is not None:
        content["refit"] = _fit_json(fit)
    results.write_json(json, content)
    _show(rows, claims, hanging, fit, target)
    return 1 if fit is not None and not fit.reproduces_committed else 0


def tasks(repeats: int, seed: int) -> list[Task]:
    """Return every run, the long ones first, so that no core waits at the end."""
    repeated = [
        Task(experiment, parameter_set, seed, repeat)
        for experiment in (*SLIP_EXPERIMENTS, *ROW_EXPERIMENTS)
        for parameter_set in PARAMETER_SETS
        for repeat in range(repeats)
    ]
    single = [
        Task(experiment, parameter_set, seed, None)
        for experiment in CURVE_EXPERIMENTS
        for parameter_set in PARAMETER_SETS
    ]
    hanging = [Task(experiment, PARAMETER_SETS[0], seed, None) for slip in HANGING for experiment in slip.runs]
    return [*hanging, *repeated, *single]


def _check(folder: Path, json: Path | None, repeats: int, seed: int) -> None:
    for option, value, least, most in (("--repeats", repeats, 2, MAX_REPEATS), ("--seed", seed, 0, MAX_SEED)):
        if not least <= value <= most:
            msg = f"{option} {value} must be {least} to {most}"
            raise InputError(msg)
    if json is not None and json.absolute().parent != folder.absolute():
        results.check_writable(json)
    results.make_folder(folder)
    results.check_writable(json)
    results.check_writable(folder / PAGE_NAME, "--output")


def _run(todo: list[Task], stop: Callable[[], bool]) -> tuple[Outcome, ...]:
    with progress_bar("the paper's tests") as show:

        def on_done(done: int, task: Task) -> None:
            show(done / len(todo), f"{task.experiment.test.replace('_', ' ')}, {SET_NAMES[task.parameter_set]}")

        try:
            return run_all(todo, on_done, stop)
        except (ParameterError, UnstableSimulationError) as error:
            raise GraphError(str(error)) from error


def _fit(stop: Callable[[], bool]) -> FitResult:
    with progress_bar("fitting again") as show:

        def on_progress(share: float) -> None:
            if stop():
                raise Interrupted
            show(share, "")

        return fit_again(on_progress)


def _fit_json(fit: FitResult) -> dict[str, Any]:
    return {
        "reproduces_committed": fit.reproduces_committed,
        "largest_deviation": fit.largest_deviation,
        "reference_rms_n": fit.reference_rms_n,
        "constants": [
            {
                "name": constant.unknown.name,
                "unit": constant.unknown.unit,
                "committed": constant.committed,
                "fitted": constant.fitted,
            }
            for constant in fit.constants
        ],
    }


def _show(
    rows: tuple[RowComparison, ...],
    claims: tuple[ClaimComparison, ...],
    hanging: tuple[HangingComparison, ...],
    fit: FitResult | None,
    target: Path,
) -> None:
    console = results.console()
    table = Table(title="Paper and simulation (z in standard errors of the paper)", title_justify="left")
    table.add_column("row")
    table.add_column("paper", justify="right")
    for parameter_set in PARAMETER_SETS:
        table.add_column(SET_NAMES[parameter_set], justify="right")
        table.add_column("z", justify="right")
    for row in ROWS:
        cells = [
            text
            for each in rows
            if each.row is row
            for text in (
                f"{each.simulated.mean:.2f}",
                _coloured(f"{round(each.z, 1) + 0.0:+.1f}", good=each.reproduced),
            )
        ]
        table.add_row(row.title, f"{row.mean:.2f} ± {row.standard_error:.3f} {row.unit}", *cells)
    console.print(table)
    for claim in claims:
        verdict = _coloured("holds" if claim.holds else "does not hold", good=claim.holds)
        console.print(f"{claim.claim.text}, {SET_NAMES[claim.parameter_set]}: {verdict} ({claim.evidence})")
    hold = any(each.holds for each in hanging)
    verdict = _coloured("all hold at some of them" if hold else "never all hold", good=hold)
    console.print(f"the claims on feet that hang, at {len(hanging)} pitches and frictions: {verdict}")
    if fit is not None:
        verdict = "the committed constants" if fit.reproduces_committed else "OTHER constants than the committed"
        console.print(f"fitted again: {verdict}, largest difference {fit.largest_deviation:.2%}")
    console.print(f"page: {target}", markup=False)


def _coloured(text: str, *, good: bool) -> str:
    return f"[{'green' if good else 'red'}]{text}[/]"


if __name__ == "__main__":
    sys.exit(run_command(app))
