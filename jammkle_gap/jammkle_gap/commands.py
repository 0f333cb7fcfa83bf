"""Arguments of `jammkle gap`. What the subcommands do stands in modules of their own."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for NumPy

from __future__ import annotations

import enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jammkle_common.command.options import ON_THE_GAP, JsonOption, NamespaceOption

if TYPE_CHECKING:
    from collections.abc import Mapping

gap_app = typer.Typer(
    help="Find out where simulation and robot disagree, and why.",
    context_settings={"help_option_names": ["-h", "--help"]},
    no_args_is_help=True,
)

app = typer.Typer()
app.add_typer(gap_app, name="gap", rich_help_panel=ON_THE_GAP)

LibraryOption = Annotated[
    Path | None, typer.Option(help="Effects of your own (YAML), beside the built-in ones.", metavar="FILE")
]


class Sensors(enum.Enum):
    """Values of `ankle.sensors.SensorSet`, which takes longer to load than `--help` may."""

    ROBOT = "robot"
    RIG = "rig"
    INSTRUMENTED = "instrumented"


@gap_app.command()
def diagnose(  # noqa: PLR0913, PLR0917 - every one is an option
    bags: Annotated[list[Path], typer.Argument(help="Recordings: repeats, or several settings.", metavar="BAG")],
    since: Annotated[
        list[Path] | None,
        typer.Option(
            help="Earlier recording of the same machine, same setting: what has changed since? Five are good. "
            "May be repeated.",
            metavar="BAG",
        ),
    ] = None,
    rig: Annotated[
        str | None,
        typer.Option(
            metavar="RIG",
            help="Rig that was recorded, where a bag has no run sheet: one of `jammkle rig --help`. "
            "How it was set is written into run.yaml; `jammkle info` prints a template.",
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Any robot: its model (MJCF, URDF), or a map (YAML) that names it and what recordings call "
            "otherwise. Bags hold joint_states and commands, or are CSV files.",
        ),
    ] = None,
    held_out: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="BAG",
            help="Any robot: recording that nothing is fitted to, to try the corrected model on. May be repeated.",
        ),
    ] = None,
    library: LibraryOption = None,
    without: Annotated[
        list[str] | None, typer.Option(metavar="EFFECT", help="Take an effect out of the library; may be repeated.")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="EFFECT", help="Offer only effects named so; may be repeated.")
    ] = None,
    sensors: Annotated[
        Sensors | None,
        typer.Option(
            help="Sensors that are used. robot: pressures, IMU, joint angles. rig: and the load cell and the carriage. "
            "instrumented: and tension and extension of every tendon.",
            show_default="robot; rig where a load cell was recorded",
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the page, gap.html, and of corrected.yaml.", metavar="DIR")
    ] = Path("runs/gap"),
    namespace: Annotated[str | None, typer.Option(help="Namespace of the ankle, if the bags hold several.")] = None,
    jobs: Annotated[int | None, typer.Option(help="Processes.", show_default="one per core where that pays")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler that spreads the runs.")] = None,
    json: JsonOption = None,
) -> int:
    """Say where recordings and simulator disagree, which effect explains it, and how far the gap closes.

    Give all recordings of one machine together, whatever rigs they are of: its constants are fitted to all of them.
    With --since the question is what has changed since then.

    Ctrl-C ends the search and keeps what is known by then.
    """
    if model is not None:
        from jammkle_gap.mujoco.command import RobotRequest, diagnose_robot

        _refuse_with_model(
            {
                "--rig": rig,
                "--library": library,
                "--sensors": sensors,
                "--namespace": namespace,
                "--scheduler": scheduler,
            }
        )
        request = RobotRequest(model, bags, since or [], output, json, jobs, only or (), without or (), held_out or ())
        return diagnose_robot(request)
    if held_out:
        from jammkle_common.command.errors import InputError

        msg = f"--held-out {held_out[0]} goes with --model; of an ankle every recording is held out in turn"
        raise InputError(msg)
    from jammkle_gap.ankle.sensors import SensorSet
    from jammkle_gap.diagnosing import DiagnoseRequest
    from jammkle_gap.diagnosing import diagnose as run

    run(
        DiagnoseRequest(
            bags,
            since or [],
            rig,
            namespace,
            library,
            output,
            json,
            jobs,
            scheduler,
            without or (),
            only or (),
            None if sensors is None else SensorSet(sensors.value),
        )
    )
    return 0


def _refuse_with_model(given: Mapping[str, object]) -> None:
    """Refuse options of an ankle beside `--model`.

    Raises:
        InputError: one of them was given.

    """
    from jammkle_common.command.errors import InputError

    for option, value in given.items():
        if value is not None:
            shown = value.value if isinstance(value, enum.Enum) else value
            msg = f"{option} {shown} is of ankles, and --model diagnoses any robot"
            msg += "; leave one of them out (what recordings call otherwise stands in a map, docs/any_robot.md)"
            raise InputError(msg)


@gap_app.command()
def session(
    folder: Annotated[
        Path, typer.Argument(help="Gets a bag per run, and the page; what is there already counts.", metavar="DIR")
    ],
    further: Annotated[int, typer.Option(help="Most runs after the first exercises.")] = 3,
    namespace: NamespaceOption = "/",
    jobs: Annotated[int | None, typer.Option(help="Processes.", show_default="one per core where that pays")] = None,
    json: JsonOption = None,
) -> int:
    """Take a live robot through the exercises, diagnose it, and record what separates the causes that remain.

    It ends when one is named, or when no exercise on offer would separate what is left. A simulated robot goes on by
    itself; a real one moves again when a person says so.
    """
    from jammkle_common.names import normalised
    from jammkle_gap.session import SessionRequest
    from jammkle_gap.session import session as run

    run(SessionRequest(folder, normalised(namespace), further, json, jobs))
    return 0


@gap_app.command()
def effects(
    library: LibraryOption = None,
    json: JsonOption = None,
) -> int:
    """List the effects that a diagnosis may name, with what it fits of each."""
    from jammkle_gap.diagnosing import list_effects

    return list_effects(library, json)
