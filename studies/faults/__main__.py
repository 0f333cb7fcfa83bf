"""`make faults`: what the driver's diagnosis is worth, on its own law and on another one, into the README."""

from __future__ import annotations

import os
from pathlib import Path  # noqa: TC003 - Typer reads annotations while it runs
from typing import TYPE_CHECKING, Annotated

import typer

from fault_bench import fake_plant
from jammkle_driver.parameters import DriverParameters
from studies.faults.real_air import real_plant
from studies.faults.tables import tables
from studies.faults.trial import healthy, run

if TYPE_CHECKING:
    from fault_bench import PlantBuilder
    from studies.faults.trial import Outcome

_WORKERS = os.cpu_count() or 1
_PARTS: dict[str, PlantBuilder] = {"the law that it judges by": fake_plant, "the independent model": real_plant}
BEGIN, END = "<!-- trial of faults, {}: begin -->", "<!-- trial of faults, {}: end -->"


def main(
    count: Annotated[int, typer.Option(min=1, help="Injections on each law.")] = 500,
    hours: Annotated[float, typer.Option(min=0.0, help="Healthy jamming on each law, h.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Start of all that is random.")] = 0,
    page: Annotated[Path | None, typer.Option(help="Page whose tables are written anew; none: printed.")] = None,
) -> None:
    """Inject random faults into random ankles, beside the simplest baseline, jam healthy ones, and write the tables."""
    for name, build in _PARTS.items():
        outcomes: list[Outcome] = []
        with typer.progressbar(run(count, seed, _WORKERS, build), length=count, label=f"injections, {name}") as bar:
            outcomes.extend(bar)
        by_time_outs = list(run(count, seed, _WORKERS, build, DriverParameters(diagnose=False)))
        typer.echo(f"healthy jamming, {name}, {hours:g} h ...")
        text = tables(outcomes, by_time_outs, healthy(hours, seed + 1_000_000, _WORKERS, build), hours)
        if page is None:
            typer.echo(text)
            continue
        begin, end = BEGIN.format(name), END.format(name)
        head, rest = page.read_text(encoding="utf-8").split(begin)
        page.write_text(f"{head}{begin}\n{text}{end}{rest.split(end)[1]}", encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
