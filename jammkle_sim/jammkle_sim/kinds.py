"""What a sim node simulates, made from its parameters: an ankle on the landing rig, or a robot on its ankles."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jammkle_common.command.errors import InputError
from jammkle_common.parameters import ParameterError
from jammkle_sim.core.engine import Output
from jammkle_sim.parameters import RobotParameters, RunParameters, SimParameters
from jammkle_sim.rigs.catalogue import as_it_is
from jammkle_sim.rigs.landing import LandingOptions, landing_built
from jammkle_sim.rigs.options import checked
from jammkle_sim.rigs.rig import load_change
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.catalogue import ankle_alone, robot
from jammkle_sim.robots.options import RobotOptions
from jammkle_sim.robots.robot import FollowingControl

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jammkle_sim.rigs.rig import Change, Machine
    from jammkle_sim.robots.robot import Robot


@dataclass(frozen=True)
class SimKind:
    """One kind of simulation on the graph."""

    parameters: type[RunParameters]
    """Table of the node's parameters."""
    options: type
    """Those of them that the machine is built from, and built anew from at a reset once they are others."""
    make: Callable[[Any], Simulation]
    """Builds it from the node's parameters."""
    outputs: tuple[Output, ...]
    """What each of its ankles can publish."""
    robot_of: Callable[[Any], Robot]
    """Gives what the robot description of a machine is made from."""

    def options_of(self, parameters: RunParameters) -> Any:
        """Return what the parameters say of the machine; speed and rates are none of its business."""
        return _options(self.options, parameters)


def make_simulation(parameters: SimParameters) -> Simulation:
    """Build the landing rig.

    Raises:
        ParameterError: the rig refuses a value, or the effects file cannot be used.

    """
    change = _effects(parameters.effects_file, lambda file: load_change(file).live()) or as_it_is
    options = checked(_options(LandingOptions, parameters))
    return _warmed_up(lambda: change(landing_built(options)))


def make_robot(parameters: RobotParameters) -> Simulation:
    """Build the robot.

    Raises:
        ParameterError: the robot refuses a value, or the effects file cannot be used.

    """
    change = _effects(parameters.effects_file, lambda file: load_change(file).live().of_robots())

    def built() -> Robot:
        made = robot(parameters.robot, _options(RobotOptions, parameters))
        chosen = _chosen_ankles([each.name for each in made.ankles], parameters.effects_ankle)
        changes = {} if change is None else dict.fromkeys(chosen, change)
        return dataclasses.replace(made, control=FollowingControl(made.model, made.control), changes=changes)

    try:
        return _warmed_up(built)
    except InputError as error:
        msg = f"parameter 'effects_file': {error}"
        raise ParameterError(msg) from error


def _chosen_ankles(names: Sequence[str], wanted: str) -> Sequence[str]:
    """Return the ankles that are meant; all where none is named.

    Raises:
        ParameterError: the robot has no such ankle.

    """
    if wanted and wanted not in names:
        msg = f"parameter 'effects_ankle' is '{wanted}'; this robot's ankles are: {', '.join(names)}"
        raise ParameterError(msg)
    return [wanted] if wanted else names


def _warmed_up(build: Callable[[], Machine]) -> Simulation:
    """Return a simulation at its start.

    The first step of a process compiles or loads the laws. It is taken by a machine that is thrown away, or else the
    simulated time of the real one would start with a backlog.
    """
    Simulation(build()).advance(1)
    return Simulation(build())


def _options(table: type, parameters: RunParameters) -> Any:
    return table(**{field.name: getattr(parameters, field.name) for field in fields(table)})


def _effects(file: str, load: Callable[[Path], Change]) -> Change | None:
    """Return what the effects of a file do; None without a file.

    Raises:
        ParameterError: it cannot be read, or holds effects that cannot be simulated.

    """
    if not file:
        return None
    try:
        return load(Path(file))
    except InputError as error:
        msg = f"parameter 'effects_file': {error}"
        raise ParameterError(msg) from error


RIG = SimKind(
    SimParameters,
    LandingOptions,
    make_simulation,
    tuple(output for output in Output if output not in (Output.TRUE_CONTACT, Output.GAIT)),
    lambda rig: ankle_alone(rig.parts.get("ankle")),  # what a rig adds to its ankle is none of a robot's
)
ROBOT = SimKind(
    RobotParameters,
    RobotOptions,
    make_robot,
    tuple(output for output in Output if output is not Output.LOAD_CELL),
    lambda built: built,
)
