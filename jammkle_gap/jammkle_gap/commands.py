"""Arguments of `jammkle gap`. What the subcommands do stands in modules of their own."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for NumPy

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jammkle_gap.simulated import Simulated
from jammkle_gap.trial.command import blind_app
from jammkle_graph.command.options import JsonOption

gap_app = typer.Typer(
    help="Find out where simulation and robot disagree, and why.",
    context_settings={"help_option_names": ["-h", "--help"]},
    no_args_is_help=True,
)
gap_app.add_typer(blind_app, name="blind")

app = typer.Typer()
app.add_typer(gap_app, name="gap")

LibraryOption = Annotated[Path | None, typer.Option(help="Effects of your own (YAML), beside the built-in ones.")]


@gap_app.command()
def diagnose(  # noqa: PLR0913, PLR0917 - every one is an option
    bags: Annotated[list[Path], typer.Argument(help="Recordings: repeats, or several settings.", metavar="BAG")],
    reference: Annotated[
        list[Path] | None,
        typer.Option(help="Recording of the same machine in good order; may be repeated. Asks what has changed."),
    ] = None,
    rig: Annotated[
        list[str] | None,
        typer.Option(
            help="RIG, or BAG=RIG for one bag: what was recorded where bags do not tell; tensile, pressure, drop, slip "
            "or landing; may be repeated.",
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="NAME=VALUE, or BAG:NAME=VALUE for one bag, names as in `jammkle rig RIG --help`: how the simulated "
            "rig is set, whatever bags say; may be repeated.",
        ),
    ] = None,
    library: LibraryOption = None,
    without: Annotated[
        list[str] | None, typer.Option(metavar="EFFECT", help="Take an effect out of the library; may be repeated.")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="EFFECT", help="Offer only effects named so; may be repeated.")
    ] = None,
    simulate: Annotated[
        Simulated,
        typer.Option(
            help="whole: all of it, from the commands alone. parts: each part from what was measured at its inputs; "
            "better for whatever touches the ground, if tendon tensions were recorded."
        ),
    ] = Simulated.WHOLE,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the page, gap.html, and of corrected.yaml.")
    ] = Path("runs/gap"),
    namespace: Annotated[str | None, typer.Option(help="Namespace of the ankle, if the bags hold several.")] = None,
    jobs: Annotated[int | None, typer.Option(help="Processes.", show_default="one per core where that pays")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler that spreads the runs.")] = None,
    json: JsonOption = None,
) -> int:
    """Say where recordings and simulator disagree, which effect explains it, and how far the gap shrinks.

    Ctrl-C ends the search and keeps what is known by then.
    """
    from jammkle_gap.diagnose import DiagnoseRequest
    from jammkle_gap.diagnose import diagnose as run

    return run(
        DiagnoseRequest(
            bags,
            reference or [],
            rig or [],
            settings or [],
            namespace,
            library,
            output,
            json,
            jobs,
            scheduler,
            without or (),
            only or (),
            simulate,
        )
    )


@gap_app.command()
def effects(
    library: LibraryOption = None,
    json: JsonOption = None,
) -> int:
    """List the effects that a diagnosis may name, with what it fits of each."""
    from jammkle_gap.effects import effects as show_effects

    return show_effects(library, json)
