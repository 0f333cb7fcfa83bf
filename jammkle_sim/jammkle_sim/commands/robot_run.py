"""`jammkle robot`: run a leg or a quadruped once, write a bag, say what its feet did."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from rich.table import Table

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.writing import check_free
from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, Interrupted, StopRequest
from jammkle_common.command.results import progress_bar
from jammkle_common.names import CHANNELS, normalised
from jammkle_common.parameters import ParameterError, as_typed
from jammkle_sim.commands.rig_bag import write_bags
from jammkle_sim.conversions import NotFiniteError
from jammkle_sim.rigs.run import RigCancelledError
from jammkle_sim.rigs.simulation import UnstableSimulationError
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.recording import record

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_sim.commands.robot_options import RobotRequest
    from jammkle_sim.rigs.run import RigRun

_RUN_SHARE = 0.5
"""Share of the time that the run takes; the rest is the bag. Measured, roughly."""


def robot(request: RobotRequest) -> int:
    """Check everything, run the robot, write its bag, and show the figures.

    Raises:
        InputError: something cannot be as asked for; nothing was written.
        GraphError: the simulation blew up.
        Interrupted: asked to stop.

    """
    namespace = normalised(request.namespace)
    results.check_writable(request.json)
    check_free(request.bag)
    with progress_bar(f"robot {request.robot}") as show:
        runs = _run(request, lambda share: show(_RUN_SHARE * share, ""), StopRequest(), namespace)
        # as on the graph: a single ankle is in the robot's own namespace, several are below it
        placed = runs if len(runs) > 1 else {"": next(iter(runs.values()))}
        try:
            counts = write_bags(placed, request.bag, namespace, MessageDefinitions(share_folders()))
        except NotFiniteError as error:
            msg = f"robot {request.robot}: {error}; {request.bag} ends before it"
            raise GraphError(msg) from error
    _show(request, runs)
    results.console().print(f"{counts.messages} messages are in {request.bag}", markup=False)
    ankles = {name: {"results": run.results, "broken": list(run.broken)} for name, run in runs.items()}
    content = {"robot": request.robot, "bag": str(request.bag), "options": dataclasses.asdict(request.options)}
    results.write_json(request.json, {**content, "ankles": ankles})
    return 0


def _run(
    request: RobotRequest, on_progress: Callable[[float], None], stop: Callable[[], bool], namespace: str
) -> dict[str, RigRun]:
    try:
        simulation = robot_simulation(request.robot, request.options)
        for view in simulation.ankles.values():
            view.hold_vacuum(dict.fromkeys(CHANNELS, request.vacuum_pa))
        return record(simulation, request.duration_s, request.imu_rate_hz, on_progress, stop, namespace)
    except ParameterError as error:
        raise InputError(as_typed(error)) from error
    except ValueError as error:
        msg = f"--imu-rate-hz {request.imu_rate_hz}: {error}"
        raise InputError(msg) from error
    except RigCancelledError as error:
        raise Interrupted from error
    except UnstableSimulationError as error:
        raise GraphError(as_typed(error)) from error


def _show(request: RobotRequest, runs: dict[str, RigRun]) -> None:
    table = Table(title=f"Robot {request.robot}", title_justify="left")
    table.add_column("figure")
    for name in runs:
        table.add_column(name, justify="right")
    for figure in next(iter(runs.values())).results:
        table.add_row(figure, *(f"{run.results[figure]:.5g}" for run in runs.values()))
    console = results.console()
    console.print(table)
    for name, run in runs.items():
        if run.broken:
            console.print(f"broken at {name}: {', '.join(run.broken)} tore; without force from there on")
