"""`make blind`: arguments; what the subcommands do stands in modules of their own."""

# ruff: noqa: PLC0415 - imported where needed: `--help` shall not wait for NumPy

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from jammkle_common.command.main import run as run_command
from jammkle_common.command.options import JsonOption

app = typer.Typer(
    add_completion=False,
    help="Check the diagnosis blind: cases whose truth it is not told, their answers, and how good they are.",
    context_settings={"help_option_names": ["-h", "--help"]},
    no_args_is_help=True,
)

TrialArgument = Annotated[Path, typer.Argument(help="Folder of the trial.", metavar="TRIAL")]
JobsOption = Annotated[int | None, typer.Option(help="Processes, each for one case.", show_default="one per core")]
RealOption = Annotated[
    Path | None,
    typer.Option(
        help="Folder of real recordings (leak_down, pressure_friction, servo_friction): diagnosed too.", metavar="DIR"
    ),
]
SchedulerOption = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler that spreads the runs of each diagnosis.")
]


@app.command()
def make(
    seed: Annotated[int, typer.Option(help="Everything is drawn from it; below 1000: settings for development.")],
    cases: Annotated[int, typer.Option(help="How many cases; their kinds are shared out as in the standard trial.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the trial.", metavar="DIR")],
    key: Annotated[
        Path | None, typer.Option(help="File of the key.", show_default="beside the folder", metavar="FILE")
    ] = None,
    rig: Annotated[list[str] | None, typer.Option(help="Only this rig; may be repeated.", metavar="RIG")] = None,
    live: Annotated[int, typer.Option(help="Further cases, recorded from the live graph in real time.")] = 0,
    jobs: JobsOption = None,
) -> int:
    """Write the bags of a trial and, elsewhere, its key, and publish the key's hash. Goes on where it was stopped."""
    from studies.blind.make import MakeRequest, default_key
    from studies.blind.make import make as make_trial

    return make_trial(MakeRequest(seed, cases, output, key or default_key(output), jobs, rig or (), live))


@app.command()
def run(
    trial: TrialArgument,
    key: Annotated[
        Path | None,
        typer.Option(
            help="Open the key once all is diagnosed, and try the true effects alone and left out.", metavar="FILE"
        ),
    ] = None,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
) -> int:
    """Diagnose every case, in processes that see bags alone. Goes on where it was stopped."""
    from studies.blind.run import RunRequest
    from studies.blind.run import run as run_trial

    return run_trial(RunRequest(trial, key, jobs, scheduler))


@app.command()
def score(
    trial: TrialArgument,
    key: Annotated[Path, typer.Option(help="File of the key.", metavar="FILE")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the page, blind.html.", metavar="DIR")
    ] = Path("runs/blind"),
    json: JsonOption = None,
    real: RealOption = None,
) -> int:
    """Compare what was said with what is true, and write a page with every figure."""
    from studies.blind.score import ScoreRequest
    from studies.blind.score import score as score_trial

    return score_trial(ScoreRequest(trial, key, output, json, real))


@app.command()
def standard(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of trial, key and page.", metavar="DIR")
    ] = Path("runs/blind"),
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    json: JsonOption = None,
    real: RealOption = None,
) -> int:
    """Make, diagnose and score the standard trial. Goes on where it was stopped."""
    from studies.blind.standard import StandardRequest
    from studies.blind.standard import standard as run_standard

    return run_standard(StandardRequest(output, jobs, scheduler, json, real))


@app.command(hidden=True)
def answer(
    questions: Annotated[Path, typer.Argument(help="What is asked, as `run` writes it.", metavar="QUESTIONS")],
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
) -> int:
    """Answer what `run` asks of one case, and write the answers beside the questions."""
    from studies.blind.answer import AnswerRequest
    from studies.blind.answer import answer as answer_questions

    return answer_questions(AnswerRequest(questions, jobs, scheduler))


if __name__ == "__main__":
    sys.exit(run_command(app))
