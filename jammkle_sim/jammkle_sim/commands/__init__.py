"""Arguments of `jammkle rig`, `robot` and `urdf`. What they do stands in modules of their own."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for NumPy and Matplotlib

from __future__ import annotations

from typing import Annotated

import typer

from jammkle_common.command.options import WITHOUT_A_ROBOT
from jammkle_common.names import normalised
from jammkle_sim.commands.robot_options import RobotRequest, robot_command
from jammkle_sim.robots.options import ROBOTS, ImuPlace

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
    from jammkle_sim.commands.rig_run import rig as run

    return run(arguments or [])


def _run_robot(request: RobotRequest) -> int:
    from jammkle_sim.commands.robot_run import robot as run

    return run(request)


app.command("robot", rich_help_panel=WITHOUT_A_ROBOT)(robot_command(_run_robot))


@app.command(rich_help_panel=WITHOUT_A_ROBOT)
def urdf(
    robot: Annotated[str, typer.Argument(help=f"{', '.join((ANKLE, *ROBOTS))}.", metavar="ROBOT")],
    namespace: Annotated[str, typer.Option("--namespace", help="ROS namespace that the frames begin with.")] = "/",
    imu: Annotated[str, typer.Option(help=f"Where a robot's IMUs are: {', '.join(IMU_PLACES)}.")] = "shank",
    payload_kg: Annotated[float, typer.Option(help="What a robot carries, 0 to 4 kg.")] = 0.0,
) -> int:
    """Print the URDF of an ankle, a leg or a quadruped, made from the model that is simulated."""
    from jammkle_sim.commands.urdf_made import urdf as write

    return write(robot, normalised(namespace), {"imu": imu, "payload_kg": payload_kg})
