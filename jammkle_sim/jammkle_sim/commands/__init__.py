"""Command lines of `jammkle rig`, `robot` and `urdf`. What they do stands in modules of their own."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for NumPy and MuJoCo

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jammkle_common.command.options import WITHOUT_A_ROBOT, JsonOption, NamespaceOption
from jammkle_common.names import normalised
from jammkle_sim.commands.table import REQUIRED, Option, command_of
from jammkle_sim.robots.options import ROBOTS, ImuPlace, RobotOptions

ANKLE = "ankle"
"""What is no robot, but has a URDF."""
IMU_PLACES = tuple(place.value for place in ImuPlace)

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
    "robot": (Annotated[str, typer.Argument(help=f"{' or '.join(ROBOTS)}.", metavar="ROBOT")], REQUIRED),
    "output": (Annotated[Path, typer.Option("-o", "--output", help="Folder of the new bag.", metavar="DIR")], REQUIRED),
    "duration_s": (Annotated[float, typer.Option(help="Simulated time, 0.1 to 3600 s.")], 5.0),
    "imu_rate_hz": (
        Annotated[int, typer.Option(help="Rate of IMU, joints, tendons and true contact: 100, 200, 500 or 1000 Hz.")],
        500,
    ),
    "vacuum_kpa": (
        Annotated[float, typer.Option(help="Vacuum of all ankles from the start on, 0 to 75 kPa; 0: soft.")],
        0.0,
    ),
    "namespace": (NamespaceOption, "/"),
    "json": (JsonOption, None),
}


def _robot(given: dict[str, Any], options: RobotOptions) -> int:
    from jammkle_sim.commands.robot import robot as run

    return run(given, options)


app.command(
    "robot",
    rich_help_panel=WITHOUT_A_ROBOT,
    help="Run a leg or a quadruped without the graph, as fast as it can, and write a bag with the true contacts.",
)(command_of(RobotOptions, _ROBOT, _robot))


@app.command(rich_help_panel=WITHOUT_A_ROBOT)
def urdf(
    robot: Annotated[str, typer.Argument(help=f"{', '.join((ANKLE, *ROBOTS))}.", metavar="ROBOT")],
    namespace: Annotated[str, typer.Option("--namespace", help="ROS namespace that the frames begin with.")] = "/",
    imu: Annotated[str, typer.Option(help=f"Where a robot's IMUs are: {', '.join(IMU_PLACES)}.")] = "shank",
    payload_kg: Annotated[float, typer.Option(help="What a robot carries, 0 to 4 kg.")] = 0.0,
) -> int:
    """Print the URDF of an ankle, a leg or a quadruped, made from the model that is simulated."""
    from jammkle_sim.commands.robot import urdf as write

    return write(robot, normalised(namespace), {"imu": imu, "payload_kg": payload_kg})
