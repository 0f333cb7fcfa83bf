"""What a sim node can simulate: an ankle on its rig, or a robot on its ankles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_sim.ankles import RIG_OUTPUTS, ROBOT_OUTPUTS
from jammkle_sim.landing import landing_options
from jammkle_sim.parameters import RobotParameters, RunParameters, SimParameters
from jammkle_sim.robots.alone import ankle_alone
from jammkle_sim.walking import robot_options

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jammkle_sim.ankles import Ankle
    from jammkle_sim.core.schedule import Output
    from jammkle_sim.robots.robot import Robot


@dataclass(frozen=True)
class SimKind:
    """One kind of simulation on the graph."""

    parameters: type[RunParameters]
    """Table of the node's parameters."""
    outputs: tuple[Output, ...]
    """What each of its ankles can publish."""
    ankles_of: Callable[[Any], Mapping[str, Ankle]]
    """Gives the ankles of such a simulation, by namespace below the node's own."""
    reset_by: Callable[[Any], object]
    """Gives of the parameters what a reset builds the simulation anew for, once it is something else."""
    built_of: Callable[[Any], Any]
    """Gives what `exchange` of another simulation puts in the place of its own."""
    robot_of: Callable[[Any], Robot]
    """Gives what its robot description is made from."""


def _of_robot(simulation: Any) -> Mapping[str, Ankle]:
    """Return a robot's ankles by their names; a single one is in the node's own namespace."""
    ankles: Mapping[str, Ankle] = simulation.ankles
    return ankles if len(ankles) > 1 else {"": next(iter(ankles.values()))}


def _ankle_of_rig(simulation: Any) -> Robot:
    """Return a rig's ankle by itself: what a rig adds to it is none of a robot's."""
    return ankle_alone(simulation.rig.parts.get("ankle"))


RIG = SimKind(
    SimParameters,
    RIG_OUTPUTS,
    lambda simulation: {"": simulation},
    reset_by=landing_options,
    built_of=lambda simulation: simulation.rig,
    robot_of=_ankle_of_rig,
)
ROBOT = SimKind(
    RobotParameters,
    ROBOT_OUTPUTS,
    _of_robot,
    reset_by=robot_options,
    built_of=lambda simulation: simulation.robot,
    robot_of=lambda simulation: simulation.robot,
)
