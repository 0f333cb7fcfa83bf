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
from jammkle_common.parameters import in_si
from jammkle_sim.commands.bag import write_bags
from jammkle_sim.commands.table import errors_of_a_run, figures_table
from jammkle_sim.conversions import NotFiniteError
from jammkle_sim.rigs.options import changed_text
from jammkle_sim.rigs.run import run_robot
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.catalogue import ANKLE, ankle_alone
from jammkle_sim.robots.catalogue import robot as robot_of_ours
from jammkle_sim.robots.options import ROBOTS, RobotOptions
from jammkle_sim.robots.urdf import robot_mjcf, robot_urdf

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_sim.rigs.run import RigRun

_LONGEST_S, _SHORTEST_S = 3600.0, 0.1
_RATES_HZ = (100, 200, 500, 1000)
_LARGEST_VACUUM_KPA = 75.0
_RUN_SHARE = 0.5
"""Share of the time that the run takes; the rest is the bag. Measured, roughly."""


def robot(given: dict[str, Any], options: RobotOptions) -> int:
    """Check everything, run the robot, write its bag, and show the figures.

    Raises:
        InputError: something cannot be as asked for; nothing was written.
        GraphError: the simulation blew up.
        Interrupted: asked to stop.

    """
    _check(given)
    if given["output"] is None:
        msg = "Missing option '--output' / '-o': the folder of the new bag (or --urdf, --mjcf: the description alone)"
        raise InputError(msg)
    name, bag, namespace = given["robot"], given["output"], normalised(given["namespace"])
    results.check_writable(given["json"])
    check_free(bag)
    with progress_bar(f"robot {name}") as show:
        runs = _run(given, options, lambda share: show(_RUN_SHARE * share, ""), namespace)
        # as on the graph: a single ankle is in the robot's own namespace, several are below it
        placed = runs if len(runs) > 1 else {"": next(iter(runs.values()))}
        try:
            counts = write_bags(placed, bag, namespace, MessageDefinitions(share_folders()))
        except NotFiniteError as error:
            msg = f"robot {name}: {error}; {bag} ends before it"
            raise GraphError(msg) from error
    _show(name, runs)
    results.console().print(f"{counts.messages} messages are in {bag}", markup=False)
    ankles = {ankle: {"results": run.results, "broken": list(run.broken)} for ankle, run in runs.items()}
    content = {"robot": name, "bag": str(bag), "options": dataclasses.asdict(options), "ankles": ankles}
    results.write_json(given["json"], content)
    return 0


def _check(values: dict[str, Any]) -> None:
    """Refuse what is no robot's own option and out of range."""
    if values["robot"] not in ROBOTS:
        msg = f"ROBOT '{values['robot']}' does not exist; it must be {' or '.join(ROBOTS)}"
        raise InputError(msg)
    if not _SHORTEST_S <= values["duration_s"] <= _LONGEST_S:
        msg = f"--duration-s {values['duration_s']:g} must be {_SHORTEST_S:g} to {_LONGEST_S:g} s"
        raise InputError(msg)
    if values["imu_rate_hz"] not in _RATES_HZ:
        msg = f"--imu-rate-hz {values['imu_rate_hz']} must be one of {', '.join(map(str, _RATES_HZ))} Hz"
        raise InputError(msg)
    if not 0.0 <= values["vacuum_kpa"] <= _LARGEST_VACUUM_KPA:
        msg = f"--vacuum-kpa {values['vacuum_kpa']:g} must be 0 to {_LARGEST_VACUUM_KPA:g} kPa"
        raise InputError(msg)


def _run(
    given: dict[str, Any], options: RobotOptions, on_progress: Callable[[float], None], namespace: str
) -> dict[str, RigRun]:
    duration_s, rate_hz = given["duration_s"], given["imu_rate_hz"]
    with errors_of_a_run():
        built = robot_of_ours(given["robot"], options)
        simulation = Simulation(built)
        for ankle in simulation.ankles.values():
            ankle.hold_vacuum(dict.fromkeys(CHANNELS, float(in_si("vacuum_pa", given["vacuum_kpa"]))))
        urdf_text = robot_urdf(built, namespace)
        try:
            return run_robot(simulation, duration_s, rate_hz, on_progress, StopRequest(), urdf_text)
        except ValueError as error:
            msg = f"--imu-rate-hz {rate_hz}: {error}"
            raise InputError(msg) from error


def _show(name: str, runs: dict[str, RigRun]) -> None:
    console = results.console()
    console.print(figures_table(f"Robot {name}", {ankle: run.results for ankle, run in runs.items()}))
    for ankle, run in runs.items():
        if run.broken:
            console.print(f"broken at {ankle}: {', '.join(run.broken)} tore; without force from there on")


def describe(given: dict[str, Any], options: RobotOptions) -> int:
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
    if robot == ANKLE and options != RobotOptions():
        msg = f"{changed_text(options)} needs ROBOT leg or quadruped: an ankle by itself carries nothing but its IMU"
        raise InputError(msg)
    built = ankle_alone() if robot == ANKLE else robot_of_ours(robot, options)
    namespace = normalised(given["namespace"])
    sys.stdout.write(robot_mjcf(built) if given["mjcf"] else robot_urdf(built, namespace))
    return 0
