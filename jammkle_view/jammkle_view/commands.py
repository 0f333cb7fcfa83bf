"""Arguments of `jammkle view`. What it does stands in modules of its own."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for MuJoCo and viser

from __future__ import annotations

import importlib.util
from pathlib import Path  # noqa: TC003 - Typer reads annotations while it runs
from typing import Annotated

import typer

from jammkle_common.command.errors import InputError, StopRequest
from jammkle_common.command.options import ON_BAGS
from jammkle_common.names import normalised
from jammkle_view.parameters import ANY_PORT, LOCAL_HOST, NO_PAGE

app = typer.Typer(context_settings={"help_option_names": ["-h", "--help"]})


@app.command(rich_help_panel=ON_BAGS)
def view(
    bag: Annotated[Path, typer.Argument(help="The bag.", metavar="BAG")],
    corrected: Annotated[
        Path | None,
        typer.Option(help="Effects file that corrects the simulation, from `jammkle gap diagnose`.", metavar="FILE"),
    ] = None,
    rig: Annotated[
        str | None,
        typer.Option(help="What it was recorded on, where the bag does not say: landing, drop ...", metavar="RIG"),
    ] = None,
    namespace: Annotated[
        str | None, typer.Option(help="ROS namespace of the ankle.", show_default="the only one in the bag")
    ] = None,
    no_simulation: Annotated[  # noqa: FBT002 - a switch of the command line
        bool, typer.Option("--no-simulation", help="Show the recording alone.")
    ] = False,
    port: Annotated[
        int, typer.Option("--view-port", help="TCP port of the page.", show_default="the first free one from 8080 on")
    ] = ANY_PORT,
    host: Annotated[
        str, typer.Option("--view-host", help="Address it listens on; 0.0.0.0: every network.")
    ] = LOCAL_HOST,
) -> int:
    """Play a bag back on a page in the browser, its simulation laid over it."""
    if importlib.util.find_spec("viser") is None:
        raise InputError(NO_PAGE)
    from jammkle_view.playback import run

    place = None if namespace is None else normalised(namespace)
    return run(bag, place, rig, corrected, host, port, StopRequest(), simulated=not no_simulation)
