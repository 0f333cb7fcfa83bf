"""`make soak`: jam with something going wrong every few seconds, for long; exits 1 where anything was unsafe."""

from __future__ import annotations

from typing import Annotated

import typer

from jammkle_driver.fake.soak import soak

_MOST_GROWN_KIB = 4096.0
"""Memory that a soak may come to hold after its first tenth, KiB: half an hour grew by 0 to 128 KiB. Chosen."""


def main(
    minutes: Annotated[float, typer.Option(min=0.1, help="Simulated time, min.")] = 30.0,
    seed: Annotated[int, typer.Option(min=0, help="Start of all that is random.")] = 0,
) -> None:
    """Jam with random faults for long; exits 1 where anything was unsafe, or memory has grown."""
    result = soak(minutes * 60.0, seed)
    typer.echo(
        f"{result.simulated_s / 60.0:.1f} min, {result.faults} faults, {result.told} told, "
        f"{len(result.missed)} missed safe states or stuck channels, memory {result.grown_kib:+.0f} KiB"
    )
    for line in result.missed[:20]:
        typer.echo(line)
    raise typer.Exit(1 if result.missed or result.grown_kib > _MOST_GROWN_KIB else 0)


if __name__ == "__main__":
    typer.run(main)
