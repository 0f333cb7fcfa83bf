"""Command lines of `jammkle rig` and `robot`. What they do stands in modules of their own."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for NumPy and MuJoCo

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jammkle_common.command.options import WITHOUT_A_ROBOT, JsonOption, NamespaceOption
from jammkle_sim.commands.table import REQUIRED, Option, command_of, epilog_of
from jammkle_sim.robots.options import ROBOTS, RobotRunOptions

ANKLE = "ankle"
"""What is no robot, but has a URDF."""

app = typer.Typer(context_settings={"help_option_names": ["-h", "--help"]})


@app.command(
    rich_help_panel=WITHOUT_A_ROBOT,
    # The options are the rig's: its own command line, made from its table of options, takes them all.
    context_settings={"help_option_names": [], "ignore_unknown_options": True, "allow_interspersed_args": False},
)
def rig(
    arguments: Annotated[list[str] | None, typer.Argument(help="NAME [OPTIONS]; see `jammkle rig --help`.")] = None,
) -> int:
    """Run a rig without the graph, as fast as it can, and write a bag."""
    from jammkle_sim.commands.rig import rig as run

    return run(arguments or [])


_ROBOT: dict[str, Option] = {
    "robot": (
        Annotated[str, typer.Argument(help=f"{' or '.join(ROBOTS)}; --urdf, --mjcf: {ANKLE} too.", metavar="ROBOT")],
        REQUIRED,
    ),
    "output": (
        Annotated[Path | None, typer.Option("-o", "--output", help="Folder of the new bag.", metavar="DIR")],
        None,
    ),
    "urdf": (
        Annotated[bool, typer.Option("--urdf", help="Print the robot's URDF, made from its model, and run nothing.")],
        False,
    ),
    "mjcf": (
        Annotated[bool, typer.Option("--mjcf", help="Print the robot's model as MuJoCo loads it, and run nothing.")],
        False,
    ),
    "namespace": (NamespaceOption, "/"),
    "json": (JsonOption, None),
}


def _robot(given: dict[str, Any], options: RobotRunOptions) -> int:
    from jammkle_sim.commands.robot import describe
    from jammkle_sim.commands.robot import robot as run

    return describe(given, options) if given["urdf"] or given["mjcf"] else run(given, options)


app.command(
    "robot",
    rich_help_panel=WITHOUT_A_ROBOT,
    help="Run a leg or a quadruped without the graph, as fast as it can, and write a bag with the true contacts.",
    epilog=epilog_of(RobotRunOptions),
)(command_of("robot {robot}", RobotRunOptions, _ROBOT, _robot))
