"""`make blind`: try the diagnosis of an ankle on machines in other equations whose truth is withheld from it.

It goes on where it was stopped: finished cases stand in a file, one line each.
"""

from __future__ import annotations

import hashlib
import json
import statistics
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from joblib import Parallel, delayed  # type: ignore[import-untyped]  # carries no types
from scipy.stats import binomtest  # type: ignore[import-untyped]  # carries no types

from jammkle_common.command.errors import InputError
from jammkle_common.command.main import run as run_command
from jammkle_common.command.results import make_folder
from studies.blind.observer import EXERCISES, LANDINGS, NAMEABLE, Observer
from studies.blind.trial import run_case

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    Case = Mapping[str, Any]

STANDARD_SEED, STANDARD_CASES = 46_900, 100
DEVELOPMENT_SEEDS = 1000
"""Seeds below it are for development; nothing in the diagnosis may be tuned on another."""

app = typer.Typer(add_completion=False, context_settings={"help_option_names": ["-h", "--help"]})


@app.command()
def blind(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of cases and keys.")] = Path("runs/blind"),
    seed: Annotated[int, typer.Option(help="Of the first case; below 1000: for development.")] = STANDARD_SEED,
    cases: Annotated[int, typer.Option(help="How many.")] = STANDARD_CASES,
    since: Annotated[bool, typer.Option("--since", help="Hand over five healthy runs of each.")] = False,  # noqa: FBT002
    landings: Annotated[bool, typer.Option("--landings", help="Landings in the place of exercises.")] = False,  # noqa: FBT002
    further: Annotated[int, typer.Option(help="Exercises that the diagnosis may ask for.")] = 3,
    jobs: Annotated[int, typer.Option(help="Cases at a time.")] = 2,
) -> int:
    """Try the diagnosis on machines whose truth is withheld from it."""
    for name, value, low in (
        ("--seed", seed, 0),
        ("--cases", cases, 1),
        ("--further", further, 0),
        ("--jobs", jobs, 1),
    ):
        if value < low:
            msg = f"{name} {value} must be {low} or more"
            raise InputError(msg)
    make_folder(output)
    file = output / f"{'landings' if landings else 'cases'}{'_since' if since else ''}.jsonl"
    done = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    wanted = range(seed, seed + cases)
    left = [each for each in wanted if each not in {one["truth"]["seed"] for one in done}]
    observer = Observer(output / "observer", LANDINGS if landings else EXERCISES)
    tasks = (delayed(run_case)(each, observer, output, further=further, since=since) for each in left)
    with file.open("a") as kept:
        for case in Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks):
            line = json.dumps(case)
            done.append(json.loads(line))  # as it is read when it goes on
            kept.write(line + "\n")
            kept.flush()
    typer.echo(figures([each for each in done if each["truth"]["seed"] in wanted]))
    digest = hashlib.sha256("".join(sorted(json.dumps(each["truth"]) for each in done)).encode())
    typer.echo(f"\nsha256 of the keys: {digest.hexdigest()[:16]}")
    return 0


def figures(cases: Sequence[Case]) -> str:
    """Return the figures of some cases as a table in Markdown."""
    kinds = {kind: [each for each in cases if each["truth"]["kind"] == kind] for kind in ("single", "pair", "outside")}
    healthy = [each for each in cases if each["truth"]["kind"] == "none"]
    singles, pairs, outside = ([each for each in kinds[kind] if is_nameable(each)] for kind in kinds)
    named = [each for each in cases if last(each)["verdict"] == "EFFECTS"]
    listed = [each for each in singles if last(each)["verdict"] in {"EFFECTS", "AMBIGUOUS"}]
    unknown = [each for each in outside if last(each)["verdict"] == "UNKNOWN"]
    lines = [
        "| figure | cases | 95 % |",
        "|---|---|---|",
        _row("single effects, first before further exercises", (is_first(each, 0) for each in singles)),
        _row("single effects, first after them", (is_first(each) for each in singles)),
        _row("single effects, first by the least RMS error after calibration", (
            [last(each)["rms"][0]] == each["truth"]["effects"] for each in singles if last(each)["rms"]
        )),
        _row("single effects, named for certain and right", (
            last(each)["verdict"] == "EFFECTS" and is_first(each) for each in singles
        )),
        _row("single effects, a gap was seen", (last(each)["verdict"] != "NO_GAP" for each in singles)),
        _row("truth in the set, of single effects with a set", (is_in_set(each) for each in listed)),
        _row("named for certain and wrong, of all that were", (is_wrong(each) for each in named)),
        _row("pairs, both named first", (is_first(each) for each in pairs)),
        _row("outside the library, something else", (last(each)["verdict"] == "UNKNOWN" for each in outside)),
        _row("- with the right subsystem", (last(each)["subsystem"] in each["truth"]["location"] for each in unknown)),
        _row("nothing wrong, no gap", (last(each)["verdict"] == "NO_GAP" for each in healthy)),
        _row("90 % intervals that hold the truth", (
            low <= each["truth"]["values"][key] <= high
            for each in singles
            if is_first(each)
            for key, (_, low, high) in last(each)["estimates"].items()
            if key in each["truth"]["values"]
        )),
    ]  # fmt: skip
    sizes = [len([names for names in last(each)["named"] if names]) for each in listed]
    closed = [last(each)["closed"] for each in singles if is_first(each)]
    further = [len(each["answers"]) - 1 for each in cases]
    cost = [sum(one["cpu_s"] for one in each["answers"]) for each in cases]
    for label, values in (
        ("mean size of the set", sizes),
        ("share of the gap that closes, median where the truth is first", closed),
        ("further exercises, mean", further),
        ("processor time of a case, median, s", cost),
    ):
        middle = statistics.mean if "mean" in label else statistics.median
        lines.append(f"| {label} | {middle(values):.3g} | |" if values else f"| {label} | | |")
    few = sum(not is_nameable(each) for kind in kinds.values() for each in kind)
    lines.append(f"| not nameable by the ideal observer, and left out above | {few} | |")
    return "\n".join(lines)


def last(case: Case) -> Mapping[str, Any]:
    """Return the last answer of a case."""
    answer: Mapping[str, Any] = case["answers"][-1]
    return answer


def is_nameable(case: Case) -> bool:
    """Return whether the ideal observer names all that is wrong."""
    return min(case["truth"]["distances"], default=0.0) >= NAMEABLE


def is_first(case: Case, number: int = -1) -> bool:
    """Return whether exactly what is true is the first candidate of an answer, or declared to show the same as it."""
    said, truth = case["answers"][number], sorted(case["truth"]["effects"])
    if said["verdict"] not in {"EFFECTS", "AMBIGUOUS"}:
        return False
    return bool(said["first"] == truth)


def is_in_set(case: Case) -> bool:
    """Return whether what is true is in the credible set."""
    return sorted(case["truth"]["effects"]) in [sorted(names) for names in last(case)["named"]]


def is_wrong(case: Case) -> bool:
    """Return whether something was named that is not wrong with the machine, and shows not the same as what is."""
    return not set(last(case)["first"]) <= set(case["truth"]["effects"]) and not is_in_set(case)


def _row(label: str, good: Iterable[bool]) -> str:
    values = list(good)
    if not values:
        return f"| {label} | | |"
    test = binomtest(sum(values), len(values)).proportion_ci(method="wilson")
    return f"| {label} | {sum(values)} of {len(values)} | {100 * test.low:.0f} to {100 * test.high:.0f} % |"


if __name__ == "__main__":
    sys.exit(run_command(app))
