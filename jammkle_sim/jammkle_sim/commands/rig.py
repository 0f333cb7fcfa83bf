"""`jammkle rig`: run a rig once or several times, write bags, say what it measured."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.writing import check_free
from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, Interrupted, StopRequest
from jammkle_common.command.options import JsonOption, NamespaceOption
from jammkle_common.command.results import progress_bar
from jammkle_common.constants import MAX_REPEATS
from jammkle_common.names import normalised
from jammkle_common.parameters import ParameterError, as_typed
from jammkle_sim.commands.bag import write_bag
from jammkle_sim.commands.table import Option, command_of
from jammkle_sim.conversions import NotFiniteError
from jammkle_sim.rigs.catalogue import RIGS, as_it_is, run_rig, save_mjcf, scattered
from jammkle_sim.rigs.rig import BadChangeError, load_change
from jammkle_sim.rigs.run import RigCancelledError
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.run import RigRun

_RUN_SHARE = 0.5
"""Share of the time of one repeat that the run takes; the rest is the bag. Measured, roughly."""


@dataclasses.dataclass(frozen=True)
class RigRequest:
    """One call of `jammkle rig`."""

    rig: str
    options: Any
    """The options dataclass of the rig."""
    bag: Path | None
    """Folder of the bag; with repeats the name that each one's number is put behind."""
    repeats: int
    namespace: str
    json: Path | None
    mjcf: Path | None
    effects: Path | None = None
    """File of effects that are put into the rig."""


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
    """One repeat."""

    run: RigRun
    bag: Path | None
    messages: int


def rig(arguments: list[str]) -> int:
    """Run `jammkle rig` with its arguments and return the exit code."""
    code = rig_app(run_request)(arguments or ["--help"], prog_name="jammkle rig", standalone_mode=False)
    return code if isinstance(code, int) else 0


def rig_app(run: Callable[[RigRequest], int]) -> typer.Typer:
    """Return the command line of all rigs; `run` gets what was asked for and returns the exit code."""
    app = typer.Typer(
        help="Run a rig without the graph, as fast as it can, and write a bag.",
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        add_completion=False,
    )
    for kind in RIGS.values():

        def asked(given: dict[str, Any], options: Any, *, name: str) -> int:
            return run(
                RigRequest(
                    rig=name,
                    options=options,
                    bag=given["output"],
                    repeats=given["repeats"],
                    namespace=given["namespace"],
                    json=given["json"],
                    mjcf=given["save_mjcf"],
                    effects=given["effects"],
                )
            )

        command = command_of(kind.options, _COMMON, partial(asked, name=kind.name))
        app.command(kind.name, help=f"{kind.title[0].upper()}{kind.title[1:]}.")(command)
    # A single command would swallow its own name.
    app.callback()(lambda: None)
    return app


def run_request(request: RigRequest) -> int:
    """Check everything, run every repeat, write its bag, and show the results.

    Raises:
        InputError: something cannot be as asked for; nothing was written.
        GraphError: the simulation blew up.
        Interrupted: asked to stop; the bags of the repeats before are complete.

    """
    namespace = normalised(request.namespace)
    change = _change(request)
    bags = _check(request)
    stop = StopRequest()
    definitions = MessageDefinitions(share_folders())
    done: list[_Done] = []
    with progress_bar(f"rig {request.rig}") as show:
        for repeat, bag in enumerate(bags):
            options = scattered(request.rig, request.options, repeat) if request.repeats > 1 else request.options

            def on_progress(share: float, *, repeat: int = repeat) -> None:
                show((repeat + _RUN_SHARE * share) / request.repeats, f"run {repeat + 1} of {request.repeats}")

            run = _run(request.rig, options, on_progress, stop, change)
            messages = 0
            if bag is not None:
                try:
                    messages = write_bag(run, bag, namespace, definitions).messages
                except NotFiniteError as error:
                    msg = f"rig {request.rig}: {error}; {bag} ends before it"
                    raise GraphError(msg) from error
            done.append(_Done(run, bag, messages))
    _show(request, done)
    content = {"rig": request.rig, "runs": [_as_json(repeat, each) for repeat, each in enumerate(done)]}
    results.write_json(request.json, content)
    return 0


def _check(request: RigRequest) -> list[Path | None]:
    """Refuse what cannot work before anything is run, and return where each repeat's bag goes."""
    if not 1 <= request.repeats <= MAX_REPEATS:
        msg = f"--repeats {request.repeats} must be 1 to {MAX_REPEATS}"
        raise InputError(msg)
    if request.bag is None and request.mjcf is None:
        msg = "Missing option '--output' / '-o': the folder of the new bag (or --save-mjcf FILE for the model alone)"
        raise InputError(msg)
    results.check_writable(request.json)
    results.check_writable(request.mjcf, "--save-mjcf")
    bags = [_bag_path(request, repeat) for repeat in range(request.repeats)]
    for bag in bags:
        if bag is not None:
            check_free(bag)
    if request.mjcf is not None:
        try:
            save_mjcf(request.rig, request.options, request.mjcf)
        except ParameterError as error:
            raise InputError(as_typed(error)) from error
        except OSError as error:
            msg = f"--save-mjcf {request.mjcf} cannot be written: {error.strerror}"
            raise InputError(msg) from error
    return bags


def _bag_path(request: RigRequest, repeat: int) -> Path | None:
    if request.bag is None or request.repeats == 1:
        return request.bag
    return request.bag.with_name(f"{request.bag.name}_{repeat}")


def _change(request: RigRequest) -> Callable[[Rig], Rig]:
    """Return what is done to the rig before it runs."""
    if request.effects is None:
        return as_it_is
    try:
        return load_change(request.effects)
    except BadChangeError as error:
        msg = f"--effects {request.effects}: {error}"
        raise InputError(msg) from error


def _run(
    name: str,
    options: Any,
    on_progress: Callable[[float], None],
    stop: Callable[[], bool],
    change: Callable[[Rig], Rig],
) -> RigRun:
    try:
        return run_rig(name, options, on_progress, stop, change)
    except ParameterError as error:
        raise InputError(as_typed(error)) from error
    except BadChangeError as error:
        raise InputError(str(error)) from error
    except RigCancelledError as error:
        raise Interrupted from error
    except UnstableSimulationError as error:
        raise GraphError(as_typed(error)) from error


def _show(request: RigRequest, done: list[_Done]) -> None:
    console = results.console()
    table = Table(title=f"Rig {request.rig}", title_justify="left")
    table.add_column("figure")
    for repeat in range(len(done)):
        table.add_column(f"run {repeat}" if len(done) > 1 else "value", justify="right")
    for name in dict.fromkeys(name for each in done for name in each.run.results):
        table.add_row(name, *(f"{each.run.results.get(name, math.nan):.5g}" for each in done))
    console.print(table)
    for each in done:
        where = f" in {escape(str(each.bag))}" if each.bag is not None else ""
        if each.run.clipped:
            console.print(f"clipped{where}: {', '.join(each.run.clipped)}; figures taken from it are too small")
        if each.run.broken:
            console.print(f"broken{where}: {', '.join(each.run.broken)} tore; without force from there on")
        if each.bag is not None:
            console.print(f"{each.messages} messages are in {each.bag}", markup=False)
    if request.mjcf is not None:
        console.print(f"the model is in {request.mjcf}", markup=False)


def _as_json(repeat: int, done: _Done) -> dict[str, Any]:
    return {
        "repeat": repeat,
        "bag": None if done.bag is None else str(done.bag),
        "messages": done.messages,
        "options": dataclasses.asdict(done.run.options),
        "results": {name: value if math.isfinite(value) else None for name, value in done.run.results.items()},
        "broken": list(done.run.broken),
        "clipped": list(done.run.clipped),
    }
