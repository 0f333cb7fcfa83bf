"""`make blind`: make a trial, diagnose it from its bags alone, compare with what is true, and write a page.

It goes on where it was stopped: finished cases and answers are kept by joblib.Memory in the folder of the trial.
"""

from __future__ import annotations

import dataclasses
import json as json_format
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import joblib  # type: ignore[import-untyped]  # carries no types
import typer

from jammkle_common.command.errors import InputError
from jammkle_common.command.main import run as run_command
from jammkle_common.command.options import JsonOption
from jammkle_common.command.results import check_writable, console, progress_bar, write_json
from jammkle_common.constants import MAX_SEED
from jammkle_gap import ankle_library
from studies.blind.cases import case_names, read_case, read_json, read_key, write_key
from studies.blind.diagnose import SAMPLED, Way, answers, blind_questions, commit, open_questions, sampled
from studies.blind.make import make_case, plan_of
from studies.blind.page import FIGURES, case_row, page
from studies.blind.plan import RIGS, STANDARD_CASES, STANDARD_SEED, regime
from studies.blind.score import Case, answer_of, score_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from studies.blind.cases import Truth
    from studies.blind.score import Answer, WayScore

MOST_CASES = 9999
_WAYS = {
    Way.WITH: "rig's sensors, five references",
    Way.FEWER: "rig's sensors, three references",
    Way.WITHOUT: "rig's sensors, no reference",
    Way.ROBOT: "robot's sensors, five references",
    Way.INSTRUMENTED: "instrumented tendons, five references",
}

app = typer.Typer(add_completion=False, context_settings={"help_option_names": ["-h", "--help"]})


@app.command()
def blind(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of trial, key and page, blind.html.", metavar="DIR")
    ] = Path("runs/blind"),
    seed: Annotated[
        int, typer.Option(help="Everything is drawn from it; below 1000: settings for development.")
    ] = STANDARD_SEED,
    cases: Annotated[
        int, typer.Option(help="How many; kinds are shared out as in the standard trial.")
    ] = STANDARD_CASES,
    rig: Annotated[list[str] | None, typer.Option(help="Only this rig; may be repeated.", metavar="RIG")] = None,
    jobs: Annotated[int, typer.Option(help="Processes, each for one case; -1: one per core.")] = -1,
    trial: Annotated[
        Path | None, typer.Option(help="A trial that is there already, with --key.", metavar="DIR")
    ] = None,
    key: Annotated[Path | None, typer.Option(help="What is true of the cases of --trial.", metavar="FILE")] = None,
    json: JsonOption = None,
) -> int:
    """Check the diagnosis blind: make cases, diagnose them from their bags alone, compare with what is true."""
    for name, value, low, high in (("--seed", seed, 0, MAX_SEED), ("--cases", cases, 1, MOST_CASES)):
        if not low <= value <= high:
            msg = f"{name} {value} must be {low} to {high}"
            raise InputError(msg)
    for each in rig or ():
        if each not in RIGS:
            msg = f"--rig '{each}' is not recorded in trials; known are: {', '.join(RIGS)}"
            raise InputError(msg)
    if (trial is None) != (key is None):
        msg = "--trial and --key belong together; give both, or neither to make a trial"
        raise InputError(msg)
    check_writable(json)
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"-o {output} cannot be made: {error.strerror}"
        raise InputError(msg) from error
    memory = joblib.Memory(output / "memory", verbose=0)
    facts: dict[str, Any] = {"commit": commit()}
    if trial is None or key is None:
        trial, key = output / "trial", output / "key.json"
        facts = {"seed": seed, "regime": regime(seed), "cases": cases, "rigs": rig or list(RIGS)} | facts
        _make(trial, key, facts, jobs, memory)
    notes = {name: read_case(trial / "cases" / name) for name in case_names(trial)}
    kept = memory.cache(answers)
    blind_ways = blind_questions(list(notes))
    said = _run([joblib.delayed(kept)(notes[name], asked) for name, asked in blind_ways.items()], jobs, "diagnosing")
    found = dict(zip(blind_ways, said, strict=True))
    # What is true is read only now that all that needs none of it is said.
    truths = read_key(key, trial)
    open_ways = open_questions(truths, with_ceiling="seed" in facts)
    said = _run(
        [joblib.delayed(kept)(notes[name], asked) for name, asked in open_ways.items()], jobs, "oracle, ceiling"
    )
    for name, more in zip(open_ways, said, strict=True):
        found[name] |= more
    content = _score(output, truths, found, facts)
    write_json(output / "blind.json", content)
    write_json(json, content)
    return 0


def _make(trial: Path, key: Path, facts: Mapping[str, Any], jobs: int, memory: Any) -> None:
    """Make the cases that are not made yet, and write what is true of them."""
    begun = trial / "trial.json"
    if begun.exists() and read_json(begun) | {"commit": ""} != dict(facts) | {"commit": ""}:
        msg = f"{trial} was begun otherwise ({begun}); give another folder, or remove {trial.parent}"
        raise InputError(msg)
    (trial / "cases").mkdir(parents=True, exist_ok=True)
    begun.write_text(json_format.dumps(facts), encoding="utf-8")
    plan, made = plan_of(facts["seed"], facts["cases"], facts["rigs"]), memory.cache(make_case)
    tasks = [joblib.delayed(made)(facts["seed"], case, trial / "cases" / case.name) for case in plan]
    write_key(key, dict(zip([case.name for case in plan], _run(tasks, jobs, "making cases"), strict=True)))


def _run(tasks: Sequence[Any], jobs: int, title: str) -> list[Any]:
    found = []
    with progress_bar(title) as show, joblib.parallel_config("loky", inner_max_num_threads=1):
        for done in joblib.Parallel(n_jobs=jobs, return_as="generator")(tasks):
            found.append(done)
            show(len(found) / len(tasks), f"{len(found)} of {len(tasks)} cases")
    return found


def _score(
    output: Path,
    truths: Mapping[str, Truth],
    found: Mapping[str, Mapping[str, Mapping[str, Any]]],
    facts: dict[str, Any],
) -> dict[str, Any]:
    """Compare what was said, by case and way, write the page, print the figures, and return all of them."""
    parameters = {f"{effect.name}.{each.name}": each for effect in ankle_library() for each in effect.parameters}

    def said(name: str, way: Way) -> Answer | None:
        return answer_of(found[name][way.value]) if way.value in found[name] else None

    def cases_of(way: Way, names: Sequence[str]) -> list[Case]:
        left_out = way is Way.WITH
        return [
            Case(name, truths[name], answer, said(name, Way.ORACLE),
                 said(name, Way.LEFT_OUT) if left_out else None, said(name, Way.CEILING))
            for name in names if (answer := said(name, way)) is not None
        ]  # fmt: skip

    names, some = sorted(truths), sorted(sampled(sorted(truths)))
    headline = cases_of(Way.WITH, names)
    ways = [score_of(_WAYS[Way.WITH], headline, parameters)]
    if len(some) < len(names):
        ways.append(score_of(f"{_WAYS[Way.WITH]}, sample of {len(some)}", cases_of(Way.WITH, some), parameters))
    ways += [score_of(_WAYS[way], cases_of(way, some), parameters) for way in _WAYS if way in SAMPLED]
    simple = {case.name: answer_of(found[case.name][Way.RMS.value]) for case in headline}
    others = [score_of("least RMS error", [
        Case(case.name, case.truth, dataclasses.replace(simple[case.name], classes=case.answer.classes))
        for case in headline
    ], parameters)]  # fmt: skip
    under = [case for case in headline if case.ceiling is not None]
    if under:
        others.append(
            score_of("ceiling", [Case(case.name, case.truth, case.ceiling) for case in under if case.ceiling], {})
        )
        others.append(score_of("this diagnosis, the ceiling's cases", under, parameters))
    facts["diagnosed by"] = ", ".join(sorted({case.answer.commit for case in headline} - {""}))
    target = output / "blind.html"
    target.write_text(page(ways, others, facts), encoding="utf-8")
    for figure in FIGURES:
        if figure.name in ways[0].figures:
            console().print(f"{figure.text}: {figure.shown(ways[0].figures)}", markup=False, highlight=False)
    console().print(f"page: {target}", markup=False)
    return {"trial": facts, "ways": {way.name: _as_dict(way) for way in (*ways, *others)}}


def _as_dict(way: WayScore) -> dict[str, Any]:
    def plain(found: Mapping[str, Any]) -> dict[str, Any]:
        return {name: dataclasses.asdict(each) for name, each in found.items()}

    return {
        "figures": plain(way.figures),
        "parts": {part: plain(found) for part, (_, found) in way.parts.items()},
        "calibration": [dataclasses.asdict(each) for each in way.bins],
        "outcomes": way.outcomes,
        "cases": [case_row(case) for case in way.cases],
    }


if __name__ == "__main__":
    sys.exit(run_command(app))
