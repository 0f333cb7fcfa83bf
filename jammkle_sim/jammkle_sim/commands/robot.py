"""`jammkle robot`: run a leg or a quadruped, write a bag, say what its feet did; or print its description."""

from __future__ import annotations

import dataclasses
import sys
from typing import TYPE_CHECKING, Any

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.writing import check_free
from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, StopRequest
from jammkle_common.command.results import progress_bar
from jammkle_common.names import CHANNELS, normalised
from jammkle_common.parameters import option_name, rows, typed_value
from jammkle_sim.commands.bag import write_bags
from jammkle_sim.commands.table import errors_of_a_run, figures_table
from jammkle_sim.conversions import NotFiniteError
from jammkle_sim.rigs.run import run_robot
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.catalogue import ANKLE, ankle_alone
from jammkle_sim.robots.catalogue import robot as robot_of_ours
from jammkle_sim.robots.options import ROBOTS, RobotRunOptions
from jammkle_sim.robots.urdf import robot_mjcf, robot_urdf

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from jammkle_sim.rigs.run import RigRun

_RUN_SHARE = 0.5
"""Share of the time that the run takes; the rest is the bag. Measured, roughly."""


def robot(given: dict[str, Any], options: RobotRunOptions) -> int:
    """Check everything, run the robot, write its bag, and show the figures.

    Raises:
        InputError: something cannot be as asked for; nothing was written.
        GraphError: the simulation blew up.
        Interrupted: asked to stop.

    """
    if given["robot"] not in ROBOTS:
        msg = f"ROBOT '{given['robot']}' does not exist; it must be {' or '.join(ROBOTS)}"
        raise InputError(msg)
    if given["output"] is None:
        msg = "Missing option '--output' / '-o': the folder of the new bag (or --urdf, --mjcf: the description alone)"
        raise InputError(msg)
    name, bag, namespace = given["robot"], given["output"], normalised(given["namespace"])
    results.check_writable(given["json"])
    check_free(bag)
    with progress_bar(f"robot {name}") as show:
        runs = _run(name, options, lambda share: show(_RUN_SHARE * share, ""), namespace)
        # as on the graph: a single ankle is in the robot's own namespace, several are below it
        placed = runs if len(runs) > 1 else {"": next(iter(runs.values()))}
        try:
            counts = write_bags(placed, bag, namespace, MessageDefinitions(share_folders()))
        except NotFiniteError as error:
            msg = f"robot {name}: {error}; {bag} ends before it"
            raise GraphError(msg) from error
    _show(name, runs)
    results.console().print(f"{counts.messages} messages are in {bag}", markup=False)
    ankles = {
        ankle: {"results": run.results, "broken": list(run.broken), "clipped": list(run.clipped)}
        for ankle, run in runs.items()
    }
    content = {"robot": name, "bag": str(bag), "options": dataclasses.asdict(options), "ankles": ankles}
    results.write_json(given["json"], content)
    return 0


def _run(
    name: str, options: RobotRunOptions, on_progress: Callable[[float], None], namespace: str
) -> dict[str, RigRun]:
    rate_hz = options.imu_rate_hz
    with errors_of_a_run():
        built = robot_of_ours(name, options)
        simulation = Simulation(built)
        for ankle in simulation.ankles.values():
            ankle.hold_vacuum(dict.fromkeys(CHANNELS, options.vacuum_pa))
        urdf_text = robot_urdf(built, namespace)
        try:
            return run_robot(simulation, options.duration_s, rate_hz, on_progress, StopRequest(), urdf_text)
        except ValueError as error:
            msg = f"{_changed(options, {'timestep_s', 'imu_rate_hz'})}: {error}, of which 1/rate must be a whole number"
            raise InputError(msg) from error


def _changed(options: RobotRunOptions, of: Collection[str] = ()) -> str:
    """Return the options that are not as by default, all or some, as they are typed."""
    values = [(row, getattr(options, row.name)) for row in rows(RobotRunOptions) if not of or row.name in of]
    changed = [(row.name, value) for row, value in values if value != row.default]
    return ", ".join(f"{option_name(name)} {typed_value(name, value)}" for name, value in changed)


def _show(name: str, runs: dict[str, RigRun]) -> None:
    console = results.console()
    console.print(figures_table(f"Robot {name}", {ankle: run.results for ankle, run in runs.items()}))
    for ankle, run in runs.items():
        if run.clipped:
            console.print(f"clipped at {ankle}: {', '.join(run.clipped)}; figures taken from it are too small")
        if run.broken:
            console.print(f"broken at {ankle}: {', '.join(run.broken)} tore; without force from there on")


def describe(given: dict[str, Any], options: RobotRunOptions) -> int:
    """Print the URDF or the MJCF of a robot, or of an ankle by itself, which has no options.

    Raises:
        InputError: there is no such robot, or both descriptions are asked for.

    """
    robot = given["robot"]
    if given["urdf"] and given["mjcf"]:
        msg = "--urdf and --mjcf are one description each; ask for one at a time"
        raise InputError(msg)
    if robot not in {ANKLE, *ROBOTS}:
        msg = f"ROBOT '{robot}' does not exist; it must be {', '.join((ANKLE, *ROBOTS))}"
        raise InputError(msg)
    if robot == ANKLE and options != RobotRunOptions():
        msg = f"{_changed(options)} needs ROBOT leg or quadruped: an ankle by itself carries nothing but its IMU"
        raise InputError(msg)
    built = ankle_alone() if robot == ANKLE else robot_of_ours(robot, options)
    namespace = normalised(given["namespace"])
    sys.stdout.write(robot_mjcf(built) if given["mjcf"] else robot_urdf(built, namespace))
    return 0
