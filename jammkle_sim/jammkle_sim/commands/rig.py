"""`jammkle rig`: run a rig once or several times, write bags, say what it measured."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.writing import check_free
from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, StopRequest
from jammkle_common.command.options import JsonOption, NamespaceOption
from jammkle_common.command.results import progress_bar
from jammkle_common.constants import MAX_REPEATS
from jammkle_common.names import normalised
from jammkle_sim.commands.bag import write_bags
from jammkle_sim.commands.table import Option, command_of, epilog_of, errors_of_a_run, figures_table
from jammkle_sim.conversions import NotFiniteError
from jammkle_sim.rigs.catalogue import RIGS, as_it_is, run_rig, save_mjcf, scattered
from jammkle_sim.rigs.rig import load_change

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.run import RigRun

_RUN_SHARE = 0.5
"""Share of the time of one repeat that the run takes; the rest is the bag. Measured, roughly."""


_COMMON: dict[str, Option] = {
    "output": (
        Annotated[
            Path | None,
            typer.Option(
                "-o",
                "--output",
                help="Folder of the new bag; with --repeats one each: NAME_0, NAME_1, ...",
                metavar="DIR",
            ),
        ],
        None,
    ),
    "repeats": (
        Annotated[
            int,
            typer.Option(help=f"Runs, 1 to {MAX_REPEATS}; more than one scatter as the rig does, drawn from --seed."),
        ],
        1,
    ),
    "namespace": (NamespaceOption, "/"),
    "effects": (
        Annotated[
            Path | None,
            typer.Option(
                help="File of effects to put into the rig, such as the corrected.yaml of a gap diagnosis.",
                metavar="FILE",
            ),
        ],
        None,
    ),
    "json": (JsonOption, None),
    "save_mjcf": (
        Annotated[
            Path | None,
            typer.Option(
                help="Write the model that is simulated to this file (MJCF): bodies and contacts, without the law of "
                "the tendons, the air, or the release and drive of the carriage.",
                metavar="FILE",
            ),
        ],
        None,
    ),
}


@dataclasses.dataclass(frozen=True)
class _Done:
    run: RigRun
    bag: Path | None
    messages: int


def rig(arguments: list[str]) -> int:
    """Run `jammkle rig` with its arguments and return the exit code."""
    code = rig_app(run_repeats)(arguments or ["--help"], prog_name="jammkle rig", standalone_mode=False)
    return code if isinstance(code, int) else 0


def rig_app(run: Callable[[str, dict[str, Any], Any], int]) -> typer.Typer:
    """Return the command line of all rigs; `run` gets a rig's name, the common options by name, and the rig's own."""
    app = typer.Typer(
        help="Run a rig without the graph, as fast as it can, and write a bag.",
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        add_completion=False,
    )
    for kind in RIGS.values():
        command = command_of(f"rig {kind.name}", kind.options, _COMMON, partial(run, kind.name))
        title = f"{kind.title[0].upper()}{kind.title[1:]}."
        app.command(kind.name, help=title, epilog=epilog_of(kind.options))(command)
    # A single command would swallow its own name.
    app.callback()(lambda: None)
    return app


def run_repeats(name: str, given: dict[str, Any], options: Any) -> int:
    """Check everything, run every repeat, write its bag, and show the results.

    Raises:
        InputError: something cannot be as asked for; nothing was written.
        GraphError: the simulation blew up.
        Interrupted: asked to stop; the bags of the repeats before are complete.

    """
    namespace, repeats = normalised(given["namespace"]), given["repeats"]
    change = _change(given["effects"])
    bags = _check(name, given, options)
    stop = StopRequest()
    definitions = MessageDefinitions(share_folders())
    done: list[_Done] = []
    with progress_bar(f"rig {name}") as show:
        for repeat, bag in enumerate(bags):

            def on_progress(share: float, *, repeat: int = repeat) -> None:
                show((repeat + _RUN_SHARE * share) / repeats, f"run {repeat + 1} of {repeats}")

            scattering = scattered(name, options, repeat) if repeats > 1 else options
            with errors_of_a_run():
                run = run_rig(name, scattering, on_progress, stop, change)
            messages = 0
            if bag is not None:
                try:
                    messages = write_bags({"": run}, bag, namespace, definitions).messages
                except NotFiniteError as error:
                    msg = f"rig {name}: {error}; {bag} ends before it"
                    raise GraphError(msg) from error
            done.append(_Done(run, bag, messages))
    _show(name, done, given["save_mjcf"])
    results.write_json(
        given["json"], {"rig": name, "runs": [_as_json(repeat, each) for repeat, each in enumerate(done)]}
    )
    return 0


def _check(name: str, given: dict[str, Any], options: Any) -> list[Path | None]:
    """Refuse what cannot work before anything is run, and return where each repeat's bag goes."""
    output, repeats, mjcf = given["output"], given["repeats"], given["save_mjcf"]
    if not 1 <= repeats <= MAX_REPEATS:
        msg = f"--repeats {repeats} must be 1 to {MAX_REPEATS}"
        raise InputError(msg)
    if output is None and mjcf is None:
        msg = "Missing option '--output' / '-o': the folder of the new bag (or --save-mjcf FILE for the model alone)"
        raise InputError(msg)
    results.check_writable(given["json"])
    results.check_writable(mjcf, "--save-mjcf")
    numbered = output is not None and repeats > 1
    bags = [output.with_name(f"{output.name}_{i}") if numbered else output for i in range(repeats)]
    for bag in bags:
        if bag is not None:
            check_free(bag)
    if mjcf is not None:
        try:
            with errors_of_a_run():
                save_mjcf(name, options, mjcf)
        except OSError as error:
            msg = f"--save-mjcf {mjcf} cannot be written: {error.strerror}"
            raise InputError(msg) from error
    return bags


def _change(effects: Path | None) -> Callable[[Rig], Rig]:
    """Return what is done to the rig before it runs."""
    if effects is None:
        return as_it_is
    try:
        return load_change(effects)
    except InputError as error:
        msg = f"--effects {effects}: {error}"
        raise InputError(msg) from error


def _show(name: str, done: list[_Done], mjcf: Path | None) -> None:
    console = results.console()
    columns = {f"run {i}" if len(done) > 1 else "value": each.run.results for i, each in enumerate(done)}
    console.print(figures_table(f"Rig {name}", columns))
    if left_out := done[0].run.left_out:
        console.print(f"left out of --effects, as only a replay of recorded commands shows them: {', '.join(left_out)}")
    for each in done:
        where = f" in {escape(str(each.bag))}" if each.bag is not None else ""
        if each.run.clipped:
            console.print(f"clipped{where}: {', '.join(each.run.clipped)}; figures taken from it are too small")
        if each.run.broken:
            console.print(f"broken{where}: {', '.join(each.run.broken)} tore; without force from there on")
        if each.bag is not None:
            console.print(f"{each.messages} messages are in {each.bag}", markup=False)
    if mjcf is not None:
        console.print(f"the model is in {mjcf}", markup=False)


def _as_json(repeat: int, done: _Done) -> dict[str, Any]:
    return {
        "repeat": repeat,
        "bag": None if done.bag is None else str(done.bag),
        "messages": done.messages,
        "options": dataclasses.asdict(done.run.options),
        "results": {name: value if math.isfinite(value) else None for name, value in done.run.results.items()},
        "broken": list(done.run.broken),
        "clipped": list(done.run.clipped),
        "left_out": list(done.run.left_out),
    }
