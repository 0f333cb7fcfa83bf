"""`make faults` and `make soak`: what the driver's diagnosis is worth, in numbers, into docs/faults.md."""

from __future__ import annotations

import os
from pathlib import Path  # noqa: TC003 - Typer reads annotations while it runs
from typing import Annotated

import typer

from jammkle_driver.fake.soak import soak
from jammkle_driver.fake.trial import healthy, run, tables

app = typer.Typer(help=__doc__, add_completion=False)
_WORKERS = max(1, (os.cpu_count() or 2) - 1)
BEGIN, END = "<!-- trial of faults: begin -->", "<!-- trial of faults: end -->"


@app.command()
def faults(
    count: Annotated[int, typer.Option(min=1, help="Injections.")] = 500,
    hours: Annotated[float, typer.Option(min=0.0, help="Healthy jamming, h.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Start of all that is random.")] = 0,
    page: Annotated[Path | None, typer.Option(help="Page whose tables are written anew; none: printed.")] = None,
) -> None:
    """Inject random faults into random ankles, jam healthy ones for hours, and write the tables."""
    outcomes = []
    with typer.progressbar(run(count, seed, _WORKERS), length=count, label="injections") as bar:
        outcomes.extend(bar)
    typer.echo(f"healthy jamming, {hours:g} h ...")
    text = tables(outcomes, healthy(hours, seed + 1_000_000, _WORKERS), hours)
    if page is None:
        typer.echo(text)
        return
    head, rest = page.read_text(encoding="utf-8").split(BEGIN)
    page.write_text(f"{head}{BEGIN}\n{text}{END}{rest.split(END)[1]}", encoding="utf-8")


@app.command("soak")
def soak_command(
    minutes: Annotated[float, typer.Option(min=0.1, help="Simulated time, min.")] = 30.0,
    seed: Annotated[int, typer.Option(min=0, help="Start of all that is random.")] = 0,
) -> None:
    """Jam with random faults for long; exits 1 where anything was unsafe."""
    result = soak(minutes * 60.0, seed)
    typer.echo(
        f"{result.simulated_s / 60.0:.1f} min, {result.faults} faults, {result.told} told, "
        f"{len(result.missed)} missed safe states or stuck channels, memory {result.grown_kib:+.0f} KiB"
    )
    for line in result.missed[:20]:
        typer.echo(line)
    raise typer.Exit(1 if result.missed else 0)


if __name__ == "__main__":
    app()
