"""`make robots`: try the diagnosis of any robot on machines whose truth is withheld from it, and print the figures.

It goes on where it was stopped: finished cases stand in a file, one line each.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Annotated, Any

import typer
from joblib import Parallel, delayed  # type: ignore[import-untyped]  # carries no types
from scipy.stats import binomtest  # type: ignore[import-untyped]  # carries no types

from studies.any_robot.trial import run_case

STANDARD_SEED, STANDARD_CASES = 3000, 100


def main(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the cases.")] = Path("runs/any_robot"),
    seed: Annotated[int, typer.Option(help="Of the first case; below 1000: for development.")] = STANDARD_SEED,
    cases: Annotated[int, typer.Option(help="How many.")] = STANDARD_CASES,
    jobs: Annotated[int, typer.Option(help="Cases at a time.")] = 2,
) -> None:
    """Try the diagnosis of any robot on machines whose truth is withheld from it."""
    output.mkdir(parents=True, exist_ok=True)
    file = output / "cases.jsonl"
    done = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    known = {each["seed"] for each in done}
    wanted = range(seed, seed + cases)
    left = [each for each in wanted if each not in known]
    with file.open("a") as kept:
        for case in Parallel(n_jobs=jobs, return_as="generator_unordered")(delayed(run_case)(each) for each in left):
            line = json.dumps(dataclasses.asdict(case))
            done.append(json.loads(line))  # as it is read when it goes on
            kept.write(line + "\n")
            kept.flush()
    typer.echo(figures([each for each in done if each["seed"] in wanted]))


def figures(cases: list[dict[str, Any]]) -> str:
    """Return the figures of some cases as a table in Markdown."""

    def names(value: Any) -> tuple[str, ...]:
        return tuple(sorted(value))

    def row(label: str, good: list[bool]) -> str:
        if not good:
            return f"| {label} | | |"
        test = binomtest(sum(good), len(good)).proportion_ci(method="wilson")
        return f"| {label} | {sum(good)} of {len(good)} | {100 * test.low:.0f} to {100 * test.high:.0f} % |"

    singles = [each for each in cases if each["kind"] == "single" and each["nameable"]]
    pairs = [each for each in cases if each["kind"] == "pair" and each["nameable"]]
    truth_in = [names(each["truth"]) in {names(one) for one in each["named"]} for each in singles]
    sure = [each for each in cases if each["verdict"] == "EFFECTS"]
    wrong = [not set(each["first"]) <= set(each["truth"]) for each in cases if each in sure]
    strange = [
        not any(each and set(each) <= set(own["truth"]) for each in own["named"]) for own in cases if own in sure
    ]
    outside = [each for each in cases if each["kind"] == "outside"]
    none = [each for each in cases if each["kind"] == "none"]
    lines = [
        "| figure | cases | 95 % |",
        "|---|---|---|",
        row("single effects, first", [names(each["first"]) == names(each["truth"]) for each in singles]),
        row("single effects, in the set", truth_in),
        row("named for certain, and wrong", wrong),
        row("the same, where the truth is not among what was named as showing the same", strange),
        row("pairs, first", [names(each["first"]) == names(each["truth"]) for each in pairs]),
        row("outside the library, and none of them in the set", [[] in each["named"] for each in outside]),
        row("nothing wrong, and nothing named for certain", [each["verdict"] != "EFFECTS" for each in none]),
        row("single effects, first by RMS error", [[each["rms"]] == each["truth"] for each in singles]),
        row("single effects, first by stepwise BIC", [each["bic"][:1] == each["truth"] for each in singles]),
        row("single effects, all that stepwise BIC takes", [each["bic"] == each["truth"] for each in singles]),
        row("single effects, largest move of least squares", [[each["largest"]] == each["truth"] for each in singles]),
    ]
    closed = sorted(each["closed"] for each in singles)
    if closed:
        lines.append(
            f"| squared error closed in windows that were not fitted, median | {closed[len(closed) // 2]:.2f} | |"
        )
    left_out = sum(each["kind"] in {"single", "pair"} and not each["nameable"] for each in cases)
    lines.append(f"| not nameable, and left out above | {left_out} | |")
    return "\n".join(lines)


if __name__ == "__main__":
    typer.run(main)
